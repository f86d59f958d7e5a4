"""States how far off the predictions of physics weights may be."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pushgraph.checkpoint import load_checkpoint, shipped
from pushgraph.errors import CheckpointError
from pushgraph.graph.state import State
from pushgraph.graph.track_features import TrackFeatures, default_doubt, track_features
from pushgraph.network.spread_network import SPREADS, Scales
from pushgraph.spread import Spread


class SpreadModel:
    """A trained network that states spreads. record: how it was trained."""

    def __init__(self, network: nn.Module, record: Mapping[str, Any] | None = None) -> None:
        self.network, self.record = network, dict(record or {})

    @classmethod
    def load(cls, model: str | os.PathLike, physics: str | None, device: torch.device | str = "cpu") -> "SpreadModel":
        """Load a shipped spread by name, or the checkpoint in a file. physics: hash of the weights that predict.

        Raises CheckpointError if any part of it is not what it should be, or it was trained on other physics weights.
        """
        path = shipped(str(model)) if str(model) in SPREADS and not Path(model).is_file() else Path(model)
        checkpoint = load_checkpoint(path)
        if checkpoint.kind not in SPREADS:
            raise CheckpointError(f"{path}: holds {checkpoint.kind!r}, no spread; valid: {', '.join(SPREADS)}")
        if checkpoint.physics != physics:
            raise CheckpointError(
                f"{path}: states the spread of other physics weights than those that predict; the shipped one is of "
                f"the shipped {checkpoint.network.PHYSICS!r}, for others train one (pushgraph train spread)"
            )
        return cls(checkpoint.network.to(device).requires_grad_(False), checkpoint.record)

    def spread(
        self,
        states: State,
        poses: Float[Tensor, "batch frames bodies 3"],
        tool: Float[Tensor, "batch frames 3"],
        down: Bool[Tensor, "batch frames"],
        doubt: Float[Tensor, "batch pairs"] | None = None,
    ) -> Spread:
        """The spread of rollouts from `states`. doubt: probability that the relation of a pair in them is wrong."""
        doubt = default_doubt(states.relations) if doubt is None else doubt
        features = track_features(states.scenes, states.relations, poses, tool, down, doubt, states.motions)
        return spread_in_frames(self.network(features), features, poses.shape[1])


def spread_at_knots(scales: Scales, features: TrackFeatures) -> Spread:
    """The spread in those frames in which features were computed."""
    return Spread(direction=features.direction, farthest=features.farthest, **scales._asdict())


def spread_in_frames(scales: Scales, features: TrackFeatures, frames: int) -> Spread:
    """The spread in all frames: scales grow evenly between the knots, directions are those of the knot after."""
    knots = features.knots
    every = torch.arange(frames, device=knots.device)
    after = torch.searchsorted(knots, every)
    before = (after - 1).clamp(min=0)
    share = (every - knots[before]) / (knots[after] - knots[before]).clamp(min=1)
    share = share[:, None].to(scales.along.dtype)

    def between(values: Tensor) -> Tensor:
        return torch.lerp(values[:, before], values[:, after], share)

    at_knots = spread_at_knots(scales, features)
    return Spread(*map(between, at_knots))._replace(direction=features.direction[:, after])
