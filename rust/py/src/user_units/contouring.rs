//! The contouring loop: mm/min, ms, µm, arcsec, degrees, Hz.

use std::f64::consts::TAU;

use trunnion_core::contouring::simulation::Run;
use trunnion_core::contouring::{Axis, Feed, Figures, Friction, Path, Reference, Sample};
use trunnion_core::units::{ARCSEC, DEG, MM_PER_MIN, MS, UM};

/// Number of parameters in a row that describes an axis, in the order of [`axis`].
pub const AXIS_FIELDS: usize = 17;

const PERCENT: f64 = 0.01;

/// mm, or rad per degree: what a position of an axis counts in.
pub fn position_unit(letter: char) -> f64 {
    if matches!(letter, 'X' | 'Y' | 'Z') { 1.0 } else { DEG }
}

/// An axis from a row: gain (1/s), time constant (ms), Coulomb and breakaway friction as the position
/// error they take (µm | arcsec), Stribeck speed (mm/min | deg/min), backlash (µm | arcsec),
/// amplitude of the cyclic error (µm | arcsec), its pitch (mm | deg) and phase (deg), delay (ms),
/// resonance (Hz), damping ratio, limit of the velocity command (mm/min | deg/min), offset (µm |
/// arcsec), friction by direction (%), velocity feed-forward (%), acceleration feed-forward (ms); the
/// second unit for a rotary axis.
pub fn axis(row: &[f64; AXIS_FIELDS], rotary: bool) -> Axis {
    let (small, large) = if rotary { (ARCSEC, DEG) } else { (UM, 1.0) };
    let speed = large * MM_PER_MIN;
    Axis {
        gain: row[0],
        time_constant: row[1] * MS,
        friction: Friction {
            coulomb: row[2] * small * row[0],
            breakaway: row[3] * small * row[0],
            stribeck: row[4] * speed,
            drag: row[14] * PERCENT,
        },
        backlash: row[5] * small,
        cyclic: row[6] * small,
        pitch: row[7] * large,
        phase: row[8] * DEG,
        delay: row[9] * MS,
        resonance: row[10] * TAU,
        damping: row[11],
        limit: row[12] * speed,
        offset: row[13] * small,
        velocity_forward: row[15] * PERCENT,
        acceleration_forward: row[16] * MS,
    }
}

/// A feed in mm/min, acceleration time in s, deceleration at the end, largest normal acceleration in
/// mm/s² (infinite for none), dwell in s.
pub fn feed(
    (feed_mm_min, acceleration_time, decelerate, normal_acceleration, dwell): (
        f64,
        f64,
        bool,
        f64,
        f64,
    ),
) -> Feed {
    Feed {
        feed: feed_mm_min * MM_PER_MIN,
        acceleration_time,
        decelerate,
        normal_acceleration,
        dwell,
    }
}

/// Columns of a run: name, numbers in a row, values.
pub type Columns = Vec<(&'static str, usize, Vec<f64>)>;

/// Columns of a run: path parameter, tool tips (mm), axis positions (mm and degrees), true errors and
/// errors of the models (µm, arcsec).
pub fn columns(
    path: &Path,
    reference: &Reference,
    run: &Run,
    samples: impl Iterator<Item = Sample>,
) -> Columns {
    let samples: Vec<Sample> = samples.collect();
    let axes = |rows: &[[f64; 5]]| -> Vec<f64> {
        let degrees = |q: &[f64; 5]| [q[0], q[1], q[2], q[3] / DEG, q[4] / DEG];
        rows.iter().take(samples.len()).flat_map(degrees).collect()
    };
    let each = |of: &dyn Fn(&Sample) -> f64| -> Vec<f64> { samples.iter().map(of).collect() };
    let points = |of: &dyn Fn(&Sample) -> [f64; 3]| samples.iter().flat_map(of).collect();
    let reference_points = reference.point.iter().take(samples.len());
    vec![
        ("u", 1, reference.u.iter().take(samples.len()).copied().collect()),
        ("point_mm", 3, reference_points.flat_map(|p| [p.x, p.y, p.z]).collect()),
        ("reference", 5, axes(&reference.axes)),
        ("commanded", 5, axes(&run.commands)),
        ("actual", 5, axes(&run.axes)),
        ("tip_mm", 3, points(&|s| (path.frame(s.truth.u).r - s.truth.contour).into())),
        ("foot_u", 1, each(&|s| s.truth.u)),
        ("contour_vector_um", 3, points(&|s| s.truth.contour.map(|v| v / UM).into())),
        ("contour_um", 1, each(&|s| s.truth.contour.norm() / UM)),
        ("orientation_arcsec", 1, each(&|s| s.truth.orientation / ARCSEC)),
        ("following_um", 1, each(&|s| s.truth.following / UM)),
        ("circle_um", 1, each(&|s| s.proposed[0] / UM)),
        ("tangent_um", 1, each(&|s| s.tangent[0] / UM)),
        ("proposed_arcsec", 1, each(&|s| s.proposed[1] / ARCSEC)),
        ("tangent_arcsec", 1, each(&|s| s.tangent[1] / ARCSEC)),
    ]
}

/// Names of the numbers of [`figures`].
pub const FIGURES: [&str; 11] = [
    "steps",
    "diverged",
    "contour_max_um",
    "contour_rms_um",
    "orientation_max_arcsec",
    "orientation_rms_arcsec",
    "following_max_um",
    "circle_max_um",
    "tangent_max_um",
    "proposed_max_arcsec",
    "tangent_max_arcsec",
];

/// Figures of a simulation in the order of [`FIGURES`].
pub fn figures(figures: &Figures) -> [f64; 11] {
    [
        figures.steps as f64,
        f64::from(u8::from(figures.diverged)),
        figures.contour_max / UM,
        figures.contour_rms / UM,
        figures.orientation_max / ARCSEC,
        figures.orientation_rms / ARCSEC,
        figures.following_max / UM,
        figures.circle_max / UM,
        figures.tangent_max / UM,
        figures.proposed_max / ARCSEC,
        figures.tangent_axis_max / ARCSEC,
    ]
}
