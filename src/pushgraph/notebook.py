"""How notebooks show what has a picture: by the viewer, which comes after it and takes a second to import."""

import importlib
from typing import Any


def png_of(shown: Any) -> bytes:
    """The picture of a scene or a track, as PNG."""
    return importlib.import_module("pushgraph.viewer.picture").png_of(shown)
