//! Values that are tried for parameters that no linear step finds.

/// Midpoints between the times of the touches.
pub(super) fn between(times: &[f64]) -> Vec<f64> {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    sorted.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect()
}

/// Durations from a fiftieth of the whole to three times it.
pub(super) fn decades(span: f64) -> Vec<f64> {
    (0..20).map(|i| span / 50.0 * 150_f64.powf(f64::from(i) / 19.0)).collect()
}
