"""The errors of a camera: its noise, found from what it sees, and what it is told to expect beside that.

Bodies at rest are seen about where they rest. Where nothing rests yet, second differences of the poses of all that may
move tell it, too: few bodies change their speed at a time, so their median over bodies is that of noise.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.broad_phase import LEVER

BENT = 6.0
"""Variance of the second difference of a number that is seen with noise in three frames, over that of the noise."""
MEDIAN_OF_TWO, MEDIAN_OF_ONE = 1.386, 0.455
"""Medians of the sums of squares of two standard normal numbers, and of one."""
BENT_COUNT = 6.0
"""What bodies that may move show counts as so many numbers seen at rest."""
FINEST = 5e-5
"""Errors are expected to be this large at least (m), of turns at LEVER: joints give way by about as much."""
UNSEEN_SHARE, MOST_UNSEEN = 1.5, 3e-4
"""A noisy camera has a lens and a calibration, too: errors that do not show as noise are expected to be so many times
as large as noise, but not larger than this (m), of turns at LEVER."""
LEAST_BEND = 1e-12
"""Squares of second differences (m^2, rad^2) are taken for this at least, as they stand in logarithms."""
CONSTANTS = {
    "finest": FINEST,
    "unseen_share": UNSEEN_SHARE,
    "most_unseen": MOST_UNSEEN,
    "bent_count": BENT_COUNT,
    "least_bend": LEAST_BEND,
}
"""What features made of it depend on."""


class CameraNoise(NamedTuple):
    """What was seen of it, positions and then yaws.

    squares: sums over sightings of bodies at rest of how far they were from their mean, of x and y together (m^2) and
    of yaw (rad^2). counts: how many numbers those are of. bends: sums over frames of the logarithms of the median over
    bodies of squared second differences. frames: of so many. camera_error: errors that do not show as noise, of a lens
    or a calibration (m), of turns at LEVER.
    """

    squares: Float[Tensor, "batch 2"]
    counts: Float[Tensor, "batch 2"]
    bends: Float[Tensor, "batch 2"]
    frames: Float[Tensor, "batch 2"]
    camera_error: Float[Tensor, " batch"]

    @classmethod
    def begin(cls, poses: Float[Tensor, "batch bodies 3"], camera_error: float = FINEST) -> "CameraNoise":
        """Before anything is known of it."""
        nothing = poses.new_zeros(len(poses), 2)
        expected = torch.full(poses.shape[:1], camera_error, dtype=torch.float64, device=poses.device)
        return cls(nothing, nothing, nothing, nothing, expected)

    def observe_rest(
        self, away: Float[Tensor, "batch bodies 3"], rested: Float[Tensor, "batch bodies"], yaw_known: Tensor
    ) -> "CameraNoise":
        """One sighting more of bodies at rest. away: from their mean so far. rested: of how many frames that is the
        mean; zero for those that do not rest."""
        # A mean of n frames has itself the n-th part of their variance.
        weight = (rested / (rested + 1))[..., None] * away.square()
        squares = torch.stack((weight[..., :2].sum((1, 2)), (weight[..., 2] * yaw_known).sum(1)), -1)
        rests = (rested > 0).to(away.dtype)
        counts = torch.stack((2 * rests.sum(1), (rests * yaw_known).sum(1)), -1)
        return self._replace(squares=self.squares + squares, counts=self.counts + counts)

    def observe_bends(
        self, bends: Float[Tensor, "batch bodies 3"], moves: Bool[Tensor, "batch bodies"], yaw_known: Tensor
    ) -> "CameraNoise":
        """One frame more of bodies that may move. bends: second differences of their poses. moves: where there are."""
        squares = torch.stack((bends[..., :2].square().sum(-1), bends[..., 2].square()), -1)
        counted = torch.stack((moves, moves & yaw_known), -1)
        median = torch.where(counted, squares, torch.nan).nanquantile(0.5, 1)
        found = median.isfinite()
        logarithm = torch.where(found, median, 1.0).clamp(min=LEAST_BEND).log()
        return self._replace(bends=self.bends + torch.where(found, logarithm, 0.0), frames=self.frames + found)

    def variance(self, spread: Float[Tensor, "batch 2"]) -> Float[Tensor, "batch 2"]:
        """Of either coordinate of a position (m^2), and of a yaw (rad^2): of noise, and of errors that do not show as
        noise: camera_error, or what is expected of a camera with such noise, whichever is more. spread: `spread`."""
        levers, spread = self.camera_error.new_tensor([1.0, LEVER]), spread.double()
        unseen = torch.maximum(self.camera_error[:, None], (UNSEEN_SHARE * spread * levers).clamp(max=MOST_UNSEEN))
        return spread.square() + (unseen / levers).square()

    @property
    def spread(self) -> Float[Tensor, "batch 2"]:
        """Standard deviation of either coordinate of a position (m), and of a yaw (rad); zero before it is known."""
        expected = self.bends.new_tensor([BENT * MEDIAN_OF_TWO, BENT * MEDIAN_OF_ONE])
        bent = (self.bends / self.frames.clamp(min=1)).exp() / expected
        counts = torch.where(self.frames > 0, BENT_COUNT, 0.0)
        return ((self.squares + counts * bent) / (self.counts + counts).clamp(min=1)).sqrt()
