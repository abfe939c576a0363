"""What a sheet from Excel or a terminal gets wrong at first, and what is said of it."""

import re
import warnings
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app

SAMPLE = tn.sample_path("positioning/axis.csv").read_text(encoding="utf-8")
HEADER, ROWS = SAMPLE.split("\n", 1)


def refusal(tmp_path: Path, text: str, columns: dict[str, str] | None = None) -> str:
    """Return what is said of a file, without its folder."""
    path = tmp_path / "sheet.csv"
    path.write_text(text)
    with pytest.raises(tn.TrunnionError) as caught:
        tn.read(path, columns=columns)
    return str(caught.value).replace(str(path), path.name)


def renamed(**names: str) -> str:
    """Return the sample with other names of columns."""
    header = ",".join(names.get(name, name) for name in HEADER.split(","))
    return f"{header}\n{ROWS}"


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({"measured_mm": "mesured_mm"}, "no measured_mm, but mesured_mm"),
        ({"measured_mm": "deviation_um"}, "measured_mm: the target plus the deviation"),
        ({"measured_mm": "laser_mm"}, "(trunnion read --column measured_mm=laser_mm: further"),
        ({"direction": "directon"}, "without direction (is it directon?)"),
        ({"cycle": "Zyklus"}, "time_s without cycle, expected those of positioning (direction,"),
        ({"cycle": "n", "direction": "d"}, "without direction and cycle, expected those of pos"),
        (dict.fromkeys(HEADER.split(","), "x") | {"cycle": "y"}, "expected those of a kind of"),
    ],
)
def test_a_wrong_name_of_a_column(tmp_path: Path, names: dict[str, str], said: str) -> None:
    """The message names the kind that is nearest, what it lacks, and the name that is near."""
    assert said in refusal(tmp_path, renamed(**names))


def test_a_mapping_that_is_not_finished_or_the_wrong_way_round(tmp_path: Path) -> None:
    """Channels are looked for first; what is missing of the kind is named."""
    text = renamed(target_mm="Soll [mm]", measured_mm="Ist [mm]", direction="Richtung")
    said = refusal(tmp_path, text, columns={"target_mm": "Sol [mm]"})
    assert said.endswith("did you mean Soll [mm]?")
    said = refusal(tmp_path, text, columns={"Soll [mm]": "target_mm"})
    assert said.endswith(
        "expected the column's name first, then the channel's: target_mm=Soll [mm]"
    )
    said = refusal(tmp_path, text, columns={"target_mm": "Soll [mm]"})
    assert "without direction, expected those of positioning" in said
    assert "period_s" not in said
    columns = {"target_mm": "Soll [mm]", "measured_mm": "Ist [mm]", "direction": "Richtung"}
    assert tn.read(tmp_path / "sheet.csv", columns=columns).iso230_2().accuracy_um > 0


def test_title_lines_above_the_header(tmp_path: Path) -> None:
    """The line in which the names stand is named, whatever separates them."""
    for text in (SAMPLE, SAMPLE.replace(",", ";")):
        said = refusal(tmp_path, f"Machine 7\nX axis\n\n{text}")
        assert said.startswith("sheet.csv:1:1: got 'Machine 7', expected names of columns; line 4 ")
    (tmp_path / "sheet.csv").write_text(f"# Machine 7\n# X axis\n\n{SAMPLE}")
    assert len(tn.read(tmp_path / "sheet.csv")) == len(ROWS.splitlines())


def test_an_empty_row_between_others(tmp_path: Path) -> None:
    """It is refused, as a row may be missing, and named as what it is."""
    lines = SAMPLE.splitlines()
    said = refusal(tmp_path, "\n".join([*lines[:5], ",,,,", *lines[5:]]))
    assert said.endswith("got an empty field, expected a finite number (the whole row is empty)")
    said = refusal(tmp_path, "\n".join([*lines[:5], ",1,1,1,", *lines[5:]]))
    assert said.endswith(":6:1: target_mm: got an empty field, expected a finite number")


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_a_separator_at_the_end_of_every_line(tmp_path: Path, mark: str) -> None:
    """It is left out and said; where one line lacks it, a field may be missing: refused."""
    lines = [line.replace(",", mark) + mark for line in SAMPLE.splitlines()]
    path = tmp_path / "ends.csv"
    path.write_text("\n".join(lines))
    data = tn.read(path)
    assert data == tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    assert "Every line ends with a separator, which was left out." in data.recognised.notes
    path.write_text("\n".join([*lines[:4], lines[4].rstrip(mark), *lines[5:]]))
    with pytest.raises(tn.FileFormatError, match=r"got an empty field, expected the name"):
        tn.read(path)


