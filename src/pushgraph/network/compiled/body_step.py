"""A short step of boards among boxes, `pushgraph.network.body_step`, of one scene after the other."""

import math
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph.contact_patch import POINTS
from pushgraph.graph.lever_batch import LeverState
from pushgraph.network.body_problem import SOFTNESS
from pushgraph.network.body_step import MARGIN, RECOVERY, REST
from pushgraph.network.compiled.body_problem import solve
from pushgraph.network.compiled.box_contact import best_axis, edge_point, face_points, rotate_into
from pushgraph.network.compiled.jit import compiled
from pushgraph.network.compiled.threads import share_out


class Boards(NamedTuple):
    """Fields of LeverBatch and LeverState, the ways of their tools and the wrenches on boards; see there."""

    half_board: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    gravity: np.ndarray
    half: np.ndarray
    pose_box: np.ndarray
    friction: np.ndarray
    of_tool: np.ndarray
    present: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray
    tool: np.ndarray
    next_tool: np.ndarray
    wrench: np.ndarray


class Contacts(NamedTuple):
    """Room for the contacts of one scene; see `body_problem.BodyProblem`. arm: from the board's centre, world (m)."""

    normal: np.ndarray
    arm: np.ndarray
    aim: np.ndarray
    friction: np.ndarray
    softness: np.ndarray


def solve_step(
    state: LeverState,
    tool: Float[Tensor, "batch 7"],
    next_tool: Float[Tensor, "batch 7"],
    seconds: float,
    wrench: Float[Tensor, "batch 6"] | None,
) -> LeverState:
    """See `pushgraph.network.body_step.step`; tensors on the CPU."""
    acting = torch.zeros_like(state.velocity) if wrench is None else wrench
    tensors = (*state.scenes, state.pose, state.velocity, tool, next_tool, acting)
    boards = Boards(*(np.ascontiguousarray(values.numpy()) for values in tensors))
    pose, velocity = np.empty_like(boards.pose), np.empty_like(boards.velocity)
    most = POINTS * boards.half.shape[1]

    def work(first: int, last: int) -> None:
        normal, arm, aim = np.empty((3, most, 3))
        contacts = Contacts(normal, arm, aim, friction=np.empty(most), softness=np.empty(most))
        _step_scenes(boards, first, last, seconds, contacts, pose, velocity)

    share_out(work, len(pose))
    return LeverState(state.scenes, torch.from_numpy(pose), torch.from_numpy(velocity))


@compiled
def _step_scenes(boards, first, last, seconds, contacts, pose, velocity):
    matrix, inertia, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    free, found = np.empty(6), np.empty(6)
    for scene in range(first, last):
        rotate_into(boards.pose[scene, 3:], matrix)
        for i in range(3):
            for k in range(3):
                inertia[i, k] = inverse[i, k] = 0.0
                for axis in range(3):
                    square = matrix[i, axis] * matrix[k, axis]
                    inertia[i, k] += square * boards.inertia[scene, axis]
                    inverse[i, k] += square / boards.inertia[scene, axis]
        _free_velocity(boards, scene, inertia, inverse, seconds, free)
        count, touched = _find_contacts(boards, scene, matrix, inverse, seconds, contacts)
        solve(boards.mass[scene], inertia, free, boards.velocity[scene], count, contacts, found)
        radius, speed, turning = _length(boards.half_board[scene]), _length(found[:3]), _length(found[3:])
        if not touched and not boards.velocity[scene].any() and speed + turning * radius < REST:
            pose[scene], velocity[scene] = boards.pose[scene], 0.0
            continue
        velocity[scene] = found
        _move(boards.pose[scene], found, seconds, pose[scene])


@compiled
def _free_velocity(boards, scene, inertia, inverse, seconds, free):
    """The velocity after the step if nothing touches."""
    old, wrench = boards.velocity[scene], boards.wrench[scene]
    momentum, torque = np.empty(3), np.empty(3)
    for i in range(3):
        momentum[i] = inertia[i, 0] * old[3] + inertia[i, 1] * old[4] + inertia[i, 2] * old[5]
        free[i] = old[i] + seconds * (boards.gravity[scene, i] + wrench[i] / boards.mass[scene])
    torque[0] = wrench[3] - (old[4] * momentum[2] - old[5] * momentum[1])
    torque[1] = wrench[4] - (old[5] * momentum[0] - old[3] * momentum[2])
    torque[2] = wrench[5] - (old[3] * momentum[1] - old[4] * momentum[0])
    for i in range(3):
        faster = inverse[i, 0] * torque[0] + inverse[i, 1] * torque[1] + inverse[i, 2] * torque[2]
        free[3 + i] = old[3 + i] + seconds * faster


