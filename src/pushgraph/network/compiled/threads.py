"""Scenes on as many threads as torch has."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import torch

SHARE = 16
"""Fewer scenes than this are not worth a thread of their own."""


def share_out(work: Callable[[int, int], None], count: int) -> None:
    """Call `work` with the first and the end of every thread's share of so many scenes."""
    shares = min(torch.get_num_threads(), max(1, count // SHARE))
    if shares == 1:
        work(0, count)
        return
    bounds = [count * k // shares for k in range(shares + 1)]
    with ThreadPoolExecutor(shares) as threads:
        list(threads.map(work, bounds[:-1], bounds[1:]))
