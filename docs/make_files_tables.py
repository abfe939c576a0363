"""Write the columns of every kind of data into files.md as tables: ``make docs`` runs it."""

from pathlib import Path
from pkgutil import resolve_name

from trunnion.base.units import unit_of
from trunnion.models.kinds import Kind, kinds

PAGE = Path(__file__).parent / "reference" / "files.md"
BEGIN, END = "<!-- columns: begin -->", "<!-- columns: end -->"


def table(kind: Kind) -> str:
    """Markdown of one kind."""
    data = resolve_name(kind.data)
    lines = [
        f"### {kind.name}: `tn.{data.__name__}`",
        "",
        f"Known by {kind.known_by()}.",
        "",
        "| column | unit | | needed |",
        "|---|---|---|---|",
    ]
    for name, column in data.kinds.items():
        needed = "yes" if column.required else ""
        lines.append(f"| `{name}` | {unit_of(name) or '–'} | {column.meaning} | {needed} |")
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
