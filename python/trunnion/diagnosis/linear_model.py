"""A model from arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.errors import InputError
from trunnion.base.statistics import in_columns
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.effect import Effect, EffectLike
from trunnion.diagnosis.model import Covariate, Model, Nuisance, Readings
from trunnion.diagnosis.own_effects import with_own

EXACT_TOLERANCE = 1e-9


class LinearModel(Model):
    """A model from arrays: readings = design @ nuisance + effects + noise.

    Parameters
    ----------
    data:
        The measurement; handed to ``change`` of a user's own effects.
    readings, nuisance, design:
        n readings, p parameters, shape (n, p).
    effects:
        Candidate causes: built from arrays (:mod:`trunnion.diagnosis.effect`), or objects with
        ``change(data, values)``.
    covariates, components, groups, replicates:
        As in :class:`Model`; None: its defaults.
    binder:
        Makes this model from other data.
    """

    def __init__(
        self,
        data: Any,
        readings: Readings,
        nuisance: Sequence[Nuisance],
        design: ArrayLike,
        *,
        effects: Sequence[Effect | EffectLike] = (),
        covariates: Sequence[Covariate] | None = None,
        components: Mapping[str, Floats] | None = None,
        groups: ArrayLike | None = None,
        replicates: ArrayLike | None = None,
        binder: Callable[[Any], Model] | None = None,
    ) -> None:
        self.data = data
        self.readings = readings
        self.nuisance = tuple(nuisance)
        self.design = in_columns(np.asarray(design, dtype=np.float64))
        self.effects = with_own((), effects, data)
        self._covariates = covariates
        self._components = components
        self._groups = groups
        self._replicates = replicates
        self._binder = binder
        if self.design.shape != (expected := (len(readings), len(self.nuisance))):
            raise InputError(f"design: got shape {self.design.shape}, expected {expected}")

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """As given, or the order of the rows."""
        return super().covariates if self._covariates is None else tuple(self._covariates)

    @property
    def components(self) -> Mapping[str, Floats]:
        """As given, or every reading alike."""
        return super().components if self._components is None else self._components

    @property
    def groups(self) -> Integers:
        """As given, or five blocks of rows."""
        return super().groups if self._groups is None else np.asarray(self._groups, dtype=np.intp)

    @property
    def replicates(self) -> Integers | None:
        """As given, or none known."""
        return None if self._replicates is None else np.asarray(self._replicates, dtype=np.intp)

    @property
    def rank_tolerance(self) -> float:
        """Rounding: a design that is exact has no leftovers of second order."""
        return EXACT_TOLERANCE

    def base(self, nuisance: Floats) -> Floats:
        """Return design @ nuisance."""
        return self.design @ nuisance

    def base_jacobian(self, nuisance: Floats) -> Floats:  # noqa: ARG002
        """Return the design."""
        return self.design

    def bind(self, data: Any) -> Model:
        """Return the same model on other data."""
        if self._binder is None:
            raise InputError("this model cannot be bound to other data: it was given no binder")
        return self._binder(data)
