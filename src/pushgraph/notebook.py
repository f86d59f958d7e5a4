"""How notebooks show what has a picture: by the viewer, which comes after it and takes a second to import."""

import importlib
from typing import Any

from pushgraph.errors import MissingExtraError


def png_of(shown: Any) -> bytes | None:
    """The picture of a scene or a track, as PNG; None, as notebooks ask for, where the viewer is not installed."""
    try:
        return importlib.import_module("pushgraph.viewer.picture").png_of(shown)
    except MissingExtraError:
        return None
