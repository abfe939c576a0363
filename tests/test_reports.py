"""What a report says: results with tolerances, what to do, each cause over its own coordinate."""

from __future__ import annotations

import hashlib
import html
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.offline import get_plotlyjs
from typer.testing import CliRunner

import trunnion as tn
from command_lines import command_lines
from result_examples import EXAMPLES, cross, diagnosis_of
from trunnion.base.report import Result
from trunnion.cli import app
from trunnion.diagnosis.model import Covariate
from trunnion.plot.coordinates import Coordinate, Weight, coordinate_of
from trunnion.plot.diagnosis import Explained, cause_picture, diagnostics
from trunnion.plot.dispatch import pictures
from trunnion.plot.picture import Axis, Form, Picture, band
from trunnion.plot.statistics import order_picture
from trunnion.reports.hover import hovered
from trunnion.reports.space import RESIDUALS
from trunnion.setup.names import error_label

MAX_BYTES = 3_000_000


def simulated(effects: dict[str, dict[str, float]], seed: int = 1, **plan: Any) -> tn.Touches:
    setup = cross()[1]
    planned = tn.plan(setup, **plan)
    return tn.simulate(planned, setup, {"EX0C": 15.0}, effects=effects, noise_um=0.2, seed=seed)


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_every_result_has_a_report_that_needs_nothing_else(name: str, tmp_path: Path) -> None:
    result = EXAMPLES[name]()
    if not isinstance(result, Result):
        pytest.skip("data, not a result")
    text = result.to_html(tmp_path / "r.html").read_text(encoding="utf-8")
    own = text.replace(get_plotlyjs(), "")
    assert own.count("<h1>") == 1
    assert "Where this comes from" in own
    named = re.sub(r'xmlns(?::xlink)?="[^"]*"', "", own)  # names, not addresses
    assert not re.search(r'(?:src|href)="(?!#|data:)|@import|url\((?!#)|https?://', named)
    if "data-figure" in own:
        assert text.count(get_plotlyjs()) == 1
    assert "nan" not in re.sub(r"<script.*?</script>", "", own, flags=re.S).lower().split()


# --- results


def test_old_values_tolerances_and_decisions(tmp_path: Path) -> None:
    setup = cross()[1]
    limits = {"EX0C": 25.0, "EA0A": 5.0, "EY0C": 21.0}
    machine = tn.Machine(errors={"EX0C": 10.0}, tolerance=limits)
    known = tn.Setup(artefact=setup.artefact, machine=machine, probe=setup.probe)
    fit = tn.identify(cross()[0], known)
    page = fit.to_html(tmp_path / "r.html", setup=known).read_text(encoding="utf-8")
    rows = {
        cells[0]: cells[1:]
        for row in re.findall(r"<tr>(.*?)</tr>", page)
        if len(cells := [re.sub("<.*?>", "", c) for c in re.findall(r"<t[hd].*?</t[hd]>", row)])
        == 7
    }
    row = rows["offset of the C axis along X (EX0C)"]
    assert row[0] == "10"
    assert float(row[1]) == pytest.approx(fit["EX0C"], abs=0.05)
    assert float(row[2]) == pytest.approx(2 * fit.std_errors["EX0C"], rel=0.1)
    assert row[4:] == ["± 25", "pass"]
    assert rows["zero position of the A axis (EA0A)"][-1] == "fail"
    assert abs(fit["EY0C"] - 21.0) < 1.6 * fit.std_errors["EY0C"]
    assert rows["offset of the C axis along Y (EY0C)"][-1] == "undecided"
    assert "A tolerance is exceeded." in page
    assert 'class="verdict bad"' in page


def verdict_on(page: Path) -> str:
    found = re.search('<p class="verdict[^>]*>(.*?)</p>', page.read_text(encoding="utf-8"), re.S)
    assert found is not None
    return html.unescape(re.sub("<.*?>", "", found[1]))


