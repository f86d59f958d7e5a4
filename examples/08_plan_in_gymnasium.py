"""A planner in the Gymnasium environment: try hundreds of pushes side by side in the learned model, make the best one.

python examples/08_plan_in_gymnasium.py
"""

import gymnasium
import numpy as np

from pushgraph.environment.push_env import PushEnv  # importing it registers the environment

TRIED = 256


def propose(seen: dict[str, np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Pushes that begin around the body of the goal, and go where it shall go, or about so."""
    body = seen["poses"][seen["goal_body"].argmax(), :2]
    way = seen["goal"][:2] - body
    turned = rng.normal(0.0, 0.5, (TRIED, 2))
    behind = np.arctan2(way[1], way[0]) + np.pi + turned[:, 0]
    start = body + rng.uniform(0.12, 0.25, (TRIED, 1)) * np.stack((np.cos(behind), np.sin(behind)), -1)
    ahead = np.arctan2(way[1], way[0]) + turned[:, 1]
    length = rng.uniform(0.2, 1.0, (TRIED, 1))
    half_table = seen["table"][3:] / 2
    return np.hstack((start / half_table, length * np.stack((np.cos(ahead), np.sin(ahead)), -1))).astype(np.float32)


def main() -> None:
    """Bring a body of a cluttered, jointed scene to its goal in MuJoCo; the learned model only plans."""
    rng = np.random.default_rng(0)
    table = gymnasium.make("pushgraph/Push-v0", dynamics="mujoco", objects=6)
    seen, info = table.reset(seed=3)
    assert isinstance(table.unwrapped, PushEnv)
    scene, goal = table.unwrapped.scene, table.unwrapped.goal
    model = gymnasium.make_vec("pushgraph/Push-v0", num_envs=TRIED, scenes=scene, goal=goal)
    print(f"{goal.body} shall go {100 * info['distance']:.1f} cm, to {np.round(goal.position, 2).tolist()}")
    over = False
    while not over:
        model.reset(options={"poses": seen["poses"]})
        pushes = propose(seen, rng)
        _, rewards, *_ = model.step(pushes)
        seen, reward, terminated, truncated, info = table.step(pushes[rewards.argmax()])
        over = terminated or truncated
        expected, came, left = (100 * length for length in (rewards.max(), float(reward), info["distance"]))
        print(f"expected {expected:.1f} cm nearer, came {came:.1f}; left {left:.1f}")
    print("there" if info["success"] else "not there")


if __name__ == "__main__":
    main()
