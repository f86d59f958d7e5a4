"""Forces of the contacts that a prediction solves."""

import numpy as np
import torch

from pushgraph.errors import PredictionError
from pushgraph.forces import NONE, ContactForces, mean_over_frames
from pushgraph.graph.scene_batch import concatenate
from pushgraph.graph.state import Control, State
from pushgraph.network.contract import Advance
from pushgraph.network.dynamics import ContactDynamics
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.scene_parts import in_parts
from pushgraph.track import Track

MOST_STEPS = 512
"""So many steps are solved side by side."""


class _Remembering:
    """Dynamics that keep the steps they were asked for."""

    def __init__(self, dynamics: ContactDynamics) -> None:
        self.LONGEST_STEP = dynamics.LONGEST_STEP
        self._dynamics = dynamics
        self.steps: list[tuple[State, Control]] = []

    def __call__(self, state: State, control: Control) -> Advance:
        """See Dynamics."""
        self.steps.append((state, control))
        return self._dynamics(state, control)


def predict_with_forces(predictor: PhysicsPredictor, scene: Scene) -> tuple[Track, ContactForces]:
    """What `predictor.predict_many([scene])` predicts, and the forces at contacts and joints that make it so.

    The steps of the rollout are solved once more, side by side. Raises PredictionError if the predictor's motions are
    not solved from the laws of contact: then no forces are known.
    """
    if not isinstance(predictor.dynamics, ContactDynamics):
        raise PredictionError("forces are known of predictions by contact alone: other networks predict motions only")
    dynamics = _Remembering(predictor.dynamics)
    track = PhysicsPredictor(dynamics, predictor.record, predictor.hash).predict_many([scene])[0]
    if not dynamics.steps:
        return track, NONE
    found = []
    for begin in range(0, len(dynamics.steps), MOST_STEPS):
        states, controls = zip(*dynamics.steps[begin : begin + MOST_STEPS], strict=True)
        with torch.no_grad():
            solved = predictor.dynamics.forces(concatenate(states), concatenate(controls))
        found.append(solved._replace(scene=solved.scene + begin))
    lengths = np.array([float(torch.as_tensor(control.frames)) for _, control in dynamics.steps])
    frames = np.ceil(np.cumsum(lengths) - 1e-6).astype(int)
    step, first, second, points, forces, joint = (
        torch.cat(columns).cpu().numpy() for columns in zip(*found, strict=True)
    )
    owner = np.append(1 + in_parts(scene).owner, 0)  # -1, the tool, counts from the end
    each = ContactForces(frames[step], owner[first], owner[second], points, forces, joint)
    return track, mean_over_frames(lengths[step], step, each)