def test_the_first_sentence_says_how_large_and_how_sure(tmp_path: Path) -> None:
    effects = {"c_positioning_2": {"a2_arcsec": 3.0, "b2_arcsec": 4.0}}
    d = tn.diagnose(simulated(effects, c_deg=tuple(range(0, 360, 30))), cross()[1])
    said = verdict_on(d.to_html(tmp_path / "r.html"))
    size = re.search(r"twice a turn, amplitude ([\d.]+) ± ([\d.]+) arcsec \(> 99 %\)", said)
    assert size is not None, said
    assert float(size[1]) == pytest.approx(5.0, abs=3 * float(size[2]))
    largest = r"8 errors of the machine, largest: offset of the C axis along X \(EX0C\) 15.\d+ ± "
    assert re.search(rf"{largest}[\d.]+ µm\. Alone,", said)  # no angle is beyond its U
    # U of the amplitude by the law of propagation, from the covariance of the model
    a, b = d.causes[0].parameters.values()
    at = [d.model.names.index(f"c_positioning_2.{n}") for n in d.causes[0].parameters]
    gradient = np.array([a, b]) / np.hypot(a, b)
    variance = gradient @ d.model.covariance[np.ix_(at, at)] @ gradient
    assert float(size[2]) == pytest.approx(2 * np.sqrt(variance), rel=0.06)
    fine = tn.diagnose(simulated({}), cross()[1])
    assert re.search(r"\d ± [\d.]+ µm \(k = 2\)", verdict_on(fine.to_html(tmp_path / "r.html")))


def test_names_of_errors_in_words() -> None:
    assert error_label("EA0B") == "tilt of the B axis about X"
    assert error_label("EC0C") == "zero position of the C axis"
    assert error_label("rb_arcsec") == "turn of the artefact about Y"
    assert error_label("ball_2.dy_um") == "place of ball 2 along Y"
    assert error_label("rate_um_h") == "rate_um_h"


def test_of_an_r_test_the_location_errors_come_first_and_names_of_programs_not(
    tmp_path: Path,
) -> None:
    folder = tn.sample_path("rotary")
    d = tn.diagnose(tn.read(folder / "rtest.csv"), tn.read_setup(folder / "setup.toml"))
    text = d.to_html(tmp_path / "r.html").read_text(encoding="utf-8")
    text = re.sub("</?span.*?>", "", text[text.index("<main>") : text.index("</main>")])
    said = verdict_on(tmp_path / "r.html")
    assert said.index("8 errors of the machine") < said.index("positioning of C")
    assert f"{d.gain.rms_before_um:.3g} µm rms" in said
    size = re.search(r"amplitude ([\d.]+ ± [\d.]+ arcsec)", said)
    assert size is not None
    assert text.count(size[1]) == 2  # in the sentence and in the table
    what = text[text.index("<h2>What these data do not identify") :].partition("</section>")[0]
    assert "offset of the A axis along Z (EZ0A) by +5 µm" in what
    assert not re.search(r"\b\w+_um\b", what)
    set_up = re.findall(r"<pre>(.*?)</pre>", text, re.S)[-1]
    assert "[rotary_test]" in set_up
    assert "[artefact]" not in set_up  # an R-test touches none


def test_the_record_has_files_with_checksums_and_the_command(tmp_path: Path) -> None:
    data, setup, page = tmp_path / "my touches.csv", tmp_path / "setup.toml", tmp_path / "r.html"
    cross()[0].to_csv(data)
    named = tn.ReportSetup(machine="Mill 7", serial="0815", operator="M. Muster", date="2026-11-22")
    known = tn.Setup(artefact=cross()[1].artefact, probe=cross()[1].probe, report=named)
    setup.write_text(known.to_toml(comments=True), encoding="utf-8")
    run = CliRunner().invoke(app, ["diagnose", str(data), str(setup), "--output", str(page)])
    assert run.exit_code == 0, run.output
    text = page.read_text(encoding="utf-8")
    for path in (data, setup):
        assert f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path}" in text
    for told in ("Mill 7", "no. 0815", "M. Muster", "2026-11-22", tn.__version__):
        assert told in text
    missing = "instrument, with number and last calibration"
    assert f"Not stated, in table [report] of the set-up: {missing}." in text
    assert f"diagnose &#x27;{data}&#x27; {setup} --output {page}" in text
    other = tn.identify(tn.read_touches(data), known)
    again = other.to_html(page, data=tn.read_touches(data), made_by="mine()").read_text("utf-8")
    assert "mine()" in again
    assert hashlib.sha256(data.read_bytes()).hexdigest() in again
    kept, read = tn.read_touches(data), hashlib.sha256(data.read_bytes()).hexdigest()
    data.unlink()
    assert read in tn.diagnose(kept, known).to_html(page).read_text("utf-8")


