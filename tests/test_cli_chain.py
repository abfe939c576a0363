"""Commands take what other commands write."""

from pathlib import Path

from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app


def test_estimate_feeds_compensate(tmp_path: Path) -> None:
    setup = str(tn.sample_path("cross/setup.toml"))
    touches = str(tn.sample_path("cross/touches.csv"))
    estimate = tmp_path / "estimate.json"
    said = CliRunner().invoke(app, ["estimate", touches, setup, "--json"])
    assert said.exit_code == 0
    estimate.write_text(said.output)
    done = CliRunner().invoke(
        app, ["compensate", str(estimate), setup, "--output", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    assert (tmp_path / "out" / "error_map.csv").exists()
