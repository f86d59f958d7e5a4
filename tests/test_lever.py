"""Levering up: scenes that say what is wrong with them, the laws of the simulation, tracks and pictures."""

import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from pushgraph import pose_3d
from pushgraph.cli import main
from pushgraph.cli.scenes import SHIPPED_SCENES
from pushgraph.errors import SceneError, SimulationError, TrackError
from pushgraph.lever_scene import Box, LeverScene, LeverTool, ToolBox, WayPoint
from pushgraph.lever_track import LeverTrack
from pushgraph.simulation.lever import simulate_lever
from pushgraph.simulation.lever_setup import SIDES, draw_interaction
from pushgraph.viewer.box_view import DrawnBox, View, image_of

FLOOR = Box(name="floor", size=(10.0, 2.0, 0.1), position=(0.0, 0.0, -0.05), fixed=True)
BOARD = Box(name="board", size=(0.2, 0.1, 0.01), position=(0.0, 0.0, 0.005), mass=0.1)
AWAY = WayPoint(time=0.0, position=(0.0, 0.0, 1.0))


def scene_of(*bodies: Box, path: tuple[WayPoint, ...] = (AWAY, AWAY.replace(time=1.0)), **fields) -> LeverScene:
    tool = fields.pop("tool", LeverTool(boxes=(ToolBox(size=(0.3, 0.2, 0.002), position=(0.0, 0.0, -0.001)),)))
    return LeverScene(bodies=bodies, tool=tool, path=path, **fields)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda s: s["bodies"][1].update(quaternion=[1.0, 0.5, 0.0, 0.0]),
            "bodies[1] 'board': quaternion: a quaternion",
        ),
        (
            lambda s: s["bodies"][1].update(position=[0.0, 0.0, 0.0]),
            "body 'board': position: it lies inside 'floor', 5.0",
        ),
        (lambda s: s["bodies"][0].update(size=[10.0, -0.02, 0.1]), "bodies[0] 'floor': size[1]: Input should be"),
        (
            lambda s: s["path"][0].update(position=[0.0, 0.0, 0.006]),
            "path[0].position: the tool starts inside body 'board'",
        ),
        (lambda s: s["bodies"][0].update(fixed=False), "exactly one must not be fixed, the board; of these 2"),
        (lambda s: s["bodies"][0].update(name="board"), "the name 'board' is used 2 times"),
        (lambda s: s["bodies"][0].update(name="tool"), "'tool' is the tool's name"),
        (lambda s: s["path"][1].update(time=0.0), "path[1].time: times must rise"),
        (lambda s: s["path"][0].update(time=0.5), "path[0].time: the first way-point must be at 0 s"),
        (lambda s: s["path"][1].update(position=[9.0, 0.0, 1.0]), "path[1].position: reached at 9 m/s"),
        (lambda s: s.update(format="pushgraph.scene"), '"format" must be "pushgraph.lever-scene"'),
        (lambda s: s.update(version=2), "newer than this pushgraph reads"),
    ],
)
def test_what_does_not_fit_is_named(change, words: str) -> None:
    data = json.loads(scene_of(FLOOR, BOARD).to_json())
    change(data)
    with pytest.raises(SceneError) as caught:
        LeverScene.from_json(json.dumps(data))
    assert words in str(caught.value)


def test_a_scene_comes_back_from_its_file_bit_for_bit(tmp_path) -> None:
    scene = draw_interaction(0, 0).track.scene
    (tmp_path / "scene.json").write_text(scene.to_json())
    assert LeverScene.load(tmp_path / "scene.json") == scene


def test_the_published_schema_is_the_code_s_and_shipped_scenes_fit_it() -> None:
    schema = json.loads((Path(__file__).parents[1] / "docs" / "lever-scene.schema.json").read_text())
    assert schema == LeverScene.model_json_schema(), "docs/lever-scene.schema.json is stale: run make schema"
    scene = json.loads((SHIPPED_SCENES / "lever-up.json").read_text())
    for valid in (scene, json.loads(scene_of(FLOOR, BOARD).to_json())):
        jsonschema.validate(valid, schema)
    for change in ({"size": [0.1, -0.1, 0.1]}, {"quaternion": [1.0, 0.0, 0.0]}, {"weight": 1.0}):
        scene["bodies"][0] |= change
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(scene, schema)
        scene["bodies"][0] = scene["bodies"][1]


