"""Touches on the diagnosis engine: exact columns, honest input, what a user does next."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

import trunnion as tn
from power.study import ground
from trunnion.cli import app
from trunnion.diagnosis import alike, candidates, explain, terms
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.functions import DEPENDENT
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.selection import Found
from trunnion.diagnosis.whitening import Scaling
from trunnion.models.touches import TouchDiagnosisModel
from trunnion.probing.model import TouchModel
from twin.forward import EFFECTS, Truth
from twin.generator import (
    effect_change_um,
    measure,
    random_effect,
    random_errors,
    random_placement,
    setup_toml,
    write_touches,
)

COLUMN_ERR_TOL = 1e-6  # relative, against the twin's solved readings
SECOND_ORDER_TOL = 1e-3  # of a column, 100" and 100 µm of machine and placement


def measured(effects: Mapping[str, Mapping[str, float]], plan: str = "rich", seed: int = 1) -> Any:
    rng = np.random.default_rng(seed)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=dict(effects))
    made, setup, _, _ = ground(plan)
    return measure(made, setup, truth, noise_um=0.3, tick_um=0.1, seed=seed)


@pytest.mark.parametrize("plan", ["paper", "rich"])
def test_columns_are_the_twins(plan: str) -> None:
    """Change of every reading by every effect, core against the independent generator."""
    made, setup, _, read = ground(plan)
    data = tn.Touches(measured({}, plan).columns)
    model = TouchDiagnosisModel(data, read)
    assert {e.id for e in model.effects} == set(EFFECTS)
    rng = np.random.default_rng(3)
    for effect in model.effects:
        values = random_effect(rng, effect.id, made)
        theirs = effect_change_um(made, setup, {effect.id: values})
        size = max(float(np.abs(theirs).max()), 1e-3)
        ours = np.asarray(effect.change(values))
        assert np.abs(ours - theirs).max() < COLUMN_ERR_TOL * size, effect.id
        linear = [p.name for p in effect.parameters if p.linear]
        columns = model.effect_jacobian(model.start, effect, values)[:, : len(linear)]
        change = columns @ [values.get(name, 0.0) for name in linear]  # theirs does not turn
        assert np.abs(change - theirs).max() < SECOND_ORDER_TOL * size, effect.id


def test_derivatives_at_many_durations_are_those_at_each() -> None:
    model = TouchDiagnosisModel(tn.Touches(measured({}).columns), ground("rich")[3])
    effect = model.effect("warmup_z")
    taus = (3.0, 20.0, 400.0)
    values = [Values({"amplitude_um": 0.0, "tau_min": tau}) for tau in taus]
    several = model.linear_columns(model.start, effect, values)
    for number, (columns, at) in enumerate(zip(several, values, strict=True)):
        alone = model.effect_jacobian(model.start, effect, at)
        np.testing.assert_allclose(columns[0], alone[:, 0], rtol=1e-12, atol=1e-15)
        minutes = np.asarray(model.data.time_s) / 60.0
        minutes = minutes - minutes.min()
        law = [1.0 - np.exp(-minutes / tau) for tau in taus]
        np.testing.assert_allclose(columns[0] * law[0], several[0][0] * law[number], atol=1e-12)


def test_touches_together_are_those_one_by_one() -> None:
    """What neighbouring touches, or values of parameters, share is kept, and nothing else."""
    made, _, _, read = ground("rich")
    data = tn.Touches(measured({}).columns)
    rng = np.random.default_rng(4)
    drawn = {name: random_effect(rng, name, made) for name in EFFECTS}
    for ids in (list(EFFECTS), ["drift_z", "artefact_length"], ["c_positioning_2"], []):
        model = TouchModel(read, ids)
        values = model.values(
            {"EX0C": 20.0, "EB0C": 8.0}, {"dx_um": 30.0}, {i: drawn[i] for i in ids}
        )
        longer = np.char.endswith(model.names, "artefact_length.dl_um")
        other = values + np.where(longer, 7.0, 0.0)
        # With the touches before and after in the same place at other times, and elsewhere.
        some = data[np.array([*range(12), 40, 41, 200, 12, 201])]
        moves, columns = model.moves(some), list(range(len(values)))
        off, slope = model.core.linearise(moves, values)
        left = model.core.residuals(moves, values)
        both = model.core.rates(moves, np.stack([values, other]), columns)
        rates = [model.core.rates(moves, one[None], columns) for one in (values, other)]
        assert np.array_equal(both, np.concatenate(rates))
        first = int(np.argmin(np.asarray(some.time_s)))  # from which time counts
        for i in range(len(some)):
            alone = model.moves(some[np.array([first, i])])
            own_off, own_slope = model.core.linearise(alone, values)
            assert own_off[1] == off[i] == left[i] == model.core.residuals(alone, values)[1]
            assert np.array_equal(own_slope[1], slope[i])


def test_a_dictionary_with_other_weights_is_that_made_anew() -> None:
    model = TouchDiagnosisModel(tn.Touches(measured({}).columns), ground("rich")[3])
    rows = np.arange(len(model.readings))
    weights = Scaling(np.linspace(0.5, 2.0, len(rows)))
    first = Dictionary(model, rows)
    again, anew = Dictionary(model, rows, weights, first), Dictionary(model, rows, weights)
    r, basis = np.sin(rows), np.full((len(rows), 1), len(rows) ** -0.5)
    np.testing.assert_array_equal(again.gains(r, basis)[0], anew.gains(r, basis)[0])
    assert again.terms == anew.terms


def test_the_main_job_in_words(tmp_path: Path) -> None:
    m = measured({"drift_z": {"rate_um_h": 4.8}})
    d = tn.diagnose(tn.Touches(m.columns), ground("rich")[3])
    assert d.verdict == "explained"
    first, second = d.summary().splitlines()[:2]
    assert first.startswith("Explained by one cause: drift of the Z axis (drift_z): ")
    assert second.startswith("Without it, EZ0A is biased by ")
    assert d.causes[0].parameters["rate_um_h"] == pytest.approx(4.8, abs=0.4)
    assert d.model.effects["drift_z"]["rate_um_h"] == d.causes[0].parameters["rate_um_h"]
    page = d.to_html(tmp_path / "page.html").read_text(encoding="utf-8")
    assert 'data-figure="0"' in page
    loads = re.sub(r"<script[^>]*>.*?</script>", "", page, flags=re.DOTALL)
    assert "src=" not in loads
    json.dumps(d.to_dict(), allow_nan=False)


def test_the_extended_model_is_an_ordinary_model() -> None:
    setup = ground("rich")[3]
    d = tn.diagnose(tn.Touches(measured({"backlash_x": {"b_um": 3.0}}).columns), setup)
    plan = tn.plan(setup)
    exact = tn.simulate(plan, setup, d.model.errors, d.model.placement, d.model.effects)
    again = tn.identify(exact, setup, effects=tuple(d.model.effects))
    assert again.effects["backlash_x"]["b_um"] == pytest.approx(
        d.causes[0].parameters["b_um"], abs=0.1
    )
    assert d.model.simulate(plan) == tn.simulate(plan, setup, d.model) == exact
    same = tn.identify(exact, setup, effects=d.model)
    assert same == again
    assert same.owners == {"backlash_x": "machine"}


def test_score_on_another_measurement_of_the_machine() -> None:
    setup = ground("rich")[3]
    effects = {"c_positioning_2": {"a2_arcsec": 4.0, "b2_arcsec": 3.0}}
    d = tn.diagnose(tn.Touches(measured(effects, seed=2).columns), setup)
    other = measured(effects, seed=2)
    moved = Truth(other.truth.errors, random_placement(np.random.default_rng(9)), effects)
    made, twin_setup, _, _ = ground("rich")
    further = measure(made, twin_setup, moved, noise_um=0.3, tick_um=0.1, seed=77)
    g = d.score(tn.Touches(further.columns))
    assert g.heldout_rms_after_um == pytest.approx(0.3, abs=0.05)
    assert g.heldout_rms_before_um > 1.3 * g.heldout_rms_after_um


class Magnet:
    """A user's own effect: a chuck that pulls the ball down where C is near 90 degrees."""

    id = "magnet"
    parameters = ("pull_um",)

    def change(self, data: tn.Touches, values: Mapping[str, float]) -> NDArray[np.float64]:
        near = np.exp(-((np.asarray(data.c_deg) - 90.0) ** 2) / 800.0)
        return np.asarray(values["pull_um"] * near * np.asarray(data.dir_z))


