"""Small scenes that several tests use."""

from pushgraph.body import Body, Joint
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.tool import Push


def body(name: str, x: float, y: float, shape=None, yaw: float = 0.0, mass: float | None = 0.5) -> Body:
    return Body(name=name, shape=shape or Cylinder(diameter=0.12), pose_world_from_body=(x, y, yaw), mass=mass)


def workshop() -> Scene:
    """Four bodies, a hinge, a rigid group, two pushes."""
    return Scene(
        bodies=(
            body("plate", 0.0, 0.0, Cuboid(size=(0.14, 0.10))),
            body("lid", 0.0, 0.105, Cuboid(size=(0.14, 0.10)), mass=0.3),
            body("cup", 0.25, 0.0),
            body("handle", 0.33, 0.0, Cuboid(size=(0.08, 0.02)), mass=0.1),
        ),
        joints=(Joint(kind="revolute", parent="plate", child="lid", anchor=(0.06, 0.0525)),),
        rigid_groups=(("cup", "handle"),),
        pushes=(
            Push(start=(-0.2, 0.0), end=(-0.05, 0.0)),
            Push(start=(0.25, -0.2), direction=1.5, distance=0.2, speed=0.1),
        ),
    )
