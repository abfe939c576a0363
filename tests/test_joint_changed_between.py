"""A machine that was changed between measurements of different kinds, of formulas of their own.

What one kind alone shows may look like it: a drift of a plate like a scale that is another one now,
a screw that warms up like a scale of its stops. Neither is certain then.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import trunnion as tn
from trunnion.diagnosis.joint_ids import Happened, JointId
from trunnion.files.table import Table

RAD = np.pi / 648000  # of an arcsec
CERTAIN = 0.9
Rng = np.random.Generator


@dataclass(frozen=True)
class Machine:
    """Errors of X and Y: scales (ppm), squareness (arcsec), backlash of X (µm)."""

    scale: tuple[float, float] = (0.0, 0.0)
    square: float = 0.0
    backlash: float = 0.0

    def off_um(self, x: np.ndarray, y: np.ndarray, sense_x: np.ndarray) -> np.ndarray:
        """Where it is off its commanded places, (2, n)."""
        off_x = 1e-3 * self.scale[0] * x - 1e3 * RAD * self.square * y
        return np.array([off_x - self.backlash / 2 * sense_x, 1e-3 * self.scale[1] * y])


@dataclass(frozen=True)
class Case:
    """Measurements in the order of time, the machine at first and from measurement 2 on."""

    kinds: tuple[str, str]
    before: Machine
    after: Machine
    true: frozenset[str] = field(default_factory=frozenset)


def plate(rng: Rng, machine: Machine) -> tn.Points:
    """9 × 9 bores over 300 mm, measured row by row, the plate lying somehow."""
    at = np.linspace(-150.0, 150.0, 9)
    x, y = (a.ravel() for a in np.meshgrid(at, at))
    turn, off = rng.uniform(-1e-4, 1e-4), rng.uniform(-0.02, 0.02, 2)
    wrong = 1e-3 * (machine.off_um(x, y, 0 * x) + rng.normal(0.0, 0.3, (2, 81)))
    measured = np.array([x - turn * y, y + turn * x]) + wrong + off[:, None]
    return tn.Points(nominal_x_mm=x, nominal_y_mm=y, x_mm=measured[0], y_mm=measured[1])


def bar(rng: Rng, machine: Machine) -> tn.Ballbar:
    """A circle of 100 mm in both senses by a calibrated bar."""
    at = np.linspace(0.0, 2 * np.pi, 300)
    angle, sense = np.concatenate([at, -at]), np.repeat([1, -1], 300)
    x, y = 100.0 * np.cos(angle), 100.0 * np.sin(angle)
    off = 1e-3 * machine.off_um(x, y, np.sign(-sense * np.sin(angle)))
    length = np.hypot(x + off[0], y + off[1]) + rng.normal(0.0, 1e-4, 600)
    seconds = 6e-3 * 100.0 * np.abs(angle) + 60.0 * (sense < 0)
    columns = {"setup": np.ones(600), "x_mm": x, "y_mm": y, "length_mm": length}
    return tn.Ballbar(columns | {"sense": sense, "time_s": seconds})


def run(rng: Rng, machine: Machine) -> tn.Positioning:
    """Five cycles of X at ten targets over 400 mm."""
    up = np.array([5.3, 48.1, 92.7, 131.2, 178.9, 221.4, 266.8, 305.5, 352.1, 394.6])
    target, direction = np.tile([*up, *up[::-1]], 5), np.tile(np.repeat([1, -1], 10), 5)
    off = machine.off_um(target, 0 * target, direction)[0] + rng.normal(0.0, 0.4, 100)
    return tn.Positioning(
        target_mm=target,
        measured_mm=target + 1e-3 * off,
        direction=direction,
        cycle=np.repeat(np.arange(1, 6), 20),
        time_s=8.0 * np.arange(100),
        axis=["X"] * 100,
    )


MEASURED = {"plate": plate, "bar": bar, "run": run}


def drawn(rng: Rng, kinds: tuple[str, str], error: str, noises: float) -> Case:
    """Draw a machine of which one error changes by so many standard errors of the weaker kind."""
    sign = float(rng.choice([-1.0, 1.0]))
    before = Machine(square=float(rng.choice([0.0, 4.0])), backlash=float(rng.choice([0.0, 3.0])))
    match error:
        case "scale_x":
            after = replace(before, scale=(sign * 0.34 * noises, 0.0))
        case "scale_y":
            after = replace(before, scale=(0.0, sign * 0.34 * noises))
        case _:
            after = replace(before, square=before.square + sign * 0.1 * noises)
    true = {error}
    true |= {"squareness_xy"} if before.square else set()
    true |= {"backlash_x"} if before.backlash else set()
    return Case(kinds, before, after, frozenset(true))


def diagnosed(rng: Rng, case: Case) -> tn.Diagnosis:
    states = (case.before, case.after)
    data: list[Table] = [
        MEASURED[kind](rng, state) for kind, state in zip(case.kinds, states, strict=True)
    ]
    found = tn.diagnose(data)
    assert isinstance(found, tn.Diagnosis)
    return found


def wrong(found: tn.Diagnosis, case: Case) -> set[str]:
    """Causes that are certain and do not act: of differences the error says it."""
    certain = {c.id for c in found.causes if c.probability is not None and c.probability > CERTAIN}
    return {
        i
        for i in certain
        if i not in case.true and not (JointId.of(i).happened and JointId.of(i).cause in case.true)
    }


CHANGES = (
    (("bar", "plate"), "scale_y"),
    (("plate", "bar"), "scale_y"),
    (("bar", "plate"), "squareness_xy"),
    (("bar", "run"), "scale_x"),
    (("run", "bar"), "scale_x"),
    (("plate", "run"), "scale_x"),
)


@pytest.mark.parametrize(("kinds", "error"), CHANGES)
def test_no_cause_of_one_kind_is_certain_for_a_change(kinds: tuple[str, str], error: str) -> None:
    for seed, noises in enumerate((4.0, 8.0, 16.0, 25.0)):
        rng = np.random.default_rng([141, CHANGES.index((kinds, error)), seed])
        case = drawn(rng, kinds, error, noises)
        found = diagnosed(rng, case)
        assert not wrong(found, case), (seed, noises)


def test_a_drift_of_the_plate_may_as_well_be_a_change_of_the_machine() -> None:
    """Bores are measured row by row: a drift in Y is a scale of Y, but for its steps."""
    probabilities = []
    for seed in range(6):
        rng = np.random.default_rng([142, seed])
        case = Case(("bar", "plate"), Machine(), Machine(scale=(0.0, 8.0)), frozenset({"scale_y"}))
        found = diagnosed(rng, case)
        assert found.verdict == "ambiguous"
        (other,) = (
            one
            for one in found.evidence
            if {(JointId.of(i).happened, JointId.of(i).cause) for i in one.causes}
            == {(Happened.DIFFERS, "scale_y")}
        )
        probabilities.append(other.probability)
        assert found.named == {"points:drift_y"}
        (note,) = (note for note in found.notes if "was the machine changed" in note)
        assert "scale_y may be other in one kind of measurement than in the others" in note
        assert tn.Diagnosis.from_json(found.to_json()).to_dict() == found.to_dict()
    assert np.mean(probabilities) == pytest.approx(0.5, abs=0.2)


@pytest.mark.parametrize("kinds", [("bar", "plate"), ("bar", "run"), ("plate", "run")])
def test_of_a_machine_that_stays_nothing_is_asked(kinds: tuple[str, str]) -> None:
    asked = 0
    for seed in range(8):
        rng = np.random.default_rng([143, seed, *kinds[0].encode()])
        scale = (float(rng.normal(0.0, 10.0)), float(rng.normal(0.0, 10.0)))
        machine = Machine(scale, float(rng.normal(0.0, 4.0)), float(rng.normal(0.0, 3.0)))
        found = diagnosed(rng, Case(kinds, machine, machine))
        asked += any("differs" in i for causes in found.alternatives for i in causes)
    assert asked == 0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_drift_that_is_no_scale_stays_certain(seed: int) -> None:
    """In the order of measurement it goes on along X in each row, as no scale does."""
    rng = np.random.default_rng([144, seed])
    data = [bar(rng, Machine()), plate(rng, Machine())]
    order = rng.permutation(81)
    bores = data[1][order]
    drift = 6e-3 * np.arange(81) / 80
    found = tn.diagnose([data[0], bores.with_columns(y_mm=bores["y_mm"] + drift)])
    (cause,) = found.causes
    assert cause.id == "points:drift_y"
    assert cause.probability is not None
    assert cause.probability > CERTAIN


def test_contradictions_may_be_changes() -> None:
    rng = np.random.default_rng(145)
    found = diagnosed(rng, Case(("bar", "run"), Machine(), Machine(backlash=4.0)))
    assert found.verdict == "unexplained"
    assert found.unexplained is not None
    assert "contradict each other: backlash_x is" in found.unexplained
    assert "(or the machine was changed between them)" in found.unexplained
