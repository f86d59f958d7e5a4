"""Every kind of file that pushgraph reads: a sound one, how it is read, and what another way of reading it finds."""

import contextlib
import csv
import dataclasses
import gzip
import io
import json
import math
import re
import shutil
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import torch
from fuzz import of_bytes, of_csv, of_hdf5, of_json, of_svg, of_tensors
from fuzz_pool import Kind
from made_pushes import OUTLINES, rows_of, write
from safetensors.torch import load as tensors_of
from scenes import workshop
from test_damaged_recordings import SCENE, sound_file
from test_paper_json import content as paper_content

from pushgraph.adaptation.adapted import Adaptation, Adapted
from pushgraph.adaptation.correction import Correction
from pushgraph.adaptation.files import load_adaptation, save_adaptation
from pushgraph.adaptation.gaussian_process import GaussianProcess
from pushgraph.adaptation.unknowns import Estimate
from pushgraph.belief_history import BeliefHistory
from pushgraph.believed_joint import BelievedJoint
from pushgraph.believed_mass import BelievedMass
from pushgraph.checkpoint import KINDS as NETWORKS
from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from pushgraph.checksum import checksum_line, is_intact
from pushgraph.dataset import generate as generation
from pushgraph.dataset.lever_store import LeverColumns, LeverDataset
from pushgraph.dataset.ragged import RaggedFile, Recipe
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.mass_history import MassHistory
from pushgraph.planning.plan import Plan, load_plan
from pushgraph.planning.tools import load_tool
from pushgraph.real_pushes import outline_of, read_outlines, read_pushes
from pushgraph.recording.files import read_sightings, save_sightings
from pushgraph.recording.recording import read_recording
from pushgraph.recording.sightings import COLUMNS as SIGHTED
from pushgraph.recording.sightings import ReadOptions
from pushgraph.scene import Scene
from pushgraph.simulation.lever_setup import draw_interaction
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.spread import Spread
from pushgraph.svg import outline_from_svg
from pushgraph.track import Track
from pushgraph.training.running import Progress, RunningCheckpoint

PACKAGE = Path(str(files("pushgraph")))
NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
DRAWING = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 200"><g transform="translate(10 5)">'
    '<path id="part" d="M 10 10 L 90 12 L 95 60 L 50 80 L 12 70 Z"/></g></svg>'
)


def agrees(stated: Any, loaded: Any) -> bool:
    """Whether all that a JSON text states is in what was loaded, which may say more; null states nothing."""
    if isinstance(stated, dict):
        return isinstance(loaded, dict) and all(
            value is None and loaded.get(name) is None or name in loaded and agrees(value, loaded[name])
            for name, value in stated.items()
        )
    if isinstance(stated, list):
        return isinstance(loaded, list | tuple) and len(stated) == len(loaded) and all(map(agrees, stated, loaded))
    if isinstance(stated, float) and math.isnan(stated):
        return isinstance(loaded, float) and math.isnan(loaded)
    if isinstance(stated, bool) or isinstance(loaded, bool) or stated is None or isinstance(stated, str):
        return type(stated) is type(loaded) and stated == loaded
    return isinstance(loaded, int | float) and (stated == loaded or math.isclose(stated, loaded, rel_tol=1e-12))


