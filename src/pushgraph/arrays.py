"""One code for arrays of NumPy and of torch, which takes a second to import: it is not needed for NumPy's."""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

    Array = TypeVar("Array", np.ndarray, Tensor)
else:
    Array = TypeVar("Array")  # shapes and dtypes are checked of either


def is_tensor(array: Any) -> bool:
    """Whether an array is torch's."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(array, torch.Tensor)


def namespace(array: Any) -> ModuleType:
    """The functions for such an array: torch, or NumPy."""
    return sys.modules["torch"] if is_tensor(array) else np
