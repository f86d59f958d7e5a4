"""Joints between two bodies."""

from typing import Any, get_args

from pushgraph.body import JointKind
from pushgraph.scene import Scene
from pushgraph.view.panel.controls import NONE, Controls, offer_pair


class JointControls(Controls):
    """Join two bodies where they face each other, or take their joint away."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.gui.add_divider()
        self.parent = self.gui.add_dropdown("Join", (NONE,))
        self.child = self.gui.add_dropdown("and", (NONE,))
        self.kind = self.gui.add_dropdown("by a joint", get_args(JointKind))
        self.buttons(
            "Joint",
            {"Join": self._join, "Part": lambda: self.workbench.part(self.parent.value, self.child.value)},
            "Join the two where they face each other; take their joint away",
        )

    def refresh(self) -> None:
        """List the bodies."""
        scene = self.workbench.scene
        names = scene.names if isinstance(scene, Scene) else ()
        offer_pair(self.parent, self.child, names)

    def _join(self) -> None:
        joint: dict[str, Any] = {
            "kind": self.kind.value,
            "parent": self.parent.value,
            "child": self.child.value,
        }
        self.workbench.join(joint)
