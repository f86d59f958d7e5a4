"""Damaged recordings of every kind: an error or a track, never a traceback, a crash, or memory and time without end."""

import resource
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from scenes import body
from test_recording_readers import motive, write_bag, write_parquet

from pushgraph.errors import PushGraphError, TrackError
from pushgraph.recording.recording import read_recording
from pushgraph.recording.sightings import ReadOptions
from pushgraph.scene import Scene
from pushgraph.track import Track

MOST_SECONDS, MOST_BYTES = 20.0, 1_000_000_000
KINDS = ("csv", "wide", "motive", "h5", "bag", "SQLITE3", "MCAP", "parquet")
SCENE = Scene(bodies=(body("cup", 0.3, 0.2),))


def sound_file(kind: str, folder: Path) -> Path:
    """A recording of robot and cup that reads without a word."""
    times = np.arange(0, 1, 0.05)
    if kind in ("csv", "h5"):
        poses = np.zeros((len(times), 2, 3))
        poses[:, 0, 0], poses[:, 1] = 0.1 * times, (0.3, 0.2, 0.0)
        seen = np.ones((len(times), 2), dtype=bool)
        Track(SCENE, times, poses, np.zeros(len(times), dtype=int), seen).save(folder / f"track.{kind}")
        return folder / f"track.{kind}"
    if kind == "wide":
        lines = ["time,robot_x,robot_y,robot_yaw,cup_x,cup_y,cup_yaw", *(f"{t},{t / 10},0,0,0.3,0.2,0" for t in times)]
        (folder / "wide.csv").write_text("\n".join(lines))
        return folder / "wide.csv"
    if kind == "motive":
        return motive(folder / "take.csv")
    if kind == "parquet":
        return write_parquet(folder)
    path = write_bag(folder / ("push.bag" if kind == "bag" else "push"), kind)
    return path if kind == "bag" else next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed, cut out, doubled, cut off, or numbers in a text made huge, negative or no numbers at all."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        at, length = int(rng.integers(len(data))), int(rng.integers(1, 64))
        match int(rng.integers(7)):
            case 0:
                data[at] = int(rng.integers(256))
            case 1:
                data[at : at + length] = rng.bytes(length)
            case 2:
                del data[at : at + length]
            case 3:
                data[at:at] = data[at : at + length]
            case 4:
                data[at : at + 8] = b"\xff" * 8
            case 5:
                token = (b"1e300", b"nan", b"-1e6", b"1000000", b"inf", b'"', b"\n", b",,", b"\x00")[rng.integers(9)]
                data[at : at + len(token)] = token
            case 6 if rng.random() < 0.3:
                del data[at:]
        if not data:
            return b""
    return bytes(data)


def read(path: Path) -> bool:
    """Whether the recording reads; anything but an error of ours is a failure."""
    try:
        read_recording(path, SCENE, options=ReadOptions(episode=0)).believed().at_frames()
    except PushGraphError:
        return False
    return True


def status_bytes(name: str) -> int:
    """A line of this process's status."""
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(name)]
    return 1024 * int(line.split()[1])


def attack(kind: str, count: int, seed: int, folder: Path) -> None:
    path = sound_file(kind, folder)
    sound = path.read_bytes()
    assert read(path)
    rng = np.random.default_rng(seed)
    slowest, refused = 0.0, 0
    # What other tests in this process took does not count: its own peak is forgotten, that of children compared.
    Path("/proc/self/clear_refs").write_text("5")
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    held = status_bytes("VmRSS")
    for _ in range(count):
        path.write_bytes(mutated(sound, rng))
        began = time.perf_counter()
        refused += not read(path)
        slowest = max(slowest, time.perf_counter() - began)
    grown = status_bytes("VmHWM") - held
    peak_of_children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    print(
        f"{kind}: {count} files, {refused} refused, slowest {slowest:.1f} s, memory {grown / 1e6:.0f} MB more, "
        f"{peak_of_children / 1e6:.0f} MB in children"
    )
    assert slowest < MOST_SECONDS
    assert grown < MOST_BYTES
    assert peak_of_children < MOST_BYTES or peak_of_children == children


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_refused_or_read(kind: str, tmp_path: Path) -> None:
    attack(kind, 6, 0, tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_two_thousand_damaged_files_are_refused_or_read(kind: str, tmp_path: Path) -> None:
    attack(kind, 250, 1, tmp_path)


def hostile(path: Path, case: str) -> None:
    """An HDF5 track whose poses lead elsewhere, or claim what is not there."""
    with h5py.File(path, "a") as file:
        del file["poses"]
        if case == "virtual":
            layout = h5py.VirtualLayout(shape=(20, 2, 3), dtype="f8")
            layout[:] = h5py.VirtualSource(".", "poses", shape=(20, 2, 3))
            file.create_virtual_dataset("poses", layout)
        elif case == "external":
            file.create_dataset("poses", (20, 2, 3), "f8", external=[("/dev/zero", 0, h5py.h5f.UNLIMITED)])
        elif case == "huge":
            file.create_dataset("poses", (10**12, 2, 3), "f8", chunks=(1000, 2, 3))
        elif case == "packed":
            file.create_dataset("poses", (10**7, 2, 3), "f8", compression="gzip", fillvalue=0.0)
        elif case == "soft link":
            file["poses"] = h5py.SoftLink("/poses")
        elif case == "external link":
            file["poses"] = h5py.ExternalLink("other.h5", "/poses")


CASES = ("virtual", "external", "huge", "packed", "soft link", "external link")


@pytest.mark.parametrize("case", CASES)
def test_hostile_hdf5_is_refused_here_and_in_the_reader(case: str, tmp_path: Path) -> None:
    path = sound_file("h5", tmp_path)
    hostile(path, case)
    with pytest.raises(TrackError, match="poses: "):
        Track.load(path)
    with pytest.raises(TrackError, match="poses: "):
        read_recording(path, SCENE)


def test_clocks_that_leap_cost_no_memory(tmp_path: Path) -> None:
    path = sound_file("csv", tmp_path)
    lines = path.read_text().splitlines()
    for leap in ("1e6", "1e15", "1e300"):
        late = [f"{float(line.split(',')[0]) + float(leap)},{line.split(',', 1)[1]}" for line in lines[-2:]]
        path.write_text("\n".join([*lines[:-2], *late]))
        assert len(read_recording(path, SCENE).track.at_frames().times) <= 22
