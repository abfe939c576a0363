"""``trunnion diagnose``: whether a measurement fits its model, and if not, why."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.base.output import check_folder
from trunnion.base.progress import tracked
from trunnion.base.read_files import as_read
from trunnion.base.record import Record, hold_record
from trunnion.cli.command import Answer, Html, Output, check_outputs, command, save, save_result
from trunnion.cli.given import sort_files
from trunnion.cli.program import ProbeLog, read_log
from trunnion.cli.read import said_of
from trunnion.cli.schema import Of, Printed

if TYPE_CHECKING:
    from trunnion.diagnosis.result import Diagnosis
    from trunnion.models.many import DiagnosisBatch

DataAndSetup = Annotated[
    list[Path],
    typer.Argument(
        metavar="DATA... [SETUP]",
        help="measured data (CSV), and the set-up (TOML) where the kind of data needs one",
    ),
]
MAX_FILES, MAX_BATCH = 50, 100_000  # of a joint diagnosis; each by itself
MAX_NEXT = 1000  # as next_touches takes, known without importing it


class Further(TypedDict, total=False):
    """What `diagnose` prints as JSON beside the diagnosis."""

    recognised: Annotated[Any, Of(("trunnion.files.recognised:Recognised",))]
    next_measurements: list[
        Annotated[Any, Of(("trunnion.models.next_measurement:NextMeasurement",))]
    ]
    next_passes: list[Annotated[Any, Of(("trunnion.models.next_passes:NextPass",))]]


NOT_PRINTED = ("residuals", "data")
"""Not on the screen: readings and data are in files already. A file of --output has them, too."""
_ONE = ("trunnion.diagnosis.result:Diagnosis", "trunnion.models.many:FailedDiagnosis")


Effects = Annotated[
    list[str] | None,
    typer.Option(
        help="further candidates: a file of effects (TOML), or the name of a catalogue that an "
        "installed package brings"
    ),
]


class Batch(TypedDict):
    """What `diagnose` prints as JSON of several files; `reports`: the page of each."""

    names: list[str]
    results: list[Annotated[Any, Of(_ONE, NOT_PRINTED)]]
    reports: dict[str, str]


DIAGNOSED = (
    Printed("trunnion.diagnosis.result:Diagnosis", Further, NOT_PRINTED),
    Printed(keys=Batch),
)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app, values=DIAGNOSED, reads=True)(diagnose)


def diagnose(
    files: DataAndSetup,
    kind: Annotated[
        str, typer.Option(help="kind of data; by default detected from the columns")
    ] = "",
    html: Html = None,
    probe_log: ProbeLog = None,
    next_: Annotated[
        int,
        typer.Option(
            "--next",
            min=0,
            max=MAX_NEXT,
            help="plan this many touches that discriminate the alternatives (with --joint always "
            "eight); rank further tests",
        ),
    ] = 0,
    joint: Annotated[
        bool,
        typer.Option(
            "--joint", help="several measurements of one machine, in the order of time, together"
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="folder for a page with pictures of each file, and a table")
    ] = None,
    effects: Effects = None,
    output: Output = None,
) -> Answer:
    """Say whether the model explains a measurement, and if not, what is wrong, by name.

    Several files are diagnosed each by itself on all cores, with a table over all; what cannot be
    read is named there and the exit code is 2. --next ranks further tests by how probably they
    settle what is in doubt; of touches, --output is then where the plan of further ones goes
    (next.csv if absent). Where the first test is one of touches beside other measurements, its plan
    is in next.csv; with --joint touches that are chosen for it are always eight, whatever the
    number of --next. --html, or --output with a name that ends in .html, writes the report: one
    page with the evidence.
    """
    several = sum(file.suffix.lower() != ".toml" for file in files) > 1
    if (several or out is not None) and not joint:
        if html is not None or probe_log is not None or next_ or effects:
            raise tn.InputError(
                "files: got several, or --out, and an option for one file (--html, --probe-log, "
                "--next, --effects); expected one file, or --out with a folder for the pages"
            )
        return _batch(files, kind, out, output)
    if joint:
        _refuse_beside_joint(probe_log, out)
        d = _together(files, kind, effects or [])
        shown: list[Any] = [*(text for one in d.data for text in said_of(one)), d]
    else:
        d = _diagnosis(files, kind, probe_log, effects or [])
        shown = [*said_of(d.data), d]
    values = d.to_dict()
    kept = {name: values.pop(name) for name in NOT_PRINTED}
    if said := said_of(d.data):
        values["recognised"] = said[0].to_dict()
    if html is not None:
        shown.append(save(html, d.to_html))
    further, said_next = _next(d, next_, output)
    answer = Answer({**values, **further}, (*shown, *said_next), kept=kept, record_of=d)
    if output is None or (next_ and isinstance(d.data, tn.Touches)):
        return answer
    return replace(answer, shown=(*answer.shown, answer.save(output)))


def _next(d: tn.Diagnosis, n: int, output: Path | None) -> tuple[dict[str, Any], list[Any]]:
    """Say which further test settles what is in doubt: values by name, and what is shown."""
    if isinstance(d.data, tn.Diameters):
        passes = tn.next_passes(d)
        said = [f"To discriminate between them: {one}" for one in passes[:1] if one.distinguished]
        none = ["To discriminate between them: none of the passes that were tried would do."]
        return {"next_passes": [one.to_dict() for one in passes]}, said or none * bool(passes)
    if not n:
        return {}, []
    tests = tn.next_measurement(d)
    helping = [one for one in tests if one.helps]
    shown: list[Any] = [
        one.summary() if i else f"Next: {one.summary()}" for i, one in enumerate(helping)
    ]
    if idle := "; ".join(one.label for one in tests if not one.helps):
        shown.append(f"{'None' if helping else 'Next: none'} of these settles the doubt: {idle}.")
    if isinstance(d.data, tn.Touches):
        found = tn.expected_discrimination(d, n)
        shown += [found, save_result(output or Path("next.csv"), found.plan)]
    elif helping and isinstance(helping[0].plan, tn.Touches):
        shown.append(save_result(Path("next.csv"), helping[0].plan))
    return {"next_measurements": [one.to_dict() for one in tests]}, shown


def _batch(files: list[Path], kind: str, out: Path | None, output: Path | None) -> Answer:
    """Diagnose files each by itself; a page each, and a table over all."""
    if out is not None:
        check_folder(out)
    data, set_ups = sort_files(files, (1, MAX_BATCH), (0, 1), exist=False)
    found = tn.diagnose_many(data, set_ups[0] if set_ups else None, kind=kind or None)
    values = found.to_dict()
    kept = {"results": [dict(one) for one in values["results"]]}
    for one in values["results"]:
        for name in NOT_PRINTED:
            one.pop(name, None)
    reports = {} if out is None else _reports(out, found)
    answer = Answer(
        {**values, "reports": reports},
        (found,),
        failed=tuple(found.failed.values()),
        kept=kept,
        record_of=found,
    )
    said = []
    if out is not None:
        pages = f"{len(reports) or 'no'} page{'' if len(reports) == 1 else 's'}"
        said = [save_result(out / "diagnoses.csv", found), f"wrote {pages} to {out}"]
    if output is not None:
        said.append(answer.save(output))
    return replace(answer, shown=(found, *said))


def _reports(folder: Path, found: DiagnosisBatch) -> dict[str, str]:
    """Write a page of each diagnosis; return file → page."""
    stems = ["-".join(Path(name).with_suffix("").parts) for name in found.short_names()]
    if len({stem.lower() for stem in stems}) < len(stems):  # a.csv and a.xlsx
        stems = [f"{stem}-{place}" for place, stem in enumerate(stems, start=1)]
    pages = {
        name: folder / f"{stem}.html"
        for name, stem, one in zip(found.names, stems, found, strict=True)
        if isinstance(one, tn.Diagnosis)
    }
    folder.mkdir(exist_ok=True)
    check_outputs(*pages.values(), folder / "diagnoses.csv")
    for name, one in tracked(zip(found.names, found, strict=True), "pages", len(found)):
        if isinstance(one, tn.Diagnosis):
            save(pages[name], one.to_html)
    return {name: str(page) for name, page in pages.items()}


def diagnose_as(kind: str) -> Any:
    """Return a command that diagnoses data of one kind."""

    def run(files: DataAndSetup, html: Html = None, output: Output = None) -> Answer:
        return diagnose(files, kind=kind, html=html, output=output)

    run.__doc__ = f"Diagnose data of the kind {kind}: the same as `trunnion diagnose`."
    return run


def _diagnosed(data: Any, setup: tn.Setup | None, effects: list[str]) -> Diagnosis:
    """Diagnose with further candidates from files and installed packages; note which have none."""
    found: list[Any] = []
    idle: list[str] = []
    for one in effects:
        from_file = Path(one).suffix == ".toml" or Path(one).exists()
        effects_of: Any = tn.read_effects if from_file else tn.installed_effects
        mine = effects_of(one, data)
        found += mine
        if not mine:
            several = data if isinstance(data, list) else [data]
            kinds = " or ".join(dict.fromkeys(type(each).__name__ for each in several))
            others = ", ".join(f"{e.id} is for {getattr(e, 'data', '')}" for e in effects_of(one))
            why = others or "it has none at all"
            idle.append(f"{one} has no effect on {kinds} ({why}): none of it was looked for.")
    d = tn.diagnose(data, setup, effects=found)
    d = replace(d, notes=(*idle, *d.notes))
    if files := [one for one in effects if Path(one).exists()]:
        read = [as_read(one, "effects") or one for one in files]
        hold_record(d, Record.of(d, inputs=read))
    return d


def _refuse_beside_joint(probe_log: Path | None, out: Path | None) -> None:
    """Refuse options that a joint diagnosis has no use for, before anything is read."""
    if probe_log is not None:  # of several files it is not said which is its plan
        raise tn.InputError(
            "--probe-log: got it with --joint, expected measured touches among the files: write "
            f"them with `trunnion touches plan.csv {probe_log} setup.toml -o touches.csv`, "
            "then diagnose touches.csv with the others"
        )
    if out is not None:
        raise tn.InputError(
            "--out: got it with --joint, expected --html for the report or --output for the "
            "result: measurements that are diagnosed together have one page"
        )


def _together(files: list[Path], kind: str, effects: list[str]) -> Diagnosis:
    """Diagnose several measurements of one machine together."""
    data, set_ups = sort_files(files, (2, MAX_FILES), (0, 1))
    read = [tn.read(path, kind=kind or None) for path in data]
    setup = tn.read_setup(set_ups[0]) if set_ups else None
    return _diagnosed(read, setup, effects)


def _diagnosis(
    files: list[Path], kind: str, probe_log: Path | None, effects: list[str]
) -> Diagnosis:
    data, set_ups = sort_files(files, (1, 1), (0, 1))
    read = tn.read(data[0], kind=kind or None)
    setup = tn.read_setup(set_ups[0]) if set_ups else None
    if probe_log is not None:
        if not isinstance(read, tn.Touches):
            raise tn.InputError(
                f"{data[0]}: got data that are no touches, expected the plan of --probe-log"
            )
        read = read_log(probe_log, read, setup)
    other = setup and setup.artefact.kind != "none" and not setup.ballbar and not setup.hybrid
    if isinstance(read, tn.Ballbar) and other:
        raise tn.InputError(
            f"{set_ups[0]}: got neither a table [ballbar] nor [hybrid], expected one of them, or "
            "no set-up for a three-axis machine and a calibrated bar"
        )
    return _diagnosed(read, setup, effects)
