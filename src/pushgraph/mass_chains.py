"""Masses as they may be: samples of what is believed, and what they say."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.graph.contact_graph import GRAVITY
from pushgraph.graph.scene_batch import SceneBatch
from pushgraph.mass_prior import MassClass
from pushgraph.network.mass_noise import Evidence

CHAINS = 32
"""Samples of each scene."""
BINS = 16
"""Answers tell apart so many equal parts of every class."""
ASKED = 24
"""An answer is the mean of so many moves of all chains, after they were drawn anew."""
SHARES = np.geomspace(1e-5, 1.0, 39)
"""Shares of the evidence that count, one after the other, while chains are drawn anew."""
FRICTION = (0.2, 0.6)
"""Between which the table's friction is taken to lie if it is unknown."""
LEVELS = (0.5, 0.16, 0.84)
"""Of a median, and of the ends of an interval that holds 68 %."""


class MassPosterior(NamedTuple):
    """What is believed of the mass of every body.

    probabilities: of the scene's classes. median, low, high: kg; low and high are the ends of the interval that holds
    68 %. slide_median, slide_low, slide_high: of the force that slides it, table friction times weight (N). samples:
    logarithms of masses (kg) as they may be together. friction: of the table; median, low and high. Of NumPy or torch.
    """

    probabilities: Float[Any, "batch bodies classes"]
    median: Float[Any, "batch bodies"]
    low: Float[Any, "batch bodies"]
    high: Float[Any, "batch bodies"]
    slide_median: Float[Any, "batch bodies"]
    slide_low: Float[Any, "batch bodies"]
    slide_high: Float[Any, "batch bodies"]
    samples: Float[Any, "batch samples bodies"]
    friction: Float[Any, "batch 3"]


class MassPriors(NamedTuple):
    """Of all variables of scenes: the logarithms of masses, and last of the table's friction.

    lowest, highest: of their classes, in rising order; a class whose highest is not above its lowest is none. density:
    logarithm of each class's share over its width. free: variables that are unknown. count: classes of masses.
    """

    lowest: Float[np.ndarray, "batch variables classes"]
    highest: Float[np.ndarray, "batch variables classes"]
    density: Float[np.ndarray, "batch variables classes"]
    free: Bool[np.ndarray, "batch variables"]
    order: np.ndarray
    """Of the scene's classes, where each stands among the rising ones."""

    @classmethod
    def of(cls, scenes: SceneBatch, classes: Sequence[Sequence[MassClass]]) -> "MassPriors":
        """Priors of scenes; classes: of each scene."""
        batch, bodies = scenes.mass.shape
        count = max(map(len, classes))
        lowest, highest = np.zeros((batch, bodies + 1, count)), np.zeros((batch, bodies + 1, count))
        density = np.zeros((batch, bodies + 1, count))
        order = np.tile(np.arange(count), (batch, 1))
        for k, some in enumerate(classes):
            rising = np.argsort([one.lowest for one in some], kind="stable").tolist()
            total = sum(one.share for one in some)
            for place, c in enumerate(rising):
                one = some[c]
                order[k, c] = place
                lowest[k, :bodies, place], highest[k, :bodies, place] = math.log(one.lowest), math.log(one.highest)
                density[k, :bodies, place] = math.log(one.share / total / (one.highest - one.lowest))
        lowest[:, bodies, 0], highest[:, bodies, 0] = np.log(FRICTION)
        density[:, bodies, 0] = -math.log(FRICTION[1] - FRICTION[0])
        free = np.ones((batch, bodies + 1), bool)
        free[:, :bodies] = (scenes.present & ~scenes.immovable & ~scenes.mass_known).cpu().numpy()
        free[:, bodies] = ~scenes.table_friction_known.cpu().numpy()
        return cls(lowest, highest, density, free, order)


