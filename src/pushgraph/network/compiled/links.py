"""Pairs that may share an edge however far apart their bodies are."""

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.graph.broad_phase import SLIDER_GAP
from pushgraph.network.compiled.jit import compiled


@compiled
def pair_of(a: int, b: int, bodies: int) -> int:
    """Where the pair of two bodies stands in `pairs_of`."""
    if a > b:
        a, b = b, a
    return a * bodies - a * (a + 1) // 2 + b - a - 1


@compiled
def links_of(
    kind: Int[np.ndarray, "batch pairs"],
    known: Bool[np.ndarray, "batch pairs"],
    remembered: Bool[np.ndarray, "batch pairs"],
    bodies: int,
) -> tuple[Int[np.ndarray, " begins"], Int[np.ndarray, " links"], Float[np.ndarray, " links"]]:
    """Where the links of each body of each scene begin, their other ends, and up to which gap they hold (m)."""
    batch = len(kind)
    begin = np.zeros(batch * bodies + 1, np.int64)
    body, keep = np.empty(batch * bodies * (bodies - 1), np.int64), np.empty(batch * bodies * (bodies - 1))
    count = 0
    for scene in range(batch):
        for here in range(bodies):
            for away in range(1, bodies):
                there = (here + away) % bodies
                pair = pair_of(here, there, bodies)
                gap = keep_of(kind[scene, pair], known[scene, pair], remembered[scene, pair])
                if gap > 0.0:
                    body[count], keep[count] = there, gap
                    count += 1
            begin[scene * bodies + here + 1] = count
    return begin, body[:count], keep[:count]


@compiled
def keep_of(kind: int, known: bool, remembered: bool) -> float:
    """Gap (m) up to which a pair belongs together whatever the step."""
    if kind > 0:
        return math.inf
    if remembered and not known:
        return SLIDER_GAP
    return -math.inf
