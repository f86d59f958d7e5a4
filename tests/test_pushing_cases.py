"""Pushes of loose bodies and rigid pieces whose outcome physics or geometry says."""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pytest
from planar_reference import piece_pose, reference_ends
from scenes import body, flat_tool, mirrored, moved_by

from pushgraph.body import Body
from pushgraph.errors import SimulationError
from pushgraph.plausibility import remarks
from pushgraph.pose import compose, relative
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Part, Push, Tool
from pushgraph.track import Track

GRAVITY = 9.81
LARGE = Table(size=(6, 6))


def overlap(track: Track) -> float:
    """Deepest overlap (m) of any two bodies, or of tool and body, in any frame."""
    pairs = list(combinations(range(len(track.scene.bodies)), 2))
    gaps = [track.scene.tool_gaps(track.poses[:, 0], track.poses[:, 1:]).min()]
    if pairs:
        gaps.append(track.scene.pair_gaps(pairs, track.poses[:, 1:]).min())
    return -float(min(gaps))


def assert_near(moved: Sequence[float], right: Sequence[float], millimetres: float, degrees: float) -> None:
    assert math.dist(moved[:2], right[:2]) <= millimetres, f"{np.round(moved, 2)} is not {np.round(right, 2)}"
    assert abs(moved[2] - right[2]) <= degrees, f"{np.round(moved, 2)} is not {np.round(right, 2)}"


# A flat face -----------------------------------------------------------------------------------------------------


def pushed_flat(degrees: float, speed: float, side: float = 0.25, size=(0.1, 0.08), **table) -> Scene:
    angle = math.radians(degrees)
    push = Push(start=(0, 0), end=(0.15 * math.cos(angle), 0.15 * math.sin(angle)), speed=speed)
    box = body("box", 0.01 + size[0] / 2, 0, Cuboid(size=size), mass=0.4)
    return Scene(
        bodies=(box,), tool=flat_tool(0.02, 0.08), pushes=(push,), side_friction=side, table=LARGE.replace(**table)
    )


