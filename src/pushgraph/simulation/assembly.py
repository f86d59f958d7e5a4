"""How bodies hang together: pieces that move as one, trees of joints between them, and joints that close loops."""

from collections import defaultdict
from typing import NamedTuple

from pushgraph.body import Joint
from pushgraph.scene import Scene


class Piece(NamedTuple):
    """Bodies (indices) that rigid groups and fixed joints make one; immovable if one of them is fixed."""

    bodies: tuple[int, ...]
    immovable: bool


class Branch(NamedTuple):
    """A piece's place in its tree: `joint` joins it to the piece `parent`; both None for a piece that stands freely, or
    not at all."""

    piece: int
    parent: int | None
    joint: Joint | None


class Assembly(NamedTuple):
    """Pieces, their branches (parents before children), and the joints that close loops of the branches."""

    pieces: tuple[Piece, ...]
    branches: tuple[Branch, ...]
    loops: tuple[Joint, ...]

    @property
    def piece_of(self) -> dict[int, int]:
        """Piece of each body."""
        return {body: index for index, piece in enumerate(self.pieces) for body in piece.bodies}


def assemble(scene: Scene) -> Assembly:
    """The pieces and trees of a scene. A loop is cut at the joint that a walk from its first piece meets last."""
    pieces = _pieces(scene)
    piece_of = {scene.names[body]: index for index, piece in enumerate(pieces) for body in piece.bodies}
    joints = [joint for joint in scene.joints if _can_move(pieces, piece_of[joint.parent], piece_of[joint.child])]
    at_piece: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for index, joint in enumerate(joints):
        first, second = piece_of[joint.parent], piece_of[joint.child]
        at_piece[first].append((index, second))
        at_piece[second].append((index, first))
    branches: list[Branch] = []
    reached, used = set(), set()
    # What cannot move is the root of all that hangs on it.
    roots = sorted(range(len(pieces)), key=lambda index: not pieces[index].immovable)
    anchored = [index for index in roots if pieces[index].immovable]
    for start in ([anchored] if anchored else []) + [[root] for root in roots]:
        queue = [Branch(piece, None, None) for piece in start if piece not in reached]
        reached |= {branch.piece for branch in queue}
        while queue:
            branch = queue.pop(0)
            branches.append(branch)
            for index, other in at_piece[branch.piece]:
                if other not in reached:
                    reached.add(other)
                    used.add(index)
                    queue.append(Branch(other, branch.piece, joints[index]))
    loops = tuple(joint for index, joint in enumerate(joints) if index not in used)
    return Assembly(tuple(pieces), tuple(branches), loops)


def _can_move(pieces: list[Piece], first: int, second: int) -> bool:
    """Whether a joint between these pieces can move: they are two, and not both immovable."""
    return first != second and not (pieces[first].immovable and pieces[second].immovable)


def _pieces(scene: Scene) -> list[Piece]:
    root = {name: name for name in scene.names}

    def find(name: str) -> str:
        while root[name] != name:
            name = root[name]
        return name

    fixed = [(joint.parent, joint.child) for joint in scene.joints if joint.kind == "fixed"]
    for first, *others in [*scene.rigid_groups, *fixed]:
        for other in others:
            root[find(other)] = find(first)
    members: dict[str, list[int]] = defaultdict(list)
    for index, name in enumerate(scene.names):
        members[find(name)].append(index)
    return [Piece(tuple(bodies), any(scene.bodies[k].fixed for k in bodies)) for bodies in members.values()]
