"""Random single pushes of one piece: what a planar simulator must get right."""

import math

import numpy as np

from pushgraph import pose
from pushgraph.body import Body
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder, Shape
from pushgraph.tool import Part, Push, Tool

KINDS = ("box", "disc", "L", "T")
FLAT_TOOLS = 0.2
"""Share of pushes with a flat tool; all others are round."""
START_GAP, TRAVEL = 1e-3, 0.06
"""How far the tool starts from the piece, and how far it moves from where it touches (m)."""
WIDEST = math.radians(40)
"""Between a push and the inward normal."""
DENSITY = 50.0
"""kg per m^2 of outline."""
TOOL_DEPTH = 0.02
"""Of a flat tool, along the push (m)."""
FAR = 1.0
"""From where tools approach (m)."""


def random_pushes(count: int, seed: int) -> list[Scene]:
    """Scenes of one piece each and one push; kinds of pieces take turns, see `kind_of`.

    Boxes to 10:1, discs, L and T pieces; round and flat tools, 2 mm/s to 0.3 m/s, frictions 0.1 to 0.6. The push meets
    the piece somewhere on its outline, within 40 degrees of the normal there.
    """
    rng = np.random.default_rng(seed)
    return [_draw(rng, KINDS[k % len(KINDS)]) for k in range(count)]


def kind_of(scene: Scene) -> str:
    """Kind of the scene's piece, one of KINDS."""
    return scene.names[0].split()[0]


def _draw(rng: np.random.Generator, kind: str) -> Scene:
    shapes, places = _draw_piece(rng, kind)
    piece = np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(-math.pi, math.pi)])
    bodies = tuple(
        Body(
            name=kind if len(shapes) == 1 else f"{kind} {part}",
            shape=shape,
            pose_world_from_body=tuple(pose.compose(piece, np.array(place)).tolist()),
            mass=DENSITY * _area(shape),
        )
        for part, shape, place in zip(("bar", "stem"), shapes, places, strict=False)
    )
    flat = rng.random() < FLAT_TOOLS
    depth = TOOL_DEPTH if flat else float(rng.uniform(0.006, 0.06))
    flat_tool = Part(shape=Cuboid(size=(depth, float(rng.uniform(0.02, 0.10)))))
    scene = Scene(
        bodies=bodies,
        rigid_groups=(tuple(body.name for body in bodies),) if len(bodies) > 1 else (),
        tool=Tool(parts=(flat_tool,)) if flat else Tool.round(depth),
        table=Table(friction=float(rng.uniform(0.1, 0.6))),
        side_friction=float(rng.uniform(0.1, 0.6)),
    )
    point, inward = _draw_outline_point(rng, scene)
    direction = inward + float(rng.uniform(-WIDEST, WIDEST))
    # Half of the flat tools meet the face flush, the others stand square to their path.
    yaw = inward if rng.random() < 0.5 else direction
    ahead = np.array([math.cos(direction), math.sin(direction)])
    touching = point - depth / 2 * np.array([math.cos(inward), math.sin(inward)])
    start, touch = (_approach(scene, touching, ahead, yaw, gap) for gap in (START_GAP, 0.0))
    push = Push(
        start=tuple(start.tolist()),
        direction=direction,
        distance=float((touch - start) @ ahead) + TRAVEL,
        speed=float(np.exp(rng.uniform(math.log(0.002), math.log(0.3)))),
        yaw=yaw,
    )
    return scene.replace(pushes=(push,))


def _draw_piece(rng: np.random.Generator, kind: str) -> tuple[list[Shape], list[tuple[float, float, float]]]:
    """Shapes of the parts, and their poses in the piece."""
    if kind == "box":
        long = float(rng.uniform(0.05, 0.25))
        aspect = float(np.exp(rng.uniform(0, math.log(10))))
        return [Cuboid(size=(long, long / aspect))], [(0.0, 0.0, 0.0)]
    if kind == "disc":
        return [Cylinder(diameter=float(rng.uniform(0.04, 0.16)))], [(0.0, 0.0, 0.0)]
    bar, stem = rng.uniform(0.08, 0.20), rng.uniform(0.05, 0.15)
    bar_width, stem_width = rng.uniform(0.02, 0.05, 2)
    beside = (bar - stem_width) / 2 if kind == "L" else 0.0
    shapes = [Cuboid(size=(float(bar), float(bar_width))), Cuboid(size=(float(stem_width), float(stem)))]
    return shapes, [(0.0, 0.0, 0.0), (float(beside), float((bar_width + stem) / 2), 0.0)]


def _draw_outline_point(rng: np.random.Generator, scene: Scene) -> tuple[np.ndarray, float]:
    """A point on the outline of the piece, anywhere alike, and the direction of its inward normal (rad)."""
    perimeters = np.array([_perimeter(body.shape) for body in scene.bodies])
    while True:
        chosen = rng.choice(len(scene.bodies), p=perimeters / perimeters.sum())
        body = scene.bodies[chosen]
        in_body, inward = _outline_point(rng, body.shape)
        point = pose.transform(np.array(body.pose_world_from_body), in_body)
        if not any(_inside(other, point) for k, other in enumerate(scene.bodies) if k != chosen):
            return point, inward + body.pose_world_from_body[2]


def _outline_point(rng: np.random.Generator, shape: Shape) -> tuple[np.ndarray, float]:
    half_x, half_y, radius = shape.core
    if radius:
        angle = rng.uniform(-math.pi, math.pi)
        return radius * np.array([math.cos(angle), math.sin(angle)]), angle + math.pi
    along = rng.uniform(-1, 1)
    sign = rng.choice([-1.0, 1.0])
    if rng.random() < half_x / (half_x + half_y):
        return np.array([along * half_x, sign * half_y]), -sign * math.pi / 2
    return np.array([sign * half_x, along * half_y]), math.pi * (sign > 0)


def _approach(scene: Scene, touching: np.ndarray, ahead: np.ndarray, yaw: float, gap: float) -> np.ndarray:
    """Where a tool that comes from afar towards `touching` is first this near to the piece."""
    place = touching - FAR * ahead
    for _ in range(1000):
        now = float(scene.tool_gaps(np.array([[*place, yaw]]), scene.poses_world_from_body).min())
        if now - gap < 1e-7:
            break
        place = place + (now - gap) * ahead
    return place


def _inside(body: Body, point: np.ndarray) -> bool:
    half_x, half_y, radius = body.shape.core
    x, y = np.abs(pose.transform(pose.inverse(np.array(body.pose_world_from_body)), point))
    return bool(np.hypot(x, y) <= radius if radius else x <= half_x + 1e-9 and y <= half_y + 1e-9)


def _area(shape: Shape) -> float:
    half_x, half_y, radius = shape.core
    return math.pi * radius**2 if radius else 4 * half_x * half_y


def _perimeter(shape: Shape) -> float:
    half_x, half_y, radius = shape.core
    return 2 * math.pi * radius if radius else 4 * (half_x + half_y)
