"""Many pushes of one scene, each by itself from its start: what goes in, and what comes out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from pushgraph.errors import PredictionError, SceneError
from pushgraph.scene import Scene
from pushgraph.tool import Push
from pushgraph.track import Track


@dataclass(frozen=True, eq=False)
class PushPredictions:
    """What each of many pushes does to a scene.

    poses: pose_world_from_body of every body at the end of each push, x, y (m), yaw (rad); NaN where a push is refused.
    refused: why, by the push's number: its tool comes down on a body, or it is none that the scene can have. tracks:
    frame by frame, None where a push is refused. `predictions["box"]` is one body's ends, [pushes 3].
    """

    scene: Scene
    pushes: tuple[Push, ...]
    poses: Float[np.ndarray, "pushes bodies 3"]
    tracks: tuple[Track | None, ...] = field(repr=False)
    refused: Mapping[int, str] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies, in the order of `poses`."""
        return self.scene.names

    def __len__(self) -> int:
        return len(self.pushes)

    def __getitem__(self, body: str) -> Float[np.ndarray, "pushes 3"]:
        """Where a body ends, for every push; raises PredictionError if there is no such body."""
        if body not in self.names:
            raise PredictionError(f"no body {body!r}; valid: {', '.join(self.names)}")
        return self.poses[:, self.names.index(body)]


def pushes_of(pushes: Sequence[Push] | np.ndarray, speed: float | None = None) -> tuple[Push, ...]:
    """Pushes as they are, or of an array [pushes points 2 or 3]: way-points x, y (m) and yaw (rad), the start first.

    speed: of those of an array (m/s), a push's own default if None. Raises PredictionError if they are none.
    """
    if isinstance(pushes, Sequence) and not (len(pushes) and isinstance(pushes[0], Sequence)):
        for index, push in enumerate(pushes):
            if not isinstance(push, Push):
                raise PredictionError(f"pushes[{index}]: must be a Push, got {type(push).__name__}")
        if speed is not None and len(pushes):
            raise PredictionError("speed: pushes have their own; it goes with an array of way-points")
        return tuple(pushes)
    points = np.asarray(pushes)
    if points.dtype.kind not in "fiu":
        raise PredictionError(f"pushes: dtype must be a real number's, got {points.dtype}")
    if points.ndim != 3 or points.shape[1] < 2 or points.shape[2] not in (2, 3):
        raise PredictionError(
            f"pushes: shape must be (pushes, points, 2) or (pushes, points, 3), with two points at least, the start "
            f"first; got {points.shape}"
        )
    given: dict[str, Any] = {} if speed is None else {"speed": speed}
    return tuple(_push_along(index, way, given) for index, way in enumerate(points.astype(float)))


def _push_along(index: int, way: Float[np.ndarray, "points columns"], given: Mapping[str, Any]) -> Push:
    if not np.isfinite(way).all():
        raise PredictionError(f"pushes[{index}]: must be finite, got {way.tolist()}")
    yaw = way[:, 2].tolist() if way.shape[1] == 3 else [0.0] * len(way)
    start, *others = way[:, :2].tolist()
    fields = {"start": tuple(start), "yaw": yaw[0], **given}
    if len(others) == 1:
        fields |= {"end": tuple(others[0]), "rotation": yaw[1] - yaw[0]}
    else:
        fields["path"] = tuple((x, y, turned) for (x, y), turned in zip(others, yaw[1:], strict=True))
    try:
        return Push(**fields)
    except SceneError as error:
        raise PredictionError(f"pushes[{index}]: {error}") from None
