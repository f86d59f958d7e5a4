"""What was believed of masses over time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from pushgraph.believed_mass import BelievedMass, Interval
from pushgraph.errors import BeliefError
from pushgraph.scene import Scene

DIGITS = 5
"""Decimal places in files."""


@dataclass(frozen=True, eq=False)
class MassHistory:
    """What was believed of the masses of some bodies, at some moments.

    classes: names, in the scene's order. times: seconds. quantiles: median, and the ends of the interval that holds
    68 % (kg). believed: in the end, body by body in the order of the arrays. friction: of the table, its median and
    ends; None if the scene tells it.
    """

    classes: Sequence[str]
    times: Float[np.ndarray, " moments"]
    probabilities: Float[np.ndarray, "moments bodies classes"]
    quantiles: Float[np.ndarray, "moments bodies 3"]
    believed: Sequence[BelievedMass]
    friction: Float[np.ndarray, "moments 3"] | None = None

    @classmethod
    def of(
        cls, moments: Mapping[float, Sequence[BelievedMass]], frictions: Sequence[Interval | None]
    ) -> "MassHistory | None":
        """Of what was believed at each time (s), and then of the table's friction; None if no mass was learnt."""
        *_, believed = moments.values()
        if not believed:
            return None
        classes = list(believed[0].classes)
        probabilities = [[[mass.classes[name] for name in classes] for mass in masses] for masses in moments.values()]
        quantiles = [[mass.mass for mass in masses] for masses in moments.values()]
        friction = None if None in frictions else np.array(frictions)
        return cls(classes, np.array(list(moments)), np.array(probabilities), np.array(quantiles), believed, friction)

    def to_json(self) -> dict[str, Any]:
        """Plain values, as they stand in beliefs.json."""
        return {
            "classes": list(self.classes),
            "times": np.round(self.times, DIGITS).tolist(),
            "probabilities": np.round(self.probabilities, DIGITS).tolist(),
            "quantiles": np.round(self.quantiles, DIGITS).tolist(),
            "believed": [mass.to_json() for mass in self.believed],
            "friction": None if self.friction is None else np.round(self.friction, DIGITS).tolist(),
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any], scene: Scene, where: str) -> "MassHistory":
        """The inverse of `to_json`; `where` names it in errors.

        Raises KeyError or TypeError if anything is missing, and BeliefError if it cannot be or is not about the scene.
        """
        classes = list(content["classes"])
        known = [one.name for one in scene.classes_of_mass]
        if classes != known:
            raise BeliefError(f"{where}: the classes are {_listed(classes)}; those of the scene are {_listed(known)}")
        try:
            times, probabilities, quantiles = (
                np.array(content[name], dtype=float) for name in ("times", "probabilities", "quantiles")
            )
        except ValueError:
            raise BeliefError(f"{where}: times, probabilities, quantiles: rows differ in length") from None
        believed = [BelievedMass.from_json(mass) for mass in content["believed"]]
        _check_bodies(believed, scene, where)
        for mass in believed:
            of_body = f"{where}: body {mass.body!r}"
            if list(mass.classes) != classes:
                raise BeliefError(f"{of_body}: classes must be {_listed(classes)}; got {_listed(mass.classes)}")
            _check_probabilities(np.array(list(mass.classes.values())), of_body)
            _check_intervals(np.array([mass.mass, mass.slide, *mass.ratios.values()]), of_body)
        shape = len(times), len(believed), len(classes)
        for name, array, wanted in (
            ("times", times, (len(times),)),
            ("probabilities", probabilities, shape),
            ("quantiles", quantiles, (*shape[:2], 3)),
        ):
            if array.shape != wanted:
                raise BeliefError(f"{where}: {name}: shape must be {wanted}, got {array.shape}")
        if not believed or not (np.diff(times, prepend=-np.inf) > 0).all():
            raise BeliefError(f"{where}: there must be a body, and finite times that rise")
        _check_probabilities(probabilities, where)
        _check_intervals(quantiles, where)
        friction = None
        if content.get("friction") is not None:
            friction = np.array(content["friction"], dtype=float)
            if friction.shape != (len(times), 3):
                raise BeliefError(f"{where}: friction: shape must be {(len(times), 3)}, got {friction.shape}")
            _check_intervals(friction, where)
        return cls(classes, times, probabilities, quantiles, believed, friction)


def with_masses(scene: Scene, believed: Sequence[BelievedMass]) -> Scene:
    """The scene with the medians of what is believed of masses."""
    medians = {mass.body: mass.mass[0] for mass in believed}
    return scene.replace(bodies=tuple(body.replace(mass=medians.get(body.name, body.mass)) for body in scene.bodies))


def _check_bodies(believed: Sequence[BelievedMass], scene: Scene, where: str) -> None:
    bodies = [mass.body for mass in believed]
    strangers = [name for mass in believed for name in (mass.body, *mass.ratios) if name not in scene.names]
    if strangers:
        raise BeliefError(f"{where}: {strangers[0]!r} is no body of the scene; valid: {_listed(scene.names)}")
    if len(set(bodies)) != len(bodies):
        raise BeliefError(f"{where}: a body stands there twice: {_listed(bodies)}")


def _check_probabilities(probabilities: Float[np.ndarray, "*rows classes"], where: str) -> None:
    if not ((probabilities >= 0).all() and (np.abs(probabilities.sum(-1) - 1) < 1e-3).all()):
        raise BeliefError(f"{where}: probabilities of classes must be at least 0, and 1 together")


def _check_intervals(intervals: Float[np.ndarray, "*rows 3"], where: str) -> None:
    median, low, high = np.moveaxis(intervals, -1, 0)
    if not ((low > 0) & (low <= median) & (median <= high) & np.isfinite(high)).all():
        raise BeliefError(
            f"{where}: masses, forces, ratios and frictions must be [median, low, high], finite, with 0 < low <= "
            "median <= high"
        )


def _listed(names: Sequence[str] | Mapping[str, float]) -> str:
    return ", ".join(map(str, names)) or "none"
