"""A package that brings effects by entry points, as one that is installed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def install(site: Path, name: str, entry_points: Mapping[str, str], code: str) -> None:
    """Write a package of one module; ``entry_points``: each name, and what of the module it is."""
    info = site / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    of_pip = name.replace("_", "-")
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {of_pip}\nVersion: 1.0\n")
    rows = "".join(f"{entry} = {name}:{thing}\n" for entry, thing in entry_points.items())
    (info / "entry_points.txt").write_text(f"[trunnion.effects]\n{rows}")
    (site / f"{name}.py").write_text(code)
