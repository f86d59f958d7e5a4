"""Run configurations: what is written is what is read, options come before it, and anything else is refused by name."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from pushgraph import cli
from pushgraph.errors import TrainingError
from pushgraph.training.configuration import read_configuration, save_configuration
from pushgraph.training.recipe import BeliefTraining, LeverTraining, PhysicsTraining, SpreadTraining
from pushgraph.training.run import TrainingRun


@pytest.fixture
def data(tmp_path: Path) -> dict[str, str]:
    """Names of files that are there."""
    for name in ("data", "validation"):
        (tmp_path / f"{name}.h5").touch()
    return {name: str(tmp_path / f"{name}.h5") for name in ("data", "validation")}


@pytest.mark.parametrize("kind", [PhysicsTraining, BeliefTraining, SpreadTraining, LeverTraining])
def test_what_is_written_is_read(kind, data, tmp_path: Path) -> None:
    training = kind(**data, samples=123, learning_rate=1e-5, seed=2**70)
    odd = str(tmp_path / 'a "quoted" \\ name\x7f\n é.safetensors')
    run = TrainingRun(out=odd, processes=3, tensorboard=True, imports=("one", "two.three"))
    save_configuration(training, run, tmp_path / "config.toml")
    content = read_configuration(tmp_path / "config.toml", kind)
    assert TrainingRun(**{name: content.pop(name) for name in TrainingRun.model_fields if name in content}) == run
    assert kind(**content) == training


def test_files_are_named_so_that_they_are_found_from_everywhere(data, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    training = PhysicsTraining(data="data.h5", validation="validation.h5")
    save_configuration(training, TrainingRun(out="net.safetensors"), tmp_path / "config.toml")
    content = read_configuration(tmp_path / "config.toml", PhysicsTraining)
    assert content["data"] == data["data"]
    assert content["out"] == str(tmp_path / "net.safetensors")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("learing_rate = 1e-3", "'learing_rate': unknown key; did you mean learning_rate"),
        ("zzz = 1", "'zzz': unknown key; valid: model, data, validation"),
        ("[physics]\nbatch = 1", "'physics': unknown key"),
        ('samples = "10"', "samples: Input should be a valid integer, got '10'"),
        ("samples = 10.0", "samples: Input should be a valid integer, got 10.0"),
        ("batch = 0", "batch: Input should be greater than or equal to 1, got 0"),
        ("learning_rate = nan", "learning_rate: Input should be"),
        ("learning_rate = true", "learning_rate: Input should be a valid number, got True"),
        ("tensorboard = 1", "tensorboard: Input should be a valid boolean, got 1"),
        ('imports = "own"', "imports: Input should be a valid tuple, got 'own'"),
        ('precision = "float16"', "precision: Input should be 'float32' or 'bfloat16', got 'float16'"),
        ("data = 2026-01-01", "data: Input should be a valid string"),
        ('task = "belief"', "task: is a configuration of 'belief', not of 'physics'"),
        ("task = [1]", r"task: is a configuration of \[1\], not of 'physics'"),
        ("batch = 1\nbatch = 2", "not valid TOML: Cannot overwrite a value"),
        ("batch =", "not valid TOML: Invalid value"),
        ("a = " + "[" * 30_000, "not valid TOML: nested too deeply|not valid TOML"),
        ("batch = " + "1" * 10_000, "not valid TOML: Exceeds the limit"),
        ("#" * 2**17, "cannot read this configuration: it is larger than"),
    ],
)
def test_what_is_no_setting_is_refused_with_file_and_key(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(TrainingError, match=f"config.toml: {says}"):
        read_configuration(path, PhysicsTraining)
    with pytest.raises(TrainingError, match=r"cannot read this configuration: No such file"):
        read_configuration(tmp_path / "none.toml", PhysicsTraining)


def test_the_command_needs_what_neither_option_nor_file_gives(data, tmp_path: Path, capsys) -> None:
    path = tmp_path / "config.toml"
    own = tmp_path / "own.toml"
    own.write_text('imports = ["not_there.py"]')
    path.write_text(f'data = "{data["data"]}"\nbatch = 0.5\n')
    for arguments, says in (
        (["--data", "x.h5"], "--validation, --out: must be given, or stand in a --config"),
        (["--config", str(path)], "config.toml: batch: Input should be a valid integer, got 0.5"),
        (["--model", "magic", "--out", "x", "--data", data["data"], "--validation", data["data"]], "valid: propnet"),
        (["--config", str(own)], "not_there.py: cannot be imported: it is no Python file"),
        (["--device", "cuda:1", "--processes", "2", "--out", "x", "--data", "x", "--validation", "x"], "one for one"),
    ):
        with pytest.raises(SystemExit) as stop:
            cli.main(["train", "physics", *arguments])
        assert stop.value.code == 1
        assert says in " ".join(capsys.readouterr().err.split())
    assert CliRunner().invoke(cli.app, ["train", "physics", "--help"]).exit_code == 0