def test_the_log_of_a_probing_program_is_no_data_yet(tmp_path: Path) -> None:
    """What makes data of it is named."""
    said = refusal(tmp_path, "trunnion-touches 1 plan=p hash=0123456789ab touches=2 from=1\n")
    assert "trunnion touches PLAN" in said


def test_numbers_as_text(tmp_path: Path) -> None:
    """Decimal commas in cells and in quotes are read; what may be a thousand is refused."""
    workbook = pytest.importorskip("openpyxl").Workbook()
    sheet = workbook.active
    rows = [line.split(",") for line in SAMPLE.splitlines()]
    for row in rows:
        sheet.append([field.replace(".", ",") for field in row])
    workbook.save(tmp_path / "text.xlsx")
    data = tn.read(tmp_path / "text.xlsx")
    assert data == tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    assert data.recognised.sentences()[0] == (
        "Read as Positioning from xlsx, sheet 'Sheet', with the names of its kind and decimal "
        "commas."
    )
    quoted = "\n".join(",".join(f'"{f.replace(".", ",")}"' for f in row) for row in rows)
    (tmp_path / "quoted.csv").write_text(quoted)
    assert tn.read(tmp_path / "quoted.csv") == data
    said = refusal(tmp_path, SAMPLE.replace("8.20195", '"8,20195"', 1))
    assert "'8,20195', but '8.2' in column target_mm, line 2, expected one decimal mark" in said
    said = refusal(tmp_path, SAMPLE.replace("8.20195", '"8,20195 mm"', 1).replace("55.5039", "x"))
    assert said.endswith("got '8,20195 mm', expected a finite number")


DECIMAL = "(decimal commas? then separate the columns by semicolons or tabs)"
THOUSANDS = "(a comma between thousands? then write the numbers without it)"


@pytest.mark.parametrize(
    ("row", "why"),
    [
        ("0,1,1,0,100,5,2,25", DECIMAL),
        ("0,1,1,0,100,2,25", DECIMAL),
        ("0.0,1,1.0,1,234.5,2.0", THOUSANDS),
        ("0.0,1,1.0,100.5,2.0,3.0", ""),
    ],
)
def test_commas_in_numbers_between_commas(tmp_path: Path, row: str, why: str) -> None:
    """Fields that a comma made two are named; whole numbers beside each other are not."""
    path = tmp_path / "points.csv"
    path.write_text(f"cycle,nominal_x_mm,nominal_y_mm,x_mm,y_mm\n{row}\n")
    with pytest.raises(tn.TrunnionError, match=r"after the last column: got \d fields") as caught:
        tn.read_points(path)
    said = str(caught.value)
    assert said.endswith(f"y_mm {why}" if why else "y_mm")


def test_a_name_that_stands_twice_in_place_of_another(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("nominal_x_mm,nominal_y_mm,x_mm,x_mm\n1.0,2.0,1.1,2.1\n")
    with pytest.raises(tn.TrunnionError, match="x_mm: got the column twice, expected it once"):
        tn.read_points(path)


def test_a_number_that_became_a_date(tmp_path: Path) -> None:
    """What Excel does with 15.3 is named."""
    for text in ("15.Mrz", "15-Mar", "Mrz 15", "Mar-15"):
        said = refusal(tmp_path, SAMPLE.replace("55.5039", text, 1))
        assert said.startswith(
            f"sheet.csv:3:6: measured_mm: got '{text}', expected a finite number"
        )
        assert said.endswith("(a number that a spreadsheet took for a date?)") == (" " not in text)
    workbook = pytest.importorskip("openpyxl").Workbook()
    workbook.active.append(["target_mm", "measured_mm", "direction", "cycle"])
    workbook.active.append([15.3, date(2026, 3, 15), 1, 1])
    workbook.save(tmp_path / "date.xlsx")
    with pytest.raises(tn.FileFormatError, match="took for a date"):
        tn.read(tmp_path / "date.xlsx")


def said_by(*words: str | Path, code: int = 2) -> str:
    """Return what a command says, on one line."""
    ran = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "400"})
    assert ran.exit_code == code, ran.output
    return " ".join(ran.output.replace("│", " ").split())


