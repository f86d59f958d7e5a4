"""Adapted predictions of pushes that were left out: by push, by shape, by surface; resumable."""

import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pushgraph.adaptation.adapted import Adaptation, adapt, adapt_to_all, zero_shot
from pushgraph.dataset.engines import run_in_processes
from pushgraph.errors import EvaluationError
from pushgraph.evaluation.gaussian_baselines import gaussian_ends
from pushgraph.evaluation.real import Measured, errors_of, measured
from pushgraph.network.contract import Dynamics
from pushgraph.physics import PhysicsPredictor
from pushgraph.real_pushes import RealPushes
from pushgraph.storage import replacing

SIZES = (10, 30, 100, 213)
"""Pushes of the same shape and surface that are learnt from."""
REPEATS = 5
"""Random splits by push."""
FEWEST = 20
"""A material with fewer pushes left out than this is not split so."""
MOST = 100
"""Pushes that are left out and measured at a time."""
OTHERS = 1000
"""Pushes of other shapes, or of the other surface, that are learnt from."""


class Job(NamedTuple):
    """One split: indices of the pushes that are learnt from, and of those that are asked."""

    name: str
    split: str
    learnt_from: np.ndarray
    asked: np.ndarray
    contact: str
    pushes: RealPushes
    folder: Path


def jobs_of(pushes: RealPushes, seed: int, contact: str, folder: Path, sizes: tuple[int, ...] = SIZES) -> list[Job]:
    """All splits; raises EvaluationError if there are too few pushes for any."""
    found = []
    everything = np.arange(len(pushes))
    for surface, shape in pushes.materials:
        own = everything[pushes.of(surface, shape)]
        for repeat in range(REPEATS):
            drawn = np.random.default_rng((seed, repeat)).permutation(own)
            for size in sizes:
                if len(own) >= size + FEWEST:
                    split = drawn[:size], drawn[size : size + MOST]
                    found.append(
                        Job(f"push {surface} {shape} {repeat} {size}", "push", *split, contact, pushes, folder)
                    )
    for kind, names in (("shape", pushes.shape), ("surface", pushes.surface)):
        for name in dict.fromkeys(names.tolist()):
            left_out, others = everything[names == name], everything[names != name]
            if len(others) >= FEWEST:
                rng = np.random.default_rng((seed, 0))
                split = np.sort(rng.permutation(others)[:OTHERS]), np.sort(rng.permutation(left_out)[: 5 * MOST])
                found.append(Job(f"{kind} {name}", kind, *split, contact, pushes, folder))
    if not any(job.split == "push" for job in found):
        raise EvaluationError(
            f"too few pushes to split: no shape on a surface has {min(sizes) + FEWEST}; the most are "
            f"{max(int(pushes.of(*names).sum()) for names in pushes.materials)}"
        )
    return found


def evaluate_splits(
    pushes: RealPushes,
    seed: int,
    contact: str | os.PathLike = "contact",
    folder: Path = Path("splits"),
    workers: int = 1,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> list[Measured]:
    """Measure all splits; what `folder` holds already of the same pushes, seed and weights is not computed anew."""
    weights = PhysicsPredictor.load(contact).hash
    same = hashlib.sha256(f"{pushes.fingerprint} {seed} {weights}".encode()).hexdigest()[:12]
    jobs = jobs_of(pushes, seed, str(contact), folder / same, SIZES)
    for done, _ in enumerate(run_in_processes(_measure, jobs, workers), start=1):
        progress("splits", done, len(jobs))
    found: dict[tuple[str, int, str], list[Measured]] = {}
    for job in jobs:
        for one in _read(job):
            found.setdefault((one.split, one.adapted_with, one.model), []).append(one)
    return [
        Measured(
            model,
            np.concatenate([one.errors for one in some]),
            np.concatenate([one.index for one in some]),
            None if some[0].held is None else np.concatenate([one.held for one in some]),
            split,
            size,
        )
        for (split, size, model), some in sorted(found.items())
    ]


def _measure(job: Job) -> None:
    """Measure one split, unless it has been."""
    path = _path(job)
    if path.is_file():
        return
    dynamics, pushes, asked = _dynamics(job.contact), job.pushes, job.asked
    held_out, size = pushes.take(asked), _size(job)
    learnt = _adapted(job, dynamics)
    some = [
        measured("zero_shot", zero_shot(held_out).predict(dynamics, held_out), pushes, asked),
        measured("adapted", learnt.predict(dynamics, held_out), pushes, asked),
    ]
    some += [Measured(model, errors_of(ends[asked], held_out.after), asked) for model, ends in pushes.stated.items()]
    if job.split == "push":
        bases = {"gp": None} | ({"gp_poly4": "poly4"} if "poly4" in pushes.stated else {})
        for model, base in bases.items():
            ends = gaussian_ends(pushes, job.learnt_from, asked, base)
            some.append(Measured(model, errors_of(ends, held_out.after), asked))
    columns = {f"{one.model}.errors": one.errors for one in some}
    columns |= {f"{one.model}.held": one.held for one in some if one.held is not None}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **{"size": np.array(size), "index": asked, **columns})  # type: ignore[arg-type]  # names of columns are no settings


def _adapted(job: Job, dynamics: Dynamics) -> Adaptation:
    some = job.pushes.take(job.learnt_from)
    return adapt_to_all(dynamics, some) if job.split == "shape" else adapt(dynamics, some)


def _size(job: Job) -> int:
    return len(job.learnt_from)


def _read(job: Job) -> list[Measured]:
    with np.load(_path(job)) as file:
        models = [name.removesuffix(".errors") for name in file.files if name.endswith(".errors")]
        return [
            Measured(
                model,
                file[f"{model}.errors"],
                file["index"],
                file[f"{model}.held"] if f"{model}.held" in file.files else None,
                job.split,
                int(file["size"]),
            )
            for model in models
        ]


def _path(job: Job) -> Path:
    return job.folder / f"{job.name.replace(' ', '-')}.npz"


@functools.cache
def _dynamics(contact: str) -> Dynamics:
    return PhysicsPredictor.load(contact).dynamics
