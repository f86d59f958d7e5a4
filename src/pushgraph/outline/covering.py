"""Which parts cover which of an outline, and few that cover all of it."""

import math

import numpy as np
from jaxtyping import Bool, Float

from pushgraph.outline.parts import Parts
from pushgraph.outline.ring import Samples
from pushgraph.outline.tolerances import FLAT, PROTRUSION, ROUND, TURN


def covered_by_rectangles(parts: Parts, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Which rectangle runs along the outline at which sample, and how deep (m) it is there."""
    covers, depths = zip(*(_covered_by_some(parts.take(index), samples) for index in parts.slices()), strict=True)
    return np.concatenate(covers), np.concatenate(depths)


def _covered_by_some(parts: Parts, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    local = parts.local(samples.point)
    beyond = np.abs(local) - parts.half[:, None]
    tolerance = np.where(samples.curved, 1.5 * FLAT, 2 * PROTRUSION)
    covers = np.zeros(beyond.shape[:2], bool)
    depth = np.zeros(beyond.shape[:2])
    cos, sin = np.cos(parts.yaw), np.sin(parts.yaw)
    for axis, face in enumerate((np.stack((cos, sin), -1), np.stack((-sin, cos), -1))):
        on_face = (np.abs(beyond[..., axis]) < tolerance) & (beyond[..., 1 - axis] < PROTRUSION)
        part, sample = on_face.nonzero()
        inwards = face[part] * -np.sign(local[part, sample, axis])[:, None]
        alike = np.maximum((inwards * samples.edge_normal[sample]).sum(-1), (inwards * samples.normal[sample]).sum(-1))
        part, sample = part[alike > math.cos(1.02 * TURN)], sample[alike > math.cos(1.02 * TURN)]
        covers[part, sample] = True
        depth[part, sample] = np.maximum(depth[part, sample], 2 * parts.half[part, axis])
    return covers, depth


def covered_by_discs(parts: Parts, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Which disc runs along the outline at which sample, and how deep (m) it is there."""
    from_sample = parts.centre[:, None] - samples.point
    distance = np.hypot(*np.moveaxis(from_sample, -1, 0))
    turned = np.maximum(TURN, FLAT / parts.radius)[:, None]
    alike = (from_sample * samples.normal).sum(-1) > np.cos(turned) * distance
    near = np.abs(distance - parts.radius[:, None]) < np.where(samples.curved, ROUND, PROTRUSION)
    return near & alike, np.broadcast_to(2 * parts.radius[:, None], distance.shape)


def fill(inside: Bool[np.ndarray, "parts points"], least: float = 0.06) -> list[int]:
    """The largest parts: each adds this share of the points inside, at least."""
    missing = np.ones(inside.shape[1], bool)
    chosen: list[int] = []
    while len(inside):
        gain = inside[:, missing].sum(1)
        if gain.max() <= least * len(missing):
            break
        chosen.append(int(gain.argmax()))
        missing &= ~inside[chosen[-1]]
    return chosen


def choose(
    goals: Bool[np.ndarray, "parts goals"],
    weights: Float[np.ndarray, " goals"],
    preference: Float[np.ndarray, " parts"],
    chosen: list[int],
) -> list[int]:
    """Few parts, the chosen ones first, that together cover every goal that any covers; the preferred one of equals."""
    chosen = list(chosen)
    missing = goals.any(0) & ~goals[chosen].any(0)
    value = np.where(goals, weights, 0)
    while missing.any():
        gain = (value @ missing) * (1 + 0.1 * preference)
        chosen.append(int(gain.argmax()))
        missing &= ~goals[chosen[-1]]
    count = goals[chosen].sum(0)
    for part in sorted(chosen, key=lambda part: value[part].sum()):
        if (count - goals[part] >= (count > 0)).all():
            count = count - goals[part]
            chosen.remove(part)
    return chosen
