"""`image`: the paper's baseline, a convolutional network over an image of every body's surroundings."""

import itertools
import math
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph import pose
from pushgraph.graph import surroundings as features
from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.pieces import gather_pieces, mean_motion, move_pieces
from pushgraph.graph.state import Control, State
from pushgraph.graph.surroundings import CHANNELS, VECTOR, Surroundings, surroundings
from pushgraph.network.contract import Advance

DISPLACEMENT = 0.01
"""Unit of errors in training (m)."""
FASTEST = 2.0
"""Bodies move no farther in a step than this many lengths of the tool's motion."""


class ImageDynamics(nn.Module):
    """Every body's motion from its own image, told from the others' only by the next frame's images.

    Motions are in the body's frame and in lengths of the tool's motion in the step: nothing moves where the tool does
    not. Rigid groups move with their members' mean.
    """

    LONGEST_STEP = math.inf
    FRAMES_PER_STEP: tuple[int, ...] = (1,)
    SMALL = 0.01
    CHAOS = 10.0
    VELOCITY_NOISE = 0.0

    def __init__(self, hidden: int = 128, steps: int = 3) -> None:
        super().__init__()
        widths = [len(CHANNELS), *(max(8, hidden >> (steps - 1 - k)) for k in range(steps))]
        side = features.PIXELS
        layers: list[nn.Module] = []
        for before, after in itertools.pairwise(widths):
            layers += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.ReLU()]
            side = -(-side // 2)
        self.convolutions = nn.Sequential(*layers, nn.Flatten())
        self.head = nn.Sequential(
            nn.Linear(widths[-1] * side**2 + len(VECTOR), 2 * hidden),
            nn.ReLU(),
            nn.Linear(2 * hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, 4),
        )

    @staticmethod
    def schema() -> dict[str, Any]:
        """Channels of the images, and the constants that weights depend on."""
        return {
            "image_channels": list(CHANNELS),
            "vector_features": list(VECTOR),
            "constants": features.CONSTANTS | {"fastest": FASTEST},
        }

    @staticmethod
    def error_unit(step: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        """Training counts errors in this unit (m), as the paper's network does."""
        return torch.full_like(step, DISPLACEMENT)

    def forward(self, state: State, control: Control) -> Advance:
        """See Dynamics; it knows no force limits."""
        with torch.no_grad():
            seen = surroundings(state, control)
        batch, bodies = state.poses.shape[:2]
        own = self._motions(seen).to(state.poses.dtype)
        yaw = state.poses[..., 2].flatten()[seen.slot]
        world = torch.cat((pose.rotate(own[:, :2], yaw), own[:, 2:]), -1)
        motion = state.poses.new_zeros(batch * bodies, 3).index_copy(0, seen.slot, world).view(batch, bodies, 3)
        pieces = gather_pieces(state.scenes, state.scenes.group, state.poses)
        motion = move_pieces(pieces, state.poses, mean_motion(state.scenes, pieces.index, motion))
        return Advance(motion, torch.ones_like(state.poses[:, 0, 0]))

    def _motions(self, seen: Surroundings) -> Float[Tensor, "seen 3"]:
        precision = next(self.head.parameters()).dtype
        view = self.convolutions(seen.images.to(precision))
        raw = self.head(torch.cat((view, seen.vectors.to(precision)), -1)).float()
        # The last number is whether the body moves at all: most do not, and what does not shall not drift.
        share = FASTEST * (raw[:, :3] / FASTEST).tanh() * raw[:, 3:].sigmoid()
        return share * seen.length[:, None] / share.new_tensor([1.0, 1.0, LEVER])
