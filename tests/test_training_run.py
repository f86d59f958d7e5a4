"""Runs of trainings: what lies in their folder, how they stop and go on, alone and in several processes."""

import csv
import dataclasses
import os
import random
import re
import shlex
import signal
import subprocess
import sys
import time
import types
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from test_own_network import example

from pushgraph import cli
from pushgraph.checkpoint import load_checkpoint
from pushgraph.dataset.lever_store import LeverColumns, LeverDataset
from pushgraph.dataset.ragged import Recipe
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.errors import DeviceError, MissingExtraError, TrainingError, TrainingInterrupted
from pushgraph.network.registry import build_network
from pushgraph.simulation.lever_setup import draw_interaction
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.training import belief, physics, rollouts
from pushgraph.training.belief import BeliefTask, train_belief
from pushgraph.training.configuration import read_configuration
from pushgraph.training.lever import LeverTask
from pushgraph.training.physics import PhysicsTask, train_physics
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import BeliefTraining, LeverTraining, PhysicsTraining, SpreadTraining
from pushgraph.training.run import TrainingRun
from pushgraph.training.seeds import seed_of
from pushgraph.training.spread import SpreadTask

TINY = {"model": "propnet", "frames": 1, "batch": 6, "hidden": 8, "propagation_steps": 1, "samples": 6 * 40}
ENVIRONMENT = os.environ | {"OMP_NUM_THREADS": "1"}


def write(path: Path, seed: int, *trajectories) -> str:
    recipe = Recipe(setup="planar", objects=3, seed=seed, first=0, count=len(trajectories))
    Dataset.write(path, recipe, [Columns.of(trajectories)])
    return str(path)


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> dict[str, str]:
    """Three trajectories of three bodies to learn from, two to choose by."""
    folder = tmp_path_factory.mktemp("runs")
    return {
        "data": write(folder / "data.h5", 0, *(draw_trajectory("planar", 3, 0, k) for k in range(3))),
        "validation": write(folder / "validation.h5", 1, *(draw_trajectory("planar", 3, 1, k) for k in range(2))),
    }


@pytest.fixture(autouse=True)
def short_validation(monkeypatch) -> None:
    monkeypatch.setattr(physics, "VALIDATION_FRAMES", 11)
    monkeypatch.setattr(PhysicsTraining, "VALIDATIONS", 4)


def weights(path: Path) -> dict[str, torch.Tensor]:
    return load_checkpoint(path).network.state_dict()


def same(one: Path, other: Path) -> bool:
    return all(torch.equal(values, weights(other)[name]) for name, values in weights(one).items())


def metrics(folder: Path) -> list[dict[str, str]]:
    with (folder / "metrics.csv").open() as file:
        return [{key: row[key] for key in row if "seconds" not in key and "per_second" not in key}
                for row in csv.DictReader(file)]  # fmt: skip


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C interrupts, as in a terminal: processes in the background are begun with it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_interrupted_run_goes_on_by_the_command_it_names(data, interruptible, tmp_path: Path, capsys) -> None:
    training = PhysicsTraining(**data, **TINY)
    whole, run = (TrainingRun(out=str(tmp_path / f"{name}.safetensors")) for name in ("whole", "parts"))
    train_physics(training, whole)

    def interrupt(now, loss) -> None:
        if now.step == 7:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(TrainingInterrupted, match="after step 8 of 40; everything is saved") as interrupted:
        train_physics(training, run, tell=interrupt)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    command = str(interrupted.value).split("to go on: pushgraph ")[1]
    assert command == f"train physics --config {tmp_path / 'parts.run' / 'config.toml'}"
    with pytest.raises(SystemExit) as stop:
        cli.main(shlex.split(command))
    assert stop.value.code == 0
    said = capsys.readouterr().out
    assert "goes on from step 8 of 40" in said
    assert "bounded_error_cm" in said
    assert same(tmp_path / "whole.safetensors", tmp_path / "parts.safetensors")
    assert metrics(tmp_path / "whole.run") == metrics(tmp_path / "parts.run")
    rows = metrics(tmp_path / "parts.run")
    assert [int(row["samples"]) for row in rows] == [6 * int(row["step"]) for row in rows]
    assert {"learning_rate", "loss", "bounded_error_cm"} < set(rows[0])
    log = (tmp_path / "parts.run" / "log.txt").read_text()
    assert [word for word in ("begins", "stopped after", "goes on", "done") if word in log] == [
        "begins", "stopped after", "goes on", "done"
    ]  # fmt: skip
    names = {path.name for path in (tmp_path / "parts.run").iterdir()}
    assert names == {"config.toml", "metrics.csv", "log.txt", "running.safetensors", "lock", "curve.png"}


