"""What a wheel is made of, and under which licences: `make sbom`, without a network.

Two lists become one file, dist/sbom.json (CycloneDX 1.6): the Rust crates that the extension module
is compiled from (cargo metadata, which reads Cargo.lock), and the Python packages that
`pip install trunnion[all]` brings, as they are installed here. A licence that is not on the list
of tools/audit.toml ends the command with 1.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name as canonical

ROOT = Path(__file__).parent.parent
OUT = ROOT / "dist" / "sbom.json"

LISTS: dict[str, Any] = tomllib.loads((ROOT / "tools" / "audit.toml").read_text())["licences"]
ALLOWED = frozenset(LISTS["allowed"])
REPLACEABLE = frozenset(LISTS["replaceable"])


def cargo_metadata() -> Any:
    """Return what cargo knows of Cargo.lock."""
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--offline"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(found.stdout)


def locked_crates() -> Iterator[dict[str, Any]]:
    """Give every crate of Cargo.lock, those of tests, of building and of other systems as well."""
    for package in cargo_metadata()["packages"]:
        yield crate(package)


def locked_packages() -> Iterator[dict[str, Any]]:
    """Give every package of requirements.lock, with what its installed metadata say."""
    for line in (ROOT / "requirements.lock").read_text().splitlines():
        name, is_pinned, version = line.partition("#")[0].strip().partition("==")
        if not is_pinned:
            continue
        try:
            distribution = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            yield component("pypi", name, version, "")
        else:
            # Of another version nothing is known of the one that is locked.
            same = distribution.version == version
            yield component("pypi", name, version, licence_of(name, distribution) if same else "")


def crates() -> Iterator[dict[str, Any]]:
    """Give the crates that end up in the extension module: no tests, no build scripts."""
    graph = cargo_metadata()
    packages = {package["id"]: package for package in graph["packages"]}
    nodes = {node["id"]: node for node in graph["resolve"]["nodes"]}
    left = [i for i in nodes if packages[i]["name"] == "trunnion-py"]
    seen = set(left)
    while left:
        node = nodes[left.pop()]
        for need in node["deps"]:
            normal = any(kind["kind"] is None for kind in need["dep_kinds"])
            if normal and need["pkg"] not in seen:
                seen.add(need["pkg"])
                left.append(need["pkg"])
    for package in sorted((packages[i] for i in seen), key=lambda p: str(p["name"])):
        yield crate(package)


def crate(package: dict[str, Any]) -> dict[str, Any]:
    """Return the entry of a package of cargo's metadata."""
    return component("cargo", package["name"], package["version"], package["license"] or "")


def packages() -> Iterator[dict[str, Any]]:
    """Give the Python packages of `trunnion[all]` that are installed here."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    (every,) = (Requirement(text).extras for text in extras["all"])
    needs = [*project["dependencies"], *(text for name in every for text in extras[name])]
    left = [(str(canonical(n.name)), frozenset(n.extras)) for n in map(Requirement, needs)]
    seen: set[tuple[str, frozenset[str]]] = set()
    found: dict[str, metadata.Distribution] = {}
    while left:
        name, asked = left.pop()
        if (name, asked) in seen:
            continue
        seen.add((name, asked))
        try:
            found[name] = distribution = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            print(f"  not installed here, and not in the list: {name}")
            continue
        for text in distribution.requires or ():
            need = Requirement(text)
            marker = need.marker
            if marker is None or any(marker.evaluate({"extra": e}) for e in (asked or {""})):
                left.append((str(canonical(need.name)), frozenset(need.extras)))
    for name in sorted(found):
        yield component("pypi", name, found[name].version, licence_of(name, found[name]))


def licence_of(name: str, distribution: metadata.Distribution) -> str:
    """Return the licence of a package as SPDX expression; "" if its metadata do not say."""
    if name in LISTS["known"]:
        return str(LISTS["known"][name])
    about: Any = distribution.metadata
    classified = [
        line.rpartition(" :: ")[2]
        for line in about.get_all("Classifier") or ()
        if line.startswith("License :: ") and not line.endswith("OSI Approved")
    ]
    said = about.get("License-Expression") or ""
    if said:
        return str(said)
    short = str(about.get("License") or "").strip()
    names = [
        LISTS["words"].get(text.lower(), text) for text in classified or [short] if len(text) < 80
    ]
    return " AND ".join(name for name in names if name)


def component(kind: str, name: str, version: str, licence: str) -> dict[str, Any]:
    """Return one entry of the list."""
    expression = re.sub(r"\s*/\s*", " OR ", licence)
    return {
        "type": "library",
        "name": name,
        "version": version,
        "purl": f"pkg:{kind}/{name}@{version}",
        "bom-ref": f"{kind}:{name}",
        **({"licenses": [{"expression": expression}]} if expression else {}),
    }


def refused(entries: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Give a line for each entry whose licence is not on the list, or not known."""
    for entry in entries:
        expression = entry["licenses"][0]["expression"] if "licenses" in entry else ""
        allowed = ALLOWED | (REPLACEABLE if entry["purl"].startswith("pkg:pypi/") else frozenset())
        if not satisfied(expression, allowed):
            yield f"{entry['purl']}: got the licence {expression!r}, expected one of the list"


def satisfied(expression: str, allowed: frozenset[str]) -> bool:
    """Whether a SPDX expression can be met by licences of the list alone."""
    words = re.findall(r"\(|\)|[^\s()]+", expression)
    python = {"OR": "or", "AND": "and", "WITH": "and", "(": "(", ")": ")"}
    try:
        return bool(words) and bool(
            eval(" ".join(python.get(w, str(w in allowed)) for w in words), {"__builtins__": {}})
        )
    except SyntaxError:
        return False


def main() -> None:
    """Write the list, and check the licences."""
    entries = [*crates(), *packages()]
    own = next(e for e in entries if e["name"] == "trunnion-py")
    made: dict[str, Any] = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {**own, "name": "trunnion", "bom-ref": "trunnion"}},
        "components": [e for e in entries if not e["name"].startswith("trunnion")],
    }
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps(made, indent=2) + "\n", encoding="utf-8")
    wrong = [*refused(made["components"])]
    rust = sum(e["purl"].startswith("pkg:cargo") for e in made["components"])
    python = len(made["components"]) - rust
    print(f"wrote {OUT}: {rust} crates, {python} Python packages")
    print("\n".join(wrong) or "licences: all on the list")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