def test_a_users_own_effect() -> None:
    setup = ground("rich")[3]
    plan = tn.Touches(measured({}).columns)
    own = Magnet()
    data = plan.with_columns(
        **{
            f"{axis}_mm": plan.position_mm[:, i]
            + 1e-3 * own.change(plan, {"pull_um": 3.0}) * plan.direction[:, i]
            for i, axis in enumerate("xyz")
        }
    )
    assert tn.diagnose(data, setup).verdict == "unexplained"
    d = tn.diagnose(data, setup, effects=[own, "drift_z"])
    assert [c.id for c in d.causes] == ["magnet"]
    assert d.causes[0].parameters["pull_um"] == pytest.approx(3.0, abs=0.4)
    with pytest.raises(tn.UnknownNameError, match="drift_q"):
        tn.diagnose(data, setup, effects=["drift_q"])


def test_bad_input() -> None:
    setup = ground("paper")[3]
    data = tn.Touches(measured({}, "paper").columns)
    with pytest.raises(tn.InputError, match="setup"):
        tn.diagnose(data)
    with pytest.raises(tn.DataError, match="5 mm"):
        tn.diagnose(data.with_columns(z_mm=np.asarray(data.z_mm) + 6.0), setup)
    with pytest.raises(tn.DataError, match="unknowns"):
        tn.diagnose(data[:10], setup)


