"""Readings of a force sensor: in tracks and recordings, per frame, as theory has them, and what is refused."""

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scenes import body

from pushgraph import pose
from pushgraph.errors import TrackError
from pushgraph.recording.files import read_sightings, save_sightings
from pushgraph.recording.recording import read_recording
from pushgraph.recording.sightings import Declared
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cylinder
from pushgraph.simulation.force_sensor import FORCE_NOISE, MOMENT_NOISE, measured_wrench
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push
from pushgraph.track import FRAME, LIFTED, Track
from pushgraph.track_csv import COLUMNS
from pushgraph.wrench import COMPONENTS, check_measured, mean_since

GRAVITY = 9.81
MISSING = [np.nan] * 3


def row_of(masses: Sequence[float], friction: float = 0.45) -> Scene:
    """Cylinders that touch each other in the way of a slow push through their centres."""
    discs = [body(f"disc{k}", 0.101 * k, 0.0, Cylinder(diameter=0.10), mass=mass) for k, mass in enumerate(masses)]
    push = Push(start=(-0.11, 0), end=(0.04, 0), speed=0.05)
    return Scene(bodies=tuple(discs), pushes=(push,), table=Table(friction=friction))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return row_of([0.5])


@pytest.fixture(scope="module")
def track(scene: Scene) -> Track:
    """The first reading is missing."""
    true = simulate(scene)
    wrench = true.wrench.copy()
    wrench[0] = MISSING
    return replace(true, wrench=wrench)


# What a sensor sees.


@pytest.mark.parametrize(
    ("masses", "friction"), [([0.3], 0.45), ([9.0], 0.45), ([1.5], 0.2), ([0.3, 1.5], 0.45), ([9.0, 0.3], 0.6)]
)
def test_a_slow_push_is_resisted_by_friction_times_weight_of_all_that_slides(masses, friction: float) -> None:
    track = simulate(row_of(masses, friction))
    steady = (track.times > 1.5) & (track.times < 2.9)
    force = friction * sum(masses) * GRAVITY
    assert track.wrench[steady, 0] == pytest.approx(-force, rel=0.03)
    assert np.abs(track.wrench[steady, 1]).max() < 0.03 * force
    assert np.abs(track.wrench[steady, 2]).max() < 0.03 * force * 0.05


def test_noise_has_its_standard_deviations_and_is_repeatable() -> None:
    true = np.tile([-2.0, 1.0, 0.05], (4000, 1))
    noisy = measured_wrench(true, np.random.default_rng(0))
    assert (noisy - true).std(0) == pytest.approx([FORCE_NOISE, FORCE_NOISE, MOMENT_NOISE], rel=0.05)
    assert (noisy - true).mean(0) == pytest.approx([0, 0, 0], abs=0.02)
    np.testing.assert_array_equal(noisy, measured_wrench(true, np.random.default_rng(0)))
    np.testing.assert_array_equal(measured_wrench(true, np.random.default_rng(0), force=0.0, moment=0.0), true)


# Tracks.


@pytest.mark.parametrize("name", ["track.h5", "track.csv"])
def test_readings_and_their_gaps_read_back_bit_for_bit(track: Track, tmp_path: Path, name: str) -> None:
    track.save(tmp_path / name)
    np.testing.assert_array_equal(Track.load(tmp_path / name, track.scene).wrench, track.wrench)
    replace(track, wrench=None).save(tmp_path / name)
    assert Track.load(tmp_path / name, track.scene).wrench is None


