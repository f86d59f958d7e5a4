"""Steps of a rollout: what each of them covers.

A frame in which the tool moves farther than a step may is cut into several; where it goes straight, a step may cover
several frames. Poses in between are interpolated.
"""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.state import Control, controls

LONGEST = 0.0075
"""Where steps are cut by default (m): shorter ones are more exact, and take longer."""
STRAIGHT = 0.02
"""A step's path is at most this much longer than its chord, in shares: else it is no straight line."""


class Steps(NamedTuple):
    """What the tool does in each step, and when steps begin: knots in frames, repeated where a scene has no more.

    tool: where it is planned to be in every frame.
    """

    controls: list[Control]
    knots: Float[Tensor, "batch knots"]
    tool: Float[Tensor, "batch frames 3"]

    def late(self, step: int, lag: Float[Tensor, " batch"]) -> Control:
        """What the tool does in a step if it is late by some frames."""
        start, end = _interpolated(self.tool, self.knots[:, step : step + 2] - lag[:, None]).unbind(1)
        control = self.controls[step]
        return control._replace(pose=start, motion=torch.where(control.down[:, None], end - start, 0.0))

    def tool_at(self, knot: int, lag: Float[Tensor, " batch"]) -> Float[Tensor, "batch 3"]:
        """Where the tool is at a knot if it is late by some frames."""
        return _interpolated(self.tool, (self.knots[:, knot] - lag)[:, None])[:, 0]

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
    longest: float = LONGEST,
    force_limit: Float[Tensor, "batch frames"] | None = None,
) -> Steps:
    """Plan steps that cover up to so many frames each, and up to so much of the tool's way (m)."""
    batch, frames = down.shape
    if frames < 2:
        return Steps([], torch.zeros(batch, 1, dtype=torch.float64, device=tool.device), tool)
    with torch.no_grad():
        all_knots = [
            _knots(path, is_down, radius, frames_per_step, longest)
            for path, is_down, radius in zip(
                tool.detach().cpu().double().numpy(), down.cpu().numpy(), tool_radius.tolist(), strict=True
            )
        ]
        most = max(map(len, all_knots))
        padded = np.stack([np.pad(one, (0, most - len(one)), mode="edge") for one in all_knots])
        knots = torch.from_numpy(padded).to(tool.device)
    rows = torch.arange(batch, device=tool.device)[:, None]
    before = knots.floor().long()
    # The tool is down in a step if it is down in the frames at and around both of its ends.
    is_down = down[rows, before] & down[rows, knots.ceil().long()]
    limits = None if force_limit is None else force_limit[rows, before[:, :-1]]
    return Steps(controls(_interpolated(tool, knots), is_down, knots.diff(dim=1), limits), knots, tool)


def _interpolated(
    tool: Float[Tensor, "batch frames 3"], times: Float[Tensor, "batch times"]
) -> Float[Tensor, "batch times 3"]:
    """Poses at times, in frames."""
    before = times.detach().floor().long().clamp(0, tool.shape[1] - 2)
    rows = torch.arange(len(tool), device=tool.device)[:, None]
    return torch.lerp(tool[rows, before], tool[rows, before + 1], (times - before)[..., None].to(tool.dtype))


def _knots(path: np.ndarray, down: np.ndarray, radius: float, most_frames: int, longest: float) -> np.ndarray:
    """When the steps of one scene begin and end, in frames."""
    change = np.diff(path, axis=0)
    lengths = np.hypot(change[:, 0], change[:, 1]) + radius * np.abs(change[:, 2])
    lengths = lengths * (down[1:] & down[:-1])
    if most_frames == 1 and lengths.max() <= longest:
        return np.arange(len(path), dtype=float)
    knots, frame = [0.0], 0
    while frame < len(lengths):
        if lengths[frame] > longest:
            pieces = int(np.ceil(lengths[frame] / longest))
            knots += (frame + np.arange(1, pieces + 1) / pieces).tolist()
            frame += 1
            continue
        end = frame + 1
        while end < len(lengths) and end - frame < most_frames:
            way = lengths[frame : end + 1].sum()
            if way > longest or not _straight(path, down, way, frame, end + 1, radius):
                break
            end += 1
        knots.append(float(end))
        frame = end
    return np.array(knots)


def _straight(path: np.ndarray, down: np.ndarray, way: float, first: int, last: int, radius: float) -> bool:
    """Whether the tool goes straight from one frame to another, and stays down or lifted."""
    if (down[first : last + 1] != down[first]).any():
        return False
    x, y, turn = path[last] - path[first]
    chord = np.hypot(x, y) + radius * abs(turn)
    return bool(way - chord <= STRAIGHT * way)
