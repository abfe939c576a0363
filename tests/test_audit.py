"""`make audit`: what the sources say is decided on rightly, and silence is not taken for good."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

import audit
import bom
import release

# As cargo-deny 0.20 said it of a crate with a known fault and of one that was withdrawn.
ADVISORY = {
    "type": "diagnostic",
    "fields": {
        "advisory": {
            "id": "RUSTSEC-2021-0003",
            "aliases": ["CVE-2021-25900"],
            "title": "Buffer overflow in SmallVec::insert_many",
        },
        "code": "vulnerability",
        "labels": [{"span": "smallvec 1.6.0 registry+https://github.com/rust-lang/x"}],
        "message": "Buffer overflow",
        "severity": "error",
    },
}
YANKED = {
    "type": "diagnostic",
    "fields": {
        "code": "yanked",
        "labels": [{"span": "crossbeam-channel 0.5.14 registry+https://github.com/rust-lang/x"}],
        "message": "detected yanked crate (try `cargo update -p crossbeam-channel`)",
        "severity": "error",
    },
}
SUMMARY: dict[str, Any] = {"type": "summary", "fields": {}}
NO_NETWORK = {
    "type": "log",
    "fields": {"message": "failed to fetch advisory database X with cli: ...\nmore"},
}
FAULT = {
    "id": "PYSEC-2024-1",
    "aliases": ["CVE-2024-1"],
    "fix_versions": ["3.1.3"],
    "description": "",
}


def test_what_cargo_deny_finds_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    advisories, yanked = audit.denied([ADVISORY, YANKED, SUMMARY])
    assert advisories.found == (
        "smallvec 1.6.0: RUSTSEC-2021-0003, Buffer overflow in SmallVec::insert_many",
    )
    (line,) = yanked.found
    assert line.startswith("crossbeam-channel 0.5.14: detected yanked crate")
    monkeypatch.setitem(audit.CONFIG["advisories"], "CVE-2021-25900", "never called")
    advisories, yanked = audit.denied([ADVISORY, YANKED, SUMMARY])
    assert (advisories.found, len(yanked.found)) == ((), 1)


def test_a_database_that_was_not_read_is_not_taken_for_good() -> None:
    with pytest.raises(audit.NotAskedError, match=r"^failed to fetch advisory database X$"):
        audit.denied([NO_NETWORK])
    with pytest.raises(audit.NotAskedError, match="said nothing"):
        audit.denied([])


def test_what_pip_audit_finds_is_named_and_what_it_skips_is_not_good() -> None:
    good = {"name": "numpy", "version": "2.4.6", "vulns": []}
    bad = {"name": "jinja2", "version": "3.1.2", "vulns": [FAULT, {**FAULT, "fix_versions": []}]}
    skipped = {"name": "rich", "skip_reason": "not found on PyPI"}
    assert audit.audited({"dependencies": [good]}) == audit.Answer("PyPI's advisories")
    assert audit.audited({"dependencies": [good, bad, skipped]}).found == (
        "jinja2 3.1.2: PYSEC-2024-1, expected 3.1.3",
        "jinja2 3.1.2: PYSEC-2024-1, expected another package: no version mends it",
        "rich: not found on PyPI",
    )
    assert audit.audited({"dependencies": [skipped]}).not_asked == "not found on PyPI"
    assert audit.audited({"dependencies": []}).not_asked


def test_what_pip_marks_as_withdrawn_is_named() -> None:
    def one(name: str, yanked: bool) -> dict[str, Any]:
        return {"is_yanked": yanked, "metadata": {"name": name, "version": "1.0"}}

    found = audit.withdrawn({"install": [one("attrs", True), one("numpy", False)]})
    assert found.found == ("attrs 1.0",)


def test_every_locked_dependency_is_held_against_the_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    assert audit.licences().found == ()
    listed = {each["purl"] for each in (*bom.locked_crates(), *bom.locked_packages())}
    for name, begin in (("Cargo.lock", "name = "), ("requirements.lock", "")):
        kind = "cargo" if name == "Cargo.lock" else "pypi"
        lines = (bom.ROOT / name).read_text().splitlines()
        pinned = [line for line in lines if (line.startswith(begin) if begin else "==" in line)]
        assert sum(purl.startswith(f"pkg:{kind}/") for purl in listed) == len(pinned)
    monkeypatch.setattr(bom, "ALLOWED", bom.ALLOWED - {"MPL-2.0"})
    refused = "\n".join(audit.licences().found)
    assert "pkg:pypi/certifi" in refused
    assert "got the licence 'MPL-2.0', expected one of the list" in refused


def test_a_package_of_another_version_or_not_installed_is_not_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "requirements.lock").write_text("numpy==0.1\nno-such-package==1.0\n# a==1\n")
    monkeypatch.setattr(bom, "ROOT", tmp_path)
    assert len([*bom.refused(bom.locked_packages())]) == 2


def test_what_was_not_asked_is_kept_and_left_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without a network nothing but the licences is known; the list of a release says so."""

    def no_tools(*_: Any) -> Path:
        raise audit.NotAskedError("pip-audit could not be installed")

    monkeypatch.setattr(audit, "PLACE", tmp_path / "target")
    monkeypatch.setattr(audit, "OUT", tmp_path / "dist" / "audit.json")
    monkeypatch.setattr(audit, "licences", lambda: audit.Answer("licences"))
    monkeypatch.setattr(audit, "tools", no_tools)
    monkeypatch.setattr(sys, "argv", ["audit.py"])
    with pytest.raises(SystemExit) as ended:
        audit.main()
    assert not ended.value.code
    assert capsys.readouterr().out == (
        "licences: nothing found\n"
        "advisories and withdrawn releases: NOT ASKED: pip-audit could not be installed\n"
    )
    kept = json.loads(audit.OUT.read_text())
    assert release.audit_left(kept) == "not asked: advisories and withdrawn releases"
    kept[0]["found"] = ["a", "b"]
    assert release.audit_left(kept) == (
        "2 found by licences; not asked: advisories and withdrawn releases"
    )
    monkeypatch.setattr(audit, "licences", lambda: audit.Answer("licences", ("GPL",)))
    with pytest.raises(SystemExit) as ended:
        audit.main()
    assert ended.value.code == 1