def test_a_csv_has_readings_on_the_robot_s_lines(track: Track, tmp_path: Path) -> None:
    track.save(tmp_path / "track.csv")
    rows = list(csv.DictReader((tmp_path / "track.csv").open()))
    assert list(rows[0]) == [*COLUMNS, *COMPONENTS]
    for node in ("robot", "disc0"):
        empty = [row["force_x"] == row["force_y"] == row["moment"] == "" for row in rows if row["node"] == node]
        assert empty == [node != "robot" or frame == 0 for frame in range(len(track.times))]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["0,robot,-0.2,0,0,0,nan,0,0"], "line 2: force_x: must be a finite number .N., got 'nan'; leave all three"),
        (["0,robot,-0.2,0,0,0,0,inf,0"], "line 2: force_y: must be a finite number"),
        (["0,robot,-0.2,0,0,0,1,2,"], "line 2: moment: must be a finite number .N m., got ''"),
        (
            ["0,robot,-0.2,0,0,0,,,", "0,disc0,0,0,0,0,1,2,3"],
            "line 3: .* belong to the lines of 'robot', not of 'disc0'",
        ),
        (["0,robot,-0.2,0,0,0"], "line 2: 9 columns are needed, got 6"),
    ],
)
def test_a_faulty_csv_is_refused_by_line(scene: Scene, tmp_path: Path, lines: list[str], message: str) -> None:
    (tmp_path / "track.csv").write_text("\n".join([",".join([*COLUMNS, *COMPONENTS]), *lines]))
    with pytest.raises(TrackError, match=message):
        Track.load(tmp_path / "track.csv", scene)


@pytest.mark.parametrize("reading", [[np.inf, 0, 0], [0, -np.inf, 0], [np.nan, 0, 0], [0, 0, np.nan]])
def test_a_track_names_the_frame_of_a_reading_that_is_not_finite(track: Track, reading: list[float]) -> None:
    wrench = track.wrench.copy()
    wrench[7] = reading
    with pytest.raises(
        TrackError, match=r"wrench at frame 7 \(0.35 s\) is force_x .* forces must be in N, moments in N m"
    ):
        replace(track, wrench=wrench)


def test_what_no_sensor_reads_has_another_unit_but_may_be_simulated(track: Track) -> None:
    wrench = track.wrench.copy()
    wrench[3] = [0.0, -1001.0, 0.0]
    replace(track, wrench=wrench)
    with pytest.raises(TrackError, match=r"wrench at frame 3 .*at most 1000 N and N m; forces must be in N"):
        check_measured(wrench, track.times)
    check_measured(track.wrench, track.times)


def test_a_frame_s_reading_is_the_mean_since_the_frame_before() -> None:
    frames = np.array([0.0, 0.05, 0.10, 0.40])
    times = np.array([0.0, 0.01, 0.04, 0.05, 0.06, 0.30, 0.36, 0.40, 0.41])
    wrench = np.arange(9)[:, None] * [1.0, 10.0, 100.0]
    wrench[4] = np.nan
    means = mean_since(frames, times, wrench, FRAME, 1e-6)
    np.testing.assert_allclose(means[:, 0], [0.0, 2.0, np.nan, 6.5])
    np.testing.assert_allclose(means, means[:, :1] * [1.0, 10.0, 100.0])


def test_frames_of_a_faster_or_slower_sensor(scene: Scene) -> None:
    def of_rate(rate: float) -> Track:
        times = np.arange(int(rate) + 1) / rate
        poses = np.zeros((len(times), 2, 3))
        poses[:, 0, 0] = -0.5
        wrench = np.column_stack((times, -times, 0 * times))
        return Track(scene, times, poses, np.zeros(len(times), int), np.ones((len(times), 2), bool), wrench)

    fast = of_rate(100).at_frames()
    np.testing.assert_allclose(fast.wrench[1:, 0], fast.times[1:] - 0.02)
    slow = of_rate(10).at_frames()
    assert np.isnan(slow.wrench[1::2]).all()
    np.testing.assert_allclose(slow.wrench[::2, 0], slow.times[::2])
    same = of_rate(20)
    assert same.at_frames() is same


def test_a_lift_between_pushes_has_no_reading(track: Track) -> None:
    push = np.where(np.arange(len(track.times)) < 20, 0, 1)
    frames = replace(track, scene=track.scene.replace(pushes=()), push=push).at_frames()
    lift = int(np.flatnonzero(frames.push == LIFTED)[0])
    assert np.isnan(frames.wrench[lift]).all()
    np.testing.assert_array_equal(frames.wrench[1:lift], track.wrench[1:lift])


# Recordings.


