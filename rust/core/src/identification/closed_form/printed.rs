//! Equations (3) to (20) of the paper.

use nalgebra::Vector3;

use super::ERRORS;
use super::rows::{PaperRows, mean, same};
use crate::moves::Moves;
use crate::touch::TouchModel;
use crate::units::UM;

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
    let radius = model.probe().ball_radius;
    let row = |row: usize| {
        let delay = model.probe().mean_delay(moves.feed_at(row));
        Moves::vector(moves.point, row) - Moves::vector(moves.direction, row) * delay
    };
    let point = |rows: &[usize]| -> Vector3<f64> {
        rows.iter().map(|&r| row(r)).sum::<Vector3<f64>>() / rows.len() as f64
    };
    let mut turned: Vec<PrintedTurned> = rows
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
            // As if the A axis went through the origin, which the printed equations assume.
            let [y, z] = rows.shift(position.angle);
            let p = |label: usize| point(&position.rows[label - 17]) - Vector3::new(0.0, y, z);
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
    shift_to_axis(rows.axis, &mut turned, mean(tilted.iter().map(|p| p.eb_a)));
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

/// Tilts of an A axis through `axis` (Y, Z, mm) turn about a point of it and not about the origin:
/// takes off what that shifts in the readings of equations (6) to (8), which are those of
/// EX cos C + EY sin C, EY cos C − EX sin C and EZ.
fn shift_to_axis([y, z]: [f64; 2], turned: &mut [PrintedTurned], eb: f64) {
    let ea = mean(turned.iter().map(|p| p.ea));
    let ec = mean(turned.iter().map(|p| p.ec));
    let (shift_x, shift_y) = (eb * z - ec * y, -ea * z);
    for position in turned {
        let (sin, cos) = position.angle.sin_cos();
        position.ex += shift_x * cos + shift_y * sin;
        position.ey_c += shift_y * cos - shift_x * sin;
        position.ez += ea * y;
    }
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
