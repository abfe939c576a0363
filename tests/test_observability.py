"""What a plan can tell, against the figures worked out independently."""

import json

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


def test_invisible_effects_and_exact_dependencies_of_the_papers_plan() -> None:
    seen = tn.observability(tn.plan(CROSS), CROSS)
    assert set(seen.invisible) == {
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
    assert sorted(drawn) == sorted(seen.share_left)


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
    assert seen.untestable["drift_z"] == "time_s"
    with pytest.raises(tn.InputError, match=r"drift_z.*time_s"):
        tn.observability(plan, CROSS, ("drift_z",))
