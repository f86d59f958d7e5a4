"""Recordings as people have them: what is taken, what is found, what is refused, by kind."""

import csv
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scenes import body
from typer.testing import CliRunner

from pushgraph import cli, pose
from pushgraph.body import Joint
from pushgraph.errors import TrackError
from pushgraph.recording.convention import Convention
from pushgraph.recording.layout import fit
from pushgraph.recording.naming import match_names
from pushgraph.recording.recording import Recording, read_recording
from pushgraph.recording.sightings import Declared
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool
from pushgraph.track import FRAME, LIFTED, Track


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A hinged pair, a tin and a crate, and two pushes; nothing about it is its own mirror image."""
    return Scene(
        bodies=(
            body("plate", -0.10, 0.06, Cuboid(size=(0.14, 0.10))),
            body("arm", 0.065, 0.06, Cuboid(size=(0.16, 0.07)), mass=0.3),
            body("tin", 0.24, -0.16),
            body("crate", 0.05, 0.27, Cuboid(size=(0.12, 0.09)), yaw=0.5),
        ),
        joints=(Joint(kind="revolute", parent="plate", child="arm"),),
        tool=Tool.round(0.05),
        pushes=(
            Push(start=(0.12, 0.20), end=(0.10, 0.02)),
            Push(start=(0.16, -0.20), direction=0.3, distance=0.15),
        ),
    )


@pytest.fixture(scope="module")
def true(scene: Scene) -> Track:
    return simulate(scene)


@dataclass
class Film:
    """Rows of a recording that a test changes before they are written."""

    times: np.ndarray
    poses: np.ndarray
    push: np.ndarray
    names: tuple[str, ...]
    header: tuple[str, ...] = ("time", "node", "x", "y", "yaw", "push")
    comments: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, track: Track) -> "Film":
        return cls(track.times.copy(), track.poses.copy(), track.push.copy(), track.nodes)

    def save(self, path: Path) -> Path:
        rows = [
            (time, name, *poses[node], push)
            for time, poses, push in zip(self.times, self.poses, self.push, strict=True)
            for node, name in enumerate(self.names)
        ]
        return save_rows(path, rows, self.header, self.comments)


def save_rows(path: Path, rows, header=("time", "node", "x", "y", "yaw", "push"), comments=()) -> Path:
    with path.open("w", newline="") as file:
        file.writelines(f"# {comment}\n" for comment in comments)
        csv.writer(file).writerows([header, *rows])
    return path


@pytest.fixture
def film(true: Track) -> Film:
    return Film.of(true)


def said(recording: Recording) -> str:
    return "\n".join(map(str, recording.findings))


def test_a_plain_recording_is_taken_as_it_is_and_nothing_is_said(film, scene, true, tmp_path) -> None:
    recording = read_recording(film.save(tmp_path / "film.csv"), scene)
    assert recording.findings == ()
    track = recording.believed()
    np.testing.assert_array_equal(track.poses, true.poses)
    np.testing.assert_array_equal(track.push, true.push)
    assert track.at_frames() is track


def test_a_camera_s_noise_is_no_finding(film, scene, tmp_path) -> None:
    film.poses[:, 1:] += np.random.default_rng(0).normal(size=film.poses[:, 1:].shape) * [0.001, 0.001, 0.0087]
    assert said(read_recording(film.save(tmp_path / "film.csv"), scene)) == ""


# Frames of 0.05 s.


def frames_of(scene: Scene, times, robot, push) -> Track:
    times, robot = np.array(times, dtype=float), np.array(robot, dtype=float)
    poses = np.zeros((len(times), 1 + len(scene.bodies), 3))
    poses[:, 1:] = scene.poses_world_from_body
    poses[:, 0, 0] = robot
    return Track(scene, times, poses, np.array(push), np.ones(poses.shape[:2], dtype=bool))


def test_another_push_without_a_lift_between_is_lifted_for_a_frame(scene) -> None:
    track = frames_of(scene, [0.0, 0.05, 0.10, 0.15], [-0.5, -0.49, 0.9, 0.91], [0, 0, 1, 1])
    frames = track.at_frames()
    np.testing.assert_allclose(frames.times, [0.0, 0.05, 0.075, 0.10, 0.15])
    assert frames.push.tolist() == [0, 0, LIFTED, 1, 1]
    assert frames.at_frames().push.tolist() == frames.push.tolist()
    assert [down for _, down in track.frames()] == [True, True, False, True, True]


def test_a_pause_costs_one_frame_however_long_it_is(scene) -> None:
    track = frames_of(scene, [5.0, 5.05, 1e9, 1e9 + 0.05], [-0.5, -0.49, -0.48, -0.47], [0, 0, 0, 0])
    frames = track.at_frames()
    assert frames.push.tolist() == [0, 0, LIFTED, 0, 0]
    np.testing.assert_array_equal(frames.times[[0, 1, 3]], [5.0, 5.05, 1e9])


def test_frames_of_frames_are_the_same(scene) -> None:
    for gap in (0.05, 0.08, 0.14, 0.15, 3.0):
        times = [0.0, 0.05, 0.05 + gap, 0.10 + gap]
        frames = frames_of(scene, times, [-0.5, -0.49, 0.9, 0.91], [0, 0, 1, 1]).at_frames()
        again = frames.at_frames()
        np.testing.assert_allclose(again.times, frames.times)
        assert again.push.tolist() == frames.push.tolist() == [0, 0, LIFTED, 1, 1]


def test_what_moved_during_a_pause_is_not_seen_in_it(scene) -> None:
    track = frames_of(scene, [0.0, 0.05, 9.0], [-0.5, -0.49, -0.48], [0, 0, 1])
    track.poses[2, 3, 0] += 0.01
    lifted = list(track.frames())[2][0]
    assert np.isnan(lifted[:, 0]).tolist() == [False, False, False, True, False]


def test_low_and_high_rates_come_to_the_same_frames(scene) -> None:
    for rate in (5, 20, 33, 250):
        times = np.arange(0, 1 + 1e-9, 1 / rate)
        track = frames_of(scene, times, -0.5 + 0.1 * times, [0] * len(times))
        frames = track.at_frames()
        np.testing.assert_allclose(np.diff(frames.times), FRAME, atol=1e-9)
        np.testing.assert_allclose(frames.poses[:, 0, 0], -0.5 + 0.1 * frames.times, atol=1e-9)


# Times and clocks.


def test_rows_twice_out_of_order_and_missing(film, scene, tmp_path) -> None:
    path = film.save(tmp_path / "film.csv")
    lines = path.read_text().splitlines()
    lines = [lines[0], *lines[40:80], *lines[1:40], *lines[60:]]
    del lines[200:205]
    path.write_text("\n".join(lines))
    recording = read_recording(path, scene)
    assert "20 rows of a node and time that stood before: left out" in said(recording)
    assert "out of order of time: sorted" in said(recording)
    recording.believed()


def test_a_clock_that_is_set_back_is_refused_and_one_that_leaps_ahead_is_a_pause(film, scene, tmp_path) -> None:
    film.times[20:] += 1e6
    assert len(read_recording(film.save(tmp_path / "film.csv"), scene).believed().at_frames().times) < 100
    film.times[20:] -= 1e6 + 3
    with pytest.raises(TrackError, match="times fall back by .* a clock that was set anew"):
        read_recording(film.save(tmp_path / "film.csv"), scene).believed()


def two_clocks(true: Track, robot_behind: float) -> list[tuple]:
    """The robot at 125 Hz by its own clock, bodies at 30 Hz by the camera's."""
    dense = np.arange(0, true.times[-1], 0.008)
    sparse = np.arange(0.003, true.times[-1], 1 / 30)
    rows = []
    for nodes, times, behind in (((0,), dense, robot_behind), (range(1, len(true.nodes)), sparse, 0.0)):
        before = np.searchsorted(true.times, times + 1e-9) - 1
        for node in nodes:
            values = [np.interp(times, true.times, true.poses[:, node, k]) for k in range(3)]
            push = true.push[before] if node == 0 else [""] * len(times)
            rows += zip(times + behind, [true.nodes[node]] * len(times), *values, push, strict=True)
    return rows


