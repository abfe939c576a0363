"""Curves of a cause that is a wave are that wave, however few places it was read at."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.units import Floats
from trunnion.diagnosis.model import Covariate
from trunnion.plot.coordinates import Coordinate, Wave, Weight
from trunnion.plot.diagnosis import diagnosis_picture
from trunnion.plot.picture import Form

LOBES = 3


def curve_of(
    place: Floats, change: Floats, v: Covariate, wave: Wave | None
) -> tuple[Floats, Floats]:
    """Places and amounts of the curve through changes."""
    weight = Weight("deviation", "µm", np.ones(len(place)))
    made = Coordinate(v, weight, None, (), 1.0)
    ((_, x, amounts),) = made.curve(change[:, None], np.ones(len(place), bool), wave)
    return x, amounts[:, 0]


@pytest.mark.parametrize("order", [1, 2, 3, 5])
@pytest.mark.parametrize("name", ["probe_lobing", "radial_{}"])
def test_a_harmonic_is_drawn_as_itself_through_few_places(order: int, name: str) -> None:
    """Four azimuths show cos 3φ the same amounts as cos φ."""
    at = np.repeat([0.0, 90.0, 180.0, 270.0], 3)
    amounts = 2.0 * np.cos(np.radians(order * at))
    named = {f"a{order}_um": 2.0, f"b{order}_um": 0.0}
    wave = Wave.of(name.format(order), named if name == "probe_lobing" else {"ax_um": 2.0})
    x, y = curve_of(at, amounts, Covariate("azimuth", at, "deg", period=360.0), wave)
    np.testing.assert_allclose(y, 2.0 * np.cos(np.radians(order * x)), atol=1e-9)


def test_a_cyclic_error_is_drawn_with_its_pitch_between_targets() -> None:
    target = np.linspace(0.0, 500.0, 21)
    change = 3.0 * np.sin(2 * np.pi * target / 16.0)
    wave = Wave.of("periodic", {"a_um": 0.0, "b_um": 3.0, "pitch_mm": 16.0})
    x, y = curve_of(target, change, Covariate("target position", target, "mm"), wave)
    np.testing.assert_allclose(y, 3.0 * np.sin(2 * np.pi * x / 16.0), atol=1e-9)
    assert np.diff(x).max() <= 16.0 / 20


def test_what_is_no_such_wave_is_drawn_as_read() -> None:
    at = np.arange(0.0, 360.0, 30.0)
    change = np.where(at > 170.0, 1.0, 0.0)
    x, y = curve_of(at, change, Covariate("azimuth", at, "deg", period=360.0), Wave(order=3))
    np.testing.assert_allclose(x, at)
    np.testing.assert_allclose(y, change)


def test_lobes_of_a_probe_have_three_periods_in_the_picture() -> None:
    """Of touches along four azimuths: another C axis on one of three dates looks like lobes."""
    setup = tn.Setup(tn.Artefact("cross"))
    plan = tn.plan(setup)
    way = np.asarray(plan.direction)
    dates = []
    for seed, off in ((0, 15.0), (50, 22.0), (90, 15.0)):
        along = off * way[:, 0] + np.random.default_rng(seed).normal(0, 0.4, len(plan))
        at = np.asarray(plan.position_mm) + 1e-3 * along[:, None] * way
        dates.append(plan.with_columns(x_mm=at[:, 0], y_mm=at[:, 1], z_mm=at[:, 2]))
    found = tn.diagnose(dates, setup)
    lobes = next(c.id for c in found.causes if "a3_um" in c.parameters)
    picture = diagnosis_picture(found, lobes)
    curve = max((s for s in picture.series if s.form is Form.LINE), key=lambda s: len(s.x))
    y = np.asarray(curve.y, dtype=float)
    assert len(y) > 100
    crossings = int(np.sum(np.diff(np.sign(y[np.isfinite(y)] - np.nanmean(y))) != 0))
    assert crossings in (2 * LOBES - 1, 2 * LOBES)
