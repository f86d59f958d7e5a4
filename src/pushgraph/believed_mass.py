"""What is believed of a body's mass."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Interval = tuple[float, float, float]
"""A median, and the ends of the interval that holds 68 %."""


@dataclass(frozen=True)
class BelievedMass:
    """What is believed of one body.

    classes: probabilities by name of the scene's mass classes. mass: kg. slide: force that slides it on the table,
    table friction times weight (N). ratios: its mass over that of every body it was pushed with, by name.
    """

    body: str
    classes: Mapping[str, float]
    mass: Interval
    slide: Interval
    ratios: Mapping[str, Interval]

    @property
    def likeliest(self) -> str:
        """The likeliest class."""
        return max(self.classes, key=lambda name: self.classes[name])

    def to_json(self) -> dict[str, Any]:
        """Plain values, as they stand in beliefs.json."""
        return {
            "body": self.body,
            "classes": dict(self.classes),
            "mass": list(self.mass),
            "slide": list(self.slide),
            "ratios": {name: list(ratio) for name, ratio in self.ratios.items()},
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "BelievedMass":
        """The inverse of `to_json`; raises KeyError, TypeError or ValueError if anything is missing."""
        return cls(
            content["body"],
            {name: float(share) for name, share in content["classes"].items()},
            _interval(content["mass"]),
            _interval(content["slide"]),
            {name: _interval(ratio) for name, ratio in content["ratios"].items()},
        )


def _interval(values: Any) -> Interval:
    median, low, high = (float(value) for value in values)
    return median, low, high
