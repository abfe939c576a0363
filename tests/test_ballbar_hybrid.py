"""Ball-bar on the hybrid machine: what a plan can see, identification, choice of poses."""

import numpy as np
import pytest

import trunnion as tn
from trunnion.hybrid import (
    PAPER_ERRORS,
    Mechanism,
    ballbar_plan,
    choose_poses,
    identifiability,
    identify_ballbar,
)

CENTRES = np.array(
    [(0, -350, -1400), (150, -350, -1400), (-150, -350, -1400), (0, -450, -1350), (0, -250, -1450)],
    dtype=float,
)
TILT = np.radians(20)
TILTS = [
    (np.sin(TILT), 0, -np.cos(TILT)),
    (-np.sin(TILT), 0, -np.cos(TILT)),
    (0, np.sin(TILT), -np.cos(TILT)),
    (0, -np.sin(TILT), -np.cos(TILT)),
]
PLAIN = {"both_senses": False, "repeat_first": False}


def joints(plan: tn.Ballbar) -> np.ndarray:
    assert plan.joints is not None
    return plan.joints


def tilted(step: float, machine: Mechanism) -> tn.Ballbar:
    return tn.Ballbar.concatenate(
        [
            ballbar_plan(machine, c, setup=k, direction=d, step_deg=step, **PLAIN)  # type: ignore[arg-type]
            for k, c in enumerate(CENTRES)
            for d in TILTS
        ]
    )


def measured(plan: tn.Ballbar, machine: Mechanism, sigma_um: float, seed: int) -> tn.Ballbar:
    rng = np.random.default_rng(seed)
    moved = CENTRES + rng.uniform(-0.1, 0.1, CENTRES.shape)
    length, _, _ = machine.ballbar(joints(plan), moved[plan.setup.astype(int)], ())
    noise = rng.normal(0, sigma_um * 1e-3, len(length))
    return plan.with_columns(length_mm=length + noise)


def test_what_one_and_five_centres_and_tilts_determine() -> None:
    # The notes: 6, 10 and 14 well-determined directions, ranks 16, 16 and 17.
    machine = Mechanism()
    one = identifiability(ballbar_plan(machine, CENTRES[0], **PLAIN), machine)  # type: ignore[arg-type]
    assert (one.rank, one.well_determined()) == (16, 6)
    assert one.not_identifiable == ("1.00 e15_um",)
    assert one.std_errors["e15_um"] == np.inf
    many = tn.Ballbar.concatenate(
        [ballbar_plan(machine, c, setup=k, **PLAIN) for k, c in enumerate(CENTRES)]  # type: ignore[arg-type]
    )
    five = identifiability(many, machine)
    assert (five.rank, five.well_determined()) == (16, 10)
    most = identifiability(tilted(5.0, machine), machine)
    assert (most.rank, most.well_determined()) == (17, 14)
    assert most.not_identifiable == ()
    assert "rank 17 of 17" in most.summary()


def test_gradient_of_a_reading_is_that_of_the_length() -> None:
    machine = Mechanism()
    plan = ballbar_plan(machine, CENTRES[0], step_deg=40.0)
    names = [*PAPER_ERRORS, "wrist5_b_arcsec"]
    _, direction, gradient = machine.ballbar(joints(plan), CENTRES[0], names)
    for k, name in enumerate(names):
        ends = [
            machine.with_errors({name: s}).ballbar(joints(plan), CENTRES[0], ())[0]
            for s in (20.0, -20.0)
        ]
        assert np.abs((ends[0] - ends[1]) * 1e3 / 40.0 - gradient[:, k]).max() < 1e-6
    ends = [machine.ballbar(joints(plan), CENTRES[0] + [s, 0, 0], ())[0] for s in (0.01, -0.01)]
    assert np.abs((ends[0] - ends[1]) / 0.02 + direction[:, 0]).max() < 1e-6


def test_identification_finds_hidden_errors_within_their_standard_errors() -> None:
    machine = Mechanism()
    plan = tilted(20.0, machine)
    squares, covered = [], []
    for seed in range(4):
        rng = np.random.default_rng(100 + seed)
        true = dict(zip(PAPER_ERRORS, rng.normal(0, 20, 17), strict=True))
        data = measured(plan, machine.with_errors(true), 0.5, seed)
        found = identify_ballbar(data, machine)
        assert found.converged
        assert found.rank == 17
        assert found.sigma_um == pytest.approx(0.5, rel=0.1)
        off = np.array([found.errors[n] - true[n] for n in PAPER_ERRORS])
        squares.append(off @ np.linalg.solve(found.covariance, off))
        spread = np.array([found.std_errors[n] for n in PAPER_ERRORS])
        covered.append(np.abs(off) < 1.96 * spread)
    # χ² with 17 degrees of freedom each: mean 17, of four 17 ± 2.9.
    assert 8 < np.mean(squares) < 28
    assert np.mean(covered) > 0.85


