"""Effects that what is always fitted absorbs: what they would do to the machine's errors."""

from __future__ import annotations

import re

import numpy as np
import pytest

import trunnion as tn
from power.study import ground
from trunnion.reports.results import plain_words
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

SAID = re.compile(r"(5 .* of .*) would shift (E\w+) by ([+-][\d.]+) (arcsec|µm)$")
TEN = {
    "squareness_xz": ({"arcsec": 10.0}, "5 arcsec of it"),
    "a_twist": ({"k_arcsec": 10.0}, "5 arcsec of it"),
    "a_sag": ({"ky_um": 10.0, "kz_um": -10.0}, "5 µm of ky_um with -5 µm of kz_um"),
}
UNNOTICED = re.compile(r"([\d.]+) \S+ of it can stay unnoticed .* (E\w+) by ([+-][\d.]+) ")
WEAK = {("paper", "drift_z"): "rate_um_h", ("rich", "scale_z"): "ppm"}
SAG = {"a_sag": {"ky_um": 2.7, "kz_um": -3.5}}


def diagnosed(plan: str, effects: dict[str, dict[str, float]], seed: int) -> tn.Diagnosis:
    """Diagnose touches that the independent generator made."""
    rng = np.random.default_rng(seed)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=effects)
    made, setup, _, read = ground(plan)
    measured = measure(made, setup, truth, noise_um=0.3, tick_um=0.1, seed=seed)
    return tn.diagnose(tn.Touches(measured.columns), read)


@pytest.mark.parametrize("effect", TEN)
def test_the_bias_by_an_absorbed_effect_is_what_its_sentence_says(effect: str) -> None:
    """Same noise with and without 10 of it: the estimates differ by twice what 5 would do."""
    values, words = TEN[effect]
    without = diagnosed("paper", {}, 1)
    hidden = diagnosed("paper", {effect: values}, 1)
    assert hidden.verdict == "consistent"
    said = SAID.search(hidden.not_identifiable[effect])
    assert said, hidden.not_identifiable[effect]
    part, error, shift = said[1], said[2], float(said[3])
    assert part.endswith(words)
    bias = hidden.errors_after[error] - without.errors_after[error]
    assert bias == pytest.approx(2 * shift, rel=0.1)
    assert abs(bias) > hidden.errors_std[error]
    _, _, _, setup = ground("paper")
    foreseen = SAID.search(tn.observability(tn.plan(setup), setup, noise_um=0.3).bias[effect])
    assert foreseen
    assert foreseen.groups()[:2] == (words, error)
    assert float(foreseen[3]) == pytest.approx(shift, rel=0.02)


PLACED = re.compile(
    r"^what is always fitted absorbs it: 5 (µm|arcsec) of it would shift (\w+) by ([+-][\d.]+) "
    r"(µm|arcsec) \(only the placement\)$"
)


@pytest.mark.parametrize(
    ("effect", "parameter", "placement"),
    [("artefact_height", "dh_um", "dz_um"), ("c_backlash", "b_arcsec", "rc_arcsec")],
)
def test_what_the_placement_absorbs_shifts_it_as_its_sentence_says(
    effect: str, parameter: str, placement: str
) -> None:
    """No error of the machine moves: C is always reached in the same sense."""
    setup = tn.Setup(tn.Artefact("cross"))
    plan = tn.plan(setup).with_columns(c_dir=np.ones(72, dtype=int))
    without, hidden = (
        tn.diagnose(
            tn.simulate(plan, setup, {"EX0C": 15.0}, effects=e, noise_um=0.3, seed=1), setup
        )
        for e in ({}, {effect: {parameter: 10.0}})
    )
    said = PLACED.match(hidden.not_identifiable[effect])
    assert said, hidden.not_identifiable[effect]
    assert said[2] == placement
    bias = hidden.model.placement[placement] - without.model.placement[placement]
    assert bias == pytest.approx(2 * float(said[3]), rel=0.1)
    for name, value in hidden.errors_after.items():
        assert abs(value - without.errors_after[name]) < 0.5 * hidden.errors_std[name]
    words = plain_words(hidden.not_identifiable[effect])
    assert re.search(r"would change the (shift|turn) of the artefact (along|about) Z", words)


def test_an_effect_that_shifts_the_placement_only_has_no_bias() -> None:
    """The height of the artefact is its place in Z: no error of the machine."""
    _, _, _, setup = ground("paper")
    seen = tn.observability(tn.plan(setup), setup)
    assert "artefact_height" not in seen.bias
    assert f"a_twist: {seen.bias['a_twist']}." in seen.sentences()


