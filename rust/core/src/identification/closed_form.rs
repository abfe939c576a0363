//! Closed forms for the paper's 72 touches of the cross on a `trt-ca` machine.
//!
//! [`printed`] is equations (3) to (20) of the paper. [`separating`] is derived here from the same
//! touches and gives the eight location errors and the six placement parameters, whatever the
//! placement.
//!
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

use nalgebra::Vector3;

use crate::artefact::Artefact;
use crate::moves::Moves;
use crate::touch::TouchModel;
use crate::units::{DEG, UM};
use crate::{Error, Result};

/// Angles closer than this are the same position, rad.
const SAME_ANGLE: f64 = 0.01 * DEG;
/// Number of location errors and placement parameters.
pub const COUNT: usize = 14;
/// Number of location errors, the first of them.
pub const ERRORS: usize = 8;

/// One position of C with A = 0: the rows of the labels 1 to 16.
#[derive(Clone, Debug)]
struct Turned {
    angle: f64,
    rows: [Vec<usize>; 17],
}

/// One position of A with C = 0: the rows of the labels 17 to 20.
#[derive(Clone, Debug)]
struct Tilted {
    angle: f64,
    rows: [Vec<usize>; 4],
}

/// Which rows of a measurement are which touches of the paper.
#[derive(Clone, Debug)]
pub struct PaperRows {
    turned: Vec<Turned>,
    tilted: Vec<Tilted>,
    /// (L − h)/2, how far out along the arms tops and sides are touched.
    out: f64,
    height: f64,
}

impl PaperRows {
    /// Finds the paper's touches by the positions of A and C and by label; repeated touches are
    /// averaged, others ignored.
    ///
    /// # Errors
    /// Another artefact than the cross, another machine than `trt-ca`, or a position at which some of
    /// the labels are missing.
    pub fn find(model: &TouchModel, moves: &Moves, labels: &[i64]) -> Result<Self> {
        let Artefact::Cross { length, height, .. } = *model.artefact() else {
            return Err(Error::Data("closed forms: got another artefact, wanted the cross".into()));
        };
        let letters: String =
            model.machine().rotary().iter().map(crate::machine::Rotary::letter).collect();
        if letters != "AC" {
            let got = format!("rotary axes {letters}");
            return Err(Error::input("closed forms", got, "a trt-ca machine (A carries C)"));
        }
        if labels.len() != moves.len() {
            return Err(Error::input("labels", labels.len(), format!("{} of them", moves.len())));
        }
        let mut found =
            Self { turned: Vec::new(), tilted: Vec::new(), out: 0.5 * (length - height), height };
        for (row, (&label, angles)) in labels.iter().zip(moves.rotary.chunks_exact(2)).enumerate() {
            let (a, c) = (angles[0], angles[1]);
            if a.abs() < SAME_ANGLE && (1..=16).contains(&label) {
                found.turned_at(c).rows[label as usize].push(row);
            } else if same(c, 0.0) && (17..=20).contains(&label) {
                found.tilted_at(a).rows[label as usize - 17].push(row);
            }
        }
        found.check()?;
        Ok(found)
    }

    /// Rows of each touch that is used, its repeats together: the forms take their mean.
    fn repeats(&self) -> impl Iterator<Item = &[usize]> {
        let turned = self.turned.iter().flat_map(|position| position.rows.iter());
        let tilted = self.tilted.iter().flat_map(|position| position.rows.iter());
        turned.chain(tilted).map(Vec::as_slice).filter(|rows| !rows.is_empty())
    }

    fn turned_at(&mut self, angle: f64) -> &mut Turned {
        let place = self.turned.iter().position(|p| same(p.angle, angle));
        let place = place.unwrap_or_else(|| {
            self.turned.push(Turned { angle, rows: std::array::from_fn(|_| Vec::new()) });
            self.turned.len() - 1
        });
        &mut self.turned[place]
    }

    fn tilted_at(&mut self, angle: f64) -> &mut Tilted {
        let place = self.tilted.iter().position(|p| (p.angle - angle).abs() < SAME_ANGLE);
        let place = place.unwrap_or_else(|| {
            self.tilted.push(Tilted { angle, rows: std::array::from_fn(|_| Vec::new()) });
            self.tilted.len() - 1
        });
        &mut self.tilted[place]
    }

