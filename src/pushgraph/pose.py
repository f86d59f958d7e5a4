"""Planar poses, SE(2): arrays `[..., 3]` of x (m), y (m), yaw (rad), NumPy or torch, broadcast as usual.

`pose_a_from_b` maps coordinates in frame b to coordinates in frame a, so frames cancel like fractions:
`compose(pose_a_from_b, pose_b_from_c)` is `pose_a_from_c`.
"""

from types import ModuleType
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

Array = TypeVar("Array", np.ndarray, Tensor)


def _namespace(array: Array) -> ModuleType:
    return torch if isinstance(array, Tensor) else np


def rotate(vector: Float[Array, "*#batch 2"], yaw: Float[Array, "*#batch"] | float) -> Float[Array, "... 2"]:
    """Rotate vectors counter-clockwise by yaw (rad)."""
    xp = _namespace(vector)
    cos, sin = xp.cos(yaw), xp.sin(yaw)
    x, y = vector[..., 0], vector[..., 1]
    return xp.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)


def as_complex(vectors: Float[Tensor, "*batch 2"]) -> Complex[Tensor, "*batch"]:
    """Vectors as complex numbers x + iy: one product turns them; `torch.view_as_real` leads back."""
    return torch.complex(*vectors.unbind(-1))


def turning(angle: Float[Tensor, "*batch"]) -> Complex[Tensor, "*batch"]:
    """The complex numbers that turn vectors by an angle (rad); see `as_complex`."""
    return torch.polar(torch.ones_like(angle), angle)


def compose(
    pose_a_from_b: Float[Array, "*#batch 3"], pose_b_from_c: Float[Array, "*#batch 3"]
) -> Float[Array, "... 3"]:
    """Return pose_a_from_c; yaws add without wrapping."""
    position = transform(pose_a_from_b, pose_b_from_c[..., :2])
    yaw = pose_a_from_b[..., 2:] + pose_b_from_c[..., 2:]
    return _namespace(yaw).concatenate((position, yaw), axis=-1)


def inverse(pose_a_from_b: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """Return pose_b_from_a."""
    position, yaw = pose_a_from_b[..., :2], pose_a_from_b[..., 2]
    return _namespace(yaw).concatenate((-rotate(position, -yaw), -yaw[..., None]), axis=-1)


def relative(
    pose_world_from_a: Float[Array, "*#batch 3"], pose_world_from_b: Float[Array, "*#batch 3"]
) -> Float[Array, "... 3"]:
    """Return pose_a_from_b; positions are subtracted first, so nothing is lost far from the origin."""
    difference = pose_world_from_b - pose_world_from_a
    position = rotate(difference[..., :2], -pose_world_from_a[..., 2])
    return _namespace(position).concatenate((position, difference[..., 2:]), axis=-1)


def transform(pose_a_from_b: Float[Array, "*#batch 3"], points_b: Float[Array, "*#batch 2"]) -> Float[Array, "... 2"]:
    """Map points given in frame b to frame a."""
    return pose_a_from_b[..., :2] + rotate(points_b, pose_a_from_b[..., 2])


def wrap_angle(angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Return the same angle (rad) in [-pi, pi]."""
    xp = _namespace(angle)
    return xp.arctan2(xp.sin(angle), xp.cos(angle))
