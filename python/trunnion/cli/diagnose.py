"""``trunnion diagnose``: whether a measurement fits its model, and if not, why."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

import trunnion.models.touches  # noqa: F401  the kinds of data announce themselves
from trunnion.cli.common import clean_errors, show_diagnosis
from trunnion.data.axis_log import read_axis_log
from trunnion.data.ballbar import read_ballbar
from trunnion.data.diameters import read_diameters
from trunnion.data.points import read_points
from trunnion.data.sweep import read_sweep
from trunnion.data.text import decode
from trunnion.data.touches import read_touches
from trunnion.diagnosis import diagnose as diagnose_data
from trunnion.errors import InputError
from trunnion.models.next_touches import prospect
from trunnion.setup import read_setup

__all__ = ["register"]

KINDS: dict[str, tuple[Callable[[Path], Any], tuple[str, ...]]] = {
    "touches": (read_touches, ("dir_x", "dir_y", "dir_z")),
    "points": (read_points, ("nominal_x_mm", "nominal_y_mm")),
    "sweep": (read_sweep, ("angle_deg", "target")),
    "diameters": (read_diameters, ("z_mm", "error_um")),
    "ballbar": (read_ballbar, ("setup", "length_mm")),
    "axislog": (read_axis_log, ("time_s",)),
}
"""Kind of data: its reader, and the columns by which a file is known (looked for in this order)."""


def kind_of(path: Path) -> str:
    """Tell the kind of data from the header line."""
    try:
        with path.open(encoding="utf-8-sig") as lines:
            header = next((x for x in lines if x.strip() and not x.lstrip().startswith("#")), "")
    except UnicodeDecodeError:
        decode(str(path), path.read_bytes())
        raise
    names = {name.strip() for name in header.split(",")}
    for kind, (_, wanted) in KINDS.items():
        if names.issuperset(wanted):
            return kind
    raise InputError(f"{path}: got columns {header.strip()!r}, wanted those of {', '.join(KINDS)}")


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("diagnose")(clean_errors(diagnose))


def diagnose(
    files: Annotated[
        list[Path],
        typer.Argument(help="measured data (CSV), and the set-up (TOML) where it needs one"),
    ],
    kind: Annotated[str, typer.Option(help=f"{', '.join(KINDS)}; told by the columns")] = "",
    html: Annotated[Path | None, typer.Option(help="write a page with pictures here")] = None,
    next_touches: Annotated[
        int, typer.Option("--next", help="plan this many touches that part the alternatives")
    ] = 0,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="where the plan of --next goes")
    ] = Path("next.csv"),
    json_output: Annotated[
        bool, typer.Option("--json", help="print JSON instead of tables")
    ] = False,
) -> None:
    """Say whether the model explains a measurement, and if not, what is wrong, by name."""
    setups = [f for f in files if f.suffix.lower() == ".toml"]
    data = [f for f in files if f.suffix.lower() != ".toml"]
    if len(data) != 1 or len(setups) > 1:
        raise InputError(
            f"files: got {len(data)} of data and {len(setups)} set-ups, wanted one of data and at "
            "most one set-up (.toml)"
        )
    chosen = kind or kind_of(data[0])
    if chosen not in KINDS:
        raise InputError(f"kind: got {chosen!r}, wanted one of {', '.join(KINDS)}")
    read = KINDS[chosen][0](data[0])
    d = diagnose_data(read, read_setup(setups[0]) if setups else None)
    show_diagnosis(d, html=html, json_output=json_output)
    if next_touches:
        found = prospect(d, next_touches)
        found.plan.to_csv(output)
        if not json_output:
            Console(highlight=False).print(found.summary())
