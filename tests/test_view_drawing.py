"""What the browser viewer draws: geometry worked out by hand, and laws of what is sent."""

import base64
import dataclasses
import itertools
import re
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import shapely
from scenes import body, workshop

pytest.importorskip("viser", reason="the extra [viewer] is not installed")

import msgspec
import viser
import zstandard

from pushgraph import pose, pose_3d
from pushgraph.arm import Arm
from pushgraph.belief_history import BeliefHistory
from pushgraph.body import Joint
from pushgraph.forces import ContactForces
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.mass_history import MassHistory
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder, Polygon
from pushgraph.spread import Spread
from pushgraph.tool import Push
from pushgraph.track import Track
from pushgraph.view.drawing import SceneDrawing
from pushgraph.view.drawing.beliefs import rods
from pushgraph.view.drawing.colours import BODIES, GRID, JOINTS
from pushgraph.view.drawing.contact_arrows import opposite_arrows
from pushgraph.view.drawing.forces import LONGEST
from pushgraph.view.drawing.forms import RIM, form_of
from pushgraph.view.drawing.instances import _linear
from pushgraph.view.drawing.joints import ARM, drawn_joint
from pushgraph.view.drawing.names import GAP, PADDING, WIDTH, View, heights_of
from pushgraph.view.drawing.placing import LIFT, frame_at
from pushgraph.view.drawing.scene_drawing import MOST_SHADOWS
from pushgraph.view.drawing.solids import Solid, circle, outline_of, prism
from pushgraph.view.drawing.spread import PROBABILITIES, regions
from pushgraph.view.drawing.table import _from_above
from pushgraph.view.drawing.trails import BREADTH, strips, thinned
from pushgraph.view.known_forces import KnownForces
from pushgraph.view.legend import facts, legend
from pushgraph.view.saved_page import save_page
from pushgraph.view.server import start_server
from pushgraph.view.timeline import SPEEDS, Timeline

L_SHAPE = ((0.0, 0.0), (0.2, 0.0), (0.2, 0.05), (0.05, 0.05), (0.05, 0.3), (0.0, 0.3))


def volume(solid: Solid) -> float:
    """Signed: positive if every face looks outwards (divergence theorem)."""
    a, b, c = solid.vertices[solid.faces].swapaxes(0, 1)
    return float((a * np.cross(b, c)).sum() / 6)


def track_of(scene: Scene, frames: int = 12, spread: bool = False) -> Track:
    """The first body goes 1 cm along x in every frame, the tool comes down in the third; nothing else moves."""
    poses = np.tile(np.vstack((np.zeros(3), scene.poses_world_from_body)), (frames, 1, 1))
    poses[:, 1, 0] += 0.01 * np.arange(frames)
    push = np.where(np.arange(frames) < 2, -1, 0)
    seen = np.ones(poses.shape[:2], dtype=bool)
    seen[5, 1] = False
    shape = frames, len(scene.bodies)
    stated = Spread(*(np.full(shape, value) for value in (0.5, 0.01, 0.004, 5.0, 1.0, 0.05, 5.0))) if spread else None
    return Track(scene, np.arange(frames) * 0.05, poses, push, seen, spread=stated)


@pytest.fixture(scope="module")
def server():
    started = start_server()
    yield started
    started.stop()


@pytest.fixture
def drawing(server):
    drawn = SceneDrawing(server)
    yield drawn
    drawn.clear()


def sent(server) -> list:
    """What a browser that opens the page now is told, and what it is told for good."""
    return list(server._websock_server._broadcast_buffer.message_from_id.values())


@pytest.mark.parametrize("outline", [np.array(L_SHAPE), circle(0.1), np.array([[0, 0], [1, 0], [0, 1.0]])])
def test_a_prism_is_closed_and_its_faces_look_outwards(outline: np.ndarray) -> None:
    x, y = outline.T
    area = 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    solid = prism(outline, 0.1, 0.3)
    assert volume(solid) == pytest.approx(0.2 * area)
    corners = np.round(solid.vertices[solid.faces], 9)
    edges = [tuple(map(tuple, (f[i], f[(i + 1) % 3]))) for f in corners.tolist() for i in range(3)]
    assert sorted(edges) == sorted((b, a) for a, b in edges)  # each is shared by two faces, once either way


