"""Where the measured files of others are: not part of the project."""

from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / ".." / "shared" / "measured"

needs_files = pytest.mark.skipif(
    not FOLDER.is_dir(), reason="the measured files of others are not part of the project"
)
