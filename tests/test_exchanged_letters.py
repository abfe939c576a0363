"""Two positioning runs whose axis letters were exchanged: named, and only then."""

from __future__ import annotations

import re
from typing import Any, Literal

import numpy as np
import pytest

import trunnion as tn
from promise import kept, needed_runs
from test_joint_agreement import circle, stops
from test_joint_rotary_stops import stops as stops_of_c
from test_joint_rotary_stops import touches as of_twin
from trunnion.models import exchanged

Rng = np.random.Generator
Kind = Literal["ballbar", "touches"]
KINDS: tuple[Kind, Kind] = ("ballbar", "touches")
SETUP = tn.Setup(tn.Artefact("cross"))
CAUSE = "What is not explained has a likely cause: the data fit to "
SAID = 0.95


def asked(found: tn.Diagnosis) -> list[str]:
    """What is said of exchanged letters; it is among the notes and the first sentences, too."""
    said = [text for text in found.mistakes if "exchanged" in text]
    assert all(found.notes.count(text) == found.sentences().count(text) == 1 for text in said)
    return said


def drawn(rng: Rng, axes: int = 2) -> tuple[Any, Any]:
    """Scales, ppm, and backlashes, µm."""
    return rng.normal(0.0, 25.0, axes), rng.normal(0.0, 2.0, axes)


def seen_by(kind: Kind, rng: Rng, scale: Any, backlash: Any) -> Any:
    """Another measurement, that sees these scales and backlashes."""
    if kind == "ballbar":
        return circle(rng, tuple(scale), tuple(backlash), float(rng.normal(0.0, 5.0)))
    effects = {f"scale_{a}": {"ppm": v} for a, v in zip("xyz", scale, strict=False)}
    effects |= {f"backlash_{a}": {"b_um": v} for a, v in zip("xyz", backlash, strict=False)}
    seed, errors = int(rng.integers(1 << 31)), {"EX0C": float(rng.uniform(5.0, 30.0))}
    return tn.simulate(tn.plan(SETUP), SETUP, errors, effects=effects, noise_um=0.4, seed=seed)


def diagnosed(kind: Kind, data: list[Any]) -> tn.Diagnosis:
    return tn.diagnose(data, SETUP if kind == "touches" else None)


def test_exchanged_letters_are_named_where_measurements_contradict_each_other() -> None:
    named = contradict = fits = 0
    for k in range(3 * needed_runs(SAID)):
        if contradict == needed_runs(SAID):
            break
        rng, kind = np.random.default_rng([941, k]), KINDS[k % 2]
        scale, backlash = drawn(rng)
        runs = [stops(rng, "yx"[i], scale[i], backlash[i]) for i in range(2)]
        found = diagnosed(kind, [seen_by(kind, rng, scale, backlash), *runs])
        if "contradict" not in str(found.unexplained):
            continue
        contradict += 1
        said = asked(found)
        named += len(said) == 1
        if said:
            which = "positioning (Y) and positioning 2 (X) are exchanged."
            assert said[0].startswith(CAUSE)
            assert said[0].endswith(f"if the axis letters of {which}")
            fit, as_given = map(float, re.findall(r"([\d.]+) times", said[0]))
            assert as_given > 1.05 * fit
            fits += fit < 1.1
    assert fits > 0.9 * named
    assert kept(named, contradict, SAID)


@pytest.mark.parametrize("off", ["none", "scale of X", "all scales", "reversal of X"])
def test_right_letters_are_not_asked_about(off: str) -> None:
    """Nor are runs that contradict the others by themselves: a glass scale, a loose clamp."""
    contradict = 0
    for k in range(30):
        rng = np.random.default_rng([942, k])
        kind = KINDS[k % 2]
        scale, backlash = drawn(rng)
        by, play = float(rng.normal(0.0, 30.0)), float(rng.normal(0.0, 6.0))
        seen = seen_by(kind, rng, scale, backlash)
        scale = scale + {"scale of X": np.array([by, 0.0]), "all scales": by}.get(off, 0.0)
        backlash = backlash + (np.array([play, 0.0]) if off == "reversal of X" else 0.0)
        runs = [stops(rng, "xy"[i], scale[i], backlash[i]) for i in range(2)]
        found = diagnosed(kind, [seen, *runs])
        contradict += "contradict" in str(found.unexplained)
        assert asked(found) == []
    assert (contradict > 8) == (off in ("scale of X", "reversal of X"))


@pytest.mark.parametrize("seed", range(4))
def test_of_three_runs_the_two_are_named_that_were_exchanged(seed: int) -> None:
    rng = np.random.default_rng([943, seed])
    scale, backlash = np.array([12.0, 60.0, -50.0]), np.array([1.0, -2.0, 2.5])
    order = rng.permutation(3)
    runs = [stops(rng, "xzy"[i], scale[i], backlash[i]) for i in order]
    found = diagnosed("touches", [seen_by("touches", rng, scale, backlash), *runs])
    (said,) = asked(found)
    assert "(Y)" in said
    assert "(Z)" in said
    assert "(X)" not in said


@pytest.mark.parametrize("seed", range(3))
def test_what_is_of_a_run_alone_stays_with_it(seed: int) -> None:
    """A wave in one of the runs has the letter of its axis in its name."""
    rng = np.random.default_rng([944, seed])
    scale, backlash = np.array([30.0, -25.0]), np.array([1.0, -2.0])
    runs = [stops(rng, "yx"[i], scale[i], backlash[i]) for i in range(2)]
    wave = 4e-3 * np.sin(2 * np.pi * runs[0].target / 150.0)
    runs[0] = runs[0].with_columns(measured_mm=runs[0].measured + wave)
    found = diagnosed("ballbar", [seen_by("ballbar", rng, scale, backlash), *runs])
    assert any(name.endswith("_of_y") for name in found.named), found.named
    assert len(asked(found)) == 1


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_runs_of_two_rotary_axes(seed: int, swapped: bool) -> None:
    rng = np.random.default_rng([945, seed])
    effects = {"a_backlash": {"b_arcsec": -9.0}, "c_backlash": {"b_arcsec": 6.0}}
    seen, setup = of_twin(effects, rng)
    runs = [stops_of_c(rng, -6.0), stops_of_c(rng, 9.0)]
    letters = ("A", "C") if swapped else ("C", "A")
    runs = [
        run.with_columns(axis=[letter] * len(run))
        for run, letter in zip(runs, letters, strict=True)
    ]
    found = tn.diagnose([seen, *runs], setup)
    assert len(asked(found)) == swapped


def test_nothing_is_built_for_it_where_causes_explain_the_measurements(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built = []
    monkeypatch.setattr(exchanged, "joint_model", lambda *given: built.append(given))
    monkeypatch.setattr(exchanged, "refit", lambda *given: built.append(given))
    for k in range(5):
        rng = np.random.default_rng([946, k])
        scale, backlash = drawn(rng)
        runs = [stops(rng, "xy"[i], scale[i], backlash[i]) for i in range(2)]
        found = diagnosed("ballbar", [seen_by("ballbar", rng, scale, backlash), *runs])
        assert found.verdict != "unexplained"
    assert not built
