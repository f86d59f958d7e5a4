"""The tasks of the suite `tools` (paper, section IV; PROTOCOL, setup 4): from a start, bring a cylinder to a goal that
some tool and sequence of pushes reaches in simulation."""

import json
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.body import Body
from pushgraph.dataset.engines import run_in_processes
from pushgraph.evaluation.kept import keep, kept
from pushgraph.evaluation.simulation_key import simulation_key
from pushgraph.planning.exhaustive import Candidates
from pushgraph.planning.sequences import sequences
from pushgraph.planning.tools import load_tools
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder
from pushgraph.simulation.motion import plan_tool
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import FIRST_TEST_SEED
from pushgraph.storage import cache_folder
from pushgraph.track import FRAME, Track

GRID_X, GRID_Y = np.linspace(-0.725, -0.125, 4), np.linspace(-0.5, 0.5, 6)
"""Starts, relative to the end-effector (m)."""
JITTER = 0.02
"""Starts are moved so far at most, each way (m), but for the first test seed."""
DIAMETER = 0.10
CLEARANCE = 0.0
"""No tool comes down nearer to the cylinder (m). The paper's 5 cm are taken as from its centre, its radius: from its
surface they would leave 88 tasks of 154; the paper has 166."""
APART = 0.05
"""A goal is farther than this from its start, and from every other goal of that start (m)."""
NEVER_MET = 1e-3
"""A tool that stays farther than this from a body does not move it (m)."""


class Start(NamedTuple):
    """A cylinder before anything is done to it, all that may be done, and what that does in simulation."""

    scene: Scene
    candidates: Candidates
    poses: Float[np.ndarray, "plans frames 3"]  # of the cylinder, pose_world_from_body

    @property
    def tracks(self) -> list[Track]:
        """What was simulated."""
        return [_track(plan, poses[:, None]) for plan, poses in zip(self.candidates.plans, self.poses, strict=True)]

    @property
    def goals(self) -> Float[np.ndarray, "goals 2"]:
        """Where the cylinder may end, on the table, that is neither near its start nor near a goal before."""
        kept = np.empty((0, 2))
        ends = self.poses[:, -1, :2]
        for end in ends[self.scene.table.holds(ends)]:
            others = np.vstack((self.poses[0, 0, :2], kept))
            if np.hypot(*(others - end).T).min() > APART:
                kept = np.vstack((kept, end))
        return kept


def start_scenes(seed: int) -> list[Scene]:
    """The scenes of the grid, each with a cylinder of nominal mass at another place; the end-effector is at (0, 0)."""
    places = np.stack(np.meshgrid(GRID_X, GRID_Y, indexing="ij"), -1).reshape(-1, 2)
    if seed != FIRST_TEST_SEED:
        places = places + np.random.default_rng(seed).uniform(-JITTER, JITTER, places.shape)
    return [
        Scene(
            bodies=(
                Body(name="object", shape=Cylinder(diameter=DIAMETER), pose_world_from_body=(x, y, 0.0), mass=0.6),
            ),
            clearance=CLEARANCE,
        )
        for x, y in places.tolist()
    ]


def candidates_of(scene: Scene, tools: str | Sequence[str] = "all") -> Candidates:
    """Every tool that clears the body with every sequence of the paper."""
    return Candidates.of(scene, load_tools(tools), sequences())


def simulated_start(scene: Scene) -> Start:
    """A start, and all that may be done; what is simulated is kept in the user's cache."""
    candidates = candidates_of(scene)
    plans = json.dumps([list(dict.fromkeys(candidates.tools)), [repr(push) for push in sequences()]])
    key = simulation_key(scene.to_json(), plans)
    path = cache_folder() / "tool_tasks" / f"{key}.npz"
    if (found := kept(path, key)) is not None:
        return Start(scene, candidates, found["poses"])
    poses = np.stack([_simulated(plan) for plan in candidates.plans])
    keep(path, key, {"poses": poses})
    return Start(scene, candidates, poses)


def goals_of_starts(
    seed: int, workers: int = 1, progress: Callable[[int, int], None] = lambda done, total: None
) -> list[int]:
    """How many goals every start has. progress: starts done, of how many."""
    scenes = [scene.to_json() for scene in start_scenes(seed)]
    found: dict[str, int] = {}
    for done, (scene, goals) in enumerate(run_in_processes(_count_goals, scenes, workers), start=1):
        found[scene] = goals
        progress(done, len(scenes))
    return [found[scene] for scene in scenes]


def _count_goals(scene_json: str) -> int:
    return len(simulated_start(Scene.from_json(scene_json)).goals)


def _simulated(plan: Scene) -> Float[np.ndarray, "frames 3"]:
    tool, _ = plan_tool(plan.pushes, plan.tool)
    if plan.tool_gaps(tool, plan.poses_world_from_body).min() > NEVER_MET:
        return np.repeat(plan.poses_world_from_body, len(tool), 0)
    return simulate(plan).poses[:, 1]


def _track(plan: Scene, poses: Float[np.ndarray, "frames bodies 3"]) -> Track:
    tool, push = plan_tool(plan.pushes, plan.tool)
    return Track(
        scene=plan,
        times=np.arange(len(tool)) * FRAME,
        poses=np.concatenate((tool[:, None], poses), 1),
        push=push,
        seen=np.ones((len(tool), 1 + poses.shape[1]), dtype=bool),
    )
