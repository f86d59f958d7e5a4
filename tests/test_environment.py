import math
import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from predictors import no_correction
from scenes import body, flat_tool, workshop

import pushgraph.environment  # noqa: F401
from pushgraph.body import Joint
from pushgraph.environment.episodes import REFUSED
from pushgraph.environment.push_env import PushEnv, PushVectorEnv
from pushgraph.errors import EpisodeError, PlanningError, SimulationError
from pushgraph.planning.costs import cost_of
from pushgraph.planning.goal import Goal
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Polygon
from pushgraph.simulation.planar import PlanarSimulation

PREDICTOR = no_correction()
DISC = Scene(bodies=(body("disc", 0.0, 0.0),), table=Table(size=(1.0, 2.0)))
GOAL = Goal(body="disc", position=(0.2, 0.0))
THROUGH = np.array([-0.4, 0.0, 1.0, 0.0], np.float32)
"""From (-0.2, 0) 30 cm along x: the tool's front ends at 0.15, the disc at 0.21."""
SWEEPS = np.array([[-0.25, 0.0, 0.5, 0.1], [0.25, -0.2, 0.0, 1.0], [0.0, 0.25, 0.2, -0.9]], np.float32)
"""Pushes that move bodies of POOL."""
POOL = (
    workshop(),
    DISC,
    Scene(
        bodies=(
            body(
                "corner", 0.1, 0.1, Polygon(points=((0, 0), (0.2, 0), (0.2, 0.06), (0.06, 0.06), (0.06, 0.2), (0, 0.2)))
            ),
            body("post", -0.3, 0.0).replace(fixed=True),
        ),
        tool=flat_tool(0.02, 0.1),
    ),
)


def across(rng: np.random.Generator, count: int) -> np.ndarray:
    """Pushes near the middle of the table, some of them refused."""
    return (rng.uniform(-1, 1, (count, 4)) * [0.35, 0.35, 1, 1]).astype(np.float32)