@pytest.mark.parametrize(
    "command",
    [
        ["positioning", "results", "positioning/axis.csv", "--tolerance", "A=20"],
        ["levels", "results", "levels/plate.csv"],
        ["estimate", "cross/touches.csv", "cross/setup.toml"],
        ["compare", "plate/first.csv", "plate/second.csv"],
    ],
)
def test_commands_write_reports(command: list[str], tmp_path: Path) -> None:
    full = [str(tn.sample_path(c)) if "/" in c else c for c in command]
    run = CliRunner().invoke(app, [*full, "--html", str(tmp_path / "r.html")])
    assert run.exit_code == 0, run.output
    pages = list(tmp_path.glob("*.html"))
    assert pages
    for page in pages:
        assert "trunnion" in page.read_text(encoding="utf-8")


RECORDED = (
    "estimate", "observe", "compare", "verify", "ballbar results", "ballbar identify",
    "ballbar plan", "positioning results", "positioning instruments", "levels results",
    "rotary-test identify",
)  # fmt: skip
"""Commands whose result holds neither its data nor its set-up."""


@pytest.mark.parametrize("command", RECORDED)
def test_every_report_has_the_files_that_its_command_was_given(
    command: str, tmp_path: Path
) -> None:
    """By --output and, where there is one, by --html: with their checksums, and the set-up."""
    has_html = "--html" in CliRunner().invoke(app, [*command.split(), "--help"]).output
    for count, line in enumerate(command_lines(tmp_path)[command]):
        given = [Path(word) for word in line if Path(word).is_file()]
        by_every_method = command == "compare" and len(given) == 2
        for option in ("output", "html") if has_html and not by_every_method else ("output",):
            page = tmp_path / f"{option}{count}.html"
            done = CliRunner().invoke(app, [*line, f"--{option}", str(page)])
            assert done.exit_code == 0, done.output
            written = [*tmp_path.glob(f"{page.stem}*.html")]  # one a result
            assert written
            for one in written:
                text = html.unescape(one.read_text(encoding="utf-8"))
                for path in given:
                    assert f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path}" in text, path
                stated = [path.read_text("utf-8") for path in given if path.suffix == ".toml"]
                assert all(text_of.strip() in text for text_of in stated)


def test_the_page_of_a_verification_says_whether_the_forecast_holds(tmp_path: Path) -> None:
    folder = tmp_path
    before, after, setup = command_lines(folder)["verify"][1][1:]
    page, estimate = folder / "page.html", folder / "estimate.json"
    for holds, errors in ((True, {}), (False, {"EX0C": 20.0})):
        known = tn.read_setup(setup)
        touches = tn.simulate(tn.plan(known), known, errors, noise_um=0.3, seed=5)
        found = tn.identify(tn.read_touches(before), known)
        estimate.write_text(json.dumps(found.to_dict()), encoding="utf-8")
        touches.to_csv(after)
        line = ["verify", before, after, setup, "--estimate", str(estimate), "--force"]
        done = CliRunner().invoke(app, [*line, "--html", str(page)])
        assert done.exit_code == 0, done.output
        text = page.read_text(encoding="utf-8")
        top = html.unescape(re.sub(r"<[^>]+>", "", text))
        assert ("as found" if holds else "which does not hold") in top
        assert hashlib.sha256(estimate.read_bytes()).hexdigest() in text
        assert f'class="verdict {"good" if holds else "bad"}' in text