def test_a_file_where_a_command_belongs(tmp_path: Path) -> None:
    """The commands of the group are listed."""
    path = tmp_path / "x.csv"
    path.write_text(SAMPLE)
    assert "expected a command before it: results, ins" in said_by("positioning", path)
    assert "expected a command before it: init, " in said_by(path)
    assert "No such command 'nothing.csv'" in said_by("positioning", "nothing.csv")


def test_a_name_of_a_file_that_is_nearly_right(tmp_path: Path) -> None:
    """Where an instrument's file or a set-up is missing, the one that is there is named."""
    (tmp_path / "x-axis.csv").write_text(SAMPLE)
    for words in (("positioning", "results"), ("diagnose",), ("view",)):
        said = said_by(*words, tmp_path / "xaxis.csv")
        assert said.endswith(f"no such file or directory; did you mean {tmp_path / 'x-axis.csv'}?")
    assert said_by("diagnose", tmp_path / "other" / "b.csv").endswith("no such file or directory")


def test_a_decimal_comma_in_an_option(tmp_path: Path) -> None:
    """A point is asked for; a limit without its unit is named in full."""
    path = tmp_path / "x.csv"
    path.write_text(SAMPLE)
    results = ("positioning", "results", path, "--tolerance")
    assert said_by(*results, "accuracy_um=30,5").endswith("name=number with a decimal point")
    assert said_by(*results, "accuracy=30").endswith("did you mean accuracy_um?")


def test_touches_in_place_of_their_estimate() -> None:
    """What makes an estimate of them is named."""
    touches, setup = (tn.sample_path(f"cross/{name}") for name in ("touches.csv", "setup.toml"))
    for command in ("compensate", "correct"):
        more = (tn.sample_path("turning/part.ngc"),) if command == "correct" else ()
        said = said_by(command, *more, touches, setup, "-o", "out")
        assert said.endswith("as trunnion estimate TOUCHES SETUP -o estimate.json writes it")


def test_the_example_of_a_chain_is_in_the_help() -> None:
    """Brackets are not taken for markup."""
    assert "[w C' A' b X Y Z (C) t]" in said_by("init", "--help", code=0)


@pytest.mark.parametrize(
    ("left_out", "said"),
    [
        ((), "4 of 4 planned touches wrote"),
        ((4,), "3 of 4 planned touches; not among them: 4; the program goes on with #<_from> = 4"),
        ((2, 3), "2 of 4 planned touches; not among them: 2 to 3 wrote"),
        ((1, 3), "2 of 4 planned touches; not among them: 1, 3 wrote"),
    ],
)
def test_which_touches_are_not_in_a_log(tmp_path: Path, left_out: Sequence[int], said: str) -> None:
    """They are named; plan and log are taken in either order."""
    from trunnion.data.linuxcnc_log import probe_log_of

    tn.plan(tn.Setup(tn.Artefact("cross")))[:4].to_csv(tmp_path / "plan.csv")
    plan = tn.read_touches(tmp_path / "plan.csv")
    lines = probe_log_of(plan, plan, "plan").splitlines()
    kept = [line for number, line in enumerate(lines) if number not in left_out]
    (tmp_path / "run.log").write_text("\n".join(kept))
    for files in (("plan.csv", "run.log"), ("run.log", "plan.csv")):
        paths = [tmp_path / file for file in files]
        assert said in said_by("touches", *paths, "-o", tmp_path / "m.csv", "--force", code=0)


