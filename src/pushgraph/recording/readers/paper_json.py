"""The paper's recordings: one JSON object a push, which holds its scene, too.

Keys "0" to "n" hold [x, y, yaw] (m, rad) of every frame; "0" is the end-effector. `shapes` has a row for each of them:
[robot, kind, mass, a, b], kind 0 a cylinder of diameter a, 1 a cuboid of sides a and b (kg, m). `edges` has a row for
each pair that is joined: [joint, i, j], joint 1 fixed, 2 prismatic, 3 revolute; i and j count from 0, the
end-effector left out. A frame is 0.05 s.
"""

import json
import math
from codecs import BOM_UTF8
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pushgraph.body import ROBOT, Body, Joint, JointKind
from pushgraph.errors import SceneError, TrackError
from pushgraph.json_file import MOST_BYTES, parse
from pushgraph.parting import parted
from pushgraph.recording.sightings import ReadOptions, Sightings, SightingsBuilder
from pushgraph.scene import Scene, Table
from pushgraph.scene_file import TRUSTED
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.storage import read_plain
from pushgraph.tool import Part, Tool
from pushgraph.track import FRAME

JOINTS: dict[int, JointKind] = {1: "fixed", 2: "prismatic", 3: "revolute"}
KINDS = {0: "cylinder", 1: "cuboid"}
MOST = 10**15
"""Whole numbers are smaller."""
DEEPEST = 0.02
"""Bodies that first overlap by more than noise explains (m) have other sizes than the file says."""


def is_paper_json(start: bytes) -> bool:
    """Whether a file that begins so is a JSON object."""
    return start.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")


def read_paper_json(path: Path, options: ReadOptions) -> Sightings:
    """Read one recording; raises TrackError, which names key and row, if it is truncated or does not fit together.

    Cylinders whose yaw never changes count as without yaw. A pose with null or NaN was not seen.
    """
    try:
        text = read_plain(path, MOST_BYTES).removeprefix(BOM_UTF8)
    except OSError as error:
        raise TrackError(f"cannot be read: {error.strerror}") from None
    content = parse(text, "as a push of the paper", TrackError)
    if not isinstance(content, dict):
        raise TrackError("must be a JSON object")
    missing = [key for key in ("0", "1", "shapes", "edges") if key not in content]
    if missing:
        raise TrackError(f"no key {missing[0]!r}; the paper's recordings have '0' to 'n', 'shapes' and 'edges'")
    unknown = [key for key in content if not (key.isascii() and key.isdecimal()) and key not in ("shapes", "edges")]
    if unknown:
        raise TrackError(f"key {unknown[0]!r}: unknown; the paper's recordings have '0' to 'n', 'shapes' and 'edges'")
    nodes = sorted((key for key in content if key.isdecimal()), key=int)
    if nodes != [str(k) for k in range(len(nodes))]:
        raise TrackError(f"keys {', '.join(nodes)}: must be 0 to {len(nodes) - 1}, each once")
    poses = np.stack([_poses(content, key) for key in nodes], 1)
    shapes = _rows(content["shapes"], "shapes", 5)
    if len(shapes) != len(nodes):
        raise TrackError(f"shapes: has {len(shapes)} rows; needed: {len(nodes)}, one for each of the keys 0 to n")
    scene = _scene(poses, shapes, _rows(content["edges"], "edges", 3))
    blind = [False, *(not body.yaw_known for body in scene.bodies)]
    builder = SightingsBuilder()
    for frame, of_nodes in enumerate(poses.tolist()):
        for name, hidden, (x, y, yaw) in zip((ROBOT, *scene.names), blind, of_nodes, strict=True):
            builder.add(name, frame * FRAME, x, y, math.nan if hidden else yaw)
    sightings = builder.finish()
    return Sightings(**(vars(sightings) | {"scene": scene.to_json(None)}))


def as_paper_json(
    poses: Float[np.ndarray, "frames nodes 3"], shapes: Sequence[Sequence[float | int]], edges: Sequence[Sequence[int]]
) -> str:
    """Text of such a file."""
    tracks = {str(k): poses[:, k].tolist() for k in range(poses.shape[1])}
    return json.dumps(tracks | {"shapes": [list(row) for row in shapes], "edges": [list(row) for row in edges]})


def _poses(content: dict[str, Any], key: str) -> Float[np.ndarray, "frames 3"]:
    rows = _rows(content[key], key, 3, lost=True)
    if not len(rows):
        raise TrackError(f"key {key!r}: holds no frames")
    if len(rows) != len(content["0"]):
        raise TrackError(f"key {key!r}: has {len(rows)} frames, key '0' has {len(content['0'])}")
    return rows