def test_a_comparison_has_its_notes_and_doubts_where_it_is_read(tmp_path: Path) -> None:
    axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    twice = axis[np.tile(np.arange(len(axis)), 2)]
    worn = axis.with_columns(measured_mm=axis.measured + 2e-3 * axis.direction)
    page = tn.compare(twice, worn).to_html(tmp_path / "c.html").read_text("utf-8")
    assert page.index("rows repeat others") < page.index(">Pictures</h2>")
    same = tn.compare(axis, axis).to_html(tmp_path / "s.html").read_text("utf-8")
    top = verdict_on(tmp_path / "s.html")
    assert "has the same readings as before in every row" in top
    assert "Nothing changed" in top
    assert 'class="verdict bad' in same


def test_pictures_of_a_joint_diagnosis_say_of_which_measurement_they_are(tmp_path: Path) -> None:
    axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    other = axis.with_columns(measured_mm=axis.measured + 1e-4 * np.sin(np.arange(len(axis))))
    page = tn.diagnose([axis, other]).to_html(tmp_path / "j.html").read_text("utf-8")
    titles = re.findall(r"<figcaption[^>]*>(.*?)</figcaption>", page)
    assert len(titles) == len(set(titles))
    assert sum("(positioning 2)" in title for title in titles) > 1


# --- one size, one probability, one sense


def first_screen(d: Any, path: Path) -> tuple[str, dict[str, list[list[str]]]]:
    """Return the sentence at the top, and the tables before the first heading: rows by title."""
    text = d.to_html(path).read_text(encoding="utf-8").partition("<section>")[0]
    tables = {}
    for title, body in re.findall(r"<caption>(.*?)</caption>.*?<tbody>(.*?)</tbody>", text, re.S):
        rows = re.findall(r"<tr>(.*?)</tr>", body, re.S)
        cells = [re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row, re.S) for row in rows]
        plain = [[html.unescape(re.sub("<.*?>", "", c)) for c in row] for row in cells]
        tables[html.unescape(title)] = plain
    return verdict_on(path), tables


@pytest.mark.parametrize("name", ["positioning/axis.csv", "ballbar/circle.csv", "levels/bed.csv"])
def test_a_cause_has_one_size_and_one_probability_at_the_top(name: str, tmp_path: Path) -> None:
    d = tn.diagnose(tn.read(tn.sample_path(name)))
    said, tables = first_screen(d, tmp_path / "r.html")
    rows = [*tables["What was found"], *tables.get("Found beside it, not the machine's", [])]
    assert len(rows) == len(d.causes) > 1
    for label, size, meaning, chance in rows:
        name = label.removesuffix(" (in doubt)")
        assert f"{name[:1].lower()}{name[1:]}, {size} ({chance})" in said
        certain = said.partition("In doubt")[0]
        assert (name == label) == (name[1:] in certain)
        assert meaning


def test_the_zero_of_a_level_is_not_found_of_the_machine(tmp_path: Path) -> None:
    d = tn.diagnose(tn.read(tn.sample_path("levels/bed.csv")))
    _, tables = first_screen(d, tmp_path / "r.html")
    assert "Zero of the level" not in [row[0] for row in tables["What was found"]]
    assert [row[0] for row in tables["Found beside it, not the machine's"]] == ["Zero of the level"]


@pytest.mark.parametrize("name", ["positioning/axis.csv", "ballbar/circle.csv"])
def test_degrees_of_freedom_are_no_more_than_the_readings(name: str) -> None:
    d = tn.diagnose(tn.read(tn.sample_path(name)))
    freedom = [m.degrees_of_freedom for m in d.budget().measurands]
    assert len(freedom) > 1
    count = len(d.data) - len(d.model.names)
    assert freedom == pytest.approx([count] * len(freedom))


def test_both_senses_have_their_words_and_one_colour_in_every_picture() -> None:
    d = tn.diagnose(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))
    colours: dict[str, set[str]] = {}
    for picture in (cause_picture(d, "backlash_y"), *pictures(d.data)):
        for series in picture.series:
            if series.label in ("clockwise", "counter-clockwise"):
                colours.setdefault(series.label, set()).add(series.colour)
    assert {label: len(found) for label, found in colours.items()} == {
        "clockwise": 1,
        "counter-clockwise": 1,
    }
    assert colours["clockwise"] != colours["counter-clockwise"]


# --- each cause over its own coordinate


