"""``trunnion init``, ``samples``: from an empty folder to a first result."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypedDict

import typer

import trunnion as tn
from trunnion.base.output import check_folder
from trunnion.cli.command import Answer, check_outputs, command, save
from trunnion.cli.schema import Printed

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="folder, made if it is not there")]


class Copied(TypedDict):
    """What `samples` prints as JSON."""

    files: list[str]


class Started(Copied):
    """What `init` prints as JSON."""

    touches: int


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    own = "setup.toml and plan.csv are written into a folder, trunnion init DIR"
    command(app, values=Printed(keys=Started), writes=own)(init)
    own = "the samples are written into a folder, trunnion samples DIR"
    command(app, values=Printed(keys=Copied), writes=own)(samples)


def init(
    folder: Folder = Path(),
    preset: Annotated[
        str,
        typer.Option(help="trt-ca, trt-bc, table-c-head-b, tt-ab, head-bc, nutating-table, ..."),
    ] = "trt-ca",
    chain: Annotated[
        str,
        typer.Option(help="kinematic code instead of a preset, such as \\[w C' A' b X Y Z (C) t]"),
    ] = "",
    artefact: Annotated[str, typer.Option(help="cross, cuboid or sphere")] = "cross",
    length_mm: Annotated[
        float | None, typer.Option(help="of cross or cuboid along X; else 100")
    ] = None,
    width_mm: Annotated[
        float | None, typer.Option(help="of the bars of a cross; cuboid: along Y; else 25")
    ] = None,
    height_mm: Annotated[float | None, typer.Option(help="of cross or cuboid; else 25")] = None,
    diameter_mm: Annotated[float | None, typer.Option(help="of a sphere; else 25")] = None,
    ball_radius_mm: Annotated[float, typer.Option(help="of the probe")] = 1.0,
) -> Answer:
    """Write a commented set-up for a machine and an artefact, and the plan of its touches."""
    sizes = {"length_mm": length_mm, "width_mm": width_mm, "height_mm": height_mm}
    sizes["diameter_mm"] = diameter_mm
    body: dict[str, Any] = {name: size for name, size in sizes.items() if size is not None}
    if artefact == "sphere":
        body = {"diameter_mm": 25.0, "centre_mm": (60.0, 0.0, 80.0), **body}
    setup = tn.Setup(
        machine=tn.Machine(chain=chain) if chain else tn.Machine(preset=preset),
        artefact=tn.Artefact(artefact, **body),
        probe=tn.Probe(ball_radius_mm=ball_radius_mm),
    )
    plan = tn.plan(setup)
    files = (folder / "setup.toml", folder / "plan.csv")
    check_folder(folder)
    folder.mkdir(exist_ok=True)
    check_outputs(*files)
    text = setup.to_toml(comments=True)
    said = (
        save(files[0], lambda path: path.write_text(text, encoding="utf-8")),
        save(files[1], plan.to_csv),
    )
    next_steps = (
        f"Next: put the real dimensions into {files[0]}, then\n"
        f"  trunnion plan {files[0]} -o {files[1]} --force\n"
        f"  trunnion program {files[1]} {files[0]} -o probe.ngc"
        "   (LinuxCNC: docs/how-to/linuxcnc.md)\n"
        "  trunnion touches plan.csv touches.log setup.toml -o measured.csv\n"
        "  trunnion diagnose measured.csv setup.toml --html diagnosis.html"
    )
    return Answer({"files": [str(f) for f in files], "touches": len(plan)}, (*said, next_steps))


def samples(folder: Folder = Path("samples")) -> Answer:
    """Copy the sample files of every kind of data into a folder."""
    source = tn.sample_path("cross/setup.toml").parents[1]
    names = sorted(
        path.relative_to(source)
        for path in source.glob("*/*")
        if path.suffix in {".toml", ".csv", ".ngc"}
    )
    check_folder(folder)
    check_outputs(*(folder / name for name in names if (folder / name).parent.is_dir()))
    said = []
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        said.append(save(folder / name, _copy_of(source / name)))
    first = folder / "hidden"
    hint = f"Try: trunnion diagnose {first / 'touches.csv'} {first / 'setup.toml'}"
    return Answer({"files": [str(folder / name) for name in names]}, (*said, hint))


def _copy_of(path: Path) -> Callable[[Path], object]:
    return lambda draft: shutil.copyfile(path, draft)
