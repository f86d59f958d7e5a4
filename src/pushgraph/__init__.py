"""pushgraph: a learned physics engine for robot pushing.

    import pushgraph as pg

    scene = pg.Scene.load("scene.json")
    track = pg.load().predict(scene)
    track.save("track.h5")

Names are imported when first used, so that `import pushgraph` is quick. Which there are stands in `__init__.pyi` alone,
where type checkers read it, too.
"""

import ast
import importlib
import sys
import types
from pathlib import Path
from typing import Any

_MODULE_OF = {
    name.name: node.module
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(node, ast.ImportFrom) and node.module
    for name in node.names
}
__all__ = sorted([*_MODULE_OF, "__version__"])


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("pushgraph")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'pushgraph' has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(_MODULE_OF[name]), name)
    return value


class _Package(types.ModuleType):
    """`pushgraph.view` is a package, too, which importing it would put in the place of the function of that name."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _MODULE_OF and isinstance(value, types.ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __dir__() -> list[str]:
    return sorted((*globals(), *__all__))
