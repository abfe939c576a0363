"""What every model of the diagnosis engine promises, as checks that take any model.

A kind of data of one's own is checked by ``check_model(model, setup)``; see
``test_model_contract.py`` and ``test_extensions.py``.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import trunnion as tn
from trunnion.base.units import unit_of
from trunnion.compensation import volumetric_error
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.model import Covariate, Model, Uncertainty
from trunnion.diagnosis.structure import model_with
from trunnion.diagnosis.ways import ANGLE_UNIT, is_angle
from trunnion.machine.effects import Owner
from trunnion.models.kinds import model_of

Floats = NDArray[np.float64]

SIZE = 5.0  # of nuisance parameters and effects, µm, arcsec, ppm: second order below the noise


def somewhere(model: Model) -> Floats:
    """Nuisance values a little off the start."""
    rng = np.random.default_rng(3)
    return np.asarray(model.start) + SIZE * rng.standard_normal(len(model.nuisance))


def values_of(effect: Effect, linear: float = 1.0) -> dict[str, float]:
    """Linear parameters of one size, the others in the middle of their grids."""
    return {p.name: linear if p.linear else p.grid[len(p.grid) // 2] for p in effect.parameters}


def close(one: Any, other: Any, relative: float) -> bool:
    """Whether arrays differ by less than a part of the larger, or than rounding of readings."""
    size = max(float(np.abs(one).max(initial=0.0)), float(np.abs(other).max(initial=0.0)))
    return bool(np.abs(np.asarray(one) - other).max(initial=0.0) <= relative * size + 1e-7)


def slope(
    f: Callable[[Mapping[str, float]], Any], values: dict[str, float], name: str, step: float
) -> Floats:
    """Difference quotient of a function of named values."""
    up = np.asarray(f({**values, name: values[name] + step}))
    down = np.asarray(f({**values, name: values[name] - step}))
    return np.asarray((up - down) / (2 * step))


# --- the checks


def check_shapes(model: Model, setup: Any) -> None:  # noqa: ARG001
    """Everything has one entry a reading, and whitening keeps shapes and readings' groups."""
    n, p = len(model.readings), len(model.nuisance)
    start = model.start
    assert start.shape == (p,)
    assert model.readings.values.shape == model.readings.rows.shape == (n,)
    assert model.predict(start, {}).shape == (n,)
    assert model.jacobian(start, {}).shape == (n, p)
    assert model.groups.shape == (n,)
    assert len(np.unique(model.groups)) > 1
    assert model.replicates is None or model.replicates.shape == (n,)
    assert all(np.shape(c.values) == (n,) for c in model.covariates)
    assert all(np.shape(c) == (n,) for c in model.components.values())
    assert set(model.location_errors(start, {})) <= {x.name for x in model.nuisance}
    residuals = model.readings.values - model.predict(start, {})
    whiten = model.whitener(residuals)
    pair = np.stack([residuals, np.ones(n)], axis=1)
    assert whiten(pair).shape == (n, 2)
    assert close(whiten(pair)[:, 0], whiten(residuals), 1e-12)
    for group in np.unique(model.groups):
        mine = model.groups == group
        assert not np.any(np.abs(whiten(np.where(mine, residuals, 0.0))[~mine]) > 1e-12)


def check_nuisance_derivative(model: Model, setup: Any) -> None:  # noqa: ARG001
    """``jacobian`` is the difference quotient of ``predict``."""
    at = somewhere(model)
    exact = model.jacobian(at, {})
    for k, x in enumerate(model.nuisance):
        step = np.zeros(len(at))
        step[k] = 0.5
        difference = model.predict(at + step, {}) - model.predict(at - step, {})
        assert close(difference, exact[:, k], 1e-5), x.name


def check_effect_derivatives(model: Model, setup: Any) -> None:  # noqa: ARG001
    """So are the columns of every effect, by itself and beside the nuisance."""
    start, at = np.asarray(model.start), somewhere(model)
    for effect in model.effects:
        values = values_of(effect)
        own = effect.columns(values)
        exact = model.effect_jacobian(start, effect, values)
        beside = model.effect_jacobian(at, effect, values)
        assert own.shape == exact.shape == (len(model.readings), len(effect.parameters))
        for k, p in enumerate(effect.parameters):
            step = 1e-2
            if not p.linear:
                step = 1e-5 * max(abs(values[p.name]), 0.01 * max(map(abs, p.grid)))
            said = f"{effect.id}.{p.name}"
            alone = slope(effect.change, values, p.name, step)
            assert close(alone, own[:, k], 1e-3), said

            def there(v: Mapping[str, float], name: str = effect.id) -> Floats:
                return model.predict(start, {name: v})

            def here(v: Mapping[str, float], name: str = effect.id) -> Floats:
                return model.predict(at, {name: v})

            assert close(slope(there, values, p.name, step), exact[:, k], 1e-3), said
            assert close(slope(here, values, p.name, step), beside[:, k], 1e-3), said


