"""What is installed on demand: the extras of `pip install 'pushgraph[EXTRA]'`."""

import contextlib
from collections.abc import Iterator

from pushgraph.errors import MissingExtraError


@contextlib.contextmanager
def extra(name: str, purpose: str) -> Iterator[None]:
    """Import in here what an extra brings; raises MissingExtraError, which says how to install it, if it is absent."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"{purpose} needs {error.name}: pip install 'pushgraph[{name}]'") from error
