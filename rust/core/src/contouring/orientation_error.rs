//! Tool-orientation error in real time: rotary positions K_a, K_c that belong to the foot point K;
//! ε_θ = (K_a - P_a, K_c - P_c), eq. (2).

use nalgebra::Vector3;

/// Model of the tool axis at the foot point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrientationModel {
    /// The paper's: the tool axis of the nearest reference point, turned towards that of the
    /// neighbour on K's side in proportion to distance.
    Proposed,
    /// Rotary positions carried back along the tangent by the lag (reconstruction of earlier work:
    /// Lo 2002 was not available).
    Tangent,
}

/// Tool axis at `foot` between the nearest reference point and its neighbour on the foot's side:
/// O_j turned by θ = ∠(O_j, O_n) |K - R_j| / |R_n - R_j|.
///
/// The axis of the turn is **O_j × O_n**. The paper's eq. (4) prints the cross-product matrix of O_j
/// itself, which would turn O_j about itself and change nothing. Parallel tool axes: O_j.
#[must_use]
pub fn turned_tool(
    foot: &Vector3<f64>,
    nearest: (&Vector3<f64>, &Vector3<f64>),
    neighbour: (&Vector3<f64>, &Vector3<f64>),
) -> Vector3<f64> {
    let ((r_j, o_j), (r_n, o_n)) = (nearest, neighbour);
    let normal = o_j.cross(o_n);
    let sine = normal.norm();
    let spacing = (r_n - r_j).norm();
    if sine < 1e-15 || spacing == 0.0 {
        return *o_j;
    }
    let theta = sine.atan2(o_j.dot(o_n)) * (foot - r_j).norm() / spacing;
    // Rodrigues, eq. (3), for an axis square to O_j.
    let (sin, cos) = theta.sin_cos();
    o_j * cos + (normal / sine).cross(o_j) * sin
}

/// Rotary position carried back along the tangent: θ_k - (Δθ/h) λ.
#[must_use]
pub fn tangent_rotary(now: f64, before: f64, step: f64, lag: f64) -> f64 {
    if step == 0.0 { now } else { now - (now - before) / step * lag }
}

/// Angle between two unit vectors, rad.
#[must_use]
pub fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilted(angle: f64) -> Vector3<f64> {
        Vector3::new(angle.sin(), 0.0, angle.cos())
    }

    #[test]
    fn the_tool_turns_in_proportion() {
        let (r0, r1) = (Vector3::zeros(), Vector3::x());
        let o =
            turned_tool(&Vector3::new(0.25, 0.0, 0.0), (&r0, &tilted(0.1)), (&r1, &tilted(0.2)));
        assert!((o - tilted(0.125)).norm() < 1e-15);
    }

    #[test]
    fn turning_about_itself_as_printed_changes_nothing() {
        // Eq. (4) as printed: R = I + K sin θ + K² (1 - cos θ) with K the matrix of O_j.
        let o = tilted(0.3);
        let k = o.cross_matrix();
        let turned = o + k * o * 0.5_f64.sin() + k * k * o * (1.0 - 0.5_f64.cos());
        assert!((turned - o).norm() < 1e-15);
    }

    #[test]
    fn parallel_axes_stay() {
        let (r0, r1) = (Vector3::zeros(), Vector3::x());
        let o = tilted(0.1);
        assert_eq!(turned_tool(&r1, (&r0, &o), (&r1, &o)), o);
        assert_eq!(turned_tool(&r1, (&r0, &o), (&r0, &tilted(0.2))), o);
        assert_eq!(tangent_rotary(1.0, 0.5, 0.0, 0.0), 1.0);
    }
}
