"""Tables of what is believed."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

if TYPE_CHECKING:
    from pushgraph.believed_joint import BelievedJoint
    from pushgraph.believed_mass import BelievedMass
    from pushgraph.scene import Scene

SHOWN, LEAST_ROWS = 0.05, 3
"""The table of joints shows pairs that are joined with at least this probability, and at least so many."""
APART = 1.5
"""Kilograms cannot be told where the interval's ends belong to different classes and are so many times apart."""


def joints_table(title: str, pairs: Sequence[tuple[str, str]], probabilities: np.ndarray) -> Table:
    """Pairs that may be joined, and how many others surely are not."""
    from pushgraph.graph.scene_batch import JOINT_CODES

    table = Table(title=title)
    for name in ("pair", "likeliest", *JOINT_CODES):
        table.add_column(name, justify="left" if name in ("pair", "likeliest") else "right")
    kinds = list(JOINT_CODES)
    joined = 1 - probabilities[:, JOINT_CODES["none"]]
    order = np.argsort(-joined, kind="stable")[: max(LEAST_ROWS, int((joined > SHOWN).sum()))]
    for pair in order.tolist():
        row = probabilities[pair]
        table.add_row(" - ".join(pairs[pair]), kinds[row.argmax()], *(f"{value:.3f}" for value in row))
    table.caption = f"{len(pairs) - len(order)} more pairs are less likely joined than these"
    return table


def places_table(joints: Sequence["BelievedJoint"]) -> Table:
    """Where believed joints sit, and how far they were seen to move."""
    table = Table(title="Believed joints, where they sit now (± one standard deviation)")
    for name in ("joint", "kind", "sits", "was seen to move"):
        table.add_column(name)
    for joint in joints:
        place = reached = ""
        low, high = joint.reached or (0.0, 0.0)
        if joint.anchor is not None:
            x, y = joint.anchor
            place = f"at ({x:.3f}, {y:.3f}) m ± {(joint.anchor_spread or 0.0) * 1e3:.1f} mm"
            reached = f"{np.degrees(low):.1f} to {np.degrees(high):.1f} degrees"
        if joint.axis is not None:
            direction = np.degrees(np.arctan2(*joint.axis[::-1]))
            place = f"along {direction:.1f} ± {np.degrees(joint.axis_spread or 0.0):.1f} degrees"
            reached = f"{1e3 * low:.1f} to {1e3 * high:.1f} mm"
        table.add_row(f"{joint.parent} - {joint.child}", joint.kind, place, reached)
    return table


def masses_table(title: str, masses: Sequence["BelievedMass"], scene: "Scene", sensor: bool) -> Table:
    """What is believed of masses, and in words what that stands on.

    masses: BelievedMass of each body that is weighed, in the scene. sensor: whether a force was measured.
    """
    from pushgraph.mass_prior import class_of

    classes = scene.classes_of_mass
    table = Table(title=title)
    for name in ("body", *(one.name for one in classes), "kg", "slides at (N)", "ratio"):
        table.add_column(name, justify="left" if name == "body" else "right", overflow="fold")
    doubtful = []
    for mass in masses:
        shares = (f"{mass.classes[one.name]:.2f}" for one in classes)
        first = next((name for name in scene.names if name in mass.ratios), None)
        ratio = "alone" if first is None else _interval(mass.ratios[first], f" x {first}")
        table.add_row(mass.body, *shares, _interval(mass.mass), _interval(mass.slide), ratio)
        _, low, high = mass.mass
        if high > APART * low and class_of(classes, low) != class_of(classes, high):
            doubtful.append(mass.body)
    table.caption = f"In brackets: 68 %. Ratio: to the first body it was pushed with. {_footing(scene, sensor)}."
    if doubtful:
        table.caption += f" Kilograms cannot be told yet of {', '.join(doubtful)}: the intervals span classes."
    return table


def _footing(scene: "Scene", sensor: bool) -> str:
    """What kilograms stand on."""
    classes = ", ".join(f"{one.name} {one.lowest:g} to {one.highest:g}" for one in scene.classes_of_mass)
    if not sensor:
        return f"Motion tells ratios of masses only; kilograms follow through the classes: {classes} kg"
    if scene.table.friction is None:
        return (
            "A force sensor tells newtons; the table's friction is unknown, so that kilograms follow through the "
            f"classes: {classes} kg"
        )
    return f"A force sensor tells newtons; kilograms follow from the table's friction, {scene.table.friction:g}"


def _interval(values: tuple[float, float, float], unit: str = "") -> str:
    median, low, high = values
    return f"{_number(median)}{unit}\n({_number(low)}-{_number(high)})"


def _number(value: float) -> str:
    return f"{value:.2f}" if value >= 0.1 else f"{value:.2g}"
