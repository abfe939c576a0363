"""Lines that the parts of a probing program share."""

from __future__ import annotations

from collections.abc import Iterator

from trunnion.probing.cycle import SHORTEST_PROBE_MM

LONGEST_COMMENT = 240
"""LinuxCNC takes lines of at most 255 characters."""
_NO_ROUND = str.maketrans("()", "[]")


def n(value: float) -> str:
    """Return a number as programs write it."""
    text = f"{value + 0.0:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def comment(text: str) -> str:
    """Return a comment of a header; one in another, or a line too long, LinuxCNC refuses."""
    return f"({text.translate(_NO_ROUND)[:LONGEST_COMMENT]})"


def stop_if(label: int, condition: str, message: str) -> Iterator[str]:
    """Stop with a message, before anything moves."""
    yield f"o{label} if [{condition}]"
    yield f"  (ABORT, {message})"
    yield f"o{label} endif"


def fault_if(label: int, condition: str, message: str) -> Iterator[str]:
    """Say what is not as planned, and count it (``#<faults>``): the check goes on."""
    yield f"o{label} if [{condition}]"
    yield f"  (DEBUG, {message})"
    yield "  #<faults> = [#<faults> + 1]"
    yield f"o{label} endif"


def own(line: str) -> Iterator[str]:
    """Yield a line of the user's, if there is one."""
    if line:
        yield f"  {line}"


def end(message: str, indent: str = "  ") -> Iterator[str]:
    """Rise and stop with a message; the log is kept."""
    yield f"{indent}G0 Z#<_up>"
    yield f"{indent}M66 E0 L0"
    yield f"{indent}(LOGCLOSE)"
    yield f"{indent}(ABORT,%d {message})"


def protected(label: int, to: str, way: str, where: str) -> Iterator[str]:
    """Move, and stop the program on contact."""
    yield f"o{label} if [{way} GT {n(SHORTEST_PROBE_MM)}]"
    yield f"  G38.3 {to} F#<_down>"
    yield f"  o{label + 1} if [[#<_task> EQ 1] AND [#5070 EQ 1]]"
    yield from end(f"contact {where}", "    ")
    yield f"  o{label + 1} endif"
    yield f"o{label} endif"
