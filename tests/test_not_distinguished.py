"""A machine that is uniformly warm looks like another length of the instrument: both are named."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn

EITHER = (
    ", or a machine that is uniformly warm, which this measurement does not distinguish from it"
)
SETUP = tn.read_setup(tn.sample_path("cross/setup.toml"))


def warm_circle(seed: int, x_ppm: float = 30.0, y_ppm: float = 30.0) -> tn.Ballbar:
    """An exact bar of 100 mm on a machine whose axes are wrong by these shares."""
    rng = np.random.default_rng(seed)
    sense = np.repeat([1, -1], 72)
    angle = sense * np.tile(np.arange(72) * np.pi / 36, 2)
    x, y = 100.0 * np.cos(angle), 100.0 * np.sin(angle)
    length = np.hypot(x * (1 + 1e-6 * x_ppm), y * (1 + 1e-6 * y_ppm))
    return tn.Ballbar(
        setup=np.zeros(144, dtype=int),
        x_mm=x,
        y_mm=y,
        length_mm=length + rng.normal(0.0, 2e-4, 144),
        sense=sense,
        time_s=np.arange(144) * 1.5,
    )


def warm_touches(seed: int) -> tn.Touches:
    warm = {f"scale_{axis}": {"ppm": 30.0} for axis in "xyz"}
    return tn.simulate(tn.plan(SETUP), SETUP, effects=warm, noise_um=0.3, seed=seed)


def explained(found: Iterable[tn.Diagnosis]) -> tn.Diagnosis:
    """The first without a doubt: by chance another cause stays possible beside it."""
    return next(d for d in found if d.verdict == "explained")


CASES: dict[str, tuple[Callable[[], tn.Diagnosis], str]] = {
    "ball-bar": (lambda: explained(map(tn.diagnose, map(warm_circle, range(5)))), "ballbar_length"),
    "touches": (lambda: tn.diagnose(warm_touches(0), SETUP), "artefact_expansion"),
}


@pytest.mark.parametrize("kind", CASES)
def test_the_first_sentence_and_the_report_name_both(kind: str, tmp_path: Path) -> None:
    """They said "not the machine's: have it calibrated. The other results are free of it"."""
    make, id_ = CASES[kind]
    found = make()
    assert found.named == {id_}
    cause = found.causes[0]
    assert f"{cause.called()}{EITHER}:" in found.sentences()[0]
    page = re.sub(r"<[^>]+>", " ", found.to_html(tmp_path / "page.html").read_text("utf-8"))
    top = page[: page.index("What else is known")]
    assert f"{cause.label}{EITHER}" in top
    assert "how warm it and the machine were" in top
    assert "not the machine's" not in top.lower()
    assert "calibrated." not in top


def test_what_both_have_beside_it_is_the_machines(tmp_path: Path) -> None:
    found = tn.diagnose(warm_circle(1, 60.0, 30.0))
    page = found.to_html(tmp_path / "page.html").read_text("utf-8")
    assert "scale of the" in found.sentences()[0].lower() or len(found.evidence) > 1
    assert "belongs to the instrument, not to the machine" not in page


def test_it_comes_back_from_json_and_older_json_is_read() -> None:
    found = tn.diagnose(warm_circle(0))
    assert tn.Diagnosis.from_json(found.to_json()).sentences() == found.sentences()
    values = json.loads(found.to_json())
    del values["causes"][0]["instead"]
    assert tn.Diagnosis.from_json(json.dumps(values)).causes[0].instead == ""
