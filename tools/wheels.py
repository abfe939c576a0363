"""Build the wheel and the source distribution, and try both in fresh environments: `make wheels`.

The wheel is built with zig as linker, so that it runs on any Linux with glibc 2.17, and with
Python's stable interface, so that one serves every Python from 3.11. It is installed into fresh
virtual environments with the lowest and the newest numpy that are allowed, by every Python from
3.11 to 3.14, and does the main job there. A Python that is not on this machine is Debian's
(tools/pythons.py); what cannot be had is skipped, with the reason. Nothing of this needs the
repository's own environment but maturin and zig.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path

from pythons import MissingError, python_of

ROOT = Path(__file__).parent.parent
DIST = ROOT / "dist"
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
MANYLINUX = "manylinux2014"  # glibc 2.17
MAX_IMPORT_S = 0.5
NEWER = 6  # minor versions of numpy that are tried above the lowest

TRY = """
import time
begin = time.process_time()
import trunnion as tn
seconds = time.process_time() - begin
import numpy
setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
fit = tn.identify(touches, setup)
assert abs(fit.errors["EX0C"] - 15.0) < 1.0, fit.errors
assert tn.diagnose(touches, setup).verdict == "consistent"
print(f"numpy {numpy.__version__}, import {seconds:.2f} s of CPU")
assert seconds < float(%r), "the import takes too long"
"""


def run(words: Sequence[str | Path], **how: object) -> str:
    """Run a command and return what it prints; say all of it if it fails."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    # Where maturin finds zig: the package ziglang of the environment that runs this.
    env["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{env.get('PATH', '')}"
    done = subprocess.run(  # type: ignore[call-overload]
        [*map(str, words)], capture_output=True, text=True, env=env, check=False, **how
    )
    if done.returncode:
        print(done.stdout + done.stderr, file=sys.stderr)
        raise SystemExit(f"failed: {' '.join(map(str, words))}")
    return str(done.stdout)


def step(what: str) -> None:
    """Say what is done."""
    print(f"{time.strftime('%H:%M:%S')} {what}", flush=True)


def built(kind: str) -> Path:
    """Return the newest file of `dist` with this ending."""
    found = sorted(DIST.glob(f"trunnion-*{kind}"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise SystemExit(f"dist: no file that ends in {kind}")
    return found[-1]


def lowest_numpy(python: Path, folder: Path) -> str:
    """Return the lowest numpy that pyproject.toml allows and that has a wheel for this Python."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (needed,) = [need for need in project["dependencies"] if need.startswith("numpy")]
    major, minor = map(int, needed.removeprefix("numpy>=").split("."))
    run([python, "-m", "venv", folder])  # Debian's has no pip outside of environments
    pip = [str(folder / "bin" / "python"), "-m", "pip"]
    wheel = [*pip, "download", "--quiet", "--no-deps", "--only-binary", ":all:"]
    for higher in range(minor, minor + NEWER):
        numpy = f"numpy=={major}.{higher}.*"
        words = [*wheel, "--dest", str(folder), numpy]
        if subprocess.run(words, capture_output=True, check=False).returncode == 0:
            return numpy
    raise SystemExit(f"{needed}: no wheel of the next {NEWER} for {python}")


def build() -> tuple[Path, Path]:
    """Build both."""
    maturin = [sys.executable, "-m", "maturin"]
    step(f"wheel, {MANYLINUX} by zig, every Python from {PYTHONS[0]} (abi3)")
    run(
        [*maturin, "build", "--release", "--zig", "--compatibility", MANYLINUX, "--out", DIST],
        cwd=ROOT,
    )
    step("source distribution")
    run([*maturin, "sdist", "--out", DIST], cwd=ROOT)
    return built(".whl"), built(".tar.gz")


def tried(python: Path, what: Path, numpy: str, folder: Path) -> str:
    """Install into a fresh environment, do the main job in it, and return what that says."""
    run([python, "-m", "venv", folder])
    inside = folder / "bin" / "python"
    run([inside, "-m", "pip", "install", "--quiet", "--prefer-binary", what, numpy], cwd=folder)
    run([inside, "-m", "trunnion", "--version"], cwd=folder)
    run([folder / "bin" / "trunnion", "demo", "--quiet"], cwd=folder)
    run([inside, "-c", "import trunnion"], cwd=folder)  # modules are compiled now
    return run([inside, "-c", TRY % MAX_IMPORT_S], cwd=folder).strip()


def main() -> None:
    """Build, then try."""
    wheel, source = build()
    for file in (wheel, source):
        print(f"  {file.relative_to(ROOT)}, {file.stat().st_size / 1e6:.1f} MB")
    if "abi3" not in wheel.name or "manylinux" not in wheel.name:
        raise SystemExit(f"{wheel.name}: expected a manylinux wheel of the stable interface")
    with tempfile.TemporaryDirectory(prefix="trunnion wheels ") as temporary:  # a path with spaces
        for version in PYTHONS:
            try:
                python = python_of(version)
            except MissingError as error:
                print(f"  skipped: {error}")
                continue
            lowest = lowest_numpy(python, Path(temporary) / f"{version} pip")
            for name, numpy in (("lowest", lowest), ("newest", "numpy")):
                step(f"Python {version}, {name} numpy")
                folder = Path(temporary) / f"{version} {name}"
                print(f"  {tried(python, wheel, numpy, folder)}", flush=True)
        step("source distribution, built anew (needs Rust)")
        print(f"  {tried(Path(sys.executable), source, 'numpy', Path(temporary) / 'source')}")
    step("done")


if __name__ == "__main__":
    main()
