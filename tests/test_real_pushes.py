from pathlib import Path

import numpy as np
import pytest
from made_pushes import OUTLINES, rows_of, write

from pushgraph.errors import RealPushError
from pushgraph.real_pushes import depths, outline_of, read_outlines, read_pushes
from pushgraph.shape import Cuboid, Cylinder, Polygon


def test_a_table_becomes_arrays_in_si_units(tmp_path: Path) -> None:
    pushes = read_pushes(*write(tmp_path, rows_of(4, "disc") + rows_of(3, "box", surface="wood")))
    assert len(pushes) == 7
    assert pushes.materials == [("abs", "disc"), ("wood", "box")]
    np.testing.assert_allclose(pushes.speed, 0.02)
    np.testing.assert_allclose(pushes.motion, 0, atol=1e-12)
    assert pushes.of("wood").tolist() == [False] * 4 + [True] * 3
    one = pushes.take(np.array([5]))
    np.testing.assert_array_equal(one.before[0], pushes.before[5])


def test_what_other_models_state_is_read_by_their_names(tmp_path: Path) -> None:
    rows = [row | {"poly4_x1": 1.0, "poly4_y1": 2.0, "poly4_yaw1": 3.0} for row in rows_of(2, "disc")]
    pushes = read_pushes(*write(tmp_path, rows))
    np.testing.assert_array_equal(pushes.stated["poly4"], [[1.0, 2.0, 3.0]] * 2)


def test_any_outline_becomes_a_shape(tmp_path: Path) -> None:
    outlines = OUTLINES | {"oval": {"ellipse": [0.1, 0.06]}, "tri": {"polygon": [[0, 0], [0.1, 0], [0, 0.1]]}}
    shapes = read_outlines(write(tmp_path, rows_of(1, "disc"), outlines)[1])
    assert shapes["disc"] == Cylinder(diameter=0.1)
    assert shapes["box"] == Cuboid(size=(0.12, 0.08))
    assert isinstance(shapes["oval"], Polygon)
    assert np.ptp(outline_of(shapes["oval"]), axis=0).tolist() == pytest.approx([0.1, 0.06])
    corners = outline_of(shapes["tri"])
    x, y = corners.T
    assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() == pytest.approx(0.01)  # counter-clockwise


def test_depths_are_positive_inside(tmp_path: Path) -> None:
    found = depths(Cuboid(size=(0.12, 0.08)), np.array([[0.0, 0.0], [0.05, 0.0], [0.07, 0.0]]))
    np.testing.assert_allclose(found, [0.04, 0.01, -0.01])


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("x1", "nan", ["row 3", "column x1", "not finite"]),
        ("yaw0", "inf", ["row 3", "column yaw0", "not finite"]),
        ("tip_y1", "fast", ["row 3", "column tip_y1", "'fast' is no number"]),
        ("shape", "star", ["row 3", "column shape", "'star'", "disc, box"]),
        ("speed_mm_s", "0", ["row 3", "column speed_mm_s", "positive"]),
    ],
)
def test_bad_cells_are_named(tmp_path: Path, column: str, value: str, words: list[str]) -> None:
    rows = rows_of(3, "disc")
    rows[1][column] = value
    with pytest.raises(RealPushError) as error:
        read_pushes(*write(tmp_path, rows))
    assert all(word in str(error.value) for word in words), error.value


def test_a_push_that_starts_inside_is_refused(tmp_path: Path) -> None:
    rows = rows_of(3, "box")
    rows[2] |= {"tip_x0": rows[2]["x0"], "tip_y0": rows[2]["y0"]}
    with pytest.raises(RealPushError, match=r"row 4, columns tip_x0, tip_y0.*starts 44\.7 mm inside 'box'"):
        read_pushes(*write(tmp_path, rows))


def test_a_probe_that_stands_still_is_refused(tmp_path: Path) -> None:
    rows = rows_of(2, "box")
    rows[0] |= {"tip_x1": rows[0]["tip_x0"], "tip_y1": rows[0]["tip_y0"]}
    with pytest.raises(RealPushError, match="row 2.*does not move"):
        read_pushes(*write(tmp_path, rows))


@pytest.mark.parametrize(
    ("outline", "words"),
    [
        ({"polygon": [[0, 0], [0.1, 0.1], [0.1, 0], [0, 0.1]]}, "crosses or touches itself"),
        ({"polygon": [[0.05, 0.05], [-0.05, -0.05], [0.05, -0.05], [-0.05, 0.05]]}, "crosses or touches itself"),
        ({"ellipse": [0.1, -0.1]}, "positive"),
        ({"circle": 0.1}, "polygon"),
    ],
)
def test_bad_outlines_are_named(tmp_path: Path, outline: object, words: str) -> None:
    with pytest.raises(RealPushError, match=f"'bad'.*{words}"):
        read_pushes(*write(tmp_path, rows_of(1, "disc"), OUTLINES | {"bad": outline}))


def test_missing_columns_and_empty_tables_are_named(tmp_path: Path) -> None:
    rows = rows_of(2, "disc")
    for row in rows:
        del row["tip_x1"]
    with pytest.raises(RealPushError, match="row 1: no column tip_x1"):
        read_pushes(*write(tmp_path, rows))
    data, outlines = write(tmp_path, rows_of(1, "disc"))
    data.write_text(data.read_text().splitlines()[0])
    with pytest.raises(RealPushError, match="holds no push"):
        read_pushes(data, outlines)
