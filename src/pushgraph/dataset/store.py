"""Datasets on disk: one HDF5 file of ragged tracks, their scenes inside, laid out flat so that reads are fast.

/poses         [rows, 3]  float32  x (m), y (m), yaw (rad); for each frame one row a node, node 0 the robot
/push          [frames]   int16    push under way, -1 while the tool is lifted
/wrench        [frames, 3] float32 force (N, world frame) and moment (N m) of the bodies on the tool
/pose_offset   [count+1]  int64    first row of each trajectory in /poses
/frame_offset  [count+1]  int64    first frame of each trajectory in /push
/scenes        [count]    string   JSON scene with its pushes
/density       [count]    string   dense or sparse
/kind          [count]    string   paper, or one of the kinds of the training mixture
/summary       [count]    compound what happened in each trajectory
"""

import contextlib
import dataclasses
import importlib.metadata
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from pushgraph.dataset.summary import COLUMNS, summarize
from pushgraph.errors import DatasetError
from pushgraph.scene import Scene
from pushgraph.simulation.setups import Trajectory
from pushgraph.storage import replacing_hdf5
from pushgraph.track import FRAME, Track

FORMAT = "pushgraph.dataset"
VERSION = 2
ROWS_PER_CHUNK = 16384
_STORED = {"chunks": True, "compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}


@dataclass(frozen=True)
class Recipe:
    """What a dataset is made from; the same recipe gives the same bytes."""

    setup: str
    objects: int
    seed: int
    first: int
    count: int
    versions: str = dataclasses.field(
        default_factory=lambda: ", ".join(
            f"{package} {importlib.metadata.version(package)}" for package in ("pushgraph", "mujoco", "numpy", "torch")
        )
    )

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the fields."""
        return tuple(field.name for field in dataclasses.fields(cls))

    def differences(self, other: "Recipe") -> str:
        """Say where another recipe differs; empty if it does not."""
        return ", ".join(
            f"{name} {getattr(other, name)!r} instead of {getattr(self, name)!r}"
            for name in self.names()
            if getattr(other, name) != getattr(self, name)
        )


@dataclass(frozen=True)
class Columns:
    """Consecutive trajectories as the flat arrays of the file; see the top of this module."""

    poses: np.ndarray
    push: np.ndarray
    wrench: np.ndarray
    pose_offset: np.ndarray
    frame_offset: np.ndarray
    scenes: np.ndarray
    density: np.ndarray
    kind: np.ndarray
    summary: np.ndarray

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory]) -> "Columns":
        """Lay trajectories out flat."""
        tracks = [trajectory.track for trajectory in trajectories]
        return cls(
            poses=np.concatenate([track.poses.reshape(-1, 3) for track in tracks]).astype(np.float32),
            push=np.concatenate([track.push for track in tracks]).astype(np.int16),
            wrench=np.concatenate([track.wrench for track in tracks]).astype(np.float32),
            pose_offset=np.cumsum([0] + [track.poses.shape[0] * track.poses.shape[1] for track in tracks]),
            frame_offset=np.cumsum([0] + [len(track.push) for track in tracks]),
            scenes=np.array([track.scene.to_json(indent=None) for track in tracks], dtype=object),
            density=np.array([trajectory.density.encode() for trajectory in trajectories], dtype="S6"),
            kind=np.array([trajectory.kind.encode() for trajectory in trajectories], dtype="S12"),
            summary=np.array([summarize(trajectory) for trajectory in trajectories], COLUMNS),
        )


def write(path: str | os.PathLike, recipe: Recipe, frames: int, rows: int, columns: Iterable[Columns]) -> None:
    """Write a dataset of known size from its consecutive stretches, whole or not at all.

    Raises StorageError if the disk is full or refuses; the target is then as it was.
    """
    with replacing_hdf5(path) as file:
        file.attrs.update(format=FORMAT, version=VERSION, frame_s=FRAME, **dataclasses.asdict(recipe))
        chunk = min(ROWS_PER_CHUNK, rows)
        stored = {
            "poses": file.create_dataset("poses", (rows, 3), np.float32, **_STORED | {"chunks": (chunk, 3)}),
            "push": file.create_dataset("push", (frames,), np.int16, **_STORED),
            "wrench": file.create_dataset("wrench", (frames, 3), np.float32, **_STORED),
            "scenes": file.create_dataset("scenes", (recipe.count,), h5py.string_dtype()),
            "density": file.create_dataset("density", (recipe.count,), "S6"),
            "kind": file.create_dataset("kind", (recipe.count,), "S12"),
            "summary": file.create_dataset("summary", (recipe.count,), COLUMNS),
        }
        stored["poses"].attrs["unit"] = "x (m), y (m), yaw (rad)"
        stored["wrench"].attrs["unit"] = "force (N), world; moment (N m)"
        offsets = {name: np.zeros(recipe.count + 1, np.int64) for name in ("pose_offset", "frame_offset")}
        first = {name: 0 for name in stored}
        for stretch in columns:
            for name, dataset in stored.items():
                values = getattr(stretch, name)
                dataset[first[name] : first[name] + len(values)] = values
            for name, flat in (("pose_offset", "poses"), ("frame_offset", "push")):
                done, local = first["scenes"], getattr(stretch, name)
                offsets[name][done + 1 : done + len(local)] = first[flat] + local[1:]
            first = {name: first[name] + len(getattr(stretch, name)) for name in stored}
        for name, values in offsets.items():
            file[name] = values


class Dataset:
    """A dataset open for reading; `len` and indexing by trajectory. Raises DatasetError if the file is not whole."""

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        with self._reading():
            self._file = h5py.File(path, "r")
            attributes = dict(self._file.attrs)
        if str(attributes.get("format")) != FORMAT:
            raise DatasetError(f"{path}: not a dataset: attribute 'format' must be {FORMAT!r}")
        if str(attributes.get("version")) != str(VERSION):
            raise DatasetError(f"{path}: dataset version {attributes.get('version')}; this pushgraph reads {VERSION}")
        with self._reading():
            self.recipe = Recipe(**{name: _plain(attributes[name]) for name in Recipe.names()})
            self.pose_offset: np.ndarray = self._file["pose_offset"][()]
            self.frame_offset: np.ndarray = self._file["frame_offset"][()]
            self.density: np.ndarray = self._file["density"][()].astype(str)
            self.kind: np.ndarray = self._file["kind"][()].astype(str)
            self.summary: np.ndarray = self._file["summary"][()]

    def __enter__(self) -> "Dataset":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __len__(self) -> int:
        return self.recipe.count

    def __getitem__(self, index: int) -> Track:
        """The track of one trajectory, its scene checked when it was written."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"trajectory {index} of {len(self)}")
        index %= len(self)
        stretch = self.columns(index, index + 1)
        scene = self.scene(index)
        poses = stretch.poses.astype(np.float64).reshape(len(stretch.push), -1, 3)
        return Track(
            scene=scene,
            times=np.arange(len(poses)) * FRAME,
            poses=poses,
            push=stretch.push.astype(np.int64),
            seen=np.ones(poses.shape[:2], dtype=bool),
            wrench=stretch.wrench.astype(np.float64),
        )

    def scene(self, index: int) -> Scene:
        """The scene of one trajectory, with its pushes."""
        with self._reading():
            text = self._file["scenes"][index]
        return Scene.from_json(text, f"{self.path}: scene {index}", trusted=True)

    def columns(self, first: int, last: int) -> Columns:
        """Trajectories first to last - 1, laid out flat."""
        rows = slice(*self.pose_offset[[first, last]])
        frames = slice(*self.frame_offset[[first, last]])
        with self._reading():
            return Columns(
                poses=self._file["poses"][rows],
                push=self._file["push"][frames],
                wrench=self._file["wrench"][frames],
                pose_offset=self.pose_offset[first : last + 1] - rows.start,
                frame_offset=self.frame_offset[first : last + 1] - frames.start,
                scenes=self._file["scenes"][first:last],
                density=self.density[first:last].astype("S6"),
                kind=self.kind[first:last].astype("S12"),
                summary=self.summary[first:last],
            )

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except FileNotFoundError:
            raise DatasetError(f"{self.path}: no such dataset") from None
        except (OSError, KeyError, RuntimeError, AttributeError, TypeError, ValueError) as error:
            raise DatasetError(f"{self.path}: cannot be read, it may be truncated or damaged: {error}") from None


def _plain(value: object) -> object:
    return int(value) if isinstance(value, np.integer) else value
