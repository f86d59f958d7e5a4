"""What decides a training, for every task: its recipe."""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from pushgraph.errors import TrainingError
from pushgraph.training.settings import Settings

Count = Annotated[int, Field(ge=1)]


class Training(Settings):
    """What decides a training. A sample is one frame of one window."""

    TASK: ClassVar[str]
    VALIDATIONS: ClassVar[int] = 20
    FILES: ClassVar[tuple[str, ...]] = ("data", "validation", "start_from")

    model: str
    """Name of the network."""
    data: str
    """Training data, from pushgraph generate."""
    validation: str
    """Data on which the weights are chosen."""
    samples: Count
    frames: Count
    batch: Count
    learning_rate: Annotated[float, Field(gt=0)]
    """Its peak."""
    hidden: Count
    """Width of the network."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of first weights and batches."""
    start_from: str | None = None
    """A checkpoint whose weights to begin with."""
    least_gain: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """What training starts from is kept unless something validates better by this share; validations are noisy."""
    share_of_start: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Where this is not 0, nothing is chosen by validation: weights are the mean of those it starts from, which count
    this much, and the last, the noise of both trainings averaging out (Wortsman et al. 2022, arXiv 2109.01903)."""

    def model_post_init(self, _: Any) -> None:
        """Raise TrainingError if there is no such network, or no such file."""
        from pushgraph.network.registry import networks_of

        if self.model not in (networks := networks_of(self.TASK)):
            raise TrainingError(f"model: no network {self.model!r} to train; valid: {', '.join(networks)}")
        for name in ("data", "validation"):
            self._check_file(name, "pushgraph generate")
        if self.share_of_start and self.start_from is None:
            raise TrainingError("share_of_start: needs start_from, weights to take the mean with")

    def _check_file(self, name: str, maker: str) -> None:
        if not Path(getattr(self, name)).is_file():
            raise TrainingError(f"{name}: no such dataset: {getattr(self, name)}; make it with {maker}")

    @property
    def steps(self) -> int:
        """Optimizer steps."""
        return max(1, self.samples // (self.batch * self.frames))

    @property
    def config(self) -> dict[str, int]:
        """Config of the network."""
        return {"hidden": self.hidden}


class _Propagating(Training):
    """A training of networks that pass messages in several steps."""

    propagation_steps: Count = 2
    """Steps in which messages travel."""

    @property
    def config(self) -> dict[str, int]:
        """Config of the network."""
        return {"hidden": self.hidden, "steps": self.propagation_steps}


class PhysicsTraining(_Propagating):
    """What decides a training of physics prediction. A sample is one predicted frame of one window."""

    TASK: ClassVar[str] = "physics"

    model: str = "contact"
    """contact (ours), propnet or image (the paper's), or a registered one."""
    samples: Count = 20_000_000
    """Predicted frames of training windows, all in all."""
    frames: Count = 4
    """Frames predicted in a row."""
    batch: Count = 256
    """Windows in a step, over all processes."""
    learning_rate: Annotated[float, Field(gt=0)] = 2e-3
    """Its peak."""
    hidden: Count = 48
    """Width of the network."""
    velocity_noise: Annotated[float | None, Field(ge=0)] = None
    """On what the network is told of how bodies moved in the frame before, in its unit of errors; by default the
    network's own."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """What networks compute in."""


class BeliefTraining(Training):
    """What decides a training of belief regulation. A sample is one observed frame of one sequence."""

    TASK: ClassVar[str] = "belief"
    VALIDATIONS: ClassVar[int] = 12
    FILES: ClassVar[tuple[str, ...]] = (*Training.FILES, "physics", "masses", "masses_validation")

    model: str = "belief"
    """belief (ours), paper_recipe, or a registered one."""
    samples: Count = 10_000_000
    """Observed frames of sequences, all in all."""
    frames: Annotated[int, Field(ge=2)] = 200
    """Frames observed in a row."""
    batch: Count = 16
    """Sequences in a step, over all processes."""
    learning_rate: Annotated[float, Field(gt=0)] = 2e-3
    """Its peak."""
    hidden: Count = 64
    """Width of the memory."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """What networks compute in."""
    physics: str | None = None
    """Checkpoint of the physics below it; by default the shipped one."""
    masses: str | None = None
    """Data in which masses are learnt, from pushgraph generate different-masses."""
    masses_validation: str | None = None
    """Data on which that is validated."""
    keep_joints: bool = False
    """Learn about masses alone."""

    def model_post_init(self, context: Any) -> None:
        """Raise TrainingError if settings do not fit each other, too."""
        super().model_post_init(context)
        if (self.masses is None) != (self.masses_validation is None):
            raise TrainingError("masses and masses_validation: give both or neither")
        for name in ("masses", "masses_validation"):
            if getattr(self, name) is not None:
                self._check_file(name, "pushgraph generate different-masses")
        if self.masses is not None and self.model != "belief":
            raise TrainingError(f"masses: {self.model} knows no masses; only belief learns them")
        if self.keep_joints and (self.masses is None or self.start_from is None):
            raise TrainingError("keep_joints: needs masses to learn, and start_from, whose joints are kept")


class SpreadTraining(Training):
    """What decides a training of spreads. A sample is one predicted frame of one rollout."""

    TASK: ClassVar[str] = "spread"
    VALIDATIONS: ClassVar[int] = 12

    model: str = "spread"
    """spread, or a registered one."""
    samples: Count = 8_000_000
    """Predicted frames of rollouts, all in all."""
    rollouts: Count = 12_800
    """Made once, and drawn from again and again."""
    frames: Annotated[int, Field(ge=2)] = 64
    """Frames of a rollout; of a tenth of them, 300."""
    batch: Count = 32
    """Rollouts in a step, over all processes."""
    learning_rate: Annotated[float, Field(gt=0)] = 3e-3
    """Its peak."""
    hidden: Count = 32
    """Width of the network."""

    def model_post_init(self, context: Any) -> None:
        """Raise TrainingError if settings do not fit each other, too."""
        super().model_post_init(context)
        if self.rollouts < self.batch:
            raise TrainingError(f"rollouts: must be a batch at least, {self.batch}; got {self.rollouts}")


class LeverTraining(_Propagating):
    """What decides a training of boards. A sample is one predicted frame of one window."""

    TASK: ClassVar[str] = "lever-up"
    VALIDATIONS: ClassVar[int] = 10

    model: str = "lever_up"
    """lever_up (ours), lever_up_propnet (the paper's), or a registered one."""
    interactions: Annotated[int | None, Field(ge=1)] = None
    """Use the first of the data alone; by default all."""
    samples: Count = 200_000
    """Predicted frames of training windows, all in all."""
    frames: Count = 4
    """Frames predicted in a row."""
    batch: Count = 64
    """Windows in a step, over all processes."""
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    """Its peak."""
    hidden: Count = 64
    """Width of the network."""
