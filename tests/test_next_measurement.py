"""The further test that is recommended settles the doubt, measured by independent formulas.

The whole table is docs/results/power-further.md, made by ``make power-further``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from power.further import Machine, again, done, left_of_doubt
from power.study import draw_effects, ground
from promise import kept, needed_runs
from trunnion.cli import app
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

PROMISE = 0.85  # of what is said to settle the doubt with a probability of CHANCE or more
CHANCE = 0.9
MAX_SETS = 8
NOISE_UM = 0.3
GROUPS = (
    ("trigger_delay",),
    ("scale_x", "scale_y"),
    ("backlash_x", "backlash_y"),
    ("probe_bending",),
    ("scale_x", "scale_y"),
    ("a_positioning",),
)
"""Under the short plan others of the catalogue do much the same."""
Rng = np.random.Generator


def settled(d: tn.Diagnosis, test: tn.NextMeasurement, truth: Truth, rng: Rng) -> bool:
    """Whether the hidden set alone is left of those that were in doubt."""
    try:
        both = again(d, done(test.plan, Machine(truth, NOISE_UM), rng))
    except tn.DataError:  # a touch beside its face, as the artefact stands: nothing is settled
        return False
    return left_of_doubt(d, both) == {frozenset(truth.effects)}


def recommended(seed: int) -> tuple[tn.Diagnosis, tn.NextMeasurement, Truth, Rng] | None:
    """Diagnose hidden causes; the first test, if there is doubt and it may settle it."""
    rng = np.random.default_rng([61, seed])
    plan, setup, _, read = ground("paper")
    hidden: dict[str, dict[str, float]] = {}
    for name in GROUPS[seed % len(GROUPS)]:
        hidden |= draw_effects(rng, "paper", 1, 1.2, (name,))
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
    first = measure(plan, setup, truth, noise_um=NOISE_UM, tick_um=0.1, seed=seed)
    d = tn.diagnose(tn.Touches(first.columns), read)
    if frozenset(hidden) not in d.alternatives[:MAX_SETS] or len(d.alternatives) < 2:
        return None
    best = tn.next_measurement(d)[0]
    return (d, best, truth, rng) if best.chance >= CHANCE else None


def achieved(runs: int) -> tuple[list[str], list[bool]]:
    """Kinds of recommended tests, and whether they settled the doubt."""
    kinds: list[str] = []
    came: list[bool] = []
    for seed in range(6 * runs):
        if len(came) < runs and (one := recommended(seed)) is not None:
            kinds.append(one[1].kind)
            came.append(settled(*one))
    return kinds, came


def test_the_recommended_test_settles_the_doubt() -> None:
    """Few runs, so that it fails only if the prediction is far off."""
    kinds, came = achieved(9)
    assert len(came) == 9
    assert {"touches", "positioning"} <= set(kinds)
    assert sum(came) >= 6


@pytest.mark.power
def test_the_recommended_test_settles_the_doubt_as_often_as_it_says() -> None:
    _, came = achieved(needed_runs(PROMISE))
    assert kept(sum(came), len(came), PROMISE)


def test_scales_and_an_artefact_that_grew_are_a_matter_of_another_instrument() -> None:
    one = recommended(1)
    assert one is not None
    d, best, _, _ = one
    assert {"scale_x", "scale_y"} in d.alternatives
    found = {test.label: test for test in tn.next_measurement(d)}
    run, reverse = found["a positioning run of X"], found["the same touches in reversed order"]
    assert run.chance > reverse.chance
    assert all(apart > 4 for apart in run.apart.values())
    assert min(reverse.apart.values()) < 4
    assert best.minutes < 60
    quick = tn.next_measurement(d, mounting_minutes={"positioning": 1.0})
    assert quick[0].kind == "positioning"
    again = tn.NextMeasurement.from_dict(best.to_dict())
    assert (again.label, again.apart, again.chance) == (best.label, best.apart, best.chance)


def test_without_doubt_there_is_nothing_to_measure() -> None:
    d = tn.diagnose(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))
    assert tn.next_measurement(d) == ()
    with pytest.raises(tn.UnknownNameError, match="ballbar"):
        tn.next_measurement(d, mounting_minutes={"balbar": 3.0})


def test_tests_that_settle_nothing_are_one_sentence() -> None:
    """What is in doubt of a run whose axis is not stated no other instrument shows."""
    path = str(tn.sample_path("positioning/axis.csv"))
    said = CliRunner().invoke(app, ["diagnose", path, "--next", "1"])
    assert said.exit_code == 0
    text = " ".join(said.output.split())
    assert "Next: none of these settles the doubt: a circle of a ball-bar in XY, both" in text
    assert "settles the doubt with a probability" not in text


@pytest.mark.parametrize("axis", ["X", "Y", "Z", "A", "C"])
def test_a_positioning_run_in_doubt_that_names_its_axis(axis: str) -> None:
    """What only the instrument has, a curve of many parameters too, is fitted beside each test."""
    plain = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    d = tn.diagnose(plain.with_columns(axis=np.full(len(plain), axis)))
    assert d.verdict == "ambiguous"
    assert all(0.0 <= one.chance <= 1.0 for one in tn.next_measurement(d))


def test_a_shift_after_nearly_all_touches_is_settled_with_the_other_sets() -> None:
    """Of its size what few touches show is known; it was 12 mm, with which no touch meets."""
    one = recommended(587)
    assert one is not None
    d = one[0]
    doubtful = {a.causes for a in d.evidence[1:]}
    assert {"setup_shift"} in doubtful
    touches = tn.next_measurement(d)[0]
    assert set(touches.apart) == doubtful
    assert touches.chance > 0.95


def doubted(seed: int) -> tuple[tn.Diagnosis, Truth]:
    """Diagnose a ball that is 3 µm larger, by the twin: bending or delay make the same."""
    rng = np.random.default_rng([67, seed])
    plan, setup, _, read = ground("paper")
    hidden = {"probe_radius": {"dr_um": 3.0}}
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
    first = measure(plan, setup, truth, noise_um=NOISE_UM, tick_um=0.1, seed=seed)
    return tn.diagnose(tn.Touches(first.columns), read), truth


def test_touches_that_follow_are_one_measurement_with_the_first() -> None:
    """As two measurements the few that follow have fewer readings than unknowns."""
    d, truth = doubted(1)
    assert len(d.alternatives) > 2
    following = done(tn.next_touches(d, 12), Machine(truth, NOISE_UM), np.random.default_rng(2))
    both = tn.diagnose(d.data.followed_by(following), d.setup)
    assert [c.id for c in both.causes] == ["probe_radius"]
    with pytest.raises(tn.DataError, match=r"one measurement: first\.followed_by\(these\)"):
        tn.diagnose([d.data, following], d.setup)
    ball = tn.Setup(tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(30.0, 20.0, 60.0)))
    of_ball = tn.simulate(tn.plan(ball), ball)
    with pytest.raises(tn.DataError, match="misses the modelled artefact") as error:
        tn.diagnose([d.data, of_ball], d.setup)
    assert "followed_by" not in str(error.value)
    early = following.with_columns(time_s=following["time_s"] - following["time_s"].min())
    with pytest.raises(tn.InputError, match="expected later ones of one clock"):
        d.data.followed_by(early)
    assert len(d.data.followed_by(following.with_columns(time_s=None))) == len(d.data) + 12


def test_the_command_writes_touches_that_follow_behind_the_first(tmp_path: Path) -> None:
    """The program's clock begins anew; the plan's runs on from the first touches."""
    d, _ = doubted(2)
    setup, first, plan, log = (tmp_path / n for n in ("s.toml", "1.csv", "next.csv", "next.log"))
    setup.write_text('[machine]\npreset = "trt-ca"\n[artefact]\nkind = "cross"\n', encoding="utf-8")
    d.data.to_csv(first)
    tn.next_touches(d, 8).to_csv(plan)
    command = ["simulate", str(plan), str(setup), "--probe-log", str(log), "--quiet"]
    assert CliRunner().invoke(app, command).exit_code == 0
    both = tmp_path / "both.csv"
    command = ["touches", *map(str, (plan, log, setup)), "--after", str(first), "-o", str(both)]
    said = CliRunner().invoke(app, command)
    assert "8 of 8 planned touches" in said.output
    times = tn.read_touches(both)["time_s"]
    assert len(times) == len(d.data) + 8
    assert np.all(np.diff(times) > 0)


def test_touches_of_another_artefact_are_refused_with_their_file(tmp_path: Path) -> None:
    d, _ = doubted(2)
    setup, first, plan, log = (tmp_path / n for n in ("s.toml", "1.csv", "next.csv", "next.log"))
    setup.write_text('[machine]\npreset = "trt-ca"\n[artefact]\nkind = "cross"\n', encoding="utf-8")
    ball = tn.Setup(tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(30.0, 20.0, 60.0)))
    tn.simulate(tn.plan(ball), ball).to_csv(first)
    tn.next_touches(d, 8).to_csv(plan)
    command = ["simulate", str(plan), str(setup), "--probe-log", str(log), "--quiet"]
    assert CliRunner().invoke(app, command).exit_code == 0
    said = CliRunner().invoke(
        app, ["touches", *map(str, (plan, log, setup)), "--after", str(first)]
    )
    assert said.exit_code == 2
    assert "touch in line 2 of 1.csv " in " ".join(said.output.split())


def test_touches_whose_clock_begins_anew_follow_after_a_stated_pause(tmp_path: Path) -> None:
    """The message names the command that mends it; with it the times are those of one clock."""
    setup, first, plan, log = (tmp_path / n for n in ("s.toml", "1.csv", "next.csv", "next.log"))
    made = tn.Setup(tn.Artefact("cross"))
    setup.write_text(made.to_toml())
    whole = tn.simulate(tn.plan(made), made, noise_um=0.3, seed=5)
    whole[:60].to_csv(first)
    later = tn.plan(made)[60:]
    anew = later.with_columns(time_s=later["time_s"] - later["time_s"].min() + 4.0)
    command = ["simulate", str(plan), str(setup), "--probe-log", str(log), "--quiet"]
    for given in (anew, anew.with_columns(time_s=None)):
        given.to_csv(plan)
        log.unlink(missing_ok=True)
        assert CliRunner().invoke(app, command).exit_code == 0
        words = ["touches", *map(str, (plan, log, setup)), "--after", str(first)]
        refused = CliRunner().invoke(app, words)
        assert refused.exit_code == 2
        assert refused.stderr.rstrip().endswith(f"{' '.join(words)} --pause SECONDS")
        said = CliRunner().invoke(app, [*words, "--pause", "100", "-o", str(tmp_path / "both.csv")])
        assert said.exit_code == 0, said.output
        times = tn.read_touches(tmp_path / "both.csv")["time_s"]
        assert times[60] == pytest.approx(times[59] + 100.0)
        assert np.all(np.diff(times) > 0)
        (tmp_path / "both.csv").unlink()
    refused = CliRunner().invoke(app, [*words[:-2], "--pause", "100"])
    assert "--pause: got it without --after" in refused.stderr


def test_a_plan_is_not_followed_by_touches(tmp_path: Path) -> None:
    """With them in one file nothing would show it. Other mistakes are said, and are no refusal."""
    setup, first, plan, log = (tmp_path / n for n in ("s.toml", "1.csv", "next.csv", "next.log"))
    made = tn.Setup(tn.Artefact("cross"))
    setup.write_text(made.to_toml())
    whole = tn.plan(made)
    whole[60:].to_csv(plan)
    command = ["simulate", str(plan), str(setup), "--probe-log", str(log), "--quiet", "--noise-um"]
    assert CliRunner().invoke(app, [*command, "0.3", "--seed", "1"]).exit_code == 0
    out = ["--output", str(tmp_path / "both.csv"), "--pause", "10"]
    whole[:60].to_csv(first)
    for words in (
        ["touches", str(plan), str(log), "--after", str(plan)],
        ["touches", str(plan), str(log), str(setup), "--after", str(first)],
    ):
        refused = CliRunner().invoke(app, [*words, *out])
        assert refused.exit_code == 2
        assert "got touches that all lie exactly where they were planned" in refused.stderr
        assert not (tmp_path / "both.csv").exists()
    first.unlink()
    tn.simulate(whole[:60], made, {"EZ0A": -1000.0}, noise_um=0.3, seed=2).to_csv(first)
    said = CliRunner().invoke(app, [*words, *out])
    assert said.exit_code == 0, said.output
    assert "1.csv: The artefact is found 1000 µm below its place in the set-up" in said.output


def of_two(seed: int) -> tuple[tn.Diagnosis, Machine]:
    """The same beside stops of X, which say nothing of it."""
    first, truth = doubted(seed)
    machine = Machine(truth, NOISE_UM)
    run = next(t.plan for t in tn.next_measurement(first) if t.label == "a positioning run of X")
    stops = done(run, machine, np.random.default_rng([71, seed]))
    return tn.diagnose([first.data, stops], first.setup), machine


def test_further_touches_settle_the_doubt_of_several_measurements() -> None:
    """They follow the first touches, the artefact left as it is: they are one measurement."""
    came = []
    for seed in range(4):
        d, machine = of_two(seed)
        assert len(d.alternatives) > 1
        tests = tn.next_measurement(d)
        labels = [one.label for one in tests]
        assert "the same touches in reversed order" in labels
        best = next(one for one in tests if one.label.startswith("8 touches chosen for it"))
        assert best.kind == "touches"
        assert len(best.plan) == 8
        assert best.plan["time_s"].min() > d.data[0]["time_s"].max()
        assert set(best.apart) <= set(d.alternatives[1:MAX_SETS])
        more = done(best.plan, machine, np.random.default_rng([73, seed]))
        both = tn.diagnose([d.data[0].followed_by(more), d.data[1]], d.setup)
        if best.chance >= CHANCE:
            came.append([c.id.rpartition(":")[2] for c in both.causes] == ["probe_radius"])
    assert len(came) >= 3
    assert all(came)


def test_the_command_plans_touches_that_settle_the_doubt_of_several(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    d, _ = of_two(1)
    for data, name in zip(d.data, ("touches.csv", "stops.csv"), strict=True):
        data.to_csv(name)
    Path("setup.toml").write_text(d.setup.to_toml(), encoding="utf-8")
    words = ["diagnose", "--joint", "touches.csv", "stops.csv", "setup.toml", "--next", "1"]
    said = CliRunner().invoke(app, [*words, "--output", "found.json"])
    assert said.exit_code == 0, said.output
    assert "Next: 8 touches chosen for it, the artefact left" in " ".join(said.output.split())
    assert len(tn.read_touches("next.csv")) == 8
    assert "next_measurements" in Path("found.json").read_text(encoding="utf-8")
