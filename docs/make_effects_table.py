"""Print the catalogue of effects on touches as a Markdown table: ``make docs`` puts it in place."""

from pathlib import Path

import trunnion as tn

PAGE = Path(__file__).parent / "effects.md"
BEGIN, END = "<!-- touches: begin -->", "<!-- touches: end -->"


def table() -> str:
    """Markdown of every effect on touches of the cross on a trt-ca machine."""
    lines = ["| id | what it is | belongs to | parameters | needs |", "|---|---|---|---|---|"]
    for effect in tn.catalogue(tn.Setup(artefact=tn.Artefact("cross"))):
        names = ", ".join(f"`{parameter.name}`" for parameter in effect.parameters)
        needs = ", ".join(f"`{column}`" for column in effect.needs) or "–"
        lines.append(f"| `{effect.id}` | {effect.title} | {effect.owner} | {names} | {needs} |")
    return "\n".join(lines)


def main() -> None:
    """Write the table between its marks."""
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition(BEGIN)
    _, _, tail = rest.partition(END)
    PAGE.write_text(f"{head}{BEGIN}\n{table()}\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main()