    fn check(&self) -> Result<()> {
        let wanted = "wanted labels 1 to 16 at every C with A = 0, among them C = 0, and labels 17 \
                      to 20 at every A with C = 0";
        if self.turned.is_empty() || self.tilted.is_empty() {
            let (c, a) = (self.turned.len(), self.tilted.len());
            return Err(Error::Data(format!(
                "closed forms: got labelled touches at {c} positions of C and {a} of A; {wanted}"
            )));
        }
        for position in &self.turned {
            if let Some(label) = (1..=16).find(|&label: &usize| position.rows[label].is_empty()) {
                let c = position.angle / DEG;
                return Err(Error::Data(format!(
                    "closed forms: no touch {label} at C = {c:.3}°, A = 0; {wanted}"
                )));
            }
        }
        for position in &self.tilted {
            if let Some(index) = position.rows.iter().position(Vec::is_empty) {
                let (label, a) = (index + 17, position.angle / DEG);
                return Err(Error::Data(format!(
                    "closed forms: no touch {label} at A = {a:.3}°, C = 0; {wanted}"
                )));
            }
        }
        if !self.turned.iter().any(|position| same(position.angle, 0.0)) {
            return Err(Error::Data(format!("closed forms: no touches at A = C = 0; {wanted}")));
        }
        Ok(())
    }

    /// Positions of C in the order measured, rad.
    #[must_use]
    pub fn turned_angles(&self) -> Vec<f64> {
        self.turned.iter().map(|position| position.angle).collect()
    }

    /// Positions of A in the order measured, rad.
    #[must_use]
    pub fn tilted_angles(&self) -> Vec<f64> {
        self.tilted.iter().map(|position| position.angle).collect()
    }
}

/// Whether two positions of C are the same but for whole turns.
fn same(a: f64, b: f64) -> bool {
    crate::machine::kinematics::wrap(a - b).abs() < SAME_ANGLE
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count();
    values.sum::<f64>() / count as f64
}

/// What the printed equations give at one position of C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrintedTurned {
    /// C, rad.
    pub angle: f64,
    /// Equation (3), rad.
    pub ea: f64,
    /// Equation (4), rad.
    pub eb_c: f64,
    /// Equation (5), rad.
    pub ec: f64,
    /// Equation (6), mm.
    pub ex: f64,
    /// Equation (7), mm.
    pub ey_c: f64,
    /// Equation (8), mm.
    pub ez: f64,
}

/// What the printed equations give at one position of A.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrintedTilted {
    /// A, rad.
    pub angle: f64,
    /// Equation (9), rad.
    pub eb_a: f64,
    /// Equation (10), mm.
    pub ey_a: f64,
}

/// What the printed equations give, before and after averaging.
#[derive(Clone, Debug, PartialEq)]
pub struct Printed {
    /// Per position of C.
    pub turned: Vec<PrintedTurned>,
    /// Per position of A.
    pub tilted: Vec<PrintedTilted>,
    /// EA0A, EB0A, EC0A (rad), EY0A, EZ0A (mm), EB0C (rad), EX0C, EY0C (mm): equations (13) to
    /// (20), the differences of (16) and (20) written as their first terms.
    pub errors: [f64; ERRORS],
}

/// Corrections of the printed equations, each with its reason; everything else is as printed.
pub const SLIPS: [&str; 6] = [
    "(3), (4): P9 − P1 and P13 − P5 are read as the distances of the points; a difference of \
     vectors cannot stand under an arctangent",
    "(5): the first denominator is Y12 − Y2 (printed Y2 − Y12), or the first of the four angles \
     would have the opposite sign",
    "(5): the third numerator is Y14 − Y8 (printed Y4 − Y8): points 8 and 14 form the triangle that \
     the text names, and 4 lies on another arm",
    "(5): the angle is taken by atan2 on the whole direction and C subtracted; the printed branches \
     of θC' give values shifted by π at exactly 90° and 270° when EC is negative",
    "(6), (7): the sums run over j = 0, 1 (printed to kC): 8j + 7 and 8j + 3 are labels only then",
    "(10): (h/2)² stands under the root, and at A < 0 the arm that points up is −Y: points 1 and 3 \
     take the place of 9 and 11, and the sign changes",
];

