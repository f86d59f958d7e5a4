"""Bodies that noise has pressed into each other, moved apart."""

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.contact import contact_between
from pushgraph.scene import OVERLAP, Scene
from pushgraph.shape import rounded_boxes, simple, take

ROUNDS = 100


def parted(scene: Scene, poses: Float[np.ndarray, "bodies 3"]) -> Float[np.ndarray, "bodies 3"]:
    """Poses at which no two bodies overlap by more than a scene allows: each of such a pair gives way by half."""
    poses, apart = poses.copy(), scene.pairs_that_collide
    if not apart:
        return poses
    boxes = rounded_boxes([simple(body.shape) for body in scene.bodies])
    first, second = (np.array(column) for column in zip(*apart, strict=True))
    for _ in range(ROUNDS):
        between = pose.relative(poses[first], poses[second])
        touch = contact_between(take(boxes, first), take(boxes, second), between)
        deep = np.maximum(-touch.gap - 0.9 * OVERLAP, 0)
        if deep.max() == 0:
            break
        give = pose.rotate(touch.normal, poses[first, 2]) * (deep / 2)[:, None]
        np.add.at(poses[:, :2], first, -give)
        np.add.at(poses[:, :2], second, give)
    return poses
