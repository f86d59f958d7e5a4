"""Scores of tracks: their cost as predicted, or over how far off the prediction may be."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float

from pushgraph.errors import PlanningError
from pushgraph.planning.costs import Cost
from pushgraph.planning.exhaustive import costs_on_table
from pushgraph.track import Track

Score = Callable[[Sequence[Track]], Float[np.ndarray, "plans frames"]]
"""Of tracks in every frame (m), shorter ones going on as they end; less is better, infinite is never chosen."""
Risk = Callable[[Cost], Score]
"""Makes a score of a cost: `as_predicted`, `expected` or `percentile`."""
SAMPLES = 32


def as_predicted(cost: Cost) -> Score:
    """The cost of what is predicted."""
    return lambda tracks: costs_on_table(tracks, cost)


def expected(cost: Cost, samples: int = SAMPLES) -> Score:
    """The mean cost over the spread; tracks have to state theirs."""
    return _over_spread(cost, samples, lambda costs: costs.mean(0))


def percentile(cost: Cost, share: float = 0.9, samples: int = SAMPLES) -> Score:
    """The cost that is not exceeded with this probability."""
    if not 0 <= share <= 1:
        raise PlanningError(f"percentile: must be between 0 and 1, got {share:g}")
    return _over_spread(cost, samples, lambda costs: np.quantile(costs, share, axis=0))


def _over_spread(cost: Cost, samples: int, summary: Callable[[np.ndarray], np.ndarray]) -> Score:
    def score(tracks: Sequence[Track]) -> Float[np.ndarray, "plans frames"]:
        nominal = costs_on_table(tracks, cost)
        bodies = len(tracks[0].scene.bodies)
        # The same numbers for all plans, so that plans differ by what they do and not by what was drawn.
        uniform = np.random.default_rng(0).random((samples, 1, bodies, 3))
        scores = np.empty_like(nominal)
        for k, track in enumerate(tracks):
            if track.spread is None:
                raise PlanningError("risk: the tracks state no spread; predict with learned(predictor, spread=True)")
            frames = len(track.times)
            errors = track.spread.errors(np.broadcast_to(uniform, (samples, frames, bodies, 3)))
            costs = cost(torch.from_numpy(track.poses[:, 1:] + errors)).numpy()
            scores[k, :frames] = summary(costs)
            scores[k, frames:] = scores[k, frames - 1]
        return np.where(np.isinf(nominal), np.inf, scores)

    return score
