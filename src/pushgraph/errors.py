"""Errors of pushgraph: each message says what is wrong, where, and what is valid."""


class PushGraphError(Exception):
    """Base of every error that pushgraph raises on purpose."""


class SceneError(PushGraphError):
    """A scene, or the file it came from, is not valid."""


class TrackError(PushGraphError):
    """A track, or the file it came from, is not valid."""


class GeometryError(PushGraphError):
    """Shapes and poses that do not go together."""


class SimulationError(PushGraphError):
    """The simulator cannot run this scene."""


class ArmError(PushGraphError):
    """The arm cannot do a push: out of reach, beyond a limit, or in its own way."""


class SetupError(PushGraphError):
    """A setup is unknown, or cannot be drawn with these numbers."""


class OwnModuleError(PushGraphError):
    """A Python file that shall register something cannot be run."""


class ChoiceError(PushGraphError):
    """There is nothing of the name that a command was given."""


class DatasetError(PushGraphError):
    """A dataset cannot be written, continued or read."""


class StorageError(PushGraphError):
    """A file cannot be written; what stood there before still does."""


class ViewerError(PushGraphError):
    """A picture or an animation cannot be made."""


class CancelledError(ViewerError):
    """A person cancelled what was being done."""


class NetworkError(PushGraphError):
    """There is no such network, or it does not keep its contract."""


class CheckpointError(PushGraphError):
    """A checkpoint cannot be read, or is not what it says it is."""


class TrainingError(PushGraphError):
    """A training cannot begin, go on, or trust its numbers."""


class TrainingInterrupted(PushGraphError):
    """A training was asked to stop, and did; says how to go on."""


class DeviceError(PushGraphError):
    """There is no such device here."""


class PredictionError(PushGraphError):
    """A prediction is not possible, or came to nothing."""


class EvaluationError(PushGraphError):
    """An evaluation cannot be run as asked."""


class ReportError(PushGraphError):
    """A report cannot be made."""


class PlanningError(PushGraphError):
    """A goal, a tool or a plan is not possible."""


class EpisodeError(PushGraphError):
    """An environment cannot be made, begun or stepped as asked."""


class BeliefError(PushGraphError):
    """What was observed cannot be, or cannot be learnt from."""


class RealPushError(PushGraphError):
    """Recorded pushes, or the outlines of their objects, are not valid."""


class AdaptationError(PushGraphError):
    """Nothing can be learnt from these pushes, or an adaptation cannot be read."""


class MissingExtraError(PushGraphError, ImportError):
    """What is asked for needs packages that are not installed, and which extra brings them."""


class AssumptionWarning(UserWarning):
    """Something is predicted as if masses or frictions that a scene does not say were nominal."""


class RangeWarning(UserWarning):
    """A scene is unlike those that a predictor was checked on."""
