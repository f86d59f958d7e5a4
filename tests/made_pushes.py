"""Recorded pushes that were made by prediction with known unknowns, as files."""

import json
from pathlib import Path

import numpy as np

from pushgraph import pose
from pushgraph.adaptation.prediction import predicted_motion
from pushgraph.adaptation.unknowns import NOMINAL, Unknowns
from pushgraph.physics import PhysicsPredictor
from pushgraph.real_pushes import COLUMNS, RealPushes, read_pushes

OUTLINES = {
    "disc": {"ellipse": [0.1, 0.1]},
    "box": {"polygon": [[0.06, 0.04], [-0.06, 0.04], [-0.06, -0.04], [0.06, -0.04]]},
}
RADIUS = 0.00475


def rows_of(count: int, shape: str, seed: int = 0, surface: str = "abs") -> list[dict[str, str | float]]:
    """Pushes from all sides towards near the centre, none moved yet."""
    rng = np.random.default_rng(seed)
    angle, aside, turn = rng.uniform(-3, 3, count), rng.uniform(-0.025, 0.025, count), rng.uniform(-3, 3, count)
    heading = angle + np.pi
    out = np.stack((np.cos(angle), np.sin(angle)), -1)
    beside = np.stack((-out[:, 1], out[:, 0]), -1)
    start = 0.085 * out + aside[:, None] * beside
    end = start + rng.uniform(0.03, 0.06, count)[:, None] * np.stack((np.cos(heading), np.sin(heading)), -1)
    where = np.concatenate((rng.uniform(-0.1, 0.1, (count, 2)), turn[:, None]), 1)
    start, end = pose.transform(where, start), pose.transform(where, end)
    numbers = np.concatenate((np.full((count, 1), 20.0), where, where, start, end), 1)
    return [dict(zip(COLUMNS, (surface, shape, *row), strict=True)) for row in numbers.tolist()]


def write(folder: Path, rows: list[dict[str, str | float]], outlines: object = OUTLINES) -> tuple[Path, Path]:
    """Write pushes and outlines."""
    data, described = folder / "pushes.csv", folder / "outlines.json"
    data.write_text("\n".join(",".join(str(v) for v in line) for line in (rows[0], *(row.values() for row in rows))))
    described.write_text(json.dumps(outlines))
    return data, described


def made(folder: Path, counts: dict[str, int], unknowns: Unknowns = NOMINAL, noise: float = 0.0) -> tuple[Path, Path]:
    """Files of pushes that end where prediction with these unknowns ends, but for noise (m; ten times in rad)."""
    rows = [row for k, (shape, count) in enumerate(counts.items()) for row in rows_of(count, shape, seed=k)]
    pushes = read_pushes(*write(folder, rows))
    for row, after in zip(rows, ends_of(pushes, unknowns, noise).tolist(), strict=True):
        row |= dict(zip(("x1", "y1", "yaw1"), after, strict=True))
    return write(folder, rows)


def ends_of(pushes: RealPushes, unknowns: Unknowns, noise: float = 0.0) -> np.ndarray:
    """Where pushes end."""
    motion = predicted_motion(PhysicsPredictor.load().dynamics, pushes, unknowns)
    motion += np.random.default_rng(9).normal(size=motion.shape) * noise * np.array([1, 1, 10])
    return pose.compose(pushes.before, motion)
