"""Settings that options, files and Python give alike: strict, frozen, each with its meaning."""

from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError

from pushgraph.errors import TrainingError
from pushgraph.record import Record, explain


class Settings(Record):
    """Base of settings; what is said of a field is the help of its option. Raises TrainingError.

    FILES: settings that name files or folders.
    """

    model_config = ConfigDict(strict=True)
    FILES: ClassVar[tuple[str, ...]] = ()

    def __init__(self, /, **fields: Any) -> None:
        try:
            BaseModel.__init__(self, **fields)
        except ValidationError as error:
            raise TrainingError(explain(error, "settings", fields)) from None

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # see Record

    def with_names(self) -> dict[str, Any]:
        """The settings; of files only their names, which mean something elsewhere."""
        settings = {name: getattr(self, name) for name in type(self).model_fields}
        return settings | {name: settings[name] and Path(settings[name]).name for name in self.FILES}
