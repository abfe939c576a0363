"""Measurements of one machine compared: what changed, by how much, what did not."""

from datetime import UTC, date, datetime
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from positioning_twin import axis
from promise import kept, needed_runs
from result_examples import diagnosis_of
from test_levels import bed, measured
from trunnion.cli import app
from trunnion.models.kinds import kinds
from trunnion.plot.changes import changes_picture


def stops(seed: int, reversal: float, scale: float = 0.0) -> tn.Positioning:
    """An axis with a reversal (µm) and a scale error (ppm)."""
    rng = np.random.default_rng([11, seed])
    plain = axis(np.random.default_rng(5), targets=7, cycles=3)  # the same targets every time
    error = reversal / 2 * plain.direction + 1e-3 * scale * plain.target
    noise = 0.7 * rng.standard_normal(len(plain))
    return plain.with_columns(measured_mm=plain.target + 1e-3 * (error + noise))


def test_a_change_is_found_with_its_size() -> None:
    """Reversal 3 → 7 µm, scale as it was: the interval holds the change in 95 of 100 cases."""
    runs, held, sure = needed_runs(0.95), 0, 0
    for seed in range(runs):
        found = tn.compare(stops(2 * seed, 3.0, 20.0), stops(2 * seed + 1, 7.0, 20.0))
        q = next(q for q in found.quantities if q.name == "reversal.b_um")
        held += q.low <= 4.0 <= q.high
        sure += "reversal.b_um" in found.changed and "scale.ppm" not in found.changed
    assert kept(held, runs, 0.95)
    assert kept(sure, runs, 0.95)


def test_nothing_changed_where_nothing_did() -> None:
    """Over all quantities together, with causes that are there both times."""
    runs = needed_runs(0.95)
    calm = [not tn.compare(stops(s, 5.0, 30.0), stops(1000 + s, 5.0, 30.0)).changed
            for s in range(runs)]  # fmt: skip
    assert kept(sum(calm), runs, 0.95)


def test_what_only_one_diagnosis_names_is_compared_in_both() -> None:
    found = tn.compare(stops(1, 0.0), stops(2, 6.0))
    change, std = found.changes["reversal.b_um"]
    assert change == pytest.approx(6.0, abs=4 * std)
    assert abs(next(q for q in found.quantities if q.name == "reversal.b_um").before) < 1.0


def test_a_collision_of_a_machine_with_rotary_axes() -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    plan = tn.plan(setup, c_deg=(0, 90, 180, 270), a_deg=(90, -90))
    before, after = (
        tn.simulate(plan, setup, {"EX0C": e, "EB0C": 8.0}, noise_um=0.3, seed=seed)
        for seed, e in ((1, 10.0), (2, 25.0))
    )
    found = tn.compare(before, after, setup=setup)
    change, std = found.changes["EX0C"]
    assert change == pytest.approx(15.0, abs=4 * std)
    assert found.changed == {"EX0C"}
    assert "Changed from before to after: EX0C" in found.summary()
    fits = tn.compare(tn.identify(before, setup), tn.identify(after, setup))
    assert fits.changes["EX0C"][0] == pytest.approx(change, abs=std)
    # the artefact is another one: its uncertainty, 10 µm, is more than the change
    other = tn.compare(before, after, setup=setup, uncertainty={"EX0C": 10.0})
    assert not other.changed
    assert other.changes["EX0C"] == pytest.approx((change, np.hypot(std, 10 * 2**0.5)))


@pytest.mark.parametrize("kind", [k.name for k in kinds()])
def test_every_kind_is_compared(kind: str) -> None:
    """A measurement against itself: nothing changed, and every cause takes part."""
    found = diagnosis_of(kind)
    same = tn.compare(found, found)
    assert same.mistakes[0].startswith("after has the same readings as before in every row: ")
    assert not same.changed
    assert all(q.change == pytest.approx(0.0, abs=1e-6) for q in same.quantities)
    compared = {q.name.partition(".")[0].partition(" ")[0] for q in same.quantities}
    of_setup = {e.id for e in tn.catalogue(found.data, found.setup) if e.owner.of_setup}
    assert found.named - of_setup <= compared


def test_values_over_time_have_a_trend() -> None:
    """Reversal grows by 0.1 µm a day; scale stands; one day stands out."""
    days = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]
    series = [stops(i, 2.0 + 0.1 * d, 15.0) for i, d in enumerate(days)]
    found = tn.compare(*series, dates=days)
    trend = {t.name: t for t in found.trends}
    grown = trend["reversal.b_um"]
    assert grown.rate == pytest.approx(0.1, abs=4 * grown.std_error)
    assert grown.changing
    assert not trend["scale.ppm"].changing
    assert "Trend: " in found.summary()
    jumped = [stops(i, 2.0 + (8.0 if i == 7 else 0.0)) for i in range(12)]
    out = {t.name: t for t in tn.compare(*jumped).trends}["reversal.b_um"]
    assert out.outside == (7,)


