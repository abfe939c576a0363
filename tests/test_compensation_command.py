"""``trunnion compensate`` writes what it says, and the plots draw what they are given."""

import hashlib
import json
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from reference_trt_ca import TABLE_2
from trunnion.cli import app
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import read_estimate
from trunnion.machine.linear_axes import LinearMotion, Travel
from trunnion.plot.volumetric import plot_over_poses, plot_share, plot_volumetric

mpl.use("Agg")
SETUP = tn.Setup(artefact=tn.Artefact("cross"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "setup.toml").write_text('[artefact]\nkind = "cross"\n', encoding="utf-8")
    return tmp_path


def run(folder: Path, estimate: object, *more: str) -> str:
    (folder / "errors.json").write_text(json.dumps(estimate), encoding="utf-8")
    arguments = [
        "compensate",
        str(folder / "errors.json"),
        str(folder / "setup.toml"),
        "--output",
        str(folder / "o"),
    ]
    result = CliRunner(env={"COLUMNS": "120"}).invoke(
        app, [*arguments, *more], catch_exceptions=False
    )
    assert result.exit_code == 0, result.output
    return result.output


def test_the_command_writes_what_it_found(folder: Path) -> None:
    before = plt.get_fignums()
    data = tn.simulate(tn.plan(SETUP), SETUP, TABLE_2, noise_um=0.3, seed=2)
    fit = tn.identify(data, SETUP)
    printed = run(folder, fit.to_dict(), "--linear-step-mm", "150", "--rotary-step-deg", "30")
    for word in ("nothing compensated", "error map", "CNC parameters", "Volumetric error left"):
        assert word in printed
    table = tn.read_error_map(folder / "o" / "error_map.csv")
    assert list(table.rotary_deg) == ["A", "C"]
    found = json.loads((folder / "o" / "volumetric.json").read_text(encoding="utf-8"))
    expected = tn.volumetric_error(SETUP, fit).max_um
    assert found["at_zero"]["nothing compensated"]["max_um"] == pytest.approx(expected, rel=1e-12)
    assert found["at_zero"]["linear axes, exact"]["max_um"] < 1e-9
    low, high = found["predicted_interval_over_range"]["max_um"]
    assert 0 < low < high
    parameters = json.loads((folder / "o" / "parameters.json").read_text(encoding="utf-8"))
    assert parameters["zeros_arcsec"]["A"] == pytest.approx(-fit.errors["EA0A"], abs=0.1)
    assert (folder / "o" / "compensation.png").stat().st_size > 10_000
    assert plt.get_fignums() == before


def test_names_and_values_alone_are_enough(folder: Path) -> None:
    printed = run(folder, {"EX0C": 15.0}, "--linear-step-mm", "200", "--rotary-step-deg", "90")
    assert "15.000" in printed
    assert "Volumetric error left" not in printed


def test_the_command_says_what_is_wrong_in_one_line(folder: Path) -> None:
    (folder / "errors.json").write_text('{"EX0A": 1}', encoding="utf-8")
    paths = [str(folder / name) for name in ("setup.toml", "errors.json")]
    result = CliRunner().invoke(app, ["compensate", *paths])
    assert result.exit_code == 2
    assert "EX0A" in result.output
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", ":1:2: got text (Expecting property name"),
        ("[1]", "got list, expected a table of errors"),
        ('{"EX0C": "15"}', "errors.EX0C: got '15', expected a finite number"),
        ('{"errors": [1]}', "errors: got [1], expected names with numbers"),
        ('{"errors": {}, "effects": 3}', "effects: got 3"),
    ],
)
def test_a_bad_estimate_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "errors.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(tn.FileFormatError) as error:
        read_estimate(path)
    assert str(path) in str(error.value)
    assert message in str(error.value)


