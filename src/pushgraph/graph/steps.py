"""Steps of a rollout: what each of them covers.

Where the tool goes straight, a step may cover several frames, as long as it moves at most LONGEST in it; a frame in
which it moves farther is cut into several steps. Poses in between are interpolated.
"""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.state import Control, controls

LONGEST = 0.025
"""No point of the tool moves farther in one step (m)."""
STRAIGHT = 0.02
"""A step's path is at most this much longer than its chord, in shares: else it is no straight line."""


class Steps(NamedTuple):
    """What the tool does in each step, and when steps begin: knots in frames, repeated where a scene has no more."""

    controls: list[Control]
    knots: Float[Tensor, "batch knots"]

    def at_frames(
        self, poses: Float[Tensor, "batch knots bodies 3"], frames: int
    ) -> Float[Tensor, "batch frames bodies 3"]:
        """Poses in every frame, from those at the knots."""
        batch, knots = self.knots.shape
        whole = torch.arange(frames, dtype=self.knots.dtype, device=self.knots.device)
        if knots == frames and torch.equal(self.knots, whole.expand_as(self.knots)):
            return poses
        whole = whole.expand(batch, -1).contiguous()
        after = torch.searchsorted(self.knots.contiguous(), whole).clamp(1, knots - 1)
        times = [self.knots.gather(1, index) for index in (after - 1, after)]
        share = ((whole - times[0]) / (times[1] - times[0]).clamp(min=1e-9)).clamp(0, 1)[..., None, None]
        rows = torch.arange(batch, device=poses.device)[:, None]
        return torch.lerp(poses[rows, after - 1], poses[rows, after], share.to(poses.dtype))


def plan_steps(
    tool: Float[Tensor, "batch frames 3"],
    down: Bool[Tensor, "batch frames"],
    tool_radius: Float[Tensor, " batch"],
    frames_per_step: int = 1,
) -> Steps:
    """Plan steps that cover up to so many frames each."""
    batch, frames = down.shape
    if frames < 2:
        return Steps([], torch.zeros(batch, 1, dtype=torch.float64, device=tool.device))
    with torch.no_grad():
        all_knots = [
            _knots(path, is_down, radius, frames_per_step)
            for path, is_down, radius in zip(
                tool.detach().cpu().double().numpy(), down.cpu().numpy(), tool_radius.tolist(), strict=True
            )
        ]
        most = max(map(len, all_knots))
        knots = np.stack([np.pad(one, (0, most - len(one)), mode="edge") for one in all_knots])
        knots = torch.from_numpy(knots).to(tool.device)
    before = knots.floor().long().clamp(max=frames - 2)
    rows = torch.arange(batch, device=tool.device)[:, None]
    share = (knots - before)[..., None].to(tool.dtype)
    poses = torch.lerp(tool[rows, before], tool[rows, before + 1], share)
    # The tool is down in a step if it is down in the frames at and around both of its ends.
    ends = [down[rows, index] for index in (knots.floor().long(), knots.ceil().long())]
    return Steps(controls(poses, ends[0] & ends[1], knots.diff(dim=1)), knots)


def _knots(path: np.ndarray, down: np.ndarray, radius: float, longest: int) -> np.ndarray:
    """When the steps of one scene begin and end, in frames."""
    change = np.diff(path, axis=0)
    lengths = np.hypot(change[:, 0], change[:, 1]) + radius * np.abs(change[:, 2])
    lengths = lengths * (down[1:] & down[:-1])
    if longest == 1 and lengths.max() <= LONGEST:
        return np.arange(len(path), dtype=float)
    knots, frame = [0.0], 0
    while frame < len(lengths):
        if lengths[frame] > LONGEST:
            pieces = int(np.ceil(lengths[frame] / LONGEST))
            knots += (frame + np.arange(1, pieces + 1) / pieces).tolist()
            frame += 1
            continue
        end = frame + 1
        while end < len(lengths) and end - frame < longest and _one_step(path, down, lengths, frame, end + 1, radius):
            end += 1
        knots.append(float(end))
        frame = end
    return np.array(knots)


def _one_step(
    path: np.ndarray, down: np.ndarray, lengths: np.ndarray, first: int, last: int, radius: float
) -> bool:
    """Whether one step may lead from one frame to another."""
    if down[first] != down[last] or (down[first : last + 1] != down[first]).any():
        return False
    way = lengths[first:last].sum()
    x, y, turn = path[last] - path[first]
    chord = np.hypot(x, y) + radius * abs(turn)
    return bool(way <= LONGEST and way - chord <= STRAIGHT * way)
