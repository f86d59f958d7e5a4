"""Python files of the user's own, which register networks, setups and suites: run by commands and their processes."""

import importlib.util
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from pushgraph.errors import OwnModuleError

VARIABLE = "PUSHGRAPH_IMPORT"
"""The environment variable that names the files, as PATH names folders: processes that are started inherit it."""


def use(files: Sequence[str] = ()) -> None:
    """Run these files and those that the environment names, each once; processes that are started will, too.

    Raises OwnModuleError if one cannot be read, or fails.
    """
    chosen = list(dict.fromkeys(str(Path(file).absolute()) for file in (*used(), *files)))
    for file in chosen:
        _run(Path(file))
    if chosen:
        os.environ[VARIABLE] = os.pathsep.join(chosen)


def used() -> tuple[str, ...]:
    """The files that the environment names."""
    return tuple(file for file in os.environ.get(VARIABLE, "").split(os.pathsep) if file)


def _run(file: Path) -> None:
    name = file.stem
    loaded = sys.modules.get(name)
    if loaded is not None:
        if getattr(loaded, "__file__", None) == str(file):
            return
        raise OwnModuleError(f"{file}: cannot be imported: there is a module {name!r} already; rename the file")
    if file.suffix != ".py" or not file.is_file():
        raise OwnModuleError(f"{file}: cannot be imported: it is no Python file")
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, Exception):
            raise OwnModuleError(f"{file}: cannot be imported: {type(error).__name__}: {error}") from error
        raise
