"""Datasets: the same bytes on any number of workers and after any kill; nothing overwritten; clear errors."""

import contextlib
import functools
import hashlib
import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from pushgraph.checksum import checksum_line
from pushgraph.dataset import generate as generation
from pushgraph.dataset.generate import generate
from pushgraph.dataset.store import Dataset
from pushgraph.dataset.summary import table
from pushgraph.errors import DatasetError, SetupError, StorageError
from pushgraph.simulation.setups import draw_trajectory

COMMAND = Path(sys.executable).with_name("pushgraph")
SMALL = {"setup": "multiple-parts", "objects": 1, "count": 20, "seed": 5}


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def command(out: Path, workers: int = 2, **changes) -> list[str]:
    recipe = SMALL | changes
    setup = recipe.pop("setup")
    options = [part for name, value in recipe.items() for part in (f"--{name}", str(value))]
    return [str(COMMAND), "generate", setup, *options, "--out", str(out), "--workers", str(workers)]


@pytest.fixture(scope="module", autouse=True)
def drawn_once():
    """Draw every block but once in this process; what the tests are about is what becomes of it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generation, "draw_block", functools.cache(generation.draw_block))
        yield


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    return generate(**SMALL, out=tmp_path_factory.mktemp("small") / "data.h5")


def test_a_dataset_holds_the_tracks_that_its_setup_draws(small: Path) -> None:
    with Dataset(small) as dataset:
        assert len(dataset) == 20
        for index in (0, 7, 19, -1):
            stored, drawn = dataset[index], draw_trajectory("multiple-parts", 1, 5, index % 20)
            assert stored.scene == drawn.track.scene
            assert dataset.density[index] == drawn.density
            assert dataset.kind[index] == drawn.kind == "paper"
            np.testing.assert_array_equal(stored.poses, drawn.track.poses.astype(np.float32))
            np.testing.assert_array_equal(stored.push, drawn.track.push)
            np.testing.assert_allclose(stored.times, drawn.track.times)
        with pytest.raises(IndexError):
            dataset[20]


def test_the_closing_table_counts_what_is_in_the_file(small: Path) -> None:
    with Dataset(small) as dataset:
        rows = dataset.summary
        frames = sum(len(dataset[k].times) for k in range(20))
        lines = table(rows)
    assert rows["frames"].sum() == frames
    assert lines["frames"].startswith(f"{frames} ")
    assert lines["joints"] == "0 fixed, 0 revolute, 0 prismatic"
    assert lines["penetration"].startswith("at most 1 mm in 100.000% of frames")
    rows = rows.copy()
    rows["overlapping_frames"][0] = frames // 10
    rows["rejected_room"][3] = 2
    assert "in 90.0" in table(rows)["penetration"]
    assert "no room for a body: 2" in table(rows)["rejected scenes"]


def test_the_file_opens_in_any_viewer(small: Path) -> None:
    with h5py.File(small) as file:
        assert file.attrs["setup"] == "multiple-parts"
        assert file["poses"].shape == (2 * len(file["push"]), 3)
        assert json.loads(file["scenes"][0])["format"] == "pushgraph.scene"
        assert {"frames", "moved_bodies", "rejected_table"} <= set(file["summary"].dtype.names)


def test_two_workers_write_the_same_bytes_as_one(small: Path, tmp_path: Path) -> None:
    done = subprocess.run(command(tmp_path / "data.h5"), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "rejected scenes" in done.stdout
    assert digest(tmp_path / "data.h5") == digest(small)
    assert [path.name for path in tmp_path.iterdir()] == ["data.h5"]


@pytest.mark.slow
def test_ray_writes_the_same_bytes(small: Path, tmp_path: Path) -> None:
    pytest.importorskip("ray")
    done = subprocess.run([*command(tmp_path / "data.h5"), "--engine", "ray"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert digest(tmp_path / "data.h5") == digest(small)


@pytest.mark.slow
@pytest.mark.parametrize("kills", [10])
def test_killed_at_random_moments_it_ends_with_the_same_bytes(kills: int, tmp_path: Path) -> None:
    """Half of the kills come soon after the start, half soon after a further block is done; half are Ctrl-C."""
    recipe = {"setup": "multiple-parts", "objects": 4, "count": 48, "seed": 8}
    rng = random.Random(1)
    out, parts = tmp_path / "data.h5", tmp_path / "data.h5.parts"
    blocks_left = []
    for kill in range(kills):
        blocks, later = len(list(parts.glob("from_*.h5"))), (kill + kills) % 2
        process = subprocess.Popen(
            command(out, **recipe), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        while later and process.poll() is None and len(list(parts.glob("from_*.h5"))) == blocks:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.3 if later else 3.0))
        with contextlib.suppress(ProcessLookupError):  # on a fast machine it may be done
            os.killpg(process.pid, (signal.SIGKILL, signal.SIGINT)[kill // 2 % 2])
        process.wait()
        blocks_left.append(len(list(parts.glob("from_*.h5"))))
    assert any(0 < blocks < 6 for blocks in blocks_left)
    subprocess.run(command(out, **recipe), check=True, capture_output=True)
    assert [path.name for path in tmp_path.iterdir()] == ["data.h5"]
    subprocess.run(command(tmp_path / "unbroken.h5", workers=1, **recipe), check=True, capture_output=True)
    assert digest(out) == digest(tmp_path / "unbroken.h5")


def test_finished_blocks_are_not_drawn_again(small: Path, tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "data.h5"
    drawn: list[int] = []

    def draw(block):
        if len(drawn) == 2:
            raise KeyboardInterrupt
        drawn.append(block.first)
        return original(block)

    original = generation.draw_block
    monkeypatch.setattr(generation, "draw_block", draw)
    with pytest.raises(KeyboardInterrupt):
        generate(**SMALL, out=out)
    assert not out.exists()
    progress: list[int] = []
    monkeypatch.setattr(generation, "draw_block", original)
    generate(**SMALL, out=out, progress=progress.append)
    assert progress == [16, 20]
    assert digest(out) == digest(small)


def test_a_damaged_block_is_drawn_again(small: Path, tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "data.h5"
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(generation, "_join", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        generate(**SMALL, out=out)
    part = tmp_path / "data.h5.parts" / "from_00000008.h5"
    part.write_bytes(part.read_bytes()[:-100])
    generate(**SMALL, out=out)
    assert digest(out) == digest(small)


def test_parts_left_by_a_kill_at_the_very_end_are_cleared_away(tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "data.h5"
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(generation.shutil, "rmtree", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        generate(**SMALL, out=out)
    assert (tmp_path / "data.h5.parts").exists()
    generate(**SMALL, out=out)
    assert [path.name for path in tmp_path.iterdir()] == ["data.h5"]


def test_a_finished_dataset_is_left_alone(small: Path) -> None:
    before = small.stat().st_mtime_ns
    generate(**SMALL, out=small)
    assert small.stat().st_mtime_ns == before


@pytest.mark.parametrize(
    "change", [{"setup": "planar"}, {"objects": 2}, {"seed": 6}, {"count": 21}], ids=lambda change: next(iter(change))
)
def test_a_file_of_another_recipe_is_not_overwritten(small: Path, change: dict) -> None:
    before = digest(small)
    with pytest.raises(DatasetError, match=f"holds another dataset .*{next(iter(change))}"):
        generate(**SMALL | change, out=small)
    assert digest(small) == before


def test_the_beginning_of_another_recipe_is_not_overwritten(tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "data.h5"
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(generation, "_join", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        generate(**SMALL, out=out)
    with pytest.raises(DatasetError, match="beginning of another dataset .*seed"):
        generate(**SMALL | {"seed": 6}, out=out)
    generate(**SMALL, out=out)


@pytest.mark.parametrize("size", [0, 1000, -1000])
def test_a_truncated_file_is_refused_and_left_alone(small: Path, tmp_path: Path, size: int) -> None:
    out = tmp_path / "data.h5"
    out.write_bytes(small.read_bytes()[:size])
    before = digest(out)
    done = subprocess.run(command(out), capture_output=True, text=True)
    assert done.returncode == 1
    assert "truncated" in done.stderr
    assert "Traceback" not in done.stderr
    assert digest(out) == before


def test_damage_inside_the_data_is_noticed(small: Path, tmp_path: Path) -> None:
    out = tmp_path / "data.h5"
    whole = bytearray(small.read_bytes())
    with h5py.File(small) as file:
        chunk = file["poses"].id.get_chunk_info(0)
    whole[chunk.byte_offset + chunk.size // 2] ^= 0xFF
    out.write_bytes(whole)
    with pytest.raises(DatasetError, match="damaged"):
        Dataset(out)


def test_datasets_without_a_checksum_are_read_if_all_of_them_can_be(small: Path, tmp_path: Path) -> None:
    out, content = tmp_path / "data.h5", small.read_bytes()[: -len(checksum_line(b""))]
    out.write_bytes(content)
    with Dataset(out) as dataset, Dataset(small) as whole:
        np.testing.assert_array_equal(dataset[3].poses, whole[3].poses)
    with h5py.File(small) as file:
        chunk = file["poses"].id.get_chunk_info(0)
    damaged = bytearray(content)
    damaged[chunk.byte_offset + chunk.size // 2] ^= 0xFF
    out.write_bytes(damaged)
    with pytest.raises(DatasetError, match="cannot be read"):
        Dataset(out)


def test_a_foreign_file_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "data.h5"
    with h5py.File(out, "w") as file:
        file["x"] = [1]
    with pytest.raises(DatasetError, match="not a dataset"):
        generate(**SMALL, out=out)
    with pytest.raises(DatasetError, match="no such dataset"):
        Dataset(tmp_path / "nowhere.h5")


@pytest.mark.slow
def test_a_full_disk_is_a_clear_error_and_leaves_nothing_behind(tmp_path: Path) -> None:
    """A limit on file sizes fails writes as a full disk does."""

    def no_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    done = subprocess.run(command(tmp_path / "data.h5", workers=1), capture_output=True, text=True, preexec_fn=no_room)
    assert done.returncode == 1
    assert "cannot be written" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "data.h5").exists()
    subprocess.run(command(tmp_path / "data.h5", workers=1), check=True, capture_output=True)


def test_too_little_space_to_join_is_said_beforehand(small: Path, tmp_path: Path, monkeypatch) -> None:
    out = tmp_path / "data.h5"
    with (
        monkeypatch.context() as patch,
        pytest.raises(DatasetError, match=r"MiB left, .* needed .*run the same command"),
    ):
        patch.setattr(generation, "SPARE", 2**60)
        generate(**SMALL, out=out)
    generate(**SMALL, out=out)
    assert digest(out) == digest(small)


def test_two_processes_do_not_share_one_output(tmp_path: Path) -> None:
    out = tmp_path / "data.h5"
    process = subprocess.Popen(command(out, count=400), stdout=subprocess.DEVNULL, start_new_session=True)
    try:
        while not (tmp_path / "data.h5.parts" / "recipe.json").exists():
            time.sleep(0.05)
        with pytest.raises(DatasetError, match="another process"):
            generate(**SMALL | {"count": 400}, out=out)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"setup": "paper"}, SetupError, "no setup 'paper'; valid: multiple-parts, jointed, planar, planar-mixed"),
        ({"objects": 0}, DatasetError, "objects: must be from 1 to 1000, got 0"),
        ({"count": 0}, DatasetError, "count: must be from 1 to"),
        ({"seed": -1}, DatasetError, "seed: must be from 0 to"),
        ({"seed": 2**63}, DatasetError, "seed: must be from 0 to"),
        ({"objects": 1001}, DatasetError, "objects: must be from 1 to 1000"),
        ({"workers": 0}, DatasetError, "workers: must be from 1 to"),
        ({"engine": "spark"}, DatasetError, "no engine 'spark'; valid: processes, ray"),
    ],
)
def test_bad_settings_are_refused(tmp_path: Path, change: dict, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        generate(**SMALL | change, out=tmp_path / "data.h5")
    assert not list(tmp_path.iterdir())


def test_an_unwritable_place_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises((DatasetError, StorageError), match="file"):
        generate(**SMALL, out=tmp_path / "file" / "data.h5")
