"""Rollouts side by side that begin alike are predicted once, until they part."""

from collections.abc import Hashable, Sequence

import numpy as np
import torch
from jaxtyping import Int
from torch import Tensor

from pushgraph.graph.state import Control, State
from pushgraph.network.contract import Advance, Dynamics


class OnceWhileAlike:
    """Dynamics of one rollout of many scenes that predict those once which start alike, while their tools move alike.

    scenes: rows of the batch with equal ones start alike.
    """

    def __init__(self, dynamics: Dynamics, scenes: Sequence[Hashable]) -> None:
        number: dict[Hashable, int] = {}
        self.LONGEST_STEP = dynamics.LONGEST_STEP
        self._dynamics = dynamics
        self._rollout = np.array([number.setdefault(scene, len(number)) for scene in scenes])
        """Which of those that differ each row belongs to."""
        self._first: Int[Tensor, " different"] | None = None
        self._state: State | None = None

    def __call__(self, state: State, control: Control) -> Advance:
        """See Dynamics; to be called with the steps of the rollout in order."""
        single = (control.down, control.frames, control.last_frames, control.force_limit)
        columns = [
            column.detach().double().cpu().numpy() for column in (control.pose, control.motion, control.last_motion)
        ]
        columns += [np.broadcast_to(np.asarray(torch.as_tensor(one)), len(self._rollout))[:, None] for one in single]
        rows = np.concatenate((self._rollout[:, None], *columns), 1)
        _, first, self._rollout = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        if len(first) == len(rows):
            return self._dynamics(state, control)
        if self._state is None or self._first is None or len(first) > len(self._first):
            self._first = torch.from_numpy(first).to(state.poses.device)
            self._state = state.take(self._first)
        alike = self._state._replace(
            poses=state.poses[self._first],
            motions=state.motions[self._first],
            relations=state.relations.take(self._first),
        )
        motion, done = self._dynamics(alike, control.take(self._first))
        rollout = torch.from_numpy(self._rollout).to(motion.device)
        return Advance(motion[rollout], done[rollout])
