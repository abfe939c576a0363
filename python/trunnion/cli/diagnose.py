"""``trunnion diagnose``: whether a measurement fits its model, and if not, why."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from trunnion.base.errors import InputError
from trunnion.cli.common import clean_errors, show_diagnosis
from trunnion.files.text import decode
from trunnion.models.kinds import Kind, kind_of_columns, kinds
from trunnion.models.kinds import diagnose as diagnose_data
from trunnion.models.next_touches import prospect
from trunnion.setup import read_setup

__all__ = ["register"]

NAMES = ", ".join(kind.name for kind in kinds())


def kind_of(path: Path) -> Kind:
    """Return the kind of data, from the header line."""
    try:
        with path.open(encoding="utf-8-sig") as lines:
            header = next((x for x in lines if x.strip() and not x.lstrip().startswith("#")), "")
    except UnicodeDecodeError:
        decode(str(path), path.read_bytes())
        raise
    kind = kind_of_columns({name.strip() for name in header.split(",")})
    if kind is None:
        raise InputError(f"{path}: got columns {header.strip()!r}, expected those of {NAMES}")
    return kind


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("diagnose")(clean_errors(diagnose))


def diagnose(
    files: Annotated[
        list[Path],
        typer.Argument(help="measured data (CSV), and the set-up (TOML) where it needs one"),
    ],
    kind: Annotated[str, typer.Option(help=f"{NAMES}; by default detected from the columns")] = "",
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
    if kind and kind not in {known.name for known in kinds()}:
        raise InputError(f"kind: got {kind!r}, expected one of {NAMES}")
    chosen = next((k for k in kinds() if k.name == kind), None) or kind_of(data[0])
    d = diagnose_data(chosen.read(data[0]), read_setup(setups[0]) if setups else None)
    show_diagnosis(d, html=html, json_output=json_output)
    if next_touches:
        found = prospect(d, next_touches)
        found.plan.to_csv(output)
        if not json_output:
            Console(highlight=False).print(found.summary())
