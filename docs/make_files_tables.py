"""Write the columns of every kind of data into files.md as tables: ``make docs`` runs it."""

from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from trunnion.base.units import unit_of
from trunnion.files.columns import LARGEST
from trunnion.models.kinds import Kind, kinds

PAGE = Path(__file__).parent / "reference" / "files.md"
EXAMPLE_ROW = 3  # of the measurement that a value is shown from
BEGIN, END = "<!-- columns: begin -->", "<!-- columns: end -->"


def taken(column: Any, unit: str) -> str:
    """Return the range of a column's values."""
    said = getattr(column, "expected", "text or a whole number").removeprefix("a finite ")
    largest = LARGEST.get(unit)
    return said + (f", size up to {largest:g}" if largest and unit and said == "number" else "")


def shown(value: Any) -> str:
    """Return an example as it stands in a file."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def table(kind: Kind) -> str:
    """Markdown of one kind."""
    data = resolve_name(kind.data)
    lines = [
        f"### {kind.name}: `tn.{data.__name__}`",
        "",
        f"Known by {kind.known_by()}.",
        "",
        "| column | unit | | takes | example | needed |",
        "|---|---|---|---|---|---|",
    ]
    examples = [resolve_name(example)()[0] for example in kind.examples]
    for name, column in data.kinds.items():
        given = next((e.columns[name][EXAMPLE_ROW] for e in examples if name in e.columns), None)
        unit = unit_of(name)
        cells = (
            f"`{name}`",
            unit or "–",
            column.meaning,
            taken(column, unit),
            "–" if given is None else f"`{shown(given)}`",
            "yes" if column.required else "",
        )
        lines.append(f"| {' | '.join(cells)} |")
    if data.choice:
        lines += ["", f"Of the others it needs {data.choice}."]
    return "\n".join(lines)


def page(text: str) -> str:
    """Return the page with the tables between their marks."""
    head, _, rest = text.partition(BEGIN)
    tables = "\n\n".join(table(kind) for kind in kinds())
    return f"{head}{BEGIN}\n\n{tables}\n\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
