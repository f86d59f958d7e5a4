"""What decides a training."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from pushgraph.errors import TrainingError
from pushgraph.network.contract import Schema


@dataclass(frozen=True)
class Training:
    """What decides a training. A sample is one frame of one window."""

    TASK: ClassVar[str]
    MODELS: ClassVar[Mapping[str, type[Schema]]]
    VALIDATIONS: ClassVar[int] = 20
    FILES: ClassVar[tuple[str, ...]] = ("data", "validation", "start_from")
    """Settings that name files."""

    model: str
    data: str
    validation: str
    samples: int
    frames: int
    batch: int
    learning_rate: float
    hidden: int
    precision: str = "float32"
    seed: int = 0
    start_from: str | None = None

    def __post_init__(self) -> None:
        if self.model not in self.MODELS:
            raise TrainingError(f"no model {self.model!r}; valid: {', '.join(self.MODELS)}")
        if self.precision not in ("float32", "bfloat16"):
            raise TrainingError(f"precision: must be float32 or bfloat16, got {self.precision!r}")
        for name in ("samples", "frames", "batch", "hidden"):
            if getattr(self, name) < 1:
                raise TrainingError(f"{name}: must be at least 1, got {getattr(self, name)}")
        if not self.learning_rate > 0:
            raise TrainingError(f"learning_rate: must be positive, got {self.learning_rate}")
        for name in ("data", "validation"):
            if not Path(getattr(self, name)).is_file():
                raise TrainingError(f"{name}: no such dataset: {getattr(self, name)}; make it with pushgraph generate")

    @property
    def steps(self) -> int:
        """Optimizer steps."""
        return max(1, self.samples // (self.batch * self.frames))

    @property
    def config(self) -> dict[str, int]:
        """Config of the network."""
        return {"hidden": self.hidden}

    def folder(self, cache: Path) -> Path:
        """Where this training runs."""
        digest = hashlib.sha256(json.dumps(dataclasses.asdict(self), sort_keys=True).encode()).hexdigest()
        return cache / "training" / f"{self.TASK}-{self.model}-{digest[:10]}"

    def without_folders(self) -> dict[str, Any]:
        """The settings; of files only their names, which mean something elsewhere."""
        settings = dataclasses.asdict(self)
        names = [name for name in self.FILES if name in settings]
        return settings | {name: settings[name] and Path(settings[name]).name for name in names}
