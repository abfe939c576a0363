"""Simulation: seeds, ticks, effects, and what it refuses."""

import pickle

import numpy as np
import pytest

import trunnion as tn

CROSS = tn.Setup(artefact=tn.Artefact("cross"))
PLAN = tn.plan(CROSS)


def test_noise_comes_only_from_a_seed_and_is_the_same_for_the_same_seed() -> None:
    with pytest.raises(tn.InputError, match="no noise without a seed"):
        tn.simulate(PLAN, CROSS, noise_um=0.3)
    first = tn.simulate(PLAN, CROSS, noise_um=0.3, seed=4)
    assert first == tn.simulate(PLAN, CROSS, noise_um=0.3, seed=4)
    assert first != tn.simulate(PLAN, CROSS, noise_um=0.3, seed=5)
    assert first != tn.simulate(PLAN, CROSS, noise_um=0.3, seed=4, sample=1)
    assert tn.simulate(PLAN, CROSS) == tn.simulate(PLAN, CROSS, seed=4)
    samples = [
        tn.simulate(PLAN, CROSS, noise_um=0.3, seed=4, sample=i).position_mm for i in range(300)
    ]
    along = np.sum((np.array(samples) - PLAN.position_mm) * PLAN.direction, axis=2) * 1e3
    assert along.std() == pytest.approx(0.3, rel=0.02)
    assert abs(along.mean()) < 0.01
    assert abs(np.corrcoef(along[0::2].ravel(), along[1::2].ravel())[0, 1]) < 0.05


def test_ticks_are_counted_from_the_start() -> None:
    data = tn.simulate(PLAN, CROSS, {"EX0C": 12.34}, tick_um=1.0)
    start = data.start_mm
    assert start is not None
    travel = np.sum((data.position_mm - start) * data.direction, axis=1) * 1e3
    assert np.allclose(travel, np.round(travel), atol=1e-6)
    exact = tn.simulate(PLAN, CROSS, {"EX0C": 12.34}, tick_um=0.0)
    late = np.sum((data.position_mm - exact.position_mm) * data.direction, axis=1) * 1e3
    assert np.all((late > -1e-6) & (late < 1.0 + 1e-6))


def test_recorded_touches_are_repeated_along_their_lines() -> None:
    measured = tn.simulate(PLAN, CROSS, {"EX0C": 15.0})
    lines = measured.with_columns(start_x_mm=None, start_y_mm=None, start_z_mm=None)
    again = tn.simulate(lines, CROSS, {"EX0C": 15.0})
    assert np.allclose(again.position_mm, measured.position_mm, atol=1e-12)


def test_errors_of_the_setup_are_the_default_and_given_ones_replace_them() -> None:
    known = tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine(errors={"EX0C": 30.0}))
    assert tn.simulate(PLAN, known) == tn.simulate(PLAN, CROSS, {"EX0C": 30.0})
    assert tn.simulate(PLAN, known, {"EX0C": 5.0}) == tn.simulate(PLAN, CROSS, {"E_X0C": 5.0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"errors": {"EX0Q": 1.0}}, "EX0Q"),
        ({"errors": {"EX0A": 1.0}}, "EX0A.*expected one of EA0A"),
        ({"errors": {"EX0C": float("nan")}}, "EX0C: got nan"),
        ({"placement": {"dx": 1.0}}, "placement: got 'dx', expected one of dx_um"),
        ({"effects": {"gravity": {"g": 1.0}}}, 'unknown effect "gravity"; expected one of'),
        ({"effects": {"drift_z": {"rate": 1.0}}}, "got 'rate', expected one of rate_um_h"),
        ({"effects": {3: {}}}, "effect: got 3"),
        ({"noise_um": -1.0, "seed": 1}, "noise_um: got -1.0"),
        ({"noise_um": 0.1, "seed": -1}, "seed: got -1"),
        ({"errors": {"EX0C": 40000.0}}, "touches only after|does not touch"),
    ],
)
def test_refuses_what_makes_no_sense(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(tn.TrunnionError, match=message):
        tn.simulate(PLAN, CROSS, **arguments)  # type: ignore[arg-type]


def test_an_effect_without_its_column_is_refused_by_name() -> None:
    for effect, column, parameter in (
        ("drift_z", "time_s", "rate_um_h"),
        ("trigger_delay", "feed_mm_min", "tau_ms"),
        ("a_backlash", "a_dir", "b_arcsec"),
    ):
        short = PLAN.with_columns(**{column: None})
        with pytest.raises(tn.InputError, match=f"{effect}.*{column}"):
            tn.simulate(short, CROSS, effects={effect: {parameter: 1.0}})


def test_touches_that_belong_to_no_model_are_refused() -> None:
    data = tn.simulate(PLAN, CROSS)
    far = data.z_mm.copy()
    far[4] += 7.0
    with pytest.raises(tn.DataError, match=r"row 4 lies 7.000 mm from the modelled surface"):
        tn.identify(data.with_columns(z_mm=far), CROSS)
    level = np.flatnonzero((np.abs(data.rotary_deg["a"]) < 1e-9) & (np.abs(data.dir_z) < 1e-9))
    row, over = int(level[0]), data.z_mm.copy()
    over[row] = 25.0 + 1.0 + 6.0  # the top, the ball's radius
    said = (
        rf"row {row} with the ball at \(.*, 32\.000\) mm: the ball misses the modelled artefact by "
        r"6\.000 mm .*; expected a contact within 5 mm of that place"
    )
    with pytest.raises(tn.DataError, match=said):
        tn.identify(data.with_columns(z_mm=over), CROSS)
    with pytest.raises(tn.DataError, match=r"13 touches and 0 priors for 14 parameters"):
        tn.identify(data[:13], CROSS)
    with pytest.raises(tn.DataError, match=r"b_deg|a_deg"):
        tn.identify(data, tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine("trt-bc")))
    with pytest.raises(tn.UnknownNameError, match=r"trt-xy.*trt-ca"):
        tn.plan(tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine("trt-xy")))
    keep = ~((data.point == 3) & (np.round(data.rotary_deg["c"]) == 90))
    with pytest.raises(tn.DataError, match="no touch 3 at C = 90"):
        tn.closed_form(data[keep], CROSS)
    with pytest.raises(tn.DataError, match=r"column point: got none"):
        tn.closed_form(data.with_columns(point=None), CROSS)
    with pytest.raises(tn.UnknownNameError, match=r"method: got 'best'"):
        tn.closed_form(data, CROSS, "best")  # type: ignore[arg-type]


def test_results_pickle() -> None:
    result = tn.identify(tn.simulate(PLAN, CROSS, noise_um=0.3, seed=1), CROSS)
    again = pickle.loads(pickle.dumps(result))
    assert again.errors == result.errors
    assert again.summary() == result.summary()
