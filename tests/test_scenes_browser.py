"""A page of views in a real browser: it draws, without an error and without a network."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import trunnion as tn
from trunnion.plot.scenes.page import views_page

CHROMIUM = shutil.which("chromium")
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    *("--use-gl=swiftshader", "--enable-unsafe-swiftshader"),
)

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=list(OPTIONS))
        yield found
        found.close()


def test_a_view_draws_and_its_slider_turns_the_machine(browser: Any, tmp_path: Path) -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    path = tmp_path / "view.html"
    figure = tn.plot.scene(tn.plan(setup), setup)
    path.write_text(views_page([("plan", figure)], "plan"), encoding="utf-8")
    page = browser.new_page(viewport={"width": 1000, "height": 800})
    errors: list[str] = []
    asked: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("#view0 .gl-container canvas")
    before = page.locator("#view0").screenshot()
    page.evaluate("Plotly.relayout('view0', {'scene.camera.eye': {x: 0, y: 0, z: 2.5}})")
    page.wait_for_timeout(500)
    assert page.locator("#view0").screenshot() != before
    assert errors == []
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:"))] == []
