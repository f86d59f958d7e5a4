"""Training over several processes: which one this is, what they agree on, and how they are started.

Either torchrun starts them, or `run_in_processes`, which needs no more than torch: one a core, or one a GPU.
"""

import contextlib
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, distributed, multiprocessing

from pushgraph import own_modules
from pushgraph.cores import usable_cores
from pushgraph.device import device_of, gpus
from pushgraph.errors import DeviceError, PushGraphError, TrainingError, TrainingInterrupted


@dataclass(frozen=True)
class Processes:
    """This process among those that train together. local: its number on this machine."""

    rank: int = 0
    count: int = 1
    local: int = 0

    @classmethod
    def of_torchrun(cls) -> "Processes":
        """Those that torchrun started; without torchrun this process is alone."""
        return cls(*(int(os.environ.get(*one)) for one in (("RANK", "0"), ("WORLD_SIZE", "1"), ("LOCAL_RANK", "0"))))

    @property
    def leads(self) -> bool:
        """Whether this process writes files and tells progress."""
        return self.rank == 0

    def device(self, name: str) -> torch.device:
        """The device of this process: of several, each has a GPU of its own. Raises DeviceError if there is none."""
        device = device_of(name)
        if device.type != "cuda" or device.index is not None:
            return device
        if self.local >= gpus():
            raise DeviceError(f"device: process {self.local} of this machine finds no GPU left; there are {gpus()}")
        return torch.device("cuda", self.local)

    @contextlib.contextmanager
    def joined(self, device: torch.device, meeting: str = "env://") -> Iterator[None]:
        """Be connected with the others. meeting: where they find each other, as torch.distributed understands it."""
        if self.count == 1:
            yield
            return
        if device.type == "cuda":
            torch.cuda.set_device(device)
        backend = "nccl" if device.type == "cuda" else "gloo"
        distributed.init_process_group(backend, meeting, rank=self.rank, world_size=self.count)
        try:
            yield
        finally:
            distributed.destroy_process_group()

    def share(self, whole: int) -> slice:
        """This process's share of so many rows."""
        return slice(whole * self.rank // self.count, whole * (self.rank + 1) // self.count)

    def mean(self, values: Tensor) -> Tensor:
        """The mean over processes, of values without gradients."""
        if self.count == 1:
            return values
        values = values.detach().clone()
        distributed.all_reduce(values)
        return values / self.count


def started_by_torchrun() -> bool:
    """Whether torchrun started this process."""
    return "WORLD_SIZE" in os.environ


def default_count(device: str) -> int:
    """One process a GPU, or one a core."""
    if started_by_torchrun():
        return 1
    return max(1, gpus()) if device == "cuda" else 1 if device.startswith("cuda") else usable_cores()


def run_in_processes(count: int, work: Callable[..., Any], *arguments: Any) -> Any:
    """Call `work(processes, meeting, *arguments)` in so many new processes; what the first of them returns.

    Ctrl-C is passed on to them, once; a second one ends them. If one fails the others are ended, and its error is
    raised if it is one of ours.
    """
    os.environ.setdefault("TORCH_CPP_LOG_LEVEL", "ERROR")  # it warns of what some networks need and others do not
    answers = multiprocessing.get_context("spawn").SimpleQueue()
    with tempfile.TemporaryDirectory() as folder:
        meeting = (Path(folder) / "meeting").as_uri()
        started = multiprocessing.spawn(_work, (count, meeting, answers, work, arguments), count, join=False)
        interrupts = 0
        while True:
            try:
                if started.join():
                    break
            except KeyboardInterrupt:
                interrupts += 1
                for process in started.processes:
                    process.terminate() if interrupts > 1 else os.kill(process.pid, signal.SIGINT)
            except (multiprocessing.ProcessExitedException, multiprocessing.ProcessRaisedException) as error:
                if interrupts > 1:
                    raise KeyboardInterrupt from None
                if not answers.empty() and isinstance(answer := answers.get(), PushGraphError):
                    raise answer from None
                raise TrainingError(f"a process of the training ended: {str(error).strip()}") from None
    if answers.empty():  # Ctrl-C before there was anything to save
        raise KeyboardInterrupt
    answer = answers.get()
    if isinstance(answer, PushGraphError):
        raise answer
    return answer


def _work(
    rank: int,
    count: int,
    meeting: str,
    answers: Any,
    work: Callable[..., Any],
    arguments: tuple[Any, ...],
) -> None:
    if gpus() == 0:
        torch.set_num_threads(1)  # cores are shared out already
    try:
        own_modules.use()
        answer = work(Processes(rank, count, rank), meeting, *arguments)
    except TrainingInterrupted as interrupted:  # all of them stop; none is to be ended
        answer = interrupted
    except PushGraphError as error:
        answers.put(error)
        sys.exit(1)
    if rank == 0:
        answers.put(answer)
