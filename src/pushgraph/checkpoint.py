"""Checkpoints: the weights of a network with everything that makes sense of them, in one safetensors file.

The file's metadata holds a JSON header: kind and config of the network, names of its features, the record of its
training, and a hash of all that and the weights. Loading checks every part and fails loudly; there is no pickle.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import torch
from pydantic import Field
from torch import nn

from pushgraph.errors import CheckpointError, NetworkError
from pushgraph.extras import extra
from pushgraph.network.registry import NETWORKS, build_network
from pushgraph.record import Record
from pushgraph.tensor_file import Header, check_tensors, load_tensors, save_tensors

FORMAT = "pushgraph.checkpoint"
VERSION = 1
MOST = 4096
"""Of any size in a network's config."""
BASELINES = ("propnet", "image", "paper_recipe", "lever_up_propnet")
"""The paper's networks: a distribution of their own, as they are 85 % of all weights."""


class TrainingRecord(Record, extra="allow"):
    """How a network was trained, in whatever words its task has; what predictions need of it must be right."""

    range: Annotated[dict[str, tuple[float, float]], Field(default_factory=dict)]
    """Lowest and highest value of each quantity in the scenes of its data."""


class CheckpointHeader(Header):
    """What the header of a checkpoint says; see `Checkpoint`. features: of the network's inputs."""

    format: Literal["pushgraph.checkpoint"] = "pushgraph.checkpoint"
    version: Literal[1] = 1
    kind: str
    config: dict[str, Annotated[int, Field(ge=1, le=MOST)]]
    features: Annotated[dict[str, Any], Field(alias="schema")]
    record: TrainingRecord
    physics: str | None = None


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
    header, tensors = load_tensors(path, "checkpoint", CheckpointHeader, CheckpointError, "train it anew")
    kind, config, record = (header[name] for name in ("kind", "config", "record"))
    try:
        with torch.device("meta"):  # before memory is taken for what a config merely claims
            needed = build_network(kind, config).state_dict()
    except NetworkError as error:
        raise CheckpointError(f"{path}: {error}") from None
    schema = NETWORKS[kind].schema()
    if header["schema"] != schema:
        changed = [name for name in schema if header["schema"].get(name) != schema[name]]
        raise CheckpointError(f"{path}: trained on other features ({', '.join(changed)}); train it anew")
    if fault := check_tensors(tensors, needed):
        raise CheckpointError(f"{path}: its weights do not fit its config: {fault}")
    network = build_network(kind, config)
    network.load_state_dict(tensors)
    return Checkpoint(kind, config, network.eval(), record, header.get("physics"), header["hash"])


def shipped(name: str) -> Path:
    """The checkpoint of this name that comes with pushgraph.

    Raises CheckpointError with the valid names, or MissingExtraError if it is one of the baselines and they are not
    installed.
    """
    folder = Path(__file__).parent / "weights"
    if name in BASELINES:
        with extra("baselines", name):
            folder = Path(str(files("pushgraph_baselines")))
    path = folder / f"{name}.safetensors"
    if not path.is_file():
        valid = ", ".join(sorted({file.stem for file in folder.glob("*.safetensors")} | set(BASELINES)))
        raise CheckpointError(f"no shipped checkpoint {name!r}; valid: {valid}")
    return path
