"""A diagnosis in plain words, and as a table."""

import numpy as np

from trunnion.base.units import unit_of
from trunnion.diagnosis.effect import Parameter
from trunnion.diagnosis.result import Cause, Diagnosis

__all__ = ["cause_sentence", "number", "summary"]

SHOWN = 6
NOTHING = 1e-9  # µm, arcsec: rounding
MANY = 8  # parameters of a cause: more are counted, not listed


def number(value: float, error: float | None = None, unit: str = "") -> str:
    """Write a value to the two leading digits of its standard error: ``4.82 ± 0.31 µm/h``.

    What the data do not determine gets no number.
    """
    u = f" {unit}" if unit else ""
    if error is None or error <= 0:
        return f"{value:.3g}{u}"
    if not np.isfinite(error):
        return "not determined"
    digits = int(np.clip(1 - np.floor(np.log10(error)), 0, 9))
    return f"{value:.{digits}f} ± {error:.{digits}f}{u}"


def label(id_: str) -> str:
    """Write an id as words."""
    return id_.replace("_", " ")


def cause_sentence(c: Cause) -> str:
    """Say what the cause is and how large: ``the Z axis drifts: 4.8 ± 0.3 µm/h``."""
    words = c.words or label(c.id)
    if len(c.parameters) > MANY:
        return f"{words} ({len(c.parameters)} parameters)"
    parts = []
    for name, value in c.parameters.items():
        text = number(value, c.std_errors[name], unit_of(name))
        short = name.removesuffix("_" + name.split("_", 1)[-1]) if len(c.parameters) > 1 else ""
        parts.append(f"{short} = {text}" if short else text)
    return f"{words}: {', '.join(parts)}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _chance(p: float, digits: int = 2) -> str:
    return f"p = {p:.{digits}g}" if p > 0.0 else "p < 1e-300"


def _sets(d: Diagnosis) -> str:
    shown = [" + ".join(sorted(s)) for s in d.alternatives[1 : SHOWN + 1]]
    more = len(d.alternatives) - 1 - len(shown)
    return "; ".join(shown) + (f"; and {more} more" if more > 0 else "")


def unit(d: Diagnosis) -> str:
    """Return the unit of the readings, where they have one."""
    if d.source is None or not isinstance(d.source.readings.unit, str):
        return ""
    return d.source.readings.unit


def _bias(d: Diagnosis) -> str:
    """Name the machine error that the causes had biased most, in units of its standard error."""
    if d.source is None:
        return ""
    units = {x.name: x.unit for x in d.source.nuisance}
    moved = {k: v - d.errors_after.get(k, v) for k, v in d.errors_before.items()}
    if not moved:
        return ""
    # Data without noise have standard errors of 0, and rounding moves their errors.
    name = max(moved, key=lambda k: abs(moved[k]) / max(d.errors_std.get(k, 1.0), NOTHING))
    if abs(moved[name]) < max(d.errors_std.get(name, 0.0), NOTHING):
        return ""
    return f"that biased {name} by {abs(moved[name]):.2g} {units.get(name, '')}".rstrip()


def _rms(d: Diagnosis) -> str:
    g = d.gain
    u = unit(d)
    return (
        f"held-out rms falls from {g.heldout_rms_before_um:.3g} "
        f"to {g.heldout_rms_after_um:.3g} {u}".rstrip()
    )


def opening(d: Diagnosis) -> str:
    """Say the verdict in plain words."""
    u = unit(d)
    lines = []
    said = [cause_sentence(c) for c in d.causes]
    bias = _bias(d)
    tail = "; ".join(x for x in (bias, _rms(d)) if x)
    match d.verdict:
        case "consistent":
            lines.append(
                f"The model explains the data: what is left is noise of {d.sigma:.3g} {u}".rstrip()
                + f" ({_chance(d.p_value)})."
            )
        case "explained" if said:
            lines.append(f"{_capital('; '.join(said))}; {tail}.")
        case "explained":
            lines.append("The model explains the data, but for a few bad readings.")
        case "ambiguous":
            lines.append(f"{_capital('; '.join(said))}; {tail}.")
            lines.append(f"As well explained by: {_sets(d)}.")
        case "unexplained":
            lines.append(f"No known cause makes it: {d.unexplained}.")
            if said:
                lines.append(f"Beside it: {'; '.join(said)}; {tail}.")
    if d.outliers:
        rows = ", ".join(map(str, d.outliers[:20])) + (", ..." if len(d.outliers) > 20 else "")
        if len(d.outliers) == 1:
            lines.append(f"Row {rows} belongs to no model and was left out.")
        else:
            lines.append(f"Rows {rows} belong to no model and were left out.")
        if d.lost:
            lines.append(
                f"Without them nothing determines {' and '.join(d.lost)}: measure them again."
            )
    return "\n".join(lines)


def table(d: Diagnosis) -> list[tuple[str, str]]:
    """Return the rows of the table: what, value."""
    u = unit(d)
    g = d.gain
    rows = [
        ("verdict", d.verdict),
        ("p-value, all tests together", _chance(d.p_value).removeprefix("p = ")),
        ("noise of one reading", f"{d.sigma:.3g} {u}".rstrip()),
        ("rms before, after", f"{g.rms_before_um:.3g}, {g.rms_after_um:.3g} {u}".rstrip()),
        (
            "held-out rms before, after",
            f"{g.heldout_rms_before_um:.3g}, {g.heldout_rms_after_um:.3g} {u}".rstrip(),
        ),
    ]
    for c in d.causes:
        if len(c.parameters) > MANY:
            rows.append((c.id, f"{len(c.parameters)} parameters ({_chance(c.p_value, 1)})"))
            continue
        rows += [
            (
                f"{c.id}.{name}",
                number(value, c.std_errors[name], Parameter(name).unit)
                + f" ({_chance(c.p_value, 1)})",
            )
            for name, value in c.parameters.items()
        ]
        if c.aliases:
            rows.append((f"{c.id} could be", ", ".join(c.aliases)))
    for a in d.evidence[: SHOWN + 1] if len(d.evidence) > 1 else ():
        rows.append(
            (" + ".join(sorted(a.causes)), f"{a.distance:.1f} from the best, rms {a.rms_um:.3g}")
        )
    rows += [
        (name, f"{before + 0.0:.2f} before, {_after(d, name)} after")
        for name, before in d.errors_before.items()
    ]
    if d.outliers:
        rows.append(("rows left out", ", ".join(map(str, d.outliers))))
    if d.invisible:
        rows.append(("cannot be seen", ", ".join(d.invisible)))
    return rows


def _after(d: Diagnosis, name: str) -> str:
    error = d.errors_std.get(name)
    units = {x.name: x.unit for x in d.source.nuisance} if d.source is not None else {}
    return number(d.errors_after[name], error, units.get(name, ""))


def summary(d: Diagnosis) -> str:
    """Say it in plain words, then as a table."""
    rows = table(d)
    wide = max(len(a) for a, _ in rows)
    return opening(d) + "\n\n" + "\n".join(f"  {a:<{wide}}  {b}" for a, b in rows)
