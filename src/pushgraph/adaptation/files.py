"""What was learnt of a robot's pushes, in one safetensors file: numbers, and a header that anyone can read."""

import os
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from pushgraph.adaptation.adapted import Adaptation, Adapted
from pushgraph.adaptation.correction import Correction
from pushgraph.adaptation.gaussian_process import GaussianProcess
from pushgraph.adaptation.unknowns import Estimate
from pushgraph.errors import AdaptationError
from pushgraph.tensor_file import load_tensors, save_tensors

FORMAT = "pushgraph.adaptation"
VERSION = 2


def save_adaptation(
    adaptation: Adaptation, path: str | os.PathLike, physics: str | None, record: Mapping[str, Any]
) -> None:
    """Write an adaptation, whole or not at all.

    physics: hash of the weights whose predictions it is about. record: what it was learnt from.
    """
    everything: list[tuple[str, tuple[str, str | None] | None, Adapted]] = [("shared", None, adaptation.shared)]
    everything += [(f"kind {k}", name, own) for k, (name, own) in enumerate(adaptation.kinds.items())]
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
    found: dict[str, dict] = {"shared": {}, "kind": {}, "surface": {}, "material": {}}
    for one in header["learnt"]:
        own = {name.split(".")[1]: values for name, values in tensors.items() if name.split(".")[0] == one["key"]}
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
    return Adaptation(found["shared"][None], found["material"], found["kind"], found["surface"])


def record_of(path: str | os.PathLike) -> Mapping[str, Any]:
    """What an adaptation was learnt from."""
    return _read(path)[0]["record"]


def _read(path: str | os.PathLike) -> tuple[dict[str, Any], dict[str, Tensor]]:
    return load_tensors(path, "adaptation", FORMAT, VERSION, AdaptationError, "adapt anew")
