"""The built-in studies say what theory says."""

from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app
from trunnion.probing.model import TouchModel
from trunnion.studies import Seeds


def test_equation_21_gives_the_papers_case() -> None:
    # 0.1 um over sin 0.36": 1e-4 mm / 1.745329e-6.
    assert tn.smallest_length_mm(0.1, 0.36) == pytest.approx(57.2958, abs=1e-4)
    assert tn.smallest_length_mm(0.1, 0.36) < 100.0
    with pytest.raises(tn.InputError, match="linear_um: got 0"):
        tn.smallest_length_mm(0.0, 0.36)


def test_estimates_scatter_as_the_bound_says_at_every_length() -> None:
    lengths = [60.0, 100.0, 200.0]
    found = tn.sweep(
        "calibration",
        {"length_mm": lengths},
        samples=3000,
        seed=11,
        fixed={"noise_um": 0.3, "tick_um": 0.0},
        progress=False,
    )
    assert found["converged"].min() == 1.0
    for length in lengths:
        setup = tn.Setup(artefact=tn.Artefact("cross", length_mm=length))
        bound = tn.observability(tn.plan(setup), setup, noise_um=0.3).std_errors
        at = found.sel(length_mm=length)
        for name in at["parameter"].values:
            spread = at["identified_error"].sel(parameter=name).std().item()
            assert spread == pytest.approx(bound[name], rel=0.06), (length, name)
            mean = at["identified_error"].sel(parameter=name).mean().item()
            assert abs(mean) < 4.5 * bound[name] / np.sqrt(3000), (length, name)
            stated = np.sqrt((at["identified_std_error"].sel(parameter=name) ** 2).mean().item())
            assert stated == pytest.approx(bound[name], rel=0.06), (length, name)


def test_compensation_leaves_less_with_less_noise() -> None:
    found = tn.sweep(
        "compensation",
        {"noise_um": [0.05, 0.5]},
        samples=30,
        seed=3,
        fixed={"tick_um": 0.0},
        progress=False,
    )
    assert found["before_max_um"].min() > 5
    quiet, loud = (found["left_rms_um"].sel(noise_um=noise).mean().item() for noise in (0.05, 0.5))
    # What is left is linear in the noise.
    assert loud / quiet == pytest.approx(10.0, rel=0.5)
    assert loud < 0.1 * found["before_rms_um"].mean().item()


@pytest.mark.parametrize("method", ["identified", "separating", "printed"])
def test_compensation_is_that_of_single_calls(method: str) -> None:
    from trunnion.studies.calibration import CALIBRATION_PARAMETERS, bench_of

    fixed = {"noise_um": 0.3, "tick_um": 0.1}
    pose: dict[str, Any] = {"a_deg": 35.0, "c_deg": -120.0}
    n, seed = 6, 8
    found = tn.sweep(
        "compensation",
        samples=n,
        seed=seed,
        fixed={**fixed, **pose, "method": method},
        progress=False,
    )
    calibrated = tn.sweep("calibration", samples=n, seed=seed, fixed=fixed, progress=False)
    missed = calibrated[f"{method}_error"].values
    defaults = {name: p.default for name, p in CALIBRATION_PARAMETERS.items()}
    bench = bench_of({**defaults, **fixed})  # type: ignore[dict-item]
    truths = bench.truths(Seeds(seed, 0), 0, n)
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    names = bench.model.error_names
    for sample in range(n):
        true = dict(zip(names, truths[sample], strict=False))
        assumed = dict(zip(names, truths[sample, :8] + missed[sample, :8], strict=True))
        control = tn.ModelCompensation.of(setup, assumed)
        before = tn.volumetric_error(setup, true, **pose)
        left = tn.volumetric_error(setup, true, **pose, compensation=control)
        for name, expected in (
            ("before_max_um", before.max_um),
            ("before_rms_um", before.rms_um),
            ("left_max_um", left.max_um),
            ("left_rms_um", left.rms_um),
        ):
            assert found[name].values[sample] == pytest.approx(expected, abs=1e-9), (name, sample)


def test_compensation_is_the_same_in_any_pieces_and_threads() -> None:
    def run(**how: Any) -> xr.Dataset:
        grid = {"noise_um": [0.1, 0.5], "length_mm": [80.0, 40.0]}
        return tn.sweep(
            "compensation", grid, samples=7, seed=5, progress=False, most_failures=1.0, **how
        )

    whole = run(threads=1)
    for how in ({"chunk": 1}, {"chunk": 3, "threads": 2}, {"chunk": 100}):
        assert whole.identical(run(**how)), how
    # At 40 mm the sides of the arms are out of the probe's reach.
    assert np.isnan(whole["left_max_um"].sel(length_mm=40.0)).all()
    assert np.isfinite(whole["left_max_um"].sel(length_mm=80.0)).all()
    assert whole.attrs["samples_failed"] == 14


