"""How every pair of bodies has moved relative to each other, summed up in constant memory, and which joint that fits.

Planar vectors are complex numbers here: to turn is to multiply. Of a pair a < b, with the anchors and yaw offset of its
memory (see `Relations`), t is by how much b has turned relative to a, and d how far the two anchors have drifted apart,
in the frame of a. Then

    fixed:      d = 0, t = 0
    prismatic:  t = 0, d on a line
    revolute:   d = u - exp(i t) v    about the point u off a's anchor, and v off b's, both in the frame of a

The revolute fit is linear least squares in u and v; all three need no more than the sums of `JointFits`.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.scene_batch import Relations, pairs_of
from pushgraph.pose import as_complex

FIRST_COUNT = 4.0
"""The place where the memory began counts as so many frames: it is the mean of what was seen before contact."""
MEASURED = 1e-3
"""Standard deviation of the drift in a frame (m) that is expected of a camera."""
ANCHOR_SPREAD = 0.05
"""Before anything is seen, a hinge sits about so far from the middle of where its bodies face each other (m)."""
AXIS_PULL = 0.002
"""Sliders are taken to slide along the line of centres until the drift has spread by about this much (m)."""
RIDGE = (MEASURED / ANCHOR_SPREAD) ** 2
RECENT, SLOW = 6.0, 24.0
"""Recent motion is a running mean: the last frame counts as one of so many; of the slower one, as one of these."""
CONSTANTS = {
    "first_count": FIRST_COUNT,
    "measured": MEASURED,
    "anchor_spread": ANCHOR_SPREAD,
    "axis_pull": AXIS_PULL,
    "recent": RECENT,
    "slow": SLOW,
}
"""What features made of fits depend on."""


def turning(angle: Float[Tensor, "*batch"]) -> Complex[Tensor, "*batch"]:
    """The complex numbers that turn vectors by an angle (rad); see `as_complex`."""
    return torch.polar(torch.ones_like(angle), angle)


class RelativeMotion(NamedTuple):
    """drift: d (m). turn: exp(i t). angle: t (rad)."""

    drift: Complex[Tensor, "batch pairs"]
    turn: Complex[Tensor, "batch pairs"]
    angle: Float[Tensor, "batch pairs"]

    @classmethod
    def of(cls, relations: Relations, poses: Float[Tensor, "batch bodies 3"]) -> "RelativeMotion":
        """Of all pairs; it means something where the memory has begun."""
        a, b = pairs_of(poses.shape[1], poses.device)
        poses = poses.double()
        position, yaw = as_complex(poses[..., :2]), poses[..., 2]
        turned_a = turning(-yaw[:, a])
        turned = turning(yaw[:, b]) * turned_a
        apart = (position[:, b] - position[:, a]) * turned_a
        drift = apart + turned * as_complex(relations.anchor_b.double()) - as_complex(relations.anchor_a.double())
        turn = turned * turning(-relations.yaw_offset.double())
        return cls(drift, turn, turn.angle())


class HingeFit(NamedTuple):
    """The revolute joint that fits best. anchor_a, anchor_b: u and v, in the frame of a (m). residual: root mean
    squared drift that is left (m). spread: standard deviation of the anchor in either direction (m)."""

    anchor_a: Complex[Tensor, "batch pairs"]
    anchor_b: Complex[Tensor, "batch pairs"]
    residual: Float[Tensor, "batch pairs"]
    spread: Float[Tensor, "batch pairs"]

    def deviation(self, motion: RelativeMotion) -> Complex[Tensor, "batch pairs"]:
        """How far the two anchors of the fit are apart (m), in the frame of a."""
        return motion.drift - self.anchor_a + motion.turn * self.anchor_b


class SliderFit(NamedTuple):
    """The line that fits the drift best. centre: mean drift (m). axis: unit vector. along, across: root mean squared
    drift (m) along it and across. All in the frame of a."""

    centre: Complex[Tensor, "batch pairs"]
    axis: Complex[Tensor, "batch pairs"]
    along: Float[Tensor, "batch pairs"]
    across: Float[Tensor, "batch pairs"]

    def deviation(self, motion: RelativeMotion) -> Float[Tensor, "batch pairs"]:
        """How far off the line the drift is (m)."""
        return ((motion.drift - self.centre) * self.axis.conj()).imag


class JointFits(NamedTuple):
    """Sums over the frames in which either body of a pair moved.

    frames: how many. turn: of exp(i t). drift: of d. turned_back: of exp(-i t) d. squared: of d^2. square: of |d|^2.
    lowest_turn, highest_turn: of t (rad). first_drift, last_drift: the two d that are farthest apart along the line.
    rested: frames that the place where the memory began is the mean of. recent_drift, recent_angle, slow_drift,
    slow_angle: running means of d and t (rad).
    """

    frames: Float[Tensor, "batch pairs"]
    turn: Complex[Tensor, "batch pairs"]
    drift: Complex[Tensor, "batch pairs"]
    turned_back: Complex[Tensor, "batch pairs"]
    squared: Complex[Tensor, "batch pairs"]
    square: Float[Tensor, "batch pairs"]
    lowest_turn: Float[Tensor, "batch pairs"]
    highest_turn: Float[Tensor, "batch pairs"]
    first_drift: Complex[Tensor, "batch pairs"]
    last_drift: Complex[Tensor, "batch pairs"]
    rested: Float[Tensor, "batch pairs"]
    recent_drift: Complex[Tensor, "batch pairs"]
    recent_angle: Float[Tensor, "batch pairs"]
    slow_drift: Complex[Tensor, "batch pairs"]
    slow_angle: Float[Tensor, "batch pairs"]

    @classmethod
    def begin(cls, pairs: Bool[Tensor, "batch pairs"]) -> "JointFits":
        """Of pairs that have not moved; only the shape of `pairs` matters."""
        none = torch.zeros(pairs.shape, dtype=torch.float64, device=pairs.device)
        first = torch.full_like(none, FIRST_COUNT)
        nowhere, one = none.to(torch.complex128), torch.ones_like(none)
        return cls(
            *(first, first + nowhere, nowhere, nowhere, nowhere, none, none, none, nowhere, nowhere),
            *(one, nowhere, none, nowhere, none),
        )

    def observe(self, motion: RelativeMotion, moved: Bool[Tensor, "batch pairs"]) -> "JointFits":
        """One frame more of the pairs that moved."""
        on = moved.double()
        drift = torch.where(moved, motion.drift, 0.0)
        count, turn = self.frames + on, self.turn + on * motion.turn
        total, back = self.drift + drift, self.turned_back + motion.turn.conj() * drift
        squared, square = self.squared + drift * drift, self.square + drift.abs().square()
        axis = _axis(squared - total * total / count)
        place, first, last = ((some * axis.conj()).real for some in (motion.drift, self.first_drift, self.last_drift))
        # The axis has no sign: as it turns round, so do the ends.
        low, high = torch.where(first <= last, first, last), torch.where(first <= last, last, first)
        first_drift = torch.where(first <= last, self.first_drift, self.last_drift)
        last_drift = torch.where(first <= last, self.last_drift, self.first_drift)
        return JointFits(
            count,
            turn,
            total,
            back,
            squared,
            square,
            torch.where(moved, torch.minimum(self.lowest_turn, motion.angle), self.lowest_turn),
            torch.where(moved, torch.maximum(self.highest_turn, motion.angle), self.highest_turn),
            torch.where(moved & (place < low), motion.drift, first_drift),
            torch.where(moved & (place > high), motion.drift, last_drift),
            self.rested,
            self.recent_drift + on * (motion.drift - self.recent_drift) / RECENT,
            self.recent_angle + on * (motion.angle - self.recent_angle) / RECENT,
            self.slow_drift + on * (motion.drift - self.slow_drift) / SLOW,
            self.slow_angle + on * (motion.angle - self.slow_angle) / SLOW,
        )

    @property
    def turn_spread(self) -> Float[Tensor, "batch pairs"]:
        """Standard deviation of the turn (rad), of small turns."""
        return (1 - (self.turn.abs() / self.frames).square()).clamp(min=0).sqrt()

    @property
    def drift_spread(self) -> Float[Tensor, "batch pairs"]:
        """Root mean squared drift from where the memory began (m)."""
        return (self.square / self.frames).sqrt()

    def hinge(self) -> HingeFit:
        """The revolute joint that fits best, by least squares with ANCHOR_SPREAD as the prior."""
        count, length = self.frames + RIDGE, self.turn.abs()
        determinant = count.square() - length.square()
        anchor_a = (count * self.drift - self.turn * self.turned_back) / determinant
        anchor_b = (self.turn.conj() * self.drift - count * self.turned_back) / determinant
        explained = (self.drift.conj() * anchor_a - self.turned_back.conj() * anchor_b).real
        prior = RIDGE * (anchor_a.abs().square() + anchor_b.abs().square())
        residual = ((self.square - explained - prior).clamp(min=0) / self.frames).sqrt()
        # Half of it in either direction, and half since the mean of both anchors is the anchor.
        information = 4 * (count - length)
        return HingeFit(anchor_a, anchor_b, residual, residual.clamp(min=MEASURED) / information.sqrt())

    def slider(self, line: Complex[Tensor, "batch pairs"]) -> SliderFit:
        """The line that fits the drift best. line: unit vector that it is taken to have until more than AXIS_PULL is
        seen."""
        centre = self.drift / self.frames
        scatter = self.squared / self.frames - centre * centre
        size = (self.square / self.frames - centre.abs().square()).clamp(min=0)
        axis = _axis(scatter + (AXIS_PULL * line).square())
        elongation = (scatter * axis.conj().square()).real
        along, across = ((size + sign * elongation).clamp(min=0).div(2).sqrt() for sign in (1, -1))
        return SliderFit(centre, axis, along, across)

    @property
    def turn_range(self) -> Float[Tensor, "batch pairs"]:
        """How far the pair has turned to and fro, at LEVER (m)."""
        return (self.highest_turn - self.lowest_turn) * LEVER


def _axis(scatter: Complex[Tensor, "batch pairs"]) -> Complex[Tensor, "batch pairs"]:
    """Unit vector of the greater principal axis of a scatter, given as its sum of squares."""
    return turning(scatter.angle() / 2)
