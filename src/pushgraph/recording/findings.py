"""Findings: what in a recording is doubtful, where, why, and what can be done."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class Finding(NamedTuple):
    """One doubt.

    what: what was seen. node: of whom; empty: of all or none. first, last: when (s), NaN: throughout. cause: the
    likely one. remedy: what to do. grave: the recording cannot be believed as it is.
    """

    what: str
    node: str = ""
    first: float = np.nan
    last: float = np.nan
    cause: str = ""
    remedy: str = ""
    grave: bool = False

    def __str__(self) -> str:
        who = f"{self.node}: " if self.node else ""
        when = ""
        if np.isfinite(self.first):
            ends = f"at {self.first:.2f}" if self.last == self.first else f"from {self.first:.2f} to {self.last:.2f}"
            when = f" {ends} s"
        cause = f"; likely cause: {self.cause}" if self.cause else ""
        return f"{who}{self.what}{when}{cause}" + (f"; {self.remedy}" if self.remedy else "")


def spans(times: Float[np.ndarray, " frames"], where: Bool[np.ndarray, " frames"]) -> tuple[float, float]:
    """First and last time at which something holds."""
    at = np.flatnonzero(where)
    return float(times[at[0]]), float(times[at[-1]])


def plural(count: int, noun: str) -> str:
    """`1 frame`, `2 frames`."""
    return f"{count} {noun}" + "s" * (count != 1)


def listed(names: Sequence[str], most: int = 8) -> str:
    """Names in a row, the first few of many."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
