"""The patch in which two boxes touch: `pushgraph.contact_patch` of one pair.

A box is its centre (m, world), its axes (columns of a matrix) and its half sizes (m).
"""

import math

import numpy as np

from pushgraph import contact_axes, contact_patch
from pushgraph.network.compiled.jit import compiled

PARALLEL, PREFER_FACES, TIE = contact_axes.PARALLEL, contact_patch.PREFER_FACES, contact_patch.TIE
FLAT = contact_patch.FLAT
SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Corners of a face, around it."""


@compiled
def rotate_into(quaternion, matrix):
    """The matrix of a unit quaternion; see `pose_3d.rotation_matrix`."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@compiled
def best_axis(centre_a, matrix_a, half_a, centre_b, matrix_b, half_b, margin, normal):
    """Number of the axis that tells two boxes apart, and the gap along it; -1 if they are farther apart than `margin`.

    Axes are numbered and chosen as in `contact_axes` and `contact_patch`; the normal, from a to b, is written.
    """
    between = np.empty((3, 3))
    offset = np.empty(3)
    for i in range(3):
        offset[i] = 0.0
        for k in range(3):
            offset[i] += matrix_a[k, i] * (centre_b[k] - centre_a[k])
            between[i, k] = 0.0
            for row in range(3):
                between[i, k] += matrix_a[row, i] * matrix_b[row, k]
    best, value, found, way = -1, -math.inf, 0.0, 1.0
    for i in range(3):
        extent = half_a[i]
        for k in range(3):
            extent += half_b[k] * abs(between[i, k])
        gap = abs(offset[i]) - extent
        if gap >= margin:
            return -1, gap
        if gap > value:
            best, value, found, way = i, gap, gap, offset[i]
    for k in range(3):
        apart, extent = 0.0, half_b[k]
        for i in range(3):
            apart += offset[i] * between[i, k]
            extent += half_a[i] * abs(between[i, k])
        gap = abs(apart) - extent
        if gap >= margin:
            return -1, gap
        if gap - TIE > value:
            best, value, found, way = 3 + k, gap - TIE, gap, apart
    for i in range(3):
        i_1, i_2 = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            sine = math.hypot(between[i_1, k], between[i_2, k])
            if sine <= PARALLEL:
                continue
            k_1, k_2 = (k + 1) % 3, (k + 2) % 3
            apart = (between[i_1, k] * offset[i_2] - between[i_2, k] * offset[i_1]) / sine
            extent = half_a[i_1] * abs(between[i_2, k]) + half_a[i_2] * abs(between[i_1, k])
            extent += half_b[k_1] * abs(between[i, k_2]) + half_b[k_2] * abs(between[i, k_1])
            gap = abs(apart) - extent / sine
            if gap >= margin:
                return -1, gap
            if gap - PREFER_FACES > value:
                best, value, found, way = 6 + 3 * i + k, gap - PREFER_FACES, gap, apart
    if best < 3:
        normal[:] = matrix_a[:, best]
    elif best < 6:
        normal[:] = matrix_b[:, best - 3]
    else:
        _cross(matrix_a[:, (best - 6) // 3], matrix_b[:, (best - 6) % 3], normal)
        normal /= math.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
    if way < 0:
        normal *= -1.0
    return best, found


@compiled
def face_points(first, matrix_first, half_first, second, matrix_second, half_second, outward, points, gaps):
    """Points of the second box's face against the first one's, world, and their gaps; returns how many there are."""
    frame, facing, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    extent, sides, centre = np.empty(3), np.empty(3), np.empty(3)
    corner = np.empty((4, 3))
    _face_frame(matrix_first, half_first, outward, 1.0, frame, extent)
    _face_frame(matrix_second, half_second, outward, -1.0, facing, sides)
    for i in range(3):
        centre[i] = 0.0
        for row in range(3):
            centre[i] += frame[row, i] * (second[row] - first[row])
        for k in range(3):
            turned[i, k] = 0.0
            for row in range(3):
                turned[i, k] += frame[row, i] * facing[row, k]
            turned[i, k] *= sides[k]
        centre[i] += turned[i, 2]
    for number in range(4):
        for i in range(3):
            corner[number, i] = centre[i] + SIGNS[number, 0] * turned[i, 0] + SIGNS[number, 1] * turned[i, 1]
    count = 0
    for number in range(4):
        here, there = corner[number], corner[(number + 1) % 4]
        begin, leaves = _cut(here, there, extent)
        end = min(leaves, 1.0)
        if begin > end:
            continue
        for share, is_there in ((begin, True), (end, leaves < 1)):
            if is_there:
                z = here[2] + share * (there[2] - here[2])
                x, y = here[0] + share * (there[0] - here[0]), here[1] + share * (there[1] - here[1])
                count = _add(first, frame, x, y, z, extent[2], points, gaps, count)
    # Corners of the first face within the second: in coordinates (s, t) along its sides.
    determinant = turned[0, 0] * turned[1, 1] - turned[1, 0] * turned[0, 1]
    if abs(determinant) < FLAT:
        determinant = FLAT
    for number in range(4):
        x, y = SIGNS[number, 0] * extent[0], SIGNS[number, 1] * extent[1]
        off_x, off_y = x - centre[0], y - centre[1]
        s = (off_x * turned[1, 1] - off_y * turned[0, 1]) / determinant
        t = (off_y * turned[0, 0] - off_x * turned[1, 0]) / determinant
        if abs(s) < 1 and abs(t) < 1:
            z = centre[2] + s * turned[2, 0] + t * turned[2, 1]
            count = _add(first, frame, x, y, z, extent[2], points, gaps, count)
    return count


@compiled
def _cut(here, there, extent):
    """The shares of an edge at which it enters the outline, at least 0, and leaves it."""
    enters, leaves = 0.0, math.inf
    for axis in range(2):
        along = there[axis] - here[axis]
        if abs(along) < FLAT:
            if abs(here[axis]) > extent[axis]:
                return math.inf, -math.inf
            continue
        one, other = (-extent[axis] - here[axis]) / along, (extent[axis] - here[axis]) / along
        enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
    return enters, leaves


@compiled
def _add(first, frame, x, y, z, height, points, gaps, count):
    for row in range(3):
        points[count, row] = first[row] + frame[row, 0] * x + frame[row, 1] * y + frame[row, 2] * z
    gaps[count] = z - height
    return count + 1


@compiled
def _face_frame(matrix, half, outward, way, frame, sides):
    """Axes of the face that looks most into a direction, and half sizes along them; see `contact_patch`."""
    axis, most, cosine = 0, -1.0, 0.0
    for k in range(3):
        along = way * (matrix[0, k] * outward[0] + matrix[1, k] * outward[1] + matrix[2, k] * outward[2])
        if abs(along) > most:
            axis, most, cosine = k, abs(along), along
    sign = -1.0 if cosine < 0 else 1.0
    for k in range(3):
        own = (axis + 1 + k) % 3
        sides[k] = half[own]
        for row in range(3):
            frame[row, k] = matrix[row, own] if k == 0 else sign * matrix[row, own]


@compiled
def edge_point(centre_a, matrix_a, half_a, centre_b, matrix_b, half_b, normal, pair, point):
    """The point of b's edge nearest to a's, for a pair of edges; see `contact_patch`."""
    along_a, along_b = matrix_a[:, pair // 3], matrix_b[:, pair % 3]
    on_a, on_b = np.empty(3), np.empty(3)
    _middle_of_edge(centre_a, matrix_a, half_a, normal, 1.0, pair // 3, on_a)
    _middle_of_edge(centre_b, matrix_b, half_b, normal, -1.0, pair % 3, on_b)
    cosine = from_a = from_b = 0.0
    for row in range(3):
        cosine += along_a[row] * along_b[row]
        from_a += along_a[row] * (on_b[row] - on_a[row])
        from_b += along_b[row] * (on_b[row] - on_a[row])
    share = (cosine * from_a - from_b) / max(1 - cosine * cosine, FLAT)
    for row in range(3):
        point[row] = on_b[row] + share * along_b[row]


@compiled
def _middle_of_edge(centre, matrix, half, normal, way, axis, middle):
    middle[:] = centre
    for k in range(3):
        along = way * (matrix[0, k] * normal[0] + matrix[1, k] * normal[1] + matrix[2, k] * normal[2])
        if k != axis:
            reach = -half[k] if along < 0 else half[k]
            for row in range(3):
                middle[row] += reach * matrix[row, k]


@compiled
def _cross(a, b, out):
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
