"""Files of scenes, tools, plans, beliefs and trajectories: sound ones, how they are read, what they state."""

import dataclasses
import json
import math
import shutil
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_statements import agrees, as_tree, json_kind, strictly, written
from scenes import workshop

from pushgraph.belief_history import BeliefHistory
from pushgraph.believed_joint import BelievedJoint
from pushgraph.believed_mass import BelievedMass
from pushgraph.dataset import generate as generation
from pushgraph.dataset.ragged import Recipe
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.lever_scene import LeverScene
from pushgraph.mass_history import MassHistory
from pushgraph.planning.plan import Plan, load_plan
from pushgraph.planning.tools import load_tool
from pushgraph.scene import Scene
from pushgraph.track import Track

PACKAGE = Path(str(files("pushgraph")))


def make_plan(folder: Path) -> list[Path]:
    times, bodies = np.arange(3) * 0.05, len(workshop().bodies)
    poses = np.tile(np.vstack((np.zeros(3), workshop().poses_world_from_body)), (3, 1, 1))
    track = Track(workshop(), times, poses, np.zeros(3, dtype=int), np.ones((3, 1 + bodies), dtype=bool))
    Plan("stick", workshop(), track, 0.012).save(folder / "plan.json")
    return [folder / "plan.json"]


def read_plan(path: Path) -> Any:
    tool, scene = load_plan(path)
    return {"tool": tool, "scene": as_tree(scene)}


def states_plan(content: bytes, loaded: Any) -> bool:
    stated = strictly(content)
    numbers = [stated["cost"], *(value for pose in stated["expected_end"].values() for value in pose)]
    assert all(type(value) in (int, float) and math.isfinite(value) for value in numbers)
    assert set(stated) - {"checksum"} == {"format", "version", "tool", "cost", "expected_end", "scene"}
    return agrees({name: stated[name] for name in ("tool", "scene")}, loaded)


def make_beliefs(folder: Path) -> list[Path]:
    scene, times = workshop(), np.array([0.0, 0.05, 0.1])
    names = [one.name for one in scene.classes_of_mass]
    share = np.full((3, 2, len(names)), 1 / len(names))
    quantiles = np.tile([0.5, 0.4, 0.7], (3, 2, 1))
    masses = [
        BelievedMass(
            body, dict.fromkeys(names, 1 / len(names)), (0.5, 0.4, 0.7), (2.0, 1.5, 3.0), {other: (1.0, 0.9, 1.2)}
        )
        for body, other in (("plate", "lid"), ("cup", "plate"))
    ]
    joints = [
        BelievedJoint("plate", "lid", "revolute", 0.9, (0.06, 0.05), 0.002, None, None, (-0.1, 0.4)),
        BelievedJoint("plate", "cup", "prismatic", 0.7, None, None, (1.0, 0.0), 0.02, (0.0, 0.02)),
    ]
    pairs = [("plate", "lid"), ("plate", "cup"), ("lid", "cup")]
    probabilities = np.tile([0.1, 0.2, 0.3, 0.4], (3, 3, 1))
    history = MassHistory(names, times, share, quantiles, masses)
    lost = {"cup": [(0.0, 0.05)]}
    BeliefHistory(pairs, times, probabilities, lost, joints, scene, history).save(folder / "beliefs.json")
    BeliefHistory(pairs, times, probabilities, {}, [], scene).save(folder / "joints.json")
    return [folder / "beliefs.json", folder / "joints.json"]


def read_beliefs(path: Path) -> Any:
    history = BeliefHistory.load(path)
    with tempfile.TemporaryDirectory() as folder:
        history.save(Path(folder) / "again.json")
        content = json.loads((Path(folder) / "again.json").read_text())
    content.pop("checksum", None)
    return content


def states_beliefs(content: bytes, loaded: Any) -> bool:
    """The numbers are written to five places, and what is a probability is one."""
    stated = strictly(content)
    shares = np.array(stated["probabilities"], dtype=float)
    assert (shares >= 0).all()
    assert np.allclose(shares.sum(-1), 1, atol=1e-3)
    assert (np.diff(stated["times"]) > 0).all()
    return agrees(rounded({k: v for k, v in stated.items() if k not in ("checksum", "scene")}), rounded(loaded)) and (
        agrees(stated["scene"], loaded["scene"])
    )


def rounded(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {name: rounded(value) for name, value in tree.items()}
    if isinstance(tree, list):
        return [rounded(value) for value in tree]
    return round(tree, 5) if isinstance(tree, float) else tree


def make_joint_trajectory(folder: Path) -> list[Path]:
    times = np.array([0.0, 0.5, 1.25])
    arrays = [np.random.default_rng(k).normal(size=(3, 2)) for k in range(3)]
    JointTrajectory.of(["shoulder", "elbow"], times, *arrays).save(folder / "joint_trajectory.json")
    return [folder / "joint_trajectory.json"]


def make_parts(folder: Path) -> list[Path]:
    with generation._parts_folder(folder / "data.h5", PARTS):
        pass
    return [folder / "data.h5.parts" / "recipe.json"]


PARTS = Recipe("planar", 3, 0, 0, 2, "of a test")


def read_parts(path: Path) -> Any:
    generation._check_recipe(path.parent, PARTS)
    return dataclasses.asdict(PARTS)


KINDS = [
    json_kind("scene", lambda f: written(f, "scene.json", workshop().to_json()), lambda p: as_tree(Scene.load(p))),
    json_kind(
        "lever scene",
        lambda f: [Path(shutil.copy(PACKAGE / "scenes" / "lever-up.json", f))],
        lambda p: as_tree(LeverScene.load(p)),
    ),
    json_kind(
        "tool", lambda f: [Path(shutil.copy(PACKAGE / "tools" / "l.json", f))], lambda p: as_tree(load_tool(p).tool)
    ),
    json_kind("plan", make_plan, read_plan, states_plan),
    json_kind("beliefs", make_beliefs, read_beliefs, states_beliefs),
    json_kind("joint trajectory", make_joint_trajectory, lambda p: as_tree(JointTrajectory.load(p))),
    json_kind("recipe of a dataset", make_parts, read_parts),
]
