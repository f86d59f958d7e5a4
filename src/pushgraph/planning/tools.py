"""Tools that ship with pushgraph, and those of files."""

import os
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from pushgraph.errors import PlanningError
from pushgraph.json_file import parse_object, read_text, validated
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
    if not path.exists():
        raise PlanningError(
            f"{name}: no tool: neither a file that can be read (there is none) nor one of {', '.join(TOOLS)}"
        )
    text = read_text(path, "tool", PlanningError)
    parse_object(text, str(path), "tool", PlanningError)
    return NamedTool(path.stem, validated(Tool, text, str(path), PlanningError))


def load_tools(names: str | Sequence[str | os.PathLike]) -> list[NamedTool]:
    """Tools by name or file; "all": those that ship."""
    return [load_tool(name) for name in (TOOLS if names == "all" else [names] if isinstance(names, str) else names)]
