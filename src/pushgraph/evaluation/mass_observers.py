"""The best that can be said of masses by one who knows how the masses of touching bodies compare.

All forces of a push scale with mass, so its motion shows ratios of masses and nothing more; what they weigh together
follows from the prior.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from pushgraph.evaluation.mass_answers import MassAnswer, prior_answer, prior_mean, weighted_answer
from pushgraph.mass_prior import MassClass, shares_of

SCALES = 2000
"""Equally likely scales by which the ratio observer's answers are computed: quantiles are exact to this fraction."""


class ScalePosterior:
    """What is known of the masses of bodies whose ratios are known: all are `scale` times their ratio.

    ratios: masses relative to any unit, many sets side by side. With k bodies of prior density f, the scale s has the
    density s^(k-1) f(s r_1) ... f(s r_k), up to a constant: the Jacobian of s r_i times the prior. As f is constant
    within classes, this is s^(k-1) times a constant between any two scales at which a body enters or leaves a class.
    """

    def __init__(self, ratios: Float[np.ndarray, "sets bodies"], classes: Sequence[MassClass]) -> None:
        self.ratios = ratios
        sets, bodies = ratios.shape
        ends = np.array([(one.lowest, one.highest) for one in classes])
        density = shares_of(classes) / (ends[:, 1] - ends[:, 0])
        edges = np.sort((ends.ravel() / ratios[..., None]).reshape(sets, -1), -1)
        middles = np.sqrt(edges[:, 1:] * edges[:, :-1])[:, :, None, None] * ratios[:, None, :, None]
        inside = (middles > ends[:, 0]) & (middles < ends[:, 1])
        height = (inside * density).sum(-1).prod(-1)
        power = edges**bodies
        upto = np.cumsum(height * np.diff(power, axis=-1) / bodies, -1)
        self._power, self._upto = power, np.concatenate((np.zeros((sets, 1)), upto), -1)

    @property
    def evidence(self) -> Float[np.ndarray, " sets"]:
        """Prior density of each set of ratios, per unit of the logarithm of all ratios to the first, up to the same
        constant for all sets of as many bodies; zero where no masses have such ratios."""
        relative = self.ratios / self.ratios[:, :1]
        return self._upto[:, -1] * (self.ratios[:, 0] ** self.ratios.shape[1]) * relative.prod(-1)

    def quantiles(self, levels: Float[np.ndarray, " levels"]) -> Float[np.ndarray, "sets levels"]:
        """Scales that are not exceeded with these probabilities."""
        bodies = self.ratios.shape[1]
        rows = zip(self._upto, self._power, strict=True)
        return np.stack([np.interp(levels * upto[-1], upto, power) for upto, power in rows]) ** (1 / bodies)


def ratio_observer(
    masses: Float[np.ndarray, " bodies"], groups: Int[np.ndarray, " bodies"], classes: Sequence[MassClass]
) -> MassAnswer:
    """What one can say who knows the prior, and exactly the ratios of masses inside every group.

    groups: label of the group that each body is in; a body alone in its own answers the prior.
    """
    levels = (np.arange(SCALES) + 0.5) / SCALES
    answer = prior_answer(classes, len(masses))
    for label in np.unique(groups):
        members = np.flatnonzero(groups == label)
        if len(members) == 1:
            continue
        ratios = masses[members] / masses[members[0]]
        scales = ScalePosterior(ratios[None], classes).quantiles(levels)[0]
        answer_of_group = weighted_answer(scales[:, None] * ratios, np.full(SCALES, 1 / SCALES), classes)
        for whole, part in zip(answer, answer_of_group, strict=True):
            whole[members] = part
    return answer


def mean_guess(classes: Sequence[MassClass], bodies: int) -> MassAnswer:
    """The prior's mean, whatever was seen."""
    return prior_answer(classes, bodies)._replace(median=np.full(bodies, prior_mean(classes)))
