"""A network of one's own: a small MLP, trained, saved, loaded and measured beside the shipped predictor.

python examples/09_own_network.py
"""

import math
from typing import Any

import torch
from torch import Tensor, nn

import pushgraph as pg
from pushgraph import pose
from pushgraph.evaluation.physics import evaluate_physics
from pushgraph.graph.state import Control, State
from pushgraph.network.contract import Advance

UNIT = 0.01  # of motions in a frame (m); of lengths ten times that
FEATURES = ("half_x", "half_y", "radius", "tool_radius", "x", "y", "control_x", "control_y", "down")


class MlpDynamics(nn.Module):
    """How the tool alone moves each body, told in the body's frame; what the others do to it is left out.

    It keeps the contract `pushgraph.network.contract.PhysicsNetwork`.
    """

    LONGEST_STEP = math.inf
    FRAMES_PER_STEP: tuple[int, ...] = (1,)
    SMALL, CHAOS, VELOCITY_NOISE = 0.01, 10.0, 0.0

    def __init__(self, hidden: int = 64, steps: int = 2) -> None:
        super().__init__()
        between = [layer for _ in range(steps - 1) for layer in (nn.Linear(hidden, hidden), nn.ReLU())]
        self.layers = nn.Sequential(nn.Linear(len(FEATURES), hidden), nn.ReLU(), *between, nn.Linear(hidden, 3))

    @staticmethod
    def schema() -> dict[str, Any]:
        """What a checkpoint's weights depend on."""
        return {"node_features": list(FEATURES), "constants": {"unit": UNIT}}

    @staticmethod
    def error_unit(step: Tensor) -> Tensor:
        """Training counts errors in this unit (m)."""
        return torch.full_like(step, UNIT)

    def forward(self, state: State, control: Control) -> Advance:
        """Motions of all bodies in a step, and that the tool makes all of its own."""
        scenes, yaw = state.scenes, state.poses[..., 2]
        down = control.down[:, None].expand(yaw.shape).float()
        place = pose.relative(state.poses, control.pose[:, None])[..., :2] / (10 * UNIT)
        steer = pose.rotate(control.motion[:, None, :2].expand(place.shape), -yaw) / UNIT
        boxes, tool = scenes.boxes, scenes.tool_radius[:, None, None].expand(*yaw.shape, 1)
        sizes = torch.cat((boxes.half_extents, boxes.radius[..., None], tool), -1) / (10 * UNIT)
        features = torch.cat((sizes, place, steer, down[..., None]), -1).float()
        near = place.norm(dim=-1) < sizes.sum(-1) + 1
        own = self.layers(features) * UNIT * (steer.norm(dim=-1) * down * near)[..., None]
        motion = torch.cat((pose.rotate(own[..., :2], yaw), own[..., 2:] / 0.05), -1)
        return Advance(motion, torch.ones_like(yaw[:, 0]))


pg.register_network("mlp", MlpDynamics)


def main(count: int = 96, samples: int = 200_000, scenes: int = 8) -> None:
    """Train on a few trajectories of three bodies, and measure on unseen ones."""
    data = pg.generate("multiple-parts", objects=3, count=count, seed=0, out="train.h5")
    validation = pg.generate("multiple-parts", objects=3, count=8, seed=900_000, out="validation.h5")
    training = pg.PhysicsTraining(model="mlp", data=str(data), validation=str(validation), samples=samples,
                                  hidden=64, batch=64, learning_rate=3e-3)  # fmt: skip
    pg.train_physics(training, pg.TrainingRun(out="mlp.safetensors"))
    results, _ = evaluate_physics([3], scenes, 1_000_000, {"mlp": "mlp.safetensors", "contact": "contact"})
    for row in results.rows:
        if (row["metric"], row["frames"], row["density"]) == ("mean_error_cm", 50, "all"):
            print(f"{row['model']}: {row['value']:.2f} cm off on average over 50 frames")


if __name__ == "__main__":
    main()
