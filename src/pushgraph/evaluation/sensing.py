"""What else than poses may be observed, and what may not be known of the table."""

from collections.abc import Sequence

import numpy as np
import torch

from pushgraph.errors import SimulationError
from pushgraph.evaluation.recording import Recording
from pushgraph.graph.scene_batch import SceneBatch
from pushgraph.scene import NOMINAL_TABLE_FRICTION
from pushgraph.simulation.force_sensor import measured_wrench
from pushgraph.simulation.planar import PlanarSimulation
from pushgraph.track import Track


def with_sensor(seen: Recording, tracks: Sequence[Track], rngs: Sequence[np.random.Generator] | None) -> Recording:
    """What a force sensor in the tool says beside, with its noise, unless it was recorded; once a track has ended,
    nothing."""
    frames = seen.bodies.shape[1]
    wrenches = torch.zeros(len(tracks), frames, 3, dtype=torch.float64)
    for k, track in enumerate(tracks):
        if track.wrench is None:
            raise ValueError("a track without wrench cannot be sensed")
        own = (track.wrench if rngs is None else measured_wrench(track.wrench, rngs[k]))[:frames]
        wrenches[k, : len(own)] = torch.from_numpy(own)
    return seen._replace(wrench=wrenches)


def on_table(track: Track, friction: float) -> Track:
    """The same pushes of the same scene on a table of other friction, as far as they can be made there."""
    table = track.scene.table.replace(friction=float(friction))
    simulation = PlanarSimulation(track.scene.replace(table=table, pushes=()))
    for push in track.scene.pushes:
        try:
            simulation.push(push)
        except SimulationError:  # it would come down on a body that went elsewhere
            break
    return simulation.track()


def without_friction(scenes: SceneBatch) -> SceneBatch:
    """The scenes as one sees them who does not know the table's friction."""
    return scenes._replace(
        table_friction=torch.full_like(scenes.table_friction, NOMINAL_TABLE_FRICTION),
        table_friction_known=torch.zeros_like(scenes.table_friction_known),
    )
