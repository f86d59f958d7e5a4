"""Pictures and animations of tracks."""

from pushgraph.extras import extra

with extra("viewer", "drawing"):
    import matplotlib  # noqa: F401
