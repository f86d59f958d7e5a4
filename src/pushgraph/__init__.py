"""pushgraph: a learned physics engine for robot pushing.

    import pushgraph as pg

    scene = pg.Scene.load("scene.json")
    track = pg.load().predict(scene)
    track.save("track.h5")

Names are imported when first used, so that `import pushgraph` is quick.
"""

import importlib
from typing import Any

_MODULE_OF = {
    **dict.fromkeys(("RoundedBox", "Contact", "contact_between", "signed_gap"), "pushgraph.contact"),
    **dict.fromkeys(("Cuboid", "Cylinder", "PlacedShape", "Polygon"), "pushgraph.shape"),
    "outline_from_svg": "pushgraph.svg",
    **dict.fromkeys(("MassProperties", "Patch", "mass_properties", "patch_of"), "pushgraph.patch"),
    **dict.fromkeys(("Part", "Push", "Tool"), "pushgraph.tool"),
    **dict.fromkeys(("Body", "Joint"), "pushgraph.body"),
    **dict.fromkeys(("Scene", "Table"), "pushgraph.scene"),
    "Arm": "pushgraph.arm",
    "JointTrajectory": "pushgraph.joint_trajectory",
    **dict.fromkeys(("ArmExecution", "ArmSimulation", "simulate_with_arm"), "pushgraph.simulation.arm"),
    "Track": "pushgraph.track",
    **dict.fromkeys(("Recording", "read_recording"), "pushgraph.recording.recording"),
    **dict.fromkeys(("Declared", "ReadOptions"), "pushgraph.recording.sightings"),
    "Spread": "pushgraph.spread",
    **dict.fromkeys(("assumptions", "remarks"), "pushgraph.plausibility"),
    **dict.fromkeys(("PlanarSimulation", "simulate"), "pushgraph.simulation.planar"),
    **dict.fromkeys(("Camera", "film"), "pushgraph.simulation.camera"),
    "PhysicsPredictor": "pushgraph.physics",
    "BeliefModel": "pushgraph.belief",
    "BeliefRegulator": "pushgraph.regulator",
    "BeliefHistory": "pushgraph.belief_history",
    "plan": "pushgraph.planning.planner",
    "Goal": "pushgraph.planning.goal",
    "Plan": "pushgraph.planning.plan",
    "Sampling": "pushgraph.planning.sampling",
    **dict.fromkeys(("SimulatedEnvironment", "push_to_goal"), "pushgraph.planning.closed_loop"),
    "LeverScene": "pushgraph.lever_scene",
    "LeverTrack": "pushgraph.lever_track",
    "LeverPredictor": "pushgraph.lever_physics",
    "simulate_lever": "pushgraph.simulation.lever",
    "draw_trajectory": "pushgraph.simulation.setups",
    "generate": "pushgraph.dataset.generate",
    "Dataset": "pushgraph.dataset.store",
    **dict.fromkeys(("WindowBatch", "WindowSampler"), "pushgraph.dataset.windows"),
    **dict.fromkeys(("save_picture", "save_comparison"), "pushgraph.viewer.picture"),
    "save_animation": "pushgraph.viewer.animation",
    "PushGraphError": "pushgraph.errors",
}

__all__ = sorted([*_MODULE_OF, "load"])


def load(model: str = "contact", device: str = "cpu", precision: str = "float32") -> Any:
    """Load a predictor: a shipped one (contact, propnet) or a checkpoint; see `PhysicsPredictor.load`."""
    from pushgraph.physics import PhysicsPredictor

    return PhysicsPredictor.load(model, device, precision)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'pushgraph' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return sorted((*globals(), *_MODULE_OF))
