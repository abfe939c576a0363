"""Clocks that are not common: the offset is found, and its uncertainty is true."""

import numpy as np
import pytest

import trunnion as tn
from promise import kept, needed_runs

A, B = np.arange(0.0, 10.0, 0.008), np.arange(0.0, 9.0, 0.01)


def motion(t: np.ndarray) -> np.ndarray:
    """Moves and rests, with ramps, and no period."""
    knots = ([-1, 1, 3, 4, 6.5, 9, 12], [0, 0, 5, 5, -3, 1, 1])
    return np.asarray(np.interp(t, *knots) + 0.3 * np.sin(1.3 * t + np.sin(0.31 * t * t)))


def recorded(seed: int) -> tuple[float, tn.ClockOffset]:
    """Offset of two recordings with other rates, gains and noise; and what is found."""
    rng = np.random.default_rng(seed)
    offset = rng.uniform(-0.5, 0.5)
    a = 2.0 * motion(A) + 1.0 + 0.02 * rng.standard_normal(len(A))
    b = motion(B + offset) + 0.01 * rng.standard_normal(len(B))
    return offset, tn.align_clocks(A, a, B, b)


def test_the_offset_lies_in_its_interval() -> None:
    runs = needed_runs(0.90)
    found = [recorded(seed) for seed in range(runs)]
    inside = sum(abs(r.offset_s - true) < 1.96 * r.std_error_s for true, r in found)
    assert kept(inside, runs, 0.90)
    errors = np.array([r.offset_s - true for true, r in found])
    assert np.abs(errors).max() < 0.001  # a tenth of a sample
    assert abs(errors.mean()) < 3 * errors.std() / np.sqrt(runs)


def test_a_place_that_turns_with_an_angle() -> None:
    rng = np.random.default_rng(3)
    angle = motion(A)
    place = np.stack([300 * np.cos(angle), 300 * np.sin(angle), 0 * angle], axis=1)
    turned = motion(B - 0.123)
    found = tn.align_clocks(
        A,
        place + 0.05 * rng.standard_normal(place.shape),
        B,
        np.stack([np.cos(turned), np.sin(turned)], axis=1),
    )
    assert found.offset_s == pytest.approx(-0.123, abs=5 * found.std_error_s)
    assert found.std_error_s < 1e-3
    assert "standard uncertainty" in found.summary()


def test_signals_that_cannot_tell_are_refused() -> None:
    rng = np.random.default_rng(1)
    still, noise = np.zeros(len(A)), rng.standard_normal(len(B))
    with pytest.raises(tn.DataError, match="does not move"):
        tn.align_clocks(A, still, B, motion(B))
    with pytest.raises(tn.DataError, match="are they of the same motion"):
        tn.align_clocks(A, motion(A), B, noise)
    with pytest.raises(tn.DataError, match="a motion that repeats"):
        tn.align_clocks(A, np.sin(8 * A), A, np.sin(8 * A))
    with pytest.raises(tn.InputError, match="rising"):
        tn.align_clocks(A[::-1], motion(A), B, motion(B))
    with pytest.raises(tn.InputError, match="a row for each"):
        tn.align_clocks(A, motion(A)[:-1], B, motion(B))
