"""How much farther off each joint of a pair is than a camera's noise explains.

Distances stand in standard deviations of what noise alone would give, so that one number means the same whether much or
little was seen, by a good camera or a bad one.
"""

from typing import NamedTuple

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from pushgraph.graph.joint_fit import FIRST_COUNT, RECENT, SLOW, JointFits, RelativeMotion


class Misfit(NamedTuple):
    """How much farther off each joint is than a camera's noise explains: standard deviations of what noise gives.

    fixed_drift, fixed_turn, hinge, slider: of the sums of squares that the fits leave; along_centres: of what a slide
    along the line of centres leaves; tilt: of the angle between the slide and that line. mean_drift, mean_turn: of the
    means since the pair moved; recent_drift, recent_turn, slow_drift, slow_turn: of running means; shift_drift,
    shift_turn: between the slow ones and the means; drift, turn: in the last frame.
    """

    fixed_drift: Float[Tensor, "batch pairs"]
    fixed_turn: Float[Tensor, "batch pairs"]
    hinge: Float[Tensor, "batch pairs"]
    slider: Float[Tensor, "batch pairs"]
    along_centres: Float[Tensor, "batch pairs"]
    tilt: Float[Tensor, "batch pairs"]
    mean_drift: Float[Tensor, "batch pairs"]
    mean_turn: Float[Tensor, "batch pairs"]
    recent_drift: Float[Tensor, "batch pairs"]
    recent_turn: Float[Tensor, "batch pairs"]
    slow_drift: Float[Tensor, "batch pairs"]
    slow_turn: Float[Tensor, "batch pairs"]
    shift_drift: Float[Tensor, "batch pairs"]
    shift_turn: Float[Tensor, "batch pairs"]
    drift: Float[Tensor, "batch pairs"]
    turn: Float[Tensor, "batch pairs"]


def misfit(
    fits: JointFits,
    motion: RelativeMotion,
    resting: Float[Tensor, "batch pairs"],
    drift_noise: Float[Tensor, "batch pairs"],
    turn_noise: Float[Tensor, "batch pairs"],
    centres: Complex[Tensor, "batch pairs"],
) -> Misfit:
    """What a camera's noise does not explain of what was seen before the last frame, and of this.

    fits: to what was seen before. motion: in the last frame. resting: frames that it is the mean of. drift_noise (m),
    turn_noise (rad): standard deviations of either coordinate of the drift, and of the turn, in one frame. centres:
    from a's centre to b's, where the memory began (m).
    """
    noise = torch.stack((drift_noise, turn_noise))
    return Misfit(*_excess_and_tilt(fits, noise, centres), *_shifts(fits, motion, resting, noise))


def _excess_and_tilt(
    fits: JointFits, noise: Float[Tensor, "2 batch pairs"], centres: Complex[Tensor, "batch pairs"]
) -> list[Tensor]:
    """Of the sums of squares that fits leave, and of the angle between the slide and the line of centres."""
    drift_noise, turn_noise = noise
    distance = centres.abs().clamp(min=1e-6)
    line = centres / distance
    moved = fits.frames - FIRST_COUNT
    # The place where the memory began is as sure as the frames that it is the mean of.
    begun = fits.rested - FIRST_COUNT
    whole = fits._replace(frames=fits.frames + begun, turn=fits.turn + begun)
    scatter = fits.square - fits.drift.abs().square() / whole.frames
    spread = whole.frames - whole.turn.abs().square() / whole.frames
    hinge, slider = whole.hinge().residual.square(), whole.slider(line).across.square()
    of_line = (fits.squared - fits.drift.square() / whole.frames) * line.conj().square()
    along, across = ((scatter + sign * of_line.real).clamp(min=0) / 2 for sign in (1, -1))
    left = torch.stack((scatter, spread, hinge * whole.frames, slider * whole.frames, across))
    squares = left / noise[[0, 1, 0, 0, 0]].square()
    free = torch.stack((2 * moved, moved, 2 * moved - 2, moved - 1, moved)).clamp(min=0)
    excess = (squares - free) / (2 * free.clamp(min=1)).sqrt()

    # The slope of across on along, by least squares: a short slide has none, and the line was seen with noise, too.
    of_centres = ((drift_noise / distance).square() + turn_noise.square() / 2) / fits.rested
    unsure = (drift_noise.square() * (along + drift_noise.square()) + of_centres * along.square()).sqrt()
    return [*excess, (of_line.imag / 2).abs() / unsure]


def _shifts(
    fits: JointFits,
    motion: RelativeMotion,
    resting: Float[Tensor, "batch pairs"],
    noise: Float[Tensor, "2 batch pairs"],
) -> Float[Tensor, "shifts batch pairs"]:
    """Of means of the drift and the turn: from where the memory began, and from each other."""
    moved = fits.frames - FIRST_COUNT
    count = moved.clamp(min=1)
    mean_drift, mean_angle = fits.drift / count, (fits.turn - FIRST_COUNT).angle() * (moved > 0)
    # A running mean begins at zero, which its first frames must not count.
    weight = 1 - (1 - 1 / SLOW) ** count
    slow_drift, slow_angle = fits.slow_drift / weight, fits.slow_angle / weight
    drifts = (mean_drift, fits.recent_drift, slow_drift, slow_drift - mean_drift, motion.drift)
    angles = (mean_angle, fits.recent_angle, slow_angle, slow_angle - mean_angle, motion.angle)
    of_recent, of_slow = torch.full_like(count, 2 * RECENT - 1), count.clamp(max=2 * SLOW - 1)
    sightings = torch.stack((count, of_recent, of_slow, of_slow, resting))
    began = torch.stack((fits.rested,) * 3 + (torch.full_like(count, torch.inf), fits.rested))
    sure = noise[:, None] * (1 / sightings + 1 / began).sqrt()
    shifts = torch.stack((torch.stack(drifts).abs(), torch.stack(angles).abs())) / sure
    return shifts.transpose(0, 1).flatten(0, 1)
