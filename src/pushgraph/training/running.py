"""A training under way on disk: everything that the same command needs to go on after it was killed."""

import contextlib
import fcntl
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from pushgraph.errors import TrainingError
from pushgraph.storage import replacing

PATIENCE = 20.0
"""Seconds to wait for a killed training's other processes to end."""


@dataclass
class Progress:
    """How far a training is: next step, seconds spent, curve of validations, and the best of them."""

    step: int = 0
    seconds: float = 0.0
    curve: list[dict[str, int | float]] = field(default_factory=list)
    best: float = float("inf")


class RunningCheckpoint:
    """The file `running.safetensors` in a folder of its own: weights, the best weights, optimizer, progress."""

    def __init__(self, folder: Path, recipe: dict[str, Any]) -> None:
        self.folder, self._recipe = folder, recipe
        self._path = folder / "running.safetensors"

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder; raises TrainingError if another training does."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with (self.folder / "lock").open("w") as lock:
            begun = time.monotonic()
            while True:
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() - begun > PATIENCE:
                        raise TrainingError(f"{self.folder}: another process is at this training") from None
                    time.sleep(0.2)
            yield

    def save(
        self, network: nn.Module, best: dict[str, Tensor], optimizer: torch.optim.Optimizer, now: Progress
    ) -> None:
        """Write everything, whole or not at all."""
        tensors = {f"network.{name}": values for name, values in network.state_dict().items()}
        tensors |= {f"best.{name}": values for name, values in best.items()}
        for index, state in optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer.{index}.{name}": values for name, values in state.items()}
        header = {"recipe": self._recipe, "progress": vars(now)}
        tensors = {name: values.detach().cpu().contiguous() for name, values in tensors.items()}
        with replacing(self._path) as temporary:
            temporary.write_bytes(save(tensors, {"pushgraph": json.dumps(header)}))

    def load(self, network: nn.Module, optimizer: torch.optim.Optimizer) -> tuple[Progress, dict[str, Tensor]]:
        """Restore network and optimizer; returns how far it was and the best weights. At the beginning: nothing.

        Raises TrainingError if the folder holds a training with another recipe.
        """
        if not self._path.exists():
            return Progress(), {name: values.clone() for name, values in network.state_dict().items()}
        try:
            with safe_open(self._path, "pt") as file:
                header = json.loads(file.metadata()["pushgraph"])
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
        except (OSError, SafetensorError, ValueError, KeyError) as error:
            raise TrainingError(f"{self._path}: cannot be read ({error}); remove it to begin anew") from None
        changed = [name for name, value in self._recipe.items() if header["recipe"].get(name) != value]
        if changed or set(header["recipe"]) != set(self._recipe):
            raise TrainingError(f"{self._path}: a training with other settings ({', '.join(changed)}); remove it")

        def part(prefix: str) -> dict[str, Tensor]:
            return {name.removeprefix(prefix): values for name, values in tensors.items() if name.startswith(prefix)}

        network.load_state_dict(part("network."))
        state: dict[int, dict[str, Tensor]] = {}
        for name, values in part("optimizer.").items():
            index, key = name.split(".")
            state.setdefault(int(index), {})[key] = values
        optimizer.load_state_dict(optimizer.state_dict() | {"state": state})
        return Progress(**header["progress"]), part("best.")
