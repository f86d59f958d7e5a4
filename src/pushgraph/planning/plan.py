"""A plan: the tool, the pushes, and what is expected of them."""

import json
import os
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import model_validator

from pushgraph.errors import PlanningError
from pushgraph.json_file import check_seal, parse_object, read_text, save_sealed, validated
from pushgraph.record import Record
from pushgraph.scene import Scene
from pushgraph.spread import Ellipse
from pushgraph.tool import Push
from pushgraph.track import Track

FORMAT, VERSION = "pushgraph.plan", 1


class PlanFile(Record):
    """What stands in plan.json."""

    format: Literal["pushgraph.plan"]
    version: Literal[1]
    tool: str
    cost: float
    expected_end: dict[str, tuple[float, float, float]]
    """pose_world_from_body of every body of the scene, in its order."""
    scene: Scene
    checksum: str | None = None

    @model_validator(mode="after")
    def _about_the_scene(self) -> "PlanFile":
        if tuple(self.expected_end) != self.scene.names:
            raise ValueError(f"expected_end: must be of the bodies {', '.join(self.scene.names)}, in this order")
        return self


@dataclass(frozen=True, eq=False)
class Plan:
    """Pushes that a robot can run.

    tool: its name. scene: what was planned for, with the tool and the pushes in. expected: the track that the dynamics
    expect, up to the frame in which the plan ends. cost: of its last frame (m).
    """

    tool: str
    scene: Scene
    expected: Track
    cost: float

    @property
    def pushes(self) -> tuple[Push, ...]:
        """What the robot shall do."""
        return self.scene.pushes

    @property
    def end(self) -> Float[np.ndarray, "bodies 3"]:
        """pose_world_from_body expected at the end."""
        return self.expected.poses[-1, 1:]

    def end_region(self, body: str, probability: float = 0.68) -> Ellipse | None:
        """Where the body is in the end with this probability, around where it is expected; None if nothing says so."""
        if self.expected.spread is None:
            return None
        index = self.scene.names.index(body)
        return self.expected.spread.take((-1, index)).ellipse(probability)

    def save(self, path: str | os.PathLike) -> None:
        """Write JSON: the scene with tool and pushes, which other commands read, and what is expected."""
        content = {
            "format": FORMAT,
            "version": VERSION,
            "tool": self.tool,
            "cost": self.cost,
            "expected_end": {
                name: row for name, row in zip(self.scene.names, np.round(self.end, 6).tolist(), strict=True)
            },
            "scene": json.loads(self.scene.to_json()),
        }
        save_sealed(path, content, indent=2)


def load_plan(path: str | os.PathLike) -> tuple[str, Scene]:
    """The tool's name, and the scene with tool and pushes, of a plan that was saved; raises PlanningError."""
    text = read_text(path, "plan", PlanningError)
    content = parse_object(text, str(path), "plan", PlanningError)
    if content.get("format") != FORMAT or content.get("version") != VERSION:
        raise PlanningError(f'{path}: not a plan: needs "format": "{FORMAT}", "version": {VERSION}')
    check_seal(content, str(path), PlanningError)
    plan = validated(PlanFile, text, str(path), PlanningError)
    return plan.tool, plan.scene
