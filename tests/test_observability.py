"""What a plan can tell, against the figures worked out independently."""

import json
import tracemalloc

import numpy as np
import pytest

import trunnion as tn
from trunnion.plot.touches import plot_observability

CROSS = tn.Setup(artefact=tn.Artefact("cross"))


def test_the_papers_plan_sees_all_fourteen() -> None:
    seen = tn.observability(tn.plan(CROSS), CROSS, noise_um=1.0)
    assert seen.rank == 14
    bounds = {"EA0A": 1.82, "EB0A": 2.75, "EC0A": 2.92, "EX0C": 0.236, "EY0A": 0.433, "EZ0A": 0.359}
    for name, bound in bounds.items():
        assert seen.std_errors[name] == pytest.approx(bound, rel=4e-3), name
    top = tn.observability(tn.plan(CROSS, layout="top"), CROSS, noise_um=1.0)
    bounds = {"EB0A": 3.89, "EC0A": 2.75, "EY0A": 0.377, "EZ0A": 0.396}
    for name, bound in bounds.items():
        assert top.std_errors[name] == pytest.approx(bound, rel=4e-3), name
    json.dumps(seen.to_dict(), allow_nan=False)


def test_effects_that_are_not_identifiable_and_exact_dependencies_of_the_papers_plan() -> None:
    seen = tn.observability(tn.plan(CROSS), CROSS)
    assert set(seen.not_identifiable_effects) == {
        "probe_lobing",
        "artefact_height",
        "squareness_xz",
        "backlash_z",
        "a_twist",
        "c_backlash",
    }
    groups = set(seen.alike)
    for members in (
        {"probe_radius", "probe_bending"},
        {"probe_radius", "trigger_delay"},
        {"a_positioning", "a_scale"},
        {"probe_radius", "artefact_length", "artefact_width"},
        {"probe_bending", "backlash_x", "backlash_y"},
        {"artefact_expansion", "artefact_length", "artefact_width"},
    ):
        assert frozenset(members) in groups, members
    drawn = [text.get_text() for text in plot_observability(seen).get_yticklabels()]
    # labels for people, the id behind each
    assert sorted(t.rpartition("(")[2].rstrip(")") for t in drawn) == sorted(seen.share_left)
    assert all(len(text.partition("(")[0]) > 3 for text in drawn)


def test_what_cannot_be_told_is_said_in_words() -> None:
    seen = tn.observability(tn.plan(CROSS), CROSS, ("artefact_height",))
    assert seen.rank == 14
    assert np.isinf(seen.condition)
    assert np.isinf(seen.std_errors["dz_um"])
    assert any(
        "dz_um" in line and "artefact_height.dh_um" in line for line in seen.not_identifiable
    )
    assert "together with" in seen.summary()


def test_a_plan_without_times_says_what_it_cannot_test() -> None:
    plan = tn.plan(CROSS).with_columns(time_s=None)
    seen = tn.observability(plan, CROSS)
    assert seen.missing_columns["drift_z"] == "time_s"
    with pytest.raises(tn.InputError, match=r"drift_z.*time_s"):
        tn.observability(plan, CROSS, ("drift_z",))


def repeated(times: int) -> tuple[tn.Touches, tn.Setup]:
    """The sample's touches again and again, by a probe of known repeatability."""
    setup = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(repeatability_um=0.3))
    touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    columns = {name: np.tile(np.asarray(v), times) for name, v in touches.columns.items()}
    return tn.Touches(columns), setup


def test_memory_is_linear_in_rows() -> None:
    """Twenty thousand touches: a square array of them alone would be 3 GB."""
    plan, setup = repeated(278)
    assert len(plan) > 20_000
    tracemalloc.start()
    tn.observability(plan, setup)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4000 * len(plan)


def test_repeats_narrow_what_a_plan_tells_and_nothing_else() -> None:
    one, setup = repeated(1)
    many, _ = repeated(9)
    first, ninth = tn.observability(one, setup), tn.observability(many, setup)
    assert ninth.alike == first.alike
    assert ninth.combinations == first.combinations
    for name, error in first.std_errors.items():
        assert ninth.std_errors[name] == pytest.approx(error / 3, rel=1e-9), name
    off = 1e-10 * np.random.default_rng(1).standard_normal((3, len(many)))  # equal ones count once
    many = many.with_columns(
        x_mm=many.x_mm + off[0], y_mm=many.y_mm + off[1], z_mm=many.z_mm + off[2]
    )
    for method in ("printed", "separating"):
        a, b = (tn.closed_form(data, setup, method=method) for data in (one, many))
        for name, error in a.std_errors.items():
            assert b[name] == pytest.approx(a[name], abs=1e-6), name
            assert b.std_errors[name] == pytest.approx(error / 3, rel=1e-6), name
