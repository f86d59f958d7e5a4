"""`results.json`: one row a number, with its interval over scenes, so that any table or figure is a selection."""

import importlib.metadata
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pushgraph.storage import replacing

RESAMPLES = 1000


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
        per_scene: Sequence[Any],
        statistic: Callable[[list[Any]], float],
        **labels: Any,
    ) -> None:
        """Add a statistic of what was measured in each scene, with its 95 % bootstrap interval over scenes.

        Raises ValueError if a label is missing or not the suite's.
        """
        if set(labels) != set(self.labels):
            raise ValueError(f"labels must be {sorted(self.labels)}, got {sorted(labels)}")
        rng = np.random.default_rng(0)
        count = len(per_scene)
        resampled = [statistic([per_scene[k] for k in rng.integers(count, size=count)]) for _ in range(RESAMPLES)]
        low, high = np.percentile(resampled, [2.5, 97.5])
        value = statistic(list(per_scene))
        self.rows.append(
            {"model": model, "metric": metric, "value": value, "low": float(low), "high": float(high), "unit": unit}
            | labels
        )

    def save(self, path: str | os.PathLike) -> None:
        """Write the results as JSON."""
        versions = {name: importlib.metadata.version(name) for name in ("pushgraph", "torch", "mujoco", "numpy")}
        content = {"suite": self.suite, "protocol": self.protocol, "versions": versions, "rows": self.rows}
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(content, indent=1))