def test_another_training_does_not_go_on_in_the_same_folder(data, tmp_path: Path) -> None:
    run = TrainingRun(out=str(tmp_path / "out.safetensors"))
    training = PhysicsTraining(**data, **TINY | {"samples": 6})
    train_physics(training, run)
    before = (tmp_path / "out.run" / "config.toml").read_text()
    with pytest.raises(TrainingError, match=r"other settings: batch 6, not 3. Remove it to begin anew"):
        train_physics(training.replace(batch=3), run)
    assert (tmp_path / "out.run" / "config.toml").read_text() == before
    (tmp_path / "file").touch()
    with pytest.raises(Exception, match="file: cannot be written: File exists"):
        train_physics(training, TrainingRun(out=str(tmp_path / "new.safetensors"), run_folder=str(tmp_path / "file")))


def shortened(trajectory, frames: int):
    """The first push alone, and of it so many frames."""
    track = simulate(trajectory.track.scene.replace(pushes=trajectory.track.scene.pushes[:1]))
    names = ("times", "poses", "push", "seen", "wrench")
    cut = dataclasses.replace(track, **{name: getattr(track, name)[:frames] for name in names})
    return trajectory._replace(track=cut)


def test_validations_of_other_numbers_of_bodies_and_frames_add_up(data, tmp_path: Path) -> None:
    trajectories = [shortened(draw_trajectory("planar", 3, 2, 0), 6), draw_trajectory("planar", 5, 2, 1)]
    network = build_network("propnet", {"hidden": 8, "steps": 1}).eval()
    network.network.head[-1].reset_parameters()  # which begins at zero, so that nothing would move
    validated = []
    for name, some in (("both", trajectories), ("short", trajectories[:1]), ("wide", trajectories[1:])):
        path = write(tmp_path / f"{name}.h5", 2, *some)
        training = PhysicsTraining(data=data["data"], validation=path, **TINY)
        with torch.no_grad():
            validated.append(PhysicsTask(training, Processes(), torch.device("cpu")).validate(network))
    both, short, wide = validated
    torch.testing.assert_close(both, short + wide, rtol=1e-4, atol=1e-4)
    assert both[1].tolist() == [2.0] * 4
    with pytest.raises(TrainingError, match=r"validation: .*both.h5 holds 2 trajectories, which 3 processes cannot"):
        PhysicsTask(training.replace(validation=str(tmp_path / "both.h5")), Processes(0, 3), torch.device("cpu"))


@pytest.mark.slow
def test_validations_of_beliefs_may_have_other_numbers_of_bodies_and_frames(data, tmp_path: Path) -> None:
    trajectories = [shortened(draw_trajectory("planar", 3, 2, 0), 6), draw_trajectory("planar", 5, 2, 1)]
    validation = write(tmp_path / "both.h5", 2, *trajectories)
    training = BeliefTraining(data=data["data"], validation=validation, hidden=8, frames=20, batch=1)
    network = build_network("belief", {"hidden": 8}).eval()
    with torch.no_grad():
        sums, weights = BeliefTask(training, Processes(), torch.device("cpu")).validate(network)
    assert sums.isfinite().all()
    assert weights[0] > 0
    alone = write(tmp_path / "alone.h5", 2, draw_trajectory("multiple-parts", 1, 2, 0))
    with pytest.raises(TrainingError, match="validation: holds nothing by which surprise can be measured"):
        train_belief(training.replace(validation=alone), TrainingRun(out=str(tmp_path / "out.safetensors")))


