"""Adapting from files: what it is worth is told by pushes left out, and what is done is kept."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pushgraph.adaptation.adapted import Adaptation, Adapted, Material, adapt, zero_shot
from pushgraph.adaptation.correction import FEWEST
from pushgraph.adaptation.files import load_adaptation, record_of, save_adaptation
from pushgraph.errors import AdaptationError
from pushgraph.physics import PhysicsPredictor
from pushgraph.pose import wrap_angle
from pushgraph.real_pushes import RealPushes
from pushgraph.storage import check_replaceable

LEFT_OUT = 5
"""One of so many pushes is left out for validation."""
WORSE = 1.02
"""An adaptation that is worse by more than this on pushes left out is not kept."""
TELLING = 8
"""Fewer pushes left out tell nothing: single ones differ by more than adapting changes."""


class Validation(NamedTuple):
    """Mean errors (mm, degrees) on pushes left out, before and after; kept: whether the adaptation is."""

    surface: str
    shape: str
    pushes: int
    before: tuple[float, float]
    after: tuple[float, float]

    @property
    def kept(self) -> bool:
        """Whether the adaptation is worth it, in both errors together, as far as so many pushes tell."""
        ratios = [after / max(before, 1e-9) for before, after in zip(self.before, self.after, strict=True)]
        return self.pushes < TELLING or (sum(ratios) <= 2 and max(ratios) <= WORSE)


class Session(NamedTuple):
    """What was learnt, and what it is worth."""

    adaptation: Adaptation
    validation: list[Validation]


def adapt_recorded(
    pushes: RealPushes,
    source: str,
    out: Path,
    count: int | None = None,
    contact: str | os.PathLike = "contact",
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
    grain: bool = False,
) -> Session:
    """Learn from recorded pushes, and write it to `out`; goes on with what `out` with `.partial` holds of the same.

    source: what to call the pushes in the record and in errors. grain: whether tables may have one.
    """
    check_replaceable(out)
    if count is not None and count < len(pushes):
        pushes = pushes.take(np.linspace(0, len(pushes) - 1, count).round().astype(int))
    if len(pushes) < FEWEST:
        raise AdaptationError(f"{source}: {len(pushes)} pushes: too few to learn from; at least {FEWEST} are needed")
    predictor = PhysicsPredictor.load(contact)
    record = {"data": source, "pushes": len(pushes), "fingerprint": pushes.fingerprint, "grain": grain}
    partial = out.with_name(f"{out.stem}.partial{out.suffix}")
    begun = _begun(partial, record, predictor.hash)

    def learn(some: RealPushes, what: str, stage: dict[str, Any]) -> Adaptation:
        known = begun.get(what)
        return adapt(
            predictor.dynamics,
            some,
            lambda done, n: progress(what, done, n),
            known,
            lambda learnt: save_adaptation(learnt, partial, predictor.hash, {**record, "stage": what, **stage}),
            grain,
        )

    left_out = np.zeros(len(pushes), dtype=bool)
    for names in pushes.materials:
        left_out[np.flatnonzero(pushes.of(*names))[LEFT_OUT - 1 :: LEFT_OUT]] = True
    if "learnt" in begun:
        rows = record_of(partial)["validation"]
        validation = [
            Validation(**row)._replace(before=tuple(row["before"]), after=tuple(row["after"])) for row in rows
        ]
    else:
        tried = learn(pushes.take(~left_out), "validated", {})
        validation = _validated(predictor, tried, pushes.take(left_out))
    found = [row._asdict() for row in validation]
    final = learn(pushes, "learnt", {"validation": found})
    refused = {(row.surface, row.shape) for row in validation if not row.kept}
    before = zero_shot(pushes).surfaces
    kept: dict[Material, Adapted] = {n: before[n[0]] if n in refused else own for n, own in final.materials.items()}
    adaptation = replace(final, materials=kept)
    save_adaptation(adaptation, out, predictor.hash, {**record, "stage": "whole", "validation": found})
    partial.unlink(missing_ok=True)
    return Session(adaptation, validation)


def _validated(predictor: PhysicsPredictor, adaptation: Adaptation, pushes: RealPushes) -> list[Validation]:
    before = zero_shot(pushes).predict(predictor.dynamics, pushes).ends - pushes.after
    after = adaptation.predict(predictor.dynamics, pushes).ends - pushes.after
    found = []
    for surface, shape in pushes.materials:
        own = pushes.of(surface, shape)
        found.append(Validation(surface, shape, int(own.sum()), _means(before[own]), _means(after[own])))
    return found


def _means(apart: np.ndarray) -> tuple[float, float]:
    turned = np.abs(wrap_angle(apart[:, 2]))
    return float(1e3 * np.hypot(apart[:, 0], apart[:, 1]).mean()), float(np.degrees(turned).mean())


def _begun(partial: Path, record: Mapping[str, Any], physics: str | None) -> dict[str, Adaptation]:
    """What was learnt so far of the same pushes, by what it was learnt for."""
    if not partial.is_file():
        return {}
    stands = record_of(partial)
    if any(stands.get(name) != value for name, value in record.items()):
        return {}
    return {stands["stage"]: load_adaptation(partial, physics)}
