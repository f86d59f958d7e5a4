"""Keys of what was simulated and is kept in the user's cache."""

import hashlib
import importlib.metadata
from pathlib import Path

from pushgraph import simulation


def simulation_key(*content: str) -> str:
    """A digest of all that a simulation depends on: what is simulated, the simulation, and what it stands on."""
    digest = hashlib.sha256("\n".join(content).encode())
    digest.update(repr([importlib.metadata.version(name) for name in ("mujoco", "numpy")]).encode())
    for path in sorted(Path(simulation.__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