def long_table(track: Track, wrench: np.ndarray | None = None) -> list[list[str]]:
    rows = [[*COLUMNS, *COMPONENTS]]
    for frame, time in enumerate(track.times):
        for node, name in enumerate(track.nodes):
            reading = (track.wrench if wrench is None else wrench)[frame] if node == 0 else MISSING
            numbers = [*track.poses[frame, node], track.push[frame], *reading]
            rows.append([str(time), name, *("" if math.isnan(value) else str(value) for value in numbers)])
    return rows


def save(path: Path, rows: list[list[str]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return path


def wide_table(track: Track) -> list[list[str]]:
    rows = [
        [
            "t",
            "robot_x",
            "robot_y",
            "disc0_x",
            "disc0_y",
            "disc0_yaw",
            "push",
            "Force_X (N)",
            "force_y [N]",
            "moment (Nm)",
        ]
    ]
    for time, poses, push, reading in zip(track.times, track.poses, track.push, track.wrench, strict=True):
        numbers = [time, *poses[0, :2], *poses[1], push, *reading]
        rows.append(["" if math.isnan(value) else str(value) for value in numbers])
    return rows


@pytest.mark.parametrize("kind", ["long.csv", "wide.csv", "track.h5", "sightings.h5", "sightings.csv"])
def test_recordings_bring_readings_along(track: Track, scene: Scene, tmp_path: Path, kind: str) -> None:
    path = tmp_path / kind
    if kind == "track.h5":
        track.save(path)
    elif kind.startswith("sightings"):
        save_sightings(read_sightings(save(tmp_path / "long.csv", long_table(track))), path)
    else:
        save(path, long_table(track) if kind == "long.csv" else wide_table(track))
    recording = read_recording(path, scene)
    np.testing.assert_array_equal(recording.believed().wrench, track.wrench)
    assert [str(finding) for finding in recording.findings] == [
        f"robot: no reading of its force sensor in 1 of {len(track.times)} frames at 0.00 s; likely cause: readings "
        "lost, or fewer than poses"
    ]


def test_parquet_may_hold_readings(track: Track, scene: Scene, tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    columns = {"timestamp": track.times, "robot_x": track.poses[:, 0, 0], "robot_y": track.poses[:, 0, 1]}
    columns |= {f"disc0_{axis}": track.poses[:, 1, k] for k, axis in enumerate(("x", "y", "yaw"))}
    columns |= {"push": track.push} | {name: track.wrench[:, k] for k, name in enumerate(COMPONENTS)}
    parquet.write_table(arrow.table(columns), tmp_path / "episode.parquet")
    np.testing.assert_array_equal(read_recording(tmp_path / "episode.parquet", scene).believed().wrench, track.wrench)


def test_sightings_without_readings_are_read_as_before(track: Track, scene: Scene, tmp_path: Path) -> None:
    save_sightings(read_sightings(save(tmp_path / "long.csv", long_table(track))), tmp_path / "old.h5")
    with h5py.File(tmp_path / "old.h5", "a") as file:
        for name in COMPONENTS:
            del file[name]
    recording = read_recording(tmp_path / "old.h5", scene)
    assert recording.believed().wrench is None
    assert recording.findings == ()


def test_readings_turn_with_the_recording_s_axes(track: Track, scene: Scene, tmp_path: Path) -> None:
    """World x is the recording's y, world y its x: mirrored, so moments change their sign."""
    rows = long_table(track)
    for row in rows[1:]:
        row[2], row[3], row[6], row[7] = row[3], row[2], row[7], row[6]
        row[4] = str(math.pi / 2 - float(row[4]))
        row[8] = str(-float(row[8])) if row[8] else ""
    recording = read_recording(save(tmp_path / "swapped.csv", rows), scene, declared=Declared(axes="swapped"))
    np.testing.assert_allclose(recording.believed().wrench, track.wrench, atol=1e-12)
    frame = read_recording(
        save(tmp_path / "turned.csv", long_table(track)), scene, declared=Declared(frame="0.1 0.2 1.0")
    ).track
    np.testing.assert_allclose(
        frame.wrench[:, 0], (track.wrench[:, :2] * [math.cos(1), -math.sin(1)]).sum(1), atol=1e-12
    )


def test_readings_are_mended_with_a_frame_of_reference_that_turned(track: Track, tmp_path: Path) -> None:
    """From frame 20 on the recording is of a frame turned by 0.3 rad, robot, bodies, forces and all."""
    other = body("other", 0.3, 0.3, Cylinder(diameter=0.10))
    scene = track.scene.replace(bodies=(*track.scene.bodies, other))
    true = simulate(scene)
    turned = true.poses.copy()
    turned[20:] = pose.compose(np.array([0.1, 0.0, 0.3]), true.poses[20:])
    wrench = true.wrench.copy()
    wrench[20:, :2] = pose.rotate(true.wrench[20:, :2], 0.3)
    path = save(tmp_path / "bumped.csv", long_table(replace(true, poses=turned), wrench))
    recording = read_recording(path, scene, mend=True)
    assert any("leap as one" in str(finding) and "the robot with" in str(finding) for finding in recording.findings)
    np.testing.assert_allclose(recording.track.wrench, true.wrench, atol=0.02 * np.abs(true.wrench).max())


def test_lost_readings_are_said_and_others_kept(track: Track, scene: Scene, tmp_path: Path) -> None:
    wrench = track.wrench.copy()
    wrench[10:15] = np.nan
    recording = read_recording(save(tmp_path / "lost.csv", long_table(track, wrench)), scene)
    assert "no reading of its force sensor in 6 of" in str(recording.findings[0])
    np.testing.assert_array_equal(recording.believed().wrench, wrench)


@pytest.mark.parametrize(
    ("reading", "says"),
    [
        ([-2000.0, 0.0, 0.0], "wrench at frame 9 .*: it must be at most 1000 N and N m; forces must be in N"),
        ([-2.0, 0.0, 1500.0], "wrench at frame 9 .* moment 1500: it must be at most 1000"),
        ([-2.0, np.nan, 0.0], "wrench at frame 9 .*: it must be finite"),
    ],
)
def test_recordings_in_other_units_or_with_half_readings_are_refused(
    track: Track, scene: Scene, tmp_path: Path, reading: list[float], says: str
) -> None:
    wrench = track.wrench.copy()
    wrench[9] = reading
    with pytest.raises(TrackError, match=says) as error:
        read_recording(save(tmp_path / "film.csv", long_table(track, wrench)), scene)
    assert "film.csv" in str(error.value)


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("time,node,x,y,yaw,force_x", "columns force_x alone are no reading; needed: force_x, force_y, moment"),
        ("time,node,x,y,yaw,force_x (lbf),force_y,moment", "line 1: force_x is in 'lbf'; valid: N"),
        ("time,node,x,y,yaw,force_x,force_y,moment [N mm]", "line 1: moment is in 'N mm'; valid: N m"),
    ],
)
def test_columns_that_are_no_readings_are_refused(tmp_path: Path, header: str, says: str) -> None:
    (tmp_path / "film.csv").write_text(header + "\n0,robot,0,0,0,1,1,1\n")
    with pytest.raises(TrackError, match=says):
        read_sightings(tmp_path / "film.csv")


def test_slow_sensors_and_fast_cameras_give_every_frame_a_reading(scene: Scene, tmp_path: Path) -> None:
    """Robot and sensor at 20 Hz, the body at 100 Hz."""
    rows = [[*COLUMNS, *COMPONENTS]]
    for tick in range(101):
        if tick % 5 == 0:
            rows.append([str(tick / 100), "robot", "-0.5", "0", "0", "0", str(-tick / 100), "0", "0"])
        rows.append([str(tick / 100), "disc0", "0", "0", "0", "0", "", "", ""])
    recording = read_recording(save(tmp_path / "film.csv", rows), scene)
    assert recording.findings == ()
    frames = recording.believed().at_frames()
    np.testing.assert_allclose(frames.wrench[:, 0], -frames.times, atol=1e-12)