def test_seeds_are_made_of_what_they_are_for() -> None:
    assert seed_of("windows", seed=1) == 1599655588823256592
    different = [seed_of("a", seed=1), seed_of("b", seed=1), seed_of("a", seed=2), seed_of("a", step=1, seed=1)]
    assert len({*different}) == 4
    assert seed_of("a", step=1, seed=2) == seed_of("a", seed=2, step=1)
    assert 0 <= min(different) <= max(different) < 2**63
    code = "from pushgraph.training.seeds import seed_of; print(seed_of('a', seed=1))"
    printed = {
        subprocess.check_output([sys.executable, "-c", code], env=ENVIRONMENT | {"PYTHONHASHSEED": salt}).strip()
        for salt in ("1", "2")
    }
    assert printed == {str(different[0]).encode()}
    sources = Path(physics.__file__).parents[1].rglob("*.py")
    assert not [path for path in sources if re.search(r"(?<![\w.])hash\(", path.read_text())]


def test_curves_go_to_tensorboard_if_it_is_there(data, tmp_path: Path, monkeypatch) -> None:
    run = TrainingRun(out=str(tmp_path / "out.safetensors"), tensorboard=True)
    training = PhysicsTraining(**data, **TINY | {"samples": 12})
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(MissingExtraError, match=r"--tensorboard needs .*: pip install 'pushgraph\[tensorboard\]'"):
        train_physics(training, run)
    written = []

    class SummaryWriter:
        def __init__(self, folder: Path, purge_step: int) -> None:
            assert folder == tmp_path / "out.run" / "tensorboard"
            assert purge_step == 1

        def add_scalar(self, name: str, value: float, step: int) -> None:
            written.append((name, step))

        def close(self) -> None:
            written.append(("closed", 0))

    module = types.ModuleType("torch.utils.tensorboard")
    module.SummaryWriter = SummaryWriter
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", module)
    train_physics(training, run)
    assert {("loss", 1), ("loss", 2), ("learning_rate", 2), ("validation/bounded_error_cm", 0)} < set(written)
    assert written[-1] == ("closed", 0)


@pytest.mark.parametrize("device", ["cuda", "cuda:7", "warp", "cpu:x"])
def test_devices_that_are_not_here_are_refused_before_anything_is_done(device: str, data, tmp_path: Path) -> None:
    if device == "cuda" and torch.cuda.is_available():
        pytest.skip("there is one")
    run = TrainingRun(out=str(tmp_path / "out.safetensors"), device=device)
    with pytest.raises(DeviceError, match=rf"device: no.*'{device}'.*valid: cpu"):
        train_physics(PhysicsTraining(**data, **TINY), run)
    assert not any(tmp_path.iterdir())


class Rank(Processes):
    """One of several processes that are not there: what it divides by is what all said in the round before."""

    def mean(self, values):
        said, heard = self.__dict__.setdefault("said", []), self.__dict__.get("heard")
        said.append(values.detach())
        return heard[len(said) - 1] if heard else values


