"""Tracks at any rate, turned into frames of 0.05 s."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from pushgraph.pose import wrap_angle
from pushgraph.track_frames import FRAME, LIFTED, ON_TIME, Frames
from pushgraph.wrench import mean_since

LONGEST_BRIDGE = 1.0
"""Across more than this (s) no pose is interpolated, however low the rate."""
RESTED, RESTED_YAW = 3e-3, math.radians(1.0)
"""A body that moved less than this (m, rad) while the recorder paused has rested."""


def longest_bridge(times: Float[np.ndarray, " frames"]) -> float:
    """Seconds between two sightings across which poses are interpolated; a longer gap is a pause."""
    interval = float(np.median(np.diff(times))) if len(times) > 1 else FRAME
    return min(1.5 * max(interval, 2 * FRAME), LONGEST_BRIDGE)


def in_frames(samples: Frames) -> Frames:
    """The same every 0.05 s, see `Track.at_frames`; itself if it is so already."""
    down = samples.push != LIFTED
    joined = down[1:] & down[:-1] & (samples.push[1:] != samples.push[:-1])
    grid = samples.times[0] + np.arange(len(samples.times)) * FRAME
    if not joined.any() and np.abs(samples.times - grid).max() < ON_TIME:
        return samples
    bridge = longest_bridge(samples.times)
    begins = down[1:] & (samples.push[1:] != samples.push[:-1]) | (np.diff(samples.times) > bridge)
    bounds = [0, *(np.flatnonzero(begins) + 1).tolist(), len(samples.times)]
    stretches = [_stretch_in_frames(_part(samples, slice(*ends)), bridge) for ends in pairwise(bounds)]
    parts = stretches[:1]
    for before, after in pairwise(stretches):
        lifts = before.push[-1] != LIFTED and after.push[0] != LIFTED
        parts += [_lift_between(before, after), after] if lifts else [after]
    columns: list[Any] = [None if some[0] is None else np.concatenate(some) for some in zip(*parts, strict=True)]
    return Frames(*columns)


def _part(samples: Frames, part: slice) -> Frames:
    columns: list[Any] = [None if column is None else column[part] for column in samples]
    return Frames(*columns)


def _stretch_in_frames(samples: Frames, bridge: float) -> Frames:
    """One push, or one lift. bridge: the longest between two sightings (s)."""
    at_samples = samples.times - samples.times[0]
    times = np.arange(int((at_samples[-1] + ON_TIME) / FRAME) + 1) * FRAME
    if samples.push[-1] == LIFTED and at_samples[-1] - times[-1] > ON_TIME:  # keep the lift, and where the push ended
        times = np.append(times, at_samples[-1])
    poses = np.full((len(times), *samples.poses.shape[1:]), np.nan)
    seen = np.zeros(poses.shape[:2], dtype=bool)
    for node in range(poses.shape[1]):
        sighted = samples.seen[:, node]
        if not sighted.any():
            continue
        at, values = at_samples[sighted], samples.poses[:, node][sighted]
        after = np.searchsorted(at, times - ON_TIME).clip(max=len(at) - 1)
        before = (np.searchsorted(at, times + ON_TIME) - 1).clip(min=0)
        seen[:, node] = (
            (at[before] <= times + ON_TIME) & (at[after] >= times - ON_TIME) & (at[after] - at[before] <= bridge)
        )
        values[:, 2] = np.unwrap(values[:, 2])
        poses[:, node] = np.stack([np.interp(times, at, column) for column in values.T], -1)
        if node > 0 and len(at) > 1 and np.isfinite(values).all():  # the tool goes straight, bodies turn about centres
            poses[:, node, :2] = _along_arcs(times, at, values)
    poses[~seen] = np.nan
    last = (np.searchsorted(at_samples, times + ON_TIME) - 1).clip(min=0)
    wrench = None if samples.wrench is None else mean_since(times, at_samples, samples.wrench, FRAME, ON_TIME)
    return Frames(samples.times[0] + times, poses, samples.push[last], seen, wrench)


def _along_arcs(
    times: Float[np.ndarray, " times"], at: Float[np.ndarray, " sightings"], values: Float[np.ndarray, "sightings 3"]
) -> Float[np.ndarray, "times 2"]:
    """Positions of a body between its sightings, moving on with one twist: what is glued stays glued, where straight
    lines from one sighting to the next would part it."""
    first = (np.searchsorted(at, times, side="right") - 1).clip(0, len(at) - 2)
    share = ((times - at[first]) / (at[first + 1] - at[first])).clip(0.0, 1.0)
    place, turn = values[:, 0] + 1j * values[:, 1], np.diff(values[:, 2])[first]
    straight = np.abs(turn) < 1e-9
    whole = np.where(straight, 1.0, np.exp(1j * turn) - 1)
    moved = np.where(straight, share, (np.exp(1j * share * turn) - 1) / whole) * np.diff(place)[first]
    found = place[first] + moved
    return np.stack((found.real, found.imag), -1)


def _lift_between(before: Frames, after: Frames) -> Frames:
    """One lifted frame after the first of two stretches, and before the second.

    A body that moved from one to the other is not seen in it, so that its motion is not taken for one without cause.
    """
    poses = after.poses[:1].copy()
    change = np.abs(poses[0] - before.poses[-1])
    change[:, 2] = np.abs(wrap_angle(change[:, 2]))
    change[np.isnan(poses[0])] = 0.0  # a yaw that cannot be known
    rested = (np.hypot(change[:, 0], change[:, 1]) < RESTED) & (change[:, 2] < RESTED_YAW)
    rested[0] = True
    seen = after.seen[:1] & before.seen[-1:] & rested
    poses[~seen] = np.nan
    time = np.minimum((before.times[-1:] + after.times[:1]) / 2, before.times[-1:] + FRAME)
    wrench = None if after.wrench is None else np.full((1, 3), np.nan)
    return Frames(time, poses, np.full(1, LIFTED, dtype=after.push.dtype), seen, wrench)
