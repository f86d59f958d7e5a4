"""Training: it learns, survives kills without a trace, and stops at what is not finite."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from typer.testing import CliRunner

from pushgraph import cli, pose
from pushgraph.checkpoint import load_checkpoint
from pushgraph.dataset.ragged import Recipe
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.dataset.windows import WindowSampler
from pushgraph.errors import TrainingError
from pushgraph.graph.propnet_graph import DISPLACEMENT, TURN
from pushgraph.graph.scene_batch import JOINT_CODES, batch_scenes, pairs_of
from pushgraph.network.dynamics import PropnetDynamics
from pushgraph.network.registry import build_network
from pushgraph.scene import Scene
from pushgraph.simulation.setups import draw_trajectory, multiple_parts, planar
from pushgraph.training import physics
from pushgraph.training.examples import ExampleMaker, mirror, mirror_scenes, withhold
from pushgraph.training.losses import unrolled_loss
from pushgraph.training.physics import PhysicsTask, PhysicsTraining, train_physics
from pushgraph.training.processes import Processes
from pushgraph.training.run import TrainingRun
from pushgraph.training.seeds import seed_of
from pushgraph.training.share import Draws

TINY = {"frames": 2, "batch": 16, "hidden": 8, "propagation_steps": 2}


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> dict[str, str]:
    """Four trajectories of three bodies to learn from, two to choose by."""
    paths = {}
    for name, seed, count in (("data", 0, 4), ("validation", 1, 2)):
        path = tmp_path_factory.mktemp("training") / f"{name}.h5"
        columns = Columns.of([draw_trajectory("planar", 3, seed, k) for k in range(count)])
        recipe = Recipe(setup="planar", objects=3, seed=seed, first=0, count=count)
        Dataset.write(path, recipe, [columns])
        paths[name] = str(path)
    return paths


@pytest.fixture(autouse=True)
def short_validation(monkeypatch) -> None:
    monkeypatch.setattr(physics, "VALIDATION_FRAMES", 11)


def weights(path: Path) -> dict[str, torch.Tensor]:
    return load_checkpoint(path).network.state_dict()


@pytest.mark.parametrize("model", [pytest.param("contact", marks=pytest.mark.slow), "propnet"])
def test_training_lowers_the_rollout_error_and_records_how(model, data, tmp_path) -> None:
    settings = TINY | {"samples": 1600, "learning_rate": 3e-3}
    if model == "propnet":
        settings |= {"samples": 4800, "learning_rate": 1e-2, "hidden": 32}
    training = PhysicsTraining(model=model, **data, **settings)
    train_physics(training, TrainingRun(out=str(tmp_path / "out.safetensors")))
    checkpoint = load_checkpoint(tmp_path / "out.safetensors")
    record, curve = checkpoint.record, checkpoint.record["curve"]
    assert record["samples"] == settings["samples"]
    assert record["data"]["seed"] == 0
    assert record["training"]["batch"] == 16
    assert curve[0]["step"] == 0
    if model == "propnet":
        # It begins at standing still; the losses of two steps are of other windows and cannot be compared.
        assert min(row["mean_error_cm"] for row in curve) < curve[0]["mean_error_cm"]
    else:
        # A correction is kept only if it is clearly better than none.
        best = min(row["bounded_error_cm"] for row in curve) / curve[0]["bounded_error_cm"]
        assert checkpoint.network.network.is_silent == (best > 0.95)
    low, high = record["range"]["mass"]
    assert 0.05 < low < high < 100


@pytest.mark.parametrize("model", ["contact", "propnet"])
def test_gradients_in_bfloat16_point_where_those_in_float32_do(model, data) -> None:
    gradients = []
    for precision in ("float32", "bfloat16"):
        training = PhysicsTraining(model=model, **data, samples=1600, precision=precision, **TINY | {"hidden": 32})
        torch.manual_seed(0)
        network = build_network(model, training.config)
        PhysicsTask(training, Processes(), torch.device("cpu")).loss(network, 0).backward()
        gradients.append(torch.cat([values.grad.flatten() for values in network.parameters()]))
    assert float(torch.cosine_similarity(*gradients, dim=0)) > 0.99


def test_networks_see_motions_with_the_noise_that_is_asked_for_in_every_frame(data, monkeypatch) -> None:
    training = PhysicsTraining(model="propnet", **data, samples=1600, **TINY)
    network, seen = build_network("propnet", training.config), []

    def forward(state, control):
        seen.append(state.motions.double())
        return PropnetDynamics.forward(network, state, control)

    monkeypatch.setattr(network, "forward", forward)
    for noise in (0.0, 0.3, None):
        asked = training.model_copy(update={"velocity_noise": noise})
        PhysicsTask(asked, Processes(), torch.device("cpu")).loss(network, 0)
    # It begins with no motion, so what it sees later does not depend on the noise that it saw before.
    true, noisy, by_default = torch.stack(seen).unflatten(0, (3, training.frames))
    torch.testing.assert_close(noisy, by_default, rtol=0, atol=0)
    noise = (noisy - true) / true.new_tensor([DISPLACEMENT, DISPLACEMENT, TURN])
    torch.testing.assert_close(noise.std((1, 2)), torch.full((2, 3), 0.3, dtype=torch.float64), rtol=0.3, atol=0)
    assert abs(float(torch.corrcoef(noise.flatten(1))[0, 1])) < 0.3


@pytest.mark.parametrize(("least_gain", "kept"), [(0.05, True), (0.02, False)])
def test_what_a_training_starts_from_is_kept_unless_others_are_better_by_so_much(
    data, tmp_path, monkeypatch, least_gain, kept
) -> None:
    errors = itertools.chain([1.0], itertools.repeat(0.97))
    monkeypatch.setattr(PhysicsTask, "validate", lambda *_: torch.tensor([[next(errors)] * 4, [1.0] * 4]))
    training = PhysicsTraining(model="propnet", **data, samples=64, least_gain=least_gain, **TINY)
    with torch.random.fork_rng():
        torch.manual_seed(seed_of("first weights", seed=training.seed))
        before = build_network(training.model, training.config).state_dict()
    train_physics(training, TrainingRun(out=str(tmp_path / "out.safetensors")))
    after = weights(tmp_path / "out.safetensors")
    assert all(torch.equal(before[name], after[name]) for name in before) == kept


def test_the_mean_of_the_first_and_the_last_weights_is_written(data, tmp_path, monkeypatch) -> None:
    start, mean = tmp_path / "start.safetensors", tmp_path / "mean.safetensors"
    settings = TINY | {"samples": 320, "learning_rate": 3e-3, "least_gain": 0.0}
    train_physics(PhysicsTraining(model="propnet", **data, **settings), TrainingRun(out=str(start)))
    on = PhysicsTraining(model="propnet", **data, seed=1, start_from=str(start), share_of_start=0.25, **settings)
    run = TrainingRun(out=str(mean))
    errors = itertools.count(1.0)  # whatever validates best: it would be the first
    monkeypatch.setattr(PhysicsTask, "validate", lambda *_: torch.tensor([[next(errors)] * 4, [1.0] * 4]))
    train_physics(on, run)
    first, found = weights(start), weights(mean)
    with safe_open(Path(run.folder) / "running.safetensors", "pt") as file:
        for name in first:
            expected = 0.25 * first[name] + 0.75 * file.get_tensor(f"network.{name}")
            torch.testing.assert_close(found[name], expected, rtol=0, atol=1e-6)
    assert any(not torch.equal(first[name], found[name]) for name in first)
    with pytest.raises(TrainingError, match="share_of_start: needs start_from"):
        PhysicsTraining(**data, share_of_start=0.5)


def test_what_is_not_finite_stops_the_training_and_is_kept(data, tmp_path, monkeypatch) -> None:
    broken = lambda *some: unrolled_loss(*some) * float("nan")  # noqa: E731
    monkeypatch.setattr(physics, "unrolled_loss", broken)
    with pytest.raises(TrainingError, match=r"step 0: loss nan.*not finite.*failure-step-0-process-0"):
        train_physics(PhysicsTraining(**data, samples=64, **TINY), TrainingRun(out=str(tmp_path / "out.safetensors")))
    (failure,) = tmp_path.glob("out.run/failure-*.safetensors")
    with safe_open(failure, "pt") as file:
        assert all(file.get_tensor(name).isfinite().all() for name in file.keys())  # noqa: SIM118
    assert not (tmp_path / "out.safetensors").exists()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"model": "magic"}, "no network 'magic' to train; valid: propnet, contact"),
        ({"precision": "float16"}, "precision: Input should be 'float32' or 'bfloat16', got 'float16'"),
        ({"samples": 0}, "samples: Input should be greater than or equal to 1, got 0"),
        ({"data": "none.h5"}, "no such dataset: none.h5; make it with pushgraph generate"),
        ({"learning_rate": float("nan")}, "learning_rate: Input should be"),
    ],
)
def test_settings_that_cannot_work_are_refused(change, says, data) -> None:
    with pytest.raises(TrainingError, match=says):
        PhysicsTraining(**data | change)


def test_test_seeds_are_refused(data, tmp_path) -> None:
    columns = Columns.of([draw_trajectory("multiple-parts", 2, 1_000_000, 0)])
    recipe = Recipe(setup="multiple-parts", objects=2, seed=1_000_000, first=0, count=1)
    Dataset.write(tmp_path / "test.h5", recipe, [columns])
    training = PhysicsTraining(data=str(tmp_path / "test.h5"), validation=data["validation"], **TINY)
    with pytest.raises(TrainingError, match="seeds from 1,000,000 on are for tests"):
        train_physics(training, TrainingRun(out=str(tmp_path / "out.safetensors")))
    assert not (tmp_path / "out.run").exists()


def test_the_command_says_what_is_wrong(data, tmp_path, capsys) -> None:
    arguments = ["train", "physics", "--data", "none.h5", "--validation", data["validation"], "--out", "x.safetensors"]
    with pytest.raises(SystemExit) as stop:
        cli.main(arguments)
    assert stop.value.code == 1
    assert "no such dataset: none.h5" in capsys.readouterr().err
    assert CliRunner().invoke(cli.app, ["train", "physics", "--help"]).exit_code == 0


def test_a_mirrored_scene_is_the_scene_of_the_mirrored_world() -> None:
    found = 0
    for index in range(16):
        scene = planar(np.random.default_rng(index), 5, 2 * index).scene
        turned = {"pose_world_from_body": lambda p: (p[0], -p[1], -p[2])}
        bodies = tuple(
            b.replace(pose_world_from_body=turned["pose_world_from_body"](b.pose_world_from_body)) for b in scene.bodies
        )
        joints = []
        for joint in scene.joints:
            anchor, axis, (low, high) = scene.joint_frame(joint)
            place = {"anchor": (anchor[0], -anchor[1])}
            if joint.kind == "prismatic":
                place |= {"axis": (axis[0], -axis[1]), "limits": (low, high)}
            if joint.kind == "revolute":
                place |= {"limits": (-high, -low)}
            joints.append(joint.replace(**place))
        parts = tuple(
            p.replace(pose_tool_from_part=turned["pose_world_from_body"](p.pose_tool_from_part))
            for p in scene.tool.parts
        )
        there = scene.replace(bodies=bodies, joints=tuple(joints), tool=scene.tool.replace(parts=parts), pushes=())
        expected = batch_scenes([Scene.from_json(there.to_json(), trusted=True)])
        mirrored = mirror_scenes(batch_scenes([scene]), torch.tensor([-1.0]))
        torch.testing.assert_close(mirrored.pose_tool_from_part, expected.pose_tool_from_part)
        torch.testing.assert_close(mirrored.centre_of_mass, expected.centre_of_mass, atol=1e-4, rtol=0)
        # The order of feet may differ, their moments may not.
        skewed = [(feet.shares * feet.points.prod(-1)).sum(-1) for feet in (mirrored.feet, expected.feet)]
        torch.testing.assert_close(*skewed, atol=3e-5, rtol=0)
        for one, other in zip(mirrored.relations, expected.relations, strict=True):
            torch.testing.assert_close(one, other, atol=1e-6, rtol=0)
        found += len(joints)
    assert found > 8


def test_a_window_becomes_the_example_of_what_followed(data) -> None:
    dataset = Dataset(data["data"])
    windows = WindowSampler(dataset, frames=5, batch=32, seed=0).batch(0)
    example = ExampleMaker(dataset)(windows, Draws.of(0, 32))
    assert windows.push_start.any()
    assert not windows.push_start.all()
    for k in range(32):
        first = int(windows.start[k]) + (0 if windows.push_start[k] else 1)
        true = dataset[int(windows.trajectory[k])].poses[first : first + 4]
        signs = [torch.tensor([s]) for s in (1.0, -1.0)]
        choices = [mirror(torch.tensor(true, dtype=torch.float32)[None], sign)[0] for sign in signs]
        same = [torch.allclose(example.poses[k], choice[:, 1:]) for choice in choices]
        assert any(same)
        choice = choices[same.index(True)]
        torch.testing.assert_close(example.state.poses[k], choice[0, 1:])
        for frame, control in enumerate(example.controls):
            torch.testing.assert_close(control.pose[k], choice[frame, 0])
            torch.testing.assert_close(control.motion[k], choice[frame + 1, 0] - choice[frame, 0])
        if windows.push_start[k]:
            assert not example.state.motions[k].any()


def test_what_is_withheld_leaves_no_trace() -> None:
    scenes = [multiple_parts(np.random.default_rng(1), 5, 1).scene] * 400
    whole = batch_scenes(scenes)
    poses = torch.tensor(np.stack([scene.poses_world_from_body for scene in scenes]), dtype=torch.float32)
    some = withhold(whole, poses, Draws.of(0, 400))
    hidden = ~some.relations.known
    assert not some.relations.kind[hidden].any()
    assert not some.relations.remembered[hidden].any()
    assert (some.mass[~some.mass_known] == np.float32(0.6)).all()
    for flag in (hidden, ~some.mass_known, ~some.table_friction_known[:, None], ~some.side_friction_known[:, None]):
        assert 0.05 < float(flag.any(1).float().mean()) < 0.25
    assert not some.yaw_known[whole.is_cylinder].all()
    assert some.yaw_known[~whole.is_cylinder].all()
    joined = some.relations.kind > 0
    assert torch.equal(some.relations.kind[joined], whole.relations.kind[joined])
    assert set(whole.relations.kind.unique().tolist()) - {0} <= set(JOINT_CODES.values())


def test_joints_of_a_body_whose_turning_was_not_seen_count_from_now() -> None:
    scene = multiple_parts(np.random.default_rng(1), 4, 1).scene
    whole = batch_scenes([scene] * 64)
    poses = torch.tensor(np.stack([scene.poses_world_from_body] * 64), dtype=torch.float32)
    blind = poses.clone()
    blind[..., 2] = torch.rand(64, 4) * whole.is_cylinder  # what the yaw was when it began nobody knows
    some = withhold(whole, blind, Draws.of(0, 64))
    unseen, joined = ~some.yaw_known, some.relations.kind > 0
    a, b = pairs_of(4)
    from_now = joined & (unseen[:, a] | unseen[:, b])
    assert from_now.any()
    for body, anchors in ((a, some.relations.anchor_a), (b, some.relations.anchor_b)):
        world = pose.transform(blind[:, body], anchors)
        other = pose.transform(
            blind[:, a + b - body], some.relations.anchor_b if body is a else some.relations.anchor_a
        )
        torch.testing.assert_close(world[from_now], other[from_now], atol=1e-6, rtol=0)
    turned = blind[:, b, 2] - blind[:, a, 2]
    torch.testing.assert_close(some.relations.yaw_offset[from_now], turned[from_now])
    seen = joined & ~from_now
    torch.testing.assert_close(some.relations.yaw_offset[seen], whole.relations.yaw_offset[seen])
