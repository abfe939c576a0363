"""Licences, advisories and withdrawn releases of every locked dependency: `make audit`.

Licences are read from what is installed here and from cargo's metadata, without a network, and held
against the lists of tools/audit.toml. Advisories come from RustSec (by cargo-deny) and from PyPI
(by pip-audit), releases that were withdrawn ("yanked") from crates.io and PyPI. A source that could
not be asked is named as not asked, never counted as good. What was found goes to dist/audit.json,
which the list of a release reads; anything found ends the command with 1.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tomllib
import venv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import bom

ROOT = Path(__file__).parent.parent
LOCK = ROOT / "requirements.lock"
OUT = ROOT / "dist" / "audit.json"
PLACE = ROOT / "target" / "audit"
CONFIG: dict[str, Any] = tomllib.loads((ROOT / "tools" / "audit.toml").read_text())
RUSTSEC = "https://github.com/rustsec/advisory-db"
KNOWN_TO_PYPI = "numpy"  # if PyPI does not know this one, it is not PyPI that answers
STAND_IN = """```toml
[advisory]
id = "RUSTSEC-2000-0001"
package = "no-such-crate"
date = "2000-01-01"
[versions]
patched = []
```

# In place of the database, without which cargo-deny says nothing of withdrawn releases
"""


@dataclass(frozen=True)
class Answer:
    """What one source says: found something, found nothing, or was not asked."""

    source: str
    found: tuple[str, ...] = ()
    not_asked: str = ""

    def lines(self) -> Iterator[str]:
        """Give the lines for people."""
        state = f"NOT ASKED: {self.not_asked}" if self.not_asked else "nothing found"
        yield f"{self.source}: {f'{len(self.found)} found' if self.found else state}"
        yield from (f"  {line}" for line in self.found)


class NotAskedError(Exception):
    """A source could not be asked; why."""


def run(
    words: Sequence[str | Path], environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command in the repository."""
    return subprocess.run(
        [*map(str, words)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **(environment or {})},
    )


def licences() -> Answer:
    """Hold the licence of every locked crate and package against the lists."""
    entries = [*bom.locked_crates(), *bom.locked_packages()]
    return Answer(f"licences of {len(entries)} dependencies", tuple(bom.refused(entries)))


def tools(place: Path, wanted: Sequence[str]) -> Path:
    """Return the folder of the tools' programs, after installing them if they are not there."""
    marker, programs = place / "installed.json", place / "env" / "bin"
    if not marker.exists() or json.loads(marker.read_text()) != wanted:
        venv.create(place / "env", clear=True, with_pip=True)
        done = run([programs / "python", "-m", "pip", "install", "--quiet", *wanted])
        if done.returncode:
            raise NotAskedError(f"{', '.join(wanted)} could not be installed")
        marker.write_text(json.dumps(wanted))
    return programs


def accepted(names: Sequence[str]) -> bool:
    """Whether one of an advisory's names is among those that do not matter here."""
    return any(name in CONFIG["advisories"] for name in names)


def deny(program: Path, database: Path | None, name: str) -> list[dict[str, Any]]:
    """Run cargo-deny with a clone of the database (None: from its own address)."""
    lines = [
        "[advisories]",
        f"db-path = {json.dumps(str(PLACE / name))}",
        f'db-urls = ["{RUSTSEC}"]',
        'yanked = "deny"',
    ]
    config = PLACE / f"{name}.toml"
    config.write_text("\n".join(lines) + "\n")
    instead: dict[str, str] = {}
    if database is not None:
        shutil.rmtree(PLACE / name, ignore_errors=True)
        instead = {
            "GIT_CONFIG_COUNT": "1",
            "GIT_CONFIG_KEY_0": f"url.{database.resolve().as_uri()}.insteadOf",
            "GIT_CONFIG_VALUE_0": RUSTSEC,
        }
    words: list[str | Path] = [program, "--format", "json", "--config", config]
    done = run([*words, "check", "--hide-inclusion-graph", "advisories"], instead)
    return [json.loads(line) for line in done.stderr.splitlines() if line.startswith("{")]


def denied(messages: Sequence[dict[str, Any]]) -> tuple[Answer, Answer]:
    """Return what messages of cargo-deny say of advisories and of withdrawn crates."""
    errors = [m["fields"]["message"] for m in messages if m["type"] == "log"]
    if not any(m["type"] == "summary" for m in messages):
        raise NotAskedError((errors or ["cargo-deny said nothing"])[0].partition(" with ")[0])
    advisories, yanked = [], []
    for fields in (m["fields"] for m in messages if m["type"] == "diagnostic"):
        crate = " ".join(fields["labels"][0]["span"].split()[:2]) if fields["labels"] else ""
        about = fields.get("advisory")
        if about is not None:
            if not accepted([about["id"], *about["aliases"]]):
                advisories.append(f"{crate}: {about['id']}, {about['title']}")
        elif fields["severity"] in ("error", "warning"):
            yanked.append(f"{crate}: {fields['message']}")
    return Answer("RustSec", tuple(advisories)), Answer("withdrawn crates", tuple(yanked))


