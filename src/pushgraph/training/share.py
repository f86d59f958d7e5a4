"""Random numbers of a share of a batch: drawn for the whole, so that they do not depend on who shares it."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Draws:
    """Draws numbers for the rows `share` of a batch of `whole` rows, on the processor."""

    generator: torch.Generator
    whole: int
    share: slice

    @classmethod
    def of(cls, seed: int, whole: int, share: slice = slice(None)) -> "Draws":
        """Draws from a seed."""
        return cls(torch.Generator().manual_seed(seed), whole, share)

    def uniform(self, *shape: int) -> Tensor:
        """From 0 to 1, [share *shape]."""
        return torch.rand(self.whole, *shape, generator=self.generator)[self.share]

    def normal(self, *shape: int) -> Tensor:
        """Of the standard normal distribution, [share *shape]."""
        return torch.randn(self.whole, *shape, generator=self.generator)[self.share]

    def signs(self) -> Tensor:
        """-1 or 1, [share]."""
        return (1.0 - 2.0 * torch.randint(2, (self.whole,), generator=self.generator))[self.share]