def test_dates_of_any_kind() -> None:
    three = [stops(i, 2.0).iso230_2() for i in range(3)]
    utc = datetime(2026, 1, 11, tzinfo=UTC)
    for dates in (
        ["2026-01-01", "2026-01-11T00:00:00", "2026-03-01"],
        [date(2026, 1, 1), utc, date(2026, 3, 1)],
    ):
        assert tn.compare(*three, dates=dates).days == (0.0, 10.0, 59.0)


def test_rows_that_were_pasted_twice_count_once() -> None:
    """Of data, and of diagnoses of them, with an outlier: the same changes, and it is said."""
    one, other = stops(1, 2.0), stops(2, 6.0)
    far = one["measured_mm"].copy()
    far[5] += 0.05
    one = one.with_columns(measured_mm=far)
    twice = [d[np.tile(np.arange(len(d)), 2)] for d in (one, other)]
    assert tn.diagnose(one).outliers == (5,)
    plain = tn.compare(one, other)
    for found in (tn.compare(*twice), tn.compare(*map(tn.diagnose, twice))):
        for name, (change, std) in plain.changes.items():
            assert found.changes[name] == pytest.approx((change, std), rel=1e-6), name
        said = [note for note in found.notes if "rows repeat others in every column" in note]
        assert [note.partition(":")[0] for note in said] == ["before", "after"]


def test_estimates_that_are_given_twice_and_names_given_twice_are_said() -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    plan = tn.plan(setup, c_deg=(0, 90, 180, 270), a_deg=(90, -90))
    fits = [
        tn.identify(tn.simulate(plan, setup, {}, noise_um=0.3, seed=s), setup) for s in (1, 2, 1)
    ]
    found = tn.compare(*fits, dates=["2026-01-01", "2026-01-01", "2026-03-01"])
    assert found.names == ("2026-01-01 (1)", "2026-01-01 (2)", "2026-03-01")
    (said,) = found.mistakes
    assert said.startswith("2026-03-01 has the same values and standard errors as 2026-01-01 (1) ")


def test_what_cannot_be_compared_is_refused() -> None:
    one, two = stops(1, 2.0), stops(2, 2.0)
    level = tn.read_levels(tn.sample_path("levels/bed.csv"))
    with pytest.raises(tn.InputError, match="Positioning and Levels"):
        tn.compare(one, level)
    with pytest.raises(tn.InputError, match="out of order"):
        tn.compare(one, two, dates=["2026-02-01", "2026-01-01"])
    with pytest.raises(tn.InputError, match="got 2026-02-01 for each of 2 measurements"):
        tn.compare(one, two, dates=["2026-02-01", "2026-02-01"])
    with pytest.raises(tn.InputError, match="one a measurement, 2"):
        tn.compare(one, two, dates=[1.0])
    with pytest.raises(tn.InputError, match="got 'later'"):
        tn.compare(one, two, dates=["2026-01-01", "later"])
    with pytest.raises(tn.InputError, match="uncertainty"):
        tn.compare(one, two, uncertainty={"EX0C": 1.0})
    with pytest.raises(tn.InputError, match="got float"):
        tn.compare(1.0, 2.0)


def test_other_targets_are_said() -> None:
    fewer = stops(2, 5.0)
    fewer = fewer[fewer.target < 470]
    found = tn.compare(stops(1, 5.0), fewer)
    assert any("other places (7, 6)" in note for note in found.notes)
    assert not found.changed


@pytest.mark.parametrize("seed", range(3))
def test_runs_without_a_common_target_are_compared_by_causes(seed: int) -> None:
    one, two = stops(seed, 3.0), stops(seed + 3, 7.0)
    moved = two.with_columns(target_mm=two.target + 7.0, measured_mm=two.measured + 7.0)
    found = tn.compare(one, moved)
    (said,) = (note for note in found.notes if "no place in common" in note)
    ends = [f"{value:g}" for value in (one.target.min(), one.target.max())]
    assert f"of 7 from {ends[0]} to {ends[1]} and 7 from" in said
    assert found.changed == {"reversal.b_um"}
    assert found.changes["reversal.b_um"][0] == pytest.approx(4.0, abs=0.8)
    assert not set(found.changes) & {"accuracy_um", "mean_reversal_um"}


def test_lines_of_a_level_without_a_common_place_are_compared_by_causes() -> None:
    rng = np.random.default_rng(1)
    slopes = 20.0 + 0.5 * rng.standard_normal(20)
    one = tn.Levels(position_mm=50.0 * np.arange(20), along_um_m=slopes)
    moved = one.with_columns(position_mm=np.asarray(one.position_mm) + 30.0)
    found = tn.compare(one, moved)
    assert any("no place in common" in note for note in found.notes)
    assert not found.changed


def test_the_command_compares(tmp_path: Path) -> None:
    paths = [tmp_path / "before.csv", tmp_path / "after.csv"]
    for i, path in enumerate(paths):
        stops(i, 3.0 + 5.0 * i).to_csv(path)
    said = CliRunner().invoke(app, ["compare", *map(str, paths)])
    assert said.exit_code == 0, said.output
    assert "Changed from before to after" in said.output
    assert "reversal of the axis, forward less backward" in said.output


