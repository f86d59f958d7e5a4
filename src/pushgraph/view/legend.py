"""What the colours and marks of a drawing mean, and what is known of masses and frictions, as HTML."""

import html
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.adaptation.unknowns import COUNT, Unknowns
from pushgraph.belief_history import BeliefHistory
from pushgraph.lever_scene import LeverScene
from pushgraph.mass_chains import FRICTION, LEVELS
from pushgraph.mass_prior import prior_quantiles
from pushgraph.scene import NOMINAL_MASS, NOMINAL_SIDE_FRICTION, NOMINAL_TABLE_FRICTION, Scene
from pushgraph.view.drawing import SceneDrawing
from pushgraph.view.drawing.colours import BODIES, FORCE, GOAL, JOINTS, PUSH, SPREAD, Colour, darker
from pushgraph.view.drawing.placing import frame_at

MOST_BODIES = 40
LIGHT = 180
"""Colours of which every part is larger stand on a dark ground."""
MARKS = {
    "fixed": "■ fixed joint",
    "revolute": "● hinge, its arc the limits",
    "prismatic": "◆ slider, its rail the limits",
}


def legend(drawing: SceneDrawing) -> str:
    """A line for everything that is shown."""
    scene, rows = drawing.scene, []
    if isinstance(scene, Scene):
        kinds = sorted({joint.kind for joint in scene.joints})
        rows += [(JOINTS[kind], html.escape(MARKS[kind][2:]), MARKS[kind][0]) for kind in kinds]
        if scene.pushes:
            rows.append((PUSH, "pushes, by number; the tool comes down at the foot", "➔"))
    if drawing.track is not None or drawing.outcome is not None:
        rows.append((darker(BODIES[1]), "lines on the table: the ways that bodies and tool go", "~"))
    if drawing.outcome is not None:
        rows.append((darker(BODIES[1]), "translucent: where bodies end", "▢"))
    if drawing.ghost is not None:
        rows.append((darker(BODIES[1]), "translucent, moving: the other track", "▢"))
    if drawing.shows_spread:
        rows.append((SPREAD, "holds the true position with 68 and 95 %", "●"))
    if drawing.newtons:
        rows.append((FORCE, f"force on the tool: 10 cm are {drawing.newtons:.2g} N", "➔"))
    source, newtons = drawing.contact_forces
    if source:
        rows.append((FORCE, f"contact forces ({source}) on the body they lie over: 10 cm are {newtons:.2g} N", "→"))
    if drawing.goal is not None:
        rows.append((GOAL, "the goal", "●"))
    if drawing.history is not None:
        rows += [(JOINTS[kind], f"believed: {kind}", "▬") for kind in JOINTS]
    return "".join(_row(*row) for row in rows)


def facts(scene: Scene | LeverScene, history: BeliefHistory | None = None, time: float = float("inf")) -> str:
    """A table of masses, with what was believed of them at a time (s), and the frictions."""
    if isinstance(scene, LeverScene):
        lines = [(body.name, "fixed" if body.fixed else f"{body.mass:g} kg") for body in scene.bodies]
        frictions = [(body.name, f"friction {body.friction:g}") for body in scene.bodies]
        return _table([*lines, *frictions])
    believed = believed_masses(history, time)
    still = scene.immovable
    rows = []
    assumed = _assumed(NOMINAL_MASS, prior_quantiles(scene.classes_of_mass, np.array(LEVELS[1:])), " kg")
    for body, fixed in list(zip(scene.bodies, still.tolist(), strict=True))[:MOST_BODIES]:
        mass = assumed if body.mass is None else f"{body.mass:.3g} kg"
        rows.append((body.name, "fixed" if fixed else believed.get(body.name, mass)))
    if len(scene.bodies) > MOST_BODIES:
        rows.append(("...", f"{len(scene.bodies) - MOST_BODIES} more"))
    return _table([*rows, *_frictions(scene, history, time)])


def _frictions(scene: Scene, history: BeliefHistory | None, time: float) -> list[tuple[str, str]]:
    """What is known of frictions; where that is nothing, what is assumed, and what is thought possible beforehand."""
    table, sides = scene.table.friction, scene.side_friction
    low, high = FRICTION
    prior = np.array([low + (high - low) * level for level in LEVELS[1:]])
    friction = _assumed(NOMINAL_TABLE_FRICTION, prior) if table is None else f"{table:g}"
    masses = None if history is None else history.mass_history
    if masses is not None and masses.friction is not None:
        median, low, high = masses.friction[frame_at(masses.times, time)].tolist()
        friction = f"{median:.2g} ({low:.2g} to {high:.2g})"
    deviation = np.eye(COUNT)[Unknowns._fields.index("side_friction")]
    prior = np.asarray(Unknowns.of(np.array([-deviation, deviation])).side_friction)
    between = _assumed(NOMINAL_SIDE_FRICTION, prior) if sides is None else f"{sides:g}"
    grain = []
    if scene.table.anisotropy:
        along = f"{scene.table.anisotropy:.0%} more along {math.degrees(scene.table.grain_world) % 180:.0f} degrees"
        grain = [("its grain", along)]
    return [("friction of the table", friction), *grain, ("between bodies", between)]


def _assumed(nominal: float, interval: Float[np.ndarray, "2"], unit: str = "") -> str:
    low, high = interval.tolist()
    return f"{nominal:g}{unit} assumed ({low:.2g} to {high:.2g})"


def believed_masses(history: BeliefHistory | None, time: float) -> dict[str, str]:
    """By body, the median and the interval that holds 68 % at a time (s), and in the end the force that slides it."""
    if history is None or history.mass_history is None:
        return {}
    masses = history.mass_history
    moment = frame_at(masses.times, time)
    over = time >= masses.times[-1]
    found = {}
    for index, body in enumerate(masses.believed):
        median, low, high = masses.quantiles[moment, index].tolist()
        found[body.body] = f"{median:.2g} kg ({low:.2g} to {high:.2g})"
        if over:
            slide, least, most = body.slide
            found[body.body] += f", slides at {slide:.2g} N ({least:.2g} to {most:.2g})"
    return found


def _row(colour: Colour, text: str, mark: str) -> str:
    shade = "#{:02x}{:02x}{:02x}".format(*colour)
    ground = "#777" if min(colour) > LIGHT else "#fff"
    chip = f'<span style="color:{shade};background:{ground};border-radius:3px;padding:0 0.25em">{mark}</span>'
    return f'<div style="margin:0.15em 0">{chip} {text}</div>'


def _table(rows: Sequence[tuple[str, str]]) -> str:
    cells = "".join(
        f'<tr><td style="padding-right:1em">{html.escape(name)}</td><td>{html.escape(value)}</td></tr>'
        for name, value in rows
    )
    return f'<table style="font-size:0.875em">{cells}</table>'
