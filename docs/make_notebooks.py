"""Run the notebooks and keep what they show: ``make notebooks``, or with names of notebooks.

Static pictures and tables stay, so that a notebook can be read on a code host and in the docs; a
view in space gets a picture beside it (by chromium, where there is one). What changes from run to
run (times, counts of execution) is taken out. The hash of the sources that ran is stored, and
``tests/test_notebooks.py`` holds the committed sources to it.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
PLOTLY = "application/vnd.plotly.v1+json"
MAX_BYTES = 1_000_000
COLOURS = 128
KEPT = ("text/plain", "text/html", "image/png", "image/svg+xml", "text/markdown", "text/latex")


def source_hash(notebook: Any) -> str:
    """Return the hash of the sources of the code cells, in order."""
    sources = [cell["source"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return hashlib.sha256(json.dumps(sources).encode()).hexdigest()


def execute(path: Path) -> Any:
    """Run a notebook from top to bottom and return it with its outputs."""
    notebook = nbformat.read(path, as_version=4)
    folder = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=1200, kernel_name="python3", resources=folder).execute()
    for cell in notebook.cells:
        cell.metadata = nbformat.NotebookNode()
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = [out for out in map(_kept, cell.outputs) if out is not None]
    notebook.metadata = nbformat.from_dict(
        {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
            "trunnion": {"executed": source_hash(notebook)},
        }
    )
    return notebook


def _kept(output: Any) -> Any:
    """Return an output as it is committed; None for what is seen while it runs only."""
    if output.output_type == "stream":
        return None if output.name == "stderr" else output
    if output.output_type == "error":
        return output
    data = output.data
    if PLOTLY in data:
        picture = photograph(data[PLOTLY])
        data = {"image/png": picture} if picture else {"text/plain": "a view in space"}
    if "application/vnd.jupyter.widget-view+json" in data:
        return None
    output.data = nbformat.from_dict({k: v for k, v in data.items() if k in KEPT})
    if "image/png" in output.data:
        output.data["image/png"] = smaller(output.data["image/png"])
    if "image/png" in output.data or "text/html" in output.data:
        output.data.pop("text/plain", None)
    if "execution_count" in output:
        output.execution_count = None
    output.metadata = nbformat.NotebookNode()
    return output if output.data else None


def smaller(picture: str) -> str:
    """Return a PNG (base64) with a palette: a third of the size, the same to the eye."""
    from PIL import Image

    image = Image.open(io.BytesIO(base64.b64decode(picture)))
    flat = Image.new("RGB", image.size, "white")
    flat.paste(image, mask=image.getchannel("A") if image.mode == "RGBA" else None)
    buffer = io.BytesIO()
    flat.quantize(COLOURS).save(buffer, format="png", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


def photograph(figure: Any, width: int = 820, height: int = 560) -> str | None:
    """Return a Plotly figure as PNG (base64) by chromium; None where there is none."""
    chromium = shutil.which("chromium")
    if chromium is None:
        return None
    from playwright.sync_api import sync_playwright
    from plotly import graph_objects

    shown = graph_objects.Figure({"data": figure["data"], "layout": figure["layout"]})
    shown.update_layout(width=width, height=height, paper_bgcolor="white")
    options = ["--headless", "--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader"]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = Path(folder) / "view.html"
        shown.write_html(page_file, config={"displayModeBar": False})
        browser = playwright.chromium.launch(executable_path=chromium, args=options)
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(page_file.as_uri())
        page.wait_for_selector(".gl-container canvas, .main-svg")
        page.wait_for_timeout(2500)
        picture = page.screenshot()
        browser.close()
    return base64.b64encode(picture).decode()


def main(names: list[str]) -> None:
    """Run the notebooks of these names; all of them without any."""
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        if names and not any(name in path.stem for name in names):
            continue
        text = nbformat.writes(execute(path)) + "\n"
        size = len(text.encode())
        if size > MAX_BYTES:
            raise SystemExit(f"{path.name}: got {size} bytes, expected at most {MAX_BYTES}")
        path.write_text(text, encoding="utf-8")
        sys.stdout.write(f"{path.name}: {size // 1000} kB\n")


if __name__ == "__main__":
    main(sys.argv[1:])
