"""Scenes as JSON files: a header that says which format they are of, then the fields of a record."""

import json
import os
from typing import Any, TypeVar

from pydantic import ValidationError

from pushgraph.errors import SceneError
from pushgraph.json_file import parse, read_text
from pushgraph.record import Record, explain
from pushgraph.storage import replacing

AnyScene = TypeVar("AnyScene", bound="SceneFile")

TRUSTED = {"trusted": True}
"""Validation context of scenes that were checked when they were written: skips the geometry."""


def is_trusted(info: Any) -> bool:
    """Whether a validator's record was checked when it was written."""
    return bool((info.context or {}).get("trusted"))


class SceneFile(Record):
    """Base of the records that scene files hold; their fields `format` and `version` have one valid value each."""

    def to_json(self, indent: int | None = 2) -> str:
        """The scene as JSON text; `from_json` reads it back bit for bit."""
        return self.model_dump_json(indent=indent)

    def save(self, path: str | os.PathLike) -> None:
        """Write the scene as JSON; `load` reads it back bit for bit."""
        with replacing(path) as temporary:
            temporary.write_text(self.to_json() + "\n", encoding="utf-8")

    @classmethod
    def from_json(cls: type[AnyScene], text: str | bytes, source: str = "scene", trusted: bool = False) -> AnyScene:
        """Read a scene from JSON text; `source` names it in errors. Trusted text is not checked for overlap."""
        if not trusted:
            cls._check_header(text, source)
        try:
            return cls.model_validate_json(text, strict=True, context=TRUSTED if trusted else None)
        except ValidationError as error:
            raise SceneError(explain(error, source, _parsed(text))) from None

    @classmethod
    def load(cls: type[AnyScene], path: str | os.PathLike) -> AnyScene:
        """Read a scene from a JSON file."""
        return cls.from_json(read(path), str(path))

    @classmethod
    def format_name(cls) -> str:
        """What the field `format` of such a file says."""
        return cls.model_fields["format"].default

    @classmethod
    def _check_header(cls, text: str | bytes, source: str) -> None:
        """Refuse what is no scene, or a scene of another version, before its fields are looked at."""
        data, valid = header(text, source), cls.model_fields["version"].default
        if data.get("format") != cls.format_name():
            raise SceneError(f'{source}: "format" must be "{cls.format_name()}", got {data.get("format")!r}')
        version = data.get("version")
        if type(version) is int and version > valid:
            raise SceneError(
                f"{source}: written in version {version} of the scene format, newer than this pushgraph reads "
                f"({valid}); update pushgraph"
            )
        if type(version) is not int or version != valid:
            raise SceneError(f'{source}: "version" must be {valid}, got {version!r}')


def read(path: str | os.PathLike) -> bytes:
    """The text of a scene file."""
    return read_text(path, "scene", SceneError)


def header(text: str | bytes, source: str) -> dict[str, object]:
    """The fields of a scene's JSON text as they stand there, not checked."""
    data = parse(text, source, SceneError)
    if not isinstance(data, dict):
        raise SceneError(f"{source}: a scene is a JSON object, got {type(data).__name__}")
    return data


def _parsed(text: str | bytes) -> object:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None

