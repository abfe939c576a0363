"""The picture of a report in the docs, by a browser: ``make docs``."""

import shutil
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

import trunnion as tn

FIGURE = Path(__file__).parent / "figures" / "report.png"
SIZE = {"width": 1280, "height": 1000}
QUIET = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]


def report(folder: Path) -> Path:
    """Diagnose the sample with two causes on a machine that has a name."""
    read = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    named = tn.ReportSetup(
        machine="Example machine", serial="4711", operator="M. Muster", date="2026-11-22"
    )
    setup = tn.Setup(artefact=read.artefact, machine=read.machine, probe=read.probe, report=named)
    d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    return d.to_html(folder / "report.html")


def main() -> None:
    """Write the top of the page as a picture."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise SystemExit("chromium is not installed: docs/figures/report.png stays as it is")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=QUIET)
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        page.goto(report(Path(folder)).as_uri())
        page.wait_for_selector("body[data-ready]")
        page.screenshot(path=str(FIGURE))
        browser.close()


if __name__ == "__main__":
    main()