def test_touches_without_time_or_feed() -> None:
    setup = ground("paper")[3]
    m = measured({"c_axial_2": {"a2_um": 2.0, "b2_um": 0.0}}, "paper")
    bare = {k: v for k, v in m.columns.items() if k not in ("time_s", "feed_mm_min", "point")}
    d = tn.diagnose(tn.Touches(bare), setup)
    assert frozenset({"c_axial_2"}) in d.alternatives
    assert not any("drift" in e.id for e in d.rebuilt_model().effects)


def test_next_touches_part_the_aliases_of_a() -> None:
    setup = ground("paper")[3]
    m = measured({"a_positioning": {"k_arcsec": 18.0}}, "paper")
    d = tn.diagnose(tn.Touches(m.columns), setup)
    assert d.verdict == "ambiguous"
    more = tn.next_touches(d, 8)
    assert len(more) == 8
    assert np.min(np.asarray(more.time_s)) > np.max(m.columns["time_s"])
    said = tn.expected_discrimination(d, 8)
    assert said.chance > 0.8
    assert "touches distinguish the" in said.summary()


def test_next_touches_say_when_none_can() -> None:
    """A ball radius and its bending stay alike under any plan this small."""
    setup = ground("paper")[3]
    m = measured({"probe_radius": {"dr_um": 0.4}}, "paper")
    d = tn.diagnose(tn.Touches(m.columns), setup)
    said = tn.expected_discrimination(d, 8)
    assert said.chance < 0.5
    assert said.enough is None or said.enough > 8
    with pytest.raises(tn.InputError, match="n:"):
        tn.next_touches(d, 0)


def test_command_line(tmp_path: Path) -> None:
    write_touches(measured({"drift_z": {"rate_um_h": 4.8}}), tmp_path / "touches.csv")
    (tmp_path / "setup.toml").write_text(setup_toml(ground("rich")[1]), encoding="utf-8")
    files = [str(tmp_path / "touches.csv"), str(tmp_path / "setup.toml")]
    run = CliRunner().invoke(app, ["diagnose", *files, "--html", str(tmp_path / "d.html")])
    assert run.exit_code == 0, run.output
    assert "drift of the Z axis (drift_z): " in run.output
    assert (tmp_path / "d.html").exists()
    printed = CliRunner().invoke(app, ["diagnose", *files, "--json"])
    assert json.loads(printed.output)["causes"][0]["id"] == "drift_z"
    more = [*files, "--next", "3", "-o", str(tmp_path / "next.csv")]
    assert CliRunner().invoke(app, ["diagnose", *more]).exit_code == 0
    assert len(tn.read_touches(tmp_path / "next.csv")) == 3
    assert CliRunner().invoke(app, ["diagnose", files[0]]).exit_code == 2
    assert CliRunner().invoke(app, ["diagnose", files[1]]).exit_code == 2


