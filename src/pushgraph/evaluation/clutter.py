"""The suite `clutter`: bring a body among others to a goal, push by push, without being told what is joined."""

import functools
import math
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from pushgraph.belief import BeliefModel
from pushgraph.errors import PushGraphError
from pushgraph.evaluation.blocks import SETUP, Block, measure_blocks
from pushgraph.evaluation.results import Results
from pushgraph.joint_doubt import Beliefs
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.closed_loop import MOST_PUSHES, SimulatedEnvironment, push_to_goal
from pushgraph.planning.dynamics import learned, simulated
from pushgraph.planning.goal import Goal
from pushgraph.planning.plan import Plan
from pushgraph.planning.risk import Risk, as_predicted, expected, percentile
from pushgraph.planning.sampling import Sampling, plan_continuously
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import Scene

AWAY = 0.20
"""How far the goal is from where the body is (m), in any direction."""
MARGIN = 0.15
"""The goal is this far from the table's edges (m): the tool has room to push from there."""
TURN = math.pi / 2
"""Goal poses are turned by up to this, either way (rad)."""
GOALS = ("position", "pose")
BLOCK = 5
"""Scenes that one process handles at a time."""


class Contender(NamedTuple):
    """One way to plan. joints: what is known of them: unknown, none, true. simulates: plans by MuJoCo."""

    joints: str = "unknown"
    risk: Risk = as_predicted
    simulates: bool = False


CONTENDERS = {
    "belief": Contender(),
    "belief_expected": Contender(risk=expected),
    "belief_percentile_90": Contender(risk=percentile),
    "no_joint": Contender(joints="none"),
    "true_joints": Contender(joints="true"),
    "mujoco": Contender(simulates=True),
}
"""By name. mujoco: believes as `belief` does, and has the time that it takes for a plan on average in the same task."""


class Run(NamedTuple):
    """What came of one task. error: in the end (m, rad). planning: seconds, one a push. said: of each push, how likely
    it was said to bring the body to its goal, and whether it did; empty if nothing was said."""

    reached: bool
    error: tuple[float, float]
    planning: tuple[float, ...]
    said: tuple[tuple[float, bool], ...]


class ClutterScene(NamedTuple):
    """Runs in one scene by contender and goal."""

    objects: int
    runs: dict[tuple[str, str], Run]


def evaluate_clutter(
    objects: Sequence[int],
    count: int,
    seed: int,
    models: Mapping[str, str | os.PathLike],
    workers: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    contenders: Sequence[str] = tuple(CONTENDERS),
) -> tuple[Results, list[ClutterScene]]:
    """Run closed loops in `count` test scenes for each number of objects; see `measure_blocks`.

    models: the checkpoints `contact`, which predicts, and `belief`, which watches. contenders: of CONTENDERS.
    """
    work = partial(run_block, contenders=tuple(contenders))
    scenes = measure_blocks(work, objects, count, seed, models, workers, progress, block=BLOCK)
    protocol = {"setup": SETUP, "count": count, "seed": seed, "away": AWAY, "turn": TURN, "most_pushes": MOST_PUSHES}
    results = Results("clutter", protocol, ("objects", "goal"))
    for number in objects:
        some = [scene for scene in scenes if scene.objects == number]
        for model in contenders:
            for goal in GOALS:
                _add_rows(results, model, [scene.runs[model, goal] for scene in some], objects=number, goal=goal)
    return results, scenes


def draw_goal(rng: np.random.Generator, scene: Scene) -> Goal:
    """A pose for any one of the bodies that can move: AWAY from where it is in any direction, turned by up to TURN.

    Drawn again until it is MARGIN from the table's edges. Other bodies may stand there: they can be pushed aside.
    """
    room = scene.table.replace(size=tuple(side - 2 * MARGIN for side in scene.table.size))
    while True:
        body = scene.bodies[int(rng.choice(np.flatnonzero(~scene.immovable)))]
        x, y, yaw = body.pose_world_from_body
        direction, turn = rng.uniform(-math.pi, math.pi), rng.uniform(-TURN, TURN)
        place = (x + AWAY * math.cos(direction), y + AWAY * math.sin(direction))
        if room.holds(np.array([place])).all():
            return Goal(body=body.name, position=place, yaw=yaw + turn)