SHAPES = (Cuboid(size=(0.06, 0.03)), Cylinder(diameter=0.08), Polygon(points=L_SHAPE))


@pytest.mark.parametrize("shape", SHAPES)
def test_a_form_has_the_size_of_its_body_and_a_rim_all_around(shape) -> None:
    form = form_of(shape)
    sized = [s._replace(vertices=s.vertices * size) for s, size in ((form.solid, form.size), (form.rim, form.rim_size))]
    area = shapely.Polygon(outline_of(shape)).area
    assert volume(sized[0]) == pytest.approx(area * shape.height)
    upper = [s.vertices[s.vertices[:, 2] > 0] for s in sized]
    assert upper[1][:, 2] == pytest.approx(shape.height + RIM)
    inner, outer = (shapely.Polygon(p[: len(outline_of(shape))]) for p in upper)
    assert outer.contains(inner)
    assert volume(sized[1]) > volume(sized[0])


def test_one_call_draws_all_bodies_of_a_kind(server, drawing: SceneDrawing) -> None:
    shapes = (*SHAPES, Cuboid(size=(0.05, 0.05)), Cylinder(diameter=0.05), Polygon(points=L_SHAPE))
    scene = Scene(bodies=tuple(body(f"b{k}", 0.3 * k - 0.75, 0.0, shape) for k, shape in enumerate(shapes)))
    drawing.show_scene(scene)
    assert sorted(grip.names for grip in drawing.grips) == [("b0", "b3"), ("b1", "b4"), ("b2", "b5")]
    for grip in drawing.grips:
        places = [scene.poses_world_from_body[scene.names.index(name), :2] for name in grip.names]
        np.testing.assert_allclose(grip.handle.batched_positions[:, :2], places, atol=1e-6)


def test_a_body_may_be_called_as_parts_of_the_drawing_are(server, drawing: SceneDrawing) -> None:
    names = ("solids_0", "rims_0", "fronts")
    drawing.show_scene(Scene(bodies=tuple(body(name, 0.3 * k, 0.0) for k, name in enumerate(names))))
    assert [grip.names for grip in drawing.grips] == [names]
    for name in names:
        assert isinstance(server.scene.get_handle_by_name(f"/view/bodies/{name}"), viser.FrameHandle)


