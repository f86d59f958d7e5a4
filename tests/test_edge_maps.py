"""Maps at edges against rigid motions by hand, and against each other: forces undo what twists do."""

import math

import torch

from pushgraph.network.edge_maps import arms_of, edges_last, in_contact_frame, parting, pushing

EDGES, POINTS = 5, 3


def drawn(*shape: int) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(len(shape) + sum(shape)), dtype=torch.float64)


def normals() -> torch.Tensor:
    angle = drawn(EDGES) * math.pi
    return torch.stack((angle.cos(), angle.sin()))


def test_a_twist_told_in_the_contact_frame_is_turned_back_by_the_normal() -> None:
    normal, twist = normals(), drawn(3, EDGES)
    told = (in_contact_frame(normal) * twist[:, None]).sum(0)
    x, y = normal
    torch.testing.assert_close(torch.stack((told[0] * x - told[1] * y, told[0] * y + told[1] * x, told[2])), twist)


def test_points_part_as_those_of_two_rigid_bodies_do() -> None:
    normal, receiver, sender = normals(), drawn(EDGES, POINTS, 2), drawn(EDGES, POINTS, 2) + 1
    twists = drawn(6, EDGES)
    moved, turned = parting(normal, arms_of(receiver), arms_of(sender))
    moved, turned = (moved * twists[:, None, None]).sum(0), (turned * twists).sum(0)
    for k in range(EDGES):
        x, y = normal[:, k].tolist()
        frame = torch.tensor(((x, y), (-y, x)), dtype=torch.float64)
        for p in range(POINTS):
            ways = []
            for levers, (vx, vy, turn) in ((receiver, twists[:3, k]), (sender, twists[3:, k])):
                lever = levers[k, p]
                ways.append(frame @ torch.stack((vx, vy)) + turn * torch.stack((-lever[1], lever[0])))
            torch.testing.assert_close(moved[p, :, k], ways[1] - ways[0])
        torch.testing.assert_close(turned[k], twists[5, k] - twists[2, k])


def test_forces_push_a_body_as_its_points_part_by_virtual_work() -> None:
    normal, levers = normals(), drawn(EDGES, POINTS, 2)
    moved, turned = parting(normal, arms_of(levers), arms_of(levers))
    pushed = pushing(normal, arms_of(levers), torch.ones(EDGES, dtype=torch.float64))
    # The receiver's points move towards the sender's, so the distance shrinks by what the same forces would move.
    torch.testing.assert_close(pushed[:-1], -moved[:3].flatten(1, 2).transpose(0, 1))
    torch.testing.assert_close(pushed[-1], -turned[:3])
    eased = pushing(normal, arms_of(levers), torch.full((EDGES,), 4.0, dtype=torch.float64))
    torch.testing.assert_close(eased[:-1, 2], 4 * pushed[:-1, 2])
    torch.testing.assert_close(eased[:, :2], pushed[:, :2])


def test_edges_last_are_the_same_numbers_in_rows() -> None:
    levers = drawn(EDGES, POINTS, 2)
    assert edges_last(levers).is_contiguous()
    torch.testing.assert_close(edges_last(levers)[1, 0], levers[:, 1, 0])
