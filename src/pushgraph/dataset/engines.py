"""Run independent tasks side by side: in this process, in processes of this machine, or over a Ray cluster."""

import concurrent.futures
import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import torch

from pushgraph import own_modules
from pushgraph.errors import DatasetError
from pushgraph.extras import extra

Task = TypeVar("Task")
Result = TypeVar("Result")
Engine = Callable[[Callable[[Task], Result], Sequence[Task], int], Iterator[tuple[Task, Result]]]


def run_in_processes(
    work: Callable[[Task], Result], tasks: Sequence[Task], workers: int
) -> Iterator[tuple[Task, Result]]:
    """Yield each task with its result as it is done; one worker runs in this process."""
    if workers == 1:
        with single_threaded():
            yield from ((task, work(task)) for task in tasks)
        return
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(workers, context, _prepare_worker) as pool:
        futures = {pool.submit(work, task): task for task in tasks}
        try:
            for future in concurrent.futures.as_completed(futures):
                yield futures[future], future.result()
        except concurrent.futures.process.BrokenProcessPool:
            raise DatasetError(
                "a worker process died, perhaps for lack of memory; run the same command again to go on, with fewer "
                "workers if it happens again"
            ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def run_on_ray(work: Callable[[Task], Result], tasks: Sequence[Task], workers: int) -> Iterator[tuple[Task, Result]]:
    """The same over the Ray cluster that RAY_ADDRESS names, or a local one with this many workers."""
    with extra("cluster", "the engine ray"):
        import ray
    started = not ray.is_initialized()
    if started:
        address = os.environ.get("RAY_ADDRESS")
        ray.init(**({"address": address} if address else {"num_cpus": workers}), log_to_driver=False)
    try:
        remote: Any = ray.remote(num_cpus=1, max_retries=3)(_single_threaded_work)
        waiting = {remote.remote(work, task): task for task in tasks}
        while waiting:
            done, _ = ray.wait(list(waiting), num_returns=1)
            yield waiting.pop(done[0]), ray.get(done[0])
    finally:
        if started:
            ray.shutdown()


ENGINES: dict[str, Engine] = {"processes": run_in_processes, "ray": run_on_ray}


def _prepare_worker() -> None:
    """One thread a worker, which knows what is the user's own; an interrupt is for the process that shares out the
    work."""
    torch.set_num_threads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    own_modules.use()


def _single_threaded_work(work: Callable[[Task], Result], task: Task) -> Result:
    own_modules.use()
    with single_threaded():
        return work(task)


@contextlib.contextmanager
def single_threaded() -> Iterator[None]:
    """Keep torch on one thread: the work is small, and the other cores have workers of their own."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
