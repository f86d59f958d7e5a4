"""How far a frame's evidence about masses is to be trusted: a small network that states its noise.

Predictions with the true masses are off too: by how much depends on what happens. The network is trained so that true
masses are as likely as can be under the evidence of whole tracks.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph.graph.mass_evidence import SENSED, Felt, Linearized
from pushgraph.simulation.force_sensor import FORCE_NOISE, MOMENT_NOISE

FEATURES = (
    *("step", "motion", "greatest_motion", "curvature", "sensitivity", "own_sensitivity"),
    *("bodies_moving", "tracking_noise", "camera_noise"),
)
UNIT = 1e-3
"""Of lengths in the features (m), which stand as logarithms."""
FLOOR, OF_STEP, OF_MOTION = 3e-4, 0.1, 0.05
"""The noise from which the network starts: this much (m), and shares of the tool's step and of the body's motion."""
WIDEST = 6.0
"""The network changes the logarithm of a variance by at most this."""
OF_WRENCH, OF_DOUBT = 0.02, 1.0
"""Noise of a predicted force before training, as shares of it and of what is doubtful of it."""
WRENCH_LEVER = 0.05
"""Moments are predicted about as exactly as forces at this distance (m)."""
CONSTANTS = {
    "unit": UNIT,
    "floor": [FLOOR, OF_STEP, OF_MOTION],
    "wrench": [FORCE_NOISE, MOMENT_NOISE, OF_WRENCH, OF_DOUBT, WRENCH_LEVER],
}


class Noise(NamedTuple):
    """Variances (m^2). model: of a predicted motion, turns at LEVER. observed: of what a camera sees."""

    model: Float[Tensor, "*batch bodies 3"]
    observed: Float[Tensor, "*batch bodies 3"]


class Evidence(NamedTuple):
    """A Gaussian over logarithms of masses and friction: information x = pull at its highest point."""

    information: Float[Tensor, "*batch variables variables"]
    pull: Float[Tensor, "*batch variables"]


class MassNoise(nn.Module):
    """States the noise of a predicted motion, and turns surprises into evidence about masses."""

    def __init__(self, hidden: int = 24) -> None:
        super().__init__()
        last = nn.Linear(hidden, 2)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.layers = nn.Sequential(
            nn.Linear(len(FEATURES), hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh(), last
        )
        self.log_freedom = nn.Parameter(torch.tensor([1.4]))
        """Logarithm of the degrees of freedom of Student's distribution that surprises have."""
        self.log_worth = nn.Parameter(torch.tensor([0.0]))
        """Logarithm of what evidence is worth: errors of successive frames are alike."""
        self.log_of_wrench = nn.Parameter(torch.tensor([OF_WRENCH, OF_WRENCH]).log())
        """Logarithms of the noise of a predicted wrench, as a share of the force, and how that grows with the camera's
        noise, for each UNIT of that."""
        self.log_of_doubt = nn.Parameter(torch.tensor([OF_DOUBT, OF_WRENCH]).log())
        """The same, as shares of the force that is doubtful."""
        self.log_worth_of_wrench = nn.Parameter(torch.tensor([0.0]))

    def noise(
        self,
        step: Float[Tensor, "*batch"],
        linearized: Linearized,
        usual: Float[Tensor, "*batch bodies"],
        variance: Float[Tensor, "*batch bodies"],
        camera: Float[Tensor, "*batch 2"],
    ) -> Float[Tensor, "*batch bodies 2"]:
        """Variances of predicted positions and of turns at LEVER (m^2).

        step: how far the tool moves (m). usual: see `usual_noise`. variance: of tracked positions (m^2). camera:
        standard deviations (m).
        """
        motion = linearized.motion[..., :2].norm(dim=-1)
        greatest = motion.amax(-1, keepdim=True).expand_as(motion)
        sensitivity = linearized.sensitivity[..., :-1].abs()
        own = sensitivity.diagonal(dim1=-3, dim2=-1).amax(-2)
        lengths = torch.stack(
            (
                *(step[..., None].expand_as(motion), motion, greatest, linearized.curvature.sqrt()),
                *(sensitivity.amax((-2, -1)), own, variance.sqrt(), camera[..., :1].expand_as(motion)),
            ),
            -1,
        )
        count = linearized.moves.sum(-1, keepdim=True).expand_as(motion)[..., None]
        logs = (lengths / UNIT + 1e-2).log() / 2
        features = torch.cat((logs[..., :6], count / 4 - 1, logs[..., 6:]), -1)
        change = self.layers(features.float()).clamp(-WIDEST, WIDEST).to(motion.dtype)
        return usual[..., None] * change.exp()

    def evidence(
        self,
        linearized: Linearized,
        surprise: Float[Tensor, "*batch bodies 3"],
        variance: Float[Tensor, "*batch bodies 3"],
        log_mass: Float[Tensor, "*batch variables"],
    ) -> Evidence:
        """From how far bodies were from where they were expected (m; NaN where not seen), and its variance.

        log_mass: about which the step was linearized.
        """
        seen = surprise.isfinite()
        off = torch.where(seen, surprise, 0.0)
        sensitivity = linearized.sensitivity
        freedom = self.log_freedom.exp()
        scaled = (off.square() / variance).sum(-1)
        weight = (freedom + seen.sum(-1)) / (freedom + scaled) * self.log_worth.exp()
        sensed = sensitivity.abs().amax((-2, -1)) > SENSED
        weights = torch.where(seen & sensed[..., None], weight[..., None] / variance, 0.0)
        return _evidence(sensitivity.flatten(-3, -2), weights.flatten(-2), off.flatten(-2), log_mass)

    def wrench_evidence(
        self,
        felt: Felt,
        wrench: Float[Tensor, "*batch 3"],
        log_mass: Float[Tensor, "*batch variables"],
        camera: Float[Tensor, "*batch 2"],
    ) -> Evidence:
        """From what a force sensor said (N, N m; NaN where it said nothing). camera: see `noise`."""
        said = wrench.isfinite()
        off = torch.where(said, wrench - felt.wrench, 0.0)
        blurred = torch.stack((torch.ones_like(camera[..., 0]), camera[..., 0] / UNIT), -1)
        of_wrench, of_doubt = ((blurred * log.exp()).sum(-1) for log in (self.log_of_wrench, self.log_of_doubt))
        force, doubtful = of_wrench * felt.wrench[..., :2].norm(dim=-1), of_doubt * felt.doubt
        model = force.square() + doubtful.square()
        levers = wrench.new_tensor([1.0, 1.0, WRENCH_LEVER])
        sensor = wrench.new_tensor([FORCE_NOISE, FORCE_NOISE, MOMENT_NOISE])
        variance = model[..., None] * levers.square() + sensor.square() + felt.curvature
        # Forces that contradict what is believed go on to pull, however strongly: all too sure beliefs must give way.
        scaled = (off.square() / variance).sum(-1, keepdim=True) / self.log_freedom.exp()
        weight = self.log_worth_of_wrench.exp() * (1 + scaled).rsqrt()
        return _evidence(felt.sensitivity, torch.where(said, weight / variance, 0.0), off, log_mass)


def usual_noise(step: Float[Tensor, "*batch"], linearized: Linearized) -> Float[Tensor, "*batch bodies"]:
    """Variance of a predicted motion from which the network starts (m^2)."""
    motion = linearized.motion[..., :2].norm(dim=-1)
    return FLOOR**2 + (OF_STEP * step[..., None]).square() + (OF_MOTION * motion).square() + linearized.curvature


def _evidence(
    sensitivity: Float[Tensor, "*batch numbers variables"],
    weights: Float[Tensor, "*batch numbers"],
    off: Float[Tensor, "*batch numbers"],
    log_mass: Float[Tensor, "*batch variables"],
) -> Evidence:
    weighted = (sensitivity * weights[..., None]).transpose(-1, -2)
    target = off + (sensitivity @ log_mass[..., None])[..., 0]
    return Evidence(weighted @ sensitivity, (weighted @ target[..., None])[..., 0])