def test_a_bad_touch_that_weighs_much_is_told_from_those_that_check_it() -> None:
    """Touch 17 at A = 90°: the fit follows it. It bends the model as touch 20 does, no other."""
    read = ground("paper")[3]
    columns = dict(measured({}, "paper").columns)
    rows = (columns["a_deg"] == 90) & np.isin(columns["point"], [17, 20])
    at = int(np.flatnonzero(rows & (columns["point"] == 17))[0])
    for axis in "xyz":
        columns[f"{axis}_mm"] = np.array(columns[f"{axis}_mm"])
        columns[f"{axis}_mm"][at] += 0.05 * columns[f"dir_{axis}"][at]
    d = tn.diagnose(tn.Touches(columns), read)
    assert d.outliers == tuple(np.flatnonzero(rows))
    assert d.causes == ()
    lost = [name for name in d.errors_after if name in d.not_identifiable]
    assert lost == ["EB0A", "EC0A"]
    assert all(np.isinf(d.errors_std[name]) for name in lost)
    assert all(np.isfinite(s) for name, s in d.errors_std.items() if name not in lost)
    again = "only the outliers identify it: measure them again"
    assert f"Not identifiable: EB0A, EC0A ({again})." in d.summary()


def test_touches_without_any_noise_are_put_into_words(tmp_path: Path) -> None:
    setup = str(tn.sample_path("cross/setup.toml"))
    touches = str(tmp_path / "touches.csv")
    run = CliRunner().invoke(app, ["simulate", setup, "--noise-um", "0", "-o", touches])
    assert run.exit_code == 0
    said = CliRunner().invoke(app, ["diagnose", touches, setup])
    assert said.exit_code == 0, said.output
    doubt, verdict = said.output.splitlines()[:2]
    assert doubt.startswith("Every touch lies where the set-up expects it")
    assert verdict.startswith("Consistent: ")


def _cross_at(a_deg: tuple[float, ...]) -> tuple[tn.Touches, tn.Setup]:
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    return touches[np.isin(touches.rotary_deg["a"], a_deg)], setup


@pytest.mark.parametrize("a_deg", [(0.0,), (0.0, 90.0), (0.0, -90.0, 90.0)])
def test_diagnosis_and_identification_agree_on_what_is_identifiable(
    a_deg: tuple[float, ...],
) -> None:
    """The same estimates, the same standard errors, the same ones without."""
    touches, setup = _cross_at(a_deg)
    fit = tn.identify(touches, setup)
    d = tn.diagnose(touches, setup)
    assert d.verdict == "consistent"
    for name, value in d.errors_after.items():
        std, expected = d.errors_std[name], fit.std_errors[name]
        assert np.isinf(std) == np.isinf(expected), name
        if np.isinf(std):
            assert value == pytest.approx(fit.errors[name], abs=1e-3)
        else:
            assert std == pytest.approx(expected, rel=1e-4)
            assert abs(value - fit.errors[name]) < 1e-3 * std


def test_an_effect_that_shares_with_an_error_leaves_neither_identified() -> None:
    """A sag of the A axis lifts the table at A = 90 deg as an offset of the axis does."""
    data = tn.Touches(measured({"a_sag": {"ky_um": 2.0, "kz_um": 3.0}}).columns)
    setup = ground("rich")[3]
    d = tn.diagnose(data, setup)
    assert [c.id for c in d.causes] == ["a_sag"]
    fit = tn.identify(data, setup, effects=("a_sag",))
    for name, value in d.errors_after.items():
        std = d.errors_std[name]
        assert np.isinf(std) == np.isinf(fit.std_errors[name]), name
        assert value == pytest.approx(fit.errors[name], abs=1e-3)
    assert np.isinf(d.errors_std["EZ0A"])
    assert np.isinf(d.causes[0].std_errors["kz_um"])


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"backlash_x": {"b_um": 6.0}}, {"backlash_y": {"b_um": -6.0}}),
        ({"scale_x": {"ppm": 60.0}}, {"scale_y": {"ppm": -60.0}}),
        ({"drift_x": {"rate_um_h": 8.0}}, {"drift_y": {"rate_um_h": -8.0}}),
    ],
)
@pytest.mark.parametrize("plan", ["paper", "rich"])
def test_opposite_causes_are_no_structure_without_a_name(
    first: Any, second: Any, plan: str
) -> None:
    """Touches along X and Y only show opposite backlashes as a 2nd harmonic of the azimuth."""
    for seed in range(40, 43):
        data = tn.Touches(measured({**first, **second}, plan, seed).columns)
        d = tn.diagnose(data, ground(plan)[3])
        assert d.unexplained is None
        assert d.named == {*first, *second}
        for cause in d.causes:
            for name, value in {**first, **second}[cause.id].items():
                assert abs(cause.parameters[name] - value) < 4 * cause.std_errors[name]


