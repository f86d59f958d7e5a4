"""What people try out on one scene beyond editing it: predictions, simulations, beliefs, plans, files; no browser."""

import dataclasses
import warnings
from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from pushgraph.belief_history import BeliefHistory, Watching
from pushgraph.errors import AssumptionWarning, BeliefError, PlanningError, SceneError
from pushgraph.lever_physics import LeverPredictor
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning import planner
from pushgraph.planning.dynamics import learned
from pushgraph.planning.sampling import Sampling
from pushgraph.plausibility import assumptions, remarks
from pushgraph.scene import Scene
from pushgraph.simulation.lever import simulate_lever
from pushgraph.simulation.planar import simulate
from pushgraph.storage import replacing
from pushgraph.track import Track
from pushgraph.view.editing import Editing
from pushgraph.view.folder import Folder
from pushgraph.view.known_forces import KnownForces, forces_of
from pushgraph.view.opening import Opened, open_file
from pushgraph.view.work import MOST_FRAMES, AnyTrack, alike, check_length, end_of_push, like, work_on
from pushgraph.view.working import Progress

PREDICTED, SIMULATED = "Predicted", "Simulated"
SAVED = {"scene": ".json", "predicted": ".h5", "simulated": ".h5", "beliefs": ".json", "plan": ".json"}
"""What can be saved, and how the names of such files end."""


