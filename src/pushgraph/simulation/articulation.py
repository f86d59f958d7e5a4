"""Draw the joints of a scene between neighbours that stand close enough to be joined."""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from jaxtyping import Int

from pushgraph import pose
from pushgraph.body import Joint, JointKind
from pushgraph.scene import Scene
from pushgraph.shape import simple
from pushgraph.simulation.placement import NEIGHBOUR_GAP

DYNAMICS: tuple[JointKind, ...] = ("fixed", "revolute", "prismatic")
JOINTS = (2, 6)
"""Fewest and most joints of a scene, as far as its neighbours allow."""
MOVES = {"revolute": 0.05, "prismatic": 0.05}
"""A joint that can move does so by this angle (rad), or this share of the smaller body's reach."""
TRIES = 12
STEPS = 24
"""Places in which a joint's free range is looked for, to either side."""


def draw_joints(
    rng: np.random.Generator,
    scene: Scene,
    farthest: float = NEIGHBOUR_GAP[1],
    kinds: Sequence[JointKind] = DYNAMICS,
    bounds: tuple[int, int] = JOINTS,
) -> tuple[Joint, ...]:
    """Joints of equally likely kinds between random neighbours, so that they close no loop with those of the scene.

    Neighbours stand `farthest` (m) apart at most. Which of them are joined does not depend on their gap: geometry
    tells nothing about joints. bounds: fewest and most, as far as the neighbours allow.
    """
    pairs = _neighbours(scene, farthest)
    tree = list(range(len(scene.bodies)))
    fixed = [body.name for body in scene.bodies if body.fixed]
    for group in [*scene.rigid_groups, fixed, *((joint.parent, joint.child) for joint in scene.joints)]:
        members = [scene.names.index(name) for name in group]
        joined = {tree[k] for k in members}
        tree = [min(joined) if root in joined else root for root in tree]
    forest: list[tuple[int, int]] = []
    for first, second in rng.permutation(pairs).tolist():
        old, new = tree[first], tree[second]
        if old != new:
            tree = [new if root == old else root for root in tree]
            forest.append((first, second))
    fewest, most = (min(bound, len(forest)) for bound in bounds)
    count = int(rng.integers(fewest, most + 1))
    return tuple(
        Joint(kind=kinds[int(rng.integers(len(kinds)))], parent=scene.names[first], child=scene.names[second])
        for first, second in forest[:count]
    )


def place_anywhere(rng: np.random.Generator, scene: Scene, joint: Joint) -> Joint:
    """The joint with an anchor anywhere on or between its bodies, any axis, and limits, small ones too.

    It can move: by MOVES at least before its bodies overlap, or the joint is as its geometry would have it.
    """
    if joint.kind == "fixed":
        return joint
    pieces = [_piece(scene, name) for name in (joint.parent, joint.child)]
    small = rng.random() < 0.5
    for _ in range(TRIES):
        if joint.kind == "revolute":
            placed = joint.replace(anchor=_point_on(rng, scene, joint))
            reach = (rng.uniform(0.05, 0.3, 2) if small else rng.uniform(0.3, math.pi, 2)).tolist()
        else:
            angle = rng.uniform(-math.pi, math.pi)
            size = min(scene.bodies[scene.names.index(name)].shape.reach for name in (joint.parent, joint.child))
            placed = joint.replace(axis=(math.cos(angle), math.sin(angle)))
            reach = (size * (rng.uniform(0.03, 0.3, 2) if small else rng.uniform(0.3, 1.5, 2))).tolist()
        lower, upper = _free_range(scene, placed, pieces, reach)
        if upper - lower >= MOVES[joint.kind] * (1.0 if joint.kind == "revolute" else size):
            return placed.replace(limits=(lower, upper))
    return joint


def _point_on(rng: np.random.Generator, scene: Scene, joint: Joint) -> tuple[float, float]:
    """On one of the two bodies, or on the line between such points of both."""
    points = []
    for name in (joint.parent, joint.child):
        body = scene.bodies[scene.names.index(name)]
        half_x, half_y, radius = simple(body.shape).core
        own = np.array([half_x + radius, half_y + radius]) * rng.uniform(-1, 1, 2)
        points.append(pose.transform(np.array(body.pose_world_from_body), own))
    share = rng.choice([0.0, 1.0, rng.uniform()])
    return tuple(((1 - share) * points[0] + share * points[1]).tolist())


def _piece(scene: Scene, name: str) -> list[int]:
    group = next((group for group in scene.rigid_groups if name in group), (name,))
    return [scene.names.index(member) for member in group]


def _free_range(scene: Scene, joint: Joint, pieces: list[list[int]], reach: list[float]) -> tuple[float, float]:
    """How far, of `reach` to either side, the child's piece moves before it overlaps the parent's."""
    anchor, axis, _ = scene.joint_frame(joint)
    share = np.linspace(0, 1, STEPS)
    poses = scene.poses_world_from_body
    free = []
    for sign, far in zip((-1.0, 1.0), reach, strict=True):
        moved = sign * far * share
        if joint.kind == "revolute":
            offset = anchor - pose.rotate(np.broadcast_to(anchor, (STEPS, 2)), moved)
            motion = np.column_stack((offset, moved))
        else:
            motion = np.column_stack((moved[:, None] * axis, np.zeros(STEPS)))
        frames = np.repeat(poses[None], STEPS, 0)
        frames[:, pieces[1]] = pose.compose(motion[:, None], frames[:, pieces[1]])
        gaps = scene.pair_gaps(list(product(pieces[0], pieces[1])), frames).min(1)
        within = np.flatnonzero(gaps < min(0.0, gaps[0]))
        free.append(sign * far * share[within[0] - 1 if len(within) else -1])
    return float(free[0]), float(free[1])


def _neighbours(scene: Scene, farthest: float) -> Int[np.ndarray, "pairs 2"]:
    still = scene.immovable
    pairs = [(i, j) for i, j in scene.pairs_apart if not (still[i] and still[j])]
    if not pairs:
        return np.empty((0, 2), dtype=np.int64)
    near = scene.contacts(pairs).gap <= farthest
    return np.array(pairs)[near]
