"""What numbers networks compute in, and which are fastest here."""

import functools
import time

import torch

PRECISIONS = {"float32": torch.float32, "bfloat16": torch.bfloat16}
"""What the networks may compute in; geometry and poses keep their own precision."""


@functools.cache
def fastest_precision(device: str = "cpu") -> str:
    """The precision in which networks are fastest on this machine, timed once: without instructions for bfloat16 it is
    several times slower than float32."""
    seconds = {}
    for name, precision in PRECISIONS.items():
        weight, rows = torch.ones(256, 256, dtype=precision, device=device), torch.ones(4096, 256, device=device)
        rows = rows.to(precision)
        for _ in range(2):  # the first warms up
            begun = time.perf_counter()
            for _ in range(4):
                rows = (rows @ weight).relu() / 256
            rows.sum().item()
            seconds[name] = time.perf_counter() - begun
    return min(seconds, key=seconds.__getitem__)
