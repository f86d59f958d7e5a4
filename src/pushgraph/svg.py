"""Outlines from drawings: the closed paths of an SVG file."""

import math
import os
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import svgelements

from pushgraph import outline
from pushgraph.errors import SceneError
from pushgraph.shape import Polygon
from pushgraph.storage import read_plain

FLATNESS = 2e-5
"""Curves are drawn as chords that stay within this of them (m)."""
TURN = math.radians(5)
"""And that turn by no more than this from one to the next."""
MOST_POINTS = 1000
MOST_BYTES = 2 * 2**20
"""Largest drawing that is read."""
_NUMBER = r"[\s,]*+[+-]?+(?>\d++\.?+\d*+|\.\d++)(?>[eE][+-]?+\d++)?+"
_FLAG = r"[\s,]*+[01]"
_ARGUMENTS = {"Hh": [_NUMBER], "MmLlTt": [_NUMBER] * 2, "SsQq": [_NUMBER] * 4, "Cc": [_NUMBER] * 6}
_ARGUMENTS |= {"Aa": [*[_NUMBER] * 3, _FLAG, _FLAG, _NUMBER, _NUMBER], "Vv": [_NUMBER]}
_COMMANDS = "|".join(rf"[{letters}](?>{''.join(parts)})++" for letters, parts in _ARGUMENTS.items())
_PATH = re.compile(rf"(?>\s*+(?>{_COMMANDS}|[Zz]))*+\s*+", re.ASCII)
"""Path data as SVG 1.1 has it; the parser leaves out what it does not understand."""


def outline_from_svg(file: str | os.PathLike, scale: float, id: str | None = None, height: float = 0.10) -> Polygon:
    """The outline that an SVG file draws, as a polygon about the centroid of its area.

    scale: metres per user unit of the drawing, 0.001 where it is drawn in millimetres; transforms are applied first.
    id: of the element to take; without it the drawing must hold one closed outline. SVG counts y downwards, a body
    upwards: the outline stands as it does on the screen. Curves become chords within 0.02 mm.

    Raises SceneError if there is no such file or element, no closed outline or several, or it is not valid.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise SceneError(f"{file}: scale: must be metres per unit of the drawing, above 0, got {scale!r}")
    try:
        read_plain(Path(file), MOST_BYTES)
        _check_written(Path(file))
        drawing = svgelements.SVG.parse(str(Path(file)), reify=True)
        # The parser turns user units into pixels of a screen: turn them back.
        units = ~svgelements.Matrix(drawing.viewbox_transform or "")
    except SceneError:
        raise
    except Exception as error:  # the parser raises whatever its XML and number readers raise
        raise SceneError(f"{file}: cannot read this drawing: {error}") from error
    found: dict[tuple[str, int], svgelements.Path] = {}
    for element in drawing.elements(lambda one: isinstance(one, svgelements.Shape)):
        for k, path in enumerate(abs(svgelements.Path(element) * units).as_subpaths()):
            path = svgelements.Path(path)
            if _is_closed(path):
                found[element.id or f"(no id, number {len(found) + 1})", k] = path
    ids = sorted({name for name, _ in found})
    if id is not None:
        found = {key: path for key, path in found.items() if key[0] == id}
        if not found:
            raise SceneError(f"{file}: no closed outline with the id {id!r}; valid: {', '.join(ids[:20]) or 'none'}")
    if not found:
        raise SceneError(f"{file}: no closed outline; a path must end with Z or where it began")
    if len(found) > 1:
        raise SceneError(
            f"{file}: {len(found)} closed outlines ({', '.join(ids[:20])}); name one by id. Holes are not supported"
        )
    ((name, _), path) = found.popitem()
    points = np.array(_chords(path, scale)) * (scale, -scale)
    points = points[np.hypot(*(points - np.roll(points, -1, 0)).T) > 1e-9]
    where = f"{file}: outline {name}"
    if not 3 <= len(points) <= MOST_POINTS:
        raise SceneError(f"{where}: {len(points)} points at this scale; 3 to {MOST_POINTS} are valid")
    fault = outline.fault_of(tuple(map(tuple, points.tolist())))
    if fault:
        raise SceneError(f"{where}: {fault}")
    points = points - outline.centroid(points)
    return Polygon(points=tuple(map(tuple, points.round(9).tolist())), height=height)


def _check_written(file: Path) -> None:
    """Raise SceneError if a path or a list of points is not whole."""
    for element in ElementTree.parse(file).iter():
        kind = str(element.tag).rpartition("}")[2]
        written, whole = element.get("d", ""), _PATH.fullmatch(element.get("d", ""))
        if kind in ("polygon", "polyline"):
            written = element.get("points", "")
            whole = re.fullmatch(rf"(?>{_NUMBER}{_NUMBER})*+\s*+", written, re.ASCII)
        if whole is None:
            at = _PATH.match(written)
            end = at.end() if at and kind == "path" else 0
            name = element.get("id") or "(no id)"
            raise SceneError(f"{file}: {kind} {name}: its data make no sense from {written[end : end + 40]!r} on")


def _is_closed(path: svgelements.Path) -> bool:
    drawn = [segment for segment in path if not isinstance(segment, svgelements.Move)]
    if not drawn:
        return False
    first, last = path.first_point, path.current_point
    size = max(abs(complex(segment.end) - complex(first)) for segment in drawn if segment.end is not None)
    return isinstance(drawn[-1], svgelements.Close) or (size > 0 and abs(complex(last) - complex(first)) < 1e-6 * size)


def _chords(path: svgelements.Path, scale: float) -> list[tuple[float, float]]:
    """Points along a path: ends of its segments, and points of its curves."""
    points: list[tuple[float, float]] = []
    for segment in path:
        if isinstance(segment, svgelements.Move):
            continue
        if not isinstance(segment, svgelements.Line | svgelements.Close):
            points += _on_curve(segment, scale)
        if segment.end is not None:
            points.append((segment.end.x, segment.end.y))
    return points


def _on_curve(segment: svgelements.PathSegment, scale: float) -> list[tuple[float, float]]:
    """Inner points of a curve, so many that chords stay within `FLATNESS` and turn by `TURN` at most."""
    count = 2
    while True:
        position = np.array([complex(p.x, p.y) for p in map(segment.point, np.linspace(0, 1, 2 * count + 1).tolist())])
        ends, middles = position[::2], position[1::2]
        chord = np.diff(ends)
        sagitta = np.abs(middles - (ends[1:] + ends[:-1]) / 2) * scale
        turn = np.abs(np.angle((ends[1:] - middles) * (middles - ends[:-1]).conj()))
        if count >= MOST_POINTS or not len(chord) or (sagitta.max() < FLATNESS and turn.max() < TURN):
            return [(z.real, z.imag) for z in ends[1:-1].tolist()]
        count += max(1, count // 4)
