"""The setup `lever-up`: a screwdriver levers a circuit board up from each side of a hard disk drive.

The board lies in the middle of the drive on a plate smaller than itself; the screwdriver goes under its overhang, and
turns about the drive's rim. On each side there may be a ledge, beside which the screwdriver goes in.
"""

import contextlib
import functools
import math
import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.errors import SetupError, SimulationError
from pushgraph.lever_scene import OVERLAP, Box, LeverScene, LeverTool, Size, ToolBox, WayPoint, depth
from pushgraph.lever_track import LeverTrack

LEVER_UP = "lever-up"
SIDES = ("east", "north", "west", "south")
"""Names of the sides; the outward normal of each is a quarter turn on from that of the one before."""
DRIVE, DRIVE_HEIGHT = 0.20, 0.02
BOARD = (0.10, 0.20)
BOARD_HEIGHT = (0.0016, 0.004)
BOARD_MASS = (0.05, 0.20)
OVERHANG, UNDER_BOARD = (0.014, 0.028), (0.0025, 0.005)
"""How far the board reaches over its plate on each side, and how high above the drive it lies."""
LEDGE_SHARE, LEDGE, LEDGE_DEPTH = 0.6, (0.002, 0.08), 0.008
"""How often a side has a ledge; its length along the side."""
LEDGE_GAP, LEDGE_ABOVE = (0.001, 0.012), (0.0, 0.006)
"""From board to ledge, and how much higher than the board the ledge is."""
FRICTION, FRICTION_OF_DRIVE = (0.2, 0.45), 0.2
BLADE: tuple[Size, ...] = ((0.02, 0.010, 0.0015), (0.03, 0.009, 0.003), (0.12, 0.008, 0.006))
"""Boxes of the screwdriver from its tip on: length, width, thickness; flush below."""
SHORT_OF_PLATE = (0.002, 0.006)
HEADING = math.radians(10)
"""The screwdriver goes in within so much of the side's normal."""
LIFT, STEEPEST = (0.006, 0.028), math.radians(50)
"""How high its tip is lifted, and how far it turns at most."""
WITHDRAWN, ADVANCE = (0.008, 0.02), (0.005, 0.03)
"""How far it starts from the board, and how far it goes in further when it is up."""
ADVANCES, LOWERS = 0.4, 0.2
"""How often it goes in further; how often it turns back."""
DURATION = 3.0
TRIES = 20
"""Places of a screwdriver on a side that are tried before another drive is drawn."""
ATTEMPTS = 1000


class Drive(NamedTuple):
    """A drive with its board, the last of its boxes, and how far that reaches over its plate (m)."""

    bodies: tuple[Box, ...]
    overhang: float


class Interaction(NamedTuple):
    """One lever-up: its side, whether a ledge stands there, and what happened.

    rejected: how often a board was crushed before, between a ledge and a screwdriver that went another way.
    """

    track: LeverTrack
    side: str
    ledge: bool
    rejected: int


def draw_interaction(seed: int, index: int) -> Interaction:
    """Simulate interaction `index`: drive index // 4, side index % 4; the same arguments give the same bits."""
    from pushgraph.simulation.lever import simulate_lever  # here, so that datasets are read without MuJoCo

    number, side = divmod(index, len(SIDES))
    for rejected, scene in enumerate(_draw_scenes(seed, number, side)):
        with contextlib.suppress(SimulationError):
            track = simulate_lever(scene)
            if track.penetration.max() <= OVERLAP:
                return Interaction(track, SIDES[side], f"ledge_{SIDES[side]}" in track.scene.names, rejected)
    raise SetupError(f"setup {LEVER_UP!r}: {ATTEMPTS} ways under the {SIDES[side]} side of drive {number} fail")


def draw_scene(seed: int, index: int) -> LeverScene:
    """The scene of interaction `index` before anything is simulated: its board may yet be crushed."""
    return next(_draw_scenes(seed, *divmod(index, len(SIDES))))


def _draw_scenes(seed: int, number: int, side: int) -> Iterator[LeverScene]:
    """Ways of screwdrivers under one side of a drive."""
    drive = draw_drive(seed, number)
    rng = np.random.default_rng([zlib.crc32(LEVER_UP.encode()), seed, number, side])
    for _ in range(ATTEMPTS):
        way = _draw_way(rng, drive, side)
        if way is not None:
            yield LeverScene(bodies=drive.bodies, tool=way[0], path=way[1])


@functools.lru_cache(maxsize=4)
def draw_drive(seed: int, number: int) -> Drive:
    """A drive whose sides all have room for the screwdriver."""
    rng = np.random.default_rng([zlib.crc32(LEVER_UP.encode()), seed, number])
    for _ in range(ATTEMPTS):
        drive = _draw_boxes(rng)
        if all(_draw_way(rng, drive, side) is not None for side in range(len(SIDES))):
            return drive
    raise SetupError(f"setup {LEVER_UP!r}: {ATTEMPTS} drives in a row have a side without room for the screwdriver")


