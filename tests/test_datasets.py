"""Measured sets by name: from a folder, shipped, or from their address by checksum."""

import hashlib
from pathlib import Path

import pytest

import trunnion as tn
from measured import FOLDER, needs_files
from trunnion.files.table import Table


def test_every_set_says_what_it_is() -> None:
    for name in tn.datasets.names():
        said = tn.datasets.about(name)
        assert len(said.commit) == 40
        assert said.licence in ("CC0", "CC BY 4.0") or "not stated" in said.licence
        assert said.source in said.summary()
    with pytest.raises(tn.UnknownNameError, match="did you mean resolver"):
        tn.datasets.about("resolvr")


@needs_files
@pytest.mark.parametrize("name", tn.datasets.names())
def test_every_set_loads(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    data = tn.datasets.load(name, FOLDER)
    assert isinstance(data, Table)
    assert len(data) >= 20
    monkeypatch.setenv("TRUNNION_DATA", str(FOLDER))
    assert tn.datasets.load(name) == data


@needs_files
def test_checksums_are_those_of_the_files() -> None:
    for name in tn.datasets.names():
        for file, (_, digest) in tn.datasets.about(name).public.items():
            assert hashlib.sha256((FOLDER / file).read_bytes()).hexdigest() == digest


def test_open_ones_are_shipped_and_others_say_where_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TRUNNION_DATA", raising=False)
    for name in ("mill", "servos"):
        public = tn.datasets.about(name).public
        shipped = Path(tn.datasets.__file__).parent / "files"
        ((file, (_, digest)),) = public.items()
        assert hashlib.sha256((shipped / Path(file).name).read_bytes()).hexdigest() == digest
        assert isinstance(tn.datasets.load(name), tn.AxisLog)
    with pytest.raises(tn.InputError, match="published in another form only"):
        tn.datasets.load("emps", tmp_path)


def test_downloads_are_held_to_their_checksum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, str]] = []

    def retrieve(url: str, known_hash: str, **_: object) -> str:
        asked.append((url, known_hash))
        raise ConnectionError

    monkeypatch.setattr("pooch.retrieve", retrieve)
    with pytest.raises(ConnectionError):
        tn.datasets.load("ur5", tmp_path, download=True)
    ((url, known),) = asked
    assert url.startswith("https://raw.githubusercontent.com/FinnLinxxx/akig/bc0fd21b")
    assert known.startswith("sha256:13030e14")
