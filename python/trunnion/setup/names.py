"""Names of errors and effects: one spelling inside, several accepted on input."""

import re
from collections.abc import Callable, Sequence
from functools import lru_cache

from trunnion.base.arguments import checked
from trunnion.base.errors import UnknownNameError
from trunnion.base.units import parameter_words

# EA0C: an error E in direction A..C (tilt) or X..Z (offset), zero for location, of an axis.
_SPELLING = re.compile(r"(?:E_?|E_\{)([XYZABC])[0O]([A-Z][0-9]?)\}?", re.IGNORECASE)


@checked
def canonical_error_name(text: str) -> str:
    """Spell the name of a location error as ISO 230-1 does, with a digit zero: ``EA0A``.

    The letter O for the zero, lower case and a leading ``E_`` (``E_A0A``, ``E_{AOA}``) are
    accepted. Whether the machine has such an error is not known here.

    Raises
    ------
    UnknownNameError
        If `text` is not the name of a location error in any of these spellings.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.canonical_error_name("E_XOC")
    'EX0C'
    """
    match = _SPELLING.fullmatch(text.strip()) if isinstance(text, str) else None
    if match is None or ("{" in text) != ("}" in text):
        raise UnknownNameError(
            f"location error: got {text!r}, expected a name of ISO 230-1 such as EA0A (tilt "
            "about X of the A axis) or EX0C (offset along X of the C axis)"
        )
    direction, axis = match.groups()
    return f"E{direction}0{axis}".upper()


# Effects by id → codes of the errors that they are part of. A letter in braces is that of the axis
# or of the direction; tilts have the letters of rotary axes.
_CODE = re.compile(r"E_?\{?[XYZABC][0O]?[XYZABC]\}?", re.IGNORECASE)
_SQUARENESS = {"xy": "EC0Y", "xz": "EB0Z", "yz": "EA0Z"}
_TILT = dict(zip("xyz", "ABC", strict=True))
_AXIS = re.compile(r"(?:scale|positioning|periodic|cyclic)_([xyz])")
_DIRECTION = re.compile(r"(straightness|angular)_([xyz])_of_([xyz])")
_ROTARY = re.compile(
    r"(?:([abc])_)?(positioning|scale|radial|sag|axial|tilt|wobble|twist)(?:_(?:\d+|trend|scale|cyclic))?"
)


@lru_cache(maxsize=1024)
def iso_codes(effect: str) -> tuple[str, ...]:
    """Return the ISO 230-1 codes of the errors that an effect of this id is part of, if any.

    ``scale_x`` and ``positioning_x`` → EXX, ``straightness_y_of_x`` → EYX, ``angular_z_of_x`` →
    ECX, ``squareness_xy`` → EC0Y, ``c_radial_2`` → EXC and EYC. A rotary axis without a letter
    (targets on one axis) counts as C.
    """
    if effect.startswith("squareness_") and effect[11:] in _SQUARENESS:
        return (_SQUARENESS[effect[11:]],)
    if match := _AXIS.fullmatch(effect):
        axis = match[1].upper()
        return (f"E{axis}{axis}",)
    if match := _DIRECTION.fullmatch(effect):
        kind, direction, axis = match.groups()
        letter = _TILT[direction] if kind == "angular" else direction.upper()
        return (f"E{letter}{axis.upper()}",)
    if effect not in ("scale", "twist") and (match := _ROTARY.fullmatch(effect)):
        return _rotary_codes((match[1] or "c").upper(), match[2])
    return ()


def _rotary_codes(axis: str, kind: str) -> tuple[str, ...]:
    """Codes of an error motion of a rotary axis: about or along itself, or across."""
    along = "XYZ"["ABC".index(axis)]
    if kind in ("positioning", "scale"):
        return (f"E{axis}{axis}",)
    if kind == "axial":
        return (f"E{along}{axis}",)
    if kind in ("radial", "sag"):
        return tuple(f"E{d}{axis}" for d in "XYZ" if d != along)
    across = [t for t in "ABC" if t != axis]
    # a twist is about the horizontal axis across: EBA, EAB
    return (f"E{across[0]}{axis}",) if kind == "twist" else tuple(f"E{t}{axis}" for t in across)


