"""Columns that are combinations of a few."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trunnion.base.units import Floats


@dataclass(frozen=True)
class Combined:
    """Columns that are combinations ``weights`` (m, q) of a few ``shared`` ones (q, n)."""

    weights: Floats
    shared: Floats

    @cached_property
    def products(self) -> Floats:
        """Inner products of the shared columns (q, q)."""
        return np.asarray(self.shared @ self.shared.T)

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, some: slice) -> Floats:
        return np.asarray(self.weights[some] @ self.shared)