/// Equations (3) to (20) of the paper on the recorded ball centres, the trigger's mean delay taken
/// off.
#[must_use]
pub fn printed(model: &TouchModel, rows: &PaperRows, moves: &Moves) -> Printed {
    let (delay, radius) = (model.probe().mean_delay(), model.probe().ball_radius);
    let row =
        |row: usize| Moves::vector(moves.point, row) - Moves::vector(moves.direction, row) * delay;
    let point = |rows: &[usize]| -> Vector3<f64> {
        rows.iter().map(|&r| row(r)).sum::<Vector3<f64>>() / rows.len() as f64
    };
    let turned: Vec<PrintedTurned> = rows
        .turned
        .iter()
        .map(|position| {
            let points: [Vector3<f64>; 17] = std::array::from_fn(|label| match label {
                0 => Vector3::zeros(),
                _ => point(&position.rows[label]),
            });
            let p = |label: usize| points[label];
            let (sin, cos) = position.angle.sin_cos();
            let slope = |to: usize, from: usize| {
                let way = p(to) - p(from);
                (way.z / way.norm()).atan()
            };
            let along_y = slope(9, 1);
            let along_x = slope(13, 5);
            let ea = along_y * cos + along_x * sin;
            let eb_c = along_y * sin - along_x * cos;
            // Direction from one point to the other, against where it would be at C = 0.
            let yaw = |to: usize, from: usize, nominal: f64| {
                let way = p(to) - p(from);
                let turned = way.y.atan2(way.x) - nominal - position.angle;
                crate::machine::kinematics::wrap(turned)
            };
            let up = std::f64::consts::FRAC_PI_2;
            let ec = 0.25 * (yaw(12, 2, up) + yaw(10, 4, up) + yaw(14, 8, 0.0) + yaw(16, 6, 0.0));
            let (tan_a, tan_b) = (ea.tan(), eb_c.tan());
            let x = |label: usize| p(label).x - p(label).z * tan_b;
            let y = |label: usize| p(label).y + p(label).z * tan_a;
            let ex = 0.5 * ((x(7) + x(15)) * cos + (y(7) + y(15)) * sin);
            let ey_c = 0.5 * ((y(3) + y(11)) * cos - (x(3) + x(11)) * sin);
            let tops = p(1).z + p(5).z + p(9).z + p(13).z;
            let ez = 0.25 * tops - rows.height - radius;
            PrintedTurned { angle: position.angle, ea, eb_c, ec, ex, ey_c, ez }
        })
        .collect();
    let zero = rows.turned.iter().find(|position| same(position.angle, 0.0));
    let tilted: Vec<PrintedTilted> = rows
        .tilted
        .iter()
        .map(|position| {
            let p = |label: usize| point(&position.rows[label - 17]);
            let distance = |v: Vector3<f64>| v.y.hypot(v.z);
            let eb_a = ((distance(p(17)) - distance(p(20))) / (p(17) - p(20)).norm()).atan();
            let side = position.angle.signum();
            let (top, end) = if side > 0.0 { (9, 11) } else { (1, 3) };
            let upright =
                zero.map_or(0.0, |zero| point(&zero.rows[top]).z + side * point(&zero.rows[end]).y);
            let (sin, cos) = position.angle.sin_cos();
            let to_end = (distance(p(19)).powi(2) - (0.5 * rows.height).powi(2)).sqrt();
            let out = side * rows.out;
            let to_top = (p(18).y - out * cos).hypot(p(18).z - out * sin);
            let ey_a = 0.5 * side * (upright - to_end - to_top);
            PrintedTilted { angle: position.angle, eb_a, ey_a }
        })
        .collect();
    let over_c = |pick: fn(&PrintedTurned) -> f64| mean(turned.iter().map(pick));
    let over_a = |pick: fn(&PrintedTilted) -> f64| mean(tilted.iter().map(pick));
    let errors = [
        over_c(|p| p.ea),
        over_a(|p| p.eb_a),
        over_c(|p| p.ec),
        over_a(|p| p.ey_a),
        over_c(|p| p.ez),
        over_c(|p| p.eb_c),
        over_c(|p| p.ex),
        over_c(|p| p.ey_c),
    ];
    Printed { turned, tilted, errors }
}

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

impl PaperRows {
    /// Positions 0°, 90°, 180°, 270° of C and ±90° of A, in this order; others are no part of the
    /// separating forms.
    fn quarters(&self) -> Option<([&Turned; 4], [&Tilted; 2])> {
        let turned = |quarter: f64| {
            self.turned.iter().find(|position| same(position.angle, quarter * 90.0 * DEG))
        };
        let tilted = |angle: f64| {
            self.tilted.iter().find(|position| (position.angle - angle * DEG).abs() < SAME_ANGLE)
        };
        Some((
            [turned(0.0)?, turned(1.0)?, turned(2.0)?, turned(3.0)?],
            [tilted(90.0)?, tilted(-90.0)?],
        ))
    }
}