@compiled
def _find_contacts(boards, scene, matrix_board, inverse, seconds, contacts):
    """How many contacts there are, and whether the tool has any of them."""
    board, half_board, tool = boards.pose[scene, :3], boards.half_board[scene], boards.tool[scene]
    moves, box, matrix = np.empty(6), np.empty(7), np.empty((3, 3))
    normal, points, gaps = np.empty(3), np.empty((POINTS, 3)), np.empty(POINTS)
    _rates(tool, boards.next_tool[scene], seconds, moves)
    radius_board = _length(half_board)
    board_speed = _length(boards.velocity[scene, :3]) + _length(boards.velocity[scene, 3:]) * radius_board
    lightness = 1 / boards.mass[scene]
    spread = inverse[0, 0] + inverse[1, 1] + inverse[2, 2]
    count, touched = 0, False
    for k in range(boards.half.shape[1]):
        if not boards.present[scene, k]:
            continue
        half, of_tool = boards.half[scene, k], boards.of_tool[scene, k]
        radius, margin = _length(half), MARGIN + seconds * board_speed
        if of_tool:
            _compose(tool, boards.pose_box[scene, k], box)
            swing = _swing(moves, box, tool, normal)
            margin += seconds * (swing + _length(moves[3:]) * radius)
        else:
            box[:] = boards.pose_box[scene, k]
        between = math.sqrt((box[0] - board[0]) ** 2 + (box[1] - board[1]) ** 2 + (box[2] - board[2]) ** 2)
        if between >= radius + radius_board + margin:
            continue
        rotate_into(box[3:], matrix)
        place = box[:3]
        best, gap = best_axis(board, matrix_board, half_board, place, matrix, half, margin, normal)
        if best < 0:
            continue
        if best < 3:
            there = face_points(board, matrix_board, half_board, place, matrix, half, normal, points, gaps)
        elif best < 6:
            there = face_points(place, matrix, half, board, matrix_board, half_board, -normal, points, gaps)
            for number in range(there):
                points[number] += gaps[number] * normal
        else:
            edge_point(board, matrix_board, half_board, place, matrix, half, normal, best - 6, points[0])
            gaps[0], there = gap, 1
        for number in range(there):
            if gaps[number] >= margin:
                continue
            touched |= of_tool
            arm, aim = contacts.arm[count], contacts.aim[count]
            aim[:] = 0.0
            if of_tool:
                _swing(moves, points[number], tool, aim)
            apart = -gaps[number] / seconds * (RECOVERY if gaps[number] < 0 else 1.0)
            square = turned = 0.0
            for i in range(3):
                contacts.normal[count, i] = normal[i]
                arm[i] = points[number, i] - board[i]
                aim[i] -= apart * normal[i]
                square += arm[i] * arm[i]
            for i in range(3):
                turned += arm[i] * (inverse[i, 0] * arm[0] + inverse[i, 1] * arm[1] + inverse[i, 2] * arm[2])
            contacts.friction[count] = boards.friction[scene, k]
            contacts.softness[count] = SOFTNESS * (lightness + (spread * square - turned) / 3)
            count += 1
    return count, touched


@compiled
def _length(vector):
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


@compiled
def _swing(moves, point, tool, out):
    """Velocity of a point that moves with the tool, and its length."""
    x, y, z = point[0] - tool[0], point[1] - tool[1], point[2] - tool[2]
    out[0] = moves[0] + moves[4] * z - moves[5] * y
    out[1] = moves[1] + moves[5] * x - moves[3] * z
    out[2] = moves[2] + moves[3] * y - moves[4] * x
    return _length(out)


@compiled
def _multiply(a, b, out):
    """See `pose_3d.multiply`."""
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + b[0] * a[1] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] + b[0] * a[2] + a[3] * b[1] - a[1] * b[3]
    out[3] = a[0] * b[3] + b[0] * a[3] + a[1] * b[2] - a[2] * b[1]


@compiled
def _compose(pose, other, out):
    """See `pose_3d.compose`."""
    matrix = np.empty((3, 3))
    rotate_into(pose[3:], matrix)
    for i in range(3):
        out[i] = pose[i] + matrix[i, 0] * other[0] + matrix[i, 1] * other[1] + matrix[i, 2] * other[2]
    _multiply(pose[3:], other[3:], out[3:])


@compiled
def _rates(before, after, seconds, moves):
    """Velocity and turning that lead from one pose to another; see `lever_batch.displacement`."""
    back, turn = np.empty(4), np.empty(4)
    back[0], back[1], back[2], back[3] = before[3], -before[4], -before[5], -before[6]
    _multiply(after[3:], back, turn)
    if turn[0] < 0:
        turn *= -1.0
    sine = _length(turn[1:])
    factor = 2 * math.atan2(sine, turn[0]) / sine if sine > 0.0 else 2.0
    for i in range(3):
        moves[i] = (after[i] - before[i]) / seconds
        moves[3 + i] = factor * turn[1 + i] / seconds


@compiled
def _move(pose, velocity, seconds, out):
    """The pose after a step with this velocity; its quaternion stays of length 1."""
    turn = np.empty(4)
    half = seconds * _length(velocity[3:]) / 2
    turn[0], factor = math.cos(half), seconds / 2 * (math.sin(half) / half if half > 0.0 else 1.0)
    for i in range(3):
        out[i] = pose[i] + seconds * velocity[i]
        turn[1 + i] = factor * velocity[3 + i]
    _multiply(turn, pose[3:], out[3:])
    length = math.sqrt(out[3] * out[3] + _length(out[4:]) ** 2)
    out[3:] /= length
