"""Beliefs, learnt push by push, and corrected."""

import html

from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.scene import Scene
from pushgraph.view.panel.controls import NONE, Controls, offer_pair
from pushgraph.view.session import block
from pushgraph.view.work import Work

AS_SEEN = "as seen"
MOST_PAIRS = 12
DOUBT = 0.005
"""Pairs that are surer not joined are told together."""


class BeliefControls(Controls):
    """Watch one push more of the track, and say what is wrong with what is believed."""

    def make(self) -> None:
        """Add the controls where the GUI stands."""
        self.buttons(
            "Watch",
            {"Next push": self._step, "Forget": self.workbench.forget},
            "Watch one push more of what was opened, simulated or predicted; begin anew",
        )
        self.told = self.gui.add_html("")
        self.believed = self.gui.add_checkbox(
            "predict so", False, hint="With the joints that are believed, and the doubt"
        )
        self.on_change(self.believed, self._believe)
        self.gui.add_divider()
        self.one = self.gui.add_dropdown("Bodies", (NONE,))
        self.other = self.gui.add_dropdown("and", (NONE,))
        self.kind = self.gui.add_dropdown("are joined", (*JOINT_CODES, AS_SEEN))
        self.buttons("by hand", {"Correct": self._correct}, "From now on this is known of the two")

    def refresh(self) -> None:
        """Tell what is believed."""
        scene, work = self.workbench.scene, self.workbench.work
        names = scene.names if isinstance(scene, Scene) else ()
        offer_pair(self.one, self.other, names)
        self.told.content = _told(work)

    def _step(self) -> str:
        self.session.say("Watching; the first time the networks are loaded, which takes some seconds.")
        self.session.server.flush()
        self.workbench.step_belief(self.session.working.tell)
        watching = self.workbench.work.watching
        if watching is None:
            return ""
        self.session.show_next = float(watching.frames.times[watching.done - 1])
        return f"{watching.done} of {watching.end} frames were watched."

    def _believe(self) -> None:
        self.session.believed = bool(self.believed.value)
        self.workbench.predict(self.session.believed)

    def _correct(self) -> None:
        kind = None if self.kind.value == AS_SEEN else self.kind.value
        self.workbench.correct_belief(self.one.value, self.other.value, kind)


def _told(work: Work) -> str:
    """What is believed of the pairs of which most is believed, as HTML."""
    history = work.history
    if history is None:
        return block("Nothing was watched yet.")
    last, kinds = history.probabilities[-1], list(JOINT_CODES)
    rows = []
    doubted = [row for row in (-last[:, 1:].max(1)).argsort(kind="stable").tolist() if last[row, 0] < 1 - DOUBT]
    for row in doubted[:MOST_PAIRS]:
        one, other = map(html.escape, history.pairs[row])
        cells = "".join(f'<td style="text-align:right">{100 * share:.0f}</td>' for share in last[row])
        rows.append(f"<tr><td>{one} - {other}</td>{cells}</tr>")
    head = "".join(f"<th>{kind}</th>" for kind in kinds)
    others = len(last) - len(rows)
    rows.append(f'<tr><td colspan="5">{others} more {"pairs" * bool(rows)}</td></tr>' * bool(others))
    table = f"<tr><th>%</th>{head}</tr>{''.join(rows)}"
    return f'<table style="font-size:0.8em;width:100%;padding:0 0.75em">{table}</table>'