/// The separating forms on deviations `along` (n, mm): recorded minus modelled coordinate along
/// each touch's approach direction.
///
/// # Errors
/// Positions other than C = 0°, 90°, 180°, 270° and A = ±90° only.
pub fn separating(rows: &PaperRows, along: &[f64]) -> Result<Separated> {
    let ([c0, c90, c180, c270], [plus, minus]) = rows.quarters().ok_or_else(|| {
        Error::Data(
            "separating closed forms: wanted C = 0°, 90°, 180°, 270° with A = 0 and A = 90°, -90° \
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
    let mut values = [0.0; COUNT];
    values.copy_from_slice(start);
    let mut first = None;
    for _ in 0..2 {
        scratch.along.resize(moves.len(), 0.0);
        let mut walk = model.walk(moves, &values);
        for (row, slot) in scratch.along.iter_mut().enumerate() {
            let deviation = walk.deviation(row).ok_or_else(|| {
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

/// Change of the printed forms' estimates for one mm of each reading, 8 × n row-major, from ±0.5 µm:
/// they are linear in the readings but for products with the errors themselves (1e-5 of the result
/// at 1 mm).
#[must_use]
pub fn printed_operator(model: &TouchModel, rows: &PaperRows, moves: &Moves) -> Vec<f64> {
    let readings = moves.len();
    let step = 0.5 * UM;
    let mut operator = vec![0.0; ERRORS * readings];
    let mut points = moves.point.to_vec();
    for repeats in rows.repeats() {
        for side in [1.0, -1.0] {
            for &row in repeats {
                let moved = Moves::vector(moves.point, row)
                    + Moves::vector(moves.direction, row) * (side * step);
                points[3 * row..3 * row + 3].copy_from_slice(moved.as_slice());
            }
            let shifted = printed(model, rows, &Moves { point: &points, ..*moves });
            for &row in repeats {
                for (k, value) in shifted.errors.into_iter().enumerate() {
                    operator[k * readings + row] +=
                        side * value / (2.0 * step * repeats.len() as f64);
                }
            }
        }
        for &row in repeats {
            points[3 * row..3 * row + 3].copy_from_slice(&moves.point[3 * row..3 * row + 3]);
        }
    }
    operator
}

/// Memory that [`separate`] reuses from one measurement to the next.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    along: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use crate::plan::collision::Stylus;
    use crate::plan::targets::Layout;
    use crate::plan::{PlanOptions, PlanRequest, PlannedTouch, plan};
    use crate::probe::Probe;

    struct Measurement {
        model: TouchModel,
        rotary: Vec<f64>,
        point: Vec<f64>,
        direction: Vec<f64>,
        labels: Vec<i64>,
    }

    impl Measurement {
        fn paper(length: f64, width: f64, height: f64) -> Self {
            let machine = Machine::preset("trt-ca", 150.0).unwrap();
            let artefact = Artefact::Cross { length, width, height };
            let options = PlanOptions {
                clearance: 5.0,
                overtravel: 5.0,
                linear_resolution: 0.0,
                rotary_resolution: 0.0,
                rapid: 100.0,
                rotary_speed: 1.0,
                stylus: Stylus { ball_radius: 1.0, stem_radius: 0.5, length: 100.0 },
                table_radius: 150.0,
                table_thickness: 30.0,
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
            let touches = plan(&machine, &artefact, &request, &options).unwrap();
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
        for (length, width, height) in [(100.0, 25.0, 25.0), (120.0, 20.0, 30.0)] {
            let m = Measurement::paper(length, width, height);
            let n = m.labels.len();
            let (mut deviations, mut jacobian) = (vec![0.0; n], vec![0.0; n * COUNT]);
            assert!(m.model.linearise(&m.moves(), &[0.0; COUNT], &mut deviations, &mut jacobian));
            assert!(deviations.iter().all(|d| d.abs() < 1e-12));
            let rows = PaperRows::find(&m.model, &m.moves(), &m.labels).unwrap();
            for k in 0..COUNT {
                let along: Vec<f64> = (0..n).map(|i| jacobian[i * COUNT + k]).collect();
                let found = separating(&rows, &along).unwrap();
                for (j, value) in found.values.iter().enumerate() {
                    let wanted = if j == k { 1.0 } else { 0.0 };
                    assert!((value - wanted).abs() < 1e-9, "{k} {j} {value}");
                }
                assert!(found.kappa.abs() < 1e-9 && found.zeta.abs() < 1e-9, "{k}");
            }
        }
    }
}
