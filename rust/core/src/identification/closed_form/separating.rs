//! # The separating forms
//!
//! To first order every reading is linear in the fourteen parameters. Let b = (L − h)/2, and let all
//! readings be deviations from the model. At a position of C the four top touches give two slopes of
//! the artefact, α along its Y bar and β along its X bar; the six X and six Y readings of ends and
//! sides give its mean displacement (x, y); the eight sides its yaw. What turns with C belongs to
//! the artefact on the table, what stays belongs to the table: sums over a turn part the two. At
//! A = ±90° touches 17 and 20 give the slope e of the up-looking sides, 18 the position v of the
//! upright arm's top along Y, and 17, 19, 20 the mean height q. Of the seventy-two readings
//! two combinations are left over as free checks, κ and ζ, whose weights make the estimates those of
//! least squares.
//!
//! Products of two errors are left out: at the size of Table 2 they amount to 0.0016 µm and
//! 0.0013″, at 60 µm and 60″ to about 0.02 µm. Repeating the forms once on the difference between the
//! readings and the exact model removes them (4e-4 µm left at 0.2 mm and 300″).

use super::COUNT;
use super::rows::{PaperRows, Tilted, Turned, mean};
use crate::moves::Moves;
use crate::touch::TouchModel;
use crate::{Error, Result};

/// What the separating forms give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Separated {
    /// EA0A, EB0A, EC0A (rad), EY0A, EZ0A (mm), EB0C (rad), EX0C, EY0C (mm), then dx, dy, dz (mm), ra,
    /// rb, rc (rad): corrections to where the readings' deviations were taken from.
    pub values: [f64; COUNT],
    /// First consistency check, mm; variance σ² of one reading.
    pub kappa: f64,
    /// Second consistency check, mm; variance (35/48) σ².
    pub zeta: f64,
}

/// The separating forms on deviations `along` (n, mm): recorded minus modelled coordinate along
/// each touch's approach direction.
///
/// # Errors
/// Positions other than C = 0°, 90°, 180°, 270° and A = ±90° only.
pub fn separating(rows: &PaperRows, along: &[f64]) -> Result<Separated> {
    let ([c0, c90, c180, c270], [plus, minus]) = rows.quarters().ok_or_else(|| {
        Error::Data(
            "separating closed forms: expected C = 0°, 90°, 180°, 270° with A = 0 and A = 90°, -90° \
             with C = 0"
                .into(),
        )
    })?;
    let b = rows.out;
    let h = rows.height;
    let turns = [c0, c90, c180, c270].map(|position| Slopes::of(position, along, b));
    let [t0, t90, t180, t270] = &turns;
    let tilts = [plus, minus].map(|position| Upright::of(position, along, b));
    let [tp, tm] = &tilts;

    let ra_1 = mean(turns.iter().map(|t| t.alpha));
    let rb = -mean(turns.iter().map(|t| t.beta));
    let ea_1 = (t0.alpha - t180.alpha + t90.beta - t270.beta) / 4.0;
    let eb0c = (t90.alpha - t270.alpha - t0.beta + t180.beta) / 4.0;
    let eb0a = (tp.slope + tm.slope) / 2.0;
    let rc = (tm.slope - tp.slope) / 2.0;
    let ec0a = mean(turns.iter().map(|t| t.yaw)) - rc;

    let dx_m = (t0.x + t90.y - t180.x - t270.y) / 4.0;
    let dy_m = (t0.y - t90.x - t180.y + t270.x) / 4.0;
    let x_mean = mean(turns.iter().map(|t| t.x));
    let y_mean = mean(turns.iter().map(|t| t.y));
    let ex0c = x_mean - 0.5 * h * eb0c;
    let ey0c = y_mean + 0.5 * h * ea_1;
    let dx = dx_m - 0.5 * h * rb;
    let dy = dy_m + 0.5 * h * ra_1;

    let y_1 = (tp.top + tm.top) / 2.0 + b * (ea_1 + ra_1);
    let y_2 = y_mean + dy_m - (tp.height - tm.height) / 2.0;
    let kappa = y_1 - y_2;
    let ey0a = (y_1 + 3.0 * y_2) / 4.0;
    let ea0a = ea_1 - kappa / (8.0 * b);
    let ra = ra_1 - kappa / (8.0 * b);

    let dz_1 = (tm.top - tp.top) / 2.0;
    let z_1 = (tp.height + tm.height) / 2.0;
    let z_2 = mean(turns.iter().map(|t| t.z)) - dz_1;
    let zeta = z_1 - z_2;
    let ez0a = (27.0 * z_1 + 8.0 * z_2) / 35.0;
    let dz = dz_1 - 24.0 / 35.0 * zeta;

    // Tilts of the A axis turn about a point of it: what they shift where that is not the origin.
    let [y, z] = rows.axis;
    let ex0c = ex0c + eb0a * z - ec0a * y;
    let ey0c = ey0c - ea0a * z;
    let dz = dz + ea0a * y;

    let values = [ea0a, eb0a, ec0a, ey0a, ez0a, eb0c, ex0c, ey0c, dx, dy, dz, ra, rb, rc];
    Ok(Separated { values, kappa, zeta })
}

