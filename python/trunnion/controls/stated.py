"""What the public documentation of a control does not say, and its user states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trunnion.base.checks import choose
from trunnion.base.errors import InputError


@dataclass(frozen=True)
class Need:
    """One thing that must be stated: its name, what it may be (none: any text), what it says."""

    name: str
    choices: tuple[str, ...]
    meaning: str


def take(control: str, stated: Mapping[str, str] | None, needs: Sequence[Need]) -> dict[str, str]:
    """Return what was stated, every need of it.

    Raises InputError: a need without a value, with another one than it may have, or a value that
    nothing needs.
    """
    given = {name: str(value) for name, value in (stated or {}).items()}
    known = {need.name: need for need in needs}
    for name in given:
        choose(f"stated, {control}", name, known)
    missing = [need for need in needs if need.name not in given]
    if missing:
        wanted = "; ".join(
            f"{need.name} ({', '.join(need.choices) or 'text'}): {need.meaning}" for need in missing
        )
        raise InputError(
            f"{control}: got no {missing[0].name}, expected what the public documentation of the "
            f"control does not say (--stated NAME=VALUE); ask its builder, or try one error. "
            f"{wanted}"
        )
    for name, value in given.items():
        if known[name].choices:
            choose(name, value, known[name].choices)
    return given


def lines(stated: Mapping[str, str], comment: str) -> list[str]:
    """Header of a file: what its user stated."""
    return [f"{comment} stated by the user, not documented: {k} = {v}" for k, v in stated.items()]