@pytest.mark.parametrize(
    ("effect", "values", "x", "unit"),
    [
        ("c_positioning_2", {"a2_arcsec": 2.0, "b2_arcsec": 6.0}, "C position", "arcsec"),
        ("drift_z", {"rate_um_h": 60.0}, "Time", "µm"),
        ("backlash_x", {"b_um": 5.0}, "Direction along X", "µm"),
        ("scale_x", {"ppm": 60.0}, "X place", "µm"),
    ],
)
def test_a_cause_is_drawn_over_what_it_depends_on(
    effect: str, values: dict[str, float], x: str, unit: str
) -> None:
    data = simulated({effect: values}, c_deg=tuple(range(0, 360, 30)))
    d = tn.diagnose(data, cross()[1])
    assert d.named == {effect}
    picture = cause_picture(d, effect)
    assert picture.x.label == x
    assert picture.y.unit == unit
    go.Figure(picture.to_plotly())
    readings = picture.series[0]
    fitted = next(s for s in picture.series if s.form is Form.LINE)
    assert readings.rows is not None
    if effect == "c_positioning_2":
        c = np.radians(fitted.x)
        truth = 2.0 * (np.cos(2 * c) - 1) + 6.0 * np.sin(2 * c)
        sign = np.sign(fitted.y @ truth)
        assert np.abs(sign * fitted.y - truth).max() < 1.0
        assert len(fitted.x) > 100  # a curve, not a line from reading to reading
    if effect == "drift_z":
        slope = np.polyfit(fitted.x, fitted.y, 1)[0] * 3600
        assert slope == pytest.approx(60.0, abs=5.0)  # a drift that is positive rises


def test_a_step_that_is_not_quite_one_of_the_quantity_is_drawn_as_a_step() -> None:
    rng = np.random.default_rng(5)
    speed = np.sort(rng.uniform(-10, 10, 200))
    change = np.where(speed < 0, 2.0, -2.0)
    just = np.flatnonzero(np.abs(speed) < 0.6)[::2]
    change[just] *= 0.5  # what follows a reversal still has the sign of before
    v = Covariate("speed", speed, "mm/s")
    made = Coordinate(v, Weight("reading", "µm", np.ones(200)), None, (), 1.0)
    ((_, x, y),) = made.curve(change[:, None], speed < 99)
    assert np.all(np.diff(x) > 0)
    assert np.all(np.diff(y[:, 0]) <= 0)
    np.testing.assert_allclose(y[np.abs(x) > 1, 0], -2 * np.sign(x[np.abs(x) > 1]))
    wave = np.cos(2 * np.pi * speed * 1.3)
    ((_, x, y),) = made.curve(wave[:, None], speed < 99)
    np.testing.assert_allclose(y[:, 0], np.cos(2 * np.pi * x * 1.3))  # no step: as it is


def test_a_curve_and_its_band_are_broken_where_nothing_was_read() -> None:
    time = np.concatenate([np.arange(40.0), 200.0 + np.arange(40.0)])
    wave = np.sin(time**2)  # no law that is known
    v = Covariate("time", time, "s")
    made = Coordinate(v, Weight("reading", "µm", np.ones(80)), None, (), 1.0)
    ((_, x, y),) = made.curve(wave[:, None], time >= 0)
    assert np.flatnonzero(np.isnan(y[:, 0])).tolist() == [40]
    np.testing.assert_allclose(y[~np.isnan(y[:, 0]), 0], wave)
    drawn = Picture("t", Axis("x"), Axis("y"), (band(x, y[:, 0] - 1, y[:, 0] + 1),)).to_plotly()
    assert drawn["data"][0]["x"].count(None) == 1
    first = drawn["data"][0]["x"][: drawn["data"][0]["x"].index(None)]
    np.testing.assert_allclose(first, [*np.arange(40.0), *np.arange(40.0)[::-1]])