/// Outward normals of the labels 1 to 16 in the artefact's frame, as the plan has them: the touches
/// approach against them, so that a deviation along the approach is minus one along the normal.
fn planar_normal(label: usize) -> (f64, f64) {
    // Arms −Y, −X, +Y, +X; side 2 at the left of the outward direction, end 3, side 4.
    const OUTWARD: [(f64, f64); 4] = [(0.0, -1.0), (-1.0, 0.0), (0.0, 1.0), (1.0, 0.0)];
    let (x, y) = OUTWARD[(label - 1) / 4];
    match label % 4 {
        2 => (-y, x),
        3 => (x, y),
        _ => (y, -x),
    }
}

/// First-order shape of the artefact's pose at one position of C.
struct Slopes {
    /// Slope of the tops along the artefact's Y.
    alpha: f64,
    /// Slope of the tops along the artefact's X.
    beta: f64,
    /// Turn about Z.
    yaw: f64,
    /// Mean displacement, machine frame.
    x: f64,
    y: f64,
    z: f64,
}

impl Slopes {
    fn of(position: &Turned, along: &[f64], b: f64) -> Self {
        let outward = |label: usize| -mean(position.rows[label].iter().map(|&row| along[row]));
        let (top, side) = (&outward, &outward);
        let yaw = side(2) - side(12) + side(10) - side(4) + side(6) - side(16) + side(14) - side(8);
        let (mut u, mut v) = (0.0, 0.0);
        for label in (1..=16).filter(|label| label % 4 != 1) {
            let (x, y) = planar_normal(label);
            u += x * side(label) / 6.0;
            v += y * side(label) / 6.0;
        }
        let (sin, cos) = crate::pose::sin_cos(position.angle);
        Self {
            alpha: (top(9) - top(1)) / (2.0 * b),
            beta: (top(13) - top(5)) / (2.0 * b),
            yaw: yaw / (8.0 * b),
            x: cos * u - sin * v,
            y: sin * u + cos * v,
            z: (top(1) + top(5) + top(9) + top(13)) / 4.0,
        }
    }
}

/// First-order shape at one position of A.
struct Upright {
    /// Slope of the sides that look up.
    slope: f64,
    /// Displacement of the upright arm's top along machine Y.
    top: f64,
    /// Mean height of the faces that look up.
    height: f64,
}

impl Upright {
    fn of(position: &Tilted, along: &[f64], b: f64) -> Self {
        let outward = |label: usize| -mean(position.rows[label - 17].iter().map(|&row| along[row]));
        // The artefact's top looks to −Y at A = +90° and to +Y at −90°.
        let side = position.angle.signum();
        Self {
            slope: (outward(17) - outward(20)) / (2.0 * b),
            top: -side * outward(18),
            height: (outward(17) + outward(19) + outward(20)) / 3.0,
        }
    }
}

/// Both closed forms on one measurement: the separating ones, once on the readings and once on what
/// the exact model leaves of them.
///
/// # Errors
/// Touches off the modelled surface, or positions that the separating forms do not cover.
pub fn separate(
    model: &TouchModel,
    rows: &PaperRows,
    moves: &Moves,
    start: &[f64],
    scratch: &mut Scratch,
) -> Result<Separated> {
    let mut values: [f64; COUNT] = start.try_into().map_err(|_| {
        let expected = format!("{COUNT}: location errors and placement, without effects");
        Error::input("number of start values", start.len(), expected)
    })?;
    let mut first = None;
    for _ in 0..2 {
        scratch.along.resize(moves.len(), 0.0);
        let mut evaluator = model.evaluator(moves, &values);
        for (row, slot) in scratch.along.iter_mut().enumerate() {
            let deviation = evaluator.deviation(row).ok_or_else(|| {
                Error::Data(format!("touch in row {row} misses the modelled artefact"))
            })?;
            *slot = -deviation;
        }
        let step = separating(rows, &scratch.along)?;
        for (value, change) in values.iter_mut().zip(step.values) {
            *value += change;
        }
        first.get_or_insert(step);
    }
    // The checks are those of the readings, before anything was fitted.
    let (kappa, zeta) = first.map_or((0.0, 0.0), |step| (step.kappa, step.zeta));
    Ok(Separated { values, kappa, zeta })
}