def test_what_is_absorbed_in_part_is_not_excluded_at_the_size_that_hurts() -> None:
    """Not at that of one parameter alone, which shows before; first, as it shows at no size."""
    without = diagnosed("paper", {}, 1)
    said = "sag of the A axis (a_sag): 5 µm of ky with −5 µm of kz would shift EZ0A by +5 µm"
    (opening,) = (line for line in without.summary().splitlines() if "Not excluded" in line)
    assert opening.startswith(f"Not excluded: {said}, unnoticed")
    hidden = diagnosed("paper", {"a_sag": {"ky_um": 5.0, "kz_um": -5.0}}, 1)
    assert hidden.verdict == "consistent"
    bias = hidden.errors_after["EZ0A"] - without.errors_after["EZ0A"]
    assert bias == pytest.approx(5.0, abs=0.1)
    setup = tn.Setup(tn.Artefact("cross"))
    seen = tn.observability(tn.plan(setup), setup)
    assert f"a_sag: {seen.bias['a_sag']}." in seen.sentences()
    assert not set(seen.bias) & set(seen.unnoticed)


@pytest.mark.parametrize(("plan", "effect"), WEAK)
def test_what_can_stay_unnoticed_shifts_the_error_as_stated(plan: str, effect: str) -> None:
    """Half of it is not named, twice of it is where that is of plausible size."""
    without = diagnosed(plan, {}, 1)
    said = UNNOTICED.match(without.unnoticed[effect])
    assert said, without.unnoticed[effect]
    size, error, shift = float(said[1]), said[2], float(said[3])
    assert f"({effect}): {without.unnoticed[effect].replace('-', '−')}" in without.summary()
    hidden = diagnosed(plan, {effect: {WEAK[plan, effect]: size / 2}}, 1)
    assert hidden.verdict == "consistent"
    bias = hidden.errors_after[error] - without.errors_after[error]
    assert bias == pytest.approx(shift / 2, rel=0.1)
    assert abs(shift) > without.errors_std[error]
    large = diagnosed(plan, {effect: {WEAK[plan, effect]: 2 * size}}, 1)
    assert effect in large.named or size in (5.0, 10.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_error_confounded_with_a_named_effect_has_no_size_either(seed: int) -> None:
    """Equal ky and kz of a sag are a shift of the A axis and of the artefact in Z."""
    rng = np.random.default_rng(seed)
    truth = random_errors(rng)
    d = diagnosed("rich", SAG, seed)
    assert "a_sag" in d.named
    for name in ("EY0A", "EZ0A"):
        std = d.errors_std[name]
        assert np.isinf(std) or abs(d.errors_after[name] - truth[name]) < 4 * std
    assert np.isinf(d.errors_std["EZ0A"])
    assert d.not_identifiable["EZ0A"].endswith("change no reading")
    for member in ("EZ0A", "dz_um", "a_sag.ky_um", "a_sag.kz_um"):
        assert member in d.not_identifiable["EZ0A"]


@pytest.mark.parametrize("preset", ["head-bc", "table-c-head-b", "nutating-head", "head-ac"])
def test_on_heads_too_an_absorbed_effect_has_a_size(preset: str) -> None:
    """Errors of a head are left open by one artefact: what an effect adds to these is said."""
    setup = tn.Setup(tn.Artefact("cross"), machine=tn.Machine(preset))
    data = tn.simulate(tn.plan(setup), setup, {}, {"dx_um": 100.0}, noise_um=0.3, seed=1)
    said = tn.diagnose(data, setup).not_identifiable
    absorbed = {name: text for name, text in said.items() if "always fitted absorbs" in text}
    assert {"artefact_height", "backlash_z", "scale_z"} <= set(absorbed)
    assert all("would shift" in text for text in absorbed.values())
    assert "leave open in part" in absorbed["backlash_z"]


def test_errors_that_an_effect_moves_alike_are_all_named() -> None:
    """One of two that move by the same was named, as if the other did not."""
    cuboid = tn.Artefact("cuboid", length_mm=80.0, width_mm=60.0, height_mm=40.0)
    setup = tn.Setup(cuboid, machine=tn.Machine(preset="trt-bc"))
    plan = tn.plan(setup)
    said = tn.observability(plan, setup, noise_um=0.5).summary().splitlines()
    (line,) = [one for one in said if one.startswith("probe_lobing: ")]
    amount, moved = line.removeprefix("probe_lobing: ").rstrip(".").split(" would shift ")
    assert amount == "5 µm of a3_um"
    named = dict(one.split(" by ") for one in moved.split(" and "))
    assert set(named) == {"EX0B", "EX0C"}
    effect = {"probe_lobing": {"a3_um": 5.0, "b3_um": 0.0}}
    fit = tn.identify(tn.simulate(plan, setup, effects=effect), setup)
    for name, shift in named.items():
        assert fit[name] == pytest.approx(float(shift.split()[0]), rel=0.01)