def strictly(content: bytes) -> Any:
    """JSON text in UTF-8, no key of an object twice."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        assert len({name for name, _ in pairs}) == len(pairs), "a key stands twice"
        return dict(pairs)

    return json.loads(content.decode(), object_pairs_hook=once)


def states_json(content: bytes, loaded: Any, without: Sequence[str] = ()) -> bool:
    stated = strictly(content)
    return agrees({name: stated[name] for name in stated if name not in (*without, "checksum")}, loaded)


def has_checksum(content: bytes) -> bool:
    try:
        return "checksum" in json.loads(content)
    except (ValueError, TypeError, RecursionError):
        return False


def reseal_json(tree: Any) -> Any:
    """With its checksum made anew."""
    if isinstance(tree, dict) and "checksum" in tree:
        from pushgraph.json_file import sealed

        del tree["checksum"]
        return sealed(tree)
    return tree


def json_kind(
    name: str,
    make: Callable[[Path], Sequence[Path]],
    read: Callable[[Path], Any],
    states: Callable[[bytes, Any], bool] = states_json,
) -> Kind:
    mutation = of_json(reseal_json)
    return Kind(name, make, read, (of_bytes, mutation, mutation), states, has_checksum)


def written(folder: Path, name: str, text: str) -> list[Path]:
    (folder / name).write_text(text)
    return [folder / name]


def as_tree(record: Any) -> Any:
    return json.loads(record.to_json() if hasattr(record, "to_json") else record.model_dump_json())


# Scenes, tools, plans, beliefs, trajectories


def make_plan(folder: Path) -> list[Path]:
    times, bodies = np.arange(3) * 0.05, len(workshop().bodies)
    poses = np.tile(np.vstack((np.zeros(3), workshop().poses_world_from_body)), (3, 1, 1))
    track = Track(workshop(), times, poses, np.zeros(3, dtype=int), np.ones((3, 1 + bodies), dtype=bool))
    Plan("stick", workshop(), track, 0.012).save(folder / "plan.json")
    return [folder / "plan.json"]


def read_plan(path: Path) -> Any:
    tool, scene = load_plan(path)
    return {"tool": tool, "scene": as_tree(scene)}


def states_plan(content: bytes, loaded: Any) -> bool:
    stated = strictly(content)
    numbers = [stated["cost"], *(value for pose in stated["expected_end"].values() for value in pose)]
    assert all(type(value) in (int, float) and math.isfinite(value) for value in numbers)
    assert set(stated) - {"checksum"} == {"format", "version", "tool", "cost", "expected_end", "scene"}
    return agrees({name: stated[name] for name in ("tool", "scene")}, loaded)


def make_beliefs(folder: Path) -> list[Path]:
    scene, times = workshop(), np.array([0.0, 0.05, 0.1])
    names = [one.name for one in scene.classes_of_mass]
    share = np.full((3, 2, len(names)), 1 / len(names))
    quantiles = np.tile([0.5, 0.4, 0.7], (3, 2, 1))
    masses = [
        BelievedMass(body, dict.fromkeys(names, 1 / len(names)), (0.5, 0.4, 0.7), (2.0, 1.5, 3.0), {other: (1.0, 0.9, 1.2)})
        for body, other in (("plate", "lid"), ("cup", "plate"))
    ]
    joints = [
        BelievedJoint("plate", "lid", "revolute", 0.9, (0.06, 0.05), 0.002, None, None, (-0.1, 0.4)),
        BelievedJoint("plate", "cup", "prismatic", 0.7, None, None, (1.0, 0.0), 0.02, (0.0, 0.02)),
    ]
    pairs = [("plate", "lid"), ("plate", "cup"), ("lid", "cup")]
    probabilities = np.tile([0.1, 0.2, 0.3, 0.4], (3, 3, 1))
    history = MassHistory(names, times, share, quantiles, masses)
    lost = {"cup": [(0.0, 0.05)]}
    BeliefHistory(pairs, times, probabilities, lost, joints, scene, history).save(folder / "beliefs.json")
    BeliefHistory(pairs, times, probabilities, {}, [], scene).save(folder / "joints.json")
    return [folder / "beliefs.json", folder / "joints.json"]


def read_beliefs(path: Path) -> Any:
    history = BeliefHistory.load(path)
    with tempfile.TemporaryDirectory() as folder:
        history.save(Path(folder) / "again.json")
        content = json.loads((Path(folder) / "again.json").read_text())
    content.pop("checksum", None)
    return content


def states_beliefs(content: bytes, loaded: Any) -> bool:
    """The numbers are written to five places, and what is a probability is one."""
    stated = strictly(content)
    shares = np.array(stated["probabilities"], dtype=float)
    assert (shares >= 0).all() and np.allclose(shares.sum(-1), 1, atol=1e-3)
    assert (np.diff(stated["times"]) > 0).all()
    return agrees(rounded({k: v for k, v in stated.items() if k not in ("checksum", "scene")}), rounded(loaded)) and (
        agrees(stated["scene"], loaded["scene"])
    )


def rounded(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {name: rounded(value) for name, value in tree.items()}
    if isinstance(tree, list):
        return [rounded(value) for value in tree]
    return round(tree, 5) if isinstance(tree, float) else tree


def make_joint_trajectory(folder: Path) -> list[Path]:
    times = np.array([0.0, 0.5, 1.25])
    arrays = [np.random.default_rng(k).normal(size=(3, 2)) for k in range(3)]
    JointTrajectory.of(["shoulder", "elbow"], times, *arrays).save(folder / "joint_trajectory.json")
    return [folder / "joint_trajectory.json"]


def make_parts(folder: Path) -> list[Path]:
    with generation._parts_folder(folder / "data.h5", PARTS):
        pass
    return [folder / "data.h5.parts" / "recipe.json"]


PARTS = Recipe("planar", 3, 0, 0, 2, "of a test")


def read_parts(path: Path) -> Any:
    generation._check_recipe(path.parent, PARTS)
    return dataclasses.asdict(PARTS)


# Outlines and recorded pushes


def read_outline(path: Path) -> Any:
    return outline_from_svg(path, 0.001).points


def states_drawing(content: bytes, points: Any) -> bool:
    """The XML is whole, every path draws all that it says, and of straight lines the corners are where they stand."""
    root = ElementTree.fromstring(content)
    paths = [one.get("d") or "" for one in root.iter() if one.tag.endswith("path")]
    number = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
    grammar = rf"\s*[Mm]\s*{number}([\s,]*({number}|[MmLlHhVvZzCcSsQqTtAa]))*\s*"
    return bool(paths) and all(re.fullmatch(grammar, path, re.ASCII) for path in paths)


def make_outlines(folder: Path) -> list[Path]:
    shapes = OUTLINES | {"egg": {"ellipse": [0.1, 0.06]}, "tri": {"polygon": [[0, 0], [0.1, 0], [0.02, 0.08]]}}
    return [write(folder, rows_of(2, "box"), shapes)[1]]


def read_shapes(path: Path) -> Any:
    return {name: outline_of(shape).tolist() for name, shape in read_outlines(path).items()}


def states_outlines(content: bytes, loaded: Any) -> bool:
    stated = strictly(content)
    assert set(stated) == set(loaded)
    for name, outline in stated.items():
        ((kind, numbers),) = outline.items()
        points = np.array(loaded[name])
        given = np.array(numbers if kind == "polygon" else [numbers])
        assert given.dtype.kind in "if" and given.shape[1:] == (2,), "no plain numbers"
        if kind == "polygon":
            nearest = np.abs(points[:, None] - given[None]).max(-1)
            assert (nearest.min(1) < 1e-9).all() and (nearest.min(0) < 1e-9).all()
        else:
            assert np.allclose(np.ptp(points, axis=0), given[0], rtol=1e-2)
    return True


def make_pushes(folder: Path) -> list[Path]:
    rows = [*rows_of(4, "box"), *rows_of(3, "disc", 1, "wood")]
    data, _ = write(folder, [row | {"poly4_x1": 0.0, "poly4_y1": 0.1, "poly4_yaw1": 0.2} for row in rows])
    (folder / "packed.csv").write_bytes(gzip.compress(data.read_bytes(), mtime=0))
    return [data, folder / "packed.csv"]


def read_table(path: Path) -> Any:
    pushes = read_pushes(path, path.parent / "outlines.json")
    columns = {
        "surface": pushes.surface, "shape": pushes.shape, "speed_mm_s": pushes.speed * 1e3,
        **dict(zip(("x0", "y0", "yaw0"), pushes.before.T, strict=True)),
        **dict(zip(("x1", "y1", "yaw1"), pushes.after.T, strict=True)),
        **dict(zip(("tip_x0", "tip_y0"), pushes.probe_start.T, strict=True)),
        **dict(zip(("tip_x1", "tip_y1"), pushes.probe_end.T, strict=True)),
    }  # fmt: skip
    for model, poses in pushes.stated.items():
        columns |= dict(zip((f"{model}_x1", f"{model}_y1", f"{model}_yaw1"), poses.T, strict=True))
    return {name: values.tolist() for name, values in columns.items()}


def states_table(content: bytes, loaded: Any) -> bool:
    text = (gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content).decode("utf-8-sig")
    header, *rows = [row for row in csv.reader(io.StringIO(text, newline=""), strict=True) if row]
    assert len(set(header)) == len(header), "a column stands twice"
    assert all(len(row) == len(header) for row in rows), "a row of another length"
    of_column = dict(zip(header, zip(*rows, strict=True), strict=True))
    unread = [name for name in header if name not in loaded]
    assert not any(name.startswith("poly4") for name in unread) or not all(
        f"poly4_{c}" in header for c in ("x1", "y1", "yaw1")
    )
    return all(same_cells(of_column[name], loaded[name]) for name in loaded)


def same_cells(cells: Sequence[str], values: Sequence[Any]) -> bool:
    """Whether cells hold these numbers or names; of NaN no number."""
    if len(cells) != len(values):
        return False
    for cell, value in zip(cells, values, strict=True):
        if isinstance(value, str):
            same = value in (cell, cell.strip())
        elif math.isnan(value):
            same = not NUMBER.fullmatch(cell) or not math.isfinite(float(cell))
        else:
            same = bool(NUMBER.fullmatch(cell)) and math.isclose(float(cell), value, rel_tol=1e-9, abs_tol=1e-15)
        if not same:
            return False
    return True


def gzipped(mutation: Callable[[bytes, Random], bytes]) -> Callable[[bytes, Random], bytes]:
    """The mutation of what is packed, where it is."""

    def inner(content: bytes, rng: Random) -> bytes:
        if content[:2] != b"\x1f\x8b":
            return mutation(content, rng)
        return gzip.compress(mutation(gzip.decompress(content), rng), mtime=0)

    return inner


# Tracks and recordings


def long_rows(content: bytes) -> tuple[list[str], list[list[str]]]:
    encodings = ["utf-16"] if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ["utf-8-sig", "cp1252", "latin-1"]
    for encoding in encodings:
        with contextlib.suppress(UnicodeDecodeError):
            text = content.decode(encoding)
            break
    header, *rows = [row for row in csv.reader(io.StringIO(text, newline="")) if any(cell.strip() for cell in row)]
    return [name.strip() for name in header], rows


def read_track(path: Path) -> Any:
    track = Track.load(path, SCENE if path.suffix == ".csv" else None)
    arrays = {name: getattr(track, name) for name in ("times", "poses", "push", "seen", "wrench")}
    arrays |= {} if track.spread is None else track.spread._asdict()
    return {"scene": as_tree(track.scene)} | {
        name: None if values is None else (values.shape, np.asarray(values, dtype=float).tobytes())
        for name, values in arrays.items()
    }


def states_csv_track(content: bytes, loaded: Any) -> bool:
    """Every line is one pose of the track, in order, and the track has no other."""
    header, rows = long_rows(content)
    arrays = {name: np.frombuffer(loaded[name][1]).reshape(loaded[name][0]) for name in ("times", "poses", "push", "seen")}
    nodes, counted = ("robot", *SCENE.names), 0
    assert len(set(header)) == len(header)
    for row in rows:
        assert len(row) == len(header)
        cells = dict(zip(header, map(str.strip, row), strict=True))
        assert NUMBER.fullmatch(cells["time"])
        frame = int(np.flatnonzero(arrays["times"] == float(cells["time"]))[0])
        node = nodes.index(cells["node"])
        if not arrays["seen"][frame, node]:
            assert cells["x"] == cells["y"] == ""
            continue
        counted += 1
        assert same_cells([cells[c] for c in ("x", "y", "yaw")], arrays["poses"][frame, node].tolist())
        if node == 0:
            assert int(cells["push"]) == arrays["push"][frame]
    return counted == int(arrays["seen"].sum())


def states_h5_track(content: bytes, loaded: Any) -> bool:
    with h5py.File(io.BytesIO(content), "r") as file:
        fields = [name for name in loaded if name != "scene" and loaded[name] is not None]
        for name in fields:
            array = file[name if name in file else f"spread/{name}"]
            assert not array.is_virtual and not array.external
            if loaded[name] != (array.shape, np.asarray(array[()], dtype=float).tobytes()):
                return False
        assert ("wrench" in file) == (loaded["wrench"] is not None)
        assert [name.decode() for name in file["nodes"][()]] == ["robot", *SCENE.names]
        return agrees(strictly(file.attrs["scene"].encode()), loaded["scene"])


def make_h5_tracks(folder: Path, sealed: bool = True) -> list[Path]:
    times = np.arange(0, 1, 0.05)
    poses = np.zeros((len(times), 2, 3))
    poses[:, 0, 0], poses[:, 1] = 0.1 * times, (0.3, 0.2, 0.0)
    seen, push = np.ones((len(times), 2), dtype=bool), np.zeros(len(times), dtype=int)
    wrench = np.random.default_rng(0).normal(size=(len(times), 3))
    spread = Spread(*(np.full((len(times), 1), 2.0 + k) for k in range(len(Spread._fields))))
    Track(SCENE, times, poses, push, seen, wrench, spread).save(folder / "track.h5")
    if not sealed:
        unseal(folder / "track.h5")
    return [folder / "track.h5"]


def unseal(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: -len(checksum_line(b""))])


def reseal(content: bytes) -> bytes:
    end = content.rfind(b"\npushgraph crc32 ")
    content = content[:end] if end >= 0 and len(content) - end < 40 else content
    return content + checksum_line(content)


def has_line(content: bytes) -> bool:
    with tempfile.NamedTemporaryFile() as file:
        file.write(content)
        file.flush()
        return is_intact(Path(file.name)) is not None


def make_lever_track(folder: Path) -> list[Path]:
    draw_interaction(5, 0).track.save(folder / "lever.h5")
    return [folder / "lever.h5"]


def read_lever_track(path: Path) -> Any:
    track = LeverTrack.load(path)
    return {"scene": as_tree(track.scene), "poses": (track.poses.shape, np.asarray(track.poses, float).tobytes())}


def states_lever_track(content: bytes, loaded: Any) -> bool:
    with h5py.File(io.BytesIO(content), "r") as file:
        poses = file["poses"]
        assert not poses.is_virtual and not poses.external
        assert [name.decode() for name in file["nodes"][()]] == ["tool", *(b["name"] for b in loaded["scene"]["bodies"])]
        same = loaded["poses"] == (poses.shape, np.asarray(poses[()], dtype=float).tobytes())
        return same and agrees(strictly(file.attrs["scene"].encode()), loaded["scene"])


def read_sighted(path: Path) -> Any:
    """What stands in the recording, which must also do as a track, or be refused."""
    options = ReadOptions(episode=0)
    sightings = read_sightings(path, options)
    read_recording(path, SCENE, options=options).believed().at_frames()
    columns = {name: getattr(sightings, name).tolist() for name in SIGHTED}
    return {"names": list(sightings.names)} | {
        name: [None if isinstance(value, float) and math.isnan(value) else value for value in values]
        for name, values in columns.items()
    }


def states_sightings(content: bytes, loaded: Any) -> bool:
    header, rows = long_rows(content)
    cells = list(zip(*rows, strict=True))
    of_column = {name.lower(): list(cells[k]) for k, name in enumerate(header)}
    assert [loaded["names"][k] for k in loaded["node"]] == [name.strip() for name in of_column["node"]]
    lost = [""] * len(rows)
    return all(
        same_cells(of_column.get(name, lost), [math.nan if value is None else value for value in loaded[name]])
        for name in ("time", "x", "y", "yaw")
    )


def states_sighted_h5(content: bytes, loaded: Any) -> bool:
    with h5py.File(io.BytesIO(content), "r") as file:
        return all(
            loaded[name] == [None if isinstance(v, float) and math.isnan(v) else v for v in file[name][()].tolist()]
            for name in ("time", "x", "y", "yaw", "node")
        )


def make_sightings(folder: Path) -> list[Path]:
    save_sightings(read_sightings(sound_file("csv", folder)), folder / "sightings.h5")
    return [folder / "sightings.h5"]


def read_paper(path: Path) -> Any:
    sightings = read_sightings(path)
    poses = np.stack([sightings.x, sightings.y, sightings.yaw], -1)
    frames = poses.reshape(-1, len(sightings.names), 3)
    return {
        "scene": json.loads(sightings.scene),
        **{str(k): [[None if math.isnan(v) else v for v in row] for row in frames[:, k].tolist()] for k in range(frames.shape[1])},
    }


def states_paper(content: bytes, loaded: Any) -> bool:
    text = content.decode("utf-8-sig")
    stated = strictly(text.encode())
    keys = [name for name in stated if name.isdecimal()]
    assert len(keys) == len(loaded) - 1, "another number of nodes"
    assert set(stated) - set(keys) == {"shapes", "edges"}, "a key that says nothing"
    for key in keys:
        blind = not all(body["yaw_known"] for body in loaded["scene"]["bodies"] if body["name"] == key) if key != "0" else False
        for row, (x, y, yaw) in zip(stated[key], loaded[key], strict=True):
            given = [None if value is None or not math.isfinite(value) else value for value in row]
            lost = given[0] is None or given[1] is None
            if not lost and (given[:2] != [x, y] or not blind and given[2] != yaw):
                return False
    return True


# Datasets, networks, trainings, adaptations


def make_dataset(folder: Path) -> list[Path]:
    recipe = Recipe("planar", 3, 0, 0, 2, "of a test")
    Dataset.write(folder / "data.h5", recipe, [Columns.of([draw_trajectory("planar", 3, 0, k) for k in range(2)])])
    return [folder / "data.h5"]


def make_lever_dataset(folder: Path) -> list[Path]:
    recipe = Recipe("lever-up", 1, 5, 0, 2, "of a test")
    LeverDataset.write(folder / "lever.h5", recipe, [LeverColumns.of([draw_interaction(5, k) for k in range(2)])])
    return [folder / "lever.h5"]


def read_dataset(path: Path, kind: type[RaggedFile]) -> Any:
    with kind(path) as data:
        stretch = data.columns(0, len(data))
        tracks = [data[k].poses.shape for k in range(len(data))]  # type: ignore[index]
        arrays = {name: np.asarray(values) for name, values in vars(stretch).items()}
    content = {name: (a.shape, a.dtype.str, a.tolist() if a.dtype == object else a.tobytes()) for name, a in arrays.items()}
    return content | {"recipe": dataclasses.asdict(data.recipe), "tracks": tracks}


def states_dataset(content: bytes, loaded: Any) -> bool:
    with h5py.File(io.BytesIO(content), "r") as file:
        for name in set(loaded) - {"recipe", "tracks"}:
            array = np.asarray(file[name][()])
            shown = array.tolist() if array.dtype == object else array.tobytes()
            if loaded[name] != (array.shape, array.dtype.str, shown) or file[name].is_virtual or file[name].external:
                return False
        return all(file.attrs[name] == value for name, value in loaded["recipe"].items())


def make_checkpoints(folder: Path) -> list[Path]:
    found = []
    for kind, network in NETWORKS.items():
        config = {"hidden": 4, "steps": 2} if kind in ("contact", "propnet", "lever_up", "lever_propnet") else {"hidden": 4}
        torch.manual_seed(0)
        record = {"samples": 5, "seconds": 0.5, "curve": [{"step": 0, "loss": 0.5}], "range": {"mass": [0.1, 2.0]}}
        physics = "a" * 64 if kind in ("belief", "paper_recipe", "spread") else None
        path = folder / f"{kind}.safetensors"
        save_checkpoint(Checkpoint(kind, config, network(**config), record, physics), path)
        found.append(path)
    return found


def digest_of(tensors: Any) -> Any:
    return {name: (str(one.dtype), tuple(one.shape), one.detach().contiguous().reshape(-1).view(torch.uint8).numpy().tobytes())
            for name, one in tensors.items()}


def read_checkpoint(path: Path) -> Any:
    one = load_checkpoint(path)
    header = {"kind": one.kind, "config": dict(one.config), "record": dict(one.record), "physics": one.physics}
    return header | {"tensors": digest_of(one.network.state_dict())}


def states_tensors(content: bytes, loaded: Any) -> bool:
    size = int.from_bytes(content[:8], "little")
    header = strictly(strictly(content[8 : 8 + size])["__metadata__"]["pushgraph"].encode())
    named = {name: value for name, value in loaded.items() if name != "tensors"}
    return digest_of(tensors_of(content)) == loaded["tensors"] and all(
        agrees(header.get(name), value) for name, value in named.items()
    )


RECIPE = {"model": "contact", "samples": 10, "learning_rate": 1e-3, "start_from": None, "processes": 1}


def small_training() -> tuple[torch.nn.Module, torch.optim.Optimizer]:
    torch.manual_seed(1)
    network = torch.nn.Sequential(torch.nn.Linear(3, 4), torch.nn.Linear(4, 1))
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-3)
    network(torch.ones(2, 3)).sum().backward()
    optimizer.step()
    return network, optimizer


def make_running(folder: Path) -> list[Path]:
    network, optimizer = small_training()
    best = {name: values.clone() for name, values in network.state_dict().items()}
    curve = [{"step": 0, "seconds": 0.0, "loss": 0.5}]
    RunningCheckpoint(folder, RECIPE).save(network, best, optimizer, Progress(1, 2.5, curve, 0.25))
    return [folder / "running.safetensors"]


def read_running(path: Path) -> Any:
    network, optimizer = small_training()
    now, best = RunningCheckpoint(path.parent, RECIPE).load(network, optimizer)
    state = optimizer.state_dict()["state"]
    tensors = {f"network.{name}": one for name, one in network.state_dict().items()}
    tensors |= {f"best.{name}": one for name, one in best.items()}
    tensors |= {f"optimizer.{k}.{name}": one for k, values in state.items() for name, one in values.items()}
    return {"recipe": RECIPE, "progress": vars(now), "tensors": digest_of(tensors)}


def make_adaptation(folder: Path) -> list[Path]:
    rng = np.random.default_rng(0)
    places, logs = torch.from_numpy(rng.normal(size=(5, 11))), torch.zeros(13, dtype=torch.float64)
    process = partial(GaussianProcess.conditioned, places, logs=logs)
    correction = Correction(
        process(torch.from_numpy(rng.normal(size=(5, 2)))), process(torch.from_numpy(rng.normal(size=(5, 1)))), 0.5
    )
    own = Adapted(Estimate(rng.normal(size=6), np.eye(6) * 0.3), correction, (1.0, 1.5), 12)
    plain = Adapted(Estimate.prior(), None, (1.0, 1.0), 3)
    adaptation = Adaptation(plain, {("abs", "box"): own}, {"round": plain})
    save_adaptation(adaptation, folder / "adaptation.safetensors", "hash", {"pushes": 15})
    return [folder / "adaptation.safetensors"]


def read_adaptation(path: Path) -> Any:
    adaptation = load_adaptation(path)
    everything = [("shared", adaptation.shared), *adaptation.kinds.items(), *adaptation.materials.items()]
    tensors, learnt = {}, []
    for k, (name, own) in enumerate(everything):
        tensors |= {f"{k} mean": torch.from_numpy(own.estimate.mean)}
        tensors |= {f"{k} covariance": torch.from_numpy(own.estimate.covariance)}
        if own.correction is not None:
            for part in ("position", "yaw"):
                process = getattr(own.correction, part)._asdict()
                tensors |= {f"{k} {part} {field}": values for field, values in process.items()}
        strength = None if own.correction is None else own.correction.strength
        learnt.append([name, own.pushes, list(own.widening), strength])
    return {"learnt": learnt, "tensors": digest_of(tensors)}


def states_adaptation(content: bytes, loaded: Any) -> bool:
    """The numbers are those of the tensors, which have one type and are finite."""
    size = int.from_bytes(content[:8], "little")
    header = strictly(strictly(content[8 : 8 + size])["__metadata__"]["pushgraph"].encode())
    stored = digest_of(tensors_of(content))
    assert all(kind == "torch.float64" for kind, *_ in stored.values())
    assert all(np.isfinite(np.frombuffer(one)).all() for *_, one in stored.values())
    assert sorted(one for *_, one in stored.values()) == sorted(one for *_, one in loaded["tensors"].values())
    stated = sorted(([one["pushes"], one["widening"], one["strength"]] for one in header["learnt"]), key=repr)
    return stated == sorted((row[1:] for row in loaded["learnt"]), key=repr)


hdf5, tensors = of_hdf5(reseal), of_tensors
KINDS = [
    json_kind("scene", lambda f: written(f, "scene.json", workshop().to_json()), lambda p: as_tree(Scene.load(p))),
    json_kind(
        "lever scene",
        lambda f: [Path(shutil.copy(PACKAGE / "scenes" / "lever-up.json", f))],
        lambda p: as_tree(LeverScene.load(p)),
    ),
    json_kind("tool", lambda f: [Path(shutil.copy(PACKAGE / "tools" / "l.json", f))], lambda p: as_tree(load_tool(p).tool)),
    json_kind("plan", make_plan, read_plan, states_plan),
    json_kind("beliefs", make_beliefs, read_beliefs, states_beliefs),
    json_kind("joint trajectory", make_joint_trajectory, lambda p: as_tree(JointTrajectory.load(p))),
    json_kind("recipe of a dataset", make_parts, read_parts),
    json_kind("outlines of recorded pushes", make_outlines, read_shapes, states_outlines),
    json_kind("paper JSON", lambda f: written(f, "0.json", json.dumps(paper_content())), read_paper, states_paper),
    Kind("outline", lambda f: written(f, "outline.svg", DRAWING), read_outline, (of_bytes, of_svg, of_svg), states_drawing),
    Kind("recorded pushes", make_pushes, read_table, (of_bytes, gzipped(of_csv), gzipped(of_csv)), states_table),
    Kind("track CSV", lambda f: [sound_file("csv", f)], read_track, (of_bytes, of_csv, of_csv), states_csv_track),
    Kind("recording CSV", lambda f: [sound_file("csv", f)], read_sighted, (of_bytes, of_csv, of_csv), states_sightings),
    Kind("recording CSV, wide", lambda f: [sound_file("wide", f)], read_sighted, (of_bytes, of_csv)),
    Kind("recording of Motive", lambda f: [sound_file("motive", f)], read_sighted, (of_bytes, of_csv)),
    Kind("track HDF5", make_h5_tracks, read_track, (of_bytes, hdf5), states_h5_track, has_line),
    Kind("track HDF5, no checksum", partial(make_h5_tracks, sealed=False), read_track, (of_bytes, of_hdf5()), states_h5_track),
    Kind("lever track", make_lever_track, read_lever_track, (of_bytes, hdf5), states_lever_track, has_line),
    Kind("sightings HDF5", make_sightings, read_sighted, (of_bytes, hdf5), states_sighted_h5, has_line),
    Kind("ROS bag", lambda f: [sound_file("bag", f)], read_sighted, (of_bytes,)),
    Kind("MCAP", lambda f: [sound_file("MCAP", f)], read_sighted, (of_bytes,)),
    Kind("ROS 2 SQLite", lambda f: [sound_file("SQLITE3", f)], read_sighted, (of_bytes,)),
    Kind("LeRobot parquet", lambda f: [sound_file("parquet", f)], read_sighted, (of_bytes,)),
    Kind("dataset", make_dataset, partial(read_dataset, kind=Dataset), (of_bytes, hdf5), states_dataset, has_line),
    Kind("lever dataset", make_lever_dataset, partial(read_dataset, kind=LeverDataset), (of_bytes, hdf5), states_dataset, has_line),
    Kind("checkpoint", make_checkpoints, read_checkpoint, (of_bytes, tensors, tensors), states_tensors, lambda c: True),
    Kind("training state", make_running, read_running, (of_bytes, tensors, tensors), states_tensors, lambda c: True),
    Kind("adaptation", make_adaptation, read_adaptation, (of_bytes, tensors, tensors), states_adaptation, lambda c: True),
]  # fmt: skip
