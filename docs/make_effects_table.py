"""Write the catalogues of effects into effects.md as Markdown tables: ``make docs`` runs it."""

import re
from collections.abc import Sequence
from pathlib import Path

import trunnion as tn
from trunnion.models.kinds import kinds

PAGE = Path(__file__).parent / "reference" / "effects.md"
HEAD = ("id", "what it is", "code", "belongs to", "parameters", "needs")
MAX_SHOWN = 4

# Axes and numbers, in which alike effects differ.
_PLACE = re.compile(r"(?<=_)(?:[xyz]{1,2}|[ac]|\d+)(?=_|$)")


def tables() -> dict[str, str]:
    """Markdown table of every kind of data, by its name; effects that are alike share a line."""
    return {kind.name: table(tn.catalogue(kind.name)) for kind in kinds() if kind.examples}


def alike(e: tn.EffectInfo) -> tuple[object, ...]:
    """Return what effects have in common that differ in an axis or a number only."""
    names = tuple(re.sub(r"\d|arcsec|um|mm|deg", "", p.name) for p in e.parameters)
    return _PLACE.sub("*", e.id), names, e.owner, e.needs


def table(effects: Sequence[tn.EffectInfo]) -> str:
    """Markdown of some effects."""
    groups: dict[tuple[object, ...], list[tn.EffectInfo]] = {}
    for e in effects:
        groups.setdefault(alike(e), []).append(e)
    lines = [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
    for group in groups.values():
        first = group[0]
        cells = (
            _listed([f"`{e.id}`" for e in group]),
            first.label,
            _listed(list(dict.fromkeys(code for e in group for code in e.codes))),
            str(first.owner),
            _listed([f"`{p.name}`" for p in first.parameters]),
            ", ".join(f"`{column}`" for column in first.needs) or "–",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _listed(words: Sequence[str]) -> str:
    """Write a list, of a long one its ends."""
    if len(words) > MAX_SHOWN:
        words = [*words[: MAX_SHOWN - 2], "...", words[-1]]
    return ", ".join(words) or "–"


def page(text: str) -> str:
    """Return the page with each table between its marks."""
    for name, markdown in tables().items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        head, _, rest = text.partition(begin)
        _, _, tail = rest.partition(end)
        text = f"{head}{begin}\n{markdown}\n{end}{tail}"
    return text


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
