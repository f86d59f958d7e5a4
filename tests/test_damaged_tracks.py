"""Damaged HDF5 tracks: an error, or the track as it was saved; never a crash, and no search without end."""

import subprocess
import time
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from test_damaged_recordings import MOST_SECONDS, mutated, sound_file

from pushgraph.checksum import checksum_line, is_intact
from pushgraph.errors import TrackError
from pushgraph.track import Track

LINE = len(checksum_line(b""))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return sound_file("h5", tmp_path)


@pytest.fixture
def no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_, **__) -> None:
        pytest.fail("a process was started")

    monkeypatch.setattr(subprocess, "run", refuse)


def load(path: Path) -> Track | None:
    """The track, in time; None if it is refused."""
    began = time.perf_counter()
    try:
        return Track.load(path)
    except TrackError:
        return None
    finally:
        assert time.perf_counter() - began < MOST_SECONDS


def same(track: Track, other: Track) -> bool:
    fields = ("times", "poses", "push", "seen")
    return track.scene == other.scene and all(
        np.array_equal(getattr(track, name), getattr(other, name)) for name in fields
    )


def test_a_file_ends_with_the_checksum_of_its_bytes(path: Path) -> None:
    content = path.read_bytes()
    assert content[-LINE:] == b"\npushgraph crc32 %08x\n" % zlib.crc32(content[:-LINE])
    assert is_intact(path)
    path.write_bytes(b"other")
    assert is_intact(path) is None
    path.write_bytes(b"other" + checksum_line(b"others"))
    assert is_intact(path) is False
    path.write_bytes(b"")
    assert is_intact(path) is None


def test_the_same_track_makes_the_same_bytes(path: Path, tmp_path: Path) -> None:
    Track.load(path).save(tmp_path / "again.h5")
    assert (tmp_path / "again.h5").read_bytes() == path.read_bytes()


@pytest.mark.usefixtures("no_process")
def test_an_intact_file_is_read_without_another_process(path: Path) -> None:
    assert load(path) is not None


@pytest.mark.usefixtures("no_process")
def test_any_changed_bit_of_a_saved_track_is_noticed_before_it_is_opened(path: Path) -> None:
    content = path.read_bytes()
    rng = np.random.default_rng(0)
    anywhere = rng.integers(len(content) - LINE, size=400).tolist()
    for at in [*range(100), *anywhere, *range(len(content) - 9, len(content))]:
        changed = bytearray(content)
        changed[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(changed)
        with pytest.raises(TrackError, match="track.h5: cannot read this track: the file is damaged"):
            Track.load(path)


def check_cut(path: Path, lengths: list[int]) -> None:
    """A file cut off is refused, unless no more is missing than its checksum."""
    content, whole = path.read_bytes(), Track.load(path)
    for length in lengths:
        path.write_bytes(content[:length])
        track = load(path)
        assert track is None or (length >= len(content) - LINE and same(track, whole))


def test_files_cut_off_are_refused(path: Path) -> None:
    size = path.stat().st_size
    check_cut(path, [0, 7, 100, size // 2, size - LINE - 1, size - LINE, size - LINE + 5, size - 5, size - 1])


def test_files_that_other_programs_changed_are_read(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file["poses"][3, 1, 0] = 0.125
    assert is_intact(path) is None
    track = load(path)
    assert track is not None
    assert track.poses[3, 1, 0] == 0.125


def test_files_without_a_checksum_read_the_same(path: Path) -> None:
    content, whole = path.read_bytes(), Track.load(path)
    path.write_bytes(content[:-LINE])
    assert same(Track.load(path), whole)


def attack_without_checksum(path: Path, count: int, seed: int) -> None:
    content = path.read_bytes()[:-LINE]
    rng = np.random.default_rng(seed)
    slowest, refused = 0.0, 0
    for _ in range(count):
        path.write_bytes(mutated(content, rng))
        began = time.perf_counter()
        refused += load(path) is None
        slowest = max(slowest, time.perf_counter() - began)
    print(f"{count} files, {refused} refused, slowest {slowest:.1f} s")


def test_damaged_files_without_a_checksum_end_in_time(path: Path) -> None:
    attack_without_checksum(path, 12, 0)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_hundreds_of_damaged_files_without_a_checksum_end_in_time(path: Path) -> None:
    attack_without_checksum(path, 400, 1)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_files_cut_off_anywhere_are_refused(path: Path) -> None:
    check_cut(path, list(range(0, path.stat().st_size, 61)))


@pytest.mark.slow
@pytest.mark.usefixtures("no_process")
def test_thousands_of_damaged_saved_tracks_are_refused(path: Path) -> None:
    content = path.read_bytes()
    rng = np.random.default_rng(2)
    for _ in range(5000):
        damaged = mutated(content[:-LINE], rng)
        path.write_bytes(damaged + content[-LINE:])
        assert (load(path) is None) == (damaged != content[:-LINE])
