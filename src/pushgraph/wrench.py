"""Readings of a force sensor on the tool: what the bodies exert on it, force (N, world frame) and moment (N m).

The moment is about the end-effector, counter-clockwise. A reading that is missing is NaN in all three.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from pushgraph.errors import TrackError
from pushgraph.written_number import number

COMPONENTS = ("force_x", "force_y", "moment")
UNITS = {"force_x": "N", "force_y": "N", "moment": "N m"}
MOST_MEASURED = 1000.0
"""A measured force (N) or moment (N m) beyond this has another unit: no such sensor, and no such arm, is in use."""
NO_READING = (np.nan, np.nan, np.nan)

_ADVICE = "forces must be in N, moments in N m, and all three NaN where there is no reading"


def present(wrench: Float[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
    """Whether there is a reading."""
    return ~np.isnan(wrench).all(-1)


def check_whole(wrench: Float[np.ndarray, "frames 3"], times: Float[np.ndarray, " frames"]) -> None:
    """Raise TrackError, which names the frame, where a reading is neither finite nor missing as a whole."""
    if wrench.shape != (len(times), 3):
        raise TrackError(f"wrench: shape must be {(len(times), 3)}, got {wrench.shape}")
    _refuse(wrench, times, present(wrench) & ~np.isfinite(wrench).all(-1), "must be finite")


def check_measured(wrench: Float[np.ndarray, "frames 3"], times: Float[np.ndarray, " frames"]) -> None:
    """The same, and where it is more than any sensor reads: it has another unit."""
    check_whole(wrench, times)
    too_large = (np.abs(wrench) > MOST_MEASURED).any(-1)
    _refuse(wrench, times, too_large, f"must be at most {MOST_MEASURED:g} N and N m")


def _refuse(
    wrench: Float[np.ndarray, "frames 3"],
    times: Float[np.ndarray, " frames"],
    bad: Bool[np.ndarray, " frames"],
    valid: str,
) -> None:
    if bad.any():
        frame = int(bad.argmax())
        values = ", ".join(f"{name} {value:g}" for name, value in zip(COMPONENTS, wrench[frame].tolist(), strict=True))
        raise TrackError(f"wrench at frame {frame} ({times[frame]:g} s) is {values}: it {valid}; {_ADVICE}")


def mean_since(
    frames: Float[np.ndarray, " frames"],
    times: Float[np.ndarray, " readings"],
    wrench: Float[np.ndarray, "readings 3"],
    longest: float,
    on_time: float,
) -> Float[np.ndarray, "frames 3"]:
    """Mean of the readings since the frame before, and no longer ago than `longest` (s); NaN where there are none.

    frames, times: of frames and readings (s), rising. Readings `on_time` (s) after a frame still belong to it.
    """
    frame = np.searchsorted(frames, times - on_time)
    inside = frame < len(frames)
    frame, at, values = frame[inside], times[inside], wrench[inside]
    kept = present(values) & (frames[frame] - at < longest - on_time)
    count = np.bincount(frame[kept], minlength=len(frames))[:, None]
    total = np.stack([np.bincount(frame[kept], column, len(frames)) for column in values[kept].T], -1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def reading_from_text(cells: Sequence[str], where: str) -> tuple[float, ...]:
    """A reading from the three cells of a table's line, empty if there is none; raises TrackError that says where."""
    texts = [cell.strip() for cell in cells]
    if not any(texts):
        return NO_READING
    values = []
    for name, text in zip(COMPONENTS, texts, strict=True):
        try:
            value = number(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise TrackError(
                f"{where}: {name}: must be a finite number ({UNITS[name]}), got {text!r}; leave all three "
                "empty where there is no reading"
            )
        values.append(value)
    return tuple(values)