def run_block(block: Block, contenders: Sequence[str]) -> list[ClutterScene]:
    """Draw the scenes and goals of a block, and let every contender push towards them."""
    checkpoints = dict(block.models)
    predictor, belief = _loaded(checkpoints["contact"], checkpoints["belief"])
    measured = []
    for k, trajectory in enumerate(block.draw()):
        scene = trajectory.track.scene.replace(pushes=())
        key = [block.seed, block.objects, block.first + k]
        pose = draw_goal(np.random.default_rng(key), scene)
        runs: dict[tuple[str, str], Run] = {}
        for goal_name, goal in (("position", pose.replace(yaw=None)), ("pose", pose)):
            seconds = 1.0
            for name in contenders:
                runs[name, goal_name] = run(
                    CONTENDERS[name], scene, goal, predictor, belief, np.random.default_rng(key), seconds
                )
                if name == "belief" and runs[name, goal_name].planning:
                    seconds = float(np.mean(runs[name, goal_name].planning))
        measured.append(ClutterScene(block.objects, runs))
    return measured


def run(
    contender: Contender,
    scene: Scene,
    goal: Goal,
    predictor: PhysicsPredictor,
    belief: BeliefModel,
    rng: np.random.Generator,
    seconds: float,
) -> Run:
    """One closed loop. seconds: that MuJoCo has for a plan. What cannot go on has not reached its goal."""
    environment = SimulatedEnvironment(scene)
    known_scene = scene.replace(joints=()) if contender.joints == "none" else scene
    regulator = BeliefRegulator(known_scene, belief, given=contender.joints != "unknown")
    sampling = Sampling(seconds=seconds if contender.simulates else None)

    def plan(scene: Scene, goal: Goal, beliefs: Beliefs) -> Plan:
        dynamics = simulated if contender.simulates else learned(predictor, spread=True, beliefs=beliefs)
        return plan_continuously(scene, goal, dynamics, rng, sampling, contender.risk)

    steps = []
    try:
        for step in push_to_goal(regulator, environment, goal, plan):
            steps.append(step)
    except PushGraphError:
        pass
    end = environment.simulation.poses[scene.names.index(goal.body)]
    said = [(step.likely, goal.reached(step.observed)) for step in steps if step.likely is not None]
    return Run(
        goal.reached(end),
        goal.error(end),
        tuple(step.planning for step in steps),
        tuple(said),
    )


def _add_rows(results: Results, model: str, runs: Sequence[Run], **labels: Any) -> None:
    every = np.arange(len(runs))

    def add(metric: str, unit: str, values: list) -> None:
        results.add(model, metric, unit, np.array(values, dtype=float), every, **labels)

    distance = [run.error[0] for run in runs]
    add("success_3cm", "1", [d <= 0.03 for d in distance])
    if labels["goal"] == "pose":
        add("success_pose", "1", [run.reached for run in runs])
    add("error_cm", "cm", [100 * d for d in distance])
    add("pushes", "1", [len(run.planning) for run in runs])
    of_plans = [(k, seconds) for k, run in enumerate(runs) for seconds in run.planning]
    scene, seconds = np.array(of_plans).reshape(-1, 2).T
    results.add(model, "planning_s", "s", seconds, scene.astype(int), **labels)
    said = [(k, *pair) for k, run in enumerate(runs) for pair in run.said]
    if said:
        scene, likely, came = np.array(said, dtype=float).T
        results.add_calibration_error(
            model, np.maximum(likely, 1 - likely), (likely > 0.5) == came, scene.astype(int), **labels
        )


@functools.cache
def _loaded(contact: str, belief: str) -> tuple[PhysicsPredictor, BeliefModel]:
    return PhysicsPredictor.load(contact), BeliefModel.load(belief)