def is_code(name: str) -> bool:
    """Whether a name has the form of a code of ISO 230-1: EXX, EC0Y, in any accepted spelling."""
    return _CODE.fullmatch(name) is not None


def effect_ids(name: str, known: Sequence[str]) -> tuple[str, ...]:
    """Return the ids that a name stands for: itself, or those with this code of ISO 230-1.

    Spellings of codes as for :func:`canonical_error_name`. Empty: the name is not known.
    """
    if name in known:
        return (name,)
    if not is_code(name):
        return ()
    code = re.sub(r"[_{}]", "", name).upper().replace("O", "0")
    return tuple(i for i in known if code in iso_codes(i))


_RIGHT = {"A": "X", "B": "Y", "C": "Z"}
_OF_AXIS = re.compile(r"axis_(r?)([xyz])_(?:um|arcsec)")
_PLACEMENT = re.compile(r"(d(?=[xyz])|r(?=[abc]))([xyzabc])_(?:um|arcsec)")
_PLACE = re.compile(r"(\w+)\.d([xyz])_um")


def error_label(name: str) -> str:
    """Say what a location error or the placement of an artefact is, by its name.

    ``EX0C`` → "offset of the C axis along X", ``EB0C`` → "tilt of the C axis about Y", ``EC0C`` →
    "zero position of the C axis", ``dx_um`` → "shift of the artefact along X", ``ball.dx_um`` →
    "place of the ball along X"; else the name.
    """
    if match := _PLACEMENT.fullmatch(name):
        if match[1] == "d":
            return f"shift of the artefact along {match[2].upper()}"
        return f"turn of the artefact about {_RIGHT[match[2].upper()]}"
    if match := _PLACE.fullmatch(name):
        what, direction = match.groups()
        known = {"tool_offset": "offset of the tool", "ball": "place of the ball"}
        of = known.get(what) or f"place of {what.replace('_', ' ')}"
        return f"{of} along {direction.upper()}"
    match = _SPELLING.fullmatch(name)
    if match is None:
        return name
    what, axis = match.groups()
    if what in "XYZ":
        return f"offset of the {axis} axis along {what}"
    return (
        f"zero position of the {axis} axis"
        if what == axis
        else (f"tilt of the {axis} axis about {_RIGHT[what]}")
    )


def spoken(name: str) -> str:
    """Return an error as sentences have it: a code of ISO 230-1, or words with the name behind."""
    return name if is_code(name) else called(name)


def called(name: str) -> str:
    """Return a location error in words with its name: "offset of the C axis along X (EX0C)"."""
    label = error_label(name)
    if match := _OF_AXIS.fullmatch(name):
        verb = "tilt of the axis about" if match[1] else "offset of the axis along"
        label = f"{verb} {match[2].upper()}"
    return name if label == name else f"{label} ({name})"


def fitted_in_words(name: str, say: Callable[[str], str] = called) -> str:
    """Say what is always fitted: "offset (positioning 2)", of one of several measurements.

    say: Names a location error or a placement, and gives back what it does not know.
    """
    measurement, _, own = name.rpartition(":")
    known = say(own)
    words = parameter_words(own) if known == own else known
    return f"{words} ({measurement})" if measurement else words


def shared_label(id_: str, label: str) -> str:
    """What people call an error of the machine that several measurements know by this id.

    label: What one of them calls it, which stands where the id alone does not say it; of an effect
    of one axis ("curve_of_x") with the axis.
    """
    kind, _, axes = id_.rpartition("_")
    letters = axes.upper()
    if kind in ("scale", "backlash") and axes in ("x", "y", "z"):
        return f"{kind} of the {letters} axis"
    if kind == "backlash_slope" and axes in ("x", "y", "z"):
        return f"backlash of the {letters} axis that grows along {letters}"
    if id_ in ("a_backlash", "b_backlash", "c_backlash"):
        return f"backlash of the {id_[0].upper()} axis"
    if kind == "squareness" and axes in ("xy", "xz", "yz"):
        return f"squareness of {letters[1]} to {letters[0]}"
    said = not label or f" {letters} axis" in label
    return f"{label} ({letters})" if kind.endswith("_of") and not said else label
