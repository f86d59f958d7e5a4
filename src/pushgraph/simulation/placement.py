"""Place bodies on the table: clusters whose neighbours stand a drawn gap apart."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from pushgraph import pose
from pushgraph.contact import contact_between, signed_gap
from pushgraph.shape import Cuboid, Cylinder, rounded_boxes, take

NEIGHBOUR_GAP = (0.001, 0.020)
"""Neighbours in a cluster stand this far apart (m), joined or not."""
PIECE_OVERLAP = (-0.020, -0.002)
"""Gap between the parts of one piece (m)."""
CLUSTER_CLEARANCE = 0.05
CANDIDATES = 24
COMPACT_CHOICE = 6
"""A dense cluster takes the innermost of this many free places."""

Shapes = Sequence[Cylinder | Cuboid]


class NoRoom(Exception):
    """No free place was found; draw again."""


def reach(shape: Cylinder | Cuboid) -> float:
    """Radius of the smallest circle around the centre that holds the shape (m)."""
    return math.hypot(*shape.core[:2]) + shape.core[2]


def place_cluster(rng: np.random.Generator, shapes: Shapes, piece: Sequence[int]) -> Float[np.ndarray, "bodies 3"]:
    """Poses of one cluster, each body beside an earlier one; bodies with the same number in `piece` overlap."""
    poses = np.array([[0.0, 0.0, rng.uniform(-math.pi, math.pi)]])
    for index in range(1, len(shapes)):
        same_piece = np.array(piece[:index]) == piece[index]
        beside = np.flatnonzero(same_piece) if same_piece.any() else np.arange(index)
        low, high = PIECE_OVERLAP if same_piece.any() else NEIGHBOUR_GAP
        candidates = _beside(
            rng, shapes, index, poses, rng.choice(beside, CANDIDATES), rng.uniform(low, high, CANDIDATES)
        )
        gaps = _gaps(shapes, index, candidates, poses)
        free = np.flatnonzero((gaps[:, ~same_piece] >= NEIGHBOUR_GAP[0]).all(-1))
        if not len(free):
            raise NoRoom
        inward = np.hypot(*(candidates[free[:COMPACT_CHOICE], :2] - poses[:, :2].mean(0)).T)
        poses = np.vstack((poses, candidates[free[inward.argmin()]]))
    poses[:, :2] -= poses[:, :2].mean(0)
    return poses


def scatter_clusters(
    rng: np.random.Generator, clusters: Sequence[tuple[Shapes, np.ndarray]], half_width: float
) -> Float[np.ndarray, "bodies 3"]:
    """Move clusters, each with its poses, to random places in a square around the origin, clear of each other."""
    radii = [max(np.hypot(*p[:2]) + reach(s) for s, p in zip(*cluster, strict=True)) for cluster in clusters]
    centres: list[np.ndarray] = []
    for radius in radii:
        places = rng.uniform(-half_width, half_width, (200, 2))
        clear = np.ones(len(places), dtype=bool)
        for centre, other in zip(centres, radii, strict=False):
            clear &= np.hypot(*(places - centre).T) > radius + other + CLUSTER_CLEARANCE
        if not clear.any():
            raise NoRoom
        centres.append(places[clear.argmax()])
    return np.vstack([poses + [*centre, 0.0] for (_, poses), centre in zip(clusters, centres, strict=True)])


def _beside(
    rng: np.random.Generator,
    shapes: Shapes,
    index: int,
    poses: Float[np.ndarray, "placed 3"],
    neighbour: np.ndarray,
    gap: np.ndarray,
) -> Float[np.ndarray, "candidates 3"]:
    """Poses of body `index` at the given gap from a neighbour, in random directions.

    Along a ray from the neighbour's centre the gap is convex and rises, so Newton's method from far outside
    comes down to the wanted gap without passing it.
    """
    count = len(neighbour)
    direction, yaw = rng.uniform(-math.pi, math.pi, (2, count))
    boxes = rounded_boxes(shapes)
    a, b = take(boxes, torch.from_numpy(neighbour)), take(boxes, torch.full((count,), index))
    ray = pose.rotate(np.array([1.0, 0.0]), direction)
    distance = np.array([reach(shapes[k]) for k in neighbour]) + reach(shapes[index]) + NEIGHBOUR_GAP[1]
    for _ in range(5):
        candidates = np.column_stack((poses[neighbour, :2] + distance[:, None] * ray, yaw))
        pose_a_from_b = pose.relative(poses[neighbour], candidates)
        touch = contact_between(a, b, torch.from_numpy(pose_a_from_b))
        slope = (touch.normal.numpy() * pose.rotate(ray, -poses[neighbour, 2])).sum(-1)
        distance = distance - (touch.gap.numpy() - gap) / np.maximum(slope, 0.2)
    return candidates


def _gaps(
    shapes: Shapes, index: int, candidates: Float[np.ndarray, "candidates 3"], poses: Float[np.ndarray, "placed 3"]
) -> Float[np.ndarray, "candidates placed"]:
    candidate, placed = (torch.from_numpy(k.ravel()) for k in np.indices((len(candidates), len(poses))))
    boxes = rounded_boxes(shapes)
    pose_a_from_b = pose.relative(torch.from_numpy(poses)[placed], torch.from_numpy(candidates)[candidate])
    gaps = signed_gap(take(boxes, placed), take(boxes, torch.full_like(placed, index)), pose_a_from_b)
    return gaps.reshape(len(candidates), len(poses)).numpy()
