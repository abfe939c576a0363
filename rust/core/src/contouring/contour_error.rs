//! Contour error in real time: the point K of the reference path nearest to the tool tip P, from
//! interpolated points alone; ε = K - P, eq. (1).

use nalgebra::Vector3;

/// Model of the foot point K.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PositionModel {
    /// Circle through the nearest reference point and its two neighbours (the paper's, after Jee
    /// and Koo 2004).
    Circle,
    /// Tangent line at the present reference point (reconstruction of earlier work: Lo 2002 was not
    /// available).
    Tangent,
}

/// Below this |U × V| / (|U| |V|) three points count as collinear.
const COLLINEAR: f64 = 1e-8;

/// Foot of `p` on the circle through a, b, c (b nearest to p): p is projected onto the circle's
/// plane, then radially onto the circle.
///
/// Collinear or repeated points: foot on the line through a and c. Foot of the plane at the
/// circle's centre: b.
#[must_use]
pub fn circle_foot(
    p: &Vector3<f64>,
    a: &Vector3<f64>,
    b: &Vector3<f64>,
    c: &Vector3<f64>,
) -> Vector3<f64> {
    let (u, v) = (a - b, c - b);
    let w = u.cross(&v);
    let (uu, vv, ww) = (u.norm_squared(), v.norm_squared(), w.norm_squared());
    if ww <= COLLINEAR * COLLINEAR * uu * vv {
        let line = c - a;
        let length = line.norm_squared();
        return if length > 0.0 { b + line * ((p - b).dot(&line) / length) } else { *b };
    }
    let to_centre = (v * uu - u * vv).cross(&w) / (2.0 * ww);
    let out = p - b - to_centre;
    let in_plane = out - w * (out.dot(&w) / ww);
    let (distance, radius) = (in_plane.norm(), to_centre.norm());
    if distance <= 1e-9 * radius {
        return *b;
    }
    b + to_centre + in_plane * (radius / distance)
}

/// Foot of `p` on the line through the present reference point along its last step: R_k - λ t.
/// Returns it with λ, by which the tool lags along the line, and the step h, both mm.
#[must_use]
pub fn tangent_foot(
    p: &Vector3<f64>,
    before: &Vector3<f64>,
    now: &Vector3<f64>,
) -> (Vector3<f64>, f64, f64) {
    let step = now - before;
    let h = step.norm();
    if h == 0.0 {
        return (*now, 0.0, 0.0);
    }
    let t = step / h;
    let lag = (now - p).dot(&t);
    (now - t * lag, lag, h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foot_on_a_circle_is_exact() {
        let at = |angle: f64| Vector3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 1.0);
        let p = Vector3::new(2.9 * 0.02_f64.cos(), 2.9 * 0.02_f64.sin(), 1.2);
        let foot = circle_foot(&p, &at(-0.1), &at(0.0), &at(0.1));
        assert!((foot - at(0.02)).norm() < 1e-13, "{foot}");
    }

    #[test]
    fn degenerate_points_have_a_foot() {
        let x = Vector3::x();
        let p = Vector3::new(0.3, 0.4, 0.0);
        let line = circle_foot(&p, &-x, &Vector3::zeros(), &x);
        assert!((line - Vector3::new(0.3, 0.0, 0.0)).norm() < 1e-15);
        assert_eq!(circle_foot(&p, &x, &x, &x), x);
        let at = |angle: f64| Vector3::new(angle.cos(), angle.sin(), 0.0);
        let centre = circle_foot(&Vector3::zeros(), &at(-0.3), &at(0.0), &at(0.3));
        assert_eq!(centre, at(0.0));
        assert_eq!(tangent_foot(&p, &x, &x), (x, 0.0, 0.0));
    }
}
