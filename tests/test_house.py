"""Data flows one way: no module imports one that comes after it."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "pushgraph"
ORDER = [
    "errors",
    "extras",
    "cores",
    "device",
    "own_modules",
    "written_number",
    "checksum",
    "storage",
    "stored_array",
    "arrays",
    "array_input",
    "isolation",
    "notebook",
    "record",
    "json_file",
    "tensor_file",
    "mass_prior",
    "pose",
    "pose_3d",
    "contact_axes",
    "contact_patch",
    "contact_3d",
    "contact",
    "outline",
    "shape",
    "svg",
    "tool",
    "arm",
    "joint_trajectory",
    "real_pushes",
    "body",
    "patch",
    "parts",
    "scene_file",
    "scene",
    "scene_at",
    "parting",
    "lever_scene",
    "scene_parts",
    "scene_range",
    "spread",
    "wrench",
    "forces",
    "track_frames",
    "track_hdf5",
    "track_csv",
    "track_resampling",
    "track",
    "lever_track",
    "plausibility",
    "recording",
    "simulation",
    "dataset",
    "graph",
    "network",
    "checkpoint",
    "spread_model",
    "push_batch",
    "precision",
    "rollout",
    "joint_doubt",
    "physics",
    "predicted_forces",
    "adaptation",
    "lever_physics",
    "mass_chains",
    "joint_answers",
    "mass_memory",
    "belief",
    "believed_joint",
    "believed_mass",
    "mass_history",
    "belief_file",
    "regulator",
    "belief_history",
    "planning",
    "training",
    "evaluation",
    "viewer",
    "environment",
    "view",
    "report",
    "cli",
]


def imported_rooms(path: Path) -> set[str]:
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "pushgraph":
            parts = node.module.split(".")
            rooms |= {parts[1]} if len(parts) > 1 else {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            rooms |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith("pushgraph.")}
    return rooms


def test_no_module_imports_backwards() -> None:
    seen = set()
    for path in sorted(SOURCE.rglob("*.py")):
        room = path.relative_to(SOURCE).parts[0].removesuffix(".py")
        if room in ("__init__", "__main__"):
            continue
        seen.add(room)
        backwards = {other for other in imported_rooms(path) if ORDER.index(other) > ORDER.index(room)}
        assert not backwards, f"{path.name} imports {backwards}"
    assert seen == set(ORDER)


def test_only_the_simulation_s_engine_imports_mujoco() -> None:
    imports = re.compile(r"^\s*(import|from) mujoco", re.M)
    importers = [path for path in SOURCE.rglob("*.py") if imports.search(path.read_text())]
    assert importers == [SOURCE / "simulation" / "engine.py"]


def test_importing_pushgraph_is_quick_and_every_public_name_exists() -> None:
    code = "import time; t = time.time(); import pushgraph; print(time.time() - t)"
    tries = (subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(5))
    assert any(float(done.stdout) < 0.1 for done in tries)
    import pushgraph

    assert all(getattr(pushgraph, name) is not None for name in pushgraph.__all__)


def test_scenes_and_the_command_s_help_need_no_torch_and_take_less_than_a_second() -> None:
    load = f"import pushgraph as pg; pg.Scene.load({str(SOURCE / 'scenes' / 'demo.json')!r}); pg.Track"
    of_help = "import pushgraph.cli; sys.argv = ['pushgraph', '--help']; pushgraph.cli.main()"
    # The time of the processor: other tests may run beside this one.
    end = "import atexit, sys, time; atexit.register(lambda: print('torch' in sys.modules, time.process_time())); "
    for code in (load, of_help):
        command = [sys.executable, "-c", end + code]
        *_, torch, seconds = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
        assert torch == "False"
        assert float(seconds) < 1


def test_neither_pushgraph_nor_its_command_line_loads_the_browser_viewer() -> None:
    code = "import sys, pushgraph.cli; sys.exit(str({'viser', 'pushgraph.view.page'} & set(sys.modules) or ''))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr.strip() == ""


def test_every_dependency_is_explained_and_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *(d for extra in project["optional-dependencies"].values() for d in extra)]
    names = {re.match(r"[\w-]+", requirement)[0].lower() for requirement in wanted}
    explained = (ROOT / "docs" / "dependencies.md").read_text().lower()
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in (ROOT / "constraints.txt").read_text().split()}
    for name in names - {"pushgraph", "pushgraph-baselines"}:
        assert name in explained, name
        assert name in pinned, name


def test_the_version_is_told_alike_everywhere() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert re.search(rf"^version: {re.escape(version)}$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert tomllib.loads((ROOT / "baselines" / "pyproject.toml").read_text())["project"]["version"] == version
