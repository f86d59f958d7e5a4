"""How bodies hang together: pieces, branches and loops."""

from itertools import permutations

import pytest
from scenes import body

from pushgraph.body import Joint
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.simulation.assembly import Assembly, assemble


def scene(names: str, *joints: str, groups: tuple[str, ...] = (), fixed: str = "") -> Scene:
    """Boxes far apart, one a letter. A joint is two letters and r, p or f between them: "arb" hinges b to a."""
    kinds = {"r": "revolute", "p": "prismatic", "f": "fixed"}
    return Scene(
        bodies=tuple(
            body(name, 0.2 * k - 0.9, 0, Cuboid(size=(0.1, 0.1))).replace(fixed=name in fixed)
            for k, name in enumerate(names)
        ),
        joints=tuple(Joint(kind=kinds[joint[1]], parent=joint[0], child=joint[2]) for joint in joints),
        rigid_groups=tuple(tuple(group) for group in groups),
    )


def pieces(found: Assembly, names: str) -> set[str]:
    return {"".join(names[k] for k in piece.bodies) for piece in found.pieces}


def branches(found: Assembly, names: str) -> list[str]:
    """Each branch as piece<parent."""
    called = ["".join(names[k] for k in piece.bodies) for piece in found.pieces]
    return [called[b.piece] + ("" if b.parent is None else "<" + called[b.parent]) for b in found.branches]


def check(of: Scene) -> Assembly:
    """What holds for the assembly of any scene."""
    found = assemble(of)
    bodies = [k for piece in found.pieces for k in piece.bodies]
    assert sorted(bodies) == list(range(len(of.bodies)))
    assert len(found.branches) == len(found.pieces)
    assert {branch.piece for branch in found.branches} == set(range(len(found.pieces)))
    placed: set[int] = set()
    for branch in found.branches:
        assert (branch.parent is None) == (branch.joint is None)
        assert branch.parent is None or branch.parent in placed
        if found.pieces[branch.piece].immovable:
            assert branch.parent is None
        if branch.joint is not None:
            ends = {found.piece_of[of.names.index(name)] for name in (branch.joint.parent, branch.joint.child)}
            assert ends == {branch.piece, branch.parent}
        placed.add(branch.piece)
    ends_of = {
        joint: {found.piece_of[of.names.index(name)] for name in (joint.parent, joint.child)} for joint in of.joints
    }
    within = [
        joint
        for joint, ends in ends_of.items()
        if len(ends) == 1 or all(found.pieces[piece].immovable for piece in ends)
    ]
    used = [branch.joint for branch in found.branches if branch.joint is not None]
    parted = [(joint.parent, joint.child) for joint in [*used, *found.loops, *within]]
    assert sorted(parted) == sorted((joint.parent, joint.child) for joint in of.joints)
    still = {k for piece in found.pieces if piece.immovable for k in piece.bodies}
    assert {k for k, immovable in enumerate(of.immovable) if immovable} <= still
    return found


def test_loose_bodies_are_pieces_of_their_own() -> None:
    found = check(scene("abc"))
    assert pieces(found, "abc") == {"a", "b", "c"}
    assert branches(found, "abc") == ["a", "b", "c"]
    assert found.loops == ()


def test_rigid_groups_and_fixed_joints_make_one_piece_together() -> None:
    found = check(scene("abcdef", "bfc", "erf", groups=("ab", "cd")))
    assert pieces(found, "abcdef") == {"abcd", "e", "f"}
    assert branches(found, "abcdef") == ["abcd", "e", "f<e"]


def test_a_chain_of_fixed_joints_is_one_piece_in_any_order() -> None:
    for order in permutations(("afb", "cfb", "dfc", "efd")):
        assert pieces(check(scene("abcde", *order)), "abcde") == {"abcde"}


def test_a_chain_is_a_tree_from_its_first_body() -> None:
    found = check(scene("abcd", "bra", "cpb", "crd"))
    assert branches(found, "abcd") == ["a", "b<a", "c<b", "d<c"]


@pytest.mark.parametrize("fixed", ["a", "b", "c", "d"])
def test_what_is_fixed_is_the_root(fixed: str) -> None:
    found = check(scene("abcd", "arb", "brc", "crd", fixed=fixed))
    assert branches(found, "abcd")[0] == fixed
    assert found.loops == ()


def test_a_ring_is_cut_once_and_opposite_its_first_body() -> None:
    found = check(scene("abcd", "arb", "brc", "crd", "dra"))
    assert branches(found, "abcd") == ["a", "b<a", "d<a", "c<b"]
    assert [(joint.parent, joint.child) for joint in found.loops] == [("c", "d")]


@pytest.mark.parametrize("order", list(permutations(("arb", "brc", "crd", "dra", "bpd")))[::7])
@pytest.mark.parametrize("fixed", ["", "c", "bd"])
def test_two_rings_are_cut_twice_and_once_more_for_every_second_root(order, fixed: str) -> None:
    joints = [joint for joint in order if not {joint[0], joint[2]} <= set(fixed)]
    found = check(scene("abcd", *joints, fixed=fixed))
    free = 4 - max(len(fixed), 1)
    assert len(found.loops) == len(joints) - free


def test_a_body_between_two_fixed_ones_closes_a_loop() -> None:
    found = check(scene("abc", "apb", "cpb", fixed="ac"))
    assert branches(found, "abc") == ["a", "c", "b<a"]
    assert [(joint.parent, joint.child) for joint in found.loops] == [("c", "b")]


def test_what_a_group_or_a_fixed_joint_holds_to_something_fixed_cannot_move() -> None:
    found = check(scene("abcde", "bfc", "drc", groups=("ab",), fixed="a"))
    assert pieces(found, "abcde") == {"abc", "d", "e"}
    assert [piece.immovable for piece in found.pieces] == [True, False, False]
    assert branches(found, "abcde") == ["abc", "d<abc", "e"]


def test_joints_between_bodies_that_other_joints_make_one_piece_are_left_out() -> None:
    found = check(scene("abc", "afb", "bfc", "arc"))
    assert pieces(found, "abc") == {"abc"}
    assert found.loops == ()
    assert all(branch.joint is None for branch in found.branches)


def test_joints_between_two_pieces_that_cannot_move_are_left_out() -> None:
    found = check(scene("abcd", "afb", "bpc", "crd", fixed="ac"))
    assert [piece.immovable for piece in found.pieces] == [True, True, False]
    assert branches(found, "abcd") == ["ab", "c", "d<c"]
    assert found.loops == ()
