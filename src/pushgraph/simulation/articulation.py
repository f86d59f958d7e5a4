"""Draw the joints of a scene between neighbours that stand close enough to be joined."""

import math

import numpy as np
from jaxtyping import Int

from pushgraph import pose
from pushgraph.body import Joint
from pushgraph.scene import Scene
from pushgraph.simulation.placement import NEIGHBOUR_GAP

DYNAMICS = ("fixed", "revolute", "prismatic")
JOINTS = (2, 6)
"""Fewest and most joints of a scene, as far as its neighbours allow."""


def draw_joints(rng: np.random.Generator, scene: Scene) -> tuple[Joint, ...]:
    """Joints of equally likely kinds between random neighbours, so that joints and rigid groups form trees.

    Which neighbours are joined does not depend on their gap: geometry tells nothing about joints.
    """
    pairs = _neighbours(scene)
    tree = list(range(len(scene.bodies)))
    for group in scene.rigid_groups:
        members = [scene.names.index(name) for name in group]
        tree = [members[0] if k in members else root for k, root in enumerate(tree)]
    forest: list[tuple[int, int]] = []
    for first, second in rng.permutation(pairs).tolist():
        old, new = tree[first], tree[second]
        if old != new:
            tree = [new if root == old else root for root in tree]
            forest.append((first, second))
    fewest, most = (min(bound, len(forest)) for bound in JOINTS)
    count = int(rng.integers(fewest, most + 1))
    return tuple(
        Joint(kind=DYNAMICS[rng.integers(len(DYNAMICS))], parent=scene.names[first], child=scene.names[second])
        for first, second in forest[:count]
    )


def vary_joint(rng: np.random.Generator, scene: Scene, joint: Joint) -> Joint:
    """The joint with its own anchor, axis and limits, near those its geometry would give it."""
    anchor, axis, (lower, _) = scene.joint_frame(joint)
    if joint.kind == "revolute":
        return joint.replace(
            anchor=tuple((anchor + rng.normal(0, 0.02, 2)).tolist()),
            limits=(-rng.uniform(0.1, math.pi), rng.uniform(0.1, math.pi)),
        )
    if joint.kind == "prismatic":
        # Turned by less than 30 degrees, the axis still parts the two, and they meet no sooner than their gap.
        turned = pose.rotate(axis, rng.uniform(-0.5, 0.5))
        return joint.replace(axis=tuple(turned.tolist()), limits=(lower * rng.uniform(), rng.uniform(0.02, 0.15)))
    return joint


def _neighbours(scene: Scene) -> Int[np.ndarray, "pairs 2"]:
    pairs = scene.pairs_apart
    if not pairs:
        return np.empty((0, 2), dtype=np.int64)
    near = scene.contacts(pairs).gap.numpy() <= NEIGHBOUR_GAP[1]
    return np.array(pairs)[near]