/// Estimates of the separating forms for one mm of each reading, 14 × n row-major: they are linear.
///
/// # Errors
/// As [`separating`].
pub fn separating_operator(rows: &PaperRows, readings: usize) -> Result<Vec<f64>> {
    let mut operator = vec![0.0; COUNT * readings];
    let mut along = vec![0.0; readings];
    for repeats in rows.repeats() {
        for &row in repeats {
            along[row] = 1.0;
        }
        let values = separating(rows, &along)?.values;
        for &row in repeats {
            along[row] = 0.0;
            for (k, value) in values.into_iter().enumerate() {
                operator[k * readings + row] = value / repeats.len() as f64;
            }
        }
    }
    Ok(operator)
}

/// Memory that [`separate`] reuses from one measurement to the next.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    along: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::artefact::{Artefact, Fixture, Layout};
    use crate::machine::Machine;
    use crate::plan::collision::Stylus;
    use crate::plan::{Arrangement, PlanOptions, PlanRequest, PlannedTouch, plan};
    use crate::probe::Probe;
    use crate::units::DEG;

    struct Measurement {
        model: TouchModel,
        rotary: Vec<f64>,
        point: Vec<f64>,
        direction: Vec<f64>,
        labels: Vec<i64>,
    }

    impl Measurement {
        fn paper(length: f64, width: f64, height: f64, axis: [f64; 3]) -> Self {
            let lines = [('A', crate::machine::Line { direction: None, point: Some(axis) })];
            let machine = Machine::new("[w C' A' b X Y Z t]", 150.0, &lines).unwrap();
            let artefact = Artefact::of("cross", &[length, width, height]).unwrap();
            let options = PlanOptions {
                clearance: 5.0,
                overtravel: 5.0,
                linear_resolution: 0.0,
                rotary_resolution: 0.0,
                stylus: Stylus {
                    ball_radius: 1.0,
                    stem_radius: 0.5,
                    length: 100.0,
                    body: [0.0; 2],
                },
                layout: Layout::Side,
                all_faces: false,
            };
            let request = PlanRequest {
                turning: [0.0, 90.0, 180.0, 270.0].map(|a| a * DEG).to_vec(),
                tilting: [90.0, -90.0].map(|a| a * DEG).to_vec(),
                pairs: vec![],
                feeds: vec![10.0],
                both_senses: false,
                repeats: 1,
            };
            let (places, fixture) = (machine.nominal(), Fixture::default());
            let table = [150.0, 30.0];
            let arrangement =
                Arrangement::new(machine.clone(), &places, artefact, &fixture, table, 0.0).unwrap();
            let touches = plan(&arrangement, &request, &options).unwrap();
            let flat = |f: fn(&PlannedTouch) -> Vector3<f64>| {
                touches.iter().flat_map(|t| f(t).iter().copied().collect::<Vec<_>>()).collect()
            };
            let probe = Probe::new(1.0, 0.0).unwrap();
            Self {
                model: TouchModel::new(machine, artefact, probe, vec![]),
                rotary: touches.iter().flat_map(|t| t.rotary[..2].to_vec()).collect(),
                point: flat(|t| t.contact),
                direction: flat(|t| t.direction),
                labels: touches.iter().map(|t| t.label).collect(),
            }
        }

        fn moves(&self) -> Moves<'_> {
            Moves {
                rotary: &self.rotary,
                point: &self.point,
                direction: &self.direction,
                feed: None,
                time: None,
                sense: None,
            }
        }
    }

    /// The forms are exact to first order: on a column of the Jacobian they give its unit vector.
    #[test]
    fn separating_forms_invert_the_jacobian() {
        let (small, large) = ([100.0, 25.0, 25.0], [120.0, 20.0, 30.0]);
        let (through_origin, sunk) = ([0.0; 3], [70.0, 12.0, -35.0]);
        for ([length, width, height], axis) in
            [(small, through_origin), (large, through_origin), (large, sunk)]
        {
            let m = Measurement::paper(length, width, height, axis);
            let n = m.labels.len();
            let (mut deviations, mut jacobian) = (vec![0.0; n], vec![0.0; n * COUNT]);
            assert!(m.model.linearise(&m.moves(), &[0.0; COUNT], &mut deviations, &mut jacobian));
            assert!(deviations.iter().all(|d| d.abs() < 1e-12));
            let rows = PaperRows::find(&m.model, &m.moves(), &m.labels).unwrap();
            for k in 0..COUNT {
                let along: Vec<f64> = (0..n).map(|i| jacobian[i * COUNT + k]).collect();
                let found = separating(&rows, &along).unwrap();
                for (j, value) in found.values.iter().enumerate() {
                    let expected = if j == k { 1.0 } else { 0.0 };
                    assert!((value - expected).abs() < 1e-9, "{k} {j} {value}");
                }
                assert!(found.kappa.abs() < 1e-9 && found.zeta.abs() < 1e-9, "{k}");
            }
        }
    }
}
