"""Walk through a release: what is done, what is left, in order. It changes nothing without --do.

`make release` checks; `python tools/release.py --do` dates the changelog, writes the digest of the
source distribution into the conda recipe, commits and tags if every check before it holds.
Uploading is left to a person, with the command to type.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
CHANGELOG = ROOT / "CHANGELOG.md"
SOURCE = "dist/trunnion-{}.tar.gz"
DIGEST = "the conda recipe has the digest of the source distribution"


def git(*words: str) -> str:
    """Run git in the repository and return what it prints."""
    return subprocess.run(
        ["git", *words], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()


def version() -> str:
    """Return the version in Cargo.toml, where the package takes it from."""
    found = re.search(r'^version = "([^"]+)"', (ROOT / "Cargo.toml").read_text(), re.MULTILINE)
    if found is None:
        raise SystemExit("Cargo.toml: no version")
    return found[1]


def head() -> tuple[str, str]:
    """Return version and date of the section at the top of the changelog."""
    found = re.search(r"^## (\S+) \(([^)]+)\)", CHANGELOG.read_text(), re.MULTILINE)
    return (found[1], found[2]) if found else ("", "")


@dataclass(frozen=True)
class Check:
    """One line of the list: what should hold, what is wrong (or ""), how it is put right."""

    what: str
    wrong: Callable[[], str]
    how: str = ""


def _version() -> str:
    locked = (ROOT / "Cargo.lock").read_text()
    own = re.search(r'name = "trunnion-py"\nversion = "([^"]+)"', locked)
    return "" if own and own[1] == version() else f"Cargo.lock has {own[1] if own else 'none'}"


def _changelog() -> str:
    there, _ = head()
    return "" if there == version() else f"the section at the top is of {there or 'nothing'}"


def _dated() -> str:
    _, date = head()
    return "" if re.fullmatch(r"\d{4}-\d\d-\d\d", date) else f"it says ({date})"


def _clean() -> str:
    changed = git("status", "--porcelain")
    return f"{len(changed.splitlines())} files are changed and not committed" if changed else ""


def _branch() -> str:
    name = git("branch", "--show-current")
    return "" if name == "main" else f"this is {name or 'no branch'}"


def _tag() -> str:
    return f"v{version()} is there already" if git("tag", "--list", f"v{version()}") else ""


def _made(*patterns: str) -> str:
    """Whether each of the files is there, and newer than the last commit."""
    last = int(git("log", "-1", "--format=%ct"))
    for pattern in patterns:
        found = [*ROOT.glob(pattern)]
        if not found:
            return f"{pattern} is not there"
        if max(path.stat().st_mtime for path in found) < last:
            return f"{found[0].relative_to(ROOT)} is older than the last commit"
    return ""


def _files() -> str:
    return _made(f"dist/trunnion-{version()}*.whl", SOURCE.format(version()))


def _bom() -> str:
    return _made("dist/sbom.json")


def _audit() -> str:
    kept = ROOT / "dist" / "audit.json"
    return _made("dist/audit.json") or audit_left(json.loads(kept.read_text()))


def audit_left(answers: list[dict[str, Any]]) -> str:
    """Return what tools/audit.py found and whom it could not ask, or ""."""
    found = [f"{len(a['found'])} found by {a['source']}" for a in answers if a["found"]]
    silent = [a["source"] for a in answers if a["not_asked"]]
    return "; ".join([*found, *([f"not asked: {', '.join(silent)}"] if silent else [])])


def _site() -> str:
    return _made("target/site/index.html")


def recipe() -> Path:
    """Return the conda recipe."""
    return ROOT / "conda" / "recipe.yaml"


def _recipe() -> str:
    found = re.search(r'^  version: "([^"]+)"', recipe().read_text(), re.MULTILINE)
    return "" if found and found[1] == version() else f"it has {found[1] if found else 'none'}"


def with_digest() -> str:
    """Return the recipe with the digest of the source distribution, which does not hold it."""
    digest = hashlib.sha256((ROOT / SOURCE.format(version())).read_bytes()).hexdigest()
    return re.sub(r'(?<=sha256: ")[0-9a-f]{64}(?=")', digest, recipe().read_text())


def _digest() -> str:
    if not (ROOT / SOURCE.format(version())).exists():
        return "there is no source distribution"
    return "" if with_digest() == recipe().read_text() else "it has another"


CHECKS = (
    Check("the branch is main", _branch, "git switch main"),
    Check("nothing is changed", _clean, "git commit"),
    Check("one version in Cargo.toml and Cargo.lock", _version, "cargo update --workspace"),
    Check("the changelog begins with this version", _changelog, "write it"),
    Check("wheel and source distribution, tried in fresh environments", _files, "make wheels"),
    Check("list of what it is made of, licences checked", _bom, "make sbom"),
    Check("licences, advisories and withdrawn releases of all dependencies", _audit, "make audit"),
    Check("documentation builds without a warning", _site, "make site"),
    Check("no tag of this version yet", _tag, "raise the version in Cargo.toml"),
    Check("the conda recipe has this version", _recipe, "write it"),
    Check(DIGEST, _digest, "tools/release.py --do sets it"),
    Check("the changelog has the date", _dated, "tools/release.py --do sets it"),
)
BY_DO = ("the changelog has the date", DIGEST)
"""What --do does itself."""


def main() -> None:
    """Print the list; with --do and nothing wrong, date, commit and tag."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--do", action="store_true", help="date, commit and tag if nothing is wrong"
    )
    do = parser.parse_args().do
    print(f"Release {version()}{'' if do else ' (dry: nothing is changed)'}")
    left = []
    for check in CHECKS:
        wrong = check.wrong()
        print(
            f"  [{' ' if wrong else 'x'}] {check.what}{f': {wrong}; {check.how}' if wrong else ''}"
        )
        if wrong and check.what not in BY_DO:
            left.append(check.what)
    print("  [ ] by hand: make lint; make test; the tutorials by fresh eyes")
    if left:
        print(f"{len(left)} to do.")
        sys.exit(1 if do else 0)
    commands = f"git push --follow-tags; twine upload dist/trunnion-{version()}*"
    if not do:
        print(f"Ready: python tools/release.py --do, then {commands}")
        return
    text, today = CHANGELOG.read_text(), datetime.datetime.now(tz=datetime.UTC).date()
    CHANGELOG.write_text(
        text.replace(f"## {version()} ({head()[1]})", f"## {version()} ({today})", 1)
    )
    recipe().write_text(with_digest())
    if git("status", "--porcelain"):
        git("commit", "--all", "--message", f"Version {version()}")
    git("tag", "--annotate", f"v{version()}", "--message", f"Version {version()}")
    print(f"Tagged v{version()}. Then: {commands}")


if __name__ == "__main__":
    main()
