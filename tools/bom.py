"""What a wheel is made of, and under which licences: `make sbom`, without a network.

Two lists become one file, dist/sbom.json (CycloneDX 1.6): the Rust crates that the extension module
is compiled from (cargo metadata, which reads Cargo.lock), and the Python packages that
`pip install trunnion[all]` brings, as they are installed here. A licence that is not on the list
below ends the command with 1.
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

ALLOWED = frozenset(
    """0BSD Apache-2.0 BSD-2-Clause BSD-3-Clause BSL-1.0 CC0-1.0 HPND ISC LLVM-exception MIT MIT-0
    MIT-CMU MPL-2.0 PSF-2.0 Python-2.0 Qhull Unicode-3.0 Unlicense Zlib""".split()  # noqa: SIM905
)
"""Licences that set no condition on programs that use the package. MPL-2.0: on its own files."""
KNOWN = {
    # What the packages' own files of licences say, where their metadata say nothing that a program
    # can read. LGPL libraries are separate packages, loaded at run time and free to be replaced.
    "cmeel-qhull": "Qhull",
    "casadi": "LGPL-3.0-or-later",
    "pin": "BSD-2-Clause",
}
REPLACEABLE = frozenset(["LGPL-3.0-or-later", "LGPL-3.0", "LGPL-2.1-or-later", "LGPL-2.1"])
"""Only of packages of an extra, which a user may leave out or exchange."""
WORDS = {
    "apache software license": "Apache-2.0",
    "apache license 2.0": "Apache-2.0",
    "apache 2.0": "Apache-2.0",
    "apache-2": "Apache-2.0",
    "apache license, version 2.0": "Apache-2.0",
    "bsd license": "BSD-3-Clause",
    "bsd": "BSD-3-Clause",
    "new bsd": "BSD-3-Clause",
    "3-clause bsd license": "BSD-3-Clause",
    "bsd 3-clause": "BSD-3-Clause",
    "bsd-3-clause license": "BSD-3-Clause",
    "isc license (iscl)": "ISC",
    "isc license": "ISC",
    "mit license": "MIT",
    "mozilla public license 2.0 (mpl 2.0)": "MPL-2.0",
    "python software foundation license": "PSF-2.0",
    "psfl": "PSF-2.0",
    "the unlicense (unlicense)": "Unlicense",
    "historical permission notice and disclaimer (hpnd)": "HPND",
}


def crates() -> Iterator[dict[str, Any]]:
    """Give the crates that end up in the extension module: no tests, no build scripts."""
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--offline"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    graph = json.loads(found.stdout)
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
        name, version = package["name"], package["version"]
        yield component("cargo", name, version, package["license"] or "")


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
    if name in KNOWN:
        return KNOWN[name]
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
    names = [WORDS.get(text.lower(), text) for text in classified or [short] if len(text) < 80]
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
