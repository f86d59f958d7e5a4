"""Kinds of outlines: what was learnt of some shapes serves others of their kind."""

from typing import Literal

import numpy as np

from pushgraph.outline import CORNER
from pushgraph.real_pushes import outline_of
from pushgraph.shape import BodyShape

Kind = Literal["cornered", "round"]


def kind_of(shape: BodyShape) -> Kind:
    """Whether an outline has corners."""
    edges = np.diff(outline_of(shape), axis=0, append=outline_of(shape)[:1])
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    turns = np.abs(np.angle(np.exp(1j * (np.roll(heading, -1) - heading))))
    return "cornered" if turns.max() > CORNER else "round"
