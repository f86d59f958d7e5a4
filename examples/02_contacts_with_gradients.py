"""Contact geometry in torch: move a cuboid until it just touches a cylinder, by following the gradient of the gap.

python examples/02_contacts_with_gradients.py
"""

import torch

import pushgraph as pg


def main() -> None:
    """Shapes come in batches; here a batch of one."""
    cylinder = pg.RoundedBox(torch.zeros(1, 2), torch.tensor([0.05]))
    cuboid = pg.RoundedBox(torch.tensor([[0.06, 0.04]]), torch.zeros(1))
    pose_cylinder_from_cuboid = torch.tensor([[0.20, 0.10, 0.4]], requires_grad=True)
    optimizer = torch.optim.SGD([pose_cylinder_from_cuboid], lr=0.05)
    for _ in range(200):
        optimizer.zero_grad()
        gap = pg.signed_gap(cylinder, cuboid, pose_cylinder_from_cuboid)
        gap.square().sum().backward()
        optimizer.step()
    touch = pg.contact_between(cylinder, cuboid, pose_cylinder_from_cuboid.detach())
    print(f"gap {1000 * touch.gap.item():.4f} mm at {touch.points_a[0, 0].tolist()}, normal {touch.normal[0].tolist()}")


if __name__ == "__main__":
    main()
