"""Poses in space, SE(3): arrays `[..., 7]` of x, y, z (m) and a unit quaternion w, x, y, z, NumPy or torch.

As in `pushgraph.pose`, `pose_a_from_b` maps coordinates in frame b to coordinates in frame a, so frames cancel like
fractions: `compose(pose_a_from_b, pose_b_from_c)` is `pose_a_from_c`. A quaternion and its negative are one rotation:
whatever these functions say about rotations is the same for both.
"""

from types import ModuleType
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

Array = TypeVar("Array", np.ndarray, Tensor)

SMALL_ANGLE = 1e-2
"""Below this angle (rad) differences that cancel are taken from their series."""


def _namespace(array: Array) -> ModuleType:
    return torch if isinstance(array, Tensor) else np


def _norm(vector: Float[Array, "*batch n"]) -> Float[Array, "*batch 1"]:
    return _namespace(vector).linalg.norm(vector, axis=-1, keepdims=True)


def cross(a: Float[Array, "*#batch 3"], b: Float[Array, "*#batch 3"]) -> Float[Array, "... 3"]:
    """Vector product."""
    a_x, a_y, a_z = a[..., 0], a[..., 1], a[..., 2]
    b_x, b_y, b_z = b[..., 0], b[..., 1], b[..., 2]
    products = (a_y * b_z - a_z * b_y, a_z * b_x - a_x * b_z, a_x * b_y - a_y * b_x)
    return _namespace(a).stack(products, axis=-1)


def multiply(a: Float[Array, "*#batch 4"], b: Float[Array, "*#batch 4"]) -> Float[Array, "... 4"]:
    """Product of two quaternions: the rotation b, then a."""
    a_real, a_vector, b_real, b_vector = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    real = a_real * b_real - (a_vector * b_vector).sum(-1)[..., None]
    vector = a_real * b_vector + b_real * a_vector + cross(a_vector, b_vector)
    return _namespace(real).concatenate((real, vector), axis=-1)


def conjugate(quaternion: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """The inverse rotation."""
    return _namespace(quaternion).concatenate((quaternion[..., :1], -quaternion[..., 1:]), axis=-1)


def rotate(vector: Float[Array, "*#batch 3"], quaternion: Float[Array, "*#batch 4"]) -> Float[Array, "... 3"]:
    """Rotate vectors by unit quaternions."""
    axis = quaternion[..., 1:]
    twice = 2 * cross(axis, vector)
    return vector + quaternion[..., :1] * twice + cross(axis, twice)


def rotation_matrix(quaternion: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3 3"]:
    """Matrices whose columns are the turned axes."""
    xp = _namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def compose(
    pose_a_from_b: Float[Array, "*#batch 7"], pose_b_from_c: Float[Array, "*#batch 7"]
) -> Float[Array, "... 7"]:
    """Return pose_a_from_c."""
    position = transform(pose_a_from_b, pose_b_from_c[..., :3])
    quaternion = multiply(pose_a_from_b[..., 3:], pose_b_from_c[..., 3:])
    return _namespace(position).concatenate((position, quaternion), axis=-1)


def inverse(pose_a_from_b: Float[Array, "*batch 7"]) -> Float[Array, "*batch 7"]:
    """Return pose_b_from_a."""
    back = conjugate(pose_a_from_b[..., 3:])
    return _namespace(back).concatenate((-rotate(pose_a_from_b[..., :3], back), back), axis=-1)


def relative(
    pose_world_from_a: Float[Array, "*#batch 7"], pose_world_from_b: Float[Array, "*#batch 7"]
) -> Float[Array, "... 7"]:
    """Return pose_a_from_b; positions are subtracted first, so nothing is lost far from the origin."""
    back = conjugate(pose_world_from_a[..., 3:])
    position = rotate(pose_world_from_b[..., :3] - pose_world_from_a[..., :3], back)
    return _namespace(back).concatenate((position, multiply(back, pose_world_from_b[..., 3:])), axis=-1)


def transform(pose_a_from_b: Float[Array, "*#batch 7"], points_b: Float[Array, "*#batch 3"]) -> Float[Array, "... 3"]:
    """Map points given in frame b to frame a."""
    return pose_a_from_b[..., :3] + rotate(points_b, pose_a_from_b[..., 3:])


def normalized(pose: Float[Array, "*batch 7"]) -> Float[Array, "*batch 7"]:
    """The same pose with a quaternion of length 1; its sign stays."""
    return _namespace(pose).concatenate((pose[..., :3], pose[..., 3:] / _norm(pose[..., 3:])), axis=-1)


def from_rotation_vector(vector: Float[Array, "*batch 3"]) -> Float[Array, "*batch 4"]:
    """Unit quaternions of turns about the vectors by their lengths (rad); differentiable at zero, too."""
    xp = _namespace(vector)
    half = _norm(vector) / 2
    return xp.concatenate((xp.cos(half), xp.sinc(half / np.pi) * vector / 2), axis=-1)


def rotation_vector(quaternion: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3"]:
    """Axis times angle (rad, at most pi) of unit quaternions."""
    xp = _namespace(quaternion)
    upper = xp.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    sine = _norm(upper[..., 1:])
    is_small = sine < SMALL_ANGLE / 2
    safe = xp.where(is_small, xp.ones_like(sine), sine)
    factor = xp.where(is_small, 2 + sine * sine / 3, 2 * xp.arctan2(sine, upper[..., :1]) / safe)
    return factor * upper[..., 1:]


def exponential(twist: Float[Array, "*batch 6"]) -> Float[Array, "*batch 7"]:
    """The pose that a frame has, seen from where it was, after it moved along a screw.

    twist: displacement of its origin at first (m), rotation vector (rad), both in the frame's axes.
    """
    xp = _namespace(twist)
    shift, turn = twist[..., :3], twist[..., 3:]
    angle = _norm(turn)
    is_small = angle < SMALL_ANGLE
    safe = xp.where(is_small, xp.ones_like(angle), angle)
    once = 0.5 * xp.sinc(angle / (2 * np.pi)) ** 2
    twice = xp.where(is_small, 1 / 6 - angle * angle / 120, (1 - xp.sinc(safe / np.pi)) / (safe * safe))
    across = cross(turn, shift)
    position = shift + once * across + twice * cross(turn, across)
    return xp.concatenate((position, from_rotation_vector(turn)), axis=-1)


def rotation_error(a: Float[Array, "*#batch 7"], b: Float[Array, "*#batch 7"]) -> Float[Array, "..."]:
    """Angle (rad, 0 to pi) between the orientations of two poses."""
    xp = _namespace(a)
    between = multiply(conjugate(a[..., 3:]), b[..., 3:])
    return xp.asarray(2 * xp.arctan2(_norm(between[..., 1:])[..., 0], abs(between[..., 0])))
