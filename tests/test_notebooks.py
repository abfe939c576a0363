"""Every notebook runs from top to bottom, and is committed with what it shows."""

import importlib
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))
make_notebooks = importlib.import_module("make_notebooks")

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    client = NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": path.parent}}
    )
    client.execute()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_committed_with_what_its_sources_show(path: Path) -> None:
    assert path.stat().st_size < make_notebooks.MAX_BYTES
    notebook = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    executed = notebook.metadata.get("trunnion", {}).get("executed")
    assert executed == make_notebooks.source_hash(notebook), "run: make notebooks"
    outputs = [out for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs]
    assert not [out for out in outputs if out.output_type == "error"]
    kinds = {kind for out in outputs for kind in out.get("data", {})}
    assert "image/png" in kinds
    assert kinds <= set(make_notebooks.KEPT)


def test_a_changed_source_is_noticed() -> None:
    notebook = nbformat.read(NOTEBOOKS[0], as_version=4)  # type: ignore[no-untyped-call]
    before = make_notebooks.source_hash(notebook)
    code = next(cell for cell in notebook.cells if cell.cell_type == "code")
    code.source += "\n1 + 1"
    assert make_notebooks.source_hash(notebook) != before