class MassChains(NamedTuple):
    """Samples of the variables of scenes, which follow what is believed. of_prior: those of the prior."""

    priors: MassPriors
    samples: Float[np.ndarray, "batch chains variables"]
    of_prior: Float[np.ndarray, "batch chains variables"]

    @classmethod
    def begin(cls, scenes: SceneBatch, classes: Sequence[Sequence[MassClass]]) -> "MassChains":
        """Samples of the prior."""
        priors = MassPriors.of(scenes, classes)
        batch, variables = priors.free.shape
        known = torch.cat((scenes.mass.double(), scenes.table_friction.double()[:, None]), 1).log().cpu().numpy()
        # The same numbers for every scene, whatever stands beside it.
        uniforms = np.random.default_rng(0).random((CHAINS, variables, 2))
        weights = np.exp(priors.density) * np.clip(np.exp(priors.highest) - np.exp(priors.lowest), 0, None)
        upto = (weights / weights.sum(-1, keepdims=True)).cumsum(-1)
        chosen = (uniforms[None, ..., :1] > upto[:, None, :, :-1]).sum(-1)[..., None]
        lowest, highest = (
            np.exp(np.take_along_axis(np.broadcast_to(values[:, None], (batch, CHAINS, *values.shape[1:])), chosen, -1))
            for values in (priors.lowest, priors.highest)
        )
        drawn = np.log(lowest + (highest - lowest) * uniforms[None, ..., 1:])[..., 0]
        samples = np.where(priors.free[:, None], drawn, known[:, None])
        return cls(priors, samples, samples)

    def groups(self, evidence: Evidence) -> Int[np.ndarray, "batch bodies"]:
        """For each body the first of those whose mass relative to its own is known; itself, if there is none."""
        from pushgraph.network.compiled.mass_chains import tied

        free, bodies = self.priors.free, self.samples.shape[2] - 1
        everyone = zip(evidence.information.cpu().numpy(), np.ones_like(free), strict=True)
        return np.stack([tied(information, bodies, each)[0] for information, each in everyone])

    def mean(self) -> Float[Tensor, "batch variables"]:
        """Mean of every variable."""
        return torch.from_numpy(self.samples.mean(1))

    def sweep(self, evidence: Evidence, changed: Bool[Tensor, " batch"], number: int) -> "MassChains":
        """Move the chains of some scenes once. number: of this move, which settles the random numbers."""
        moved, _ = self._moved(evidence, changed.cpu().numpy(), 1, number, counted=0)
        return self._replace(samples=moved[-1])

    def draw_anew(self, evidence: Evidence, changed: Bool[Tensor, " batch"], number: int) -> "MassChains":
        """Draw the chains of some scenes from the prior on. number: of this draw, which settles the random numbers.

        However long they are moved, some stay in classes where they began when less was known.
        """
        # Compiled code takes half a second to import.
        from pushgraph.network.compiled.mass_chains import anneal

        information, pull = (values.detach().cpu().numpy() for values in evidence)
        samples, (lowest, highest, density, free, _) = self.samples.copy(), self.priors
        _, _, variables = samples.shape
        uniforms = np.random.default_rng(number).random((len(SHARES), CHAINS, _numbers(variables)))
        for k in np.flatnonzero(changed.cpu().numpy()):
            samples[k] = self.of_prior[k]
            anneal(
                *(samples[k], information[k], pull[k], lowest[k], highest[k], density[k], free[k]),
                *(uniforms, SHARES),
            )
        return self._replace(samples=samples)

    def answer(self, evidence: Evidence, scenes: SceneBatch) -> MassPosterior:
        """What is believed, by chains drawn anew."""
        batch, bodies = scenes.mass.shape
        drawn = self.draw_anew(evidence, torch.from_numpy(np.ones(batch, bool)), 0)
        moves, histogram = drawn._moved(evidence, np.ones(batch, bool), ASKED, 0, counted=bodies)
        samples = np.concatenate(moves, 1)
        classes = self.priors.lowest.shape[-1]
        parts = histogram.reshape(batch, bodies, classes, BINS)
        probabilities = np.take_along_axis(parts.sum(-1), self.priors.order[:, None], -1)
        quantiles = _quantiles(self.priors, parts)
        free = self.priors.free[:, :bodies]
        known = scenes.mass.double().cpu().numpy()
        quantiles = [np.where(free, values, known) for values in quantiles]
        sliding = np.exp(samples[..., :bodies] + samples[..., bodies:]) * GRAVITY
        slides = np.quantile(sliding, LEVELS, axis=1)
        known_friction = ~self.priors.free[:, bodies:]
        slides = [
            np.where(known_friction, mass * np.exp(samples[:, 0, bodies:]) * GRAVITY, slide)
            for mass, slide in zip(quantiles, slides, strict=True)
        ]
        friction = np.quantile(np.exp(samples[..., bodies]), LEVELS, axis=1).T
        arrays = (probabilities, *quantiles, *slides, samples[..., :bodies], friction)
        return MassPosterior(*(torch.from_numpy(np.ascontiguousarray(values)) for values in arrays))

    def _moved(
        self, evidence: Evidence, changed: Bool[np.ndarray, " batch"], moves: int, number: int, counted: int
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Samples after each of some moves, and the mean of the histograms of `counted` masses, of all or of none."""
        # Compiled code takes half a second to import.
        from pushgraph.network.compiled.mass_chains import sweep

        information, pull = (values.detach().cpu().numpy() for values in evidence)
        samples, (lowest, highest, density, free, _) = self.samples, self.priors
        batch, _, variables = samples.shape
        total = np.zeros((batch, counted, lowest.shape[-1] * BINS))
        histogram = np.zeros_like(total[0])
        after = []
        rng = np.random.default_rng(number)
        for _ in range(moves):
            samples, uniforms = samples.copy(), rng.random((CHAINS, _numbers(variables)))
            for k in np.flatnonzero(changed):
                sweep(
                    *(samples[k], information[k], pull[k], lowest[k], highest[k], density[k], free[k]),
                    *(uniforms, histogram),
                )
                total[k] += histogram / moves
            after.append(samples)
        return after, total


def _numbers(variables: int) -> int:
    """Random numbers that a move of a chain takes at most."""
    return 7 * variables + 2


def _quantiles(priors: MassPriors, parts: Float[np.ndarray, "batch bodies classes bins"]) -> list[np.ndarray]:
    """Masses at each of LEVELS (kg)."""
    bodies = parts.shape[1]
    low, high = (np.exp(values[:, :bodies]) for values in (priors.lowest, priors.highest))
    width = ((high - low) / BINS)[..., None]
    starts = low[..., None] + width * np.arange(BINS)
    starts, widths = (values.reshape(*parts.shape[:2], -1) for values in (starts, np.broadcast_to(width, starts.shape)))
    weights = parts.reshape(starts.shape)
    upto = weights.cumsum(-1)
    total = np.maximum(upto[..., -1:], 1e-12)
    found = []
    for level in LEVELS:
        place = (upto < level * total).sum(-1, keepdims=True).clip(0, upto.shape[-1] - 1)
        start, width_there, weight, until = (
            np.take_along_axis(values, place, -1) for values in (starts, widths, weights, upto)
        )
        share = np.clip(1 - (until - level * total) / np.maximum(weight, 1e-12), 0, 1)
        found.append((start + share * width_there)[..., 0])
    return found