def _draw_boxes(rng: np.random.Generator) -> Drive:
    sides, height = rng.uniform(*BOARD, 2), rng.uniform(*BOARD_HEIGHT)
    overhang, under = rng.uniform(*OVERHANG), rng.uniform(*UNDER_BOARD)
    bottom = DRIVE_HEIGHT + under
    fixed = functools.partial(Box, fixed=True, friction=FRICTION_OF_DRIVE)
    boxes = [
        fixed(name="drive", size=(DRIVE, DRIVE, DRIVE_HEIGHT), position=(0.0, 0.0, DRIVE_HEIGHT / 2)),
        fixed(
            name="plate",
            size=(*(sides - 2 * overhang).tolist(), under),
            position=(0.0, 0.0, DRIVE_HEIGHT + under / 2),
        ),
    ]
    for side, name in enumerate(SIDES):
        has_ledge, length, gap = rng.random() < LEDGE_SHARE, rng.uniform(*LEDGE), rng.uniform(*LEDGE_GAP)
        top, along = bottom + height + rng.uniform(*LEDGE_ABOVE), rng.uniform(-0.5, 0.5)
        if not has_ledge:
            continue
        inner = sides[side % 2] / 2 + gap
        middle = np.array([inner + LEDGE_DEPTH / 2, along * (DRIVE - length), top / 2])
        x, y, z = pose_3d.rotate(middle, _about_vertical(side)).tolist()
        size = (LEDGE_DEPTH, length, top) if side % 2 == 0 else (length, LEDGE_DEPTH, top)
        boxes.append(fixed(name=f"ledge_{name}", size=size, position=(x, y, z)))
    boxes.append(
        Box(
            name="board",
            size=(*sides.tolist(), height),
            position=(0.0, 0.0, bottom + height / 2),
            mass=rng.uniform(*BOARD_MASS),
            friction=rng.uniform(*FRICTION),
        )
    )
    return Drive(tuple(boxes), overhang)


def _draw_way(rng: np.random.Generator, drive: Drive, side: int) -> tuple[LeverTool, tuple[WayPoint, ...]] | None:
    """A screwdriver and its way under one side of the board; None if ledges leave no room.

    In the frame of the side x points outward, and the tool's origin lies on the rim when it is in. Its x points along
    it, from tip to handle.
    """
    bodies, overhang = drive
    across, along = (bodies[-1].size[axis] / 2 for axis in (side % 2, 1 - side % 2))
    for _ in range(TRIES):
        place = rng.uniform(-1, 1) * (along - BLADE[0][1])
        heading = rng.uniform(-HEADING, HEADING)
        reach = (DRIVE / 2 - across + overhang - rng.uniform(*SHORT_OF_PLATE)) / math.cos(heading)
        tool = _screwdriver(reach, rng.uniform(*FRICTION))
        path = _draw_path(rng, np.array([DRIVE / 2, place, DRIVE_HEIGHT]), heading, reach, overhang, side)
        if all(_has_room(tool, point, bodies) for point in path[:2]):
            return tool, path
    return None


def _draw_path(
    rng: np.random.Generator,
    fulcrum: Float[np.ndarray, "3"],
    heading: float,
    reach: float,
    overhang: float,
    side: int,
) -> tuple[WayPoint, ...]:
    level = pose_3d.from_rotation_vector(np.array([0.0, 0.0, heading]))
    angle = math.asin(min(rng.uniform(*LIFT) / reach, math.sin(STEEPEST)))
    # Tip up: handle, on positive x, down.
    lifted = pose_3d.multiply(pose_3d.from_rotation_vector(np.array([0.0, angle, 0.0])), level)
    inward = pose_3d.rotate(np.array([-1.0, 0.0, 0.0]), lifted)
    start = fulcrum - pose_3d.rotate(np.array([-overhang - rng.uniform(*WITHDRAWN), 0.0, 0.0]), level)
    time = rng.uniform(0.3, 0.5)
    points = [(0.0, start, level), (time, fulcrum, level)]
    time += rng.uniform(0.8, 1.4)
    points.append((time, fulcrum, lifted))
    advances, advance, lowers = rng.random() < ADVANCES, rng.uniform(*ADVANCE), rng.random() < LOWERS
    if advances:
        time += 0.4
        points.append((time, fulcrum + advance * inward, lifted))
    if lowers:
        time += 0.5
        points.append((time, points[-1][1], level))
    points.append((DURATION, *points[-1][1:]))
    turn = _about_vertical(side)
    return tuple(
        WayPoint(
            time=at,
            position=tuple(pose_3d.rotate(position, turn).tolist()),
            quaternion=tuple(pose_3d.multiply(turn, quaternion).tolist()),
        )
        for at, position, quaternion in points
    )


def _screwdriver(reach: float, friction: float) -> LeverTool:
    boxes, tip = [], -reach
    for size in BLADE:
        boxes.append(ToolBox(size=size, position=(tip + size[0] / 2, 0.0, size[2] / 2)))
        tip += size[0]
    return LeverTool(boxes=tuple(boxes), friction=friction)


def _has_room(tool: LeverTool, point: WayPoint, bodies: tuple[Box, ...]) -> bool:
    """Whether the tool is clear of plate, ledges and board at a way-point; it lies on the drive."""
    return all(
        depth(box.size, pose_3d.compose(point.pose, box.pose), body.size, body.pose) < 0
        for box in tool.boxes
        for body in bodies[1:]
    )


def _about_vertical(side: int) -> Float[np.ndarray, "4"]:
    return pose_3d.from_rotation_vector(np.array([0.0, 0.0, side * math.pi / 2]))
