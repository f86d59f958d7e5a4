"""JSON files, read strictly: UTF-8, no key twice, neither too deep nor too large; with a checksum where they are ours.

What pushgraph alone writes ends with the field `checksum`. A file without it is read as well, as by hand or by another
program changed on purpose; one that does not fit its content was damaged.
"""

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from pushgraph.errors import PushGraphError
from pushgraph.record import Record, explain
from pushgraph.storage import read_plain, replacing

AnyRecord = TypeVar("AnyRecord", bound=Record)

MOST_BYTES = 64 * 2**20
"""Largest JSON file that is read."""
CHECKSUM = "checksum"


def read_text(path: str | os.PathLike, what: str, error: type[PushGraphError]) -> bytes:
    """The text of a file, not parsed yet; what: it should be, such as "plan"."""
    try:
        return read_plain(Path(path), MOST_BYTES)
    except (OSError, ValueError) as fault:
        reason = (fault.strerror or fault) if isinstance(fault, OSError) else fault
        raise error(f"{path}: cannot read this {what}: {reason}") from fault


def parse(text: str | bytes, where: str, error: type[PushGraphError]) -> Any:
    """The values of a JSON text, which `where` names in errors."""
    try:
        written = text.decode() if isinstance(text, bytes) else text
        return json.loads(written, object_pairs_hook=_without_duplicates)
    except RecursionError:
        raise error(f"{where}: not valid JSON: nested too deeply") from None
    except UnicodeDecodeError as fault:
        raise error(f"{where}: not valid JSON: not text in UTF-8: {fault.reason} at byte {fault.start}") from None
    except ValueError as fault:
        raise error(f"{where}: not valid JSON, it may be truncated: {fault}") from None


def parse_object(text: str | bytes, where: str, what: str, error: type[PushGraphError]) -> dict[str, Any]:
    """The fields of a JSON object; raises `error` if the text is another value."""
    content = parse(text, where, error)
    if not isinstance(content, dict):
        raise error(f"{where}: a {what} is a JSON object, got {type(content).__name__}")
    return content


def check_seal(content: Mapping[str, Any], where: str, error: type[PushGraphError]) -> None:
    """Raise `error` if an object does not fit its checksum."""
    if CHECKSUM in content and content[CHECKSUM] != _checksum(content):
        raise error(
            f"{where}: it was damaged: its content does not fit its checksum; remove the field {CHECKSUM!r} if it was "
            "changed on purpose"
        )


def validated(record: type[AnyRecord], text: str | bytes, where: str, error: type[PushGraphError]) -> AnyRecord:
    """A record from JSON text that was parsed before; raises `error`, which names every field that does not fit."""
    try:
        return record.model_validate_json(text, strict=True)
    except ValidationError as fault:
        raise error(explain(fault, where, json.loads(text))) from None


def save_sealed(path: str | os.PathLike, content: Mapping[str, Any], indent: int | None = None) -> None:
    """Write an object with its checksum, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(sealed(content), indent=indent) + "\n")


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """An object with its checksum in the end."""
    return dict(content) | {CHECKSUM: _checksum(content)}


def _checksum(content: Mapping[str, Any]) -> str:
    """CRC-32 of the fields, in whichever order and layout they stand."""
    fields = {name: content[name] for name in content if name != CHECKSUM}
    return f"{zlib.crc32(json.dumps(fields, sort_keys=True).encode()):08x}"


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(name for name in names if names.count(name) > 1)!r} stands twice in one object")
    return fields