def test_between_way_points_the_tool_turns_about_its_origin() -> None:
    half = np.pi / 4  # of a quarter turn about y
    end = WayPoint(time=2.0, position=(0.4, 0.0, 1.0), quaternion=(np.cos(half), 0.0, np.sin(half), 0.0))
    poses = scene_of(FLOOR, BOARD, path=(AWAY, end)).tool_poses(np.array([0.0, 1.0, 2.0, 5.0]))
    np.testing.assert_allclose(poses[:, 0], [0.0, 0.2, 0.4, 0.4], atol=1e-12)
    np.testing.assert_allclose(
        pose_3d.rotation_error(poses, poses[:1]), np.array([0.0, 0.5, 1, 1]) * np.pi / 2, atol=1e-7
    )


def test_a_board_that_nothing_touches_falls_freely() -> None:
    track = simulate_lever(scene_of(FLOOR, BOARD.replace(position=(0.0, 0.0, 0.5))))
    assert track.board[5, 2] == pytest.approx(0.5 - 9.81 * 0.25**2 / 2, abs=1e-3)
    assert track.board[-1, 2] == pytest.approx(0.005, abs=1e-4)


@pytest.mark.parametrize("degrees", [10.0, 30.0])
def test_on_a_slope_it_sticks_or_slides_as_coulomb_says(degrees: float) -> None:
    """Friction 0.3 holds up to 16.7 degrees."""
    slope, down = np.radians(degrees), np.array([np.sin(np.radians(degrees)), 0.0, -np.cos(np.radians(degrees))])
    track = simulate_lever(scene_of(FLOOR, BOARD, gravity=tuple((9.81 * down).tolist())))
    acceleration = 9.81 * max(np.sin(slope) - 0.3 * np.cos(slope), 0.0)
    assert track.board[10, 0] == pytest.approx(acceleration * 0.5**2 / 2, rel=0.01, abs=5e-5)
    assert track.penetration.max() < 1e-4


def test_a_flat_tool_lifts_the_board_by_as_much_as_it_rises() -> None:
    under, high = WayPoint(time=0.0, position=(0.0, 0.0, 0.099)), WayPoint(time=1.0, position=(0.0, 0.0, 0.149))
    stand = [Box(name=f"stand_{x}", size=(0.02, 0.3, 0.1), position=(0.16 * x, 0.0, 0.05), fixed=True) for x in (-1, 1)]
    board = BOARD.replace(size=(0.4, 0.1, 0.01), position=(0.0, 0.0, 0.105))
    tool = LeverTool(boxes=(ToolBox(size=(0.2, 0.08, 0.002), position=(0.0, 0.0, -0.001)),))
    track = simulate_lever(scene_of(*stand, board, path=(under, high), tool=tool))
    assert track.rise[-1] == pytest.approx(0.049, abs=1e-4)
    assert track.raised
    assert pose_3d.rotation_error(track.board[-1], track.board[0]) < 1e-3


def test_a_board_crushed_against_what_cannot_give_way_is_refused() -> None:
    way = tuple(WayPoint(time=time, position=(0.0, 0.0, height)) for time, height in ((0.0, 0.03), (0.5, -0.01)))
    block = LeverTool(boxes=(ToolBox(size=(0.1, 0.1, 0.02), position=(0.0, 0.0, 0.01)),))
    with pytest.raises(SimulationError, match="crushed .* mm deep at .* s, pressed against"):
        simulate_lever(scene_of(FLOOR, BOARD, path=way, tool=block))


def test_the_setup_levers_one_drive_from_every_side_without_deep_overlap() -> None:
    drawn = [draw_interaction(3, index) for index in range(4)]
    assert [one.side for one in drawn] == list(SIDES)
    assert len({one.track.scene.bodies for one in drawn}) == 1
    for one, outward in zip(drawn, ((1, 0), (0, 1), (-1, 0), (0, -1)), strict=True):
        track = one.track
        assert track.poses[0, 0, :2] @ outward > 0.1
        assert track.penetration.max() < 5e-4
        assert track.rise.max() > 0.002
        assert one.ledge == (f"ledge_{one.side}" in track.scene.names)
    again = draw_interaction(3, 2)
    assert again.track.scene == drawn[2].track.scene
    np.testing.assert_array_equal(again.track.poses, drawn[2].track.poses)
    assert draw_interaction(4, 2).track.scene != again.track.scene


