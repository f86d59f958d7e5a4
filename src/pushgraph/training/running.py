"""A training under way on disk: everything that the same command needs to go on after it was killed."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import torch
from filelock import FileLock, Timeout
from pydantic import Field
from torch import Tensor, nn

from pushgraph.errors import StorageError, TrainingError
from pushgraph.record import Record
from pushgraph.tensor_file import Header, check_tensors, load_tensors, save_tensors

PATIENCE = 20.0
"""Seconds to wait for a killed training's other processes to end."""


REMEDY = "remove it to begin anew"


@dataclass
class Progress:
    """How far a training is: next step, seconds spent, curve of validations, and the best of them.

    losses: sum of those since the last validation.
    """

    step: int = 0
    seconds: float = 0.0
    losses: float = 0.0
    curve: list[dict[str, int | float]] = field(default_factory=list)
    best: float = float("inf")


class ProgressEntry(Record):
    """See `Progress`."""

    step: Annotated[int, Field(ge=0)]
    seconds: Annotated[float, Field(ge=0)]
    losses: float
    curve: list[dict[str, int | float]]
    best: float


class StateHeader(Header):
    """What the header of a training's state says."""

    format: Literal["pushgraph.training"] = "pushgraph.training"
    version: Literal[2] = 2
    recipe: dict[str, Any]
    progress: ProgressEntry


class RunningCheckpoint:
    """The file `running.safetensors` in a folder of its own: weights, the best weights, optimizer, progress."""

    def __init__(self, folder: Path, recipe: dict[str, Any]) -> None:
        self.folder, self._recipe = folder, recipe
        self._path = folder / "running.safetensors"

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder; raises TrainingError if another training does."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.folder / "lock", timeout=PATIENCE, poll_interval=0.2).acquire()
        except Timeout:
            raise TrainingError(f"{self.folder}: another process is at this training") from None
        except OSError as error:
            raise StorageError(f"{self.folder}: cannot be written: {error.strerror or error}") from None
        with lock:
            yield

    def save(
        self, network: nn.Module, best: dict[str, Tensor], optimizer: torch.optim.Optimizer, now: Progress
    ) -> None:
        """Write everything, whole or not at all."""
        tensors = {f"network.{name}": values for name, values in network.state_dict().items()}
        tensors |= {f"best.{name}": values for name, values in best.items()}
        for index, state in optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer.{index}.{name}": values for name, values in state.items()}
        fields = {name: StateHeader.model_fields[name].default for name in ("format", "version")}
        header = fields | {"recipe": self._recipe, "progress": vars(now)}
        save_tensors(self._path, header, {name: values.detach().cpu().contiguous() for name, values in tensors.items()})

    def load(self, network: nn.Module, optimizer: torch.optim.Optimizer) -> tuple[Progress, dict[str, Tensor]]:
        """Restore network and optimizer; returns how far it was and the best weights. At the beginning: nothing.

        Raises TrainingError if the folder holds a training with another recipe.
        """
        if not self._path.exists():
            return Progress(), {name: values.clone() for name, values in network.state_dict().items()}
        try:
            header, tensors = load_tensors(self._path, "training", StateHeader, TrainingError, REMEDY)
        except TrainingError as error:
            raise TrainingError(f"{error}; {REMEDY}") from None
        begun = header["recipe"]
        changed = [name for name in {*begun, *self._recipe} if begun.get(name) != self._recipe.get(name)]
        if changed:
            other = ", ".join(f"{name} {begun.get(name)}, not {self._recipe.get(name)}" for name in sorted(changed))
            raise TrainingError(
                f"{self._path}: a training with other settings: {other}. Remove it to begin anew, or name another --out"
            )

        def part(prefix: str) -> dict[str, Tensor]:
            return {name.removeprefix(prefix): values for name, values in tensors.items() if name.startswith(prefix)}

        weights = network.state_dict()
        needed = {f"{prefix}.{name}": values for prefix in ("network", "best") for name, values in weights.items()}
        kept = {name.split(".")[1] for name in tensors if name.startswith("optimizer.")}
        needed |= {f"optimizer.{index}.{name}": moment for index, name, moment in _moments(optimizer) if index in kept}
        if fault := check_tensors(tensors, needed):
            raise TrainingError(f"{self._path}: does not fit its network: {fault}; {REMEDY}")
        network.load_state_dict(part("network."))
        state: dict[int, dict[str, Tensor]] = {}
        for name, values in part("optimizer.").items():
            index, key = name.split(".")
            state.setdefault(int(index), {})[key] = values
        optimizer.load_state_dict(optimizer.state_dict() | {"state": state})
        return Progress(**ProgressEntry(**header["progress"]).model_dump()), part("best.")


def _moments(optimizer: torch.optim.Optimizer) -> Iterator[tuple[str, str, Tensor]]:
    """What AdamW keeps of each parameter that it moved, by index and name; of such a type and shape."""
    parameters = [(values, group["amsgrad"]) for group in optimizer.param_groups for values in group["params"]]
    for index, (values, amsgrad) in enumerate(parameters):
        for name in ("exp_avg", "exp_avg_sq", *["max_exp_avg_sq"] * amsgrad):
            yield str(index), name, values
        yield str(index), "step", torch.empty((), device="meta")
