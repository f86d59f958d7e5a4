"""Tables of results: which rows of `results.json` they show, what stands in their lines and columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pushgraph.errors import ReportError

Row = Mapping[str, Any]


@dataclass(frozen=True)
class View:
    """A table. where: labels that rows must have, several values being alternatives. lines: labels, the model among
    them or not, whose values make a line. columns: metrics, by their titles."""

    title: str
    lines: tuple[str, ...]
    columns: Mapping[str, str]
    where: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    digits: int = 2


@dataclass(frozen=True)
class Table:
    """What is written: titles of the columns, and the cells of every line."""

    title: str
    head: tuple[str, ...]
    cells: list[tuple[str, ...]]


def table_of(view: View, rows: Sequence[Row]) -> Table:
    """The view of these rows; lines stand in the order of the rows, and those without any number are left out.

    Raises ReportError if the view asks for a metric, or a value of a label, that no row has.
    """
    for name, wanted in (*view.where.items(), ("metric", tuple(view.columns.values()))):
        there = list(dict.fromkeys(row.get(name) for row in rows))
        if unknown := [value for value in wanted if value not in there]:
            valid = ", ".join(map(str, there))
            raise ReportError(f"{view.title!r}: no row whose {name} is {unknown[0]!r}; there are: {valid}")
    chosen = [row for row in rows if all(row.get(name) in values for name, values in view.where.items())]
    values = {(*(row.get(name) for name in view.lines), row["metric"]): row for row in chosen}
    cells = []
    for line in dict.fromkeys(key[:-1] for key in values):
        found = [values.get((*line, metric)) for metric in view.columns.values()]
        if any(row is not None and row["value"] is not None for row in found):
            names = (str(value).replace("_", " ") for value in line)
            cells.append((*names, *(_cell(row, view.digits) for row in found)))
    return Table(view.title, (*(name.replace("_", " ") for name in view.lines), *view.columns), cells)


def _cell(row: Row | None, digits: int) -> str:
    """A value with its 95 % interval."""
    if row is None or row["value"] is None:
        return ""
    value, low, high = (f"{row[name]:.{digits}f}" for name in ("value", "low", "high"))
    return f"{value} ({low}, {high})"
