"""Datasets of one's own tracks, and windows of them for a DataLoader."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import body, workshop
from torch.utils.data import DataLoader

import pushgraph as pg
from pushgraph.dataset.own import storable
from pushgraph.errors import DatasetError
from pushgraph.track import LIFTED, Track

ALONE = pg.Scene(
    bodies=(body("cup", 0.0, 0.0),), pushes=(pg.Push(start=(-0.2, 0.0), end=(-0.05, 0.01)),), tool=pg.Tool.round(0.05)
)


@pytest.fixture(scope="module")
def simulated() -> list[Track]:
    return [pg.simulate(workshop()), pg.simulate(ALONE)]


@pytest.fixture(scope="module")
def own(simulated, tmp_path_factory) -> Path:
    return pg.write_dataset(simulated, tmp_path_factory.mktemp("own") / "own.h5")


def faster(track: Track, hertz: float) -> Track:
    """The same motion at another rate, as a camera that saw it would tell it."""
    times = np.arange(0, track.times[-1], 1 / hertz)
    frame = np.searchsorted(track.times, times + 1e-9, "right") - 1
    poses = np.apply_along_axis(lambda column: np.interp(times, track.times, column), 0, track.poses)
    return Track(track.scene, times, poses, track.push[frame], track.seen[frame])


def test_tracks_come_back_as_they_were_whatever_their_bodies_and_frames(own: Path, simulated: list[Track]) -> None:
    with pg.Dataset(own) as dataset:
        assert len(dataset) == 2
        assert (dataset.recipe.setup, dataset.recipe.objects) == ("own", 4)
        for stored, track in zip((dataset[0], dataset[1]), simulated, strict=True):
            assert stored.scene == track.scene
            np.testing.assert_array_equal(stored.poses, track.poses.astype(np.float32))
            np.testing.assert_array_equal(stored.push, track.push)
            np.testing.assert_allclose(stored.wrench, track.wrench, rtol=1e-6)
    again = pg.write_dataset(iter(simulated), own.with_name("again.h5"))
    assert again.read_bytes() == own.read_bytes()


def test_other_rates_and_tracks_without_a_sensor_are_stored_in_frames(simulated: list[Track], tmp_path: Path) -> None:
    filmed = faster(simulated[1], 77.0)
    with pg.Dataset(pg.write_dataset([filmed], tmp_path / "own.h5")) as dataset:
        stored = dataset[0]
    np.testing.assert_allclose(np.diff(stored.times), 0.05)
    assert stored.wrench is None
    assert abs(len(stored.times) - len(simulated[1].times)) <= 3
    np.testing.assert_allclose(stored.poses[-1], simulated[1].poses[-1], atol=2e-3)


def test_where_a_body_is_lost_a_track_is_cut_and_its_scene_is_as_of_the_first_frame(simulated: list[Track]) -> None:
    track = simulated[0]
    seen = track.seen.copy()
    (pushed,) = np.nonzero(track.push == 0)
    lost = int(pushed[len(pushed) // 2])
    seen[lost : lost + 2, 1] = False
    first, second = storable(Track(track.scene, track.times, track.poses, track.push, seen))
    assert len(first.times) == lost
    np.testing.assert_array_equal(second.poses, track.poses[lost + 2 :])
    np.testing.assert_allclose(second.scene.poses_world_from_body, second.poses[0, 1:], atol=2e-3)
    assert first.scene.pushes == second.scene.pushes == ()
    # The hinge has gone with its plate.
    (joint,), plate = second.scene.joints, second.poses[0, 1]
    expected = pg.Scene.from_json(track.scene.to_json()).joints[0].anchor - track.poses[0, 1, :2]
    turn = plate[2] - track.poses[0, 1, 2]
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    np.testing.assert_allclose(joint.anchor, plate[:2] + rotation @ expected, atol=2e-3)


def test_polygons_are_stored_as_the_parts_that_networks_know(tmp_path: Path) -> None:
    corner = pg.Polygon(points=((0, 0), (0.12, 0), (0.12, 0.04), (0.04, 0.04), (0.04, 0.12), (0, 0.12)))
    track = pg.simulate(ALONE.replace(bodies=(body("corner", 0.0, -0.05, corner),)))
    with pg.Dataset(pg.write_dataset([track], tmp_path / "own.h5")) as dataset:
        stored = dataset[0]
    parts = len(corner.parts)
    assert len(stored.scene.bodies) == parts > 1
    assert [len(group) for group in stored.scene.rigid_groups] == [parts]
    np.testing.assert_allclose(stored.scene.poses_world_from_body, stored.poses[0, 1:], atol=1e-6)
    # They stay where they are in the body.
    first = stored.poses[:, 1:] - stored.poses[:, 1:2]
    np.testing.assert_allclose(np.hypot(*first[-1, :, :2].T), np.hypot(*first[0, :, :2].T), atol=1e-6)


def test_what_cannot_be_stored_is_refused_in_words(simulated: list[Track], tmp_path: Path) -> None:
    track, out = simulated[1], tmp_path / "own.h5"

    def changed(**fields) -> Track:
        return Track(**{"scene": track.scene, "times": track.times, "poses": track.poses, "push": track.push} | fields)

    lifted = changed(push=np.full_like(track.push, LIFTED), seen=track.seen)
    unseen = np.concatenate((track.seen[:, :1], np.zeros_like(track.seen[:, 1:])), 1)
    far = track.poses + [5.0, 0.0, 0.0]
    for tracks, says in (
        ([track, lifted], r"tracks\[1\]: the tool is never down"),
        ([changed(seen=unseen)], r"tracks\[0\]: there is no push .*: 'cup' is not at 0 s"),
        ([changed(poses=far, seen=track.seen)], r"tracks\[0\]: .*body 'cup'.* stands off the table"),
        ([], "tracks: at least one is needed"),
        ([track.scene], r"tracks\[0\]: must be a Track, got Scene; .*lever"),
    ):
        with pytest.raises(DatasetError, match=says):
            pg.write_dataset(iter(tracks), out)
    assert not out.exists()


def test_every_window_is_there_once_and_is_what_the_track_holds(own: Path, simulated: list[Track]) -> None:
    windows = pg.WindowDataset(own, frames=5)
    expected = {
        (k, s)
        for k, track in enumerate(simulated)
        for s in range(len(track.push) - 4)
        if track.push[s] >= 0 and track.push[s] == track.push[s + 4]
    }
    items = list(windows)
    assert len(items) == len(windows) == len(expected)
    assert {(int(item.trajectory), int(item.start)) for item in items} == expected
    for item in items[:: len(items) // 7]:
        track, start, nodes = simulated[int(item.trajectory)], int(item.start), int(item.nodes)
        np.testing.assert_array_equal(item.poses[:, :nodes], track.poses[start : start + 5].astype(np.float32))
        np.testing.assert_array_equal(item.initial_poses[:nodes], track.poses[0].astype(np.float32))
        assert not item.poses[:, nodes:].any()
        assert bool(item.push_start) == bool(track.push_start[start])
    assert windows.scene(1) == simulated[1].scene
    with pytest.raises(IndexError):
        windows[len(windows)]


def digest(windows: pg.WindowDataset, workers: int) -> str:
    generator = torch.Generator().manual_seed(1)
    loader = DataLoader(windows, batch_size=16, shuffle=True, num_workers=workers, generator=generator)
    content = hashlib.sha256()
    for batch in loader:
        assert isinstance(batch, pg.Window)
        for field in batch:
            content.update(field.numpy().tobytes())
    return content.hexdigest()


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_any_number_of_workers_gives_the_same_bytes(own: Path, monkeypatch) -> None:
    windows = pg.WindowDataset(own, frames=5, count=100, seed=4)
    alone = digest(windows, 0)
    assert alone == digest(pg.WindowDataset(own, frames=5, count=100, seed=4), 2)
    assert alone == digest(windows, 2)  # the file is open here already: a worker opens it anew
    assert alone != digest(pg.WindowDataset(own, frames=5, count=100, seed=5), 0)
    monkeypatch.setattr("pushgraph.dataset.window_dataset.IN_MEMORY", 0)
    assert alone == digest(pg.WindowDataset(own, frames=5, count=100, seed=4), 0)


def test_drawn_windows_are_of_all_trajectories_alike(own: Path) -> None:
    windows = pg.WindowDataset(own, frames=5, count=600)
    share = np.mean([int(windows[k].trajectory) for k in range(600)])
    assert share == pytest.approx(0.5, abs=0.07)
    for settings, says in (({"frames": 0}, "frames: must be at least 1, got 0"), ({"count": 0}, "count: must be")):
        with pytest.raises(DatasetError, match=says):
            pg.WindowDataset(own, **settings)
    with pytest.raises(DatasetError, match="no push lasts 5000 frames"):
        pg.WindowDataset(own, frames=5000)


@pytest.mark.slow
def test_own_data_of_different_sizes_is_trained_on(own: Path, simulated: list[Track], tmp_path: Path) -> None:
    validation = pg.write_dataset(simulated[:1], tmp_path / "validation.h5")
    training = pg.PhysicsTraining(
        model="contact", data=str(own), validation=str(validation), samples=16, hidden=8, batch=4
    )
    pg.train_physics(training, pg.TrainingRun(out=str(tmp_path / "own.safetensors")))
    assert pg.load(tmp_path / "own.safetensors").record["data"]["setup"] == "own"
