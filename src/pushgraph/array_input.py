"""Arrays from outside, NumPy's or torch's, as the tensors that are computed with; errors name shape and dtype."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from pushgraph.errors import PredictionError

Values = Tensor | np.ndarray


def checked(name: str, values: Values, shape: Sequence[int | str], kind: str, like: Tensor) -> Tensor:
    """The values as a tensor where `like` is.

    shape: what each dimension must be; a word names one that may be anything. kind: "real" for floating point, "bool".
    Raises PredictionError if the values have another shape or dtype, or are not numbers.
    """
    if not isinstance(values, Tensor | np.ndarray):
        raise PredictionError(f"{name}: must be an array of NumPy or torch, got {type(values).__name__}")
    if isinstance(values, np.ndarray):
        if values.dtype.kind not in "fiub":
            raise PredictionError(f"{name}: dtype must be {_said(kind)}, got {values.dtype}")
        values = torch.from_numpy(np.ascontiguousarray(values))
    if values.is_floating_point() != (kind == "real") or (kind == "bool" and values.dtype != torch.bool):
        raise PredictionError(f"{name}: dtype must be {_said(kind)}, got {str(values.dtype).removeprefix('torch.')}")
    fits = [isinstance(one, str) or one == length for one, length in zip(shape, values.shape, strict=False)]
    if values.dim() != len(shape) or not all(fits):
        raise PredictionError(f"{name}: shape must be ({', '.join(map(str, shape))}), got {tuple(values.shape)}")
    if kind == "real" and values.isnan().any():
        first = tuple(values.isnan().nonzero()[0].tolist())
        raise PredictionError(f"{name}: must hold no NaN; there is one at {first}")
    return values.to(like.device)


def _said(kind: str) -> str:
    return "bool" if kind == "bool" else "floating point"
