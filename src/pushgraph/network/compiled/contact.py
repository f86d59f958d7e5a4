"""Contact of two rounded boxes: `pushgraph.contact.contact_between`, of one pair of shapes."""

import math
from typing import NamedTuple

import numpy as np

from pushgraph import contact
from pushgraph.network.compiled.jit import compiled

_TIE = contact.TIE[64]
_COINCIDENT = (32 * np.finfo(np.float64).eps) ** 2
"""Points nearer than the root of this coincide."""
_TINY = np.finfo(np.float64).tiny


class PairContact(NamedTuple):
    """One or two contacts of shapes a and b, in the frame of a (m).

    normal: unit vector from a to b. gap, on_a, on_b: of the first contact, gap_2 and so on: of the second, which is the
    first again where there is but one.
    """

    normal_x: float
    normal_y: float
    gap: float
    on_a_x: float
    on_a_y: float
    on_b_x: float
    on_b_y: float
    gap_2: float
    on_a_x_2: float
    on_a_y_2: float
    on_b_x_2: float
    on_b_y_2: float


@compiled
def _face(half_x, half_y, other_x, other_y, cos, sin, x, y, handicap, best, best_face, first_face):
    """The face of a box, if it is better than the best so far, along whose normal another box stands farthest apart."""
    if half_x == 0.0 and half_y == 0.0 and (other_x > 0.0 or other_y > 0.0):
        return best, best_face
    # Half of the other box's extent along the axes of this one.
    reach_x = abs(other_x * cos) + abs(other_y * sin)
    reach_y = abs(other_x * sin) + abs(other_y * cos)
    separations = (x - reach_x - half_x, y - reach_y - half_y, -x - reach_x - half_x, -y - reach_y - half_y)
    for k in range(4):
        value = -separations[k] + handicap * (first_face + k)
        if value < best:
            best, best_face = value, first_face + k
    return best, best_face


@compiled
def contact_of(
    a_x: float,
    a_y: float,
    a_radius: float,
    b_x: float,
    b_y: float,
    b_radius: float,
    x: float,
    y: float,
    yaw: float,
) -> PairContact:
    """The contact of a box with half extents a_x, a_y with another, whose pose_a_from_b is x, y, yaw."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    back_x, back_y = -(x * cos + y * sin), x * sin - y * cos
    best, face = _face(a_x, a_y, b_x, b_y, cos, sin, x, y, _TIE, math.inf, -1, 0)
    best, face = _face(b_x, b_y, a_x, a_y, cos, -sin, back_x, back_y, _TIE, best, face, 4)
    of_a = face < 4
    quarter = face % 4
    # Everything in the frame of the box whose face it is, turned so that the face looks along x.
    if of_a:
        own_x, own_y, other_x, other_y, place_x, place_y, turn = a_x, a_y, b_x, b_y, x, y, sin
    else:
        own_x, own_y, other_x, other_y, place_x, place_y, turn = b_x, b_y, a_x, a_y, back_x, back_y, -sin
    height_of_face, half_length = (own_x, own_y) if quarter % 2 == 0 else (own_y, own_x)
    n_x = (1.0, 0.0, -1.0, 0.0)[quarter]
    n_y = (0.0, 1.0, 0.0, -1.0)[quarter]
    # The two lowest corners of the other box.
    low_value = second_value = math.inf
    low_x = low_y = next_x = next_y = 0.0
    for k in range(4):
        sign_x = 1.0 if k == 0 or k == 3 else -1.0
        sign_y = 1.0 if k < 2 else -1.0
        corner_x = sign_x * other_x * cos - sign_y * other_y * turn + place_x
        corner_y = sign_x * other_x * turn + sign_y * other_y * cos + place_y
        above, beside = corner_x * n_x + corner_y * n_y, corner_y * n_x - corner_x * n_y
        value = above + k * _TIE
        if value < low_value:
            second_value, next_x, next_y = low_value, low_x, low_y
            low_value, low_x, low_y = value, above, beside
        elif value < second_value:
            second_value, next_x, next_y = value, above, beside
    height, along = low_x - height_of_face, low_y
    rise, run = next_x - low_x, next_y - low_y
    separation = -(best - _TIE * face)

    parted = separation > 0.0
    face_along, behind = along, 0.0
    if parted or abs(rise) <= _TIE:
        face_along = min(max(along, -half_length), half_length)
        behind = ((face_along - along) * run - height * rise) / max(rise * rise + run * run, _TINY)
        behind = min(max(behind, 0.0), 1.0)
    other_height, other_along = height + behind * rise, along + behind * run
    squared = other_height**2 + (other_along - face_along) ** 2
    parted = parted and squared > _COINCIDENT
    distance = math.sqrt(squared) if parted else separation

    # The far end of the stretch in which the two faces look at each other.
    start = max(min(along, along + run), -half_length)
    end = min(max(along, along + run), half_length)
    far_along = end if other_along - start <= end - other_along + _TIE else start
    slope = rise / run if abs(run) > _TIE else 0.0
    far_height = height + slope * (far_along - along)
    two = end > start + _TIE and min(a_x, a_y) > 0.0 and min(b_x, b_y) > 0.0

    # Back to the frame of a.
    f_x, f_y, origin_x, origin_y = n_x, n_y, 0.0, 0.0
    if not of_a:
        f_x, f_y, origin_x, origin_y = n_x * cos - n_y * sin, n_x * sin + n_y * cos, x, y
    face_x = height_of_face * f_x - face_along * f_y + origin_x
    face_y = height_of_face * f_y + face_along * f_x + origin_y
    lifted = height_of_face + other_height
    over_x, over_y = lifted * f_x - other_along * f_y + origin_x, lifted * f_y + other_along * f_x + origin_y
    face_x_2 = height_of_face * f_x - far_along * f_y + origin_x
    face_y_2 = height_of_face * f_y + far_along * f_x + origin_y
    lifted = height_of_face + far_height
    over_x_2, over_y_2 = lifted * f_x - far_along * f_y + origin_x, lifted * f_y + far_along * f_x + origin_y
    if not of_a:
        face_x, face_y, over_x, over_y = over_x, over_y, face_x, face_y
        face_x_2, face_y_2, over_x_2, over_y_2 = over_x_2, over_y_2, face_x_2, face_y_2
        f_x, f_y = -f_x, -f_y
    first_x, first_y = f_x, f_y
    if parted:
        first_x, first_y = (over_x - face_x) / distance, (over_y - face_y) / distance
    radii = a_radius + b_radius
    gap = distance - radii
    on_a_x, on_a_y = face_x + a_radius * first_x, face_y + a_radius * first_y
    on_b_x, on_b_y = over_x - b_radius * first_x, over_y - b_radius * first_y
    if not two:
        return PairContact(
            first_x, first_y, gap, on_a_x, on_a_y, on_b_x, on_b_y, gap, on_a_x, on_a_y, on_b_x, on_b_y
        )
    return PairContact(
        first_x,
        first_y,
        gap,
        on_a_x,
        on_a_y,
        on_b_x,
        on_b_y,
        far_height - radii,
        face_x_2 + a_radius * f_x,
        face_y_2 + a_radius * f_y,
        over_x_2 - b_radius * f_x,
        over_y_2 - b_radius * f_y,
    )
