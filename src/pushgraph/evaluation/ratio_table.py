"""What a push does to a scene, for every ratio that the masses of its bodies may have: a table, simulated once.

The pusher does not yield, so only ratios of masses matter.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.dataset.engines import run_in_processes
from pushgraph.evaluation.kept import keep, kept
from pushgraph.evaluation.simulation_key import simulation_key
from pushgraph.mass_prior import MassClass, draw_masses
from pushgraph.scene import Scene
from pushgraph.simulation.masses import weighing
from pushgraph.simulation.planar import simulate
from pushgraph.storage import cache_folder

PRIOR_DRAWS = 200_000
"""Masses that are drawn to find which cells of the table the prior reaches."""
TOGETHER = 32
"""Simulations of one task."""


@dataclass(frozen=True, eq=False)
class RatioTable:
    """Poses of bodies in all frames at the nodes of a grid, and between them by multilinear interpolation.

    lowest, spacing: of the nodes' log ratios of mass, those of every body but the first to the first; the same in every
    dimension. poses: rows of [frames * bodies * 3], by node; NaN where no cell is reached. reached: cells (by their
    lowest node) in which some masses of the prior lie.
    """

    lowest: float
    spacing: float
    poses: Float[np.ndarray, "*nodes values"]
    reached: Bool[np.ndarray, "*cells"]

    @property
    def dimensions(self) -> int:
        """Bodies but the first."""
        return self.reached.ndim

    def at(self, log_ratios: Float[np.ndarray, "points dimensions"]) -> Float[np.ndarray, "points values"]:
        """Poses at any log ratios within cells that are reached."""
        cell = np.stack(self.cells_of(log_ratios), -1)
        part = ((log_ratios - self.lowest) / self.spacing - cell).astype(np.float32)
        between = np.zeros((len(cell), self.poses.shape[-1]), np.float32)
        for corner in itertools.product((0, 1), repeat=self.dimensions):
            weight = np.where(corner, part, 1 - part).prod(-1)
            between += weight[:, None] * self.poses[tuple((cell + corner).T)]
        return between

    def cells_of(self, log_ratios: Float[np.ndarray, "points dimensions"]) -> tuple[Int[np.ndarray, " points"], ...]:
        """Indices, by dimension, of the cells that log ratios lie in."""
        cell = np.floor((log_ratios - self.lowest) / self.spacing).astype(np.int64)
        return tuple(cell.clip(0, np.array(self.reached.shape) - 1).T)


def grid_of(classes: Sequence[MassClass], cells: int) -> tuple[float, float, int]:
    """Lowest log ratio that the prior allows, the spacing of so many cells from there to the highest, and the cells."""
    farthest = np.log(max(one.highest for one in classes) / min(one.lowest for one in classes))
    return -float(farthest), 2 * float(farthest) / cells, cells


def reached_cells(classes: Sequence[MassClass], dimensions: int, cells: int) -> Bool[np.ndarray, "*cells"]:
    """Cells of the grid in which masses of the prior lie."""
    lowest, spacing, _ = grid_of(classes, cells)
    masses = draw_masses(np.random.default_rng(0), classes, PRIOR_DRAWS * (1 + dimensions)).reshape(PRIOR_DRAWS, -1)
    cell = np.floor((np.log(masses[:, 1:] / masses[:, :1]) - lowest) / spacing).astype(np.int64)
    reached = np.zeros((cells,) * dimensions, dtype=bool)
    reached[tuple(cell.clip(0, cells - 1).T)] = True
    return reached


def fill(
    poses_of: Callable[[Float[np.ndarray, "points dimensions"]], Float[np.ndarray, "points values"]],
    classes: Sequence[MassClass],
    dimensions: int,
    cells: int,
    known: RatioTable | None = None,
) -> RatioTable:
    """A table of so many cells in each dimension; `known`, of half as many, need not be computed again."""
    lowest, spacing, _ = grid_of(classes, cells)
    reached = reached_cells(classes, dimensions, cells)
    missing = np.zeros((cells + 1,) * dimensions, dtype=bool)
    for corner in itertools.product((0, 1), repeat=dimensions):
        missing[tuple(slice(start, start + cells) for start in corner)] |= reached
    poses = None
    if known is not None:
        every_other = (slice(None, None, 2),) * dimensions
        poses = np.full((*missing.shape, known.poses.shape[-1]), np.nan, np.float32)
        poses[every_other] = known.poses
        missing &= np.isnan(poses[..., 0])
    nodes: Int[np.ndarray, "points dimensions"] = np.argwhere(missing)
    computed = poses_of(lowest + spacing * nodes)
    if poses is None:
        poses = np.full((*missing.shape, computed.shape[-1]), np.nan, np.float32)
    poses[missing] = computed
    return RatioTable(lowest, spacing, poses, reached)


def simulated_table(
    scene: Scene,
    cells: int,
    known: RatioTable | None = None,
    workers: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> RatioTable:
    """The table of a scene and its pushes; kept in the user's cache, so that it is simulated only once.

    progress: told how many simulations of how many are done.
    """
    classes, dimensions = scene.classes_of_mass, len(scene.bodies) - 1
    key = simulation_key(weighing(scene, [1.0] * len(scene.bodies)).to_json(), repr(classes))
    path, stands_for = cache_folder() / "mass_ratios" / f"{key}-{cells}.npz", f"{key} {cells}"
    if (found := kept(path, stands_for)) is not None:
        lowest, spacing, _ = grid_of(classes, cells)
        return RatioTable(lowest, spacing, found["poses"], reached_cells(classes, dimensions, cells))

    def poses_of(log_ratios: np.ndarray) -> np.ndarray:
        tasks = [(scene, tuple(map(tuple, some))) for some in _chunks(log_ratios.tolist())]
        done, found = 0, {}
        for task, poses in run_in_processes(_simulate_ratios, tasks, min(workers, len(tasks))):
            found[task[1]] = poses
            done += len(poses)
            progress(done, len(log_ratios))
        return np.concatenate([found[some] for _, some in tasks])

    table = fill(poses_of, classes, dimensions, cells, known)
    keep(path, stands_for, {"poses": table.poses})
    return table


def _simulate_ratios(task: tuple[Scene, tuple[tuple[float, ...], ...]]) -> Float[np.ndarray, "points values"]:
    scene, several = task
    tracks = [simulate(weighing(scene, np.exp([0.0, *log_ratios]))) for log_ratios in several]
    return np.stack([track.poses[:, 1:].astype(np.float32).ravel() for track in tracks])


def _chunks(points: list) -> list[list]:
    return [points[k : k + TOGETHER] for k in range(0, len(points), TOGETHER)]
