"""Adapted predictions of pushes that were left out: by push, by shape, by surface; resumable."""

import functools
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pushgraph.adaptation.adapted import Adaptation, adapt, adapt_to_all, zero_shot
from pushgraph.dataset.engines import run_in_processes
from pushgraph.errors import EvaluationError
from pushgraph.evaluation.gaussian_baselines import gaussian_ends
from pushgraph.evaluation.kept import fingerprint, keep, kept
from pushgraph.evaluation.real import Measured, errors_of, measured
from pushgraph.network.contract import Dynamics
from pushgraph.physics import PhysicsPredictor
from pushgraph.real_pushes import RealPushes

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
    """One split: indices of the pushes that are learnt from, and of those that are asked.

    stands_for: fingerprint of what its results depend on.
    """

    name: str
    split: str
    learnt_from: np.ndarray
    asked: np.ndarray
    contact: str
    pushes: RealPushes
    folder: Path
    stands_for: str = ""


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
    """Measure all splits; what `folder` holds of the same pushes, seed, weights and version is not computed anew."""
    same = fingerprint(pushes.fingerprint, seed, PhysicsPredictor.load(contact).hash)
    jobs = [
        job._replace(stands_for=fingerprint(same, job.name, job.learnt_from, job.asked))
        for job in jobs_of(pushes, seed, str(contact), folder / same[:12], SIZES)
    ]
    measured: dict[str, list[Measured]] = {}
    for done, (job, some) in enumerate(run_in_processes(_measure, jobs, workers), start=1):
        measured[job.name] = some
        progress("splits", done, len(jobs))
    found: dict[tuple[str, int, str], list[Measured]] = {}
    for job in jobs:
        for one in measured[job.name]:
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


def _measure(job: Job) -> list[Measured]:
    """Measure one split, unless it has been."""
    path = job.folder / f"{job.name.replace(' ', '-')}.npz"
    if (arrays := kept(path, job.stands_for)) is not None:
        return _of_arrays(job, arrays)
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
    arrays = {"size": np.array(size), "index": asked, **columns}
    keep(path, job.stands_for, arrays)
    return _of_arrays(job, arrays)


def _adapted(job: Job, dynamics: Dynamics) -> Adaptation:
    some = job.pushes.take(job.learnt_from)
    return adapt_to_all(dynamics, some) if job.split == "shape" else adapt(dynamics, some)


def _size(job: Job) -> int:
    return len(job.learnt_from)


def _of_arrays(job: Job, arrays: Mapping[str, np.ndarray]) -> list[Measured]:
    models = [name.removesuffix(".errors") for name in arrays if name.endswith(".errors")]
    size = int(arrays["size"])
    return [
        Measured(model, arrays[f"{model}.errors"], arrays["index"], arrays.get(f"{model}.held"), job.split, size)
        for model in models
    ]


@functools.cache
def _dynamics(contact: str) -> Dynamics:
    return PhysicsPredictor.load(contact).dynamics
