"""The suite `tools`: its tasks, and what is measured of them."""

import numpy as np
import pytest

from pushgraph.errors import EvaluationError
from pushgraph.evaluation import tool_tasks
from pushgraph.evaluation.tool_figures import save_tools
from pushgraph.evaluation.tools import evaluate_tools
from pushgraph.planning.sequences import sequences
from pushgraph.planning.tools import load_tools
from pushgraph.simulation.setups import FIRST_TEST_SEED

WITH_GOALS = 14


def test_starts_are_the_grid_and_jittered_by_the_seed():
    grid = np.array([scene.poses_world_from_body[0, :2] for scene in tool_tasks.start_scenes(FIRST_TEST_SEED)])
    assert np.unique(grid[:, 0]).tolist() == pytest.approx([-0.725, -0.525, -0.325, -0.125])
    assert np.unique(grid[:, 1]).tolist() == pytest.approx([-0.5, -0.3, -0.1, 0.1, 0.3, 0.5])
    other, same = (
        np.array([scene.poses_world_from_body[0, :2] for scene in tool_tasks.start_scenes(FIRST_TEST_SEED + 1)])
        for _ in range(2)
    )
    assert np.array_equal(other, same)
    assert 0 < np.abs(other - grid).max() <= tool_tasks.JITTER


@pytest.fixture
def one_start(monkeypatch, tmp_path):
    """One start of the grid, two tools, two pushes."""
    (scene,) = tool_tasks.start_scenes(FIRST_TEST_SEED)[WITH_GOALS : WITH_GOALS + 1]
    monkeypatch.setenv("PUSHGRAPH_CACHE", str(tmp_path))
    for module in ("tool_tasks", "tools"):
        monkeypatch.setattr(f"pushgraph.evaluation.{module}.start_scenes", lambda seed: [scene])
    monkeypatch.setattr(tool_tasks, "load_tools", lambda names: load_tools(["stick", "l"] if names == "all" else names))
    monkeypatch.setattr(tool_tasks, "sequences", lambda: sequences(pushes=2))
    return scene


def test_goals_are_apart_on_the_table_and_reached_in_simulation(one_start, monkeypatch):
    start = tool_tasks.simulated_start(one_start)
    goals = start.goals
    assert len(goals) >= 2
    away = np.hypot(*(goals - one_start.poses_world_from_body[0, :2]).T)
    between = np.hypot(*(goals[:, None] - goals[None]).transpose(2, 0, 1)) + np.eye(len(goals))
    assert min(away.min(), between.min()) > tool_tasks.APART
    ends = start.poses[:, -1, :2]
    assert all(np.hypot(*(ends - goal).T).min() == 0 for goal in goals)
    monkeypatch.setattr(tool_tasks, "simulate", None)
    again = tool_tasks.simulated_start(one_start)  # from the cache
    assert np.array_equal(again.poses, start.poses)


@pytest.mark.slow
def test_learned_plans_reach_the_goals_that_simulated_ones_reach(one_start, tmp_path):
    results, measures = evaluate_tools(2, FIRST_TEST_SEED)
    assert measures.tasks == 2
    values = {
        (row["model"], row["tool"], row["executed"], row["loop"], row["metric"]): row["value"] for row in results.rows
    }
    for model in ("learned", "mujoco"):
        assert values[model, "all", "tool", "open", "success_5cm"] == 1
        assert values[model, "all", "tool", "open", "mean_error_cm"] < 1
    assert values["learned", "all", "arm", "open", "success_5cm"] == 1
    assert values["learned", "all", "tool", "closed", "success_10cm"] == 1
    # Tools that were not there do nothing.
    assert values["learned", "stick-left", "tool", "open", "mean_error_cm"] > 5
    assert values["mujoco", "all", "all", "open", "planning_s"] > values["learned", "all", "all", "open", "planning_s"]
    save_tools(results.rows, measures.tasks, tmp_path / "tools.png")
    assert (tmp_path / "tools.png").stat().st_size > 10_000


def test_seeds_of_training_are_refused():
    with pytest.raises(EvaluationError, match="training"):
        evaluate_tools(2, 5)