@pytest.mark.parametrize("behind", [0.0, 0.12, -0.2, 1.7e9])
def test_the_robot_s_lag_is_estimated_said_and_taken_back(true, scene, tmp_path, behind) -> None:
    recording = read_recording(save_rows(tmp_path / "film.csv", two_clocks(true, behind)), scene)
    assert recording.lag == pytest.approx(behind, abs=0.015)
    assert ("clocks of robot and camera that differ" in said(recording)) == (behind != 0)
    track = recording.believed()
    for node in range(2):
        there = np.stack([np.interp(track.times, true.times, true.poses[:, node, k]) for k in range(2)], -1)
        off = np.hypot(*(track.poses[:, node, :2] - there)[track.down & track.seen[:, node]].T)
        assert np.median(off) < 2e-3


def test_a_given_lag_is_taken(true, scene, tmp_path) -> None:
    recording = read_recording(save_rows(tmp_path / "film.csv", two_clocks(true, 0.12)), scene, lag=0.12)
    assert said(recording) == ""
    assert recording.lag == 0.12


def test_pushes_that_are_not_said_are_told_by_jumps_or_height(true, scene, tmp_path) -> None:
    rows = [row[:5] for row in two_clocks(true, 0.0)]
    path = save_rows(tmp_path / "film.csv", rows, ("time", "node", "x", "y", "yaw"))
    recording = read_recording(path, scene)
    assert "no push is said: the tool is taken as down, but where it jumps" in said(recording)
    lifted = dict(zip(true.times.round(3), ~true.down, strict=True))
    rows = [
        (time, name, *true.poses[k, node], 0.2 if lifted[round(float(time), 3)] else 0.1)
        for k, time in enumerate(true.times)
        for node, name in enumerate(true.nodes)
    ]
    path = save_rows(tmp_path / "high.csv", rows, ("time", "node", "x", "y", "yaw", "z"))
    np.testing.assert_array_equal(read_recording(path, scene).track.push, true.push)


