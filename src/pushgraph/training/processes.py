"""Training over several processes: which one this is, and what they agree on. torchrun starts them."""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, distributed, nn

from pushgraph.errors import TrainingError


@dataclass(frozen=True)
class Processes:
    """This process among those that train together."""

    rank: int
    count: int
    parent: int

    @classmethod
    def join(cls, device: torch.device) -> "Processes":
        """Join those that torchrun started; without torchrun this process is alone."""
        count = int(os.environ.get("WORLD_SIZE", "1"))
        if count > 1 and not distributed.is_initialized():
            distributed.init_process_group("nccl" if device.type == "cuda" else "gloo")
        return cls(int(os.environ.get("RANK", "0")), count, os.getppid())

    @property
    def leads(self) -> bool:
        """Whether this process writes files and tells progress."""
        return self.rank == 0

    def mean(self, values: Tensor) -> Tensor:
        """The mean over processes."""
        if self.count > 1:
            distributed.all_reduce(values)
            values /= self.count
        return values

    def average_gradients(self, network: nn.Module) -> None:
        """Give every process the mean gradient, in one message."""
        if self.count == 1:
            return
        learning = [(parameter, parameter.grad) for parameter in network.parameters() if parameter.grad is not None]
        mean = self.mean(torch.cat([gradient.flatten() for _, gradient in learning]))
        parts = mean.split([parameter.numel() for parameter, _ in learning])
        for (parameter, _), part in zip(learning, parts, strict=True):
            parameter.grad = part.view_as(parameter)

    def check_parent(self) -> None:
        """End this process if the one that started it was killed; it would otherwise train on unseen."""
        if self.count > 1 and os.getppid() != self.parent:
            raise TrainingError("the process that started this one has ended")

    def wait(self) -> None:
        """Wait until all have come here."""
        if self.count > 1:
            distributed.barrier()

    def leave(self) -> None:
        """Part from the others."""
        if self.count > 1:
            distributed.destroy_process_group()


def started_by_torchrun() -> bool:
    """Whether torchrun started this process."""
    return "WORLD_SIZE" in os.environ


def become_torchrun(processes: int, arguments: Sequence[str]) -> None:
    """Replace this process by torchrun, which starts `pushgraph` with these arguments in several processes."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone", f"--nproc-per-node={processes}"]
    sys.stdout.flush()
    os.execv(sys.executable, [*launcher, "-m", "pushgraph", *arguments])