EFFECTS = ["none", "drift_z", "probe_bending", "a_sag"]
COUNTS = ("found", "among_alternatives", "missed", "wrong")


def by_hand(effect: str, rms_um: float, rng: np.random.Generator) -> str:
    """One diagnosis of a hidden effect, and which of the four it is."""
    setup = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(tick_um=0.1))
    plan = tn.plan(setup)
    exact = tn.Setup(artefact=tn.Artefact("cross"))
    truth = {"errors": 60.0, "placement": 100.0}

    def readings(**there: Any) -> Any:
        touched = tn.simulate(plan, exact, **there)
        return np.einsum("ij,ij->i", touched.position_mm, touched.direction) * 1e3

    nothing = readings()
    model = TouchModel(setup)
    hidden: dict[str, dict[str, float]] = {}
    if effect != "none":
        (entry,) = (entry for entry in tn.catalogue(setup) if entry.id == effect)
        drawn = {parameter.name: rng.normal() for parameter in entry.parameters}
        columns = [readings(errors={name: 1.0}) - nothing for name in model.error_names]
        columns += [readings(placement={name: 1.0}) - nothing for name in model.names[8:]]
        design = np.stack(columns, axis=1)
        change = readings(effects={effect: drawn}) - nothing
        left = change - design @ np.linalg.lstsq(design, change, rcond=None)[0]
        size = rms_um / np.sqrt(np.mean(left**2))
        hidden = {effect: {name: size * value for name, value in drawn.items()}}
    errors = {name: rng.uniform(-1, 1) * truth["errors"] for name in model.error_names}
    placement = {name: rng.uniform(-1, 1) * truth["placement"] for name in model.names[8:]}
    seed = int(rng.integers(2**62))
    data = tn.simulate(plan, setup, errors, placement, hidden, noise_um=0.1, seed=seed)
    found = tn.diagnose(data, setup)
    named = {cause.id for cause in found.causes}
    if named == set(hidden) and found.verdict in ("consistent", "explained", "ambiguous"):
        return "found"
    if frozenset(hidden) in found.alternatives:
        return "among_alternatives"
    return "missed" if found.verdict == "consistent" else "wrong"


def test_power_counts_what_single_diagnoses_say() -> None:
    sizes = [0.03, 0.5]
    samples, seed = 2, 5
    how: dict[str, Any] = {
        "grid": {"effect": EFFECTS, "rms_um": sizes},
        "samples": samples,
        "seed": seed,
        "fixed": {"plan": "paper", "noise_um": 0.1},
        "progress": False,
    }
    with ThreadPoolExecutor(1) as here:
        found = tn.sweep("diagnosis-power", executor=here, **how)
    seen = set()
    for node, (effect, size) in enumerate(product(EFFECTS, sizes)):
        at = found.sel(effect=effect, rms_um=size)
        for sample in range(samples):
            expected = by_hand(effect, size, Seeds(seed, node).generator(sample))
            got = {name: at[name].values[sample] for name in COUNTS}
            assert got == {name: float(name == expected) for name in COUNTS}, (
                effect,
                size,
                sample,
            )
            seen.add(expected)
    assert seen >= {"found", "among_alternatives", "missed"}


def test_power_is_the_same_in_worker_processes() -> None:
    how: dict[str, Any] = {
        "grid": {"effect": ["none", "drift_z"]},
        "samples": 2,
        "seed": 1,
        "fixed": {"plan": "paper", "rms_um": 2.0, "noise_um": 0.1},
        "progress": False,
    }
    there = tn.sweep("diagnosis-power", chunk=2, **how)
    with ThreadPoolExecutor(1) as here:
        assert there.identical(tn.sweep("diagnosis-power", executor=here, chunk=1, **how))
    np.testing.assert_array_equal(sum(there[name] for name in COUNTS), 1.0)


def test_command_line(tmp_path: object) -> None:
    from pathlib import Path

    folder = Path(str(tmp_path))
    study = folder / "study.toml"
    study.write_text(
        'study = "calibration"\nsamples = 3\nseed = 1\n'
        "[grid]\nnoise_um = [0.1, 0.3]\n[fixed]\nidentify = false\n"
    )
    result = CliRunner().invoke(app, ["sweep", str(study)])
    assert result.exit_code == 0, result.output
    found = tn.open_sweep(folder / "study.nc")
    assert found["separating_error"].shape == (2, 3, 14)
    study.write_text('study = "calibration"\nsample = 3\n')
    result = CliRunner().invoke(app, ["sweep", str(study)])
    assert result.exit_code == 2
    assert "got key 'sample'" in result.output
