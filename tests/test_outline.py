"""Outlines and what they are cut into, against shapely."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import affinity

from pushgraph.errors import SceneError
from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.svg import outline_from_svg


def radial(radii: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    return radii[:, None] * np.stack((np.cos(angle), np.sin(angle)), -1)


def ellipse(count: int, a: float, b: float) -> np.ndarray:
    return radial(np.ones(count)) * (a, b)


def gear(teeth: int) -> np.ndarray:
    steps = ((0, 0.05), (0.3, 0.05), (0.4, 0.06), (0.8, 0.06), (0.9, 0.05))
    polar = [(2 * np.pi * (k + turn) / teeth, radius) for k in range(teeth) for turn, radius in steps]
    return np.array([(radius * math.cos(angle), radius * math.sin(angle)) for angle, radius in polar])


def bone() -> np.ndarray:
    knobs = [shapely.Point(x, y).buffer(0.025, 32) for x in (-0.06, 0.06) for y in (-0.018, 0.018)]
    return np.array(shapely.union_all([*knobs, shapely.box(-0.06, -0.015, 0.06, 0.015)]).exterior.coords)[:-1]


def ragged(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    count = rng.integers(5, 14)
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(0, 0.8, count)) / count
    return rng.uniform(0.03, 0.12, count)[:, None] * np.stack((np.cos(angle), np.sin(angle)), -1)


FAMILY = {  # points, and most parts
    "square": ([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], 1),
    "points along edges": ([(0, 0), (0.05, 0), (0.06, 0), (0.1, 0), (0.1, 0.1), (0.05, 0.1), (0, 0.1)], 1),
    "hexagon": (radial(np.full(6, 0.06)), 6),
    "L": ([(0, 0), (0.1, 0), (0.1, 0.03), (0.03, 0.03), (0.03, 0.12), (0, 0.12)], 2),
    "T": ([(-0.06, 0.03), (-0.06, 0), (-0.015, 0), (-0.015, -0.1), (0.015, -0.1), (0.015, 0), (0.06, 0),
           (0.06, 0.03)], 2),
    "hammer": ([(-0.01, -0.2), (0.01, -0.2), (0.012, 0), (0.06, 0), (0.06, 0.03), (-0.05, 0.03), (-0.08, 0.015),
                (-0.05, 0), (-0.012, 0)], 20),
    "triangle": ([(0, 0), (0.15, 0), (0, 0.15)], 20),
    "acute triangle": ([(0, 0), (0.15, 0), (0.01, 0.03)], 20),
    "star": (radial(np.tile((0.08, 0.035), 5)), 60),
    "ellipse": (ellipse(200, 0.075, 0.0525), 40),
    "disc": (ellipse(100, 0.05, 0.05), 1),
    "gear": (gear(12), 50),
    "bone": (bone(), 8),
    "thin plate": ([(0, 0), (0.2, 0), (0.2, 0.002), (0, 0.002)], 1),
    **{f"ragged {seed}": (ragged(seed), 60) for seed in range(6)},
}  # fmt: skip


def polygon(points, **fields) -> Polygon:
    return Polygon(points=tuple(map(tuple, np.asarray(points, float).tolist())), **fields)


def area_of(part) -> shapely.Polygon:
    x, y, yaw = part.pose_body_from_part
    if isinstance(part.shape, Cylinder):
        return shapely.Point(x, y).buffer(part.shape.diameter / 2, 128)
    length, width = part.shape.size
    box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
    return affinity.translate(affinity.rotate(box, yaw, (0, 0), use_radians=True), x, y)


def farthest(of: shapely.Geometry, from_: shapely.Geometry) -> float:
    points = shapely.points(shapely.get_coordinates(shapely.segmentize(of, 2e-4)))
    return float(shapely.distance(from_, points).max())


@pytest.mark.parametrize("name", FAMILY)
def test_parts_touch_as_the_outline_does(name: str) -> None:
    points, most = FAMILY[name]
    parts = polygon(points).parts
    assert len(parts) <= most
    true, union = shapely.Polygon(points), shapely.union_all([area_of(part) for part in parts])
    assert union.geom_type == "Polygon", "the parts are one piece"
    outer = shapely.Polygon(union.exterior).exterior
    assert farthest(outer, true.exterior) < 5e-4
    assert farthest(true.exterior, outer) < 5e-4
    # Nothing fits through: within 3 mm of the outline, no gap takes a pin of a millimetre.
    rim = true.buffer(-4e-4).difference(true.buffer(-3e-3)).difference(union)
    assert rim.buffer(-5e-4).is_empty


@pytest.mark.parametrize("name", ["L", "triangle", "ellipse", "ragged 3"])
def test_the_direction_of_the_points_changes_no_error(name: str) -> None:
    points, most = FAMILY[name]
    parts = polygon(points[::-1]).parts
    assert len(parts) <= most
    union = shapely.union_all([area_of(part) for part in parts])
    assert farthest(shapely.Polygon(points).exterior, union.exterior) < 5e-4


def test_normals_along_a_curve_are_those_of_the_outline() -> None:
    angle = np.linspace(0, 2 * np.pi, 721)
    points = np.stack((0.075 * np.cos(angle), 0.0525 * np.sin(angle)), -1)
    normals = np.stack((np.cos(angle) / 0.075, np.sin(angle) / 0.0525), -1)
    union = shapely.union_all([area_of(part) for part in polygon(FAMILY["ellipse"][0]).parts]).exterior
    turned = []
    for point, normal in zip(points, normals / np.hypot(*normals.T)[:, None], strict=True):
        at = union.project(shapely.Point(point))
        ahead, behind = (np.array(union.interpolate((at + d) % union.length).coords[0]) for d in (5e-4, -5e-4))
        along = ahead - behind
        turned.append(abs(math.asin(along @ normal / np.hypot(*along))))
    assert np.quantile(turned, 0.95) < math.radians(3.5)
    assert max(turned) < math.radians(8)  # at the seams of two discs


def test_cuboids_and_cylinders_are_their_own_only_part() -> None:
    for shape in (Cuboid(size=(0.1, 0.2)), Cylinder(diameter=0.1)):
        assert shape.parts == ((shape, (0.0, 0.0, 0.0)),)


def test_parts_keep_the_height_and_are_cut_once() -> None:
    triangle = polygon(FAMILY["triangle"][0], height=0.03)
    assert {part.shape.height for part in triangle.parts} == {0.03}
    assert polygon(FAMILY["triangle"][0], height=0.03).parts is triangle.parts


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(0, 0), (0.1, 0)], "at least 3 items"),
        ([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0)], "points 3 and 0 are the same.*closes itself"),
        ([(0, 0), (0.1, 0), (0.1, 0), (0, 0.1)], "points 1 and 2 are the same"),
        ([(0, 0), (0.1, 0.1), (0.1, 0), (0, 0.1)], r"crosses or touches itself at \[0.05, 0.05\] m"),
        ([(0, 0), (0.1, 0), (0.1, 0.1), (0.05, 0), (0, 0.1)], r"crosses or touches itself at \[0.05, 0\] m"),
        ([(0, 0), (0.1, 0), (0.2, 0)], "on one line"),
        ([(0, 0), (0.0005, 0), (0, 0.0005)], "encloses 0.125 mm"),
        ([(0, 0), (30, 0), (0, 1)], "30 m long; at most 20 m"),
        ([(0, 0), (math.nan, 0), (0, 1)], "finite number"),
    ],
)
def test_what_is_no_outline_is_refused_by_name(points, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Polygon(points=points)


def drawing(folder: Path, content: str) -> Path:
    path = folder / "drawing.svg"
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="100mm" viewBox="0 0 200 100">'
    path.write_text(f"{head}{content}</svg>")
    return path


LOZENGE = '<path id="lozenge" d="M0 0 L40 0 A20 20 0 0 1 40 40 L0 40 Z"/>'


def test_an_outline_is_read_from_a_drawing(tmp_path: Path) -> None:
    read = outline_from_svg(drawing(tmp_path, f'<g transform="translate(9,9)">{LOZENGE}</g>'), 0.001)
    true = shapely.union(shapely.box(0, 0, 0.04, 0.04), shapely.Point(0.04, 0.02).buffer(0.02, 256))
    true = affinity.translate(true, -true.centroid.x, -true.centroid.y)
    assert shapely.hausdorff_distance(true, shapely.Polygon(read.points)) < 1e-4
    assert len(read.parts) == 2


def test_a_drawing_stands_as_on_the_screen(tmp_path: Path) -> None:
    read = outline_from_svg(drawing(tmp_path, '<polygon points="0,0 60,0 0,30"/>'), 0.001)
    assert np.array(sorted(read.points)) == pytest.approx(np.array([(-0.02, -0.02), (-0.02, 0.01), (0.04, 0.01)]))


@pytest.mark.parametrize(
    ("content", "id", "message"),
    [
        ('<path d="M0 0 L40 0 L40 40"/>', None, "no closed outline; a path must end with Z"),
        (LOZENGE + '<circle id="hole" cx="20" cy="20" r="5"/>', None, r"2 closed outlines \(hole, lozenge\); name one"),
        (LOZENGE, "cup", "no closed outline with the id 'cup'; valid: lozenge"),
        ('<path id="bow" d="M0 0 L40 40 L40 0 L0 40 Z"/>', None, "outline bow: the outline crosses"),
        ("<path", None, "cannot read this drawing"),
    ],
)
def test_drawings_without_one_outline_are_refused(tmp_path: Path, content: str, id: str | None, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        outline_from_svg(drawing(tmp_path, content), 0.001, id)


def test_one_of_several_outlines_is_taken_by_id(tmp_path: Path) -> None:
    read = outline_from_svg(drawing(tmp_path, LOZENGE + '<circle id="hole" cx="20" cy="20" r="5"/>'), 0.001, "hole")
    (part,) = read.parts
    assert part.shape.diameter == pytest.approx(0.01, abs=1e-4)