@pytest.mark.parametrize(
    "name",
    ["physics", *(pytest.param(name, marks=pytest.mark.slow) for name in ("belief", "masses", "spread", "lever"))],
)
def test_the_mean_gradient_of_shares_is_that_of_the_batch(name: str, data, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(belief, "MASS_FRAMES", 20)
    monkeypatch.setattr(belief, "MASS_VALIDATION", 2)
    monkeypatch.setattr(rollouts, "LONGEST_WATCH", 10)
    if name == "lever":
        data = write_interactions(tmp_path)
    masses = {"masses": data["data"], "masses_validation": data["validation"]} if name == "masses" else {}
    make_task, training, network = {
        "physics": lambda: (PhysicsTask, PhysicsTraining, "propnet"),
        "belief": lambda: (BeliefTask, BeliefTraining, "belief"),
        "masses": lambda: (BeliefTask, BeliefTraining, "belief"),
        "spread": lambda: (SpreadTask, SpreadTraining, "spread"),
        "lever": lambda: (LeverTask, LeverTraining, "lever_up_propnet"),
    }[name]()
    settings = {"frames": 12, "batch": 5, "hidden": 8} | ({"rollouts": 5} if name == "spread" else {})
    training = training(model=network, **data, **settings, **masses)

    def gradient(processes: Processes) -> torch.Tensor:
        torch.manual_seed(0)
        network = build_network(training.model, training.config).eval()  # each process has a dropout of its own
        make_task(training, processes, torch.device("cpu")).loss(network, 3).backward()
        gradients = [torch.zeros_like(one) if one.grad is None else one.grad for one in network.parameters()]
        return torch.cat([one.flatten() for one in gradients])

    ranks = [Rank(rank, 2) for rank in range(2)]
    for one in ranks:
        gradient(one)
    heard = [sum(values) / 2 for values in zip(*(one.__dict__.pop("said", []) for one in ranks), strict=True)]
    for one in ranks:
        one.__dict__["heard"] = heard
    whole, shared = gradient(Processes()), sum(gradient(one) for one in ranks) / 2
    assert whole.norm() > 0
    torch.testing.assert_close(shared, whole, rtol=1e-3, atol=1e-5 * float(whole.abs().max()))


def write_interactions(folder: Path) -> dict[str, str]:
    interaction, recipe = draw_interaction(0, 0), Recipe("lever-up", 1, 0, 0, 2)
    LeverDataset.write(folder / "lever.h5", recipe, [LeverColumns.of([interaction] * 2)])
    return {"data": str(folder / "lever.h5"), "validation": str(folder / "lever.h5")}


# Several processes, and kills -----------------------------------------------------------------------------------


def command(data: dict[str, str], out: Path, *more: object, **settings: object) -> list[str]:
    arguments = [sys.executable, "-m", "pushgraph", "train", "physics", "--out", str(out), *map(str, more)]
    for name, value in (TINY | data | {"processes": 1} | settings).items():
        arguments += [f"--{name.replace('_', '-')}", str(value)]
    return arguments


OFTEN = "from pushgraph.cli import main; from pushgraph.training import loop; loop.SAVE_EVERY = 0.5; main()"


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_killed_at_ten_random_moments_it_ends_with_the_same_weights(data, tmp_path: Path) -> None:
    """Half are kill -9, half Ctrl-C; four come soon after the start, six while steps are made."""
    rng, settings = random.Random(2), {"samples": 6 * 1500}
    whole, pieces = tmp_path / "whole.safetensors", tmp_path / "pieces.safetensors"
    log, statuses, reached = tmp_path / "pieces.run" / "log.txt", [], []
    arguments = command(data, pieces, **settings)
    arguments[1:3] = ["-c", OFTEN]
    for kill in range(10):
        before = read(log)
        process = subprocess.Popen(
            arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
            env=ENVIRONMENT,
        )  # fmt: skip
        while kill > 3 and process.poll() is None and read(log) == before:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 3.0))
        os.killpg(process.pid, (signal.SIGKILL, signal.SIGINT)[kill % 2])
        said, _ = process.communicate()
        statuses.append(process.returncode)
        reached += map(int, re.findall(r"goes on from step (\d+) of 1500", said))
        if stopped := re.search(r"stopped after step (\d+) of 1500; everything is saved .*--config (\S+)", said):
            assert stopped[2] == str(tmp_path / "pieces.run" / "config.toml")
            reached.append(int(stopped[1]))
        # Before it is imported, Python ends by Ctrl-C in its own way.
        assert process.returncode in (-signal.SIGKILL, -signal.SIGINT, 130), said
    assert not pieces.exists()
    assert statuses.count(-signal.SIGKILL) == 5
    assert statuses[-1] == 130
    assert len({*reached}) > 3
    assert reached == sorted(reached)
    subprocess.run(arguments, check=True, capture_output=True, env=ENVIRONMENT)
    subprocess.run(command(data, whole, **settings), check=True, capture_output=True, env=ENVIRONMENT)
    assert same(whole, pieces)
    assert metrics(tmp_path / "whole.run") == metrics(tmp_path / "pieces.run")


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["own", "torchrun"])
def test_two_processes_train_as_one_does_a_network_of_one_s_own(launcher: str, data, tmp_path: Path) -> None:
    one, two = tmp_path / "one.safetensors", tmp_path / "two.safetensors"
    # A batch that two cannot share alike.
    settings = {"model": "mlp", "samples": 7 * 20, "batch": 7, "learning_rate": 1e-3}
    done = run_with_own(command(data, one, **settings))
    assert done.returncode == 0, done.stderr
    arguments = command(data, two, **settings | {"processes": 2 if launcher == "own" else 1})
    if launcher == "torchrun":
        arguments[1:3] = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2", "-m", "pushgraph"]
    done = run_with_own(arguments)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("the weights that validated best") == 1
    example("own_network")
    first, second = (load_checkpoint(path) for path in (one, two))
    assert second.record["training"] == first.record["training"] | {"processes": 2}
    for row, other in zip(first.record["curve"], second.record["curve"], strict=True):
        told, heard = ({name: value for name, value in some.items() if name != "seconds"} for some in (row, other))
        assert told == pytest.approx(heard, rel=1e-4)
    for name, values in first.network.state_dict().items():
        torch.testing.assert_close(second.network.state_dict()[name], values, atol=1e-5, rtol=1e-3)
    content = read_configuration(tmp_path / "two.run" / "config.toml", PhysicsTraining)
    assert content["imports"] == [str(OWN_NETWORK)]
    assert content["processes"] == (2 if launcher == "own" else 1)