def stand_in() -> Path:
    """Return a database that holds nothing of any crate."""
    place = PLACE / "no database"
    entry = place / "crates" / "no-such-crate" / "RUSTSEC-2000-0001.md"
    entry.parent.mkdir(parents=True, exist_ok=True)
    entry.write_text(STAND_IN)
    who = ["-c", "user.name=audit", "-c", "user.email=audit@localhost"]
    for words in (["init", "-q", "-b", "main"], ["add", "-A"], [*who, "commit", "-qm", "nothing"]):
        run(["git", "-C", place, *words])
    return place


def crates(programs: Path, database: Path | None) -> tuple[Answer, Answer]:
    """Ask RustSec and crates.io."""
    own = shutil.which("cargo-deny")
    program = Path(own) if own else programs / "cargo-deny"
    # Renews what cargo knows of the locked crates, withdrawn ones among them.
    online = run(["cargo", "update", "--dry-run", "--quiet"]).returncode == 0
    name = "withdrawn crates"
    try:
        advisories, yanked = denied(deny(program, database, "given" if database else "rustsec"))
    except NotAskedError as why:
        advisories = Answer("RustSec", not_asked=f"{why}; --rustsec takes a clone of {RUSTSEC}")
        try:
            _, yanked = denied(deny(program, stand_in(), "none"))
        except NotAskedError as also:
            return advisories, Answer(name, not_asked=str(also))
    return advisories, yanked if online else Answer(name, not_asked="crates.io is not reachable")


def packages(programs: Path) -> Answer:
    """Ask PyPI for advisories: first about one package that it must know."""
    lines = LOCK.read_text().splitlines()
    first = PLACE / "first.txt"
    first.write_text(next(line for line in lines if line.startswith(f"{KNOWN_TO_PYPI}==")))
    words: list[str | Path] = [programs / "pip-audit", "--no-deps", "--disable-pip", "-f", "json"]
    for asked in (first, LOCK):
        done = run([*words, "--requirement", asked])
        if not done.stdout.startswith("{"):
            said = done.stderr.strip().splitlines() or ["pip-audit said nothing"]
            return Answer("PyPI's advisories", not_asked=said[-1])
        answer = audited(json.loads(done.stdout))
        if answer.not_asked:
            break
    return answer


def audited(heard: Mapping[str, Any]) -> Answer:
    """Return what pip-audit says; a package that it skips is not one without advisories."""
    source, entries = "PyPI's advisories", heard["dependencies"]
    skipped = [each for each in entries if "skip_reason" in each]
    if len(skipped) == len(entries):
        return Answer(source, not_asked=skipped[0]["skip_reason"] if skipped else "no package")
    found = [
        f"{each['name']} {each['version']}: {one['id']}, expected {expected(one)}"
        for each in entries
        for one in each.get("vulns", ())
        if not accepted([one["id"], *one["aliases"]])
    ]
    return Answer(source, (*found, *(f"{e['name']}: {e['skip_reason']}" for e in skipped)))


def expected(advisory: Mapping[str, Any]) -> str:
    """Return the versions in which an advisory's fault is mended."""
    return " or ".join(advisory["fix_versions"]) or "another package: no version mends it"


def yanked_packages(programs: Path) -> Answer:
    """Ask pip, by an installation that changes nothing, which releases were withdrawn."""
    report = PLACE / "report.json"
    words = ["install", "--quiet", "--dry-run", "--ignore-installed", "--no-deps", "--report"]
    done = run([programs / "python", "-m", "pip", *words, report, "--requirement", LOCK])
    if done.returncode:
        return Answer("withdrawn packages", not_asked=done.stderr.strip().splitlines()[-1])
    return withdrawn(json.loads(report.read_text()))


def withdrawn(report: Mapping[str, Any]) -> Answer:
    """Return the releases that pip's report marks as withdrawn."""
    about = [each["metadata"] for each in report["install"] if each["is_yanked"]]
    return Answer("withdrawn packages", tuple(f"{a['name']} {a['version']}" for a in about))


def main() -> None:
    """Ask every source, say what they say, and keep it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--rustsec", type=Path, metavar="DIR", help=f"a clone of {RUSTSEC}, without a network"
    )
    database = parser.parse_args().rustsec
    PLACE.mkdir(parents=True, exist_ok=True)
    answers = [licences()]
    try:
        programs = tools(PLACE, CONFIG["tools"]["audit"])
        answers += [*crates(programs, database), packages(programs), yanked_packages(programs)]
    except NotAskedError as why:
        answers.append(Answer("advisories and withdrawn releases", not_asked=str(why)))
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps([asdict(each) for each in answers], indent=2) + "\n")
    print("\n".join(line for each in answers for line in each.lines()))
    sys.exit(any(each.found for each in answers))


if __name__ == "__main__":
    main()
