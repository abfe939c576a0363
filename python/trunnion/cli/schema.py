"""What ``--json`` prints, as JSON Schema: made from the fields of results, not by hand."""

from __future__ import annotations

import types
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pkgutil import resolve_name
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

DIALECT = "https://json-schema.org/draft/2020-12/schema"
ANYTHING: dict[str, Any] = {}
NUMBER: dict[str, Any] = {"anyOf": [{"type": "number"}, {"enum": ["inf", "-inf", "nan"]}]}
"""JSON has no numbers that are not finite: these are text."""


@dataclass(frozen=True)
class Printed:
    """What a command prints with --json.

    result: "module:Class" of a result whose fields are printed; "" for none.
    keys: A TypedDict of what is printed beside them.
    without: Fields of the result that are not printed.
    """

    result: str = ""
    keys: Any = None
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Of:
    """In an annotation: values are results of these classes, "module:Class"."""

    results: tuple[str, ...]
    without: tuple[str, ...] = ()


def schema(command: str, version: int, printed: tuple[Printed, ...]) -> dict[str, Any]:
    """Return the JSON Schema of what a command prints; of several forms, one fits."""
    definitions: dict[str, Any] = {}
    head = {
        "type": "object",
        "properties": {"command": {"const": command}, "version": {"const": version}},
        "required": ["command", "version"],
    }
    forms = [_form(each, definitions, head) for each in printed]
    made = forms[0] if len(forms) == 1 else {"anyOf": forms}
    title = f"trunnion {command} --json, version {version}"
    return {"$schema": DIALECT, "title": title, **made, "$defs": definitions}


def _form(printed: Printed, definitions: dict[str, Any], head: dict[str, Any]) -> dict[str, Any]:
    from trunnion.base.record import Record

    keys: dict[str, Any] = {"schema": head, "record": _of(Record, definitions)}
    required = ["schema"]
    if printed.result:
        of = _less(_result(resolve_name(printed.result), definitions), printed.without)
        keys |= of["properties"]
        required += of["required"]
    if printed.keys is not None:
        hints = get_type_hints(printed.keys, include_extras=True)
        optional: Collection[str] = printed.keys.__optional_keys__
        keys |= {name: _of(hint, definitions) for name, hint in hints.items()}
        required += [name for name in hints if name not in optional]
    return {"type": "object", "properties": keys, "required": required}


def _result(kind: type, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a dataclass as `trunnion.base.report.plain` stores it."""
    stored = hasattr(kind, "to_dict")  # a result: with its name, without what is code
    hints = _hints(kind)
    named = [f.name for f in fields(kind) if f.compare or not stored]
    keys = {name: _of(hints.get(name, Any), definitions) for name in named}
    if stored:
        keys = {"result": {"const": kind.__name__}, **keys}
    return {"type": "object", "properties": keys, "required": [*keys]}


def _hints(kind: type) -> dict[str, Any]:
    """Return the types of fields; where a name is not there at run time, none."""
    try:
        return get_type_hints(kind, include_extras=True)
    except NameError:
        return {}


def _of(hint: Any, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of values of a type, as `plain` stores them."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        of = next((each for each in hint.__metadata__ if isinstance(each, Of)), None)
        return _of(arguments[0], definitions) if of is None else _any_of(of, definitions)
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin in (Union, types.UnionType):
        return {"anyOf": [_of(each, definitions) for each in arguments]}
    if isinstance(hint, type) and is_dataclass(hint):
        if hint.__name__ not in definitions:
            definitions[hint.__name__] = ANYTHING  # one that holds itself
            definitions[hint.__name__] = _result(hint, definitions)
        return {"$ref": f"#/$defs/{hint.__name__}"}
    return _plain(origin or hint, arguments, definitions)


def _any_of(of: Of, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of results, one of several classes."""
    classes = [resolve_name(each) for each in of.results]
    if not of.without:
        found = [_of(each, definitions) for each in classes]
    else:
        found = [_less(_result(each, definitions), of.without) for each in classes]
    return found[0] if len(found) == 1 else {"anyOf": found}


def _less(made: dict[str, Any], without: Collection[str]) -> dict[str, Any]:
    kept = {name: of for name, of in made["properties"].items() if name not in without}
    return {**made, "properties": kept, "required": [*kept]}


def _plain(kind: Any, arguments: tuple[Any, ...], definitions: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(kind, type):
        return ANYTHING
    if issubclass(kind, Mapping):
        if arguments and arguments[0] is not str:  # the class stores it in a form of its own
            return ANYTHING
        values = _of(arguments[1], definitions) if len(arguments) == 2 else ANYTHING
        return {"type": "object", "additionalProperties": values}
    if issubclass(kind, str):
        return {"type": "string"}
    if issubclass(kind, Collection) or kind.__name__ == "ndarray":
        items = [_of(each, definitions) for each in arguments if each is not Ellipsis]
        if kind.__name__ == "ndarray":
            return {"anyOf": [{"type": "array"}, NUMBER]}  # of no axes: a number
        if not items:
            return {"type": "array"}
        return {"type": "array", "items": items[0] if len(items) == 1 else {"anyOf": items}}
    simple = (
        (bool, {"type": "boolean"}),
        (int, {"type": "integer"}),
        (float, NUMBER),
        (type(None), {"type": "null"}),
    )
    return next((found for each, found in simple if issubclass(kind, each)), ANYTHING)
