"""Whose pose is it: names in a recording matched to the nodes of a scene."""

import re
import unicodedata
from collections.abc import Mapping, Sequence

from pushgraph.body import ROBOT
from pushgraph.errors import TrackError
from pushgraph.recording.findings import Finding, listed

ROBOT_NAMES = ("robot", "tool", "tool0", "ee", "eef", "endeffector", "pusher", "gripper", "tcp", "agent", "hand")
"""What the robot is called elsewhere."""
DECORATIONS = {"tag", "id", "body", "marker", "pose", "link", "frame", "rigid", "poses", "obj"}
"""Words around a name that say nothing of whose it is."""


def match_names(recorded: Sequence[str], nodes: Sequence[str], given: Mapping[str, str]) -> dict[str, str]:
    """Node of each recorded name that belongs to one: as given, or of the same name but for case, slashes, prefixes.

    A body that has none was never seen. Raises TrackError if a given name or node does not exist, if two names fit one
    node, or if a node has none while names are left over.
    """
    for name, node in given.items():
        if name not in recorded:
            raise TrackError(f"--name {name}={node}: the recording has no {name!r}; it has {listed(recorded, 30)}")
        if node not in nodes:
            raise TrackError(f"--name {name}={node}: the scene has no {node!r}; it has {listed(nodes, 30)}")
    matched = dict(given)
    free = [name for name in recorded if name not in matched]
    for keys in (_whole, _spelt, _last_part, _bare):
        for node in nodes:
            if node in matched.values():
                continue
            wanted = keys(node) | (set(ROBOT_NAMES) if node == ROBOT and keys is not _whole else set())
            fits = [name for name in free if name not in matched and keys(name) & wanted]
            if len(fits) > 1:
                raise TrackError(f"{listed(fits)} all fit {node!r}; say which is meant: --name {fits[0]}={node}")
            matched.update(dict.fromkeys(fits, node))
    missing = [node for node in nodes if node not in matched.values()]
    unused = [name for name in recorded if name not in matched]
    if missing and (unused or ROBOT in missing):
        example = unused[0] if unused else recorded[0]
        raise TrackError(
            f"nothing in the recording is called {listed(missing)}; names left: {listed(unused, 30) or 'none'}; say "
            f"what they are called: --name {example}={missing[0]}"
        )
    return matched


def unmatched(recorded: Sequence[str], matched: Mapping[str, str]) -> list[Finding]:
    """Say which names are none of the scene's."""
    others = [name for name in recorded if name not in matched]
    return [Finding(f"{listed(others)}: not in the scene, ignored")] if others else []


def _whole(name: str) -> set[str]:
    return {name}


def _spelt(name: str) -> set[str]:
    """Without case, blanks and signs."""
    return {re.sub(r"[\W_]+", "", unicodedata.normalize("NFKC", name).casefold())}


def _last_part(name: str) -> set[str]:
    """What stands after the last slash or colon."""
    return _spelt(re.split(r"[/:]", name.rstrip("/:"))[-1])


def _bare(name: str) -> set[str]:
    """The only word that is no decoration; of `/tags/cup/pose` it is `cup`."""
    words = [word for word in re.split(r"[\W_]+", unicodedata.normalize("NFKC", name).casefold()) if word]
    kept = [word for word in words if word not in DECORATIONS and word.rstrip("s") not in DECORATIONS]
    return {"".join(kept)} if kept else set()
