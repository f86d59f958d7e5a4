"""A new virtual environment that finds what a wheel asks for and nothing else, without a network.

The packages are those of the environment that runs the tests, linked one by one: what a wheel needs and does not ask
for is missing here, as it would be elsewhere.
"""

import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from importlib.metadata import Distribution, PathDistribution, distribution
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]


def build(folder: Path) -> None:
    """Build the sdist, the wheel from it, and the wheel of the baselines into a folder."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(folder)], cwd=ROOT, check=True)
    (sdist,) = folder.glob("pushgraph-*.tar.gz")
    for source in (sdist, ROOT / "baselines"):
        subprocess.run([*pip, "--wheel-dir", str(folder), str(source)], cwd=folder, check=True)


def wheel_metadata(folder: Path, name: str) -> Distribution:
    """What the wheel of this name in a folder says."""
    (wheel,) = folder.glob(f"{name.replace('-', '_')}-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (place,) = {entry.split("/")[0] for entry in archive.namelist() if ".dist-info/" in entry}
    return PathDistribution(zipfile.Path(wheel, f"{place}/"))


class FreshEnvironment:
    """An environment in a folder; pip in it finds the wheels of another folder."""

    def __init__(self, folder: Path, wheels: Path) -> None:
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        self._bin, self._wheels = folder / "bin", wheels
        (self._packages,) = folder.glob("lib/python*/site-packages")
        self.run("pip uninstall --yes setuptools", folder)  # Python 3.11 brings one that nobody asked for
        self._own = {name: wheel_metadata(wheels, name) for name in ("pushgraph", "pushgraph-baselines")}

    def offer(self, requirements: Iterable[str]) -> None:
        """Link the packages that these requirements lead to, but not ours: those pip has to install."""
        waiting, done = [Requirement(text) for text in requirements], set()
        while waiting:
            wanted = waiting.pop()
            name = re.sub(r"[-_.]+", "-", wanted.name).lower()
            for extra in {"", *wanted.extras} - {extra for named, extra in done if named == name}:
                done.add((name, extra))
                found = self._own.get(name) or distribution(name)
                if name not in self._own:
                    self._link(found)
                needed = map(Requirement, found.requires or ())
                waiting += [one for one in needed if one.marker is None or one.marker.evaluate({"extra": extra})]

    def _link(self, found: Distribution) -> None:
        for part in {file.parts[0] for file in found.files or ()} - {"..", "__pycache__"}:
            link = self._packages / part
            if not link.exists():
                link.symlink_to(found.locate_file(part))

    def run(self, script: str, folder: Path, **variables: str) -> subprocess.CompletedProcess:
        """Run a shell script in a folder, with this environment's commands first and pip kept from the network."""
        own = {
            "PATH": f"{self._bin}:{os.environ['PATH']}",
            "PIP_NO_INDEX": "1",
            "PIP_FIND_LINKS": str(self._wheels),
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
            "PIP_NO_BUILD_ISOLATION": "0",  # pip's word for: build with what is here
            "COLUMNS": "200",
        }
        inherited = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
        command = ["bash", "-euo", "pipefail", "-c", script]
        return subprocess.run(command, cwd=folder, env=inherited | own | variables, capture_output=True, text=True)
