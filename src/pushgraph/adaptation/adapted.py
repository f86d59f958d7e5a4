"""A predictor adapted to a robot, its objects and surfaces."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.adaptation.correction import FEWEST, MOST, Correction
from pushgraph.adaptation.fit import Linearized, fit, linearized, residuals
from pushgraph.adaptation.probe_offset import from_starts
from pushgraph.adaptation.scenes import with_unknowns
from pushgraph.adaptation.uncertainty import DEGREES, covariance, spread_of
from pushgraph.adaptation.unknowns import Estimate
from pushgraph.errors import AdaptationError
from pushgraph.network.contract import Dynamics
from pushgraph.real_pushes import RealPushes
from pushgraph.scene import Scene
from pushgraph.spread import Spread

Material = tuple[str, str]
"""Names of a surface and a shape."""
MOST_SHARED, MOST_OWN = 360, 150
"""So many pushes, evenly chosen, tell how far off other shapes are, and the unknowns of one: more tell no more."""
STATED = 0.68
"""Share of errors that spreads are widened to hold."""
TRUSTED = 20
"""So many pushes count as much as what spreads say without any."""


class Prediction(NamedTuple):
    """Final poses in the world, and how far off each may be."""

    ends: Float[np.ndarray, "pushes 3"]
    spread: Spread


@dataclass(frozen=True, eq=False)
class Adapted:
    """What was learnt of one object on one surface, or of all of them.

    pushes: how many it was learnt from. widening: factors of the deviations of positions and yaws.
    """

    estimate: Estimate
    correction: Correction | None = None
    widening: tuple[float, float] = (1.0, 1.0)
    pushes: int = 0

    def motion(self, dynamics: Dynamics, pushes: RealPushes) -> tuple[Float[np.ndarray, "pushes 3"], Spread]:
        """How objects move, in their own frames before, and the spread of where they end."""
        at = linearized(dynamics, pushes, self.estimate.mean)
        further = None if self.correction is None else self.correction.variance(pushes, at.motion)
        motion = at.motion if self.correction is None else self.correction.motion(pushes, at.motion)
        spread = spread_of(pushes, covariance(pushes, at, self.estimate.covariance, further), *self.widening)
        return motion, spread


ZERO_SHOT = Adapted(Estimate.prior())


@dataclass(frozen=True, eq=False)
class Adaptation:
    """What was learnt of materials, of surfaces, and of everything together."""

    shared: Adapted
    materials: Mapping[Material, Adapted] = field(default_factory=dict)
    surfaces: Mapping[str, Adapted] = field(default_factory=dict)

    def of(self, surface: str, shape: str) -> Adapted:
        """What is known of a material; of one that was not learnt, what is of its surface, or of all."""
        return self.materials.get((surface, shape), self.surfaces.get(surface, self.shared))

    def apply_to(self, scene: Scene, surface: str | None = None) -> Scene:
        """The scene on a surface, with the unknowns of bodies that bear the names of shapes that were learnt of there.

        surface: needed only if several were learnt of. Raises AdaptationError if it was not learnt of, or no body bears
        such a name. Corrections, and offsets of the probe, are not of the scene.
        """
        surfaces = list(dict.fromkeys(name for name, _ in self.materials))
        if surface is None and len(surfaces) == 1:
            surface = surfaces[0]
        if surface not in surfaces:
            raise AdaptationError(f"surface: {surface!r} was not learnt of; learnt: {', '.join(surfaces)}")
        learnt = {shape: own.estimate for (name, shape), own in self.materials.items() if name == surface}
        known = {name: learnt[name] for name in scene.names if name in learnt}
        if not known:
            raise AdaptationError(
                f"no body of the scene bears the name of a shape that was learnt of on {surface!r}: {', '.join(learnt)}"
            )
        return with_unknowns(scene, known)

    def predict(self, dynamics: Dynamics, pushes: RealPushes) -> Prediction:
        """Where recorded pushes end, each by what is known of its material; of surfaces that were not learnt, by what
        the starts of these pushes tell."""
        everything = replace(self, surfaces={**zero_shot(pushes).surfaces, **self.surfaces})
        ends, spreads = np.zeros((len(pushes), 3)), np.zeros((len(Spread._fields), len(pushes)))
        known = [everything.of(*names) for names in pushes.materials]
        for one in {id(one): one for one in known}.values():
            names = [name for name, own in zip(pushes.materials, known, strict=True) if own is one]
            chosen = np.any([pushes.of(*name) for name in names], axis=0)
            motion, spread = one.motion(dynamics, pushes.take(chosen))
            ends[chosen] = pose.compose(pushes.before[chosen], motion)
            spreads[:, chosen] = np.stack(spread)
        return Prediction(ends, Spread(*spreads))


def zero_shot(pushes: RealPushes) -> Adaptation:
    """What is known before any outcome is seen: where pushes start tells where the probe is on each surface."""
    surfaces = dict.fromkeys(pushes.surface.tolist())
    starts = {name: from_starts(pushes.take(pushes.of(name)), Estimate.prior()) for name in surfaces}
    return Adaptation(ZERO_SHOT, surfaces={name: Adapted(estimate) for name, estimate in starts.items()})


def adapt(
    dynamics: Dynamics,
    pushes: RealPushes,
    progress: Callable[[int, int], None] = lambda done, total: None,
    begun: Adaptation | None = None,
    keep: Callable[[Adaptation], None] = lambda learnt: None,
    grain: bool = False,
) -> Adaptation:
    """Learn from recorded pushes: how sure predictions of other shapes are, then each object on each surface by itself.

    begun: what an adaptation to the same pushes that was interrupted handed to `keep`, which takes what is learnt so
    far after every object on a surface. grain: whether tables may have one. Raises AdaptationError if there are too
    few pushes to learn from.
    """
    if len(pushes) < FEWEST:
        raise AdaptationError(f"{len(pushes)} pushes: too few to learn from; at least {FEWEST} are needed")
    materials = pushes.materials
    total = len(materials) + (len(materials) > 1)
    if len(materials) == 1:
        prior = from_starts(pushes, Estimate.prior())
        own = _learnt(dynamics, pushes, prior.with_grain() if grain else prior)
        return Adaptation(own, {materials[0]: own})
    learnt = begun or adapt_to_all(dynamics, pushes)
    progress(1, total)
    for number, (surface, shape) in enumerate(materials, start=2):
        of_material = pushes.take(pushes.of(surface, shape))
        if len(of_material) >= FEWEST and (surface, shape) not in learnt.materials:
            prior = learnt.surfaces[surface].estimate
            own = _learnt(dynamics, of_material, prior.with_grain() if grain else prior)
            learnt = replace(learnt, materials={**learnt.materials, (surface, shape): own})
            keep(learnt)
        progress(number, total)
    return learnt


def adapt_to_all(dynamics: Dynamics, pushes: RealPushes) -> Adaptation:
    """Learn what is known of shapes that were not pushed: where the probe is on each surface, and how far off they are.

    Friction and pressure of other shapes do not serve: fitted to all together they make one that is left out worse.
    """
    found = dict(zero_shot(pushes).surfaces)
    for surface, starts in found.items():
        own = pushes.take(pushes.of(surface))
        if len(own) >= FEWEST:
            found[surface] = _in_common(dynamics, own, starts.estimate)
    return Adaptation(_in_common(dynamics, pushes, Estimate.prior()), surfaces=found)


def _in_common(dynamics: Dynamics, pushes: RealPushes, estimate: Estimate) -> Adapted:
    """The same estimate, with how far off it is for different shapes together."""
    some = _evenly(pushes, MOST_SHARED)
    at = linearized(dynamics, some, estimate.mean)
    return Adapted(estimate, None, _held(some, at, estimate, None, residuals(at.motion, some)), len(pushes))


def _learnt(dynamics: Dynamics, pushes: RealPushes, prior: Estimate) -> Adapted:
    """Unknowns and a correction for one material; no correction where it serves nothing."""
    estimate = fit(dynamics, _evenly(pushes, MOST_OWN), prior)
    some = _evenly(pushes, MOST)
    at = linearized(dynamics, some, estimate.mean)
    tried = Correction.fit(some, at.motion)
    error = tried.left_out
    correction = tried if tried.strength else None
    return Adapted(estimate, correction, _held(some, at, estimate, correction, error), len(pushes))


def _held(
    pushes: RealPushes,
    at: Linearized,
    estimate: Estimate,
    correction: Correction | None,
    error: Float[np.ndarray, "pushes 3"],
) -> tuple[float, float]:
    """Factors of deviations that hold errors of motions as stated."""
    further = None if correction is None else correction.variance(pushes, at.motion)
    stated = spread_of(pushes, covariance(pushes, at, estimate.covariance, further))
    world = np.concatenate((pose.rotate(error[:, :2], pushes.before[:, 2]), error[:, 2:]), 1)
    return _widening(stated, world)


def _widening(stated: Spread, error: Float[np.ndarray, "pushes 3"]) -> tuple[float, float]:
    """Factors of deviations so that these errors are held as stated; few errors change little."""
    own = pose.rotate(error[:, :2], -stated.direction)
    radius = np.hypot(own[:, 0] / stated.along, own[:, 1] / stated.across)
    turn = np.abs(error[:, 2]) / stated.yaw
    held = np.sqrt(DEGREES * ((1 - STATED) ** (-2 / DEGREES) - 1)), DEGREES * ((1 - STATED) ** (-1 / DEGREES) - 1)
    count = len(error)
    position, turning = (
        np.quantile(values, STATED) / bound for values, bound in zip((radius, turn), held, strict=True)
    )

    def trusted(factor: float) -> float:
        return float((count * factor + TRUSTED) / (count + TRUSTED))

    return trusted(position), trusted(turning)


def _evenly(pushes: RealPushes, most: int) -> RealPushes:
    if len(pushes) <= most:
        return pushes
    return pushes.take(np.linspace(0, len(pushes) - 1, most).round().astype(int))