@pytest.mark.parametrize("speed", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("degrees", [5, 10])
def test_a_flat_face_within_the_friction_cone_sticks(degrees: float, speed: float) -> None:
    angle = math.radians(degrees)
    right = (150 * math.cos(angle), 150 * math.sin(angle), 0)
    assert_near(moved_by(simulate(pushed_flat(degrees, speed)))[0], right, 0.5, 0.3)


@pytest.mark.parametrize(
    ("degrees", "side", "size", "turn", "table"),
    [
        (-10, 0.25, (0.1, 0.08), 0.0, {}),
        (13, 0.25, (0.1, 0.08), 0.0, {}),
        (25, 0.5, (0.06, 0.1), 0.0, {}),
        (5, 0.1, (0.05, 0.2), 0.0, {"friction": 0.1}),
        (10, 0.25, (0.2, 0.1), 2.0, {"friction": 1.0}),
        (10, 0.25, (0.02, 0.02), 0.4, {}),
    ],
)
def test_other_flat_faces_stick(degrees: float, side: float, size, turn: float, table: dict) -> None:
    scene = pushed_flat(degrees, 0.1, side, size, **table).moved(np.array([0.2, -0.1, turn]))
    angle = math.radians(degrees) + turn
    assert_near(moved_by(simulate(scene))[0], (150 * math.cos(angle), 150 * math.sin(angle), 0), 0.5, 0.3)


@pytest.mark.parametrize(("degrees", "side"), [(20, 0.25), (-20, 0.25), (15, 0.1), (10, 0.0)])
def test_a_flat_face_beyond_the_friction_cone_slips_along_its_edge(degrees: float, side: float) -> None:
    angle = math.radians(degrees)
    forward = 150 * math.cos(angle)
    right = (forward, math.copysign(side, degrees) * forward, 0)
    assert_near(moved_by(simulate(pushed_flat(degrees, 0.02, side)))[0], right, 0.5, 0.3)


@pytest.mark.parametrize("x", [-0.291, -0.2, -0.1234, -0.04, -0.0075])
def test_a_plate_of_5_mm_stays_before_a_flat_tool(x: float) -> None:
    plate = body("plate", 0, 0, Cuboid(size=(0.005, 0.06)), mass=0.1)
    scene = Scene(bodies=(plate,), tool=flat_tool(0.01, 0.12), pushes=(Push(start=(x, 0), end=(0.1, 0)),), table=LARGE)
    assert_near(moved_by(simulate(scene))[0], (107.5, 0, 0), 0.5, 0.3)


@pytest.mark.parametrize("start", [-0.2, -0.1507, -0.05])
@pytest.mark.parametrize(("speed", "turn"), [(0.5, 0.0), (0.5, 0.7), (1.0, 0.0), (2.0, -2.0)])
def test_a_plate_of_3_mm_is_not_passed_at_any_speed(start: float, speed: float, turn: float) -> None:
    plate = body("plate", 0, 0, Cuboid(size=(0.003, 0.06)), mass=0.1)
    push = Push(start=(start, 0), end=(0.5, 0), speed=speed)
    scene = Scene(bodies=(plate,), tool=flat_tool(0.01, 0.12), pushes=(push,), table=LARGE).moved(
        np.array([0, 0, turn])
    )
    right = 506.5 * np.array([math.cos(turn), math.sin(turn)])
    assert_near(moved_by(simulate(scene))[0], (*right, 0), 1.5, 0.3)


@pytest.mark.parametrize("shape", [Cuboid(size=(0.1, 0.1)), Cylinder(diameter=0.1), Cuboid(size=(0.1, 0.03))])
@pytest.mark.parametrize("turn", [0.0, 0.9])
def test_a_push_that_starts_in_touch_through_the_centre_turns_nothing(shape, turn: float) -> None:
    scene = Scene(
        bodies=(body("a", 0, 0, shape),), tool=Tool.round(0.02), pushes=(Push(start=(-0.06, 0), end=(0.04, 0)),)
    )
    right = (100 * math.cos(turn), 100 * math.sin(turn), 0)
    assert_near(moved_by(simulate(scene.moved(np.array([0.1, 0, turn]))))[0], right, 0.5, 0.3)


# Off-centre: uniform pressure ------------------------------------------------------------------------------------


def pushed_disc(diameter: float = 0.1, y: float = 0.02, speed: float = 0.03) -> Scene:
    disc = body("disc", 0, 0, Cylinder(diameter=diameter))
    push = Push(start=(-0.07, y), end=(0.05, y), speed=speed)
    return Scene(bodies=(disc,), tool=Tool.round(0.02), pushes=(push,))


def test_a_disc_pushed_off_centre_moves_as_uniform_pressure_says() -> None:
    assert_near(moved_by(simulate(pushed_disc()))[0], (68.7, -37.0, -51.3), 2, 2)


@pytest.mark.parametrize(("diameter", "y"), [(0.1, 0.035), (0.1, -0.01), (0.06, 0.015), (0.12, 0.03)])
def test_discs_pushed_elsewhere_move_as_the_reference_says(diameter: float, y: float) -> None:
    scene = pushed_disc(diameter, y)
    ((right,),) = reference_ends([scene])
    assert_near(moved_by(simulate(scene))[0], right * [1e3, 1e3, 180 / math.pi], 2, 2)


def pushed_bar(cells: int = 1, copies: int = 1) -> Scene:
    """A bar of 200 x 20 mm and 5 kg pushed at its end, as cells side by side, or as copies in one place."""
    x = (np.arange(cells) + 0.5) / cells * 0.2 - 0.1
    shape = Cuboid(size=(0.2 / cells, 0.02))
    bodies = tuple(
        body(f"c{k} {copy}", x[k], 0, shape, mass=5 / cells / copies) for k in range(cells) for copy in range(copies)
    )
    groups = (tuple(b.name for b in bodies),) if len(bodies) > 1 else ()
    push = Push(start=(0.09, -0.06), end=(0.09, 0.06), speed=0.05)
    return Scene(bodies=bodies, rigid_groups=groups, tool=Tool.round(0.06), pushes=(push,))


@pytest.mark.parametrize("cells", [1, 10])
def test_a_bar_is_one_cuboid_or_ten_cells(cells: int) -> None:
    scene = pushed_bar(cells)
    end, start = (piece_pose(scene, poses[1:]) for poses in simulate(scene).poses[[-1, 0]])
    assert_near((end - start) * [1e3, 1e3, 180 / math.pi], (-8.5, 30.0, 39.8), 1.5, 1.5)


@pytest.mark.parametrize(("cells", "copies"), [(2, 1), (7, 1), (1, 2), (2, 3)])
def test_cells_and_copies_of_a_bar_move_as_the_bar(cells: int, copies: int) -> None:
    scene = pushed_bar(cells, copies)
    end, start = (piece_pose(scene, poses[1:]) for poses in simulate(scene).poses[[-1, 0]])
    whole = moved_by(simulate(pushed_bar()))[0]
    assert_near((end - start) * [1e3, 1e3, 180 / math.pi], whole, 0.5, 0.5)


def pushed_tee(push: Push) -> Scene:
    bar, stem = (
        body("bar", 0, 0.015, Cuboid(size=(0.12, 0.03)), mass=0.4),
        body("stem", 0, 0.075, Cuboid(size=(0.03, 0.09)), mass=0.3),
    )
    return Scene(bodies=(bar, stem), rigid_groups=(("bar", "stem"),), tool=Tool.round(0.03), pushes=(push,))


@pytest.mark.parametrize(
    "push",
    [
        Push(start=(0.04, 0.11), end=(-0.06, 0.11), speed=0.05),
        Push(start=(-0.04, 0.11), end=(0.06, 0.11), speed=0.02),
        Push(start=(0.05, -0.03), end=(0.05, 0.07), speed=0.05),
        Push(start=(0.0, 0.15), end=(0.005, 0.06), speed=0.1),
    ],
)
def test_a_tee_moves_as_the_reference_says(push: Push) -> None:
    scene = pushed_tee(push)
    track, (right,) = simulate(scene), reference_ends([scene])
    for node, body_right in enumerate(right, start=1):
        error = (track.poses[-1, node] - body_right) * [1e3, 1e3, 180 / math.pi]
        assert_near(error, (0, 0, 0), 2.5, 2.5)


ELL = ((0, 0), (0.12, 0), (0.12, 0.04), (0.04, 0.04), (0.04, 0.1), (0, 0.1))
"""An L of 0.0072 m^2: 0.12 x 0.04 m and 0.04 x 0.06 m."""


def ell_of_cuboids() -> tuple[Body, ...]:
    return (
        body("foot", 0.06, 0.02, Cuboid(size=(0.12, 0.04)), mass=0.48),
        body("leg", 0.02, 0.07, Cuboid(size=(0.04, 0.06)), mass=0.24),
    )


def ell_of_overlapping_cuboids() -> tuple[Body, ...]:
    """Where both cover a point, each counts half: so loaded that the union is as heavy everywhere."""
    return (
        body("foot", 0.06, 0.02, Cuboid(size=(0.12, 0.04)), mass=0.1 * (48 - 8)),
        body("leg", 0.02, 0.05, Cuboid(size=(0.04, 0.1)), mass=0.1 * (40 - 8)),
    )


@pytest.mark.parametrize(
    "bodies",
    [
        ell_of_cuboids(),
        ell_of_overlapping_cuboids(),
        (body("a", 0, 0, Polygon(points=ELL), mass=0.72),),
        (body("a", 0, 0, Polygon(points=ELL[::-1]), mass=0.72),),
        (body("a", 0, 0, Polygon(points=ELL[3:] + ELL[:3]), mass=0.72),),
        (
            body("a", 0.1, 0.2, Polygon(points=tuple((x - 0.1, y - 0.2) for x, y in ELL)), mass=0.36),
            body("b", 0, 0, Polygon(points=ELL), mass=0.36),
        ),
    ],
    ids=["cuboids", "overlapping cuboids", "polygon", "other winding", "other first point", "copies"],
)
@pytest.mark.parametrize(
    "push",
    [
        Push(start=(0.02, -0.03), end=(0.02, 0.07), speed=0.05),
        Push(start=(0.1, 0.08), end=(0.06, 0.0), speed=0.05),
        Push(start=(-0.03, 0.09), end=(0.07, 0.09), speed=0.05),
    ],
    ids=["below", "within the corner", "at the leg"],
)
def test_an_ell_is_the_same_however_it_is_described(bodies: tuple[Body, ...], push: Push) -> None:
    def end_of_its_frame(bodies: tuple[Body, ...]) -> np.ndarray:
        groups = (tuple(b.name for b in bodies),) if len(bodies) > 1 else ()
        scene = Scene(bodies=bodies, rigid_groups=groups, tool=Tool.round(0.02), pushes=(push,))
        first = np.array(bodies[0].pose_world_from_body)
        return compose(simulate(scene).poses[-1, 1], relative(first, np.zeros(3))) * [1e3, 1e3, 180 / math.pi]

    assert_near(end_of_its_frame(bodies), end_of_its_frame(ell_of_cuboids()), 0.5, 0.5)


def test_a_cross_of_overlapping_cuboids_is_its_outline() -> None:
    crossing = (body("a", 0, 0, Cuboid(size=(0.12, 0.04))), body("b", 0, 0, Cuboid(size=(0.04, 0.12))))
    inner, outer = 0.02, 0.06
    corner = [(outer, -inner), (outer, inner), (inner, inner)]
    turned = [[(x, y), (-y, x), (-x, -y), (y, -x)] for x, y in corner]
    outline = Polygon(points=tuple(turned[k][quarter] for quarter in range(4) for k in range(3)))
    pushes = (Push(start=(-0.09, 0.005), end=(0, 0.005), speed=0.05),)
    one = Scene(bodies=(body("a", 0, 0, outline, mass=1.0),), tool=Tool.round(0.02), pushes=pushes)
    two = Scene(bodies=crossing, rigid_groups=(("a", "b"),), tool=Tool.round(0.02), pushes=pushes)
    assert_near(moved_by(simulate(one))[0], moved_by(simulate(two))[0], 0.3, 0.3)


def ellipse(corners: int, long: float = 0.06, short: float = 0.03) -> Polygon:
    angle = 2 * math.pi * np.arange(corners) / corners
    return Polygon(points=tuple(zip((long * np.cos(angle)).tolist(), (short * np.sin(angle)).tolist(), strict=True)))


def test_an_ellipse_rolls_the_same_over_its_corners_however_many_there_are() -> None:
    def moved(corners: int) -> np.ndarray:
        pushes = (Push(start=(0.045, -0.055), end=(0.045, 0.05), speed=0.05),)
        return moved_by(
            simulate(Scene(bodies=(body("a", 0, 0, ellipse(corners)),), tool=Tool.round(0.04), pushes=pushes))
        )[0]

    assert abs(moved(120)[2]) > 30
    for corners in (48, 80):
        assert_near(moved(corners), moved(120), 1.0, 1.5)


@pytest.mark.parametrize("y", [0.02, -0.035])
def test_a_round_polygon_is_a_cylinder(y: float) -> None:
    scene = pushed_disc(y=y)
    polygon = scene.replace(bodies=(body("disc", 0, 0, ellipse(90, 0.05, 0.05)),))
    assert_near(moved_by(simulate(polygon))[0], moved_by(simulate(scene))[0], 0.7, 1.0)


@pytest.mark.parametrize("count", [3, 4, 6])
def test_a_body_on_feet_moves_as_the_reference_says_of_discs_of_2_mm_there(count: int) -> None:
    angle = 2 * math.pi * np.arange(count) / count + 0.2
    at = list(zip((0.045 * np.cos(angle)).tolist(), (0.045 * np.sin(angle)).tolist(), strict=True))
    scene = pushed_disc(y=0.03)
    on_feet = scene.replace(bodies=(scene.bodies[0].replace(support=at),))
    discs = [body(f"f{k}", *place, Cylinder(diameter=0.002), mass=0.5 / count) for k, place in enumerate(at)]
    # The hull carries next to nothing, so that the discs bear the weight.
    hull = scene.bodies[0].replace(mass=0.001)
    of_discs = scene.replace(bodies=(hull, *discs), rigid_groups=((hull.name, *(d.name for d in discs)),))
    (right,) = reference_ends([of_discs])
    assert_near(moved_by(simulate(on_feet))[0], right[0] * [1e3, 1e3, 180 / math.pi], 0.5, 0.5)


# Rows ------------------------------------------------------------------------------------------------------------


def row(count: int, shape, gap: float = 0.5e-3, mass: float = 0.2, speed: float = 0.1) -> Scene:
    bodies = tuple(body(f"b{k}", 0.036 + k * (0.05 + gap), 0, shape, mass=mass) for k in range(count))
    push = Push(start=(0, 0), end=(0.1, 0), speed=speed)
    return Scene(bodies=bodies, tool=flat_tool(0.02, 0.1), pushes=(push,), table=LARGE)


@pytest.mark.parametrize(
    ("count", "shape", "gap", "mass", "speed", "turn"),
    [
        (6, Cuboid(size=(0.05, 0.05)), 0.5e-3, 0.2, 0.1, 0.0),
        (15, Cuboid(size=(0.05, 0.05)), 0.5e-3, 0.2, 0.1, 0.0),
        (15, Cuboid(size=(0.05, 0.05)), 0.5e-3, 5.0, 0.02, 0.0),
        (10, Cuboid(size=(0.05, 0.09)), 0.0, 1.0, 0.2, 0.3),
        (6, Cylinder(diameter=0.05), 0.5e-3, 0.2, 0.1, 0.0),
        (15, Cylinder(diameter=0.05), 0.5e-3, 0.2, 0.02, 0.0),
    ],
)
def test_each_body_of_a_row_moves_by_the_stroke_less_the_gaps_before_it(
    count: int, shape, gap: float, mass: float, speed: float, turn: float
) -> None:
    scene = row(count, shape, gap, mass, speed).moved(np.array([0, 0, turn]))
    track = simulate(scene)
    for k, moved in enumerate(moved_by(track)):
        right = 99 - 1e3 * gap * k
        assert_near(moved, (right * math.cos(turn), right * math.sin(turn), 0), 0.5, 0.5)
    assert overlap(track) <= 0.5e-3


# Table friction --------------------------------------------------------------------------------------------------


def test_a_slow_push_does_not_depend_on_table_friction() -> None:
    def moved(friction: float) -> np.ndarray:
        push = Push(start=(-0.1, 0.01), end=(0.1, 0.01), speed=0.02)
        box = body("a", 0, 0, Cuboid(size=(0.1, 0.1)))
        table = LARGE.replace(friction=friction)
        return moved_by(simulate(Scene(bodies=(box,), tool=Tool.round(0.05), pushes=(push,), table=table)))[0]

    assert abs(moved(1.0)[2]) > 5
    for friction in (0.1, 0.45, 2.0):
        assert_near(moved(friction), moved(1.0), 0.5, 0.5)


def pushed_puck(friction: float, rest: float) -> Scene:
    push = Push(start=(-0.1, 0), end=(0.2, 0), speed=0.5, rest=rest)
    puck = body("puck", 0, 0, Cylinder(diameter=0.06), mass=0.3)
    return Scene(bodies=(puck,), tool=flat_tool(0.02, 0.08), pushes=(push,), table=LARGE.replace(friction=friction))


@pytest.mark.parametrize(("friction", "right"), [(0.05, 115 + 254.84), (0.08, 115 + 159.28), (0.2, 240), (2.0, 240)])
def test_a_puck_leaves_a_tool_that_brakes_at_1_m_s2_and_slides_by_coulomb_s_law(friction, right) -> None:
    # The tool brakes over the last 125 mm; friction above 1 m/s^2 keeps the puck at the tool.
    track = simulate(pushed_puck(friction, rest=1.5))
    assert_near(moved_by(track)[0], (right, 0, 0), 3, 0.5)
    assert remarks(track) == []


def test_a_puck_that_still_slides_where_the_track_ends_is_remarked() -> None:
    track = simulate(pushed_puck(0.05, rest=0.2))
    assert track.poses[-1, 1, 0] < 0.36
    (said,) = remarks(track)
    assert said.startswith("'puck' still moves when the track ends, at 1")
    assert "longer rest" in said
    assert remarks(simulate(pushed_puck(2.0, rest=0.2))) == []


@pytest.mark.parametrize("friction", [0.05, 0.45, 2.0])
@pytest.mark.parametrize("shape", [Cylinder(diameter=0.06), Cuboid(size=(0.06, 0.12))])
def test_what_a_tool_lets_go_at_once_slides_by_coulomb_s_law(friction: float, shape) -> None:
    speed = 0.4
    push = Push(start=(-0.1, 0), path=[(0.2, 0)], times=[0.3 / speed], rest=2.0)
    scene = Scene(
        bodies=(body("puck", 0, 0, shape),),
        tool=flat_tool(0.02, 0.08),
        pushes=(push,),
        table=LARGE.replace(friction=friction),
    )
    slid = 1e3 * speed**2 / (2 * friction * GRAVITY)
    assert moved_by(simulate(scene))[0, 0] == pytest.approx(240 + slid, abs=max(1.5, 0.01 * slid))


# Where a scene stands, and how it is written ---------------------------------------------------------------------


def crowd(polygon: bool = False) -> Scene:
    """Different bodies, pushed so that some of them touch."""
    ell = (
        (body("ell", 0.05, -0.16, Polygon(points=ELL), yaw=0.3, mass=0.5),)
        if polygon
        else (
            body("foot", 0.11, -0.12, Cuboid(size=(0.12, 0.04)), mass=0.48),
            body("leg", 0.07, -0.17, Cuboid(size=(0.04, 0.06)), mass=0.24),
        )
    )
    bodies = (
        body("crate", 0, 0, Cuboid(size=(0.12, 0.08)), mass=1.0),
        body("can", 0.13, 0.03, mass=0.3),
        *ell,
    )
    groups = () if polygon else (("foot", "leg"),)
    push = Push(start=(-0.103, 0.02), path=[(0.02, 0.02), (0.05, -0.08)], speed=0.1)
    return Scene(bodies=bodies, rigid_groups=groups, tool=Tool.round(0.02), pushes=(push,), table=LARGE)


def one_ell() -> Scene:
    ell = body("ell", 0, 0, Polygon(points=ELL), mass=0.5)
    return Scene(bodies=(ell,), tool=Tool.round(0.02), pushes=(Push(start=(0.02, -0.03), end=(0.02, 0.07)),))


def one_crate() -> Scene:
    push = Push(start=(-0.1, 0.02), end=(0.1, 0.02), speed=0.1)
    crate = body("crate", 0, 0, Cuboid(size=(0.12, 0.08)), mass=1.0)
    return Scene(bodies=(crate,), tool=Tool.round(0.02), pushes=(push,), table=LARGE)


MOTIONS = [(0.0, 0.0, math.pi / 2), (0.3, -0.7, 0.1), (-1.0, 0.2, 1.234), (5.0, 5.0, -2.5), (0.0, 0.01, math.pi)]


@pytest.mark.parametrize("scene", [one_crate(), crowd(), crowd(polygon=True)], ids=["crate", "crowd", "with polygon"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_scene_that_is_turned_and_shifted_moves_the_same_in_its_own_frame(scene: Scene, motion) -> None:
    here, there = simulate(scene).poses, simulate(scene.moved(motion)).poses
    assert np.hypot(*(compose(np.array(motion), here) - there)[..., :2].reshape(-1, 2).T).max() <= 0.3e-3
    assert np.abs((here - there)[:, 1:, 2] + motion[2]).max() <= math.radians(0.3)


@pytest.mark.parametrize(
    "scene",
    [one_crate(), crowd(), pushed_disc(), pushed_bar(10), pushed_tee(Push(start=(0.04, 0.11), end=(-0.06, 0.11)))],
    ids=["crate", "crowd", "disc", "bar", "tee"],
)
def test_mirror_images_have_mirrored_answers(scene: Scene) -> None:
    here, there = simulate(scene).poses, simulate(mirrored(scene)).poses
    assert np.abs(here * [1, -1, -1] - there)[..., :2].max() <= 0.01e-3
    assert np.abs(here * [1, -1, -1] - there)[..., 2].max() <= math.radians(0.01)


def test_a_mirrored_polygon_has_a_mirrored_answer() -> None:
    """Less exactly: the points that stand for its pressure are found by cutting it, which knows left and right."""
    here, there = simulate(one_ell()).poses, simulate(mirrored(one_ell())).poses
    assert np.abs(here * [1, -1, -1] - there)[..., :2].max() <= 0.1e-3


@pytest.mark.parametrize("scene", [crowd(polygon=True), row(6, Cuboid(size=(0.05, 0.05)))], ids=["crowd", "row"])
def test_the_order_of_bodies_hardly_matters(scene: Scene) -> None:
    renamed = tuple(b.replace(name=f"{k} {b.name}") for k, b in enumerate(scene.bodies[::-1]))
    shuffled = scene.replace(bodies=renamed)
    here, there = simulate(scene).poses[-1, 1:], simulate(shuffled).poses[-1, :0:-1]
    assert np.abs(here - there)[:, :2].max() <= 0.3e-3


def test_what_is_too_far_to_be_touched_changes_nothing() -> None:
    alone = one_crate()
    far = alone.replace(bodies=(*alone.bodies, body("far", 1, 1), body("other", -1, 1, Cuboid(size=(0.1, 0.1)))))
    assert np.abs(simulate(far).poses[:, :2] - simulate(alone).poses).max() <= 0.01e-3
    assert np.ptp(simulate(far).poses[:, 2:], axis=0).max() <= 1e-9


# What is said ----------------------------------------------------------------------------------------------------


def test_a_box_that_leaves_the_table_is_remarked() -> None:
    box = body("a", 0, 0, Cuboid(size=(0.1, 0.1)))
    pushes = (Push(start=(-0.08, 0), end=(0.4, 0)),)
    track = simulate(Scene(bodies=(box,), tool=Tool.round(0.02), pushes=pushes, table=Table(size=(0.3, 0.3))))
    assert [said for said in remarks(track) if "'a' leaves the table at 1." in said]
    assert remarks(simulate(track.scene.replace(table=LARGE))) == []


def test_a_second_push_that_comes_down_in_a_moved_body_is_refused() -> None:
    box = body("a", 0, 0, Cuboid(size=(0.1, 0.1)))
    pushes = (Push(start=(-0.08, 0), end=(0, 0), speed=0.1), Push(start=(0.07, 0), end=(0.1, 0.05)))
    with pytest.raises(SimulationError, match=r"pushes\[1\].start: the tool would come down on body 'a', \d"):
        simulate(Scene(bodies=(box,), tool=Tool.round(0.02), pushes=pushes))


# Paths and forces ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("limit", [None, 50.0])
@pytest.mark.parametrize("times", [None, (1.0, 1.5, 3.0)])
def test_the_tool_reaches_every_way_point(times, limit: float | None) -> None:
    path = [(0.02, 0.02), (0.05, -0.05, 0.8), (-0.05, -0.1, 0.8)]
    push = Push(start=(-0.1, 0.02), path=path, times=times, speed=0.1, force_limit=limit)
    track = simulate(one_crate().replace(pushes=(push,)))
    for x, y, _ in push.waypoints:
        away = np.hypot(*(track.poses[:, 0, :2] - [x, y]).T)
        assert away.min() < (0.1 * 0.05 / 2 + 1e-3 if times is None else 1e-3)
    assert track.poses[-1, 0] == pytest.approx(push.waypoints[-1], abs=1e-3)
    if times:
        frames = [round(time / 0.05) for time in times]
        assert track.poses[frames, 0] == pytest.approx(push.waypoints[1:], abs=1e-3)


@pytest.mark.parametrize("scene", [one_crate(), pushed_disc(), pushed_flat(10, 0.1)], ids=["crate", "disc", "flat"])
def test_a_force_limit_that_is_not_reached_changes_nothing(scene: Scene) -> None:
    limited = scene.replace(pushes=(scene.pushes[0].replace(force_limit=20.0),))
    with_limit, without = simulate(limited), simulate(scene)
    assert np.abs(with_limit.poses - without.poses)[..., :2].max() <= 0.1e-3
    assert remarks(with_limit) == []


@pytest.mark.parametrize("limit", [None, 100.0])
@pytest.mark.parametrize(
    ("shape", "mass", "friction", "turn"),
    [
        (Cuboid(size=(0.1, 0.08)), 0.5, 0.45, 0.0),
        (Cuboid(size=(0.1, 0.08)), 8.0, 0.2, 2.0),
        (Cylinder(diameter=0.1), 0.5, 0.45, -0.7),
        (Polygon(points=((-0.05, -0.04), (0.05, -0.04), (0.05, 0.04), (-0.05, 0.04))), 0.02, 1.0, 0.3),
    ],
)
def test_the_wrench_of_a_steady_push_is_the_body_s_friction(
    shape, mass: float, friction: float, turn: float, limit: float | None
) -> None:
    push = Push(start=(-0.1, 0), end=(0.1, 0), speed=0.05, force_limit=limit)
    table = LARGE.replace(friction=friction)
    scene = Scene(bodies=(body("a", 0, 0, shape, mass=mass),), tool=flat_tool(0.02, 0.08), pushes=(push,), table=table)
    track = simulate(scene.moved(np.array([0, 0, turn])))
    force = friction * mass * GRAVITY
    steady = (track.times > 1.5) & (track.times < 3.5)
    right = -force * np.array([math.cos(turn), math.sin(turn)])
    assert np.abs(track.wrench[steady, :2] - right).max() <= 0.02 * force
    assert np.abs(track.wrench[steady, 2]).max() <= 0.02 * force * 0.04
    assert np.abs(track.wrench[track.times < 0.7]).max() <= 1e-6 * force


def test_the_wrench_is_zero_where_nothing_is_touched_and_while_lifted() -> None:
    free = one_crate().replace(pushes=(Push(start=(-0.1, 0.2), end=(0.1, 0.2)), Push(start=(-0.1, 0), end=(0, 0))))
    track = simulate(free)
    assert np.abs(track.wrench[~track.down | (track.push == 0)]).max() <= 1e-6
    assert np.abs(track.wrench[track.push == 1]).max() > 1


def test_the_moment_on_a_tool_is_its_lever_times_the_force() -> None:
    tool = Tool(parts=(Part(shape=Cuboid(size=(0.02, 0.08)), pose_tool_from_part=(0.0, 0.1, 0.0)),))
    box = body("a", 0.065, 0.1, Cuboid(size=(0.1, 0.08)))
    track = simulate(Scene(bodies=(box,), tool=tool, pushes=(Push(start=(0, 0), end=(0.15, 0), speed=0.05),)))
    steady = (track.times > 1.0) & (track.times < 2.5)
    force = 0.45 * 0.5 * GRAVITY
    assert track.wrench[steady, 0] == pytest.approx(-force, rel=0.02)
    assert track.wrench[steady, 2] == pytest.approx(0.1 * force, rel=0.02)
