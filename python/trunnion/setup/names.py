"""Names of location errors: one spelling inside, several accepted on input."""

import re

from trunnion.base.errors import UnknownNameError

__all__ = ["canonical_error_name"]

# EA0C: an error E in direction A..C (tilt) or X..Z (offset), zero for location, of an axis.
_SPELLING = re.compile(r"(?:E_?|E_\{)([XYZABC])[0O]([A-Z][0-9]?)\}?", re.IGNORECASE)


def canonical_error_name(text: str) -> str:
    """Spell the name of a location error as ISO 230-1 does, with a digit zero: ``EA0A``.

    The letter O for the zero, lower case and a leading ``E_`` (``E_A0A``, ``E_{AOA}``) are
    accepted. Whether the machine has such an error is not known here.

    Raises
    ------
    UnknownNameError
        If `text` is not the name of a location error in any of these spellings.
    """
    match = _SPELLING.fullmatch(text.strip()) if isinstance(text, str) else None
    if match is None or ("{" in text) != ("}" in text):
        raise UnknownNameError(
            f"location error: got {text!r}, expected a name of ISO 230-1 such as EA0A (tilt "
            "about X of the A axis) or EX0C (offset along X of the C axis)"
        )
    direction, axis = match.groups()
    return f"E{direction}0{axis}".upper()