OWN_NETWORK = Path(__file__).parents[1] / "examples" / "09_own_network.py"


def run_with_own(arguments: list[str]) -> subprocess.CompletedProcess:
    place = arguments.index("train")
    arguments = [*arguments[:place], "--import", str(OWN_NETWORK), *arguments[place:]]
    return subprocess.run(arguments, capture_output=True, text=True, env=ENVIRONMENT)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_two_processes_stop_with_the_one_that_started_them(number: int, data, tmp_path: Path) -> None:
    arguments = command(data, tmp_path / "out.safetensors", samples=10**8, processes=2)
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=ENVIRONMENT)
    log = tmp_path / "out.run" / "log.txt"
    wait_until(lambda: "validation" in read(log) or process.poll() is not None)
    time.sleep(3)
    started = children_of(process.pid)
    assert len(started) >= 2
    process.send_signal(number)
    said, _ = process.communicate(timeout=60)
    if number == signal.SIGINT:
        assert process.returncode == 130, said
        assert "everything is saved" in said
        assert "to go on: pushgraph train physics --config" in said
    wait_until(lambda: not any(Path(f"/proc/{one}").exists() for one in started))


def read(path: Path) -> str:
    return path.read_text() if path.exists() else ""


def wait_until(condition, seconds: float = 90) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.1)


def children_of(parent: int) -> set[int]:
    """Processes that another one started, as long as they have ended neither."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, started_by = status.read_text().rpartition(")")[2].split()[:2]
        except OSError:
            continue
        if int(started_by) == parent and state != "Z":
            found.add(int(status.parent.name))
    return found
