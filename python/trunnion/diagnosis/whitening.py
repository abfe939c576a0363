"""Making the noise of readings white, of one size."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from numpy.typing import NDArray

from trunnion.base.units import Floats

Whiten: TypeAlias = Callable[[NDArray[Any]], NDArray[Any]]


def identity(columns: Floats) -> Floats:
    """Whiten noise that is white already."""
    return columns


@dataclass(frozen=True, eq=False)
class Scaling:
    """Whiten readings of different noise: divide each by its own, ``scale`` (n,)."""

    scale: Floats

    def __call__(self, columns: Floats) -> Floats:
        """Divide columns (n, ...)."""
        return columns / self.scale.reshape(-1, *(1,) * (columns.ndim - 1))
