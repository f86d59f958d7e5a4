"""A plan: the tool, the pushes, and what is expected of them."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pushgraph.errors import PlanningError, PushGraphError
from pushgraph.scene import Scene
from pushgraph.spread import Ellipse
from pushgraph.storage import replacing
from pushgraph.tool import Push
from pushgraph.track import Track

FORMAT, VERSION = "pushgraph.plan", 1


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
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(content, indent=2) + "\n")


def load_plan(path: str | os.PathLike) -> tuple[str, Scene]:
    """The tool's name, and the scene with tool and pushes, of a plan that was saved; raises PlanningError."""
    try:
        content = json.loads(Path(path).read_bytes())
    except (OSError, ValueError) as error:
        raise PlanningError(f"{path}: cannot read this plan, the file may be truncated: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT or content.get("version") != VERSION:
        raise PlanningError(f'{path}: not a plan: needs "format": "{FORMAT}", "version": {VERSION}')
    try:
        return str(content["tool"]), Scene.from_json(json.dumps(content["scene"]), f"{path}: scene")
    except (KeyError, PushGraphError) as error:
        raise PlanningError(f"{path}: this plan is damaged: {error}") from None
