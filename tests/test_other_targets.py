"""Two positioning tests of an axis at other targets: a wave between them is no change of scale."""

import numpy as np
import pytest

import trunnion as tn

LENGTH_MM = 350.0


def run(
    rng: np.random.Generator, targets: np.ndarray, scale_ppm: float, pitch_mm: float, start: float
) -> tn.Positioning:
    """Five cycles in both directions; an error of 2 µm that comes again with a pitch; 0.3 µm."""
    way = np.tile(np.r_[targets, targets[::-1]], 5)
    count = len(targets)
    wave = 2.0 * np.sin(2 * np.pi * way / pitch_mm + start) if pitch_mm else 0.0
    error = 1e-3 * scale_ppm * way + wave + 0.3 * rng.standard_normal(len(way))
    return tn.Positioning(
        target_mm=way,
        measured_mm=way + 1e-3 * error,
        direction=np.tile(np.repeat([1, -1], count), 5),
        cycle=np.repeat(np.arange(1, 6), 2 * count),
        axis=np.full(len(way), "X"),
    )


def both(seed: int, counts: tuple[int, int], pitch_mm: float, change_ppm: float) -> tn.Diagnosis:
    """Diagnose two dates with other targets, some millimetres off equal steps as ISO 230-2 asks."""
    rng = np.random.default_rng([65, seed])
    start = float(rng.uniform(0.0, 6.0))
    made = []
    for count, scale in zip(counts, (10.0, 10.0 + change_ppm), strict=True):
        targets = np.linspace(0.0, LENGTH_MM, count) + 10.0 + rng.uniform(-3.0, 3.0, count)
        made.append(run(rng, np.round(targets, 2), scale, pitch_mm, start))
    return tn.diagnose(made)


def change_of(d: tn.Diagnosis) -> tn.Cause | None:
    return next((c for c in d.causes if c.id.endswith(":change_scale_x")), None)


@pytest.mark.parametrize(
    ("counts", "pitch_mm"), [((11, 21), 40.0), ((11, 16), 30.0), ((11, 21), 10.0)]
)
def test_a_wave_between_targets_is_no_change_of_the_scale(
    counts: tuple[int, int], pitch_mm: float
) -> None:
    stated, off = 0, []
    for seed in range(8):
        d = both(seed, counts, pitch_mm, 0.0)
        change = change_of(d)
        if change is not None:
            stated += change.probability > 0.9
            off.append(change.parameters["ppm"] / change.std_errors["ppm"])
            assert any("choice of targets" in note for note in d.notes)
    assert stated <= 1
    assert not off or np.sqrt(np.mean(np.square(off))) < 2.0


@pytest.mark.parametrize(("pitch_mm", "change_ppm"), [(0.0, 8.0), (30.0, 40.0)])
def test_a_scale_that_changed_is_found(pitch_mm: float, change_ppm: float) -> None:
    off = []
    for seed in range(6):
        change = change_of(both(seed, (11, 16), pitch_mm, change_ppm))
        assert change is not None
        assert change.probability > 0.9
        off.append((change.parameters["ppm"] - change_ppm) / change.std_errors["ppm"])
    assert np.sqrt(np.mean(np.square(off))) < 2.0
