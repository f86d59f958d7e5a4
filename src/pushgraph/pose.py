"""Planar poses, SE(2): arrays `[..., 3]` of x (m), y (m), yaw (rad), NumPy or torch, broadcast as usual.

`pose_a_from_b` maps coordinates in frame b to coordinates in frame a, so frames cancel like fractions:
`compose(pose_a_from_b, pose_b_from_c)` is `pose_a_from_c`.
"""

from jaxtyping import Complex, Float

from pushgraph.arrays import Array, is_tensor, namespace


def rotate(vector: Float[Array, "*#batch 2"], yaw: Float[Array, "*#batch"] | float) -> Float[Array, "... 2"]:
    """Rotate vectors counter-clockwise by yaw (rad)."""
    xp = namespace(vector)
    cos, sin = xp.cos(yaw), xp.sin(yaw)
    x, y = vector[..., 0], vector[..., 1]
    return xp.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)


def as_complex(vectors: Float[Array, "*batch 2"]) -> Complex[Array, "*batch"]:
    """Vectors as complex numbers x + iy: one product turns them; `as_real` leads back."""
    return complex_of(vectors[..., 0], vectors[..., 1])


def complex_of(x: Float[Array, "*batch"], y: Float[Array, "*batch"]) -> Complex[Array, "*batch"]:
    """The complex numbers x + iy; see `as_complex`."""
    return namespace(x).complex(x, y) if is_tensor(x) else x + 1j * y


def as_real(numbers: Complex[Array, "*batch"]) -> Float[Array, "*batch 2"]:
    """Complex numbers as vectors; see `as_complex`."""
    xp = namespace(numbers)
    return xp.view_as_real(numbers) if is_tensor(numbers) else xp.stack((numbers.real, numbers.imag), axis=-1)


def compose(
    pose_a_from_b: Float[Array, "*#batch 3"], pose_b_from_c: Float[Array, "*#batch 3"]
) -> Float[Array, "... 3"]:
    """Return pose_a_from_c; yaws add without wrapping."""
    position = transform(pose_a_from_b, pose_b_from_c[..., :2])
    yaw = pose_a_from_b[..., 2:] + pose_b_from_c[..., 2:]
    return namespace(yaw).concatenate((position, yaw), axis=-1)


def inverse(pose_a_from_b: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """Return pose_b_from_a."""
    position, yaw = pose_a_from_b[..., :2], pose_a_from_b[..., 2]
    return namespace(yaw).concatenate((-rotate(position, -yaw), -yaw[..., None]), axis=-1)


def relative(
    pose_world_from_a: Float[Array, "*#batch 3"], pose_world_from_b: Float[Array, "*#batch 3"]
) -> Float[Array, "... 3"]:
    """Return pose_a_from_b; positions are subtracted first, so nothing is lost far from the origin."""
    difference = pose_world_from_b - pose_world_from_a
    position = rotate(difference[..., :2], -pose_world_from_a[..., 2])
    return namespace(position).concatenate((position, difference[..., 2:]), axis=-1)


def transform(pose_a_from_b: Float[Array, "*#batch 3"], points_b: Float[Array, "*#batch 2"]) -> Float[Array, "... 2"]:
    """Map points given in frame b to frame a."""
    return pose_a_from_b[..., :2] + rotate(points_b, pose_a_from_b[..., 2])


def wrap_angle(angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Return the same angle (rad) in [-pi, pi]."""
    xp = namespace(angle)
    return xp.arctan2(xp.sin(angle), xp.cos(angle))
