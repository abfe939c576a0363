"""Every kind of data keeps what the engine was promised of a model."""

import runpy
from collections.abc import Callable
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest

from model_contract import CHECKS
from trunnion.diagnosis.model import Model
from trunnion.models.kinds import kinds, model_of

EXAMPLES = [example for kind in kinds() for example in kind.examples]


@cache
def made(example: str) -> tuple[Model, Any]:
    data, setup = resolve_name(example)()
    return model_of(data, setup), setup


def test_every_kind_has_an_example() -> None:
    assert all(kind.examples for kind in kinds())


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda name: name.split(":")[1])
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_promise(check: Callable[[Model, Any], None], example: str) -> None:
    check(*made(example))


def test_the_page_of_effects_is_that_of_the_catalogues() -> None:
    docs = Path(__file__).parents[1] / "docs"
    made = runpy.run_path(str(docs / "make_effects_table.py"))
    text = (docs / "reference" / "effects.md").read_text(encoding="utf-8")
    assert made["page"](text) == text, "run `make docs`"
