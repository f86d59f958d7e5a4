"""Checkpoints: the weights of a network with everything that makes sense of them, in one safetensors file.

The file's metadata holds a JSON header: kind and config of the network, names of its features, the record of its
training, and a hash of all that and the weights. Loading checks every part and fails loudly; there is no pickle.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import nn

from pushgraph.errors import CheckpointError, NetworkError
from pushgraph.network.registry import NETWORKS, build_network
from pushgraph.tensor_file import load_tensors, save_tensors

FORMAT = "pushgraph.checkpoint"
VERSION = 1


@dataclass(frozen=True)
class Checkpoint:
    """A network, its kind and config, and the record of its training.

    physics: hash of the checkpoint of the physics network that a belief or a spread stands on. hash: its own, once it
    is saved.
    """

    kind: str
    config: Mapping[str, Any]
    network: nn.Module
    record: Mapping[str, Any]
    physics: str | None = None
    hash: str | None = None


def save_checkpoint(checkpoint: Checkpoint, path: str | os.PathLike) -> None:
    """Write a checkpoint, whole or not at all."""
    tensors = {name: values.detach().cpu().contiguous() for name, values in checkpoint.network.state_dict().items()}
    header = {
        "format": FORMAT,
        "version": VERSION,
        "kind": checkpoint.kind,
        "config": dict(checkpoint.config),
        "schema": NETWORKS[checkpoint.kind].schema(),
        "record": dict(checkpoint.record),
    }
    if checkpoint.physics is not None:
        header["physics"] = checkpoint.physics
    save_tensors(path, header, tensors)


def load_checkpoint(path: str | os.PathLike) -> Checkpoint:
    """Read a checkpoint; raises CheckpointError if any part of it is not what this pushgraph understands."""
    header, tensors = load_tensors(path, "checkpoint", FORMAT, VERSION, CheckpointError, "train it anew")
    try:
        network = build_network(header["kind"], header["config"])
    except NetworkError as error:
        raise CheckpointError(f"{path}: {error}") from None
    schema = NETWORKS[header["kind"]].schema()
    if header["schema"] != schema:
        changed = [name for name in schema if header["schema"].get(name) != schema[name]]
        raise CheckpointError(f"{path}: trained on other features ({', '.join(changed)}); train it anew")
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        raise CheckpointError(f"{path}: its weights do not fit its config: {error}") from None
    if not all(values.isfinite().all() for values in tensors.values()):
        raise CheckpointError(f"{path}: it holds weights that are not finite")
    kind, config, record = (header[name] for name in ("kind", "config", "record"))
    return Checkpoint(kind, config, network.eval(), record, header.get("physics"), header["hash"])


def shipped(name: str) -> Path:
    """The checkpoint of this name that comes with pushgraph; raises CheckpointError with the valid names."""
    folder = Path(__file__).parent / "weights"
    path = folder / f"{name}.safetensors"
    if not path.is_file():
        valid = ", ".join(sorted(file.stem for file in folder.glob("*.safetensors")))
        raise CheckpointError(f"no shipped checkpoint {name!r}; valid: {valid}")
    return path
