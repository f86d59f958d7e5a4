"""What works without the extras, and how those that are missing are named."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pushgraph.cores import usable_cores
from pushgraph.errors import MissingExtraError, PushGraphError
from pushgraph.extras import extra

BLOCK = """
import sys

class Block:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {absent!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Block())
"""
OPTIONAL = (
    *("mujoco", "matplotlib", "PIL", "viser", "pushgraph_baselines", "ray", "Box2D", "pymunk", "rosbags", "pyarrow"),
    *("sklearn", "scipy", "mink", "qpsolvers", "daqp", "gymnasium", "tensorboard"),
)
PREDICTION = """
import numpy as np
import pushgraph as pg

scene = pg.Scene.load({demo!r})
predictor = pg.load()
track = predictor.predict(scene, spread=True)
for name in ("track.h5", "track.csv"):
    track.save(name)
    assert pg.read_recording(name, scene).believed().poses.shape == track.poses.shape
assert track._repr_png_() is None and scene._repr_png_() is None
pushes = np.stack((np.array([[-0.3, 0.0], [-0.3, 0.1]]), np.array([[-0.2, 0.0], [-0.2, 0.1]])), 1)
assert len(predictor.predict_pushes(scene.replace(pushes=()), pushes).poses) == 2
pg.BeliefRegulator, pg.plan, pg.push_to_goal, pg.LeverPredictor, pg.Dataset, pg.WindowSampler, pg.train_physics
"""
PREDICT = "from pushgraph.cli import main; main(['predict', 'demo', '--out', 'predicted'])"
SIMULATE = "from pushgraph.cli import main; main(['simulate', 'demo'])"
MISSING = (
    ("sim", "pg.simulate"),
    ("viewer", "pg.save_picture"),
    ("viewer", "pg.view(wait=False)"),
    ("tensorboard", "from pushgraph.training.recorder import _summary_writer; _summary_writer()"),
    ("baselines", "pg.load('propnet')"),
    ("gym", "import pushgraph.environment"),
    ("cluster", "from pushgraph.dataset.engines import run_on_ray; next(run_on_ray(abs, [1], 1))"),
    ("real", "from pushgraph.evaluation.gaussian_baselines import gaussian_ends as f; f(None, None, None, None)"),
    ("lerobot", "from pushgraph.recording.readers.lerobot import read_parquet; read_parquet(None, None)"),
    ("rosbags", "from pushgraph.recording.readers.bags import read_bag; read_bag(None, None)"),
)


def run_without(absent: tuple[str, ...], code: str, folder: Path) -> subprocess.CompletedProcess:
    """Run code in a process in which these packages are not installed."""
    environment = os.environ | {"COLUMNS": "200"}
    command = [sys.executable, "-c", BLOCK.format(absent=absent) + code]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


def test_prediction_needs_no_extra(tmp_path: Path) -> None:
    demo = str(Path(__file__).parents[1] / "src" / "pushgraph" / "scenes" / "demo.json")
    done = run_without(OPTIONAL, PREDICTION.format(demo=demo) + PREDICT, tmp_path)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "predicted").iterdir()} == {"track.h5", "track.csv"}
    assert "nothing is drawn: drawing needs matplotlib: pip install 'pushgraph[viewer]'" in done.stdout


def test_every_missing_extra_is_named_and_ends_a_command_with_status_1(tmp_path: Path) -> None:
    tries = [
        f"try:\n    {use}\nexcept MissingExtraError as error:\n    print(error)\nelse:\n    print('there', {use!r})\n"
        for _, use in MISSING
    ]
    code = "import pushgraph as pg\nfrom pushgraph.errors import MissingExtraError\n" + "".join(tries)
    done = run_without(OPTIONAL, code + SIMULATE, tmp_path)
    said = done.stdout.splitlines()
    assert said[-1].startswith("Note: nothing is drawn: ")
    for (name, _), line in zip(MISSING, said[:-1], strict=True):
        assert line.endswith(f": pip install 'pushgraph[{name}]'")
    assert done.stderr.strip() == "Error: simulation needs mujoco: pip install 'pushgraph[sim]'"
    assert done.returncode == 1
    assert not list(tmp_path.iterdir())


def test_a_missing_extra_is_an_error_of_ours_and_an_import_error() -> None:
    said = r"flying needs wings: pip install 'pushgraph\[sky\]'"
    with pytest.raises(MissingExtraError, match=said) as raised, extra("sky", "flying"):
        raise ModuleNotFoundError(name="wings")
    assert isinstance(raised.value, PushGraphError)
    assert isinstance(raised.value, ImportError)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no affinity here")
def test_cores_are_counted_by_affinity() -> None:
    allowed = os.sched_getaffinity(0)
    assert usable_cores() == len(allowed)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        assert usable_cores() == 1
    finally:
        os.sched_setaffinity(0, allowed)
