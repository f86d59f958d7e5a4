"""Place blocks on the table: clusters whose neighbours stand a drawn gap apart."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.contact import contact_between, signed_gap
from pushgraph.shape import rounded_boxes, take
from pushgraph.simulation.block import Block

NEIGHBOUR_GAP = (0.001, 0.020)
"""Neighbours in a cluster stand this far apart (m), joined or not."""
CLUSTER_CLEARANCE = 0.05
CANDIDATES = 24
COMPACT_CHOICE = 6
"""A dense cluster takes the innermost of this many free places."""

Gap = tuple[float, float]


class NoRoom(Exception):
    """No free place was found; draw again."""


def place_cluster(
    rng: np.random.Generator, blocks: Sequence[Block], gap: Gap = NEIGHBOUR_GAP
) -> Float[np.ndarray, "blocks 3"]:
    """Poses of one cluster, each block beside an earlier one, their gap between the two given (m)."""
    poses = np.array([[0.0, 0.0, rng.uniform(-math.pi, math.pi)]])
    for index in range(1, len(blocks)):
        neighbours = rng.choice(np.arange(index), CANDIDATES)
        candidates = _beside(rng, blocks, index, poses, neighbours, rng.uniform(*gap, CANDIDATES))
        gaps = _gaps(blocks, index, candidates, poses)
        free = np.flatnonzero(gaps >= gap[0])
        if not len(free):
            raise NoRoom
        inward = np.hypot(*(candidates[free[:COMPACT_CHOICE], :2] - poses[:, :2].mean(0)).T)
        poses = np.vstack((poses, candidates[free[inward.argmin()]]))
    poses[:, :2] -= poses[:, :2].mean(0)
    return poses


def place_clusters(
    rng: np.random.Generator, blocks: Sequence[Block], half_width: float, gap: Gap = NEIGHBOUR_GAP
) -> Float[np.ndarray, "blocks 3"]:
    """Poses of clusters of one to four blocks, scattered over a square around the origin."""
    clusters, first = [], 0
    while first < len(blocks):
        last = min(first + int(rng.integers(1, 5)), len(blocks))
        clusters.append((blocks[first:last], place_cluster(rng, blocks[first:last], gap)))
        first = last
    return scatter_clusters(rng, clusters, half_width)


def scatter_clusters(
    rng: np.random.Generator, clusters: Sequence[tuple[Sequence[Block], np.ndarray]], half_width: float
) -> Float[np.ndarray, "blocks 3"]:
    """Move clusters, each with its poses, to random places in a square around the origin, clear of each other."""
    radii = [max(np.hypot(*p[:2]) + b.reach for b, p in zip(*cluster, strict=True)) for cluster in clusters]
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
    blocks: Sequence[Block],
    index: int,
    poses: Float[np.ndarray, "placed 3"],
    neighbour: np.ndarray,
    gap: np.ndarray,
) -> Float[np.ndarray, "candidates 3"]:
    """Poses of block `index` at the given gap from a neighbour, in random directions.

    Along a ray from the neighbour the gap of two parts is convex, so Newton's method from far outside never passes
    where it is the wanted one; nor do blocks, if of all pairs of parts the one that holds them farthest apart does.
    """
    count = len(neighbour)
    direction, yaw = rng.uniform(-math.pi, math.pi, (2, count))
    own = len(blocks[index].parts)
    pairs = [(c, i, j) for c, k in enumerate(neighbour) for i in range(len(blocks[k].parts)) for j in range(own)]
    candidate, first, second = np.array(pairs).T
    begins = np.flatnonzero(np.diff(candidate, prepend=-1))
    a = rounded_boxes([blocks[neighbour[c]].parts[i].shape for c, i, _ in pairs])
    b = take(rounded_boxes([part.shape for part in blocks[index].parts]), second)
    poses_a = np.concatenate([pose.compose(poses[k], blocks[k].poses_block_from_part) for k in neighbour])
    at_a = np.concatenate(([0], np.cumsum([len(blocks[k].parts) for k in neighbour])[:-1]))[candidate] + first
    poses_a, poses_own = poses_a[at_a], blocks[index].poses_block_from_part[second]
    ray = pose.rotate(np.array([1.0, 0.0]), direction)
    ray_in_a = pose.rotate(ray[candidate], -poses_a[:, 2])
    distance = np.array([blocks[k].reach for k in neighbour]) + blocks[index].reach + NEIGHBOUR_GAP[1]
    for _ in range(5 if len(pairs) == count else 12):
        candidates = np.column_stack((poses[neighbour, :2] + distance[:, None] * ray, yaw))
        pose_a_from_b = pose.relative(poses_a, pose.compose(candidates[candidate], poses_own))
        touch = contact_between(a, b, pose_a_from_b)
        slope = (touch.normal * ray_in_a).sum(-1)
        nearer = distance[candidate] - (touch.gap - gap[candidate]) / np.maximum(slope, 0.2)
        distance = np.maximum.reduceat(nearer, begins)
    return candidates


def _gaps(
    blocks: Sequence[Block],
    index: int,
    candidates: Float[np.ndarray, "candidates 3"],
    poses: Float[np.ndarray, "placed 3"],
) -> Float[np.ndarray, " candidates"]:
    """Least gap of block `index`, at each of its candidate poses, to the blocks that are placed (m)."""
    parts = [part.shape for block in blocks[: len(poses)] for part in block.parts]
    poses_placed = np.concatenate(
        [pose.compose(place, block.poses_block_from_part) for place, block in zip(poses, blocks, strict=False)]
    )
    own = blocks[index]
    poses_own = pose.compose(candidates[:, None], own.poses_block_from_part)
    candidate, part, placed = (k.ravel() for k in np.indices((len(candidates), len(own.parts), len(parts))))
    pose_a_from_b = pose.relative(poses_placed[placed], poses_own[candidate, part])
    gaps = signed_gap(
        take(rounded_boxes(parts), placed), take(rounded_boxes([part.shape for part in own.parts]), part), pose_a_from_b
    )
    return gaps.reshape(len(candidates), -1).min(-1)
