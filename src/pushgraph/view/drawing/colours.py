"""Colours that colour-blind people tell apart, on light and on dark pages alike."""

Colour = tuple[int, int, int]

# Okabe and Ito, Color Universal Design (2008), without black; the blue ones apart, since they are the nearest.
BODIES: tuple[Colour, ...] = (
    (230, 159, 0),
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (204, 121, 167),
    (0, 114, 178),
    (213, 94, 0),
)
WALL: Colour = (120, 120, 120)
TABLE: Colour = (196, 192, 184)
LIT_TABLE: Colour = (219, 217, 212)
"""As the table looks in the light of the lamps."""
GRID: Colour = (160, 156, 148)
EDGE: Colour = (40, 40, 40)
TOOL: Colour = (60, 60, 66)
PUSH: Colour = (20, 20, 90)
FORCE: Colour = (190, 0, 0)
GOAL: Colour = (0, 110, 60)
SPREAD: Colour = (150, 0, 100)
ARM: Colour = (157, 180, 200)
JOINTS: dict[str, Colour] = {
    "none": (235, 235, 235),
    "fixed": (30, 30, 30),
    "prismatic": (230, 159, 0),
    "revolute": (0, 114, 178),
}
"""Of marks, of links that are believed, and of probabilities, by kind of joint."""


def darker(colour: Colour, share: float = 0.55) -> Colour:
    """The same hue, less of it."""
    red, green, blue = (round(value * share) for value in colour)
    return red, green, blue


def body_colours(names: tuple[str, ...], groups: tuple[tuple[str, ...], ...], fixed: tuple[bool, ...]) -> list[Colour]:
    """One for each body: pieces of a rigid group share that of its first, walls are grey."""
    first = {name: group[0] for group in groups for name in group}
    own = {name: BODIES[index % len(BODIES)] for index, name in enumerate(names)}
    return [WALL if still else own[first.get(name, name)] for name, still in zip(names, fixed, strict=True)]
