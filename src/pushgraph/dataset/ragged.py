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

from pushgraph.errors import DatasetError
from pushgraph.storage import replacing_hdf5
from pushgraph.track_frames import FRAME

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
        self.path = Path(path)
        with self._reading():
            self._file = h5py.File(path, "r")
            attributes = dict(self._file.attrs)
        valid = self.layout
        if str(attributes.get("format")) != valid.format:
            raise DatasetError(f"{path}: not a dataset: attribute 'format' must be {valid.format!r}")
        if str(attributes.get("version")) != str(valid.version):
            raise DatasetError(
                f"{path}: dataset version {attributes.get('version')}; this pushgraph reads {valid.version}"
            )
        with self._reading():
            self.recipe = Recipe(**{name: _plain(attributes[name]) for name in Recipe.names()})
            self.offsets: dict[str, np.ndarray] = {name: self._file[name][()] for name in valid.measured_by}
            self.entries: dict[str, np.ndarray] = {
                name: self._file[name][()]
                for name, column in valid.columns.items()
                if column.offset is None and name != "scenes"
            }
            self.summary: np.ndarray = self.entries["summary"]

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
        with replacing_hdf5(path) as file:
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
        except (OSError, KeyError, RuntimeError, AttributeError, TypeError, ValueError) as error:
            raise DatasetError(f"{self.path}: cannot be read, it may be truncated or damaged: {error}") from None


def _create(file: h5py.File, name: str, column: Column, length: int) -> h5py.Dataset:
    if column.offset is None:
        return file.create_dataset(name, (length,), column.dtype)
    shape = (length,) if column.width is None else (length, column.width)
    chunks = {"chunks": (min(ROWS_PER_CHUNK, length), column.width)} if name == "poses" else {}
    return file.create_dataset(name, shape, column.dtype, **_STORED | chunks)


def _plain(value: Any) -> Any:
    return int(value) if isinstance(value, np.integer) else value
