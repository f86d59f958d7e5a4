"""`results.json`: one row a number, with its interval over scenes, so that any table or figure is a selection."""

import importlib.metadata
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from pushgraph.storage import replacing

RESAMPLES = 1000


def _mean(ordered: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return weights @ ordered / weights.sum(1)


def _median(ordered: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The median of values, each there as often as its weight says: the mean of the two in the middle."""
    upto = weights.cumsum(1)
    total = upto[:, -1]
    low = (upto < ((total + 1) // 2)[:, None]).sum(1)
    high = (upto < (total // 2 + 1)[:, None]).sum(1)
    return (ordered[low] + ordered[high]) / 2


def _max(ordered: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return ordered[len(ordered) - 1 - (weights[:, ::-1] > 0).argmax(1)]


_STATISTICS = {"mean": _mean, "median": _median, "max": _max}


@dataclass
class Results:
    """The numbers of one suite; `labels` are those that every row carries."""

    suite: str
    protocol: Mapping[str, Any]
    labels: Sequence[str]
    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(
        self,
        model: str,
        metric: str,
        unit: str,
        values: Float[np.ndarray, " values"],
        scene: Int[np.ndarray, " values"],
        statistic: Literal["mean", "median", "max"] = "mean",
        **labels: Any,
    ) -> None:
        """Add a statistic of values, each measured in a scene, with its 95 % bootstrap interval over scenes.

        Raises ValueError if a label is missing or not the suite's. Without values the row holds nulls.
        """
        if set(labels) != set(self.labels):
            raise ValueError(f"labels must be {sorted(self.labels)}, got {sorted(labels)}")
        value = low = high = None
        if len(values):
            order = np.argsort(values, kind="stable")
            ordered = np.asarray(values, dtype=float)[order]
            _, place = np.unique(scene, return_inverse=True)
            value = float(_STATISTICS[statistic](ordered, np.ones((1, len(ordered))))[0])
            if not math.isfinite(value):
                raise ValueError(f"{model}, {metric}: {value} is not a number to report")
            drawn = np.random.default_rng(0).integers(place.max() + 1, size=(RESAMPLES, place.max() + 1))
            weights = np.stack([np.bincount(row, minlength=place.max() + 1) for row in drawn])
            resampled = np.concatenate(
                [_STATISTICS[statistic](ordered, some[:, place[order]]) for some in np.array_split(weights, 20)]
            )
            low, high = (float(bound) for bound in np.percentile(resampled, [2.5, 97.5]))
        self.rows.append(
            {"model": model, "metric": metric, "value": value, "low": low, "high": high, "unit": unit} | labels
        )

    def save(self, path: str | os.PathLike) -> None:
        """Write the results as JSON."""
        versions = {name: importlib.metadata.version(name) for name in ("pushgraph", "torch", "mujoco", "numpy")}
        content = {"suite": self.suite, "protocol": self.protocol, "versions": versions, "rows": self.rows}
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(content, indent=1))
