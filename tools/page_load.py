"""How long a report takes to open in a browser: ``python tools/page_load.py``.

A diagnosis of 504 touches is written as a page and opened several times, each in a browser profile
of its own. Printed are medians of the times that the browser counts from the start of the load: to
the first text, to the frame that shows the two pictures at the top, until they answer the pointer,
and until all others are drawn, while the page is used; and of the processor time of the page's
thread until then, which other work on the machine does not lengthen.
"""

import os
import shutil
import statistics
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, sync_playwright

import trunnion as tn

COUNT, TIMES = 504, 9
QUIET = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
WATCH = """
window.at = {};
let seen = false;
const shown = (name) => requestAnimationFrame(() => setTimeout(() => {
  window.at[name] = performance.now();
}, 0));
new MutationObserver((_, observer) => {
  const top = [...document.querySelectorAll(".plot")].slice(0, 2);
  if (!seen && top.length == 2 && top.every((p) => p.querySelector("svg > *"))) {
    seen = true;
    shown("pictures");
  }
  if (window.Plotly && !window.at.live) window.at.live = performance.now();
  if (document.body && document.body.hasAttribute("data-ready")) {
    window.at.all = performance.now();
    const paint = performance.getEntriesByName("first-contentful-paint")[0];
    window.at.text = paint ? paint.startTime : 0;
    observer.disconnect();
  }
}).observe(document, {attributes: true, childList: true, subtree: true});
"""
STEPS = {
    "text": "first text",
    "pictures": "the first two pictures",
    "live": "they answer the pointer",
    "all": "all other pictures, drawn one by one while the page is used",
    "work": "processor time of the page until then",
}


def report(folder: Path) -> Path:
    """Diagnose touches with two causes."""
    setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    plan = tn.plan(setup, c_deg=tuple(range(0, 360, 10)))
    effects = {
        "drift_z": {"rate_um_h": 20.0},
        "c_positioning_2": {"a2_arcsec": 2.0, "b2_arcsec": 4.0},
    }
    made = tn.simulate(plan, setup, {"EX0C": 15.0}, effects=effects, noise_um=0.3, seed=1)
    touches = made[np.arange(len(made)) < COUNT]
    if len(touches) < COUNT:
        raise SystemExit(f"got {len(touches)} touches, expected {COUNT}")
    return tn.diagnose(touches, setup).to_html(folder / "report.html")


def opened(browser: Browser, page: Path) -> dict[str, float]:
    """Open a page once; return ms from the start of the load to each step."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    tab = context.new_page()
    tab.add_init_script(WATCH)
    session = context.new_cdp_session(tab)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    tab.goto(page.as_uri())
    tab.wait_for_function("window.at.all !== undefined")
    found: dict[str, float] = tab.evaluate("window.at")
    measured = session.send("Performance.getMetrics")["metrics"]
    metrics = {one["name"]: one["value"] for one in measured}
    found["work"] = 1e3 * metrics["TaskDuration"]
    context.close()
    return found


def main() -> None:
    """Print the medians and what they were measured on."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise SystemExit("chromium is not installed: nothing was measured")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page = report(Path(folder))
        browser = playwright.chromium.launch(executable_path=chromium, args=QUIET)
        found = [opened(browser, page) for _ in range(TIMES)]
        size, load = page.stat().st_size / 1e6, os.getloadavg()[0]
        print(f"{size:.1f} MB, {TIMES} times; {os.cpu_count()} cores, load {load:.1f}")
        for key, name in STEPS.items():
            times = [one[key] for one in found]
            span = f"{min(times):.0f} to {max(times):.0f}"
            print(f"{name}: median {statistics.median(times):.0f} ms ({span})")
        browser.close()


if __name__ == "__main__":
    main()