def test_plots_share_a_scale() -> None:
    before = tn.volumetric_error(SETUP, TABLE_2, points=(7, 5, 4))
    after = tn.volumetric_error(
        SETUP, TABLE_2, points=(7, 5, 4), compensation=tn.cnc_parameters(SETUP, TABLE_2)
    )
    for plane in ("xy", "xz", "yz"):
        for field in (before, after):
            ax = plot_volumetric(field, plane=plane, scale_um=before.max_um)
            mesh = ax.collections[0]
            assert mesh.get_clim() == (0.0, before.max_um)
            plt.close("all")
    low_high = plot_volumetric(after, scale_um=(0.01, 60.0)).collections[0].get_clim()
    assert low_high == (0.01, 60.0)
    poses = tn.volumetric_error(SETUP, TABLE_2, a_deg=(-90, 0, 90), c_deg=(0, 180, 360))
    values = plot_over_poses(poses).collections[0].get_array()
    assert values is not None
    np.testing.assert_allclose(np.ravel(values), poses.max_by_pose_um.ravel())
    ax = plot_share({"before": before, "after": after})
    assert len(ax.get_lines()) == 2
    plt.close("all")
    with pytest.raises(tn.InputError, match="plane: got 'zz'"):
        plot_volumetric(before, plane="zz")
    with pytest.raises(tn.InputError, match="expected two"):
        plot_over_poses(before)
    with pytest.raises(tn.InputError, match="scale_um: got"):
        plot_volumetric(before, scale_um=(1.0, 0.5))


@pytest.mark.parametrize("preset", ["three-axis", "four-axis-a", "four-axis-c", "tt-ab", "head-bc"])
def test_every_machine_gets_a_map_and_parameters(preset: str, folder: Path) -> None:
    (folder / "setup.toml").write_text(
        f'[machine]\npreset = "{preset}"\n[artefact]\nkind = "none"\n', encoding="utf-8"
    )
    given = {"errors": {}, "effects": {"scale_x": {"ppm": 40.0}}}
    coarse = ("--linear-step-mm", "150", "--rotary-step-deg", "90")
    run(folder, given, *coarse)
    table = tn.read_error_map(folder / "o" / "error_map.csv")
    setup = tn.read_setup(folder / "setup.toml")
    rotary = dict.fromkeys(Chain(setup).letters, 0.0)
    # 40 ppm too long: X is sent 4 µm less at 100 mm.
    found = table.correction_um([[100.0, 20.0, 50.0]], rotary)
    np.testing.assert_allclose(found, [[-4.0, 0.0, 0.0]], atol=0.11)


def test_what_moves_with_the_linear_axes_is_in_the_map(folder: Path) -> None:
    """A diagnosis of points as it is printed: an error map of three axes holds all of it."""
    (folder / "setup.toml").write_text(
        '[machine]\npreset = "three-axis"\n[artefact]\nkind = "none"\n', encoding="utf-8"
    )
    travel = Travel((0.0, 0.0), (150.0, 120.0))
    bent = tn.Estimate(
        errors={},
        effects={"straightness_y_of_x": {"a2_um": 10.0, "a3_um": 0.0}},
        motions={"straightness_y_of_x": LinearMotion("straightness_y_of_x", travel)},
    )
    run(folder, bent.to_dict(), "--linear-step-mm", "10")
    table = tn.read_error_map(folder / "o" / "error_map.csv")
    found = table.correction_um([[x, 0.0, 0.0] for x in (0.0, 75.0, 150.0)], {})
    np.testing.assert_allclose(found[:, 1], [5.0, 1.25, -10.0], atol=0.15)


def test_the_record_lists_the_estimate_with_its_checksum(folder: Path) -> None:
    data = tn.simulate(tn.plan(SETUP), SETUP, TABLE_2, noise_um=0.3, seed=2)
    estimate = tn.identify(data, SETUP).to_dict()
    run(folder, estimate, "--linear-step-mm", "200", "--html", str(folder / "page.html"))
    page = (folder / "page.html").read_text(encoding="utf-8")
    for name in ("errors.json", "setup.toml"):
        digest = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        assert f"{digest}  {folder / name}" in page