def logged(tmp_path: Path, off_um: float = 0.0, touch: int = 1) -> tuple[tn.Touches, list[str]]:
    """A plan of a cross in plan.csv, its set-up, and the log of its program; one touch is off."""
    from trunnion.data.linuxcnc_log import probe_log_of

    setup = tn.Setup(tn.Artefact("cross"))
    tn.plan(setup).to_csv(tmp_path / "plan.csv")
    (tmp_path / "setup.toml").write_text(setup.to_toml())
    plan = tn.read_touches(tmp_path / "plan.csv")
    made = tn.simulate(plan, setup, {"EX0C": 15.0}, {"dx_um": 40.0}, noise_um=0.3, seed=1)
    along = np.zeros(len(made))
    along[touch - 1] = 1e-3 * off_um
    x, y, z = (made.position_mm + along[:, None] * made.direction).T
    made = made.with_columns(x_mm=x, y_mm=y, z_mm=z)
    return plan, probe_log_of(plan, made, "plan").splitlines()


def test_a_last_line_that_was_cut_is_said(tmp_path: Path) -> None:
    """What is left out of a log, and where: on the screen, in the CSV and in JSON."""
    _, lines = logged(tmp_path)
    log = tmp_path / "run.log"
    log.write_text("\n".join([*lines[:6], lines[6][:20]]))
    cut = "Line 7 of run.log is cut off (3 of 8 fields, no end of line): its touch is left out."
    plan, setup = tmp_path / "plan.csv", tmp_path / "setup.toml"
    measured = tmp_path / "m.csv"
    said = said_by("touches", plan, log, "-o", measured, code=0)
    assert said.startswith(f"{cut} 5 of 72 planned touches; not among them: 6 to 72; ")
    printed = CliRunner().invoke(app, ["touches", str(plan), str(log)]).output
    assert printed.splitlines()[0] == f"# {cut}"
    (tmp_path / "printed.csv").write_text(printed)
    assert tn.read(tmp_path / "printed.csv") == tn.read(measured)
    assert cut in said_by("touches", plan, log, "--json", code=0)
    log.write_text("\n".join([*lines[:-1], lines[-1][:20]]))
    cut = cut.replace("Line 7", "Line 73")
    assert cut in said_by("diagnose", plan, setup, "--probe-log", log, code=0)
    log.write_text("\n".join(lines))
    whole = said_by("touches", plan, log, "-o", measured, "--force", code=0)
    assert whole.startswith("72 of 72 planned touches wrote")
    assert "cut off" not in said_by("diagnose", plan, setup, "--probe-log", log, code=0)


def test_a_whole_run_before_one_that_was_stopped_is_said(tmp_path: Path) -> None:
    """Its touches are in the log: they are not used, and the command says how they can be."""
    _, lines = logged(tmp_path)
    log = tmp_path / "run.log"
    log.write_text("\n".join([*lines, *lines[:31]]) + "\n")
    plan, setup = tmp_path / "plan.csv", tmp_path / "setup.toml"
    said = said_by("touches", plan, log, "-o", tmp_path / "m.csv", code=0)
    note, _, rest = said.partition(" that ends with it. ")
    assert note.endswith(
        "the last is used, 30 touches from line 74 on; not used: 72 touches from line 1 on. To use "
        "one of those, read a copy of the log"
    )
    assert rest.startswith("30 of 72 planned touches; not among them: 31 to 72; the program goes")
    for command in ("estimate", "diagnose"):
        assert note in said_by(command, plan, setup, "--probe-log", log, code=0)


