"""Kinds of outlines: what was learnt of some shapes serves others of their kind."""

from typing import Literal

from pushgraph.adaptation.pressure import corners_of
from pushgraph.shape import BodyShape

Kind = Literal["cornered", "round"]


def kind_of(shape: BodyShape) -> Kind:
    """Whether an outline has corners."""
    return "cornered" if len(corners_of(shape)) else "round"
