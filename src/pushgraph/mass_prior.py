"""What is known of masses before anything is seen: classes such as light, normal and heavy."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field, StringConstraints, model_validator

from pushgraph.record import Record

ClassName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_ -]{0,31}$")]
Kilograms = Annotated[float, Field(ge=0.001, le=1000)]


class MassClass(Record):
    """Bodies of one kind, whose masses are spread evenly from `lowest` to `highest` (kg)."""

    name: ClassName
    lowest: Kilograms
    highest: Kilograms
    share: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """How many bodies are of this class, as a weight against those of the others."""

    @model_validator(mode="after")
    def _consistent(self) -> "MassClass":
        if not self.lowest < self.highest:
            raise ValueError(f"lowest must be less than highest, got {self.lowest:g} and {self.highest:g}")
        return self


LIGHT, NORMAL, HEAVY = (
    MassClass(name="light", lowest=0.2, highest=0.5),
    MassClass(name="normal", lowest=1.0, highest=2.0),
    MassClass(name="heavy", lowest=8.0, highest=10.0),
)
MASS_CLASSES = (LIGHT, NORMAL, HEAVY)
"""Those of the paper (setup of different masses), equally likely."""


def check_classes(classes: Sequence[MassClass]) -> None:
    """Raise ValueError unless there is a class, names differ and the classes do not overlap."""
    names = [one.name for one in classes]
    if not names:
        raise ValueError("mass_classes: at least one is needed")
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"mass_classes: the name {name!r} is used {names.count(name)} times; names must differ")
    ordered = sorted(classes, key=lambda one: one.lowest)
    for lighter, heavier in pairwise(ordered):
        if lighter.highest > heavier.lowest:
            raise ValueError(
                f"mass_classes: {lighter.name!r} ends at {lighter.highest:g} kg, beyond where {heavier.name!r} begins, "
                f"{heavier.lowest:g} kg; classes must not overlap"
            )


def shares_of(classes: Sequence[MassClass]) -> Float[np.ndarray, " classes"]:
    """Their probabilities."""
    shares = np.array([one.share for one in classes])
    return shares / shares.sum()


def class_of(classes: Sequence[MassClass], mass: float) -> int:
    """Index of the class that a mass (kg) belongs to: the one that holds it, or else the nearest in logarithms."""
    away = [max(math.log(one.lowest / mass), math.log(mass / one.highest), 0.0) for one in classes]
    return int(np.argmin(away))


def draw_masses(rng: np.random.Generator, classes: Sequence[MassClass], count: int) -> Float[np.ndarray, " count"]:
    """Masses (kg) drawn from the classes."""
    chosen = rng.choice(len(classes), count, p=shares_of(classes))
    lowest, highest = (np.array([getattr(one, end) for one in classes])[chosen] for end in ("lowest", "highest"))
    return rng.uniform(lowest, highest)


def prior_quantiles(
    classes: Sequence[MassClass], levels: Float[np.ndarray, " levels"]
) -> Float[np.ndarray, " levels"]:
    """Masses (kg) that this share of bodies stay below."""
    ordered = sorted(classes, key=lambda one: one.lowest)
    masses = np.array([[one.lowest, one.highest] for one in ordered]).ravel()
    upto = np.repeat(np.concatenate(([0.0], shares_of(ordered).cumsum())), 2)[1:-1]
    return np.interp(levels, upto, masses)