def test_the_table_is_an_image_where_bodies_are_too_many_for_shadows(server, drawing: SceneDrawing) -> None:
    drawing.show_scene(workshop())
    assert server.scene.get_handle_by_name("/view/table/top/image") is None
    places = [(0.15 * (k % 5) - 0.3, 0.15 * (k // 5) - 0.3) for k in range(MOST_SHADOWS + 1)]
    drawing.show_scene(Scene(bodies=tuple(body(f"b{k}", *place) for k, place in enumerate(places))))
    assert server.scene.get_handle_by_name("/view/table/top/solid") is None
    assert server.scene.get_handle_by_name("/view/table/top/image") is not None
    assert not any(grip.handle.cast_shadow for grip in drawing.grips)
    image = _from_above(Table(size=(0.6, 0.4)))
    assert image.shape == (200, 300, 3)
    lines = (image == GRID).all(-1)
    assert lines.all(0).sum() == 7  # across x, every 10 cm from rim to rim
    assert lines.all(1).sum() == 5


def test_instances_have_the_colours_of_screens() -> None:
    grey = _linear([(0, 0, 0), (188, 188, 188), (255, 255, 255)])[:, 0].tolist()
    assert grey == [0, pytest.approx(128, abs=2), 255]  # half the light is 188 of 255 in sRGB


def test_strips_lie_along_the_legs_of_a_trail() -> None:
    legs = np.random.default_rng(0).normal(size=(20, 2, 3))
    legs[:2] = [[[0, 0, 0], [-1, 0, 0]], [[0, 0, 0], [0, 0, 2]]]
    solid = strips(legs)
    for (begin, end), corners in zip(legs, solid.vertices.reshape(20, 4, 3), strict=True):
        np.testing.assert_allclose((corners[0] + corners[3]) / 2, begin, atol=1e-12)
        np.testing.assert_allclose((corners[1] + corners[2]) / 2, end, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(corners[3] - corners[0]), BREADTH)
        assert (corners[3] - corners[0]) @ (end - begin) == pytest.approx(0, abs=1e-12)


def test_names_do_not_hide_each_other_at_first_sight() -> None:
    rng = np.random.default_rng(3)
    view = View((0.0, 0.0, 0.0), (0.0, -1.0, 1.0), 0.03)
    places = np.column_stack((rng.uniform(-0.3, 0.3, (30, 2)), np.full(30, 0.1)))
    lengths = rng.integers(2, 9, 30)
    places[:, 2] += heights_of(places, lengths.tolist(), view)
    up = np.array([0.0, 1.0, 1.0]) / np.sqrt(2)
    x, y = places[:, 0], places @ up
    half = (WIDTH * lengths + 2 * PADDING) * 0.03 / 2
    for i, j in itertools.combinations(range(30), 2):
        assert abs(x[i] - x[j]) >= half[i] + half[j] - 1e-9 or abs(y[i] - y[j]) >= 0.03 * (1 + PADDING) - 1e-9


def test_names_keep_clear_of_each_other_as_bodies_move_and_the_camera_turns(server, drawing: SceneDrawing) -> None:
    scene = Scene(bodies=(body("left", -0.5, 0.0), body("behind", 0.5, 0.0)))
    still = np.zeros((4, 3, 3))
    still[:, 1:] = scene.poses_world_from_body
    still[-1, 2] = [-0.5, 0.02, 0.0]
    shown = Track(scene, np.arange(4) * 0.5, still, np.full(4, -1), np.ones((4, 3), dtype=bool))
    drawing.show_track(shown)

    def heights() -> list[float]:
        labels = (server.scene.get_handle_by_name(f"/view/bodies/{name}/name") for name in scene.names)
        return [round(float(label.position[2]) - 0.1 - GAP, 3) for label in labels]

    assert heights() == [0.0, 0.0]
    drawing.set_frame(3)
    low, high = heights()
    assert low == 0.0
    assert high > 0.0
    assert server.scene.get_handle_by_name("/view/bodies/behind/pole").visible
    drawing.look_from(np.array([-0.5, 1.0, 0.5]), np.array([-0.5, 0.0, 0.0]))
    turned = heights()
    assert turned[0] > 0.0
    assert turned[1] == 0.0
    drawing.look_from(np.array([-0.5, 0.0, 1.0]), np.array([-0.5, 0.0, 0.0]))
    assert heights() == turned
    drawing.set_frame(0)
    assert heights() == [0.0, 0.0]


def test_rods_lead_from_body_to_body() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(2, 20, 3))
    second[0] = first[0] - [0, 0, 0.5]  # straight down
    positions, turns, scales = rods(first, second, np.ones(20))
    tips = positions + pose_3d.rotate(scales * [0, 0, 1], turns)
    np.testing.assert_allclose(positions, first)
    np.testing.assert_allclose(tips, second, atol=1e-12)
    assert (rods(first, second, np.full(20, 0.05))[2] == 0).all()


def test_trails_have_gaps_where_a_body_was_not_seen() -> None:
    way = np.column_stack((np.linspace(0, 1, 101), np.zeros((101, 2))))
    way[40:60] = np.nan
    legs = thinned(way, 0.05)
    lengths = np.linalg.norm(legs[:, 1] - legs[:, 0], axis=-1)
    assert lengths.sum() == pytest.approx(0.39 + 0.40)
    assert lengths.max() < 0.07
    assert not ((legs[:, 0, 0] < 0.39 - 1e-9) & (legs[:, 1, 0] > 0.6 - 1e-9)).any()
    assert len(thinned(np.zeros((9, 3)), 0.05)) == 0


def test_frames_are_found_by_time() -> None:
    times = np.array([0.5, 1.0, 1.5])
    assert [frame_at(times, time) for time in (0.0, 0.5, 0.99, 1.0, 9.0)] == [0, 0, 0, 1, 2]


def test_a_hinge_turned_by_its_limit_points_along_its_limit() -> None:
    scene = workshop().replace(
        joints=(Joint(kind="revolute", parent="plate", child="lid", anchor=(0.06, 0.0525), limits=(-0.5, 1.0)),)
    )
    hinge = drawn_joint(scene, scene.joints[0])
    (sector,) = hinge.limits
    plate, lid = scene.poses_world_from_body[:2]
    for angle, end in ((-0.5, sector[1]), (1.0, sector[-2])):
        about = np.array([*scene.joints[0].anchor, angle])
        turned = pose.compose(about, pose.compose(np.array([-0.06, -0.0525, 0.0]), lid))
        tip = pose.transform(turned, hinge.hand)[1]
        np.testing.assert_allclose(tip, pose.transform(plate, end), atol=1e-9)
        assert np.hypot(*(tip - scene.joints[0].anchor)) == pytest.approx(ARM)


def test_spread_is_drawn_as_it_is_stated() -> None:
    track = track_of(workshop(), spread=True)
    for probability, (places, scales) in zip(PROBABILITIES, regions(track, 7), strict=True):
        ellipse = track.spread.take(7).ellipse(probability)
        np.testing.assert_allclose(scales[:, 0], ellipse.along)
        np.testing.assert_allclose(scales[:, 1], ellipse.across)
        np.testing.assert_allclose(2 * np.arctan2(places[:, 6], places[:, 3]), ellipse.direction)
        np.testing.assert_allclose(places[:, :2], track.poses[7, 1:, :2])
    assert regions(track, 5)[0][1][0].tolist() == [0, 0, 0]  # not seen


def test_a_frame_moves_what_moved_and_sends_nothing_else(server, drawing: SceneDrawing) -> None:
    track = track_of(workshop())
    drawing.show_track(track)
    handle = server.scene.get_handle_by_name("/view/bodies/plate")
    tool = server.scene.get_handle_by_name("/view/tool/frame")
    assert tool.position[2] == pytest.approx(LIFT)
    recording = server.get_scene_serializer()
    before = len(recording._messages)
    drawing.set_frame(4)
    assert handle.position.tolist() == [0.04, 0.0, 0.0]
    assert tool.position[2] == 0.0
    assert {message["name"] for _, message in recording._messages[before:]} == {
        "/view/bodies/plate",
        "/view/tool/frame",
        *(f"/view/bodies/{part}" for part in ("-solids_0", "-rims_0", "-fronts")),
    }
    recording.serialize()
    (grip,) = [grip for grip in drawing.grips if "plate" in grip.names]
    instance = grip.names.index("plate")
    assert grip.handle.batched_positions[instance].tolist() == pytest.approx([0.04, 0.0, 0.0])
    drawing.set_frame(5)
    assert not handle.visible
    assert (grip.handle.batched_scales[instance] == 0).all()
    drawing.set_frame(99)
    assert handle.visible
    assert (grip.handle.batched_scales[instance] > 0).all()
    assert drawing.frame == len(track.times) - 1
    assert drawing.push_times == {1: pytest.approx(0.10)}


def test_what_has_not_changed_is_not_drawn_again(drawing: SceneDrawing) -> None:
    scene = workshop()
    drawing.show_scene(scene)
    solids = list(drawing.grips)
    pushes = drawing._pushes._layer._frame
    drawing.show_scene(scene.replace(pushes=(Push(start=(-0.3, 0.0), end=(0.0, 0.0)),)))
    assert list(drawing.grips) == solids
    assert drawing._pushes._layer._frame is not pushes
    drawing.show_scene(scene.replace(bodies=(*scene.bodies, body("new", -0.5, -0.5))))
    assert any("new" in grip.names for grip in drawing.grips)


def test_nothing_is_left_of_what_was_removed(server) -> None:
    empty = set(server.scene._handle_from_node_name)
    drawing = SceneDrawing(server)
    track = track_of(workshop(), spread=True)
    drawing.show_track(track)
    drawing.show_ghost(track)
    drawing.show_outcome(track)
    drawing.clear()
    left = set(server.scene._handle_from_node_name) - empty
    assert left <= {"/view", "/view/outcome"}


def test_it_plays_at_true_speed_and_steps(server, drawing: SceneDrawing) -> None:
    drawing.show_track(track_of(workshop(), 100))
    timeline = Timeline(server.gui, drawing, threading.RLock())
    for factor in ("1 ×", "4 ×"):
        timeline.refresh()
        drawing.set_frame(0)
        timeline._speed.value = factor
        begun = threading.Event()
        shown: list[tuple[float, float]] = []
        timeline.on_frame = lambda frame, shown=shown, begun=begun: (
            shown.append((time.monotonic(), float(drawing.times[frame]))),
            len(shown) > 8 and begun.set(),
        )
        timeline.play()
        assert begun.wait(20)
        timeline.pause()
        (first, earlier), (last, later) = shown[0], shown[-1]
        assert later - earlier == pytest.approx(SPEEDS[factor] * (last - first), abs=SPEEDS[factor] * 0.15)
    frame = drawing.frame
    timeline.step(3)
    assert drawing.frame == frame + 3
    timeline.step(-1000)
    assert drawing.frame == 0
    timeline.stop()


def test_forces_at_contacts_are_opposite_arrows_over_the_two_bodies(server, drawing: SceneDrawing) -> None:
    track = track_of(workshop())
    one, other = np.full(2, 1), np.array([2, 0])
    forces = ContactForces(np.array([3, 5]), one, other, np.zeros((2, 2)), np.array([[3.0, 0.0], [0.0, 4.0]]), one > 1)
    drawing.show_track(track)
    drawing.show_forces(KnownForces("predicted", forces))
    assert "contact forces (predicted)" in legend(drawing)
    newtons = drawing.contact_forces[1]
    assert newtons == pytest.approx(4.0 * 0.1 / LONGEST)
    first, second = opposite_arrows(forces.at(3), np.array([0.2]), newtons)
    np.testing.assert_allclose(first, [[0.0, 0.0, 0.2], [3.0 * 0.1 / newtons, 0.0, 0.2]])
    np.testing.assert_allclose(second[1], [-3.0 * 0.1 / newtons, 0.0, 0.2])
    for frame in (3, 4, 5):
        drawing.set_frame(frame)
    drawing.show_track(track)
    assert drawing.contact_forces == ("", 0.0)
    assert len(opposite_arrows(forces, np.zeros(2), 1e3)) == 0


def history(scene: Scene, frames: int = 30) -> BeliefHistory:
    """Of one pair that becomes a hinge."""
    shares = np.zeros((frames, 1, len(JOINT_CODES)))
    shares[:, 0, JOINT_CODES["revolute"]] = np.linspace(0, 1, frames)
    shares[:, 0, JOINT_CODES["none"]] = 1 - np.linspace(0, 1, frames)
    return BeliefHistory((("plate", "lid"),), np.arange(frames) * 0.05, shares, {}, [], scene)


def test_links_follow_the_bodies_and_the_board_the_time(server, drawing: SceneDrawing) -> None:
    scene = workshop()
    drawing.show_track(track_of(scene, 30))
    drawing.show_belief(history(scene))
    drawing.set_frame(29)
    rod = server.scene.get_handle_by_name("/view/links/rods")
    assert rod.batched_positions[0, :2] == pytest.approx([0.29, 0.0], abs=1e-3)
    assert rod.batched_scales[0, 2] == pytest.approx(np.hypot(0.29, 0.105), abs=1e-3)
    assert tuple(rod.batched_colors[0]) == JOINTS["revolute"]
    now = server.scene.get_handle_by_name("/view/probabilities/board/now")
    assert now.position[0] == pytest.approx(drawing._board._width, abs=1e-3)


def test_the_facts_tell_a_table_s_grain() -> None:
    scene = workshop()
    table = scene.table.replace(anisotropy=0.2, grain=-0.5)
    assert "20% more along 151 degrees" in facts(scene.replace(table=table))
    assert "grain" not in facts(scene)


def test_the_legend_and_the_facts_say_what_is_there(drawing: SceneDrawing) -> None:
    scene = workshop().replace(side_friction=None)
    drawing.show_scene(scene)
    assert "hinge" in legend(drawing)
    assert "slider" not in legend(drawing)
    drawing.show_track(track_of(scene, spread=True))
    assert "68 and 95 %" in legend(drawing)
    said = facts(scene)
    assert "0.5 kg" in said
    assert "0.25 assumed (0.15 to 0.27)" in said
    assert "0.45</td>" in said
    unknown = Scene(bodies=(body("cup", 0.0, 0.0, mass=None),), table=scene.table.replace(friction=None))
    said = facts(unknown)
    assert "0.45 assumed (0.26 to 0.54)" in said
    assert "0.6 kg assumed (0.34 to 9)" in said
    frictions = np.array([[0.4, 0.3, 0.5], [0.3, 0.2, 0.4]])
    told = MassHistory([], np.array([0.0, 1.0]), *np.zeros((2, 2, 0, 3)), [], frictions)
    believed = dataclasses.replace(history(unknown), mass_history=told)
    assert "0.4 (0.3 to 0.5)" in facts(unknown, believed, 0.9)
    assert "0.3 (0.2 to 0.4)" in facts(unknown, believed)


# Machado, Oliveira, Fernandes, "A physiologically-based model for simulation of color vision deficiency" (2009).
BLINDNESS = {
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def lab(colours: np.ndarray) -> np.ndarray:
    """CIE L*a*b* of linear RGB."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = colours @ to_xyz.T / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.stack((116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])), -1)


@pytest.mark.parametrize("kind", BLINDNESS)
@pytest.mark.parametrize("colours", [BODIES, tuple(JOINTS.values())])
def test_colours_are_told_apart_by_colour_blind_people(kind: str, colours: tuple) -> None:
    encoded = np.array(colours) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    seen = lab((linear @ np.array(BLINDNESS[kind]).T).clip(0, 1))
    nearest = min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2))
    assert nearest > 8, f"{kind}: {nearest:.1f}"  # 2.3 is just noticeable


def decoded(path: Path) -> dict:
    """The recording in a saved page."""
    data = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]+)"', path.read_text())[1])
    size = int.from_bytes(data[:8], "little")
    raw = zstandard.ZstdDecompressor().decompress(data[8:], max_output_size=size)
    return msgspec.msgpack.decode(raw[8 : 8 + int.from_bytes(raw[:8], "little")])


def test_a_saved_page_holds_every_frame_at_its_time_and_loads_nothing(tmp_path: Path) -> None:
    scene = workshop()
    track = track_of(scene)
    save_page(tmp_path / "page.html", track, compare=track, title="<b>A & B</b>")
    told = decoded(tmp_path / "page.html")
    moves = {
        round(time, 4): message["position"][0]
        for time, message in told["messages"]
        if message["type"] == "SetPositionMessage" and message["name"] == "/view/bodies/plate"
    }
    expected = {round(0.05 * k, 4): 0.01 * k for k in range(1, 12) if k != 5}  # begins at 0, not seen in frame 5
    assert moves == pytest.approx(expected)
    page = (tmp_path / "page.html").read_text()
    assert "<summary>&lt;b&gt;A &amp; B&lt;/b&gt;</summary>" in page
    assert "Content-Security-Policy" in page
    assert not re.search(r"""(src|href)=["']?https?:""", page)


def test_polygons_stand_as_they_are(drawing: SceneDrawing) -> None:
    scene = Scene(
        bodies=(body("bracket", 0.3, 0.0, Polygon(points=L_SHAPE)), body("box", 0, 0, Cuboid(size=(0.1, 0.1))))
    )
    drawing.show_scene(scene)
    (solid,) = [grip.handle for grip in drawing.grips if grip.names == ("bracket",)]
    top = solid.vertices[np.isclose(solid.vertices[:, 2], 0.10)][:, :2]
    assert {tuple(point) for point in top.astype(float).round(4).tolist()} == set(L_SHAPE)


def test_a_scene_that_has_an_arm_shows_it_holding_the_tool(server, drawing: SceneDrawing) -> None:
    scene = workshop().replace(arm=Arm())
    track = track_of(scene)
    drawing.show_track(track)
    links = [handle for name, handle in server.scene._handle_from_node_name.items() if "/arm/link_" in name]
    assert len(links) > 6
    rod = links[0]
    for frame, lift in ((0, Arm().lift), (6, 0.0)):
        drawing.set_frame(frame)
        tip = rod.vertices[rod.vertices[:, 2].argmax()] * [0, 0, 1]
        placed = pose_3d.transform(np.concatenate((rod.position, rod.wxyz)), tip)
        np.testing.assert_allclose(placed[:2], track.poses[frame, 0, :2], atol=1e-3)
        tool = server.scene.get_handle_by_name("/view/tool/frame")
        assert tool.position[2] == pytest.approx(lift, abs=1e-3)
    drawing.show_scene(workshop())
    assert server.scene.get_handle_by_name("/view/arm") is None
