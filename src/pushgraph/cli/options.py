"""Options of a command that come from settings: one for each field, with its bounds and meaning."""

import inspect
from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any

import typer
from annotated_types import Ge
from pydantic.fields import FieldInfo

from pushgraph.training.settings import Settings


def with_options(
    command: Callable[..., None],
    kinds: tuple[type[Settings], ...],
    more: Mapping[str, Mapping[str, Any]],
    leave_out: Collection[str] = (),
) -> Callable[..., None]:
    """The command, of keyword arguments, with an option for every field: None where it is not given.

    more: what else is to be said of the options of some fields, as `typer.Option` takes it. leave_out: fields
    that have no option.
    """

    def wrapped(**given: Any) -> None:
        command(**given)

    own = [one for one in inspect.signature(command).parameters.values() if one.kind is not one.VAR_KEYWORD]
    made = [
        inspect.Parameter(
            name,
            own[0].kind,
            default=None,
            annotation=_option(field, {"metavar": "FILE"} if name in kind.FILES else more.get(name, {})),
        )
        for kind in kinds
        for name, field in kind.model_fields.items()
        if name not in leave_out
    ]
    wrapped.__signature__ = inspect.Signature([*own, *made])  # type: ignore[attr-defined]  # what typer reads
    return wrapped


def _option(field: FieldInfo, more: Mapping[str, Any]) -> Any:
    plain = field.is_required() or field.default is None or field.default is False
    said: dict[str, Any] = {"help": field.description, "show_default": False if plain else str(field.default)}
    least = [bound.ge for bound in field.metadata if isinstance(bound, Ge)]
    said["min"] = least[0] if least else None
    kind: Any = field.annotation
    return Annotated[kind | None, typer.Option(**said | dict(more))]
