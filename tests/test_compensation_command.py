"""``trunnion compensate`` writes what it says, and the plots draw what they are given."""

import hashlib
import html
import json
import re
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from reference_trt_ca import TABLE_2, table_pose
from trunnion.cli import app
from trunnion.compensation import CncParameters, compensation_forecast
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
    for word in ("nothing compensated", "error map", "CNC parameters", "Work space: X −150"):
        assert word in printed
    table = tn.read_error_map(folder / "o" / "error_map.csv")
    assert list(table.rotary_deg) == ["A", "C"]
    found = json.loads((folder / "o" / "volumetric.json").read_text(encoding="utf-8"))
    left = {one["name"]: one for one in found["left"]}
    assert left["linear axes, exact"]["max_um"] < 1e-9
    low, high = left["linear axes, exact"]["max_interval_um"]
    assert 0 < low < high
    parameters = json.loads((folder / "o" / "parameters.json").read_text(encoding="utf-8"))
    assert parameters["zeros_arcsec"]["A"] == pytest.approx(-fit.errors["EA0A"], abs=0.1)
    assert (folder / "o" / "compensation.png").stat().st_size > 10_000
    assert plt.get_fignums() == before


def of_table(
    where: tuple[float, float], moved: CncParameters | None, points: np.ndarray
) -> np.ndarray:
    """Errors (n, 3), µm, in the frame of the table, of the machine of Table 2, without the core.

    moved: what is added to the control's values.
    """
    zeros = {"A": 0.0, "C": 0.0} if moved is None else moved.zeros_arcsec
    sent = (where[0] + zeros["A"] / 3600.0, where[1] + zeros["C"] / 3600.0)
    assumed = table_pose({} if moved is None else moved.centres_um, *where)
    ends = np.column_stack([points, np.ones(len(points))]).T
    apart = (table_pose(TABLE_2, *sent) - assumed) @ ends
    return np.asarray(1e3 * (table_pose({}, *where)[:3, :3].T @ apart[:3]).T)


def test_before_and_after_are_of_one_solid_box_and_one_range() -> None:
    """The same figures in the sentence, in the table and by integration without the core."""
    found = compensation_forecast(SETUP, TABLE_2)
    gauss = np.array([-1, 1]) / np.sqrt(3)  # two nodes integrate a square of what is affine
    nodes, corners = (
        np.stack(np.meshgrid(150 * n, 120 * n, 75 + 75 * n), axis=-1).reshape(-1, 3)
        for n in (gauss, np.array([-1.0, 1.0]))
    )
    poses = [(float(a), float(c)) for a in range(-90, 91, 10) for c in range(0, 361, 20)]
    for name, moved in (("nothing compensated", None), ("CNC parameters", found.parameters)):
        left = found.by_name(name)
        assert left is not None
        square = [np.sum(of_table(p, moved, nodes) ** 2, axis=1).mean() for p in poses]
        largest = [np.linalg.norm(of_table(p, moved, corners), axis=1).max() for p in poses]
        assert left.rms_um == pytest.approx(np.sqrt(np.mean(square)), rel=1e-6), name
        assert left.max_um == pytest.approx(max(largest), rel=1e-6), name
        assert f"{left.rms_um:.3g} " in found.sentences()[0]
        assert f"{left.max_um:.3g} " in found.sentences()[0]
        assert f"{left.rms_um:.3f}" in found.tables()[0].text()
    assert found.parameters.before_um == pytest.approx(found.left[0].rms_um, rel=1e-9)
    assert "A −90 to 90, C 0 to 360 °" in found.sentences()[1]


def test_two_touches_show_the_sign_that_a_control_takes() -> None:
    found = compensation_forecast(SETUP, TABLE_2)
    test = found.sign_test
    assert test is not None
    turned = CncParameters(
        {k: -v for k, v in found.parameters.zeros_arcsec.items()},
        {k: -v for k, v in found.parameters.centres_um.items()},
    )
    ways = (None, found.parameters, turned)
    for way, said in zip(ways, (test.before_um, test.after_um, test.opposite_um), strict=True):
        first, second = (
            of_table((at["A"], at["C"]), way, np.array([test.place_mm])) for at in test.postures
        )
        # the frame of the real table and of the nominal one: 100 arcsec of 100 µm are 0.05 µm
        assert said == pytest.approx(float(np.linalg.norm(second - first)), abs=0.05)
    assert test.after_um < 0.5 * test.before_um < test.before_um < test.opposite_um


def test_the_report_says_what_was_measured_what_to_set_and_what_to_do(folder: Path) -> None:
    data = tn.simulate(tn.plan(SETUP), SETUP, TABLE_2, noise_um=0.3, seed=2)
    fit = tn.identify(data, SETUP)
    coarse = ("--linear-step-mm", "150", "--rotary-step-deg", "30")
    page = folder / "r.html"
    printed = run(folder, fit.to_dict(), *coarse, "--html", str(page))
    text = page.read_text(encoding="utf-8")
    main = re.sub("</?span[^>]*>", "", text[text.index("<main>") : text.index("</main>")])
    body = html.unescape(re.sub("<[^>]*>", " ", main))
    sentence = printed.partition("Work space")[0].replace("\n", " ").strip()
    assert re.sub(r"\s+", " ", sentence) in re.sub(r"\s+", " ", body)
    order = ["What is changed", "What to do", "Errors measured", "What can be reached"]
    places = [body.index(one) for one in order]
    assert places == sorted(places)
    for name, value in fit.errors.items():
        size = 2 * fit.std_errors[name]
        digits = max(0, 1 - int(np.floor(np.log10(size))))
        assert f"{value:.{digits}f}".replace("-", "−") in body[places[2] : places[3]], name
    for said in ("Note the old values", "Test the signs", "trunnion verify", "tool direction"):
        assert said in body
    for name in ("error_map.csv", "parameters.json"):
        digest = hashlib.sha256((folder / "o" / name).read_bytes()).hexdigest()
        assert digest in body


def test_names_and_values_alone_are_enough(folder: Path) -> None:
    printed = run(folder, {"EX0C": 15.0}, "--linear-step-mm", "200", "--rotary-step-deg", "90")
    assert "15.000" in printed
    assert "95 %" not in printed


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