def _rows(rows: Any, key: str, length: int, lost: bool = False) -> Float[np.ndarray, "rows numbers"]:
    """Rows of so many numbers. lost: whether null and NaN stand for what was not seen."""
    if not isinstance(rows, list):
        raise TrackError(f"key {key!r}: must be a list of rows")
    for index, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != length:
            raise TrackError(f"key {key!r}: row {index}: must be {length} numbers, got {str(row)[:60]}")
        for column, value in enumerate(row):
            number = isinstance(value, float) or (type(value) is int and abs(value) < MOST)
            unseen = lost and (value is None or (number and math.isnan(value)))
            if not unseen and not (number and math.isfinite(value)):
                raise TrackError(f"key {key!r}: row {index}, column {column}: must be a number, got {str(value)[:60]}")
    return np.array(rows, dtype=float).reshape(-1, length)


def _scene(poses: Float[np.ndarray, "frames nodes 3"], shapes: np.ndarray, edges: np.ndarray) -> Scene:
    robots = np.flatnonzero(shapes[:, 0] != 0).tolist()
    if robots != [0]:
        raise TrackError(f"shapes: the robot must be row 0 and no other; rows {robots} say that they are it")
    try:
        tool = Tool(parts=(Part(shape=_shape(shapes[0], 0)),))
        bodies = [_body(row, index, poses[:, index]) for index, row in enumerate(shapes[1:], start=1)]
        joints = [_joint(row, index, len(bodies)) for index, row in enumerate(edges.tolist())]
        places = _apart(bodies).tolist()
        return Scene(
            bodies=tuple(
                body.replace(pose_world_from_body=tuple(place)) for body, place in zip(bodies, places, strict=True)
            ),
            joints=tuple(joint for joint in joints if joint is not None),
            tool=tool,
            table=Table(pose_world_from_table=(*np.mean(places, 0)[:2].tolist(), 0.0)),
        )
    except SceneError as error:
        raise TrackError(f"its scene does not fit together: {error}") from None


def _apart(bodies: Sequence[Body]) -> Float[np.ndarray, "bodies 3"]:
    """Poses of bodies that noise may have pressed into each other, moved apart."""
    scene = Scene.model_validate({"bodies": tuple(bodies)}, context=TRUSTED)
    apart = parted(scene, scene.poses_world_from_body)
    moved = np.hypot(*(apart - scene.poses_world_from_body)[:, :2].T)
    if moved.max() > DEEPEST:
        raise TrackError(
            f"shapes: body {scene.names[int(moved.argmax())]!r} overlaps others in the first frame by about "
            f"{moved.max() * 100:.0f} cm: its size must be in m, a cylinder's its diameter"
        )
    return apart


def _shape(row: np.ndarray, index: int) -> Cylinder | Cuboid:
    kind, a, b = row[[1, 3, 4]].tolist()
    if kind not in KINDS:
        raise TrackError(f"shapes: row {index}: kind {kind:g}; valid: 0 cylinder, 1 cuboid")
    if a <= 0 or b < 0 or (kind == 1 and b == 0):
        raise TrackError(f"shapes: row {index}: sizes {a:g} and {b:g} m; they must be positive")
    if kind == 0 and b not in (0, a):
        raise TrackError(f"shapes: row {index}: a cylinder of diameters {a:g} and {b:g}; they must be the same")
    return Cylinder(diameter=a) if kind == 0 else Cuboid(size=(a, b))


def _body(row: np.ndarray, index: int, poses: Float[np.ndarray, "frames 3"]) -> Body:
    shape, seen = _shape(row, index), np.isfinite(poses[:, :2]).all(-1)
    if not seen.any():
        raise TrackError(f"key '{index}': was never seen")
    yaws = poses[seen, 2]
    yaw_known = not isinstance(shape, Cylinder) or bool(np.isfinite(yaws).all() and np.ptp(yaws) > 0)
    x, y, yaw = poses[int(seen.argmax())].tolist()
    return Body(
        name=str(index),
        shape=shape,
        pose_world_from_body=(x, y, yaw if math.isfinite(yaw) else 0.0),
        mass=float(row[2]) or None,
        yaw_known=yaw_known,
    )


def _joint(row: Sequence[float], index: int, bodies: int) -> Joint | None:
    kind, first, second = row
    if kind not in (0, *JOINTS):
        raise TrackError(f"edges: row {index}: joint {kind:g}; valid: 0 none, 1 fixed, 2 prismatic, 3 revolute")
    if not {first, second} <= set(range(bodies)) or first == second:
        raise TrackError(f"edges: row {index}: joins {first:g} and {second:g}; valid: two of 0 to {bodies - 1}")
    if kind == 0:
        return None
    return Joint(kind=JOINTS[int(kind)], parent=str(int(first) + 1), child=str(int(second) + 1))