def test_outliers_of_a_log_are_named_by_its_lines_and_touches(tmp_path: Path) -> None:
    """The line of the plan is another one: its header has one line, the log's has two here."""
    _, lines = logged(tmp_path, off_um=30.0, touch=12)
    log = tmp_path / "run.log"
    log.write_text("\n".join([lines[0], "; clamped at 40 bar", *lines[1:]]) + "\n")
    plan, setup = tmp_path / "plan.csv", tmp_path / "setup.toml"
    said = said_by("diagnose", plan, setup, "--probe-log", log, code=0)
    assert "Outlier, left out: line 14 of run.log (touch 12)." in said
    assert log.read_text().splitlines()[13].startswith("12 ")
    read = tn.read_probe_log(log, tn.read_touches(plan))
    d = tn.diagnose(read, tn.read_setup(setup))
    assert tn.Diagnosis.from_json(d.to_json()).sentences() == d.sentences()
    both = tn.Touches.concatenate([tn.read_touches(plan), read])
    assert both.place(72 + 11) == "line 14 of run.log (touch 12)"
    assert both.place(11) == "line 13 of plan.csv"
    rows = [line.split() for line in lines]
    rows[12][2] = "9999.0"  # off the surface
    log.write_text("\n".join(" ".join(row) for row in rows) + "\n")
    assert "run.log:13:15: X (touch 12): got a touch" in said_by(
        "diagnose", plan, setup, "--probe-log", log
    )


def test_another_sweep_in_the_file(tmp_path: Path) -> None:
    """A finished sweep says so; another one is refused, and takes its place with --force."""
    pytest.importorskip("xarray")
    study = tmp_path / "study.toml"
    for samples, force, code, said in (
        (2, (), 0, "sample 2, "),
        (2, (), 0, "It was complete: nothing was computed."),
        (3, (), 2, "samples is 2 there, 3 here; expected the same sweep to go on with, or another"),
        (3, (), 2, "(--force starts again)"),
        (3, ("--force",), 0, "sample 3, "),
        (3, ("--force",), 0, "It was complete: nothing was computed."),
    ):
        study.write_text(f'study = "calibration"\nsamples = {samples}\n')
        assert said in said_by("sweep", study, *force, code=code)


def test_every_axis_can_be_filled_in_in_a_new_set_up(tmp_path: Path) -> None:
    """The tables of rotary axes are comments; without the # they are read."""
    said_by("init", tmp_path, code=0)
    text = (tmp_path / "setup.toml").read_text()
    plain = tn.read_setup(tmp_path / "setup.toml")
    filled = text.replace("# [axes.A]", "[axes.A]").replace(
        "# point_mm = ", "point_mm = [0.0, 5.0, -30.0] ", 1
    )
    (tmp_path / "setup.toml").write_text(filled)
    assert tn.read_setup(tmp_path / "setup.toml").axis_points()["A"] == (0.0, 5.0, -30.0)
    assert not plain.axes
    assert "# [axes.C]" in text


def test_a_call_without_its_arguments_names_the_function() -> None:
    """Python's words alone do not say what was called."""
    with pytest.raises(TypeError, match=r"^catalogue\(\) missing a required argument: 'of'$"):
        tn.catalogue()  # type: ignore[call-arg]
    touches = tn.read(tn.sample_path("cross/touches.csv"))
    fit = tn.identify(touches, tn.read_setup(tn.sample_path("cross/setup.toml")))
    with pytest.raises(tn.InputError, match=r"as an argument: scene\(touches\)$"):
        fit.scene()
    with pytest.raises(tn.InputError, match=r"got 1000\.0, expected a whole number$"):
        tn.sweep("calibration", samples=1e3)  # type: ignore[arg-type]


