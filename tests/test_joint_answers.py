"""Joints that can hold together, against every division of bodies into pieces."""

from collections.abc import Iterator

import numpy as np
import pytest
import torch
from scenes import body

from pushgraph.graph.scene_batch import JOINT_CODES, batch_scenes, pair_index, pairs_of
from pushgraph.joint_answers import answer_together
from pushgraph.network.belief_network import Rows
from pushgraph.network.compiled.fixed_pieces import MOST_OPEN, SURE, fixed_pieces
from pushgraph.scene import Scene

BODIES = 5
PAIRS = BODIES * (BODIES - 1) // 2


def pieces(
    fixed: np.ndarray, said: np.ndarray | None = None, apart: np.ndarray | None = None, bodies: int = BODIES
) -> tuple[np.ndarray, np.ndarray]:
    """How likely each pair is in one piece, and whether it is in the likeliest division."""
    said = np.ones(len(fixed), bool) if said is None else said
    apart = 1 - fixed if apart is None else apart
    together, likeliest = np.zeros((1, len(fixed))), np.zeros((1, len(fixed)), bool)
    fixed_pieces(fixed[None], apart[None], said[None], bodies, together, likeliest)
    return together[0], likeliest[0]


def divisions(count: int) -> Iterator[list[int]]:
    """Labels of every division of so many bodies into pieces."""
    if count == 0:
        yield []
        return
    for labels in divisions(count - 1):
        for label in range(max(labels, default=-1) + 2):
            yield [*labels, label]


def is_joined(labels: np.ndarray, said: np.ndarray, a: np.ndarray, b: np.ndarray) -> bool:
    """Whether every piece hangs together by pairs of which something is said."""
    label = np.arange(len(labels))
    for _ in labels:
        for pair in np.flatnonzero(said & (labels[a] == labels[b])):
            label[label == max(label[a[pair]], label[b[pair]])] = min(label[a[pair]], label[b[pair]])
    return all(len(set(label[labels == one].tolist())) == 1 for one in labels)


@pytest.mark.parametrize("everything_is_said", [True, False])
def test_pairs_are_together_as_often_as_in_all_divisions_and_the_likeliest_is_found(everything_is_said: bool) -> None:
    rng = np.random.default_rng(0)
    a, b = (ends.numpy() for ends in pairs_of(BODIES, torch.device("cpu")))
    for _ in range(30):
        fixed = rng.uniform(2 * SURE, 1 - 2 * SURE, PAIRS)
        said = np.full(PAIRS, True) if everything_is_said else rng.random(PAIRS) < 0.7
        apart = (1 - fixed) * rng.uniform(0.4, 1.0, PAIRS)
        total, together, best, likeliest = 0.0, np.zeros(PAIRS), 0.0, np.zeros(PAIRS, bool)
        for labels in map(np.array, divisions(BODIES)):
            if not is_joined(labels, said, a, b):
                continue
            same = labels[a] == labels[b]
            weight = float(np.where(same, fixed, 1 - fixed)[said].prod())
            total, together = total + weight, together + weight * same
            if (score := float(np.where(same, fixed, apart)[said].prod())) > best:
                best, likeliest = score, same
        found = pieces(fixed, said, apart)
        np.testing.assert_allclose(found[0], together / total, atol=1e-12)
        np.testing.assert_array_equal(found[1], likeliest)


def test_of_three_that_are_fixed_but_for_one_pair_the_doubtful_pair_gives_way() -> None:
    """Divisions: all one 0.9 0.9 0.2, only ab and only bc 0.9 0.1 0.8, only ac 0.1 0.1 0.2, none 0.1 0.1 0.8."""
    together, likeliest = pieces(np.array([0.9, 0.2, 0.9]), bodies=3)  # ab ac bc
    whole, of_one, of_ac, none = 0.162, 0.072, 0.002, 0.008
    total = whole + 2 * of_one + of_ac + none
    np.testing.assert_allclose(together, np.array([whole + of_one, whole + of_ac, whole + of_one]) / total)
    assert likeliest.all()


def test_one_doubtful_pair_does_not_fix_two_pieces_that_are_seen_to_be_apart() -> None:
    fixed = np.full((4, 4), np.nan)
    fixed[0, 1] = fixed[2, 3] = 0.999  # two firm pairs
    fixed[1, 2] = 0.6  # joined, as it seems
    fixed[0, 2] = fixed[1, 3] = fixed[0, 3] = 0.05  # and apart, as three others show
    together, likeliest = pieces(fixed[np.triu_indices(4, 1)], bodies=4)
    assert likeliest.tolist() == [True, False, False, False, False, True]
    assert together[pair_index(1, 2, 4)] < 0.01