def test_what_is_not_identifiable_stays_and_is_named() -> None:
    machine = Mechanism(errors={"e15_um": 7.0})
    plan = ballbar_plan(machine, CENTRES[0], step_deg=10.0)
    length, _, _ = machine.with_errors({"e15_um": 7.0, "e4_um": 30.0}).ballbar(
        joints(plan), CENTRES[0], ()
    )
    data = plan.with_columns(length_mm=length)
    found = identify_ballbar(data, machine, sigma_um=0.5)
    assert found.std_errors["e15_um"] == np.inf
    assert found.errors["e15_um"] == pytest.approx(7.0)
    assert any("e15_um" in text for text in found.not_identifiable)
    assert found.rms_um < 1e-3
    known = identify_ballbar(data, machine, sigma_um=0.5, tolerance=50.0)
    assert known.rank == 17
    assert known.std_errors["e15_um"] == pytest.approx(50.0, rel=0.01)
    assert found.mechanism.errors["e4_um"] == found.errors["e4_um"]


def test_bad_input_to_identification() -> None:
    machine = Mechanism()
    plan = ballbar_plan(machine, CENTRES[0], step_deg=90.0)
    with pytest.raises(tn.DataError, match="expected more than 20 unknowns"):
        identify_ballbar(plan[:15], machine)
    with pytest.raises(tn.InputError, match="sigma_um"):
        identify_ballbar(plan, machine, tolerance=10.0)
    circle = tn.Ballbar(
        setup=[0] * 4, x_mm=[1.0, 0, -1, 0], y_mm=[0.0, 1, 0, -1], length_mm=[1.0] * 4
    )
    with pytest.raises(tn.DataError, match="no joints"):
        identify_ballbar(circle, machine)
    with pytest.raises(tn.InputError, match="plane"):
        ballbar_plan(machine, CENTRES[0], circles=(("XX", 0, 90),))
    with pytest.raises(tn.KinematicsError, match=r"row 0: .*below the base"):
        ballbar_plan(machine, (0, 0, 300.0))


def test_chosen_poses_beat_evenly_spread_and_random_ones() -> None:
    machine = Mechanism()
    candidates = tilted(20.0, machine)

    def information(rows: np.ndarray) -> float:
        seen = identifiability(candidates[rows], machine)
        known = 1 / 100.0**2
        scaled = (seen.singular_values / seen.sigma_um) ** 2
        return float(np.sum(np.log(scaled + known)))

    chosen = choose_poses(candidates, machine, 60)
    assert len(chosen) == len(set(chosen)) == 60
    even = np.linspace(0, len(candidates) - 1, 60).astype(int)
    assert information(chosen) > information(even) + 3
    rng = np.random.default_rng(1)
    for _ in range(5):
        other = rng.choice(len(candidates), 60, replace=False)
        assert information(chosen) > information(other)
    circles = choose_poses(candidates, machine, 4, blocks=np.arange(len(candidates)) // 43)
    assert len(circles) > 4


def test_lengths_in_metres_and_a_noise_of_nothing_are_refused() -> None:
    plan = ballbar_plan(Mechanism(), (0.0, -350.0, -1400.0), step_deg=15.0)
    with pytest.raises(tn.DataError, match=r"length_mm \(row \d+\): got 0.1500, expected within 5"):
        identify_ballbar(plan.with_columns(length_mm=plan.length_mm / 1000), Mechanism())
    for sigma in (0.0, -1.0, float("nan")):
        with pytest.raises(tn.InputError, match="sigma_um"):
            identifiability(plan, Mechanism(), sigma_um=sigma)
    with pytest.raises(tn.InputError, match=r"tip_mm: got shape \(2,\)"):
        Mechanism().inverse([0.0, 0.0])
    with pytest.raises(tn.InputError, match=r"direction: got shape \(2,\)"):
        Mechanism().inverse((0.0, -350.0, -1400.0), (0.0, 1.0))
