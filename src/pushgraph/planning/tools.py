"""Tools that ship with pushgraph, and those of files."""

import os
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from pushgraph.errors import PlanningError
from pushgraph.record import explain
from pushgraph.tool import Tool

_SHIPPED = Path(str(files("pushgraph"))) / "tools"
TOOLS = ("stick", "stick-left", "stick-right", "l", "inverted-l", "l-left", "inverted-l-right")
"""Those of the paper (section IV), in its order."""


class NamedTool(NamedTuple):
    """A tool, and what it is called."""

    name: str
    tool: Tool


def load_tool(name: str | os.PathLike) -> NamedTool:
    """A shipped tool by name, or the tool in a JSON file, which is called as the file is.

    Raises PlanningError if it is neither.
    """
    path = _SHIPPED / f"{name}.json" if str(name) in TOOLS else Path(name)
    try:
        text = path.read_bytes()
    except OSError as error:
        raise PlanningError(
            f"{name}: no tool: neither a file that can be read ({error.strerror}) nor one of {', '.join(TOOLS)}"
        ) from None
    try:
        return NamedTool(path.stem, Tool.model_validate_json(text, strict=True))
    except ValidationError as error:
        raise PlanningError(explain(error, str(path), None)) from None


def load_tools(names: str | Sequence[str | os.PathLike]) -> list[NamedTool]:
    """Tools by name or file; "all": those that ship."""
    return [load_tool(name) for name in (TOOLS if names == "all" else [names] if isinstance(names, str) else names)]
