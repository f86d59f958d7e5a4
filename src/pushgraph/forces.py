"""Forces where the bodies of a track, and its tool, touch or are joined."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Forces at points, on average since the frame before.

    frame: of the track, from low to high. first, second: nodes of the track, 0 being the tool. points: world (m).
    forces: what the second node bears (N, world frame); the first bears the opposite. joint: whether the two are joined
    there, rather than touch. Of bodies that fixed joints or rigid groups make one, forces between them are not known.
    """

    frame: Int[np.ndarray, " points"]
    first: Int[np.ndarray, " points"]
    second: Int[np.ndarray, " points"]
    points: Float[np.ndarray, "points 2"]
    forces: Float[np.ndarray, "points 2"]
    joint: Bool[np.ndarray, " points"]

    def at(self, frame: int) -> "ContactForces":
        """Those of one frame."""
        rows = slice(*np.searchsorted(self.frame, [frame, frame + 1]))
        fields = (self.frame, self.first, self.second, self.points, self.forces, self.joint)
        return ContactForces(*(values[rows] for values in fields))

    def on(self, node: int, frames: int) -> Float[np.ndarray, "frames 2"]:
        """What a node bears in all in each frame (N), of a track of so many frames."""
        total = np.zeros((frames, 2))
        for ends, sign in ((self.second, 1.0), (self.first, -1.0)):
            rows = ends == node
            np.add.at(total, self.frame[rows], sign * self.forces[rows])
        return total


_NOBODY = np.zeros(0, dtype=int)
NONE = ContactForces(_NOBODY, _NOBODY, _NOBODY, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, dtype=bool))
"""Where nothing touches."""


def mean_over_frames(
    share: Float[np.ndarray, " points"], step: Int[np.ndarray, " points"], forces: ContactForces
) -> ContactForces:
    """Of forces in steps, each a share of its frame long, those of the frames.

    step: which of all steps. Points of the same two nodes belong together in the order in which they stand; a force is
    added up over the frame, and stands where its point was on average.
    """
    pair = np.stack((step, forces.first, forces.second, forces.joint), 1)
    number = _count_before(pair)
    keys, place = np.unique(np.column_stack((forces.frame, pair[:, 1:], number)), axis=0, return_inverse=True)
    place = place.reshape(-1)

    def summed(values: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "kept 2"]:
        total = np.zeros((len(keys), 2))
        np.add.at(total, place, values)
        return total

    count = np.bincount(place, minlength=len(keys))[:, None]
    frame, first, second, joint, _ = keys.T
    points = summed(forces.points) / np.maximum(count, 1)
    return ContactForces(frame, first, second, points, summed(forces.forces * share[:, None]), joint.astype(bool))


def _count_before(rows: Int[np.ndarray, "points columns"]) -> Int[np.ndarray, " points"]:
    """For each row, how many before it are equal."""
    _, group = np.unique(rows, axis=0, return_inverse=True)
    group = group.reshape(-1)
    order = np.argsort(group, kind="stable")
    begin = np.searchsorted(group[order], group[order])
    number = np.empty(len(group), dtype=int)
    number[order] = np.arange(len(group)) - begin
    return number
