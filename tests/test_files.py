"""Files that are none: devices, folders, pipes. Commands refuse them, and damaged files, and overwrite nothing."""

import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

import fuzz_networks
import fuzz_plans
import fuzz_pushes
import fuzz_tracks
import pytest
from fuzz_pool import Kind
from scenes import workshop
from test_damaged_recordings import sound_file

from pushgraph.cli import main
from pushgraph.errors import PushGraphError, SceneError, StorageError
from pushgraph.json_file import MOST_BYTES
from pushgraph.scene import Scene
from pushgraph.storage import replacing
from pushgraph.track import Track

KINDS = [*fuzz_plans.KINDS, *fuzz_pushes.KINDS, *fuzz_tracks.KINDS, *fuzz_networks.KINDS]
OF_NAME = {kind.name: kind for kind in KINDS}


def make_folder(path: Path) -> None:
    path.mkdir()
    (path / "kept").write_text("kept")


def make_device(path: Path) -> None:
    path.symlink_to("/dev/null")


NO_FILES = {"folder": make_folder, "pipe": os.mkfifo, "device": make_device}


def unchanged(path: Path) -> tuple[int, int]:
    """Kind of what stands at a path, and which it is."""
    status = path.stat()
    return stat.S_IFMT(status.st_mode), status.st_ino


@pytest.mark.parametrize("make", NO_FILES.values(), ids=NO_FILES)
def test_what_is_no_plain_file_is_not_replaced(make: Callable[[Path], None], tmp_path: Path) -> None:
    out = tmp_path / "out.h5"
    make(out)
    before = unchanged(out)
    with pytest.raises(StorageError, match="out.h5: cannot be written: it is (a folder|no plain file)"), replacing(out):
        pytest.fail("a temporary file was given")
    with pytest.raises(StorageError, match="nothing was overwritten"):
        Track.load(sound_file("h5", tmp_path)).save(out)
    assert unchanged(out) == before
    assert set(os.listdir(tmp_path)) == {"out.h5", "track.h5"}


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as exit_:
        main([str(argument) for argument in arguments])
    return int(exit_.value.code or 0)


@pytest.mark.parametrize("make", NO_FILES.values(), ids=NO_FILES)
def test_commands_do_not_begin_what_they_could_not_write(make: Callable[[Path], None], tmp_path: Path, capsys) -> None:
    (track,) = OF_NAME["track HDF5"].make(tmp_path)
    (data,) = OF_NAME["dataset"].make(tmp_path)
    pushes, _ = OF_NAME["recorded pushes"].make(tmp_path)
    out = tmp_path / "out.h5"
    make(out)
    before = unchanged(out)
    for command in (
        ("track", track, "--out", out),
        ("generate", "planar", "--objects", 3, "--count", 8, "--out", out),
        ("train", "physics", "--data", data, "--validation", data, "--out", out, "--processes", 1),
        ("adapt", "--data", pushes, "--outlines", tmp_path / "outlines.json", "--out", out),
    ):
        assert run(*command) == 1, command
        assert "cannot be written" in capsys.readouterr().err
    assert unchanged(out) == before
    assert not (tmp_path / "out.h5.parts").exists()


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_pipes_devices_and_folders_are_no_input(kind: Kind, tmp_path: Path) -> None:
    path = kind.make(tmp_path)[0]
    for make in (os.mkfifo, lambda place: place.symlink_to("/dev/zero"), Path.mkdir):
        path.unlink() if not path.is_dir() else path.rmdir()
        make(path)
        with pytest.raises(PushGraphError) as raised:
            kind.read(path)
        assert path.name in str(raised.value)


def test_a_text_too_large_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    with path.open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    with pytest.raises(SceneError, match="scene.json: cannot read this scene: it is larger than 64 MiB"):
        Scene.load(path)


COMMANDS = {
    "scene": ("simulate", "FILE", "--out", "OUT"),
    "lever scene": ("simulate", "FILE", "--out", "OUT"),
    "tool": ("plan", "SCENE", "--goal", "cup", 0.3, 0.1, "--tools", "FILE", "--out", "OUT"),
    "beliefs": ("predict", "SCENE", "--relations", "believed", "--beliefs", "FILE", "--out", "OUT"),
    "recorded pushes": ("adapt", "--data", "FILE", "--outlines", "FOLDER/outlines.json", "--out", "OUT/a.safetensors"),
    "outlines of recorded pushes": (
        "adapt", "--data", "FOLDER/pushes.csv", "--outlines", "FILE", "--out", "OUT/a.safetensors"
    ),
    "paper JSON": ("track", "FILE", "--out", "OUT/track.h5"),
    "track CSV": ("observe", "SCENE", "FILE", "--out", "OUT"),
    "track HDF5": ("observe", "SCENE", "FILE", "--out", "OUT"),
    "sightings HDF5": ("track", "FILE", "--scene", "SCENE", "--out", "OUT/track.h5"),
    "recording of Motive": ("track", "FILE", "--out", "OUT/track.h5"),
    "dataset": ("train", "physics", "--data", "FILE", "--validation", "FILE", "--processes", 1, "--out", "OUT/a.st"),
    "checkpoint": ("predict", "SCENE", "--model", "FILE", "--out", "OUT"),
    "adaptation": ("predict", "SCENE", "--adaptation", "FILE", "--surface", "abs", "--out", "OUT"),
}  # fmt: skip


@pytest.mark.parametrize("name", COMMANDS)
def test_commands_end_with_status_1_at_a_damaged_file(name: str, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setenv("PUSHGRAPH_CACHE", str(tmp_path / "cache"))
    scene, out = tmp_path / "of-commands.json", tmp_path / "out"
    scene.write_text(workshop().to_json())
    path = next(path for path in OF_NAME[name].make(tmp_path) if path.name != "belief.safetensors")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2] + b"\xff,\n")
    before = path.read_bytes()
    places = {"FILE": path, "SCENE": scene, "OUT": out, "FOLDER": tmp_path}
    command = []
    for part in map(str, COMMANDS[name]):
        for word, place in places.items():
            part = part.replace(word, str(place))
        command.append(part)
    assert run(*command) == 1
    said = capsys.readouterr().err
    assert said.startswith("Error: ")
    assert path.name in said
    assert path.read_bytes() == before
    assert not out.exists() or not any(out.iterdir())
    shutil.rmtree(out, ignore_errors=True)