def test_the_band_is_the_uncertainty_of_the_curve() -> None:
    d = tn.diagnose(simulated({"drift_z": {"rate_um_h": 60.0}}), cross()[1])
    band = next(s for s in cause_picture(d, "drift_z").series if s.form is Form.BAND)
    assert band.high is not None
    hours = (band.x[-1] - band.x[0]) / 3600
    half = (band.high[-1] - band.y[-1]) / 2
    assert half == pytest.approx(2 * d.causes[0].std_errors["rate_um_h"] * hours, rel=1e-6)


def test_a_coordinate_is_found_by_what_explains_a_change() -> None:
    rng = np.random.default_rng(4)
    angle, time = rng.uniform(0, 360, 300), np.sort(rng.uniform(0, 1, 300))
    lever = rng.uniform(-1, 1, 300)
    covariates = (
        Covariate("angle", angle, "deg", period=360.0),
        Covariate("time", time, "h", sequence=True),
        Covariate("side", rng.integers(0, 2, 300), classes=True),
    )
    weights = [Weight("reading", "µm", np.ones(300)), Weight("lever", "arcsec", lever)]
    every = np.ones(300, dtype=bool)

    def found(change: Any) -> tuple[str, str] | None:
        made = coordinate_of(change, covariates, weights, every)
        return (made.x.name, made.weight.name) if made else None

    assert found(np.sin(np.radians(angle))) == ("angle", "reading")
    assert found(lever * np.sin(np.radians(3 * angle))) == ("angle", "lever")
    assert found(5.0 * time) == ("time", "reading")
    assert found(rng.standard_normal(300)) is None
    assert found(np.zeros(300)) is None


def test_of_a_diagnosis_without_its_data_the_picture_is_drawn_all_the_same() -> None:
    d = diagnosis_of("points")
    bare = type(d)(**{**{f: getattr(d, f) for f in d.__dataclass_fields__}, "data": None})
    assert Explained.of(bare, d.causes[0].id).model is None
    go.Figure(cause_picture(bare, d.causes[0].id).to_plotly())


# --- size


def test_a_page_of_500_touches_is_small(tmp_path: Path) -> None:
    effects = {
        "drift_z": {"rate_um_h": 20.0},
        "c_positioning_2": {"a2_arcsec": 2.0, "b2_arcsec": 4.0},
    }
    data = simulated(effects, c_deg=tuple(range(0, 360, 10)), repeats=1)
    data = data[np.arange(len(data)) < 500] if len(data) > 500 else data
    d = tn.diagnose(data, cross()[1])
    assert len(d.causes) >= 2
    page = d.to_html(tmp_path / "r.html")
    assert page.stat().st_size - len(get_plotlyjs().encode()) < MAX_BYTES
    assert RESIDUALS in page.read_text(encoding="utf-8")  # with the view in space


def test_a_log_of_25000_rows_is_thinned_and_says_so() -> None:
    rng = np.random.default_rng(0)
    rows = np.arange(25_000)
    data = tn.AxisLog(time_s=rows * 1e-3, x_cmd_mm=rows * 1e-3, x_act_mm=rows * 1e-3)
    picture = hovered(order_picture(rng.standard_normal(25_000), "µm", rows=rows), (data,))
    series = picture.series[0]
    assert len(series.x) == len(series.hover) <= 1600
    assert "points the least and the largest" in picture.note
    assert series.rows is not None
    assert f"time {rows[series.rows[5]] * 1e-3:.7g} s" in series.hover[5]


def test_diagnostics_show_each_unit_by_itself() -> None:
    titles = [p.title for p in diagnostics(diagnosis_of("axislog"))]
    assert any("µm" in title for title in titles)
    assert any("arcsec" in title for title in titles)


def test_a_set_up_without_a_machine_adds_none_to_a_record_of_an_axis(tmp_path: Path) -> None:
    setup, page = tmp_path / "machine.toml", tmp_path / "r.html"
    stops = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    for text, shown in (("", False), ('[machine]\npreset = "trt-ca"\n', True)):
        setup.write_text(
            f'[report]\nserial = "4711"\n[artefact]\nkind = "none"\n{text}', encoding="utf-8"
        )
        tn.diagnose(stops).to_html(page, setup=tn.read_setup(setup))
        said = page.read_text(encoding="utf-8")
        assert "4711" in said
        assert ("Chain of axes" in said) is shown
        page.unlink()
