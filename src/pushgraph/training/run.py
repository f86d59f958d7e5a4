"""Where and how a training runs: what belongs to it on disk, on which devices, in how many processes."""

from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field

from pushgraph.errors import TrainingError
from pushgraph.training.settings import Settings


class TrainingRun(Settings):
    """Where and how a training runs; but for rounding none of it decides the weights."""

    FILES: ClassVar[tuple[str, ...]] = ("out", "run_folder")

    out: str
    """The checkpoint, safetensors."""
    run_folder: str | None = None
    """Folder of its config, metrics, log and state; by default NAME.run beside --out."""
    processes: Annotated[int, Field(ge=1)] = 1
    """Processes that share each batch."""
    device: str = "cpu"
    """cpu, cuda or cuda:N; of several processes each has a GPU of its own."""
    tensorboard: bool = False
    """Write curves for TensorBoard into the run folder, too."""
    imports: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Python files of your own that are run first, such as one that registers a network; see `pushgraph --import`."""

    def model_post_init(self, _: object) -> None:
        """Raise TrainingError if settings do not fit each other."""
        if self.processes > 1 and ":" in self.device:
            raise TrainingError(f"device: {self.device!r} is one for one process, and there are {self.processes}")

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        return Path(self.run_folder) if self.run_folder else Path(self.out).with_suffix(".run")
