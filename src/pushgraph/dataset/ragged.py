"""HDF5 files of many trajectories of different lengths: everything laid out flat, so that reads are fast."""

import contextlib
import dataclasses
import importlib.metadata
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar

import h5py
import numpy as np

from pushgraph.checksum import is_intact
from pushgraph.errors import DatasetError, SceneError, TrackError
from pushgraph.isolation import read_isolated
from pushgraph.storage import replacing_hdf5, size_of
from pushgraph.stored_array import read_through, stored, stored_here
from pushgraph.track_frames import FRAME

ROWS_PER_CHUNK = 16384
_STORED = {"chunks": True, "compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}


def _versions() -> str:
    """Of what makes a dataset; without MuJoCo, which is an extra, it was made of tracks."""
    found = []
    for package in ("pushgraph", "mujoco", "numpy", "torch"):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found.append(f"{package} {importlib.metadata.version(package)}")
    return ", ".join(found)


@dataclass(frozen=True)
class Recipe:
    """What a dataset is made from; the same recipe gives the same bytes."""

    setup: str
    objects: int
    seed: int
    first: int
    count: int
    versions: str = dataclasses.field(default_factory=_versions)

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


class Column(NamedTuple):
    """An array of the file. offset: the array that says where each trajectory begins in it; None: one entry each."""

    dtype: Any
    offset: str | None = None
    width: int | None = None
    unit: str = ""


class Layout(NamedTuple):
    """What files of a format hold. measured_by: for each offset the column whose trajectories' lengths it adds up."""

    format: str
    version: int
    columns: Mapping[str, Column]
    measured_by: Mapping[str, str]


Opened = TypeVar("Opened", bound="RaggedFile")


def flat(tracks: Sequence[Any]) -> dict[str, np.ndarray]:
    """What every dataset holds of tracks: poses, where those of each begin and end, and scenes."""
    rows = [track.poses.reshape(-1, track.poses.shape[-1]) for track in tracks]
    return {
        "poses": np.concatenate(rows).astype(np.float32),
        "pose_offset": np.cumsum([0] + [len(of_track) for of_track in rows]),
        "scenes": np.array([track.scene.to_json(indent=None) for track in tracks], dtype=object),
    }


class RaggedFile:
    """Base of datasets open for reading. Raises DatasetError if the file is not whole."""

    layout: ClassVar[Layout]
    stretch: ClassVar[type]
    """What consecutive trajectories are handed over in: a class with the layout's columns and offsets as fields."""

    def __init__(self, path: str | os.PathLike) -> None:
        self.path, valid = Path(path), self.layout
        with self._reading():
            intact = is_intact(self.path) if size_of(self.path) else None
            if intact is False:
                raise TrackError("the file is damaged, its bytes are not those that were saved")
            if intact is None:
                read_isolated(read_through, self.path, valid.format, *valid.columns, *valid.measured_by)
            self._file = h5py.File(path, "r")
            attributes = dict(self._file.attrs)
        if str(attributes.get("format")) != valid.format:
            raise DatasetError(f"{path}: not a dataset: attribute 'format' must be {valid.format!r}")
        if str(attributes.get("version")) != str(valid.version):
            raise DatasetError(
                f"{path}: dataset version {attributes.get('version')}; this pushgraph reads {valid.version}"
            )
        with self._reading():
            self.recipe = _recipe_in(attributes)
            self.offsets: dict[str, np.ndarray] = {name: stored(self._file, name) for name in valid.measured_by}
            for name in (*valid.measured_by, *valid.columns):
                self._check_column(name)
            self.entries: dict[str, np.ndarray] = {
                name: self._file[name][()]
                for name, column in valid.columns.items()
                if column.offset is None and name != "scenes"
            }
            self.summary: np.ndarray = self.entries["summary"]

    def _check_column(self, name: str) -> None:
        """Raise TrackError if an array has another type or length than the layout and the offsets say."""
        array, count = stored_here(self._file, name), self.recipe.count
        if name in self.offsets:
            offset = self.offsets[name]
            if array.dtype != np.int64 or array.shape != (count + 1,):
                raise TrackError(f"{name}: must be int64 of shape {(count + 1,)}, got {array.dtype} of {array.shape}")
            if offset[0] != 0 or (np.diff(offset) < 1).any():
                raise TrackError(f"{name}: must rise from 0 on")
            return
        column = self.layout.columns[name]
        rows = count if column.offset is None else int(self.offsets[column.offset][-1])
        shape = (rows,) if column.width is None else (rows, column.width)
        alike = h5py.check_string_dtype(array.dtype) == h5py.check_string_dtype(np.dtype(column.dtype))
        if array.dtype != column.dtype or not alike or array.shape != shape:
            raise TrackError(f"{name}: must be {column.dtype} of {shape}, got {array.dtype} of {array.shape}")

    def __enter__(self: "Opened") -> "Opened":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __len__(self) -> int:
        return self.recipe.count

    def columns(self, first: int, last: int) -> Any:
        """Trajectories first to last - 1, laid out flat."""
        ends = {name: slice(*offset[[first, last]]) for name, offset in self.offsets.items()}
        with self._reading():
            arrays = {
                name: self.entries.get(name, self._file[name])[
                    slice(first, last) if column.offset is None else ends[column.offset]
                ]
                for name, column in self.layout.columns.items()
            }
        offsets = {name: offset[first : last + 1] - offset[first] for name, offset in self.offsets.items()}
        return self.stretch(**arrays, **offsets)

    def place(self, index: int) -> int:
        """The same index, counted from the first trajectory on."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"trajectory {index} of {len(self)}")
        return index % len(self)

    @contextlib.contextmanager
    def naming(self, index: int) -> Iterator[None]:
        """Errors of one trajectory become DatasetError, which names the file and the trajectory."""
        try:
            yield
        except (TrackError, SceneError) as error:
            raise DatasetError(f"{self.path}: trajectory {index}: {error}") from None

    def scene_text(self, index: int) -> bytes:
        """The scene of one trajectory, as JSON."""
        with self._reading():
            return self._file["scenes"][index]

    @classmethod
    def write(
        cls,
        path: str | os.PathLike,
        recipe: Recipe,
        stretches: Iterable[Any],
        lengths: Mapping[str, int] | None = None,
    ) -> None:
        """Write a dataset from its consecutive stretches, whole or not at all.

        lengths: what each offset ends with; must be given where the stretches are read one at a time.
        Raises StorageError if the disk is full or refuses; the target is then as it was.
        """
        layout = cls.layout
        if lengths is None:
            stretches = list(stretches)
            lengths = {name: sum(int(getattr(one, name)[-1]) for one in stretches) for name in layout.measured_by}
        with replacing_hdf5(path, checksum=True) as file:
            file.attrs.update(format=layout.format, version=layout.version, frame_s=FRAME, **dataclasses.asdict(recipe))
            stored = {
                name: _create(file, name, column, recipe.count if column.offset is None else lengths[column.offset])
                for name, column in layout.columns.items()
            }
            for name, column in layout.columns.items():
                if column.unit:
                    stored[name].attrs["unit"] = column.unit
            offsets = {name: np.zeros(recipe.count + 1, np.int64) for name in layout.measured_by}
            first = {name: 0 for name in stored}
            for stretch in stretches:
                for name, dataset in stored.items():
                    values = getattr(stretch, name)
                    dataset[first[name] : first[name] + len(values)] = values
                for name, flat in layout.measured_by.items():
                    done, local = first["scenes"], getattr(stretch, name)
                    offsets[name][done + 1 : done + len(local)] = first[flat] + local[1:]
                first = {name: first[name] + len(getattr(stretch, name)) for name in stored}
            for name, values in offsets.items():
                file[name] = values

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except FileNotFoundError:
            raise DatasetError(f"{self.path}: no such dataset") from None
        except TrackError as error:
            raise DatasetError(f"{self.path}: cannot be read: {error}") from None
        except (OSError, KeyError, RuntimeError, AttributeError, TypeError, ValueError) as error:
            raise DatasetError(f"{self.path}: cannot be read, it may be truncated or damaged: {error}") from None


def _create(file: h5py.File, name: str, column: Column, length: int) -> h5py.Dataset:
    if column.offset is None:
        return file.create_dataset(name, (length,), column.dtype)
    shape = (length,) if column.width is None else (length, column.width)
    chunks = {"chunks": (min(ROWS_PER_CHUNK, length), column.width)} if name == "poses" else {}
    return file.create_dataset(name, shape, column.dtype, **_STORED | chunks)


def _recipe_in(attributes: Mapping[str, Any]) -> Recipe:
    """The recipe that stands in a file's attributes; raises TrackError if it is none."""
    found: dict[str, Any] = {}
    for name in Recipe.names():
        value = attributes.get(name)
        if name in ("setup", "versions"):
            if not isinstance(value, str):
                raise TrackError(f"attribute {name!r}: must be text, got {value!r}")
            found[name] = value
        else:
            least = int(name in ("objects", "count"))
            if not isinstance(value, np.integer) or value < least:
                raise TrackError(f"attribute {name!r}: must be a whole number from {least} on, got {value!r}")
            found[name] = int(value)
    if str(attributes.get("frame_s")) != str(FRAME):
        raise TrackError(f"attribute 'frame_s': must be {FRAME}, got {attributes.get('frame_s')!r}")
    return Recipe(**found)
