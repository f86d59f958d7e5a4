"""`results.json`: one row a number, with its interval over scenes, so that any table or figure is a selection."""

import importlib.metadata
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.evaluation.metrics import CALIBRATION_BINS, calibration_bin
from pushgraph.storage import replacing

RESAMPLES = 1000


def _mean(values: np.ndarray, scene: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return weights @ np.bincount(scene, values) / (weights @ np.bincount(scene))


def _median(values: np.ndarray, scene: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The median of values, each there as often as its weight says: the mean of the two in the middle."""
    order = np.argsort(values, kind="stable")
    ordered, upto = values[order], weights[:, scene[order]].cumsum(1)
    total = upto[:, -1]
    low = (upto < ((total + 1) // 2)[:, None]).sum(1)
    high = (upto < (total // 2 + 1)[:, None]).sum(1)
    return (ordered[low] + ordered[high]) / 2


def _max(values: np.ndarray, scene: np.ndarray, weights: np.ndarray) -> np.ndarray:
    highest = np.full(weights.shape[1], -np.inf)
    np.maximum.at(highest, scene, values)
    return np.where(weights > 0, highest, -np.inf).max(1)


Statistic = Literal["mean", "median", "max"]
_STATISTICS = {"mean": _mean, "median": _median, "max": _max}


def _ranks(values: np.ndarray) -> np.ndarray:
    """Ranks as shares of the number of values; equal values share the mean of theirs."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    upto = count.cumsum()
    return ((upto - (count - 1) / 2) / max(len(values), 1))[place]


@cache
def _resamples(scenes: int) -> Int[np.ndarray, "resamples scenes"]:
    """How often each scene is in each resample."""
    drawn = np.random.default_rng(0).integers(scenes, size=(RESAMPLES, scenes))
    return np.stack([np.bincount(row, minlength=scenes) for row in drawn])


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
        statistic: Statistic = "mean",
        **labels: Any,
    ) -> None:
        """Add a statistic of values, each measured in a scene, with its 95 % bootstrap interval over scenes.

        Raises ValueError if a label is missing or not the suite's. Without values the row holds nulls.
        """
        values = np.asarray(values, dtype=float)
        self._add(model, metric, unit, scene, partial(_STATISTICS[statistic], values), labels)

    def add_calibration_error(
        self,
        model: str,
        top: Float[np.ndarray, " values"],
        right: Bool[np.ndarray, " values"],
        scene: Int[np.ndarray, " values"],
        **labels: Any,
    ) -> None:
        """Add the expected calibration error, `ece`, of answers given with probability `top`; see `add`."""
        gap, place = right - np.asarray(top, dtype=float), calibration_bin(top)

        def error(scene: np.ndarray, weights: np.ndarray) -> np.ndarray:
            gaps = np.zeros((weights.shape[1], CALIBRATION_BINS))
            np.add.at(gaps, (scene, place), gap)
            return np.abs(weights @ gaps).sum(1) / (weights @ np.bincount(scene))

        self._add(model, "ece", "1", scene, error, labels)

    def add_rank_correlation(
        self,
        model: str,
        metric: str,
        first: Float[np.ndarray, " values"],
        second: Float[np.ndarray, " values"],
        scene: Int[np.ndarray, " values"],
        **labels: Any,
    ) -> None:
        """Add Spearman's rank correlation of two values, ranked once among all; see `add`."""
        x, y = (_ranks(values) for values in (first, second))

        def correlation(scene: np.ndarray, weights: np.ndarray) -> np.ndarray:
            count = weights @ np.bincount(scene)
            mean_x, mean_y, xx, yy, xy = (
                weights @ np.bincount(scene, values) / count for values in (x, y, x * x, y * y, x * y)
            )
            variances = (xx - mean_x**2) * (yy - mean_y**2)
            return (xy - mean_x * mean_y) / np.sqrt(np.maximum(variances, 1e-12))

        self._add(model, metric, "1", scene, correlation, labels)

    def _add(
        self,
        model: str,
        metric: str,
        unit: str,
        scene: np.ndarray,
        statistic: Callable[[np.ndarray, np.ndarray], np.ndarray],
        labels: Mapping[str, Any],
    ) -> None:
        """Add a statistic; it takes the scene of every value, from 0 on, and how often each resample holds each."""
        if set(labels) != set(self.labels):
            raise ValueError(f"labels must be {sorted(self.labels)}, got {sorted(labels)}")
        value = low = high = None
        if len(scene):
            _, scene = np.unique(scene, return_inverse=True)
            count = int(scene.max()) + 1
            value = float(statistic(scene, np.ones((1, count), dtype=int))[0])
            if not math.isfinite(value):
                raise ValueError(f"{model}, {metric}: {value} is not a number to report")
            resampled = [statistic(scene, some) for some in np.array_split(_resamples(count), 20)]
            low, high = (float(bound) for bound in np.percentile(np.concatenate(resampled), [2.5, 97.5]))
        row = {"model": model, "metric": metric, "value": value, "low": low, "high": high, "unit": unit}
        self.rows.append({**row, **labels})

    def save(self, path: str | os.PathLike) -> None:
        """Write the results as JSON."""
        versions = {name: importlib.metadata.version(name) for name in ("pushgraph", "torch", "mujoco", "numpy")}
        content = {"suite": self.suite, "protocol": self.protocol, "versions": versions, "rows": self.rows}
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(content, indent=1))
