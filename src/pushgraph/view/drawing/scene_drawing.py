"""One scene in the browser, and what moves in it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np
import viser
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.belief_history import BeliefHistory
from pushgraph.errors import ArmError
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.planning.goal import Goal
from pushgraph.scene import Scene
from pushgraph.track import LIFTED, Track
from pushgraph.view.drawing.arm import DrawnArm
from pushgraph.view.drawing.beliefs import BeliefLinks
from pushgraph.view.drawing.bodies import Bodies, Grip
from pushgraph.view.drawing.contact_arrows import ContactArrows
from pushgraph.view.drawing.forces import ForceArrow
from pushgraph.view.drawing.goal import DrawnGoal
from pushgraph.view.drawing.names import View
from pushgraph.view.drawing.placing import frame_at, placed, start_of
from pushgraph.view.drawing.probability_board import ProbabilityBoard
from pushgraph.view.drawing.spread import SpreadEllipses
from pushgraph.view.drawing.table import FIELD, DrawnTable, view_of
from pushgraph.view.drawing.tool import DrawnPushes, DrawnTool
from pushgraph.view.drawing.trails import Trails
from pushgraph.view.known_forces import KnownForces

MOST_SHADOWS = 20
"""More bodies cast none: every shadow is drawn several times over."""
RENAMED = 0.3
"""Names are placed anew so often in a track (s)."""


class SceneDrawing:
    """Draws into the scene of a viser server: the scene, and on it what else is shown.

    Every `show_...` replaces what it showed before, and with None removes it. What is drawn already and has not changed
    is neither sent nor computed again, so a moved push costs only its arrow. Not thread-safe: the caller holds a lock.
    """

    def __init__(self, server: viser.ViserServer, root: str = "/view") -> None:
        """root: name of the node under which everything is drawn."""
        api = server.scene
        self._server = server
        self._table = DrawnTable(api, f"{root}/table")
        self._bodies = Bodies(api, f"{root}/bodies")
        self._tool = DrawnTool(api, f"{root}/tool")
        self._pushes = DrawnPushes(api, f"{root}/pushes")
        self._trails = Trails(api, f"{root}/trails")
        self._spread = SpreadEllipses(api, f"{root}/spread")
        self._force = ForceArrow(api, f"{root}/force")
        self._contact_forces = ContactArrows(api, f"{root}/contact_forces")
        self._ghosts = Bodies(api, f"{root}/ghosts", ghost=True)
        self._outcome = Bodies(api, f"{root}/outcome/bodies", ghost=True)
        self._outcome_trails = Trails(api, f"{root}/outcome/trails")
        self._outcome_spread = SpreadEllipses(api, f"{root}/outcome/spread")
        self._links = BeliefLinks(api, f"{root}/links")
        self._board = ProbabilityBoard(api, f"{root}/probabilities")
        self._drawn_goal = DrawnGoal(api, f"{root}/goal")
        self._arm = DrawnArm(api, f"{root}/arm")
        self._shadows: bool | None = None
        self._forget()

    def _forget(self) -> None:
        self.scene: Scene | LeverScene | None = None
        self.track: Track | LeverTrack | None = None
        self.ghost: Track | LeverTrack | None = None
        self.history: BeliefHistory | None = None
        self.goal: Goal | None = None
        self.outcome: Track | None = None
        self._view: View | None = None
        self._seen: View | None = None
        self._named = -np.inf
        self._frame = 0

    def show_scene(self, scene: Scene | LeverScene) -> None:
        """Table, bodies at their poses with names, joints, tool and pushes; the track before is removed.

        So is all else, if it was of other bodies.
        """
        with self._server.atomic():
            before = self.scene
            if before is None or before.names != scene.names or type(before) is not type(scene):
                self.clear()
                self._view = view_of(scene)
                self._look(self._view, move=before is not None and not set(before.names) & set(scene.names))
            elif self.track is not None:
                self.show_track(None)
            self._draw_scene(scene)
            self._place()
            self.place_names()

    def move_bodies(self, scene: Scene) -> None:
        """Bring the bodies to where they are in the scene, which is otherwise the one shown: for what a drag shows."""
        with self._server.atomic():
            self._bodies.move(start_of(scene)[1:])

    def show_track(self, track: Track | LeverTrack | None) -> None:
        """Move bodies and tool as this track, with trails, the force on the tool and the spread, if it has them.

        Shows the track's scene, from its first frame; None: the scene as it starts.
        """
        with self._server.atomic():
            self.track, self._frame = None, 0
            if track is not None:
                self.show_scene(track.scene)
                self._trails.show(track, [body.colour for body in self._bodies.drawn])
            else:
                self._trails.clear()
            self.track = track
            planar = track if isinstance(track, Track) else None
            _show_or_clear(self._spread, planar if planar is not None and planar.spread is not None else None)
            _show_or_clear(self._force, planar if planar is not None and planar.wrench is not None else None)
            self._contact_forces.clear()
            self._place()
            self.place_names()

    def show_forces(self, known: KnownForces | None) -> None:
        """The forces at every contact of the track that moves."""
        with self._server.atomic():
            if known is None or not isinstance(self.track, Track):
                self._contact_forces.clear()
            else:
                self._contact_forces.show(self.track, known, self._force.newtons)
                self._contact_forces.at(self._frame)

    def show_ghost(self, track: Track | LeverTrack | None) -> None:
        """A second track of the same bodies, as translucent copies that move along at the same times (s)."""
        with self._server.atomic():
            self.ghost = track
            if track is None:
                self._ghosts.clear()
            else:
                self._ghosts.show(track.scene, self._seen_from(track.scene))
                self._place()

    def show_outcome(self, track: Track | None) -> None:
        """Where a track ends: translucent copies, trails and ellipses of the spread, whatever the frame.

        What a dragged push is predicted to do is shown with this.
        """
        with self._server.atomic():
            self.outcome = track
            if track is None:
                self._outcome.clear()
                self._outcome_trails.clear()
            else:
                self._outcome.show(track.scene, self._seen_from(track.scene))
                ends = placed(track, len(track.times) - 1)[1:]
                moved = np.abs(ends - placed(track, 0)[1:]).max(-1) > 1e-4
                self._outcome.move(np.where(moved[:, None], ends, np.nan))
                if track is self.track:  # whose trails are there already
                    self._outcome_trails.clear()
                else:
                    self._outcome_trails.show(track, [body.colour for body in self._outcome.drawn])
            stated = track if track is not None and track.spread is not None else None
            _show_or_clear(self._outcome_spread, stated)
            if stated is not None:
                self._outcome_spread.at(len(stated.times) - 1)

    def show_belief(self, history: BeliefHistory | None) -> None:
        """Links between the bodies in the colours of their likeliest joints, and a board of probabilities over time."""
        with self._server.atomic():
            self.history = history
            if history is None:
                self._links.clear()
                self._board.clear()
                return
            if self.scene is None or self.scene.names != history.scene.names:
                self.show_scene(history.scene)
            self._links.show(history)
            self._board.show(history, self._seen_from(history.scene))
            self._place()

    def show_goal(self, goal: Goal | None) -> None:
        """Where a body of the scene is to go."""
        self.goal = goal if isinstance(self.scene, Scene) else None
        if goal is None or not isinstance(self.scene, Scene):
            self._drawn_goal.clear()
        else:
            self._drawn_goal.show(self.scene, goal)

    def show_arm(self, trajectory: JointTrajectory | None) -> None:
        """The arm's joints move as this from the first frame of the track on; None: as the tool's poses demand.

        A scene that says which arm holds the tool shows it by itself.
        """
        with self._server.atomic():
            if isinstance(self.scene, Scene) and (trajectory is not None or self.scene.arm is not None):
                self._arm.show(self.scene, trajectory)
                self._place()

    def look_from(self, position: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]) -> None:
        """Place the names anew, for who looks from a position at a target (m), unless that is straight down."""
        if self._view is not None and np.hypot(*(target - position)[:2]) > 1e-3:
            self._seen = self._view._replace(position=tuple(position.tolist()), target=tuple(target.tolist()))
            self.place_names()

    def place_names(self) -> None:
        """Place the names anew, for where the bodies are now."""
        view = self._seen or self._view
        if self.scene is not None and view is not None:
            with self._server.atomic():
                self._named = float(self.times[self._frame])
                self._bodies.place_names(self._poses()[1:], view)

    def set_frame(self, frame: int) -> None:
        """Show this frame of the track (of the beliefs, if there is no track), from 0 to `len(times) - 1`."""
        self._frame = min(max(frame, 0), len(self.times) - 1)
        with self._server.atomic():
            self._place()
            if abs(self.times[self._frame] - self._named) >= RENAMED:
                self.place_names()

    def set_time(self, time: float) -> None:
        """Show the last frame that is not later than a time (s)."""
        self.set_frame(frame_at(self.times, time))

    @property
    def frame(self) -> int:
        """The frame shown."""
        return self._frame

    @property
    def times(self) -> Float[np.ndarray, " frames"]:
        """Of the frames (s): those of the track, else of the beliefs, else [0]."""
        shown = self.track if self.track is not None else self.history
        return np.zeros(1) if shown is None else shown.times

    @property
    def push_times(self) -> Mapping[int, float]:
        """When each push of the track begins (s), by its number from 1 on, as they are drawn."""
        if not isinstance(self.track, Track):
            return {}
        pushes, first = np.unique(self.track.push, return_index=True)
        begun = zip(pushes.tolist(), self.track.times[first].tolist(), strict=True)
        return {push + 1: time for push, time in begun if push != LIFTED}

    @property
    def shows_spread(self) -> bool:
        """Whether the track, or the outcome, states how far off it may be."""
        return self._spread.shown or self._outcome_spread.shown

    @property
    def newtons(self) -> float:
        """The force whose arrow is 10 cm long; 0 if none was measured."""
        return self._force.newtons

    @property
    def contact_forces(self) -> tuple[str, float]:
        """How the forces at contacts are known, empty if none are shown, and the force whose arrows are 10 cm long."""
        return self._contact_forces.source, self._contact_forces.newtons

    @property
    def grips(self) -> Sequence[Grip]:
        """The solids of the bodies, for `on_click` and `on_drag`; new ones after the bodies were changed."""
        return self._bodies.grips

    def clear(self) -> None:
        """Remove everything."""
        shown = (self._table, self._bodies, self._tool, self._pushes, self._trails, self._spread, self._force)
        self._contact_forces.clear()
        for part in (*shown, self._ghosts, self._links, self._board, self._drawn_goal, self._arm):
            part.clear()
        for part in (self._outcome, self._outcome_trails, self._outcome_spread):
            part.clear()
        self._forget()

    def _look(self, view: View, move: bool) -> None:
        """From where pages that open see it, and those that are open, too, if they shall move."""
        camera = self._server.initial_camera
        camera.look_at, camera.position, camera.fov = view.target, view.position, FIELD
        for client in self._server.get_clients().values() if move else ():
            client.camera.position, client.camera.look_at = view.position, view.target

    def _seen_from(self, scene: Scene | LeverScene) -> View:
        return self._view or view_of(scene)

    def _draw_scene(self, scene: Scene | LeverScene) -> None:
        view = self._seen_from(scene)
        self.scene = scene
        shadows = len(scene.bodies) <= MOST_SHADOWS
        if shadows != self._shadows:
            # Even where nothing casts one, they are computed for every pixel.
            self._server.scene.configure_default_lights(cast_shadow=shadows)
            self._shadows = shadows
        self._table.show(scene, shadows)
        self._bodies.show(scene, view, shadows)
        self._tool.show(scene)
        if isinstance(scene, Scene):
            self._pushes.show(scene, view)
            self._show_arm(scene)

    def _show_arm(self, scene: Scene) -> None:
        if scene.arm is None:
            self._arm.clear()
        else:
            with suppress(ArmError):  # the extra with its meshes is not installed: then the tool is shown alone
                self._arm.show(scene)

    def _poses(self) -> Float[np.ndarray, "nodes 7"]:
        """Of tool and bodies in the frame."""
        assert self.scene is not None
        return start_of(self.scene) if self.track is None else placed(self.track, self._frame)

    def _place(self) -> None:
        """Bring everything to the frame."""
        if self.scene is None:
            return
        time = float(self.times[self._frame])
        poses = self._poses()
        lift = self._arm.at(time - float(self.times[0]), poses[0])
        if lift is not None:
            poses[0, 2] = lift
        self._bodies.move(poses[1:])
        self._tool.move(poses[0])
        if self.ghost is not None:
            self._ghosts.move(placed(self.ghost, frame_at(self.ghost.times, time))[1:])
        self._spread.at(self._frame)
        self._force.at(self._frame)
        self._contact_forces.at(self._frame)
        if self.history is not None:
            frame = frame_at(self.history.times, time)
            middles = np.array([body.middle for body in self._bodies.drawn])
            self._links.at(frame, pose_3d.transform(poses[1:], middles))
            self._board.at(frame)


def _show_or_clear(part: SpreadEllipses | ForceArrow, track: Track | None) -> None:
    if track is None:
        part.clear()
    else:
        part.show(track)
