"""Units and axes of a recording: declared in its header or by its user, never guessed."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.errors import TrackError
from pushgraph.recording.sightings import Declared, Sightings

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
ANGLES = {"rad": 1.0, "deg": math.radians(1.0), "-rad": -1.0, "-deg": -math.radians(1.0)}
"""With a minus: counted clockwise."""
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
SYNONYMS = {
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("centimeter", "centimeters", "centimetre", "centimetres"), "cm"),
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("inch", "inches", '"'), "in"),
    **dict.fromkeys(("degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("usec", "µs", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("nsec", "nanosecond", "nanoseconds"), "ns"),
}
AXES = {"x,y": "x,y", "mirrored": "x,-y", "swapped": "y,x"}
"""Names for what is declared often: y to the other side, as in an image; x and y exchanged."""


def declared_units(text: str, where: str) -> Declared:
    """Units from words such as `mm deg ms`, in any order; raises TrackError for an unknown one."""
    found: dict[str, str] = {}
    for word in re.split(r"[\s,;/]+", text.strip()):
        unit = SYNONYMS.get(word.lower(), word.lower())
        kinds = [kind for kind, units in (("length", LENGTHS), ("angle", ANGLES), ("time", TIMES)) if unit in units]
        if not kinds:
            valid = ", ".join((*LENGTHS, *ANGLES, *TIMES))
            raise TrackError(f"{where}: no unit {word!r}; valid: {valid}")
        found[kinds[0]] = unit
    return Declared(**found)


@dataclass(frozen=True)
class Convention:
    """How numbers of a recording become poses in the world.

    length, angle, time: m, rad and s a unit. world_from_axes: rows are the world's x and y in the recording's axes; its
    determinant is -1 if the recording is mirrored. pose_world_from_recording: applied last (m, rad).
    """

    length: float = 1.0
    angle: float = 1.0
    time: float = 1.0
    world_from_axes: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 1.0))
    pose_world_from_recording: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, declared: Declared) -> "Convention":
        """From the names in a header or an option; raises TrackError for unknown ones.

        axes: the recording's axes that the world's x and y are, such as `x,-y` or `-y,x`; or `mirrored`, `swapped`.
        frame: `x y yaw` of the recording's origin in the world, in the recording's units of length and angle.
        """
        length = _factor(declared.length, LENGTHS, "length", "m")
        angle = _factor(declared.angle, ANGLES, "angle", "rad")
        return cls(
            length,
            angle,
            _factor(declared.time, TIMES, "time", "s"),
            _matrix(declared.axes or "x,y"),
            _frame(declared.frame or "0 0 0", length, angle),
        )

    @property
    def mirrors(self) -> bool:
        """Whether the recording's axes are left-handed."""
        return float(np.linalg.det(np.array(self.world_from_axes))) < 0

    def poses(self, x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], yaw: Float[np.ndarray, " n"]) -> np.ndarray:
        """Poses in the world, [n, 3] (m, rad); NaN where they are infinite, which stands for a lost tag as NaN does."""
        x, y, yaw = (np.where(np.isinf(values), np.nan, values) for values in (x, y, yaw))
        axes = np.array(self.world_from_axes)
        positions = np.stack((x, y), -1) * self.length @ axes.T
        turned = math.atan2(axes[1, 0], axes[0, 0])  # of the recording's x axis
        yaws = turned + (-1 if self.mirrors else 1) * yaw * self.angle
        poses = np.concatenate((positions, yaws[:, None]), -1)
        return pose.compose(np.array(self.pose_world_from_recording), poses)

    def wrench(self, wrench: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Forces along the world's axes, and moments counter-clockwise in them."""
        with np.errstate(invalid="ignore"):  # infinite readings are refused later, whatever becomes of them here
            force = pose.rotate(wrench[:, :2] @ np.array(self.world_from_axes).T, self.pose_world_from_recording[2])
        return np.column_stack((force, -wrench[:, 2] if self.mirrors else wrench[:, 2]))

    def apply(self, sightings: Sightings) -> Sightings:
        """The same sightings in m, rad and s, in the world frame."""
        x, y, yaw = self.poses(sightings.x, sightings.y, sightings.yaw).T
        force_x, force_y, moment = self.wrench(sightings.wrench).T
        return replace(
            sightings,
            time=sightings.time * self.time,
            x=x,
            y=y,
            yaw=yaw,
            height=sightings.height * self.length,
            force_x=force_x,
            force_y=force_y,
            moment=moment,
        )


def _factor(name: str | None, units: Mapping[str, float], kind: str, usual: str) -> float:
    name = (name or usual).strip().lower()
    name = SYNONYMS.get(name, name)
    if name not in units:
        raise TrackError(f"unit of {kind} {name!r}; valid: {', '.join(units)}")
    return units[name]


def _matrix(axes: str) -> tuple[tuple[float, float], tuple[float, float]]:
    text = AXES.get(axes.strip().lower(), axes.strip().lower())
    rows = re.fullmatch(r"([+-]?)([xy])[\s,]+([+-]?)([xy])", text)
    if not rows or rows[2] == rows[4]:
        raise TrackError(f"axes {axes!r}; valid: x and y with signs, in any order, such as x,-y; {', '.join(AXES)}")

    def row(sign: str, axis: str) -> tuple[float, float]:
        value = -1.0 if sign == "-" else 1.0
        return (value, 0.0) if axis == "x" else (0.0, value)

    return row(rows[1], rows[2]), row(rows[3], rows[4])


def _frame(text: str, length: float, angle: float) -> tuple[float, float, float]:
    try:
        x, y, yaw = (float(number) for number in re.split(r"[\s,]+", text.strip()))
    except ValueError:
        x = y = yaw = math.nan
    if not all(map(math.isfinite, (x, y, yaw))):
        raise TrackError(f"frame {text!r}; valid: x y yaw of the recording's origin in the world, three numbers")
    return x * length, y * length, yaw * angle
