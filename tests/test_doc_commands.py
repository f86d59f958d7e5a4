"""Every command in the text of README, CONTRIBUTING and docs: its options exist, and what is complete runs."""

import ast
import gzip
import importlib.util
import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from browser import NAMES
from doc_blocks import (
    FEW,
    NOT_RUN,
    PAGES,
    ROOT,
    at_most,
    blocks_of,
    code_in_text,
    commands_in_text,
    in_this_process,
    run,
)
from made_pushes import OUTLINES, made

import pushgraph as pg
from pushgraph.cli import app
from pushgraph.simulation.lever_setup import LEVER_UP

PATTERN = re.compile(r"\b[A-Z]{2,}\b|\.\.\.")
"""Stands for what the reader puts there."""
NAMED = re.compile(r"pushgraph train [\w-]+( --masses)?")
"""A command whose name alone is told: its data may stand in a file."""
PUSHGRAPH = typer.main.get_command(app)
BENCHMARKS = sorted((ROOT / "benchmarks").glob("*.py"))
NEEDED = {
    "peers": ("the extra [peers]", importlib.util.find_spec("pymunk")),
    "view_latency": ("Chromium", any(map(shutil.which, NAMES))),
}
"""What benchmarks need beside what all tests do, and whether it is there."""


def asked_of(command: str) -> tuple[list[str], list[str], list[str]]:
    """Of a command `pushgraph ...`: names that it does not have, its options, and what it needs but does not say."""
    words, known, unknown, said = shlex.split(command)[1:], PUSHGRAPH, [], 0
    while words:
        word = words.pop(0)
        options = {name: one for one in known.params for name in (*one.opts, *one.secondary_opts)}
        if word in options:
            said += options[word].required
            words = words if getattr(options[word], "is_flag", False) else words[1:]
        elif hasattr(known, "commands"):
            name = next(iter(known.commands)) if word == "..." else word
            unknown += [name] * (name not in known.commands and not PATTERN.fullmatch(name))
            known = known.commands.get(name, known)
        elif word.startswith("--"):
            unknown += [word] * (word != "--help")
        else:
            said += 1
    needed = [one.name for one in known.params if one.required]
    return unknown, [name for one in known.params for name in one.opts], needed[said:]


def few(command: str, options: list[str]) -> str:
    """The command with little asked for, also where it says nothing."""
    measures = re.match("pushgraph (evaluate|report)| |$", command)
    unsaid = [name for name in FEW if measures and name in options and name not in command.split()]
    return " ".join((at_most(command, FEW), *(f"{name} {FEW[name]}".strip() for name in unsaid)))


COMMANDS = sorted({command for page in PAGES for command in commands_in_text(page)})
OURS = [command for command in COMMANDS if command.startswith("pushgraph ")]
RUN = [
    few(command, asked_of(command)[1])
    for command in OURS
    if not PATTERN.search(command) and not NAMED.fullmatch(command) and not asked_of(command)[2]
]
COMPLETE = sorted({frozenset(command.split()): command for command in RUN}.values())
OTHERS = [command for command in COMMANDS if command not in OURS and not command.startswith("benchmarks/")]


def options_of(command: Any) -> set[str]:
    """The options of a command, and of all below it."""
    found = {name for one in command.params for name in (*one.opts, *one.secondary_opts)}
    return found.union(*map(options_of, getattr(command, "commands", {}).values()))


def test_every_option_that_is_named_exists() -> None:
    settings = re.findall(r"(\w+):", "".join(path.read_text() for path in BENCHMARKS))
    known = {*options_of(PUSHGRAPH), "--help", *(f"--{name.replace('_', '-')}" for name in settings)}
    for page in PAGES:
        for span in code_in_text(page):
            named = re.findall(r"(?<![\w-])--[a-z][\w-]*", span)
            assert span.startswith("pip ") or known.issuperset(named), f"{page.name}: {span}"


def test_every_command_has_the_options_that_a_page_gives_it() -> None:
    blocks = "\n".join(block.text for page in PAGES for block in blocks_of(page) if block.kind == "console")
    for command in (*OURS, *re.findall(r"^\$ (pushgraph [^|<>#\n]*)", blocks, re.M)):
        if "--import" not in command or PATTERN.search(command):
            assert not asked_of(command)[0], command


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("command", COMPLETE)
def test_a_command_in_the_text_runs(command: str, tmp_path: Path) -> None:
    run(command, tmp_path)
    assert not command.startswith("pushgraph evaluate") or list(tmp_path.glob("*/results.json"))


@pytest.mark.slow
@pytest.mark.parametrize("command", OTHERS)
def test_other_programs_run(command: str) -> None:
    run(command, ROOT)


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """A folder with the files that the benchmarks' own commands name."""
    folder = tmp_path_factory.mktemp("data")
    drawn = pg.generate("multiple-parts", objects=3, count=4, seed=0, out=folder / "parts.h5")
    for name in ("planar", "validation", "data", "mixture"):
        (folder / f"{name}.h5").write_bytes(Path(drawn).read_bytes())
    for name in ("lever-up", "lever-up-validation"):
        arguments = ["generate", LEVER_UP, "--drives", "1", "--seed", "0", "--out", f"{name}.h5"]
        assert in_this_process(arguments, folder)[0] == 0
    pushes, outlines = made(folder, {"box": 4, "disc": 4})
    text = pushes.read_text().replace("disc", "ellip1")
    text += "".join(f"\n{line}".replace("box", "rect3") for line in text.splitlines() if "box" in line)
    (folder / "pushes.csv.gz").write_bytes(gzip.compress(text.replace("box", "rect1").encode()))
    named = {"ellip1": OUTLINES["disc"], "rect1": OUTLINES["box"], "rect3": OUTLINES["box"]}
    outlines.write_text(json.dumps(named))
    return folder


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("benchmark", BENCHMARKS, ids=lambda path: path.stem)
def test_a_benchmark_runs_as_its_top_and_the_pages_say(benchmark: Path, data: Path) -> None:
    needed, there = NEEDED.get(benchmark.stem, ("", True))
    if not there:
        pytest.skip(f"{needed} is not installed")
    top = ast.get_docstring(ast.parse(benchmark.read_text()))
    commands = re.findall(rf"python benchmarks/{benchmark.name}(.*?)(?: \[.*)?$", top, re.M)
    assert commands
    told = subprocess.run([sys.executable, benchmark, "--help"], capture_output=True, text=True).stdout
    options = re.findall(r"(?<![\w-])--[\w-]+", told)
    more = [command.split(" ", 1)[1] for command in COMMANDS if command.startswith(f"benchmarks/{benchmark.name} ")]
    for command in sorted({few(one, options) for one in (*commands, *(f"{commands[0]} {said}" for said in more))}):
        run(f"python {benchmark}{command}", data)


def test_what_is_not_run_stands_on_a_page() -> None:
    everything = "\n".join(page.read_text() for page in PAGES)
    assert all(re.search(pattern, everything) for pattern in NOT_RUN)
