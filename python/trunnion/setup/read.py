"""The reader of ``setup.toml``."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any

from trunnion.base.arguments import checked
from trunnion.base.read_files import as_read
from trunnion.files.toml import TomlText
from trunnion.setup.artefact import DIMENSIONS, Artefact, names_of
from trunnion.setup.fields import Section, keys_of
from trunnion.setup.machine import AxisSetup
from trunnion.setup.parts import AXES, PARTS, Setup, TableSetup
from trunnion.setup.write import PROCESS_TABLES


@checked
def read_setup(path: str | PathLike[str]) -> Setup:
    """Read ``setup.toml``; ``print(setup)`` lists its keys.

    Raises
    ------
    FileFormatError
        If the file is not TOML, has a key that nobody knows or a value that its key does not take;
        the message has file, line and column, what stood there and what is expected.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.read_setup(tn.sample_path("cross/setup.toml"))
    <Setup: trt-ca, cross 100 × 25 × 25 mm, ball radius 1 mm>
    """
    file = TomlText.read(path)
    return setup_of(file.tables, file)


def setup_of(content: Mapping[str, Any], file: TomlText | None = None) -> Setup:
    """Return the set-up that tables as in ``setup.toml`` describe; `file`: where they stand."""
    root = Section(content, (), file)
    root.only((*PARTS, "axes", *PROCESS_TABLES))
    tables = {name: root.table(name) for name in (*PARTS, "axes", *PROCESS_TABLES)}
    axes = tables.pop("axes")
    axes.only(AXES)
    processes: dict[str, Any] = {name: tables.pop(name) for name in PROCESS_TABLES}
    no_touches = any(processes.values()) or content.keys() == {"report"}
    built: dict[str, Any] = {
        name: _artefact(table, needed=not no_touches)
        if name == "artefact"
        else table.build(PARTS[name])
        for name, table in tables.items()
    }
    if "table" not in root:
        built["table"] = TableSetup(is_assumed=True)
    with root.placed():
        return Setup(
            axes={letter: axes.table(letter).build(AxisSetup) for letter in axes},
            **built,
            **processes,
            source="" if file is None else file.path,
            read_as=None if file is None else as_read(file.path, "set-up"),
        )


def _artefact(table: Section, *, needed: bool) -> Artefact:
    """Return the artefact; a kind takes only its own dimensions."""
    if not table and not needed:
        return Artefact("none")
    kind, declared = table.get("kind"), keys_of(Artefact)
    own = names_of(kind) if isinstance(kind, str) and kind in DIMENSIONS else tuple(declared)
    return table.build(Artefact, {k: v for k, v in declared.items() if k in own})
