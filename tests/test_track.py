"""Tracks: HDF5 and CSV out and in, what a camera loses, and what is refused."""

import csv
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scenes import body, workshop

from pushgraph import pose
from pushgraph.errors import StorageError, TrackError
from pushgraph.scene import Scene
from pushgraph.simulation.planar import simulate
from pushgraph.track import Track
from pushgraph.track_csv import COLUMNS
from pushgraph.track_frames import Frames
from pushgraph.track_resampling import in_frames


@pytest.fixture(scope="module")
def track() -> Track:
    return simulate(workshop())


def same(one: Track, other: Track) -> bool:
    arrays = ("times", "poses", "push", "seen")
    return one.scene == other.scene and all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=name == "poses") for name in arrays
    )


@pytest.mark.parametrize("name", ["track.h5", "track.csv"])
def test_a_track_reads_back_bit_for_bit(track: Track, tmp_path: Path, name: str) -> None:
    track.save(tmp_path / name)
    assert same(Track.load(tmp_path / name, track.scene), track)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_hdf5_holds_its_scene_and_opens_in_any_viewer(track: Track, tmp_path: Path) -> None:
    track.save(tmp_path / "track.h5")
    assert same(Track.load(tmp_path / "track.h5"), track)
    with h5py.File(tmp_path / "track.h5") as file:
        assert file["poses"].shape == track.poses.shape
        assert file["nodes"].asstr()[0] == "robot"


def camera_csv(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join([",".join(COLUMNS), *lines]) + "\n")
    return path


def test_a_camera_s_track_may_lose_tags_and_come_at_any_rate(tmp_path: Path) -> None:
    scene = workshop()
    path = camera_csv(
        tmp_path / "camera.csv",
        [
            "10.0,robot,-0.2,0,0,0",
            "10.0,plate,0,0,0,0",
            "10.0,lid,0,0.105,0,0",
            "10.03,robot,-0.19,0,0,0",
            "10.03,plate,,,,0",
            "10.08,robot,-0.18,0,0,0",
            "10.08,plate,0.01,0,0.1,0",
        ],
    )
    seen = Track.load(path, scene)
    np.testing.assert_array_equal(seen.times, [10.0, 10.03, 10.08])
    np.testing.assert_array_equal(seen.seen[:, 1], [True, False, True])
    assert np.isnan(seen.poses[1, 1]).all()
    assert seen.gaps["plate"] == [(10.03, 10.03)]
    assert seen.gaps["lid"] == [(10.03, 10.08)]
    assert seen.gaps["cup"] == [(10.0, 10.08)]
    assert "robot" not in seen.gaps
    for name in ("again.csv", "again.h5"):
        seen.save(tmp_path / name)
        assert same(Track.load(tmp_path / name, scene), seen)