def makes(case: Case, term: int, best: Found) -> bool:
    """Whether causes of a set make all of a term, by least squares of their columns."""
    columns, basis = case.dictionary.block(term), case.plain.basis
    u, size, _ = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
    own = u[:, size**2 > DEPENDENT]
    blocks = [case.candidates.columns(b).T for b in best.blocks]
    sizes = np.linalg.lstsq(np.concatenate(blocks, axis=1), own, rcond=case.candidates.dependent)[0]
    made = np.split(sizes, np.cumsum([b.shape[1] for b in blocks])[:-1])
    left = own - sum(b @ s for b, s in zip(blocks, made, strict=True))
    shares = [float((s**2).sum(axis=0).max(initial=0.0)) for s in made]
    acting = sum(b.shape[1] for b, s in zip(blocks, shares, strict=True) if s > alike.SAME_SHARE)
    same = (left**2).sum(axis=0).max(initial=0.0) < alike.SAME_SHARE
    return bool(same and max(shares) < 1 + alike.SAME_SHARE and acting <= own.shape[1] + 1)


def test_terms_that_causes_make_are_those_by_least_squares_of_their_columns(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is decided on inner products, of many readings with those that the search has."""
    setup = ground("paper")[3]
    causes = {"backlash_x": {"b_um": 6.0}, "backlash_y": {"b_um": -6.0}}
    data = tn.Touches(measured(causes, "paper", 40).columns)
    asked, sums = list[bool](), alike.sums_of_causes

    def checked(case: Case, some: Sequence[int], best: Found) -> set[int]:
        found = sums(case, some, best)
        assert found == {term for term in some if makes(case, term, best)}
        asked.extend(term in found for term in some)
        return found

    monkeypatch.setattr(explain, "sums_of_causes", checked)
    few = tn.diagnose(data, setup)
    assert set(asked) == {False, True}
    of_few = list(asked)
    asked.clear()
    monkeypatch.setattr(terms, "MANY_ROWS", 0)
    monkeypatch.setattr(candidates, "MANY_ROWS", 0)
    assert tn.diagnose(data, setup).named == few.named
    assert asked == of_few


def shifted(seed: int) -> tuple[tn.Diagnosis, tn.Setup]:
    """A shift before the last six touches, of which none is along X of the table."""
    setup = tn.Setup(tn.Artefact("cross"))
    plan = tn.plan(setup, c_deg=(0, 90, 180, 270), a_deg=(90, -90))
    last = tn.simulate(plan, setup)["time_s"][-6:]
    shift = {"dx_um": 30.0, "dy_um": -20.0, "dz_um": 50.0, "t0_s": float(last[0]) - 0.5}
    touches = tn.simulate(
        plan, setup, {"EX0C": 20.0}, effects={"setup_shift": shift}, noise_um=0.5, seed=seed
    )
    return tn.diagnose(touches, setup), setup


@pytest.mark.parametrize("seed", range(60, 66))
def test_a_shift_that_no_touch_shows_in_x_is_found_in_y_and_z(seed: int) -> None:
    """Errors of the machine make a little of X show: a step along it went 12 mm."""
    d, _ = shifted(seed)
    cause = next(c for c in d.causes if c.id == "setup_shift")
    assert cause.std_errors["dx_um"] == np.inf
    assert cause.parameters["dx_um"] == 0.0
    for name, true in (("dy_um", -20.0), ("dz_um", 50.0)):
        assert cause.parameters[name] == pytest.approx(true, abs=4 * cause.std_errors[name])
        assert np.isfinite(cause.std_errors[name])  # wider where other sets are in doubt
    assert d.gain.rms_after_um < 0.7


def test_a_size_that_is_not_known_is_said_to_be_the_size() -> None:
    cause = tn.Cause("change_EY0C", {"change_um": 3.0}, {"change_um": np.inf}, 1e-6)
    assert cause.size() == "size not identifiable"