def check_zero_at_zero(model: Model, setup: Any) -> None:  # noqa: ARG001
    """An effect of no size changes nothing, wherever its other parameters are."""
    for effect in model.effects:
        change = np.asarray(effect.change(values_of(effect, 0.0)))
        assert change.shape == (len(model.readings),)
        assert not np.any(change), effect.id


def check_bound_to_its_own_data(model: Model, setup: Any) -> None:  # noqa: ARG001
    """Bound to its own data again a model predicts the same."""
    again = model.bind(model.data)
    at = somewhere(model)
    assert [x.name for x in again.nuisance] == [x.name for x in model.nuisance]
    assert [e.id for e in again.effects] == [e.id for e in model.effects]
    assert np.array_equal(again.readings.values, model.readings.values)
    for effect, other in zip(model.effects, again.effects, strict=True):
        values = values_of(effect)
        assert close(
            again.predict(at, {other.id: values}), model.predict(at, {effect.id: values}), 1e-12
        ), effect.id


def check_bound_to_other_data(model: Model, setup: Any) -> None:  # noqa: ARG001
    """Bound to the first half of the rows, effects change these and no others."""
    half = model.data[np.arange(len(model.data)) < len(model.data) // 2]
    other = model.bind(half)
    known = {e.id for e in model.effects}
    assert 0 < len(other.readings) < len(model.readings)
    for effect in other.effects:
        if effect.id in known:
            values = {**values_of(effect)}
            assert np.shape(effect.change(values)) == (len(other.readings),)
            assert other.predict(other.start, {effect.id: values}).shape == (len(other.readings),)


def check_pickle(model: Model, setup: Any) -> None:  # noqa: ARG001
    """A model and each of its effects come back from a pickle as they were."""
    again = pickle.loads(pickle.dumps(model))
    at = somewhere(model)
    assert np.array_equal(again.predict(at, {}), model.predict(at, {}))
    for effect in model.effects:
        other = pickle.loads(pickle.dumps(effect))
        values = values_of(effect)
        assert (other.id, other.parameters, other.label) == (
            effect.id,
            effect.parameters,
            effect.label,
        )
        assert np.array_equal(other.change(values), effect.change(values)), effect.id
        assert np.array_equal(other.columns(values), effect.columns(values)), effect.id


def check_catalogue(model: Model, setup: Any) -> None:
    """The catalogue lists every effect with a label for people, units and an owner."""
    listed = {info.id: info for info in tn.catalogue(model.data, setup)}
    assert list(listed) == [e.id for e in model.effects]
    assert len(set(listed)) == len(model.effects)
    for info in listed.values():
        assert info.label, info.id
        assert info.label != info.id
        assert isinstance(info.owner, Owner)
        assert all(p.unit for p in info.parameters), info.id
        assert all(p.unit in ("1", unit_of(p.name)) for p in info.parameters), info.id
        assert len({p.name for p in info.parameters}) == len(info.parameters), info.id
        assert set(info.needs) <= set(model.data.columns), info.id


class Own:
    """An effect as a user writes it; each reading (sample of each axis of a log) alike."""

    id = "my_own"
    parameters = ("k_um",)

    def change(self, data: Any, values: Mapping[str, float]) -> Floats:
        shape: tuple[int, ...] = (len(data),)
        if isinstance(data, tn.Points):
            shape = (len(data) * data.dimension,)
        elif isinstance(data, tn.Levels):
            shape = (len(data) * len(data.components),)
        elif isinstance(data, tn.Sweep):
            shape = (3 * len(data),)
        elif isinstance(data, tn.RotaryTest):
            shape = (len(data) * (1 if data.displacement_um is None else 3),)
        elif isinstance(data, tn.AxisLog):
            shape = (len(data), len(data.axes))
        return values["k_um"] * np.ones(shape)


def check_own_effects(model: Model, setup: Any) -> None:
    """A user's effect stands behind the catalogue; names taken or unknown are refused."""
    with_own = model_of(model.data, setup, [Own()])
    assert [e.id for e in with_own.effects] == [*(e.id for e in model.effects), "my_own"]
    start = with_own.start
    rise = with_own.predict(start, {"my_own": {"k_um": 2.0}}) - with_own.predict(start, {})
    assert close(rise[: len(model.data)], np.full(len(model.data), 2.0)[: len(rise)], 1e-9)
    again = with_own.bind(model.data)
    assert again.effects[-1].id == "my_own"
    with pytest.raises(tn.InputError, match="my_own"):
        model_of(model.data, setup, [Own(), Own()])
    with pytest.raises(tn.UnknownNameError, match="no_such_effect"):
        model_of(model.data, setup, ["no_such_effect"])
    first = next((info for info in tn.catalogue(model.data, setup) if info.codes), None)
    asked = [model.effects[0].id, *(first.codes if first else ())]
    assert len(model_of(model.data, setup, asked).effects) == len(model.effects)


def check_formulas(model: Model, setup: Any) -> None:
    """An effect by a formula is a candidate of what is diagnosed: it acts as structure does."""
    tried = 0
    for covariate in model.covariates:
        if not covariate.classes and np.ptp(covariate.values) == 0:
            continue
        for way, enters in (model.components or {"": np.ones(len(model.readings))}).items():
            effect = _formula(model, covariate, way, np.asarray(enters) != 0)
            made = model_of(model.data, setup, [effect])
            values = values_of(effect.bound(model.data, model), 2.0)
            as_structure = model_with(model, effect)
            rises = [
                m.predict(m.start, {effect.id: values}) - m.predict(m.start, {})
                for m in (made, as_structure)
            ]
            assert close(rises[0], rises[1], 1e-9), (covariate.name, way)
            tried += bool(np.abs(rises[0]).max() > 0.0)
    assert tried


def _formula(model: Model, covariate: Covariate, way: str, acting: Any) -> tn.FormulaEffect:
    """A parabola of a recorded quantity, or what is at its first value alone."""
    units = model.readings.unit
    unit = units if isinstance(units, str) else str(np.asarray(units)[acting][0])
    of: dict[str, Any] = {"shape": "class", "at": str(covariate.values[0])}
    if not covariate.classes:
        ends = float(np.min(covariate.values)), float(np.max(covariate.values))
        of = {"shape": "polynomial", "number": 2.0, "low": ends[0], "high": ends[1]}
    return tn.FormulaEffect(
        "my_own_shape",
        type(model.data).__name__,
        covariate=covariate.name,
        unit=covariate.unit,
        component=way,
        reading_unit=ANGLE_UNIT if is_angle(way) else unit,
        **of,
    )


def check_sense(model: Model, setup: Any) -> None:
    """A control that counts rotary axes the other way gives the same readings and columns.

    Where a reading is the position of such an axis itself, its sign is the control's.
    """
    letters = [x for x in "abc" if any(c.startswith(f"{x}_") for c in model.data.columns)]
    if setup is None or not letters:
        pytest.skip("no rotary axis of a control in these data")
    counted = [
        c
        for x in letters
        for c in (f"{x}_deg", f"{x}_dir", f"{x}_cmd_deg", f"{x}_act_deg")
        if c in model.data.columns
    ]
    data = model.data.with_columns(**{c: -model.data.columns[c] for c in counted})
    other_way = {x.upper(): tn.AxisSetup(-1) for x in letters}
    other = model_of(data, replace(setup, axes={**setup.axes, **other_way}))
    assert close(np.abs(other.readings.values), np.abs(model.readings.values), 1e-9)
    start = model.start
    for one, two in zip(model.effects, other.effects, strict=True):
        linear = [k for k, p in enumerate(one.parameters) if p.linear]
        first, second = (
            np.abs(m.effect_jacobian(start, e, values_of(e))[:, linear])
            for m, e in ((model, one), (other, two))
        )
        assert close(first, second, 1e-3), one.id


def check_not_identifiable_is_refused(model: Model, setup: Any) -> None:
    """Compensation takes no value that the data do not identify."""
    setup = tn.Setup(artefact=tn.Artefact("none")) if setup is None else setup
    machine = [x.name for x in model.nuisance if x.owner is Owner.MACHINE]
    accepted = 0
    for effect in [e for e in model.effects if e.owner is Owner.MACHINE][:12]:
        found = {effect.id: values_of(effect)}
        names = (*(x.name for x in model.nuisance), *(f"{effect.id}.{k}" for k in found[effect.id]))

        def estimate(std: dict[str, float], names: Any = names, found: Any = found) -> Any:
            full = dict.fromkeys(names, 0.1) | std
            covariance = np.diag([min(full[n], 1.0) ** 2 for n in names])
            return model.extended(
                np.asarray(model.start), found, Uncertainty(names, full, covariance, 0.3, 20)
            )

        whole = estimate({})
        if not isinstance(whole, tn.Estimate) or effect.id in whole.not_compensable:
            continue
        volumetric_error(setup, estimate({}), x_mm=(0.0, 10.0), y_mm=0.0, z_mm=0.0)
        accepted += 1
        for name in [*machine[:3], names[-1]]:
            with pytest.raises(tn.TrunnionError, match=r"identif|determine|estimate"):
                volumetric_error(
                    setup, estimate({name: np.inf}), x_mm=(0.0, 10.0), y_mm=0.0, z_mm=0.0
                )
    if not accepted:
        pytest.skip("no effect of this kind can be compensated")


CHECKS = (
    check_shapes,
    check_nuisance_derivative,
    check_effect_derivatives,
    check_zero_at_zero,
    check_bound_to_its_own_data,
    check_bound_to_other_data,
    check_pickle,
    check_catalogue,
    check_own_effects,
    check_formulas,
    check_sense,
    check_not_identifiable_is_refused,
)


def check_model(model: Model, setup: Any = None) -> None:
    """Run every check that applies to the model."""
    for check in CHECKS:
        try:
            check(model, setup)
        except pytest.skip.Exception:
            continue
