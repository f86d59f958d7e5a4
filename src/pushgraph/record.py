"""Frozen, validated records, and readable errors for what does not fit them."""

from collections.abc import Callable
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_serializer
from pydantic_core import ErrorDetails

from pushgraph.errors import SceneError

AnyRecord = TypeVar("AnyRecord", bound="Record")


class Record(BaseModel):
    """Base of every part of a scene: immutable, no unknown fields, no NaN; raises SceneError."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise SceneError(explain(error, type(self).__name__.lower(), fields)) from None

    # Without this mark pydantic would build nested records through __init__ and lose where they stand.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # a mark that pydantic looks for

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        fields = type(self).model_fields
        return {k: v for k, v in handler(self).items() if v is not None or fields[k].default is not None}

    def replace(self: AnyRecord, **fields: Any) -> AnyRecord:
        """Return a copy with some fields replaced, validated anew."""
        return type(self)(**{name: getattr(self, name) for name in type(self).model_fields} | fields)


def explain(error: ValidationError, root: str, data: Any, most: int = 10) -> str:
    """Say for each fault which record and field it is in, what is valid, and what was given.

    `root` names the outermost record and `data` is what it was to be made from.
    """
    faults = _without_consequences(error.errors(include_url=False))
    lines = [_explain_one(fault, root, data) for fault in faults[:most]]
    return "\n".join(lines + [f"and {len(faults) - most} more faults"] * (len(faults) > most))


def _without_consequences(faults: list[ErrorDetails]) -> list[ErrorDetails]:
    """Leave out that a list is too short where that is only since one of its items has a fault of its own."""

    def has_faulty_item(fault: ErrorDetails) -> bool:
        where = fault["loc"]
        return any(len(one["loc"]) > len(where) and one["loc"][: len(where)] == where for one in faults)

    return [fault for fault in faults if fault["type"] != "too_short" or not has_faulty_item(fault)]


def _explain_one(fault: ErrorDetails, root: str, data: Any) -> str:
    where, path, value = root, "", data
    for key in fault["loc"]:
        value = _child(value, key)
        if isinstance(key, int):
            path += f"[{key}]"
        elif key not in ("cylinder", "cuboid", "polygon"):  # the tag of a union is no field
            key = key if key.isidentifier() else repr(key)
            path += f".{key}" if path else key
        name = _child(value, "name")
        if isinstance(name, str):
            where, path = f"{where}: {path} {name!r}", ""
    where = f"{where}: {path}" if path else where
    message = fault["msg"].removeprefix("Value error, ")
    if fault["type"] in ("value_error", "json_invalid", "missing"):
        return f"{where}: {message}"
    if fault["type"] == "extra_forbidden":
        return f"{where}: unknown field"
    given = repr(fault["input"])
    return f"{where}: {message}, got {given if len(given) <= 80 else given[:77] + '...'}"


def _child(value: Any, key: int | str) -> Any:
    if isinstance(value, dict):
        return value.get(key)
    if isinstance(value, list | tuple) and isinstance(key, int) and key < len(value):
        return value[key]
    return getattr(value, key, None) if isinstance(key, str) and isinstance(value, BaseModel) else None