def test_a_track_comes_back_from_its_file_and_a_damaged_one_is_refused(tmp_path) -> None:
    track, path = simulate_lever(scene_of(FLOOR, BOARD)), tmp_path / "track.h5"
    track.save(path)
    loaded = LeverTrack.load(path)
    assert loaded.scene == track.scene
    np.testing.assert_array_equal(loaded.poses, track.poses)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(TrackError, match="damaged"):
        LeverTrack.load(path)
    with pytest.raises(TrackError, match="no such file"):
        LeverTrack.load(tmp_path / "none.h5")


def test_a_track_needs_unit_quaternions_of_all_nodes() -> None:
    track = simulate_lever(scene_of(FLOOR, BOARD))
    poses = track.poses.copy()
    poses[3, 2, 3] = 1.01
    with pytest.raises(TrackError, match="'board' at frame 3"):
        LeverTrack(track.scene, poses)
    with pytest.raises(TrackError, match=r"shape must be \(frames, 3, 7\)"):
        LeverTrack(track.scene, poses[:, :2])


def test_the_nearer_box_hides_the_other_and_a_transparent_one_does_not() -> None:
    """Seen from +x: right is +y, up is +z."""
    view = View.from_direction(0.0, 0.0, np.zeros(3), 0.4, (40, 40))
    identity = [1.0, 0.0, 0.0, 0.0]
    near = DrawnBox((0.1, 0.1, 0.1), np.array([0.5, 0.1, 0.0, *identity]), (1.0, 0.0, 0.0))
    far = DrawnBox((0.1, 0.3, 0.1), np.array([-0.5, 0.0, 0.0, *identity]), (0.0, 1.0, 0.0))
    image = image_of([near, far], view)
    red, green, white = image[20, 30], image[20, 10], image[2, 2]
    assert red[0] > 0.4
    assert green[1] > 0.4
    assert red[1] == green[0] == 0
    np.testing.assert_array_equal(white, 1)
    mixed = image_of([near._replace(alpha=0.5), far], view)[20, 30]
    np.testing.assert_allclose(mixed, (red + green) / 2)


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        main(list(arguments))
    return exit_.value.code


@pytest.mark.parametrize("command", ["simulate", "predict"])
def test_the_commands_take_scenes_in_space(command: str, tmp_path, capsys) -> None:
    scene = LeverScene.load(SHIPPED_SCENES / "lever-up.json")
    path = tmp_path / "own.json"
    path.write_text(scene.replace(path=scene.path[:3]).to_json())
    assert run(command, str(path), "--out", str(tmp_path / "out"), "--animation", "none") == 0
    assert "rise" in capsys.readouterr().out
    assert LeverTrack.load(tmp_path / "out" / "track.h5").raised
    assert (tmp_path / "out" / "picture.png").stat().st_size > 10_000
    assert {one.name for one in (tmp_path / "out").iterdir()} == {"track.h5", "picture.png"}


def test_predict_refuses_what_a_scene_in_space_has_not(tmp_path, capsys) -> None:
    out = str(tmp_path / "out")
    assert run("predict", "lever-up", "--out", out, "--masses", "mean") == 2
    assert "scenes in space know no other than given" in " ".join(capsys.readouterr().err.split())
    assert run("predict", "lever-up", "--out", out, "--model", "contact") == 1
    assert "for scenes in space valid: lever_up" in " ".join(capsys.readouterr().err.split())
    scene = json.loads((SHIPPED_SCENES / "lever-up.json").read_text())
    scene["bodies"][0]["size"][2] = -0.02
    (tmp_path / "bad.json").write_text(json.dumps(scene))
    assert run("predict", str(tmp_path / "bad.json"), "--out", out) == 1
    assert "bodies[0] 'drive': size[2]" in " ".join(capsys.readouterr().err.split())


def test_the_demo_tells_how_far_prediction_is_from_simulation(tmp_path, capsys) -> None:
    assert run("demo", "lever-up", "--out", str(tmp_path)) == 0
    printed = capsys.readouterr().out
    assert "predicted raised, simulated raised" in printed
    last = [float(cell) for cell in re.findall(r"│ +3\.00 │(.*)│", printed)[0].split("│")]
    predicted, simulated = (LeverTrack.load(tmp_path / f"{name}.h5") for name in ("predicted", "simulated"))
    off = 1e3 * np.linalg.norm((predicted.board - simulated.board)[-1, :3])
    assert last[3] == pytest.approx(off, abs=0.006)
    assert off < 1
    assert {one.name for one in tmp_path.iterdir()} == {
        "predicted.h5", "simulated.h5", "picture.png", "animation.gif",
    }  # fmt: skip
    assert run("demo", "lever-down") == 2
    assert "valid: demo, lever-up" in " ".join(capsys.readouterr().err.split())