def test_the_report_has_one_uncertainty_and_names_both_measurements(tmp_path: Path) -> None:
    plates = [tn.sample_path(f"plate/{name}.csv") for name in ("first", "second")]
    found = tn.compare(*map(tn.read, plates), names=("first", "second"))
    page = found.to_html(tmp_path / "r.html", data=[tn.read(p) for p in plates])
    text = page.read_text(encoding="utf-8")
    text = text[text.index("<main>") : text.index("</main>")]
    assert "<h1>Comparison: nothing changed</h1>" in text
    assert "U (k = 2)" not in text
    bow, scale, shape = found.quantities
    assert (bow.label[-8:], shape.label[-12:]) == ("bow (a2)", "S-shape (a3)")
    for q in (bow, scale, shape):
        half = f'data-value="{q.high - q.change:.9g}"'
        assert half in text, q.name
    for name in ("first.csv", "second.csv"):
        assert f"<td>{name}</td>" in text
    reach = changes_picture(found).x.limits
    sizes = [abs(q.change) / (q.high - q.change) for q in found.quantities]
    assert reach is not None
    assert max(*sizes, 1.0) < reach[1] < 2 * max(*sizes, 1.0)


@measured
def test_the_lathe_bed_bent_back() -> None:
    """What changed is across the bed, and nothing else did; along it one reading, at its end."""
    whole = tn.compare(bed("found"), bed("bent_back"), names=["as found", "bent back"])
    q = next(q for q in whole.quantities if q.name == "twist_um_m_m")
    assert (q.before, q.after) == pytest.approx((143.0, -37.0), abs=1.0)
    assert q.changed
    along = {"straightness_um", "minimum_zone_um", "bow.h_um", "kink.along_um_m"}
    assert along <= set(whole.changes)
    assert not along & whole.changed
    # Along the bed the reading at 0 mm was 234 and is 153 µm/m, and no other differs by half of it.
    before, after = bed("found"), bed("bent_back")
    one, two = np.intersect1d(before["position_mm"], after["position_mm"], return_indices=True)[1:]
    off = np.abs(before["along_um_m"][one] - after["along_um_m"][two])
    assert off[0] > 80.0
    assert np.all(off[1:] < 40.0)
    found = tn.compare(before[before["position_mm"] > 0], after[after["position_mm"] > 0])
    across = {"twist_um_m_m", "twist.k_um_m_m", "roll_um_m", "field (rms, across)"}
    # Bent back, a twist and a kink explain what is left across the bed about as well.
    assert across <= found.changed <= across | {"kink.across_um_m"}
    same = (along | {"field (rms, along)"}) - {"kink.along_um_m"}
    assert same <= set(found.changes) - found.changed
    assert "Not changed, 95 % each" in found.summary()


def test_what_is_missing_of_a_comparison_is_said() -> None:
    """Names and values alone have no standard errors; others may not be identifiable."""
    known = tn.Estimate(errors={"EX0C": 15.0, "EB0A": 3.0}, std_errors={"EX0C": 0.2, "EB0A": 0.3})
    bare = tn.Estimate(errors={"EX0C": 16.0, "EB0A": 3.0})
    found = tn.compare(known, bare)
    assert not found.quantities
    said = found.summary().replace("\n", " ")
    assert "Not compared, as after has no standard error of it: EX0C, EB0A." in said
    assert "trunnion estimate TOUCHES SETUP -o estimate.json" in said
    one = tn.Estimate(errors={"EX0C": 16.0, "EB0A": 3.0}, std_errors={"EX0C": 0.2})
    partly = tn.compare(known, one)
    assert [q.name for q in partly.quantities] == ["EX0C"]
    assert any("after has no standard error of it: EB0A." in note for note in partly.notes)
    blind = tn.Estimate(
        errors={"EX0C": 16.0, "EB0A": 3.0}, std_errors={"EX0C": 0.2, "EB0A": float("inf")}
    )
    assert "Not compared, as after does not identify it: EB0A." in tn.compare(known, blind).notes
    other = tn.Estimate(errors={"EY0A": 1.0}, std_errors={"EY0A": 0.1})
    (said,) = tn.compare(known, other).notes
    assert said == "No quantity is in all of them (before: EX0C, EB0A; after: EY0A)."
    assert tn.compare(known, known).notes == ()


def test_what_touches_do_not_identify_is_said() -> None:
    """A sphere on the axis C distinguishes neither where C is from its tilt, nor if it changed."""
    setup = tn.Setup(artefact=tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(0.0, 0.0, 40.0)))
    plan = tn.plan(setup)
    before, after = (
        tn.simulate(plan, setup, {"EX0C": e}, noise_um=0.3, seed=seed)
        for e, seed in ((15.0, 1), (80.0, 2))
    )
    found = tn.compare(before, after, setup=setup)
    lost = "EA0A, EB0C, EX0C, EY0C"
    assert not {*lost.split(", ")} & set(found.changes)
    for name in ("before", "after"):
        assert f"Not compared, as {name} does not identify it: {lost}." in found.notes