def test_the_order_of_bodies_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    square = rng.random((BODIES, BODIES))
    square = (square + square.T) / 2
    upper, order = np.triu_indices(BODIES, 1), rng.permutation(BODIES)
    together, likeliest = pieces(square[upper])
    turned, likeliest_turned = pieces(square[np.ix_(order, order)][upper])
    for pair, (k, m) in enumerate(zip(*upper, strict=True)):
        place = pair_index(*sorted((int(order[k]), int(order[m]))), BODIES)
        assert turned[pair] == pytest.approx(together[place], abs=1e-12)
        assert likeliest_turned[pair] == likeliest[place]


def test_of_too_many_pairs_that_are_alike_each_keeps_its_own_answer() -> None:
    bodies = 9
    fixed = np.full(bodies * (bodies - 1) // 2, 0.3)
    assert len(fixed) > MOST_OPEN
    together, likeliest = pieces(fixed, bodies=bodies)
    np.testing.assert_allclose(together, fixed)
    assert not likeliest.any()


def test_pairs_far_from_the_others_do_not_change_them() -> None:
    three = pieces(np.array([0.7, 0.4, 0.8]), bodies=3)[0]
    square = np.full((5, 5), np.nan)
    square[0, 1], square[0, 2], square[1, 2], square[3, 4] = 0.7, 0.4, 0.8, 0.5
    fixed = square[np.triu_indices(5, 1)]
    five = pieces(np.nan_to_num(fixed), said=np.isfinite(fixed))[0]
    np.testing.assert_allclose([five[pair_index(*ends, 5)] for ends in ((0, 1), (0, 2), (1, 2))], three)
    assert five[pair_index(3, 4, 5)] == pytest.approx(0.5)
    assert five[pair_index(2, 3, 5)] == 0.0


def test_other_joints_share_what_is_left_and_kinds_hold_together() -> None:
    batch = batch_scenes([Scene(bodies=tuple(body(name, 0.3 * k, 0.0) for k, name in enumerate("abc")))])
    batch = batch._replace(relations=batch.relations._replace(known=torch.zeros(1, 3, dtype=torch.bool)))
    answers = torch.tensor([[0.05, 0.9, 0.03, 0.02], [0.1, 0.45, 0.05, 0.4], [0.05, 0.9, 0.03, 0.02]])
    rows = Rows.of(torch.ones(1, 3, dtype=torch.bool), 3)
    believed = answer_together(batch, answers, rows, torch.ones(4, dtype=torch.bool))
    together = torch.from_numpy(pieces(answers[:, 1].double().numpy(), bodies=3)[0]).float()
    torch.testing.assert_close(believed.probabilities[0, :, JOINT_CODES["fixed"]], together)
    torch.testing.assert_close(believed.probabilities.sum(-1), torch.ones(1, 3))
    hinge, none = believed.probabilities[0, 1, [JOINT_CODES["revolute"], JOINT_CODES["none"]]]
    assert float(hinge / none) == pytest.approx(4.0, rel=1e-5)
    assert believed.kind.tolist() == [[JOINT_CODES["fixed"]] * 3]


def test_a_pair_without_a_joint_of_its_own_may_be_fixed_by_way_of_others() -> None:
    batch = batch_scenes([Scene(bodies=tuple(body(name, 0.3 * k, 0.0) for k, name in enumerate("abc")))])
    known = torch.tensor([[False, True, False]])  # ab ac bc: the scene says that nothing joins a to c directly
    batch = batch._replace(relations=batch.relations._replace(known=known))
    answers = torch.tensor([[0.1, 0.9, 0.0, 0.0], [0.2, 0.8, 0.0, 0.0]])
    believed = answer_together(batch, answers, Rows.of(~known, 3), torch.ones(4, dtype=torch.bool))
    torch.testing.assert_close(believed.probabilities[0, [0, 2]], answers)
    assert believed.probabilities[0, 1].tolist() == [1, 0, 0, 0]
    assert believed.kind.tolist() == [[JOINT_CODES["fixed"], JOINT_CODES["none"], JOINT_CODES["fixed"]]]
