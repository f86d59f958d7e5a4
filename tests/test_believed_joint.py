"""Joints as they are believed: where they sit, how far they moved, how sure that is."""

import math

import numpy as np
import pytest
import torch
from scenes import body

from pushgraph import pose
from pushgraph.belief import BeliefModel
from pushgraph.believed_joint import BelievedJoint
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.joint_answers import JointAnswers
from pushgraph.network.belief_network import BeliefNetwork
from pushgraph.network.dynamics import ContactDynamics
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import Scene

SCENE = Scene(bodies=(body("frame", 0.4, 0.1, yaw=0.6), body("part", 0.5, 0.17, yaw=-0.2)))
BESIDE = np.array([0.111, 0.0, 0.0])
"""The robot goes along with the part, here beside it: what it cannot reach is taken to rest."""


def regulator(kind: str, monkeypatch) -> BeliefRegulator:
    """One that is sure of the kind of the joint."""
    code = torch.tensor([[JOINT_CODES[kind]]])
    certain = 0.9 * torch.nn.functional.one_hot(code, len(JOINT_CODES)) + 0.1 / len(JOINT_CODES)
    monkeypatch.setattr(BeliefModel, "answers", lambda model, watched: JointAnswers(certain, code))
    network = BeliefNetwork(hidden=8).eval().requires_grad_(False)
    return BeliefRegulator(SCENE, BeliefModel(network, ContactDynamics().eval().requires_grad_(False)))


def watch(watching: BeliefRegulator, parts: np.ndarray, drift: np.ndarray | None = None) -> BelievedJoint:
    """Show the part at these poses in the world, both bodies moved by `drift` too."""
    frame = np.array(SCENE.bodies[0].pose_world_from_body)
    for k, part in enumerate(parts):
        both = np.stack((frame, part))
        if drift is not None:
            both = pose.compose(drift[k], both)
        watching.observe(np.concatenate((both[1:] + BESIDE, both)))
    (joint,) = watching.joints()
    return joint


def test_a_hinge_is_told_in_the_world_as_it_is_now(monkeypatch) -> None:
    pivot, start = np.array([0.46, 0.2]), np.array(SCENE.bodies[1].pose_world_from_body)
    turns = np.concatenate((np.linspace(0, -0.3, 20), np.linspace(-0.3, 0.5, 30)))
    swung = np.array([[*(pivot + pose.rotate(start[:2] - pivot, turn)), start[2] + turn] for turn in turns])
    drift = np.linspace(0, 1, 50)[:, None] * np.array([0.05, -0.02, 0.3])
    joint = watch(regulator("revolute", monkeypatch), swung, drift)
    assert (joint.parent, joint.child, joint.kind) == ("frame", "part", "revolute")
    assert joint.probability == pytest.approx(0.925)
    assert np.array(joint.anchor) == pytest.approx(pose.transform(drift[-1], pivot), abs=2e-3)
    assert 0 < joint.anchor_spread < 0.003
    assert joint.reached == pytest.approx((-0.3, 0.5), abs=1e-6)
    assert joint.axis is None
    assert BelievedJoint.from_json(joint.to_json()) == joint


def test_a_slider_is_told_with_its_axis_and_how_far_it_went(monkeypatch) -> None:
    way, start = np.array([math.cos(2.0), math.sin(2.0)]), np.array(SCENE.bodies[1].pose_world_from_body)
    far = np.concatenate((np.linspace(0, -0.02, 20), np.linspace(-0.02, 0.07, 30)))
    joint = watch(regulator("prismatic", monkeypatch), np.array([[*(start[:2] + f * way), start[2]] for f in far]))
    # The axis points from the parent to the child.
    assert np.abs(np.array(joint.axis) @ way) == pytest.approx(1, abs=1e-3)
    assert joint.axis_spread < math.radians(2)
    assert sorted(np.abs(joint.reached)) == pytest.approx([0.02, 0.07], abs=1e-3)
    assert joint.anchor is None


def test_nothing_moved_nothing_is_known_of_its_place(monkeypatch) -> None:
    still = np.tile(np.array(SCENE.bodies[1].pose_world_from_body), (5, 1))
    slider = watch(regulator("prismatic", monkeypatch), still)
    assert slider.axis_spread == pytest.approx(math.pi / 2)
    hinge = watch(regulator("revolute", monkeypatch), still)
    assert hinge.anchor_spread > 0.02
    assert hinge.reached == (0.0, 0.0)
    fixed = watch(regulator("fixed", monkeypatch), still)
    assert (fixed.anchor, fixed.axis, fixed.reached) == (None, None, None)
    assert isinstance(fixed.probability, float)
    assert torch.is_grad_enabled()
