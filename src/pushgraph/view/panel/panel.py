"""All controls."""

from typing import Any

from pushgraph.view.panel.beliefs import BeliefControls
from pushgraph.view.panel.bodies import BodyControls
from pushgraph.view.panel.files import FileControls
from pushgraph.view.panel.goals import GoalControls
from pushgraph.view.panel.joints import JointControls
from pushgraph.view.panel.legend import LegendControls
from pushgraph.view.panel.outline import OutlineControls
from pushgraph.view.panel.pushes import PushControls
from pushgraph.view.panel.tracks import DeedControls, TrackControls
from pushgraph.view.session import Session

TABS = {
    "Pushes": (TrackControls, PushControls),
    "Plan": (GoalControls,),
    "Bodies": (BodyControls, JointControls),
    "Beliefs": (BeliefControls,),
    "Files": (FileControls,),
}


def add_panel(session: Session) -> dict[type, Any]:
    """Put every control into the page of a session; returns them by class."""
    made: dict[type, Any] = {DeedControls: DeedControls(session)}
    tabs = session.server.gui.add_tab_group()
    for label, classes in TABS.items():
        with tabs.add_tab(label):
            for controls in classes:
                made[controls] = controls(session)
            if label == "Bodies":
                made[OutlineControls] = OutlineControls(session, made[BodyControls])
    made[LegendControls] = LegendControls(session)
    return made
