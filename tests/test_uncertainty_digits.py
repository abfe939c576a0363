"""A value and its uncertainty as people read them: two significant digits of it (GUM 7.2.6)."""

from decimal import ROUND_HALF_EVEN, Decimal

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.report import Shown, measured, plus_minus, uncertainty
from trunnion.diagnosis.records import value_in_words


def texts(value: float, std: float) -> tuple[str, str]:
    shown, error = measured(value, std)
    assert isinstance(shown, Shown)
    assert isinstance(error, Shown)
    return shown.text.replace("−", "-"), error.text


@pytest.mark.parametrize(
    ("value", "std", "said"),
    [
        (4.8213, 0.312, "4.82 ± 0.31"),
        (4.8213, 0.0996, "4.82 ± 0.10"),
        (-4.8213, 9.96, "−5 ± 10"),
        (1234.5, 123.0, "1230 ± 120"),
        (1234.5, 99.7, "1230 ± 100"),
        (12.0, 1.25, "12.0 ± 1.2"),
        (0.0, 0.01, "0.000 ± 0.010"),
        (100.0, 2.0, "100.0 ± 2.0"),
    ],
)
def test_by_hand(value: float, std: float, said: str) -> None:
    assert plus_minus(value, std) == said
    assert value_in_words(value, std, "µm") == f"{said} µm"


def test_every_size_has_two_digits_and_one_place() -> None:
    """Against decimal arithmetic, over fifteen orders of magnitude."""
    rng = np.random.default_rng(5)
    for _ in range(2000):
        std = float(10.0 ** rng.uniform(-7.5, 6.0))
        value = float(std * rng.normal(0.0, 50.0))
        shown, error = texts(value, std)
        first = Decimal(f"{std:.1e}")
        place = Decimal(1).scaleb(first.adjusted() - 1)
        assert Decimal(error) == first
        assert abs(Decimal(shown) - Decimal(value)) <= place / 2 * Decimal("1.000001")
        assert Decimal(shown) == Decimal(shown).quantize(place, ROUND_HALF_EVEN)
        if place < 1:
            assert len(shown.partition(".")[2]) == len(error.partition(".")[2])


def test_an_uncertainty_alone() -> None:
    assert [uncertainty(x) for x in (0.0996, 0.31, 1.25, 123.0)] == ["0.10", "0.31", "1.2", "120"]


def test_without_an_uncertainty_there_is_no_plus_minus() -> None:
    assert plus_minus(4.8213, None) == plus_minus(4.8213, 0.0) == "4.82"
    assert "not identifiable" in plus_minus(1.0, np.inf)


def test_results_say_it_alike() -> None:
    """Every ± of a summary: two digits, both to one place."""
    found = tn.diagnose(tn.read(tn.sample_path("positioning/axis.csv")))
    said = [part.split()[0] for part in found.summary().split("± ")[1:]]
    assert said
    for text in said:
        digits = text.replace(".", "").lstrip("0")
        assert len(digits.rstrip("0") or "0") <= 2
