"""Files of outlines, recorded pushes and the paper: sound ones, how they are read, what they state."""

import csv
import gzip
import io
import json
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from fuzz import of_bytes, of_csv, of_svg
from fuzz_pool import Kind
from fuzz_statements import json_kind, same_cells, strictly, written
from made_pushes import OUTLINES, rows_of, write
from test_paper_json import content as paper_content

from pushgraph.real_pushes import outline_of, read_outlines, read_pushes
from pushgraph.recording.files import read_sightings
from pushgraph.svg import outline_from_svg

DRAWING = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 200"><g transform="translate(10 5)">'
    '<path id="part" d="M 10 10 L 90 12 L 95 60 L 50 80 L 12 70 Z"/></g></svg>'
)


def read_outline(path: Path) -> Any:
    return outline_from_svg(path, 0.001).points


def states_drawing(content: bytes, points: Any) -> bool:
    """The XML is whole, every path draws all that it says, and of straight lines the corners are where they stand."""
    root = ElementTree.fromstring(content)
    paths = [one.get("d") or "" for one in root.iter() if one.tag.endswith("path")]
    number = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
    grammar = rf"\s*[Mm]\s*{number}([\s,]*({number}|[MmLlHhVvZzCcSsQqTtAa]))*\s*"
    return bool(paths) and all(re.fullmatch(grammar, path, re.ASCII) for path in paths)


def make_outlines(folder: Path) -> list[Path]:
    shapes = OUTLINES | {"egg": {"ellipse": [0.1, 0.06]}, "tri": {"polygon": [[0, 0], [0.1, 0], [0.02, 0.08]]}}
    return [write(folder, rows_of(2, "box"), shapes)[1]]


def read_shapes(path: Path) -> Any:
    return {name: outline_of(shape).tolist() for name, shape in read_outlines(path).items()}


def states_outlines(content: bytes, loaded: Any) -> bool:
    stated = strictly(content)
    assert set(stated) == set(loaded)
    for name, outline in stated.items():
        ((kind, numbers),) = outline.items()
        points = np.array(loaded[name])
        given = np.array(numbers if kind == "polygon" else [numbers])
        assert given.dtype.kind in "if", "no plain numbers"
        assert given.shape[1:] == (2,)
        if kind == "polygon":
            nearest = np.abs(points[:, None] - given[None]).max(-1)
            assert (nearest.min(1) < 1e-9).all()
            assert (nearest.min(0) < 1e-9).all()
        else:
            assert np.allclose(np.ptp(points, axis=0), given[0], rtol=1e-2)
    return True


def make_pushes(folder: Path) -> list[Path]:
    rows = [*rows_of(4, "box"), *rows_of(3, "disc", 1, "wood")]
    data, _ = write(folder, [row | {"poly4_x1": 0.0, "poly4_y1": 0.1, "poly4_yaw1": 0.2} for row in rows])
    (folder / "packed.csv").write_bytes(gzip.compress(data.read_bytes(), mtime=0))
    return [data, folder / "packed.csv"]


def read_table(path: Path) -> Any:
    pushes = read_pushes(path, path.parent / "outlines.json")
    columns = {
        "surface": pushes.surface, "shape": pushes.shape, "speed_mm_s": pushes.speed * 1e3,
        **dict(zip(("x0", "y0", "yaw0"), pushes.before.T, strict=True)),
        **dict(zip(("x1", "y1", "yaw1"), pushes.after.T, strict=True)),
        **dict(zip(("tip_x0", "tip_y0"), pushes.probe_start.T, strict=True)),
        **dict(zip(("tip_x1", "tip_y1"), pushes.probe_end.T, strict=True)),
    }  # fmt: skip
    for model, poses in pushes.stated.items():
        columns |= dict(zip((f"{model}_x1", f"{model}_y1", f"{model}_yaw1"), poses.T, strict=True))
    return {name: values.tolist() for name, values in columns.items()}


def states_table(content: bytes, loaded: Any) -> bool:
    text = (gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content).decode("utf-8-sig")
    header, *rows = [row for row in csv.reader(io.StringIO(text, newline=""), strict=True) if row]
    assert len(set(header)) == len(header), "a column stands twice"
    assert all(len(row) == len(header) for row in rows), "a row of another length"
    of_column = dict(zip(header, zip(*rows, strict=True), strict=True))
    unread = [name for name in header if name not in loaded]
    assert not any(name.startswith("poly4") for name in unread) or not all(
        f"poly4_{c}" in header for c in ("x1", "y1", "yaw1")
    )
    return all(same_cells(of_column[name], loaded[name]) for name in loaded)


def gzipped(mutation: Callable[[bytes, Random], bytes]) -> Callable[[bytes, Random], bytes]:
    """The mutation of what is packed, where it is."""

    def inner(content: bytes, rng: Random) -> bytes:
        if content[:2] != b"\x1f\x8b":
            return mutation(content, rng)
        return gzip.compress(mutation(gzip.decompress(content), rng), mtime=0)

    return inner


def read_paper(path: Path) -> Any:
    sightings = read_sightings(path)
    poses = np.stack([sightings.x, sightings.y, sightings.yaw], -1)
    frames = poses.reshape(-1, len(sightings.names), 3)
    return {
        "scene": json.loads(sightings.scene),
        **{
            str(k): [[None if math.isnan(v) else v for v in row] for row in frames[:, k].tolist()]
            for k in range(frames.shape[1])
        },
    }


def states_paper(content: bytes, loaded: Any) -> bool:
    text = content.decode("utf-8-sig")
    stated = strictly(text.encode())
    keys = [name for name in stated if name.isdecimal()]
    assert len(keys) == len(loaded) - 1, "another number of nodes"
    assert set(stated) - set(keys) == {"shapes", "edges"}, "a key that says nothing"
    for key in keys:
        blind = (
            not all(body["yaw_known"] for body in loaded["scene"]["bodies"] if body["name"] == key)
            if key != "0"
            else False
        )
        for row, (x, y, yaw) in zip(stated[key], loaded[key], strict=True):
            given = [None if value is None or not math.isfinite(value) else value for value in row]
            lost = given[0] is None or given[1] is None
            if not lost and (given[:2] != [x, y] or (not blind and given[2] != yaw)):
                return False
    return True


SVG = (of_bytes, of_svg, of_svg)
CSV = (of_bytes, gzipped(of_csv), gzipped(of_csv))
KINDS = [
    Kind(
        "outline",
        lambda f: written(f, "outline.svg", DRAWING),
        read_outline,
        (of_bytes, of_svg, of_svg),
        states_drawing,
    ),
    json_kind("outlines of recorded pushes", make_outlines, read_shapes, states_outlines),
    Kind("recorded pushes", make_pushes, read_table, CSV, states_table),
    json_kind("paper JSON", lambda f: written(f, "0.json", json.dumps(paper_content())), read_paper, states_paper),
]
