"""``python -m trunnion``."""

from trunnion.cli import app

app(prog_name="trunnion")
