"""Run configurations: the settings of a training as a TOML file, written by every run and read back by the next."""

import difflib
import json
import os
import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, ValidationError, create_model

from pushgraph.errors import TrainingError
from pushgraph.record import explain
from pushgraph.storage import read_plain, replacing
from pushgraph.training.recipe import Training
from pushgraph.training.run import TrainingRun

MOST_BYTES = 2**16
"""Largest configuration that is read."""


def save_configuration(training: Training, run: TrainingRun, path: str | os.PathLike) -> None:
    """Write all settings, files by their absolute names; raises TrainingError if a name is no text."""
    lines = [f"# pushgraph train {training.TASK} --config {Path(path).name}", f'task = "{training.TASK}"']
    for settings in (training, run):
        for name in type(settings).model_fields:
            value = getattr(settings, name)
            if value is not None:
                value = os.path.abspath(value) if name in settings.FILES else value
                lines.append(f"{name} = {_written(value)}")
    try:
        text = "\n".join(lines).encode() + b"\n"
    except UnicodeEncodeError as error:
        raise TrainingError(f"{path}: cannot be written: {error.object[:200]!r} is no text in UTF-8") from None
    with replacing(path) as temporary:
        temporary.write_bytes(text)


def read_configuration(path: str | os.PathLike, kind: type[Training]) -> dict[str, Any]:
    """The settings in a file, of a training of this kind and its run; some may be missing.

    Raises TrainingError, which names the file and the key, at anything that is no setting.
    """
    try:
        content = tomllib.loads(read_plain(Path(path), MOST_BYTES).decode())
    except OSError as error:
        raise TrainingError(f"{path}: cannot read this configuration: {error.strerror or error}") from None
    except RecursionError:
        raise TrainingError(f"{path}: not valid TOML: nested too deeply") from None
    except ValueError as error:  # no UTF-8, no TOML, or no path
        raise TrainingError(f"{path}: not valid TOML: {error}") from None
    task = content.pop("task", kind.TASK)
    if task != kind.TASK:
        raise TrainingError(f"{path}: task: is a configuration of {task!r}, not of {kind.TASK!r}")
    fields = kind.model_fields | TrainingRun.model_fields
    for name in content:
        if name not in fields:
            near = difflib.get_close_matches(name, fields, 1)
            hint = f"did you mean {near[0]}?" if near else f"valid: {', '.join(fields)}"
            raise TrainingError(f"{path}: {name!r}: unknown key; {hint}")
    given: dict[str, Any] = {
        name: (Annotated[(fields[name].annotation, Field(), *fields[name].metadata)], ...)
        for name in content
    }
    try:
        create_model("Configuration", __config__=ConfigDict(strict=True, allow_inf_nan=False), **given)(**content)
    except ValidationError as error:
        raise TrainingError(explain(error, str(path), content)) from None
    return content


def _written(value: Any) -> str:
    """A value as TOML: strings are those of JSON but for one character."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