def test_yaw_may_be_missing_only_where_the_scene_says_it_is_unknown(tmp_path: Path) -> None:
    scene = workshop()
    path = camera_csv(tmp_path / "camera.csv", ["0,robot,-0.2,0,0,0", "0,cup,0.25,0,,0"])
    with pytest.raises(TrackError, match="pose of 'cup' at 0 s is .*only a body with yaw_known false"):
        Track.load(path, scene)
    blind = scene.replace(bodies=tuple(seen.replace(yaw_known=seen.name != "cup") for seen in scene.bodies))
    assert np.isnan(Track.load(path, blind).poses[0, 3, 2])


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["0,robot,nan,0,0,0"], "line 2: x: must be a finite number, got 'nan'"),
        (["0,robot,0,0,0,0", "0,plate,0,inf,0,0"], "line 3: y: must be a finite number"),
        (["0,robot,0,0,0,0", "0,nut,0,0,0,0"], "line 3: no body 'nut'; valid: robot, plate, lid, cup, handle"),
        (["0,robot,0,0,0,0", "0.1,robot,0,0,0,0", "0.05,robot,0,0,0,0"], "line 4: times must rise: 0.05 s after 0.1 s"),
        (["0,robot,0,0,0,0", "0,robot,0,0,0,0"], "line 3: 'robot' stands twice at 0 s"),
        (["0,plate,0,0,0,0"], "'robot' is missing at 0 s"),
        (["0,robot,0,0,0,9"], "push 9 at frame 0: valid are -1"),
        (["0,robot,0,0,0,0.5"], "line 2: push: must be a whole number"),
        (["0,robot,0,0,0,1e30"], "line 2: push: must be a whole number"),
        (["0,robot,0,0"], "line 2: 6 columns are needed, got 4"),
        (["soon,robot,0,0,0,0"], "line 2: time: must be a finite number, got 'soon'"),
        ([], "at least one frame"),
    ],
)
def test_a_faulty_csv_is_refused_by_line(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(TrackError, match=message) as error:
        Track.load(camera_csv(tmp_path / "camera.csv", lines), workshop())
    assert "camera.csv" in str(error.value)


def test_a_csv_needs_its_header_and_a_scene(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text("t,x,y\n")
    with pytest.raises(TrackError, match="header must be time,node,x,y,yaw,push"):
        Track.load(path, workshop())
    with pytest.raises(TrackError, match="does not hold its scene"):
        Track.load(path)


def test_a_truncated_or_foreign_hdf5_file_is_refused(track: Track, tmp_path: Path) -> None:
    path = tmp_path / "track.h5"
    track.save(path)
    whole = path.read_bytes()
    for size in (0, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(TrackError, match="track.h5"):
            Track.load(path)
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "other"
    with pytest.raises(TrackError, match="not a track"):
        Track.load(path)
    with pytest.raises(TrackError, match="cannot read this track"):
        Track.load(tmp_path / "nowhere.h5")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("nodes", [1, 2, 3, 4, 5]),
        ("times", "noon"),
        ("times", [[0.0, 0.05]]),
        ("times", 1.0),
        ("push", [0.5] * 5),
        ("seen", [1] * 5),
        ("poses", None),
    ],
)
def test_hdf5_arrays_of_another_kind_are_refused(track: Track, tmp_path: Path, name: str, value) -> None:
    path = tmp_path / "track.h5"
    track.save(path)
    with h5py.File(path, "a") as file:
        del file[name]
        if value is None:
            file.create_group(name)
        else:
            file[name] = value
    with pytest.raises(TrackError, match="track.h5"):
        Track.load(path)


def test_hdf5_attributes_of_another_kind_are_refused(track: Track, tmp_path: Path) -> None:
    path = tmp_path / "track.h5"
    for name, value in (("scene", 3), ("format", [1, 2]), ("version", [1, 2]), ("version", 2)):
        track.save(path)
        with h5py.File(path, "a") as file:
            file.attrs[name] = value
        with pytest.raises(TrackError, match="track.h5"):
            Track.load(path)


def test_a_turned_body_starts_at_its_scene_s_pose() -> None:
    turned = Scene(bodies=(body("plate", 0.0, -0.3, yaw=3.5),))
    assert simulate(turned).poses[0, 1] == pytest.approx([0.0, -0.3, 3.5])


def test_arrays_that_do_not_fit_are_refused(track: Track) -> None:
    poses = track.poses.copy()
    poses[3, 2, 0] = np.nan
    with pytest.raises(TrackError, match=r"pose of 'lid' at 0.15 s is \[nan"):
        replace(track, poses=poses)
    with pytest.raises(TrackError, match=r"poses: shape must be \(\d+, 5, 3\), got \(\d+, 2, 3\)"):
        replace(track, poses=track.poses[:, :2], seen=track.seen[:, :2])
    with pytest.raises(TrackError, match="times must rise"):
        replace(track, times=track.times[::-1].copy())


def test_what_cannot_be_written_leaves_the_old_file(track: Track, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("mine")
    with pytest.raises(StorageError, match="nothing was overwritten"):
        track.save(blocked / "track.h5")
    assert blocked.read_text() == "mine"


def test_csv_columns_are_as_documented(track: Track, tmp_path: Path) -> None:
    track.save(tmp_path / "track.csv")
    rows = list(csv.DictReader((tmp_path / "track.csv").open()))
    assert len(rows) == track.poses.shape[0] * track.poses.shape[1]
    assert {row["node"] for row in rows} == set(track.nodes)
    lifted = [row for row in rows if row["push"] == "-1"]
    assert len(lifted) == 2 * len(track.nodes)


@pytest.mark.parametrize("rate", [3.0, 7.0])
def test_what_is_glued_stays_glued_between_sightings(rate: float) -> None:
    """Bodies turn about centres from one sighting to the next, as one; the tool goes straight."""
    times = np.arange(0.0, 2.0, 1 / rate)
    first = np.stack((0.1 * times, 0.05 * np.sin(times), 1.5 * times - 0.3), -1)
    second = pose.compose(first, np.array([0.13, 0.02, 0.4]))
    tool = np.stack((0.2 * times, 0.0 * times, 3.0 * times), -1)
    seen = np.ones((len(times), 3), dtype=bool)
    samples = Frames(times, np.stack((tool, first, second), 1), np.zeros(len(times), dtype=int), seen)
    frames = in_frames(samples)
    assert len(frames.times) > 2 * len(times)
    together = pose.relative(frames.poses[:, 1], frames.poses[:, 2])
    np.testing.assert_allclose(together, np.tile([0.13, 0.02, 0.4], (len(together), 1)), atol=1e-12)
    np.testing.assert_allclose(frames.poses[:, 0, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(frames.poses[0, 1], first[0], atol=1e-12)
    exact = np.stack((0.1 * frames.times, 0.05 * np.sin(frames.times)), -1)
    assert np.abs(frames.poses[:, 1, :2] - exact).max() < 0.2 * 0.1 / rate