class Workbench(Editing):
    """The state that all browsers share. What is refused raises a PushGraphError and leaves everything as it was.

    folder: where `save` and `load` find files by name.
    """

    def __init__(self, shown: Opened, folder: Folder, title: str = "scene", compare: AnyTrack | None = None) -> None:
        work = work_on(shown, title)
        if compare is not None:
            work = dataclasses.replace(work, tracks=dict(work.tracks) | {"Compared": like(work, compare)})
        super().__init__(work)
        self.folder = folder
        self._foreseen: Track | None = None
        self._forces: tuple[Track, KnownForces] | None = None

    def foreseen(self, scene: Scene) -> Track:
        """What a scene's pushes are predicted to do, with the spread; changes nothing.

        Asked for the same again, as at the end of a drag, it answers at once.
        """
        if self._foreseen is not None and self._foreseen.scene == scene:
            return self._foreseen
        check_length(scene)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AssumptionWarning)
            self._foreseen = self._predictor.predict(scene, spread=self._predictor.states_spread)
        return self._foreseen

    def predict(self, believed: bool = False) -> None:
        """Predict the scene's pushes; believed: with the joints that are believed, as surely as they are."""
        scene = self.work.scene
        if isinstance(scene, LeverScene):
            check_length(scene)
            self._add_track(PREDICTED, self._lever_predictor.predict(scene))
        elif not believed:
            self._add_track(PREDICTED, self.foreseen(scene))
        else:
            history = self._history
            check_length(scene)
            beliefs = dict(zip(history.pairs, history.probabilities[-1], strict=True))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AssumptionWarning)
                track = self._predictor.predict(history.apply_to(scene), spread=True, beliefs=beliefs)
            self._add_track(PREDICTED, dataclasses.replace(track, scene=scene))

    def simulate(self, progress: Progress = lambda done, total: None) -> None:
        """Simulate the scene's pushes in MuJoCo, with nominal values for what it does not say."""
        scene = self.work.scene
        frames = check_length(scene)
        if isinstance(scene, LeverScene):
            self._add_track(SIMULATED, simulate_lever(scene))
        else:
            track = simulate(scene.with_nominal_values(), lambda frame: progress(frame, frames))
            self._add_track(SIMULATED, dataclasses.replace(track, scene=scene))

    def plan(self, pushes: int = 1, progress: Progress = lambda done, total: None) -> None:
        """Choose at most so many pushes that bring the goal's body there; they replace those of the scene."""
        scene, goal = self.planar, self.work.goal
        if goal is None:
            raise PlanningError("there is no goal yet: say which body shall be where")
        known = scene.replace(pushes=()).with_nominal_values()
        dynamics = learned(self._predictor, spread=self._predictor.states_spread)
        sampling = Sampling(pushes=max(1, min(int(pushes), 4)))
        planned = planner.plan(known, goal, dynamics, sampling=sampling, progress=progress)
        if not planned.pushes:
            raise PlanningError(f"no push that was tried brings {goal.body!r} nearer to its goal than it is")
        pushed = scene.replace(pushes=planned.pushes)
        self._become(scene=pushed, tracks={PREDICTED: self.foreseen(pushed)}, plan=planned, watching=None)

    def forces(self, track: Track) -> KnownForces:
        """The forces at the contacts of one of the tracks, computed when they are first asked for."""
        if self._forces is None or self._forces[0] is not track:
            history, scene = self.work.history, self.work.scene
            check_length(track.scene)
            believed = [history.apply_to(scene)] if history is not None and isinstance(scene, Scene) else []
            self._forces = track, forces_of(track, self._predictor, believed)
        return self._forces[1]

    # Beliefs.

    def step_belief(self, progress: Progress = lambda done, total: None) -> None:
        """Watch one push more of the track: what was opened, or simulated, or predicted."""
        scene, watching = self.planar, self.work.watching
        watching = Watching(scene, self._watched_track()) if watching is None else watching.copied()
        if watching.done == watching.end:
            raise BeliefError("the whole track was watched; nothing of it is left")
        begin, end = watching.done, end_of_push(watching)
        watching.until(end, lambda frame, regulator: progress(frame - begin, end - begin))
        self._become(watching=watching, history=watching.history())

    def correct_belief(self, one: str, other: str, kind: str | None) -> None:
        """Say how two bodies are joined: none, fixed, prismatic or revolute; None: as it was seen."""
        if self.work.watching is None:
            raise BeliefError("nothing was watched yet: step the beliefs first")
        watching = self.work.watching.copied()
        watching.correct((one, other), kind)
        self._become(watching=watching, history=watching.history())

    def forget(self) -> None:
        """Begin to watch anew."""
        self._become(watching=None, history=None)

    # Files.

    def save(self, what: str, name: str, replace: bool = False) -> Path:
        """Write scene, predicted, simulated, beliefs or plan, as the file that the command line takes."""
        if what not in SAVED:
            raise SceneError(f"save: no {what!r}; valid: {', '.join(SAVED)}")
        path = self.folder.to_write(name, SAVED[what], replace)
        self._saver(what)(path)
        return path

    def load(self, name: str) -> None:
        """Read a scene, a track, beliefs or a plan; a CSV track is one of this scene."""
        opened = open_file(self.folder.to_read(name), self.work.scene)
        if isinstance(opened, BeliefHistory) and isinstance(self.work.scene, Scene):
            if opened.scene.names == self.work.scene.names:
                self._become(history=opened, watching=None)
                return
        elif isinstance(opened, Track | LeverTrack) and alike(opened.scene, self.work.scene) and self.work.tracks:
            self._become(tracks=dict(self.work.tracks) | {name: opened}, watching=None)
            return
        self._become(**vars(work_on(opened, name)))

    def remarks(self) -> list[str]:
        """What is assumed of the scene, and what is doubtful about its tracks, a sentence each."""
        if isinstance(self.work.scene, LeverScene):
            return []
        said = assumptions(self.work.scene)
        for title, track in self.work.tracks.items():
            if isinstance(track, Track) and len(track.times) <= MOST_FRAMES:
                said += [f"{title}: {remark}" for remark in remarks(track)]
        return said

    @cached_property
    def _predictor(self) -> PhysicsPredictor:
        return PhysicsPredictor.load()

    @cached_property
    def _lever_predictor(self) -> LeverPredictor:
        return LeverPredictor.load()

    @property
    def _history(self) -> BeliefHistory:
        if self.work.history is None:
            raise BeliefError("there are no beliefs yet: step them through a track, or load some")
        return self.work.history

    def _add_track(self, title: str, track: AnyTrack) -> None:
        """What follows from the scene is not undone by itself."""
        self.work = dataclasses.replace(self.work, tracks=dict(self.work.tracks) | {title: track})

    def _watched_track(self) -> Track:
        opened = [title for title in self.work.tracks if title not in (PREDICTED, SIMULATED)]
        for title in (*opened, SIMULATED, PREDICTED):
            track = self.work.tracks.get(title)
            if isinstance(track, Track):
                return track
        raise BeliefError("there is no track to watch: simulate or predict the scene, or load one")

    def _save_scene(self, path: Path) -> None:
        with replacing(path) as temporary:
            temporary.write_text(self.work.scene.to_json() + "\n")

    def _saver(self, what: str) -> Callable[[Path], object]:
        work = self.work
        if what == "scene":
            return self._save_scene
        if what == "beliefs":
            return self._history.save
        if what == "plan":
            if work.plan is None:
                raise PlanningError("there is no plan of this scene: set a goal and plan")
            return work.plan.save
        track = work.tracks.get(what.capitalize())
        if track is None:
            raise SceneError(f"the scene was not {what} as it is now")
        return track.save
