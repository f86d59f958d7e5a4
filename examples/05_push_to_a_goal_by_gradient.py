"""Batched, differentiable rollouts: find the push that brings a disc to a goal by following the gradient.

python examples/05_push_to_a_goal_by_gradient.py
"""

import numpy as np
import torch

import pushgraph as pg

FRAMES, GUESSES, STEPS = 26, 8, 12
GOAL = torch.tensor([0.16, 0.05], dtype=torch.float64)


def main() -> None:
    """Eight first guesses side by side, each improved by gradient; the best is checked in simulation."""
    torch.set_num_threads(1)  # so few scenes are quickest on one thread
    disc = pg.Body(name="disc", shape=pg.Cylinder(diameter=0.10), pose_world_from_body=(0, 0, 0), mass=0.5)
    scene = pg.Scene(bodies=(disc,), tool=pg.Tool.round(0.05))
    predictor = pg.load()
    states = predictor.start([scene] * GUESSES)
    down = torch.ones(GUESSES, FRAMES, dtype=torch.bool)

    # A push is a start beside the disc and a direction; the tool goes 1 cm a frame.
    rng = np.random.default_rng(0)
    push = torch.tensor(rng.uniform([-0.03, -0.6], [0.03, 0.6], (GUESSES, 2)), requires_grad=True)
    ahead = 0.01 * torch.arange(FRAMES, dtype=torch.float64)

    def tool_poses() -> torch.Tensor:
        offset, direction = push[:, :1], push[:, 1:]
        x = -0.10 + ahead * direction.cos()
        y = offset + ahead * direction.sin()
        return torch.stack((x, y, torch.zeros_like(x)), -1)

    optimizer = torch.optim.Adam([push], lr=0.03)
    distance = torch.full((GUESSES,), torch.inf)
    for _ in range(STEPS):
        poses = predictor.rollout(states, tool_poses(), down).poses
        distance = (poses[:, -1, 0, :2] - GOAL).norm(dim=-1)
        optimizer.zero_grad()
        distance.sum().backward()
        optimizer.step()
    best = int(distance.argmin())
    print(f"predicted distance to the goal: {100 * distance[best].item():.1f} cm (first guesses: up to tens of cm)")

    start, end = tool_poses()[best, [0, -1], :2].tolist()
    track = pg.simulate(scene.replace(pushes=(pg.Push(start=tuple(start), end=tuple(end), speed=0.2),)))
    print(f"simulated: {100 * np.hypot(*(track.poses[-1, 1, :2] - GOAL.numpy())):.1f} cm")


if __name__ == "__main__":
    main()
