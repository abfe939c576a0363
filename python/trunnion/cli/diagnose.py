"""``trunnion diagnose``: whether a measurement fits its model, and if not, why."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import trunnion as tn
from trunnion.cli.command import Answer, Html, Output, command, save, sort_files
from trunnion.cli.program import ProbeLog, read_log
from trunnion.cli.read import Decimal, Units, said_of

if TYPE_CHECKING:
    from trunnion.diagnosis.result import Diagnosis

DataAndSetup = Annotated[
    list[Path],
    typer.Argument(
        metavar="DATA... [SETUP]",
        help="measured data (CSV), and the set-up (TOML) where the kind of data needs one",
    ),
]
MAX_FILES = 50  # of a joint diagnosis


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    command(app)(diagnose)


def diagnose(
    files: DataAndSetup,
    kind: Annotated[
        str, typer.Option(help="kind of data; by default detected from the columns")
    ] = "",
    html: Html = None,
    probe_log: ProbeLog = None,
    units: Units = "mm",
    decimal: Decimal = "",
    next_: Annotated[
        int,
        typer.Option("--next", help="plan this many touches that discriminate the alternatives"),
    ] = 0,
    joint: Annotated[
        bool, typer.Option("--joint", help="several measurements of one machine, together")
    ] = False,
    output: Output = None,
) -> Answer:
    """Say whether the model explains a measurement, and if not, what is wrong, by name.

    --html, or --output with a name that ends in .html, writes the report: one page with the
    evidence. With --next, --output is where the plan of further touches goes (next.csv if absent).
    """
    if joint:
        d = _together(files, kind, units, decimal)
        shown: list[Any] = [*(text for one in d.data for text in said_of(one)), d]
    else:
        d = _diagnosis(files, kind, probe_log, units, decimal)
        shown = [*said_of(d.data), d]
    # Readings and data are in files already; `Diagnosis.to_json` has them, too.
    values = {k: v for k, v in d.to_dict().items() if k not in ("residuals", "data")}
    if said := said_of(d.data):
        values["recognised"] = said[0].to_dict()
    if html is None and output is not None and output.suffix.lower() == ".html":
        html, output = output, None
    if html is not None:
        shown.append(save(html, d.to_html))
    if output is not None and not next_:
        raise tn.InputError(
            f"--output: got {output}, expected a name that ends in .html, or --next"
        )
    if next_:
        found = tn.expected_discrimination(d, next_)
        shown += [found, save(output or Path("next.csv"), found.plan.to_csv)]
    elif isinstance(d.data, tn.Diameters):
        passes = tn.next_passes(d)
        values["next_passes"] = [one.to_dict() for one in passes]
        if passes:
            best = passes[0]
            shown.append(
                f"To discriminate between them: {best}"
                if best.distinguished
                else "To discriminate between them: none of the passes that were tried would do."
            )
    return Answer(values, tuple(shown))


def diagnose_as(kind: str) -> Any:
    """Return a command that diagnoses data of one kind."""

    def run(files: DataAndSetup, html: Html = None) -> Answer:
        return diagnose(files, kind=kind, html=html)

    run.__doc__ = f"Diagnose data of the kind {kind}: the same as `trunnion diagnose`."
    return run


def _together(files: list[Path], kind: str, units: str, decimal: str) -> Diagnosis:
    """Diagnose several measurements of one machine together."""
    data, set_ups = sort_files(files, (2, MAX_FILES), (0, 1))
    read = [tn.read(path, kind=kind or None, units=units, decimal=decimal or None) for path in data]
    return tn.diagnose(read, tn.read_setup(set_ups[0]) if set_ups else None)


def _diagnosis(
    files: list[Path], kind: str, probe_log: Path | None, units: str, decimal: str
) -> Diagnosis:
    data, set_ups = sort_files(files, (1, 1), (0, 1))
    read = tn.read(data[0], kind=kind or None, units=units, decimal=decimal or None)
    setup = tn.read_setup(set_ups[0]) if set_ups else None
    if probe_log is not None:
        if not isinstance(read, tn.Touches):
            raise tn.InputError(
                f"{data[0]}: got data that are no touches, expected the plan of --probe-log"
            )
        read = read_log(probe_log, read, setup)
    if isinstance(read, tn.Ballbar) and setup and not setup.ballbar and not setup.hybrid:
        raise tn.InputError(
            f"{set_ups[0]}: got neither a table [ballbar] nor [hybrid], expected one of them, or "
            "no set-up for a three-axis machine and a calibrated bar"
        )
    return tn.diagnose(read, setup)
