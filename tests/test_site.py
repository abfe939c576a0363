"""The documentation site, built as `make site` builds it: complete, nothing loaded from outside."""

import html
import html.parser
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
import typer
import yaml  # type: ignore[import-untyped]

import trunnion as tn
from docs_snippets import ROOT
from trunnion.cli import app
from trunnion.models.kinds import kinds

pytest.importorskip("mkdocs")
pytest.importorskip("mkdocstrings")

LOADS = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}


class Page(html.parser.HTMLParser):
    """Anchors of a page, what it links to, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.text = path.read_text(encoding="utf-8")
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(self.text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.ids |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag in LOADS and LOADS[tag] in given and given.get("rel") != "canonical":
            self.loads.append(given[LOADS[tag]])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, Page]:
    """Every page of the site by its path; warnings of the build are errors."""
    target = tmp_path_factory.mktemp("site")
    options = ["--quiet", "--strict", "--site-dir", str(target)]
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", *options],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT / "python")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return {path.relative_to(target): Page(path) for path in target.rglob("*.html")}


def test_nothing_is_loaded_from_elsewhere(site: dict[Path, Page]) -> None:
    outside = [(str(path), url) for path, page in site.items() for url in page.loads if "//" in url]
    assert outside == []
    assert not any(re.search(r"@import|url\(['\"]?(?:https?:)?//", p.text) for p in site.values())


def test_links_lead_to_pages_and_anchors(site: dict[Path, Page]) -> None:
    broken = []
    for path, page in site.items():
        for link in page.links:
            to = urlsplit(link)
            if to.scheme or to.netloc or path.name == "404.html":
                continue
            inside = os.path.normpath(path.parent / unquote(to.path)) if to.path else path
            target, anchor = site.get(Path(inside)), unquote(to.fragment)
            is_page = Path(inside).suffix == ".html"
            if (is_page and target is None) or (target and anchor and anchor not in target.ids):
                broken.append(f"{path}: {link}")
    assert broken == []


ROOMS = ("compensation", "contouring", "datasets", "hybrid", "nc", "plot", "turning")


def test_every_public_name_has_its_place(site: dict[Path, Page]) -> None:
    api = [page for path, page in site.items() if path.parts[:2] == ("reference", "api")]
    ids = {each for page in api for each in page.ids}
    lacking = []
    for prefix in ("", *(f"{room}." for room in ROOMS)):
        room = importlib.import_module(f"trunnion.{prefix}".rstrip("."))
        for name in getattr(room, "__all__", dir(room)):
            if name.startswith("_"):
                continue
            places = {f"trunnion.{prefix}{name}", f"trunnion.{name}"}
            if callable(getattr(room, name)) and not places & ids:
                lacking.append(prefix + name)
    assert lacking == [], "add `::: trunnion.NAME` to a page of docs/reference/api"


def test_every_command_is_there_with_its_options(site: dict[Path, Page]) -> None:
    text = site[Path("reference/commands.html")].text

    def check(group: Any, path: str) -> None:
        for name, one in group.commands.items():
            assert f"{path} {name}</code>" in text
            if hasattr(one, "commands"):
                check(one, f"{path} {name}")
                continue
            for option in one.params:
                if option.name != "help":
                    assert option.opts[0] in text or html.escape(str(option.metavar)) in text

    check(typer.main.get_command(app), "trunnion")


def test_keys_of_the_set_up_are_those_that_a_set_up_prints(site: dict[Path, Page]) -> None:
    text = site[Path("reference/setup.html")].text
    axes = {"X": tn.AxisSetup(range_mm=(0.0, 1.0)), "A": tn.AxisSetup(point_mm=(0.0, 0.0, 1.0))}
    setups = (
        tn.Setup(tn.Artefact("cross"), axes=axes),
        tn.Setup(tn.Artefact("sphere", diameter_mm=20.0, centre_mm=(0.0, 0.0, 50.0))),
    )
    for setup in setups:
        for line in str(setup).splitlines():
            if found := re.match(r"  ([a-z]+(?:\.[A-Za-z_0-9]+)+) ", line):
                assert f"<code>{found[1].rpartition('.')[2]}</code>" in text, found[1]


def test_every_column_is_there(site: dict[Path, Page]) -> None:
    text = site[Path("reference/files.html")].text
    for kind in kinds():
        for column in resolve_name(kind.data).kinds:
            assert f"<code>{column}</code>" in text


def test_every_page_is_in_the_navigation() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    assert sorted(page for page in pages if f"- {page}\n" not in text) == []


def test_the_citation_file_says_what_the_package_is() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(cited)
    assert cited["version"] == tn.__version__
    assert all(
        set(author) <= {"name", "family-names", "given-names"} for author in cited["authors"]
    )
