"""What was learnt of a robot's pushes, in one safetensors file: numbers, and a header that anyone can read."""

import os
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import torch
from pydantic import Field, model_validator
from torch import Tensor

from pushgraph.adaptation.adapted import Adaptation, Adapted
from pushgraph.adaptation.correction import FEATURES, Correction
from pushgraph.adaptation.gaussian_process import GaussianProcess
from pushgraph.adaptation.unknowns import COUNT, Estimate
from pushgraph.errors import AdaptationError
from pushgraph.record import Record
from pushgraph.tensor_file import Header, check_tensors, load_tensors, save_tensors

Positive = Annotated[float, Field(gt=0)]

FORMAT = "pushgraph.adaptation"
VERSION = 3


class Learnt(Record):
    """What the header says of one `Adapted`. key: its tensors' names begin with it. learnt: its unknowns, in words."""

    key: Annotated[str, Field(pattern=r"^(shared|(surface|material) \d{1,6})$")]
    surface: str | None
    shape: str | None
    pushes: Annotated[int, Field(ge=0)]
    learnt: tuple[str, ...]
    widening: tuple[Positive, Positive]
    strength: Annotated[float, Field(ge=0, le=1)] | None

    @model_validator(mode="after")
    def _named(self) -> "Learnt":
        what = self.key.split()[0]
        if (self.surface is not None, self.shape is not None) != (what != "shared", what == "material"):
            raise ValueError(f"surface, shape: of {self.key!r}, got {self.surface!r}, {self.shape!r}")
        return self


class AdaptationHeader(Header):
    """What the header of an adaptation says. physics: hash of the weights. record: what it was learnt from."""

    format: Literal["pushgraph.adaptation"] = "pushgraph.adaptation"
    version: Literal[3] = 3
    physics: str | None
    record: dict[str, Any]
    learnt: tuple[Learnt, ...]

    @model_validator(mode="after")
    def _each_once(self) -> "AdaptationHeader":
        keys = [one.key for one in self.learnt]
        named = [(one.key.split()[0], one.surface, one.shape) for one in self.learnt]
        if len(set(keys)) < len(keys) or len(set(named)) < len(named) or "shared" not in keys:
            raise ValueError(f"learnt: 'shared' must be there, and each but once, got {', '.join(keys)}")
        return self


def save_adaptation(
    adaptation: Adaptation, path: str | os.PathLike, physics: str | None, record: Mapping[str, Any]
) -> None:
    """Write an adaptation, whole or not at all.

    physics: hash of the weights whose predictions it is about. record: what it was learnt from.
    """
    everything: list[tuple[str, tuple[str, str | None] | None, Adapted]] = [("shared", None, adaptation.shared)]
    everything += [(f"surface {k}", (name, None), own) for k, (name, own) in enumerate(adaptation.surfaces.items())]
    everything += [(f"material {k}", name, own) for k, (name, own) in enumerate(adaptation.materials.items())]
    tensors: dict[str, Tensor] = {}
    described = []
    for key, name, adapted in everything:
        tensors[f"{key}.mean"] = torch.from_numpy(adapted.estimate.mean)
        tensors[f"{key}.covariance"] = torch.from_numpy(adapted.estimate.covariance)
        correction = adapted.correction
        if correction is not None:
            for part in ("position", "yaw"):
                process = getattr(correction, part)._asdict()
                tensors |= {f"{key}.{part} {field}": values for field, values in process.items()}
        described.append(
            {
                "key": key,
                "surface": name and name[0],
                "shape": name and name[1],
                "pushes": adapted.pushes,
                "learnt": adapted.estimate.lines(),
                "widening": list(adapted.widening),
                "strength": None if correction is None else correction.strength,
            }
        )
    header = {"format": FORMAT, "version": VERSION, "physics": physics, "record": dict(record), "learnt": described}
    tensors = {name: values.contiguous().clone() for name, values in tensors.items()}
    save_tensors(path, header, tensors)


def load_adaptation(path: str | os.PathLike, physics: str | None = None) -> Adaptation:
    """Read an adaptation; raises AdaptationError if any part of it is not what it should be, or if it is about other
    weights than those of hash `physics`, where that is given."""
    header, tensors = _read(path)
    if physics is not None and header["physics"] != physics:
        raise AdaptationError(f"{path}: was learnt about other physics weights than those that predict; adapt anew")
    found: dict[str, dict] = {"shared": {}, "surface": {}, "material": {}}
    for one in header["learnt"]:
        own = {name.split(".")[1]: values for name, values in tensors.items() if name.split(".")[0] == one["key"]}
        if fault := _fault_of(own, one["strength"] is not None):
            raise AdaptationError(f"{path}: {one['key']}: {fault}")
        correction = None
        if one["strength"] is not None:
            position, yaw = (
                GaussianProcess(*(own[f"{part} {field}"] for field in GaussianProcess._fields))
                for part in ("position", "yaw")
            )
            correction = Correction(position, yaw, one["strength"])
        estimate = Estimate(own["mean"].numpy(), own["covariance"].numpy())
        what = one["key"].split()[0]
        name = (one["surface"], one["shape"]) if one["shape"] is not None else one["surface"]
        found[what][name] = Adapted(estimate, correction, tuple(one["widening"]), one["pushes"])
    return Adaptation(found["shared"][None], found["material"], found["surface"])


def _fault_of(own: Mapping[str, Tensor], corrected: bool) -> str:
    """Say what is wrong with the numbers of one `Adapted`; empty if nothing is."""
    needed = {"mean": (COUNT,), "covariance": (COUNT, COUNT)}
    for part, values in (("position", 2), ("yaw", 1)) if corrected else ():
        samples = own.get(f"{part} places", torch.empty(0)).shape[:1].numel()
        shapes = (samples, FEATURES), (FEATURES + 2,), (samples, values), (samples, samples)
        needed |= {f"{part} {field}": shape for field, shape in zip(GaussianProcess._fields, shapes, strict=True)}
    empty = {name: torch.empty(shape, dtype=torch.float64, device="meta") for name, shape in needed.items()}
    if fault := check_tensors(own, empty):
        return fault
    covariance = own["covariance"]
    if not torch.allclose(covariance, covariance.T) or torch.linalg.eigvalsh(covariance).min() < -1e-9:
        return "covariance: is none of any numbers"
    return ""


def record_of(path: str | os.PathLike) -> Mapping[str, Any]:
    """What an adaptation was learnt from."""
    return _read(path)[0]["record"]


def _read(path: str | os.PathLike) -> tuple[dict[str, Any], dict[str, Tensor]]:
    header, tensors = load_tensors(path, "adaptation", AdaptationHeader, AdaptationError, "adapt anew")
    strangers = {name.split(".")[0] for name in tensors} - {one["key"] for one in header["learnt"]}
    if strangers:
        raise AdaptationError(f"{path}: holds numbers of {min(strangers)!r}, of which its header says nothing")
    return header, tensors