@pytest.mark.parametrize("dynamics", [PREDICTOR, "mujoco"])
def test_gymnasium_s_checker_finds_nothing(dynamics) -> None:
    env = gymnasium.make("pushgraph/Push-v0", dynamics=dynamics, objects=2, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_it_is_made_by_its_name_alone() -> None:
    many = gymnasium.make_vec("pushgraph.environment:pushgraph/Push-v0", num_envs=3, scenes=DISC)
    assert isinstance(many, PushVectorEnv)
    assert many.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    assert many.reset(seed=0)[0]["poses"].shape == (3, 1, 3)


def test_the_same_seed_gives_the_same_episode() -> None:
    def episode(seed: int) -> list:
        env = PushEnv(objects=3, dynamics=PREDICTOR, goal_yaw=True)
        rng = np.random.default_rng(0)
        return [env.reset(seed=seed)[0], *(env.step(across(rng, 1)[0])[0] for _ in range(3))]

    first, again, other = episode(5), episode(5), episode(6)
    assert all(np.array_equal(a[name], b[name]) for a, b in zip(first, again, strict=True) for name in a)
    assert not np.array_equal(first[0]["poses"], other[0]["poses"])
    assert not np.array_equal(first[0]["goal"], other[0]["goal"])


def test_tables_side_by_side_are_as_tables_one_by_one() -> None:
    many = PushVectorEnv(6, POOL, dynamics=PREDICTOR, max_episode_steps=4)
    single = SyncVectorEnv(
        [lambda: gymnasium.make("pushgraph/Push-v0", 4, scenes=POOL, dynamics=PREDICTOR)] * 6,
        autoreset_mode=AutoresetMode.NEXT_STEP,
    )
    rng = np.random.default_rng(1)
    results = [(one.reset(seed=3)[0],) for one in (many, single)]
    moved = 0.0
    for _ in range(10):
        for left, right in zip(*results, strict=True):
            if isinstance(left, dict):
                assert left.keys() == right.keys()
                for name in left:
                    np.testing.assert_allclose(left[name], right[name], atol=1e-5)
            else:
                np.testing.assert_allclose(left, right, atol=1e-5)
        actions = across(rng, 6)
        before = results[0][0]["poses"]
        results = [one.step(actions)[:4] for one in (many, single)]
        moved += np.abs(results[0][0]["poses"] - before).max()
    assert moved > 0.1


def test_pushes_one_by_one_are_the_pushes_of_a_track() -> None:
    scene = workshop().replace(pushes=())
    env = PushEnv(scene, dynamics=PREDICTOR)
    env.reset(seed=0)
    pushes = [env.push(action) for action in SWEEPS]
    for action in SWEEPS:
        shown, *_, info = env.step(action)
        assert info["refused"] == ""
    track = PREDICTOR.predict_many([scene.replace(pushes=tuple(pushes))])[0]
    assert np.abs(track.poses[-1, 1:] - track.poses[0, 1:]).max() > 0.1
    np.testing.assert_allclose(shown["poses"], track.poses[-1, 1:], atol=1e-6)


def test_the_learned_table_is_near_the_simulated_one() -> None:
    ends = []
    for dynamics in (PREDICTOR, "mujoco"):
        env = PushEnv(DISC, goal=GOAL, dynamics=dynamics)
        env.reset(seed=0)
        shown, reward, terminated, truncated, info = env.step(THROUGH)
        ends.append(shown["poses"][0])
        assert (terminated, truncated, info["success"]) == (True, False, True)
        assert reward == pytest.approx(0.2 - info["distance"], abs=1e-6)
    assert ends[0][0] == pytest.approx(0.21, abs=0.01)
    np.testing.assert_allclose(*ends, atol=0.005)


def test_rewards_add_up_to_what_the_cost_fell_by() -> None:
    goal = Goal(body="lid", position=(0.1, 0.1), yaw=0.5)
    env = PushEnv(workshop(), goal=goal, dynamics=PREDICTOR)
    env.reset(seed=0)
    total = 0.0
    for action in SWEEPS:
        shown, reward, *_, info = env.step(action)
        total += reward + REFUSED * bool(info["refused"])
    cost = cost_of(env.scene, goal)
    start, end = (
        float(cost(torch.tensor(poses[None]))[0]) for poses in (env.scene.poses_world_from_body, shown["poses"])
    )
    assert abs(end - start) > 0.01
    assert total == pytest.approx(start - end, abs=1e-5)


@pytest.mark.parametrize("dynamics", [PREDICTOR, "mujoco"])
@pytest.mark.parametrize(
    ("action", "why"),
    [
        ((0.0, 0.05, 0.1, 0.0), "the tool would come down -60 mm from body 'disc'"),
        ((0.225, 0.0, 0.1, 0.0), "the tool would come down 2 mm from body 'disc'"),
        ((-0.9, 0.0, -1.0, 0.0), "the end-effector would leave the table"),
    ],
)
def test_pushes_that_cannot_be_made_do_nothing_and_cost(dynamics, action, why) -> None:
    env = PushEnv(DISC, goal=GOAL, dynamics=dynamics)
    before, _ = env.reset(seed=0)
    after, reward, terminated, truncated, info = env.step(np.array(action, np.float32))
    assert (reward, terminated, truncated, info["refused"]) == (-REFUSED, False, False, why)
    assert all(np.array_equal(before[name], after[name]) for name in before)


def test_an_episode_ends_when_a_body_leaves_the_table() -> None:
    scene = DISC.replace(bodies=(body("disc", 0.4, 0.0),))
    env = PushEnv(scene, goal=Goal(body="disc", position=(0.0, 0.0)), dynamics=PREDICTOR)
    env.reset(seed=0)
    _, reward, terminated, _, info = env.step(np.array([0.5, 0.0, 0.8, 0.0], np.float32))
    assert (terminated, info["left_table"], info["success"]) == (True, True, False)
    assert reward < -0.1


def test_an_episode_is_cut_off_where_the_simulation_fails(monkeypatch) -> None:
    def fails(self, push):
        raise SimulationError("crushed")

    monkeypatch.setattr(PlanarSimulation, "push", fails)
    env = PushEnv(DISC, goal=GOAL, dynamics="mujoco")
    env.reset(seed=0)
    _, _, terminated, truncated, info = env.step(THROUGH)
    assert (terminated, truncated, info["refused"]) == (False, True, "crushed")


@pytest.mark.parametrize("scene", [workshop(), POOL[2]], ids=["joints", "polygon"])
def test_beginning_where_another_episode_is_goes_on_like_it(scene) -> None:
    goal = Goal(body=scene.names[0], position=(0.5, 0.5))
    env, model = (PushEnv(scene, goal=goal, dynamics=PREDICTOR) for _ in range(2))
    env.reset(seed=0)
    for action in SWEEPS:
        shown = env.step(action)[0]
    assert np.abs(shown["poses"] - env.reset(seed=0)[0]["poses"]).max() > 0.02
    for action in SWEEPS:
        env.step(action)
    model.reset(seed=9, options={"poses": shown["poses"]})
    for action in -SWEEPS[::-1]:
        np.testing.assert_allclose(env.step(action)[0]["poses"], model.step(action)[0]["poses"], atol=1e-5)


def test_a_table_may_stand_anywhere() -> None:
    motion = np.array([0.3, -0.2, math.radians(40)])
    ends = []
    for scene in (DISC, DISC.moved(motion)):
        env = PushEnv(scene, dynamics=PREDICTOR)
        env.reset(seed=0)
        env.step(THROUGH)
        ends.append(env._episodes.tables.poses[0, 0, :2] - scene.poses_world_from_body[0, :2])
    assert np.hypot(*ends[1]) == pytest.approx(np.hypot(*ends[0]), abs=1e-4)
    assert math.atan2(*ends[1][::-1]) == pytest.approx(motion[2], abs=1e-3)


def test_what_is_seen_is_what_the_scene_says() -> None:
    scene = workshop().replace(joints=(Joint(kind="prismatic", parent="plate", child="lid"),))
    goal = Goal(body="lid", position=(0.3, 0.2), yaw=math.pi / 2)
    shown, _ = PushEnv((scene, *POOL[1:]), dynamics=PREDICTOR).reset(seed=0)
    assert shown["poses"].shape == (4, 3)
    env = PushEnv(scene, goal=goal, dynamics=PREDICTOR)
    shown, info = env.reset(seed=0)
    assert shown["joints"].tolist() == [[0, 2, 0, 0], [2, 0, 0, 0], [0, 0, 0, 1], [0, 0, 1, 0]]
    assert shown["goal_body"].tolist() == [0, 1, 0, 0]
    np.testing.assert_allclose(shown["goal"], [0.3, 0.2, 0, 1], atol=1e-6)
    np.testing.assert_allclose(shown["sizes"][[0, 2]], [[0.07, 0.05, 0], [0, 0, 0.06]], atol=1e-6)
    assert info["turn"] == pytest.approx(math.pi / 2)


def test_what_cannot_be_is_said() -> None:
    with pytest.raises(EpisodeError, match="no setup 'parts'; valid: multiple-parts"):
        PushEnv("parts", dynamics=PREDICTOR)
    with pytest.raises(EpisodeError, match="one of learned, mujoco"):
        PushEnv(DISC, dynamics="bullet")
    with pytest.raises(PlanningError, match="no body 'cup'"):
        PushEnv(DISC, goal=Goal(body="cup", position=(0, 0)), dynamics=PREDICTOR)
    with pytest.raises(EpisodeError, match="no body of the scene can be moved"):
        PushEnv(
            Scene(bodies=(body("wall", 0, 0, Cuboid(size=(0.1, 0.1))).replace(fixed=True),)), dynamics=PREDICTOR
        ).reset()
    env = PushVectorEnv(2, DISC, dynamics=PREDICTOR)
    with pytest.raises(EpisodeError, match="no 'pose'; valid: poses"):
        env.reset(options={"pose": 1})
    with pytest.raises(EpisodeError, match=r"of shape \(1, 3\) or \(2, 1, 3\); got \(3,\)"):
        env.reset(options={"poses": np.zeros(3)})
    with pytest.raises(EpisodeError, match="one for each of 2 tables, got 3"):
        env.reset(seed=[1, 2, 3])
    with pytest.raises(EpisodeError, match="only learned dynamics"):
        PushEnv(DISC, dynamics="mujoco").reset(options={"poses": np.zeros((1, 3))})


def test_only_masked_tables_begin_anew() -> None:
    env = PushVectorEnv(2, DISC, dynamics=PREDICTOR)
    env.reset(seed=0)
    moved = env.step(np.stack((THROUGH, THROUGH)))[0]["poses"]
    shown, info = env.reset(seed=1, options={"reset_mask": np.array([True, False])})
    assert shown["poses"][0, 0, 0] == 0.0
    assert np.array_equal(shown["poses"][1], moved[1])
    assert info["_distance"].tolist() == [True, False]
