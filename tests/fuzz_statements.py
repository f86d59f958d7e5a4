"""What files state, found in another way than pushgraph reads them; and checksums made anew."""

import json
import math
import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fuzz import of_bytes, of_json
from fuzz_pool import Kind

from pushgraph.checksum import checksum_line, is_intact
from pushgraph.json_file import sealed

NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)


def agrees(stated: Any, loaded: Any) -> bool:
    """Whether all that a JSON text states is in what was loaded, which may say more; null states nothing."""
    if isinstance(stated, dict):
        return isinstance(loaded, dict) and all(
            (value is None and loaded.get(name) is None) or (name in loaded and agrees(value, loaded[name]))
            for name, value in stated.items()
        )
    if isinstance(stated, list):
        return isinstance(loaded, list | tuple) and len(stated) == len(loaded) and all(map(agrees, stated, loaded))
    if isinstance(stated, float) and math.isnan(stated):
        return isinstance(loaded, float) and math.isnan(loaded)
    if isinstance(stated, bool) or isinstance(loaded, bool) or stated is None or isinstance(stated, str):
        return type(stated) is type(loaded) and stated == loaded
    return isinstance(loaded, int | float) and (stated == loaded or math.isclose(stated, loaded, rel_tol=1e-12))


def strictly(content: bytes) -> Any:
    """JSON text in UTF-8, no key of an object twice."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        assert len({name for name, _ in pairs}) == len(pairs), "a key stands twice"
        return dict(pairs)

    return json.loads(content.decode(), object_pairs_hook=once)


def states_json(content: bytes, loaded: Any, without: Sequence[str] = ()) -> bool:
    stated = strictly(content)
    return agrees({name: stated[name] for name in stated if name not in (*without, "checksum")}, loaded)


def has_checksum(content: bytes) -> bool:
    try:
        return "checksum" in json.loads(content)
    except (ValueError, TypeError, RecursionError):
        return False


def reseal_json(tree: Any) -> Any:
    """With its checksum made anew."""
    if isinstance(tree, dict) and "checksum" in tree:
        del tree["checksum"]
        return sealed(tree)
    return tree


def json_kind(
    name: str,
    make: Callable[[Path], Sequence[Path]],
    read: Callable[[Path], Any],
    states: Callable[[bytes, Any], bool] = states_json,
) -> Kind:
    mutation = of_json(reseal_json)
    return Kind(name, make, read, (of_bytes, mutation, mutation), states, has_checksum)


def written(folder: Path, name: str, text: str) -> list[Path]:
    (folder / name).write_text(text)
    return [folder / name]


def as_tree(record: Any) -> Any:
    return json.loads(record.to_json() if hasattr(record, "to_json") else record.model_dump_json())


def same_cells(cells: Sequence[str], values: Sequence[Any]) -> bool:
    """Whether cells hold these numbers or names; of NaN no number."""
    if len(cells) != len(values):
        return False
    for cell, value in zip(cells, values, strict=True):
        if isinstance(value, str):
            same = value in (cell, cell.strip())
        elif math.isnan(value):
            same = not NUMBER.fullmatch(cell) or not math.isfinite(float(cell))
        else:
            same = bool(NUMBER.fullmatch(cell)) and math.isclose(float(cell), value, rel_tol=1e-9, abs_tol=1e-15)
        if not same:
            return False
    return True


def reseal(content: bytes) -> bytes:
    end = content.rfind(b"\npushgraph crc32 ")
    content = content[:end] if end >= 0 and len(content) - end < 40 else content
    return content + checksum_line(content)


def has_line(content: bytes) -> bool:
    with tempfile.NamedTemporaryFile() as file:
        file.write(content)
        file.flush()
        return is_intact(Path(file.name)) is not None