# Units and axes: declared, or said to be doubtful.


def changed(film: Film, kind: str) -> None:
    x, y, yaw = (film.poses[..., k].copy() for k in range(3))
    if kind == "mm":
        film.poses[..., :2] *= 1e3
    elif kind == "cm":
        film.poses[..., :2] *= 1e2
    elif kind == "deg":
        film.poses[..., 2] = np.degrees(yaw)
    elif kind == "mirrored":
        film.poses[..., 1], film.poses[..., 2] = -y, -yaw
    elif kind == "swapped":
        film.poses[..., 0], film.poses[..., 1], film.poses[..., 2] = y, x, np.pi / 2 - yaw
    elif kind == "-rad":
        film.poses[..., 2] = -yaw
    elif kind == "ms":
        film.times *= 1e3


KINDS = {
    "mm": ("looks like millimetres", ["units: mm"]),
    "cm": ("looks like centimetres", ["units: cm"]),
    "deg": ("looks like degrees", ["units: deg"]),
    "mirrored": ("as in a mirror.*give --axes mirrored", ["axes: mirrored"]),
    "swapped": ("as in a mirror.*give --axes swapped", ["axes: swapped"]),
    "-rad": ("yaws that count clockwise", ["units: -rad"]),
    "ms": ("looks like ms", ["units: ms"]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_units_and_axes_are_taken_as_declared_and_doubted_if_not(film, scene, true, tmp_path, kind) -> None:
    changed(film, kind)
    with pytest.raises(TrackError, match=KINDS[kind][0]):
        read_recording(film.save(tmp_path / "film.csv"), scene).believed()
    film.comments = KINDS[kind][1]
    recording = read_recording(film.save(tmp_path / "film.csv"), scene)
    assert recording.findings == ()
    np.testing.assert_allclose(recording.track.poses[:, :, :2], true.poses[:, :, :2], atol=1e-9)
    np.testing.assert_allclose(np.cos(recording.track.poses[..., 2] - true.poses[..., 2]), 1, atol=1e-9)


def test_a_rotated_frame_needs_no_word_and_may_be_declared(film, scene, true, tmp_path) -> None:
    pose_recording_from_world = pose.inverse(np.array([0.4, -0.2, 2.0]))
    film.poses = pose.compose(pose_recording_from_world, film.poses)
    path = film.save(tmp_path / "film.csv")
    assert read_recording(path, scene).findings == ()
    declared = read_recording(path, scene, declared=Declared(frame="0.4 -0.2 2.0"))
    np.testing.assert_allclose(declared.track.poses, true.poses, atol=1e-9)


@pytest.mark.parametrize(
    ("declared", "says"),
    [
        (Declared(length="ell"), "unit of length 'ell'; valid: m, cm, mm, in"),
        (Declared(axes="x,x"), "axes 'x,x'; valid: x and y with signs"),
        (Declared(frame="1 2"), "frame '1 2'; valid: x y yaw"),
    ],
)
def test_unknown_conventions_are_refused(declared, says) -> None:
    with pytest.raises(TrackError, match=says):
        Convention.of(declared)


def test_a_similarity_is_found_by_its_law() -> None:
    points = np.random.default_rng(0).normal(size=(5, 2))
    moved = pose.transform(np.array([3.0, -1.0, 0.8]), points)
    found = fit(points, 1e3 * moved, mirrored=False, scale=1e3)
    assert (found.rotation, found.off) == (pytest.approx(0.8), pytest.approx(0, abs=1e-12))
    assert fit(points, moved * [1, -1], mirrored=False, scale=1.0).off > 0.1
    assert fit(points, moved * [1, -1], mirrored=True, scale=1.0).off < 1e-12


# Wrong sightings.


def test_zeros_empty_and_nan_are_lost_tags(film, scene, tmp_path) -> None:
    film.poses[5, 1] = 0.0
    film.poses[9, 3] = np.nan
    recording = read_recording(film.save(tmp_path / "film.csv"), scene)
    assert "plate: 1 pose of 0,0,0 taken as lost at 0.25 s" in said(recording)
    assert not recording.track.seen[[5, 9], [1, 3]].any()
    assert (~recording.track.seen).sum() == 2


def test_infinite_poses_are_lost_tags_and_infinite_forces_no_warnings() -> None:
    convention = Convention.of(Declared(axes="y,-x"))
    numbers = np.array([[0.1, 0.2, 0.3], [np.inf, 0.2, 0.3], [0.1, -np.inf, 0.3], [0.1, 0.2, np.inf]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        poses = convention.poses(*numbers.T)
        wrench = convention.wrench(numbers)
    assert np.isfinite(poses).all(-1).tolist() == [True, False, False, False]
    assert not np.isinf(poses).any()
    assert np.isfinite(wrench).all(-1).tolist() == [True, False, False, False]


def test_a_body_that_stands_on_the_origin_is_not_lost(scene, film, tmp_path) -> None:
    film.poses[..., :2] -= film.poses[0, 2, :2]
    assert read_recording(film.save(tmp_path / "film.csv"), scene).track.seen.all()


@pytest.mark.parametrize(("turn", "said_turn"), [(np.pi, "180"), (np.pi / 2, "90")])
def test_tags_read_turned_are_left_out_or_mended(film, scene, true, tmp_path, turn, said_turn) -> None:
    wrong = np.random.default_rng(0).random(film.poses.shape[:2]) < 0.05
    wrong[:, 0] = False
    wrong[0, 2] = True
    film.poses[..., 2] += turn * wrong
    path = film.save(tmp_path / "film.csv")
    recording = read_recording(path, scene)
    assert f"turned by {said_turn} degrees in {wrong[:, 2].sum()} of {len(true.times)} sightings" in said(recording)
    np.testing.assert_array_equal(recording.believed().seen, ~wrong)
    mended = read_recording(path, scene, mend=True).believed()
    np.testing.assert_allclose(np.cos(mended.poses[..., 2] - true.poses[..., 2]), 1, atol=1e-9)


def test_strays_are_left_out_and_exchanged_tags_are_mended(film, scene, true, tmp_path) -> None:
    film.poses[7, 1, :2] += 0.3
    film.poses[20:26, [3, 4]] = film.poses[20:26, [4, 3]]
    path = film.save(tmp_path / "film.csv")
    recording = read_recording(path, scene)
    assert "plate: 1 sighting away from those before and after at 0.35 s" in said(recording)
    assert "tin and crate: leap to each other's place and back, 6 frames exchanged" in said(recording)
    assert not recording.believed().seen[7, 1]
    assert not recording.track.seen[20:26, 3:].any()
    mended = read_recording(path, scene, mend=True).believed()
    np.testing.assert_allclose(mended.poses[20:26], true.poses[20:26])


@pytest.mark.parametrize(("column", "step"), [(0, 0.1), (2, 0.8)])
def test_a_body_that_leaps_and_stays_there_is_refused(film, scene, tmp_path, column, step) -> None:
    film.poses[25:, 1, column] += step
    with pytest.raises(TrackError, match=r"plate: jumps by .*, and stays there at 1.25 s"):
        read_recording(film.save(tmp_path / "film.csv"), scene).believed()


@pytest.mark.parametrize("first", [0, 1])
def test_a_frame_of_reference_that_moves_is_refused_or_mended(film, scene, true, tmp_path, first) -> None:
    film.poses[12:, first:] = pose.compose(np.array([0.05, -0.03, 0.1]), film.poses[12:, first:])
    path = film.save(tmp_path / "film.csv")
    with pytest.raises(TrackError, match=r"all 4 bodies leap as one, by .* at 0.60 s.*the frame of reference moved"):
        read_recording(path, scene).believed()
    mended = read_recording(path, scene, mend=True).believed()
    np.testing.assert_allclose(mended.poses[:, 1:], true.poses[:, 1:], atol=5e-3)


def test_names_that_are_exchanged_are_refused(film, scene, tmp_path) -> None:
    film.poses[:, [1, 3]] = film.poses[:, [3, 1]]
    with pytest.raises(TrackError, match="plate and tin stand where the scene has the other"):
        read_recording(film.save(tmp_path / "film.csv"), scene).believed()


def test_bodies_that_move_untouched_and_tools_inside_bodies_are_said(film, scene, tmp_path) -> None:
    film.poses[10:14, 4, 0] += np.linspace(0, 0.02, 4)
    film.poses[14:, 4, 0] += 0.02
    assert "crate: moves untouched, by 2.0 cm" in said(read_recording(film.save(tmp_path / "film.csv"), scene))
    wide = scene.replace(tool=Tool.round(0.10))
    assert "arm: the tool is up to 25 mm inside" in said(read_recording(film.save(tmp_path / "film.csv"), wide))


def test_a_rate_that_is_too_low_is_said(film, scene, tmp_path) -> None:
    film.times, film.poses, film.push = film.times[::8], film.poses[::8], film.push[::8]
    assert "2.5 frames a second are too few" in said(read_recording(film.save(tmp_path / "film.csv"), scene))


# Names.


def test_names_of_other_systems_find_their_nodes() -> None:
    nodes = ("robot", "block_1", "cup", "tin", "tag-23")
    recorded = ["/ee", "/vicon/Block 1", "Take:CUP", "杯子", "23", "Tür"]
    matched = match_names(recorded, nodes, {"杯子": "tin"})
    assert matched == {"杯子": "tin", "/ee": "robot", "/vicon/Block 1": "block_1", "Take:CUP": "cup", "23": "tag-23"}
    with pytest.raises(TrackError, match="nothing in the recording is called cup; names left: Tür; .*--name Tür=cup"):
        match_names(["robot", "Tür"], ("robot", "cup"), {})
    with pytest.raises(TrackError, match="/a/cup, /b/cup all fit 'cup'; say which is meant"):
        match_names(["robot", "/a/cup", "/b/cup"], ("robot", "cup"), {})
    with pytest.raises(TrackError, match="--name x=cup: the recording has no 'x'; it has robot"):
        match_names(["robot"], ("robot", "cup"), {"x": "cup"})


# On the command line.


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments])
    return result.exit_code, result.output + str(result.exception or "")


def test_track_on_the_command_line_reports_converts_and_refuses(film, scene, true, tmp_path) -> None:
    (tmp_path / "scene.json").write_text(scene.to_json())
    film.poses[5, 1, 2] += np.pi
    film.names = tuple(f"Take:{name}" for name in film.names)
    recorded, converted = film.save(tmp_path / "film.csv"), tmp_path / "track.h5"
    code, output = run("track", recorded, "--out", converted)
    assert (code, "Take:" in output, "No --scene" in output) == (0, True, True)
    code, output = run("track", converted, "--scene", tmp_path / "scene.json", "--mend", "--out", tmp_path / "again.h5")
    assert code == 0, output
    assert "plate: turned by 180 degrees" in output
    np.testing.assert_allclose(Track.load(tmp_path / "again.h5").poses, true.poses, atol=1e-9)
    code, output = run("track", tmp_path / "again.h5", "--out", tmp_path / "again.csv")  # holds its scene
    assert (code, "No --scene" in output) == (0, False)
    np.testing.assert_allclose(Track.load(tmp_path / "again.csv", scene).poses, true.poses, atol=1e-9)
    changed(film, "mm")
    code, output = run("track", film.save(recorded), "--scene", tmp_path / "scene.json", "--out", tmp_path / "no.h5")
    assert (code, "looks like millimetres" in output, (tmp_path / "no.h5").exists()) == (1, True, False)
    assert "positions spread over" in run("track", recorded)[1]
    assert run("track", recorded, "--name", "nonsense")[0] == 2
