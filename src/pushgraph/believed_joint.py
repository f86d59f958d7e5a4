"""A joint as it is believed: of which kind, where it sits, how far it was seen to move, and how sure all that is."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from torch import Tensor

from pushgraph import pose
from pushgraph.graph.believed import JointPlaces


class BelievedJoint(NamedTuple):
    """World frame, as the bodies stood when it was asked for.

    kind: fixed, prismatic or revolute, the likeliest, with its `probability`. anchor: of a hinge (m), with the standard
    deviation in either direction; None for others. axis: unit vector along which the child slides, with the standard
    deviation of its direction (rad); None for others. reached: lowest and highest angle (rad) or displacement (m) of
    the child, relative to the parent, since they were first adjacent: what limits there are lie beyond.
    """

    parent: str
    child: str
    kind: str
    probability: float
    anchor: tuple[float, float] | None = None
    anchor_spread: float | None = None
    axis: tuple[float, float] | None = None
    axis_spread: float | None = None
    reached: tuple[float, float] | None = None

    @classmethod
    def of(
        cls,
        names: tuple[str, str],
        kind: str,
        probability: float,
        places: JointPlaces,
        row: int,
        pose_world_from_parent: Float[np.ndarray, "3"],
    ) -> "BelievedJoint":
        """Of the pair that stands in `row` of the places of one scene."""
        joint = cls(*names, kind, probability)
        if kind == "revolute":
            anchor = pose.transform(pose_world_from_parent, places.anchor_a[0, row].cpu().numpy())
            return joint._replace(
                anchor=_pair(anchor),
                anchor_spread=float(places.anchor_spread[0, row]),
                reached=_pair(places.turned[0, row]),
            )
        if kind == "prismatic":
            axis = pose.rotate(places.axis[0, row].cpu().numpy(), pose_world_from_parent[2])
            spread = min(float(places.axis_spread[0, row]), math.pi / 2)
            return joint._replace(axis=_pair(axis), axis_spread=spread, reached=_pair(places.slid[0, row]))
        return joint

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "BelievedJoint":
        """What `to_json` gives; raises TypeError or ValueError if it is not that."""
        pairs = {name: _pair_of(content[name]) for name in ("anchor", "axis", "reached") if name in content}
        return cls(**{**content, **pairs})

    def to_json(self) -> dict[str, Any]:
        """What there is, by name."""
        return {name: value for name, value in self._asdict().items() if value is not None}


def _pair_of(values: Sequence[float]) -> tuple[float, float]:
    first, second = values
    return float(first), float(second)


def _pair(values: np.ndarray | Tensor) -> tuple[float, float]:
    return _pair_of(values.tolist())
