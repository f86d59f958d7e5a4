"""Arrays from outside, NumPy's or torch's, as the tensors that are computed with; errors name shape and dtype."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from pushgraph.errors import PredictionError, PushGraphError

Values = Tensor | np.ndarray


def checked(
    name: str,
    values: Values,
    shape: Sequence[int | str],
    kind: str,
    like: Tensor,
    error: type[PushGraphError] = PredictionError,
    may_lack: bool = False,
) -> Tensor:
    """The values as a tensor where `like` is.

    shape: what each dimension must be; a word names one that may be anything. kind: "real" for floating point, "bool".
    may_lack: whether NaN is valid. Raises the error if the values have another shape or dtype, or are not numbers.
    """
    if not isinstance(values, Tensor | np.ndarray):
        raise error(f"{name}: must be an array of NumPy or torch, got {type(values).__name__}")
    if isinstance(values, np.ndarray):
        if values.dtype.kind not in "fiub":
            raise error(f"{name}: dtype must be {_said(kind)}, got {values.dtype}")
        values = torch.from_numpy(np.ascontiguousarray(values))
    if values.is_floating_point() != (kind == "real") or (kind == "bool" and values.dtype != torch.bool):
        raise error(f"{name}: dtype must be {_said(kind)}, got {str(values.dtype).removeprefix('torch.')}")
    fits = [isinstance(one, str) or one == length for one, length in zip(shape, values.shape, strict=False)]
    if values.dim() != len(shape) or not all(fits):
        raise error(f"{name}: shape must be ({', '.join(map(str, shape))}), got {tuple(values.shape)}")
    if kind == "real" and not may_lack and values.isnan().any():
        first = tuple(values.isnan().nonzero()[0].tolist())
        raise error(f"{name}: must hold no NaN; there is one at {first}")
    return values.to(like.device)


def _said(kind: str) -> str:
    return "bool" if kind == "bool" else "floating point"
