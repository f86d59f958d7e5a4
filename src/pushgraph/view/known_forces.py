"""The forces at the contacts of a track, where it can be told how they came about."""

import contextlib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pushgraph.errors import PredictionError, PushGraphError
from pushgraph.forces import ContactForces
from pushgraph.physics import PhysicsPredictor
from pushgraph.predicted_forces import predict_with_forces
from pushgraph.scene import Scene
from pushgraph.simulation.sensed_forces import simulate_with_forces
from pushgraph.track import Track

SAME = 1e-5
"""Poses that differ by less than this (m, rad) are of the same track."""


class KnownForces(NamedTuple):
    """source: how they are known: "predicted" or "simulated"."""

    source: str
    forces: ContactForces


def forces_of(track: Track, predictor: PhysicsPredictor, believed: Sequence[Scene] = ()) -> KnownForces:
    """Those of a track that is what its scene is predicted or simulated to do; believed: other scenes to predict.

    Tracks hold no forces, so they are computed anew, and the poses compared. Raises PredictionError if the track came
    about in another way.
    """
    for source, again, forces in _made_anew(track, predictor, believed):
        if again.poses.shape == track.poses.shape and np.allclose(again.poses, track.poses, rtol=0, atol=SAME):
            return KnownForces(source, forces)
    raise PredictionError(
        "contact forces: known of tracks that are as their scene is predicted or simulated now, and this one is neither"
    )


def _made_anew(
    track: Track, predictor: PhysicsPredictor, believed: Sequence[Scene]
) -> Iterator[tuple[str, Track, ContactForces]]:
    for scene in (track.scene, *believed):
        with contextlib.suppress(PushGraphError):
            yield "predicted", *predict_with_forces(predictor, scene)
    with contextlib.suppress(PushGraphError):
        yield "simulated", *simulate_with_forces(track.scene.with_nominal_values())
