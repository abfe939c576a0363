"""One effect of a model by itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.model import Model


@dataclass(frozen=True, eq=False)
class OneEffect:
    """Change of every reading by one effect of a model, at the start of its nuisance parameters."""

    model: Model
    name: str

    def change(self, values: Mapping[str, float]) -> Floats:
        """Return the change, shape (n,)."""
        start, predict = self.model.start, self.model.predict
        return np.asarray(predict(start, {self.name: values}) - predict(start, {}))

    def jacobian(self, values: Mapping[str, float]) -> Floats:
        """Return its derivative by each parameter, shape (n, k)."""
        return self.model.effect_jacobian(self.model.start, self.model.effect(self.name), values)
