"""Reports in a real browser: no error, no network, hover, highlight, sorting, A4, accessibility."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from result_examples import EXAMPLES, cross

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe-core")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

A4_WIDTH = 688
"""Pixels between the margins of 14 mm."""
QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
KINDS = (
    *("diagnosis points", "diagnosis sweep", "diagnosis diameters", "diagnosis ballbar"),
    *("diagnosis positioning", "diagnosis levels", "diagnosis axislog", "diagnosis of several"),
    *("diagnosis with outliers", "ClosedFormResult", "BallbarIdentification", "Iso2302", "Iso2304"),
    *("Conformity", "Straightness", "Flatness", "MachineComparison", "CompensationForecast"),
    *("VolumetricError", "Observability"),
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        yield found
        found.close()


Opened = tuple[Any, list[str]]


@pytest.fixture
def opened(browser: Any, tmp_path: Path) -> Iterator[Callable[..., Opened]]:
    """Return what opens the report of a result, and what the page complained of or asked for."""
    context = browser.new_context(viewport={"width": 1000, "height": 800})

    def open_(result: Any, *, wait: bool = True, **more: Any) -> Opened:
        path = result.to_html(tmp_path / "report.html", **more)
        page, wrong = context.new_page(), []
        page.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)

        def asked(dialog: Any) -> None:
            wrong.append("a dialog")
            dialog.dismiss()

        page.on("dialog", asked)

        def only_the_page(route: Any) -> None:
            if route.request.url == path.as_uri():
                route.continue_()
            else:
                wrong.append(f"asked for {route.request.url}")
                route.abort()

        page.route("**/*", only_the_page)
        page.goto(path.as_uri(), wait_until="load" if wait else "commit")
        page.wait_for_selector("body[data-ready]" if wait else "#report-data", state="attached")
        return page, wrong

    yield open_
    context.close()


CLIPPED = """width => {
  const found = [];
  const box = (e) => e.getBoundingClientRect();
  const name = (e) => `${e.tagName} ${e.getAttribute("class")}: ${e.textContent.slice(0, 40)}`;
  for (const e of document.querySelectorAll("main *:not(svg *):not(.described)")) {
    const b = box(e);
    if (b.width && (b.right > width + 1 || b.left < -1)) found.push(`beyond the paper: ${name(e)}`);
    const style = getComputedStyle(e);
    if (style.overflowX !== "visible" && e.scrollWidth > e.clientWidth + 1)
      found.push(`clipped: ${name(e)}`);
  }
  for (const plot of document.querySelectorAll(".plot")) {
    const around = box(plot);
    for (const e of plot.querySelectorAll("svg.main-svg text, svg.still text")) {
      const b = box(e);
      const out = Math.max(b.right - around.right, around.left - b.left, b.bottom - around.bottom);
      if (b.width && out > 2)
        found.push(`text off its picture: ${name(e)}`);
    }
  }
  return found;
}"""


PLACES = """() => [...document.querySelectorAll("main *:not(.plot *)")].map((e) => {
  const b = e.getBoundingClientRect();
  return [b.left + scrollX, b.top + scrollY, b.width, b.height].map(Math.round);
}).filter((b) => b[3])"""


def point_at_stills(page: Any) -> None:
    """Have the reader point at every picture that waits for it."""
    while page.locator(".plot .still").count():
        page.locator(".plot:has(.still)").first.hover()
        page.wait_for_timeout(50)


@pytest.mark.parametrize("kind", KINDS)
def test_every_report_opens_prints_and_can_be_read_by_everybody(
    kind: str, opened: Callable[..., Opened]
) -> None:
    page, wrong = opened(EXAMPLES[kind]())
    drawn = page.locator(".plot").count()
    assert page.locator(".plot:has(.still), .plot[data-drawn]:has(.main-svg)").count() == drawn
    found = axe.Axe().run(page, options={"runOnly": ["wcag2a", "wcag2aa"]}).response
    severe = [v for v in found["violations"] if v["impact"] in ("serious", "critical")]
    assert not severe, [(v["id"], v["nodes"][0]["html"][:200]) for v in severe]
    page.emulate_media(media="print")
    page.set_viewport_size({"width": A4_WIDTH, "height": 971})
    page.wait_for_function("width => document.body.clientWidth <= width", arg=A4_WIDTH)
    page.wait_for_timeout(100)  # the pictures follow the width
    assert page.evaluate(CLIPPED, A4_WIDTH) == []
    places = page.evaluate(PLACES)
    point_at_stills(page)
    assert page.locator(".plot[data-drawn]:has(.main-svg)").count() == drawn
    assert page.evaluate(PLACES) == places
    assert page.evaluate(CLIPPED, A4_WIDTH) == []
    assert wrong == []


def two_causes() -> Any:
    setup = cross()[1]
    effects = {"drift_z": {"rate_um_h": 60.0}, "backlash_x": {"b_um": 4.0}}
    data = tn.simulate(tn.plan(setup), setup, {"EX0C": 15.0}, effects=effects, noise_um=0.2, seed=1)
    return tn.diagnose(data, setup)


def test_hover_highlight_and_zoom(opened: Callable[..., Opened]) -> None:
    d = two_causes()
    assert d.named == {"drift_z", "backlash_x"}
    page, wrong = opened(d)
    point_at_stills(page)
    shown = page.evaluate(
        """() => { const p = document.querySelectorAll(".plot")[0];
        const trace = p.data.findIndex((t) => t.text);
        Plotly.Fx.hover(p, [{ curveNumber: trace, pointNumber: 3 }]);
        return [p.querySelector(".hoverlayer").textContent, p.data[trace].customdata[3]]; }"""
    )
    row = shown[1]
    assert f"row {row}" in shown[0]
    assert f"c {np.asarray(d.data.c_deg)[row]:g} deg" in shown[0]
    button = page.get_by_role("button", name="highlight its readings: Drift of the Z axis")
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    picked = page.evaluate(
        """() => [...document.querySelectorAll(".plot")].map((p) =>
        p.data.filter((t) => t.customdata)
        .map((t) => t.selectedpoints.map((i) => t.customdata[i])))"""
    )
    assert d.residuals is not None
    change = np.abs(d.residuals.changes["drift_z"])
    mine = set(d.residuals.rows[change > 0.02 * change.max()].tolist())
    assert 0 < len(mine) < len(d.data)
    seen = [set(rows) for plot in picked for rows in plot]
    assert len(seen) > 3
    assert all(rows <= mine for rows in seen)
    assert any(rows == mine for rows in seen)
    button.click()
    assert (
        page.evaluate("() => document.querySelectorAll('.plot')[0].data[0].selectedpoints") is None
    )
    before = page.evaluate("() => document.querySelectorAll('.plot')[0].layout.xaxis.range")
    area = page.locator(".plot .nsewdrag").first.bounding_box()
    page.mouse.move(area["x"] + 100, area["y"] + 100)
    page.mouse.down()
    page.mouse.move(area["x"] + 250, area["y"] + 200, steps=4)
    page.mouse.up()
    after = page.evaluate("() => document.querySelectorAll('.plot')[0].layout.xaxis.range")
    assert after[1] - after[0] < 0.6 * (before[1] - before[0])
    assert wrong == []


def test_tables_sort_by_mouse_and_by_keyboard(opened: Callable[..., Opened]) -> None:
    page, _ = opened(EXAMPLES["IdentificationResult"]())
    table = page.locator("table").first
    head = table.get_by_role("columnheader", name="value")
    values = "cells => cells.map((c) => Number(c.dataset.value))"
    column = [text.strip() for text in table.locator("thead th").all_inner_texts()].index("value")
    cells = table.locator(f"tbody tr > :nth-child({column + 1})")
    plain = cells.evaluate_all(values)
    assert plain != sorted(plain)
    head.get_by_role("button").click()
    assert cells.evaluate_all(values) == sorted(plain)
    assert head.get_attribute("aria-sort") == "ascending"
    head.get_by_role("button").focus()
    page.keyboard.press("Enter")
    assert cells.evaluate_all(values) == sorted(plain, reverse=True)


HOSTILE = "\"><script>window.hacked = 1</script><img src=x onerror='window.hacked=2'> Ø 測"


def test_texts_from_files_stay_texts(opened: Callable[..., Opened], tmp_path: Path) -> None:
    setup = cross()[1]
    named = tn.ReportSetup(
        machine=HOSTILE, operator="O'Neil & <b>Söhne</b>", serial="${body} {{7*7}}"
    )
    setup = tn.Setup(artefact=setup.artefact, probe=setup.probe, report=named)
    name = tmp_path / "a <img src=x onerror=alert(1)> & 'b'.csv"
    EXAMPLES["data touches"]().to_csv(name)
    d = tn.diagnose(tn.read_touches(name), setup)
    page, wrong = opened(d, made_by="tn.diagnose('</pre><script>window.hacked = 3</script>')")
    assert page.evaluate("() => window.hacked === undefined")
    assert page.locator("main img, main script, main b").count() == 0
    point_at_stills(page)
    text = page.locator("main").inner_text()
    for told in (HOSTILE, "O'Neil & <b>Söhne</b>", "${body} {{7*7}}", name.name, "</pre><script>"):
        assert told in text
    page.evaluate(
        """() => { const p = document.querySelector(".plot");
        const t = p.data.findIndex((one) => one.text);
        if (t >= 0) Plotly.Fx.hover(p, [{ curveNumber: t, pointNumber: 0 }]); }"""
    )
    assert page.locator(".plot img").count() == 0
    assert page.evaluate("() => window.hacked === undefined")
    assert wrong == []


def test_the_page_follows_a_dark_screen_and_prints_on_white(opened: Callable[..., Opened]) -> None:
    page, wrong = opened(EXAMPLES["IdentificationResult"]())
    ground = "() => getComputedStyle(document.body).backgroundColor"
    tick = "() => getComputedStyle(document.querySelector('.plot text')).fill"
    frame = "() => getComputedStyle(document.querySelector('.still path[style*=soft]')).stroke"
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(ground) == "rgb(22, 24, 29)"
    assert page.evaluate(tick) == "rgb(232, 234, 237)"
    assert page.evaluate(frame) == "rgb(169, 177, 186)"
    found = axe.Axe().run(page, options={"runOnly": ["color-contrast"]}).response
    assert found["violations"] == []
    page.emulate_media(color_scheme="dark", media="print")
    assert page.evaluate(ground) == "rgb(255, 255, 255)"
    assert page.evaluate(tick) == "rgb(0, 0, 0)"
    point_at_stills(page)
    tick = "() => getComputedStyle(document.querySelector('.plot .ytick text')).fill"
    page.emulate_media(color_scheme="dark", media="screen")
    assert page.evaluate(tick) == "rgb(232, 234, 237)"
    page.emulate_media(color_scheme="dark", media="print")
    assert page.evaluate(tick) == "rgb(0, 0, 0)"
    assert wrong == []


def test_the_first_pictures_are_seen_before_any_script_and_print_without_it(
    browser: Any, tmp_path: Path
) -> None:
    path = two_causes().to_html(tmp_path / "report.html")
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(path.as_uri())
    stills = page.locator(".top .plot .still")
    assert stills.count() == page.locator(".top .plot").count() > 0
    assert stills.locator("text", has_text="Time (s)").count() == 1
    assert stills.first.locator("use").count() > 20
    box = stills.first.bounding_box()
    assert box["width"] > 300
    assert box["height"] > 300
    context.close()


def test_a_page_printed_at_once_holds_every_picture(opened: Callable[..., Opened]) -> None:
    """Print before the script had time: each picture is still or drawn by then."""
    page, wrong = opened(two_causes(), wait=False)
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.locator(".plot:not(:has(.still, .main-svg))").count() == 0
    assert wrong == []
