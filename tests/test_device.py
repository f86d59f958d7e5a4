"""Devices: inputs go where the network is, answers come back, and what is not here is refused by name."""

import numpy as np
import pytest
import torch
from scenes import workshop
from torch import nn

import pushgraph as pg
from pushgraph import lever_physics
from pushgraph.belief import BeliefModel
from pushgraph.device import devices, place_of
from pushgraph.errors import DeviceError, TrainingError
from pushgraph.graph.broad_phase import reachable
from pushgraph.graph.lever_batch import start_lever
from pushgraph.graph.scene_batch import batch_scenes, tensors_of
from pushgraph.graph.state import start
from pushgraph.network.dynamics import ContactDynamics
from pushgraph.network.registry import build_network
from pushgraph.rollout import rollout
from pushgraph.simulation.lever_setup import draw_interaction
from pushgraph.training.processes import Processes, default_count
from pushgraph.training.run import TrainingRun


class Met(Exception):
    """What was to be computed, and where its inputs were."""


def meets(*given: object, **_: object) -> None:
    """Stands for a computation: raises Met if all that it is given is on `meta`."""
    tensors = [one for value in given for one in found(value)]
    assert {one.device.type for one in tensors} == {"meta"}
    raise Met


def found(value: object) -> list[torch.Tensor]:
    if isinstance(value, torch.Tensor):
        return [value]
    return list(tensors_of(value)) if isinstance(value, tuple) else []


@pytest.mark.parametrize("model", ["contact", "propnet"])
def test_what_is_predicted_goes_where_the_network_is(model: str, monkeypatch) -> None:
    predictor = pg.load(model, device="meta")
    assert predictor.device.type == "meta"
    monkeypatch.setattr("pushgraph.physics.rollout", meets)
    scene = workshop()
    states = pg.load(model).start([scene])
    assert {one.device.type for one in tensors_of(predictor.start([scene]))} == {"meta"}
    tool, down = np.zeros((1, 4, 3)), np.ones((1, 4), bool)
    for call in (
        lambda: predictor.predict(scene),
        lambda: predictor.predict_many([scene, scene]),
        lambda: predictor.predict_pushes(scene, scene.pushes[:1]),
        lambda: predictor.rollout(states, tool, down, force_limit=np.ones((1, 4))),
    ):
        with pytest.raises(Met):
            call()


def test_beliefs_and_boards_are_computed_where_their_networks_are(monkeypatch) -> None:
    model = BeliefModel.load(device="meta")
    monkeypatch.setattr("pushgraph.belief.first_look", meets)
    regulator = pg.BeliefRegulator(workshop(), model)
    with pytest.raises(Met):
        regulator.observe(np.concatenate((np.zeros((1, 3)), workshop().poses_world_from_body)))
    board = lever_physics.LeverPredictor.load(device="meta")
    monkeypatch.setattr(lever_physics, "rollout_lever", meets)
    with pytest.raises(Met):
        board.predict(draw_interaction(0, 0).track.scene)


@pytest.mark.parametrize("model", ["contact", "propnet", "belief"])
def test_nothing_is_made_elsewhere_on_the_way(model: str, monkeypatch) -> None:
    """What is made without saying where is made on `meta` here, and could not be added to the rest."""
    # As on a GPU, where nothing compiled is called.
    monkeypatch.setattr(ContactDynamics, "_can_be_compiled", lambda *_: False)
    monkeypatch.setattr("pushgraph.belief.bodies_in_reach", lambda *step: reachable(*step).may_move)
    batch = batch_scenes([workshop()])
    poses = torch.from_numpy(workshop().poses_world_from_body)[None]
    state = start(batch, torch.nn.functional.pad(poses, (0, 0, 0, batch.mass.shape[1] - poses.shape[1])))
    network = build_network(model if model != "belief" else "contact", {"hidden": 8, "steps": 1})
    tool = torch.linspace(0, 0.04, 4)[:, None] * torch.tensor([1.0, 0.0, 0.0]) + poses[0, 0] - torch.tensor([0.1, 0, 0])
    tool, down = tool[None].double(), torch.ones(1, 4, dtype=torch.bool)
    state = state.double()
    watcher = BeliefModel.load()
    with torch.device("meta"):
        if model == "belief":
            everything = torch.ones_like(state.scenes.present)
            unknown = batch._replace(mass_known=~everything)
            watch = watcher.begin(unknown, state.poses, tool[:, 0], down[:, 0], everything)
            watch = watcher.observe(watch, state.poses, tool[:, 1], down[:, 1], everything)
            answer = watcher.probabilities(watch)
            assert watcher.masses(watch).median.isfinite().all()
        else:
            answer = rollout(network, state, tool, down).poses
    assert answer.device.type == "cpu"
    assert answer.isfinite().all()


@pytest.mark.parametrize("model", ["lever_up", "lever_up_propnet"])
def test_nothing_of_boards_is_made_elsewhere_on_the_way(model: str) -> None:
    scene = draw_interaction(0, 0).track.scene
    state, tool = start_lever([scene]), torch.from_numpy(lever_physics.tool_knots(scene, 2))[None]
    network = build_network(model, {"hidden": 8, "steps": 1})
    state = state._replace(pose=state.pose.requires_grad_())  # so that nothing compiled is called
    with torch.device("meta"):
        boards = lever_physics.rollout_lever(network, state, tool)
    assert boards.device.type == "cpu"
    assert boards.isfinite().all()


def test_what_is_not_here_is_refused(monkeypatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert devices() == ["cpu"]
    for load in (pg.load, BeliefModel.load, lever_physics.LeverPredictor.load):
        with pytest.raises(DeviceError, match="device: no 'cuda': CUDA finds no GPU here; valid: cpu"):
            load(device="cuda")
    with pytest.raises(DeviceError, match="device: no device 'warp'; valid: cpu"):
        pg.load(device="warp")
    assert default_count("cuda") == 1
    # On a machine with two:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    with pytest.raises(DeviceError, match="device: no 'cuda:7': there are 2 GPUs; valid: cpu, cuda, cuda:0, cuda:1"):
        pg.load(device="cuda:7")
    assert default_count("cuda") == 2
    assert default_count("cuda:1") == 1
    monkeypatch.setenv("LOCAL_RANK", "1")
    monkeypatch.setenv("RANK", "5")
    monkeypatch.setenv("WORLD_SIZE", "8")
    assert default_count("cuda") == 1  # torchrun has started them
    assert Processes.of_torchrun().device("cuda") == torch.device("cuda", 1)
    assert Processes.of_torchrun().device("cpu") == torch.device("cpu")
    with pytest.raises(DeviceError, match="process 2 of this machine finds no GPU left; there are 2"):
        Processes(2, 3, 2).device("cuda")
    with pytest.raises(TrainingError, match="is one for one process"):
        TrainingRun(out="x", device="cuda:0", processes=2)


def test_the_place_of_what_is_no_module_is_the_processor() -> None:
    assert place_of(lambda state, control: None) == torch.device("cpu")
    assert place_of(nn.Linear(1, 1, device="meta")) == torch.device("meta")
