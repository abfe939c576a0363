"""What is handed out: extras, recipe, lock file, licences, release; wheels are `make wheels`."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import metadata
from pathlib import Path

import pytest
import yaml  # type: ignore[import-untyped]
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from typer.testing import CliRunner

import bom
import pythons
import release
from trunnion.cli import app

ROOT = Path(__file__).parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT, BUILD = PYPROJECT["project"], PYPROJECT["build-system"]
EXTRAS = PROJECT["optional-dependencies"]


def test_all_is_every_extra_that_runs() -> None:
    (whole,) = map(Requirement, EXTRAS["all"])
    assert whole.name == "trunnion"
    assert whole.extras == set(EXTRAS) - {"all", "dev", "docs"}


def test_the_lock_file_is_of_no_machine_and_has_what_is_needed() -> None:
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    pinned = [line for line in lines if line and not line.lstrip().startswith("#")]
    assert all(re.fullmatch(r"[a-z0-9.-]+==\S+", line) for line in pinned)
    names = {line.partition("==")[0] for line in pinned}
    for text in (*PROJECT["dependencies"], *(t for ts in EXTRAS.values() for t in ts)):
        need = Requirement(text)
        assert need.name == "trunnion" or need.name.lower().replace("_", "-") in names, text


def test_what_is_pinned_runs_on_the_lowest_python() -> None:
    """Debian 12, where LinuxCNC runs, has Python 3.11.2: two pins of 3.11.5 stopped `make demo`."""
    lowest = f"{PROJECT['requires-python'].removeprefix('>=')}.0"
    for line in (ROOT / "requirements.lock").read_text().splitlines():
        if "==" in line and not line.lstrip().startswith("#"):
            needs = str(metadata(line.partition("==")[0]).json.get("requires_python", ""))
            assert SpecifierSet(needs).contains(lowest), f"{line} wants Python {needs}"


def test_the_recipe_says_what_the_package_says() -> None:
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text())
    needs = {f"python {PROJECT['requires-python']}"}
    for need in map(Requirement, PROJECT["dependencies"]):
        name = "matplotlib-base" if need.name == "matplotlib" else need.name
        needs.add(f"{name} {need.specifier}")
    assert {line.replace("_", "-") for line in recipe["requirements"]["run"]} == needs
    assert recipe["context"]["version"] == release.version()
    scripts = [f"{name} = {target}" for name, target in PROJECT["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == scripts
    about, commands = recipe["about"], recipe["tests"][1]["script"]
    assert (about["license"], about["summary"]) == (PROJECT["license"], PROJECT["description"])
    assert set(about["license_file"]) == {*PROJECT["license-files"], "THIRDPARTY.yml"}
    lowest = PROJECT["requires-python"].removeprefix(">=")
    host = recipe["requirements"]["host"]
    assert {f"python {lowest}.*", f"python-abi3 {lowest}.*"} <= set(host)
    (build,) = (need.replace(">", " >", 1) for need in BUILD["requires"])
    assert build in host
    names = [command.split()[1:] for command in commands]
    assert [CliRunner().invoke(app, words).exit_code for words in names] == [0] * len(names)


@pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo is not on this machine")
def test_the_list_of_parts_is_cyclonedx_and_every_licence_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bom, "OUT", tmp_path / "sbom.json")
    monkeypatch.setattr(bom, "ROOT", ROOT)
    with pytest.raises(SystemExit) as ended:
        bom.main()
    assert not ended.value.code
    text = (tmp_path / "sbom.json").read_text()
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    purls = {entry["purl"].partition("@")[0] for entry in json.loads(text)["components"]}
    direct = (ROOT / "rust/py/Cargo.toml").read_text() + (ROOT / "rust/core/Cargo.toml").read_text()
    for name in ("pyo3", "numpy", "rayon", "nalgebra", "thiserror"):
        assert name in direct
        assert f"pkg:cargo/{name}" in purls
    for need in map(Requirement, PROJECT["dependencies"]):
        assert f"pkg:pypi/{need.name}" in purls


@pytest.mark.parametrize(
    ("expression", "good"),
    [
        ("MIT OR Apache-2.0", True),
        ("GPL-3.0-only OR MIT", True),
        ("MIT AND GPL-3.0-only", False),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("(MIT OR GPL-2.0) AND Zlib", True),
        ("GPL-3.0-only", False),
        ("", False),
        ("MIT MIT", False),
    ],
)
def test_a_licence_is_met_by_the_list_alone(expression: str, good: bool) -> None:
    assert bom.satisfied(expression, bom.ALLOWED) is good


def test_the_release_list_changes_nothing_unless_told() -> None:
    before = (ROOT / "CHANGELOG.md").read_text()
    done = subprocess.run(
        [sys.executable, str(ROOT / "tools" / "release.py")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "dry: nothing is changed" in done.stdout
    assert all(check.what in done.stdout for check in release.CHECKS)
    assert (ROOT / "CHANGELOG.md").read_text() == before


def test_a_release_is_not_made_of_what_is_not_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a repository of its own: refused with a list, then dated, committed and tagged."""

    def git(*words: str) -> str:
        who = ["-c", "user.name=a", "-c", "user.email=a@b"]
        done = subprocess.run(
            ["git", *who, *words], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return done.stdout

    monkeypatch.setattr(release, "ROOT", tmp_path)
    monkeypatch.setattr(release, "CHANGELOG", tmp_path / "CHANGELOG.md")
    monkeypatch.setattr(sys, "argv", ["release.py", "--do"])
    (tmp_path / "Cargo.toml").write_text('[workspace.package]\nversion = "1.2.3"\n')
    (tmp_path / "Cargo.lock").write_text('name = "trunnion-py"\nversion = "1.2.3"\n')
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## 1.2.3 (unreleased)\n")
    (tmp_path / "conda").mkdir()
    (tmp_path / "conda" / "recipe.yaml").write_text(
        f'context:\n  version: "1.2.3"\nsource:\n  sha256: "{"0" * 64}" # of the release\n'
    )
    (tmp_path / ".gitignore").write_text("dist\ntarget\n")
    git("init", "-q", "-b", "main")
    git("config", "user.name", "a")
    git("config", "user.email", "a@b")
    git("add", "-A")
    git("commit", "-qm", "x")
    with pytest.raises(SystemExit) as ended:
        release.main()
    assert ended.value.code == 1
    assert "dist/trunnion-1.2.3*.whl is not there" in capsys.readouterr().out
    assert git("tag").strip() == ""
    (tmp_path / "dist").mkdir()
    for name in ("trunnion-1.2.3-cp311-abi3-linux.whl", "trunnion-1.2.3.tar.gz", "sbom.json"):
        (tmp_path / "dist" / name).touch()
    (tmp_path / "dist" / "audit.json").write_text("[]")
    (tmp_path / "target" / "site").mkdir(parents=True)
    page = tmp_path / "target" / "site" / "index.html"
    page.touch()
    os.utime(page, (0, 0))
    with pytest.raises(SystemExit):
        release.main()
    assert "target/site/index.html is older than the last commit" in capsys.readouterr().out
    page.touch()
    release.main()
    digest = hashlib.sha256((tmp_path / "dist" / "trunnion-1.2.3.tar.gz").read_bytes()).hexdigest()
    assert f'sha256: "{digest}"' in (tmp_path / "conda" / "recipe.yaml").read_text()
    assert git("tag").strip() == "v1.2.3"
    assert re.search(r"## 1\.2\.3 \(\d{4}-\d\d-\d\d\)", (tmp_path / "CHANGELOG.md").read_text())
    assert git("status", "--porcelain") == ""


def test_a_step_is_quiet_unless_it_fails() -> None:
    def step(*words: str) -> subprocess.CompletedProcess[str]:
        line = ["sh", str(ROOT / "tools" / "step.sh"), "a thing", *words]
        return subprocess.run(line, capture_output=True, text=True, check=False)

    good = step("echo", "noise")
    assert (good.returncode, good.stderr) == (0, "")
    assert re.fullmatch(r"a thing \.\.\.\n  done in \d+ s\n", good.stdout)
    bad = step("sh", "-c", "echo why; exit 3")
    assert bad.returncode == 3
    assert "why" in bad.stderr


def test_a_python_that_is_not_there_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What `make wheels` prints as skipped; what only has the name is not taken."""
    monkeypatch.setattr(pythons, "FOLDER", tmp_path / "pythons")
    monkeypatch.setenv("HOME", str(tmp_path))
    fake = tmp_path / "bin" / "python3.99"
    fake.parent.mkdir()
    fake.write_text("#!/bin/sh\necho 3.98\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(fake.parent))
    with pytest.raises(pythons.MissingError, match=r"no python3\.99 on this machine, and no apt-"):
        pythons.python_of("3.99")
    fake.write_text("#!/bin/sh\necho 3.99\n")
    assert pythons.python_of("3.99") == fake
    fake.unlink()
    if shutil.which("apt-get", path=os.defpath) is None or not pythons.KEYS.exists():
        pytest.skip("needs apt-get and the keys of Debian's archive")
    monkeypatch.setenv("PATH", os.defpath)
    monkeypatch.setattr(pythons, "MIRROR", f"file:{tmp_path}")
    with pytest.raises(pythons.MissingError, match=r"Debian's packages cannot be asked for \("):
        pythons.python_of("3.99")
