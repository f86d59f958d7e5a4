"""From features of a predicted track to how far off it may be."""

from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph.graph.track_features import CONSTANTS, COUPLINGS, FEATURES, LEAST_LENGTH, TrackFeatures

LEAST, LEAST_YAW = 5e-5, 4e-4
"""Scales of what rests (m, rad): 68 % regions are then some 0.1 mm and 0.05 degrees wide."""
DEGREES = (0.5, 30.0)
"""Fewest and most degrees of freedom: errors that are either small or large need few."""
LOG_SHARE = (-9.0, 1.0)
"""Scales are shares of the motion around a body; their logarithms stay in these bounds."""


class Scales(NamedTuple):
    """What `Spread` holds under the same names, at the knots."""

    along: Float[Tensor, "batch knots bodies"]
    across: Float[Tensor, "batch knots bodies"]
    degrees: Float[Tensor, "batch knots bodies"]
    yaw: Float[Tensor, "batch knots bodies"]
    yaw_degrees: Float[Tensor, "batch knots bodies"]


class Messages(nn.Module):
    """Every node hears from those that it is coupled with, by a message for each coupling."""

    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.keep, self.send = nn.Linear(inputs, hidden), nn.Linear(inputs, hidden * len(COUPLINGS))

    def forward(
        self,
        nodes: Float[Tensor, "batch knots nodes inputs"],
        couplings: Float[Tensor, "batch knots nodes nodes couplings"],
    ) -> Float[Tensor, "batch knots nodes hidden"]:
        """What nodes know after they have heard."""
        messages = self.send(nodes).unflatten(-1, (len(COUPLINGS), -1)).flatten(2, 3)
        return (self.keep(nodes) + couplings.flatten(3) @ messages).relu()


class SpreadNetwork(nn.Module):
    """Messages between coupled nodes tell at which rates doubt grows as a body moves; what has grown by then, and a
    second round of messages, settle the scales, as shares of the motion around each body.

    So where nothing moved, nothing is doubtful, and what is doubtful about a body reaches its neighbours. `widening`:
    factors of the scales of positions and of yaws, set once after training.
    """

    PHYSICS = "contact"
    widening: Tensor

    def __init__(self, hidden: int = 32) -> None:
        super().__init__()
        self.encode = nn.Linear(len(FEATURES), hidden)
        self.hear = Messages(hidden, hidden)
        self.rate = nn.Linear(hidden, hidden)
        self.hear_again = Messages(2 * hidden, hidden)
        self.answer = nn.Linear(3 * hidden, len(Scales._fields))
        self.register_buffer("widening", torch.ones(2))
        with torch.no_grad():
            self.answer.weight *= 0.1
            self.answer.bias.copy_(torch.tensor([-4.0, -4.0, 0.0, -4.0, 0.0]))

    @staticmethod
    def schema() -> dict[str, Any]:
        """Names of the features, and the constants that its answers depend on."""
        constants = CONSTANTS | {"LEAST": LEAST, "LEAST_YAW": LEAST_YAW, "DEGREES": list(DEGREES)}
        return {
            "node_features": list(FEATURES),
            "couplings": list(COUPLINGS),
            "constants": constants | {"LOG_SHARE": list(LOG_SHARE)},
        }

    def forward(self, track: TrackFeatures) -> Scales:
        """Scales at the knots of the features."""
        bodies = track.around.shape[-1]
        encoded = self.encode(track.nodes).relu()
        heard = self.hear(encoded, track.couplings)
        rate = nn.functional.softplus(self.rate(heard))
        grown = ((track.moved[..., None] * rate).cumsum(1) + LEAST_LENGTH).log() / 3 + 1.5
        again = self.hear_again(torch.cat((heard, grown), -1), track.couplings)
        answers = self.answer(torch.cat((encoded, grown, again), -1)[:, :, :bodies])
        along, across, degrees, yaw, yaw_degrees = answers.unbind(-1)
        around = track.around
        wider, yaw_wider = self.widening
        return Scales(
            along=LEAST + wider * around * _share(along),
            across=LEAST + wider * around * _share(across),
            degrees=_degrees(degrees),
            yaw=LEAST_YAW + yaw_wider * around / track.lever[:, None] * _share(yaw),
            yaw_degrees=_degrees(yaw_degrees),
        )


def _share(answer: Tensor) -> Tensor:
    return answer.clamp(*LOG_SHARE).exp()


def _degrees(answer: Tensor) -> Tensor:
    least, most = DEGREES
    return (least + nn.functional.softplus(answer)).clamp(max=most)


SPREADS: dict[str, type[SpreadNetwork]] = {"spread": SpreadNetwork}
"""The networks that state spreads, by name."""