def test_a_plan_is_not_a_measurement() -> None:
    """Said of touches that lie where the set-up expects them; nothing else is said by numpy."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    plan = tn.plan(setup)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page = tn.diagnose(plan, setup)
        assert page._repr_html_()
    assert "is this the plan, not what was measured?" in page.summary()
    assert "0 (ball" not in page.summary()
    assert not re.search(r"\de-\d", " ".join(page.sentences()))
    ticks = replace(setup, probe=replace(setup.probe, tick_um=0.0, servo_period_ms=1.0))
    notes = " ".join(tn.identify(plan, ticks).notes)  # half a tick is taken off each of them
    assert "is this the plan, not what was measured?" in notes
    for errors, placement, said in (
        ({}, {}, True),
        ({"EX0C": 0.5}, {}, False),
        ({}, {"dx_um": 20.0}, False),
    ):
        made = tn.simulate(plan, setup, errors, placement=placement)
        notes = " ".join(tn.identify(made, setup).notes)
        assert ("is this the plan" in notes) == said


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("length_mm = 80,0", " (a decimal comma? TOML has points)"),
        ("length_mm = 80,0 # mm", " (a decimal comma? TOML has points)"),
        ("kind = cuboid", ' (text stands in quotes: "...")'),
        ('kind = "cuboid', ""),
        ("place_mm = [0, 0, 0", ""),
    ],
)
def test_what_is_likely_wrong_in_a_set_up(tmp_path: Path, line: str, why: str) -> None:
    """The two slips of who writes TOML for the first time are named, others not."""
    (tmp_path / "setup.toml").write_text(f"[artefact]\n{line}\n")
    with pytest.raises(tn.FileFormatError) as caught:
        tn.read_setup(tmp_path / "setup.toml")
    assert "expected TOML: " in str(caught.value)
    assert str(caught.value).endswith(why or str(caught.value)[-1])
    assert why or "(" not in str(caught.value)


def test_a_folder_in_place_of_a_file(tmp_path: Path) -> None:
    for read in (tn.read, tn.read_touches, tn.read_setup):
        with pytest.raises(tn.InputError, match="got a folder, expected a file"):
            read(tmp_path)


def test_a_command_does_not_write_over_what_it_reads(tmp_path: Path) -> None:
    """Not even with --force: the measurement would be lost."""
    data, setup = tmp_path / "touches.csv", tmp_path / "setup.toml"
    data.write_bytes(tn.sample_path("cross/touches.csv").read_bytes())
    setup.write_bytes(tn.sample_path("cross/setup.toml").read_bytes())
    before = data.read_bytes()
    for words in (["estimate"], ["diagnose"], ["simulate"], ["program"]):
        files = [*words, str(data), str(setup), "--output", str(data), "--force"]
        done = CliRunner().invoke(app, files)
        assert done.exit_code == 2
        assert "got a file that this command reads" in done.stderr
        assert data.read_bytes() == before


@pytest.mark.parametrize(("first", "said"), [("0", "--from"), ("73", "--from: got 73")])
def test_a_run_goes_on_from_a_touch_of_the_plan(tmp_path: Path, first: str, said: str) -> None:
    plan = tmp_path / "plan.csv"
    setup = tn.sample_path("cross/setup.toml")
    tn.plan(tn.read_setup(setup)).to_csv(plan)
    done = CliRunner().invoke(app, ["program", str(plan), str(setup), "--from", first])
    assert done.exit_code != 0
    assert said in done.stderr


@pytest.mark.parametrize("tick_um", [0.0, 10.0])
@pytest.mark.parametrize("step_um", [0.0, 0.1, 20.0])
def test_coarse_commands_make_no_plan_of_a_measurement(step_um: float, tick_um: float) -> None:
    """Errors of a good machine are smaller than a coarse step of commands; a plan has none."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    setup = replace(
        setup,
        probe=replace(setup.probe, tick_um=tick_um, servo_period_ms=0.0),
        resolution=replace(setup.resolution, linear_um=step_um),
    )
    plan = tn.plan(setup)
    assert "is this the plan" in " ".join(tn.identify(plan, setup).notes)
    for seed in range(1, 6):
        made = tn.simulate(plan, setup, {"EX0C": 2.0, "EB0A": 3.0}, noise_um=0.4, seed=seed)
        assert "is this the plan" not in " ".join(tn.identify(made, setup).notes)


def test_a_plan_of_a_set_up_that_states_errors_is_recognised() -> None:
    """They are in the plan, too."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    setup = replace(setup, machine=replace(setup.machine, errors={"EX0C": 150.0, "EB0A": 40.0}))
    plan = tn.plan(setup)
    assert "is this the plan" in " ".join(tn.identify(plan, setup).notes)
    made = tn.simulate(plan, setup, {"EX0C": 151.0, "EB0A": 40.0}, noise_um=0.4, seed=1)
    assert "is this the plan" not in " ".join(tn.identify(made, setup).notes)
