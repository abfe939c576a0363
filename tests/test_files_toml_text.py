"""Places of TOML keys: what stands at the place found for a key is the key's value."""

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trunnion.files.toml import TomlText

TRICKY = (
    r'''# a comment with [brackets] and "quotes"
a.b . "c d" = 1   # after a value
"x]" = "]#\"["
'y = 1' = 'no \ escape'
many = """
[no.table]
k = "v" \""" still"""
lines = """ends with quotes""""
raw = """'''
    + "'''[no]\n''''"
    + r'''"""
when = 2020-01-02 03:04:05
mixed = [ # comment ]
  [1, 2], # another
  { p = "}", q.r = [ ] },
  "a,b",
]
[t] # comment
k = +1_000.5e-3
[t . "u.v"]
k = inf
[[rows]]
k = 1
[[rows.inner]]
k = 2
[[rows.inner]]
k = 3
[[rows]]
[rows.inner]
k = {}
'''
)


def leaves(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of everything that stands in a file as a value."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from leaves(inner, (*path, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from leaves(inner, (*path, index))
    else:
        yield path


def look_up(tables: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        tables = tables[key]
    return tables


def check(file: TomlText) -> None:
    assert set(leaves(file.tables)) <= set(file.spans)
    for path, span in file.spans.items():
        value = look_up(file.tables, path)  # a path that is not there would be a KeyError
        if written := file.written(path):
            assert tomllib.loads(f"x = {written}")["x"] == value
            assert not file.text[span.key].isspace()


def test_every_form_of_key_and_value_is_found(tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_text(TRICKY)
    file = TomlText.read(path)
    check(file)
    error = file.error(("rows", 0, "inner", 1, "k"), "what", at_value=True)
    line = TRICKY[: TRICKY.index("k = 3")].count("\n") + 1
    assert str(error) == f"{path}:{line}:5: what"


names = st.text(max_size=8) | st.sampled_from(["a", "b.c", '"', "'''", "#", "[x]", "="])
texts = st.text(max_size=12) | st.sampled_from(['"""', "'''", "#]", "\\", "a\nb", "},"])
values = st.recursive(
    st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False) | texts | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
    max_leaves=10,
)


@settings(
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
@given(st.dictionaries(names, values, max_size=4))
def test_every_value_of_a_written_file_is_found(tmp_path: Path, raw: dict[str, Any]) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(
        tomli_w.dumps({"artefact": {"kind": "cross"}, "turning": raw}), encoding="utf-8"
    )
    check(TomlText.read(path))
