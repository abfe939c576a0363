"""Pages of results are what their makers make of runs today."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from measured import FOLDER, needs_files

DOCS = Path(__file__).parents[1] / "docs"


def maker(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the module that makes pages."""
    monkeypatch.syspath_prepend(DOCS)
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, made)
    spec.loader.exec_module(made)
    return made


def test_the_pages_of_the_papers_are_current(monkeypatch: pytest.MonkeyPatch) -> None:
    for file, text in maker("make_papers", monkeypatch).pages().items():
        assert (DOCS / "results" / file).read_text(encoding="utf-8") == text, "run make docs"


@needs_files
def test_the_page_of_real_machines_is_current(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUNNION_DATA", str(FOLDER))
    text = maker("make_real_machines", monkeypatch).page()
    page = DOCS / "results" / "real-machines.md"
    assert page.read_text(encoding="utf-8") == text, "run make real-machines"
