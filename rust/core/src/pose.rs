//! Rigid poses and rotations: the one home of every sign convention.
//!
//! Right-handed frames; a positive angle turns right-handed about +X, +Y, +Z. Angular errors are
//! written R(α, β, γ) = Rx(α) Ry(β) Rz(γ). A pose `A_from_B` takes coordinates in B to
//! coordinates in A.

use nalgebra::{Matrix3, Vector3};

/// A direction of the machine frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// +X
    X,
    /// +Y
    Y,
    /// +Z, along the spindle
    Z,
}

impl Direction {
    /// The three directions in order.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// 0, 1, 2 for X, Y, Z.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Unit vector.
    #[must_use]
    pub fn unit(self) -> Vector3<f64> {
        let mut unit = Vector3::zeros();
        unit[self.index()] = 1.0;
        unit
    }

    /// Letter of a turn about this direction: A, B, C (ISO 841).
    #[must_use]
    pub const fn turn_letter(self) -> char {
        ['A', 'B', 'C'][self as usize]
    }

    /// Letter of a travel along this direction: X, Y, Z (ISO 841).
    #[must_use]
    pub const fn travel_letter(self) -> char {
        ['X', 'Y', 'Z'][self as usize]
    }

    /// Right-handed rotation by `angle` (rad) about this direction.
    #[must_use]
    #[inline]
    pub fn rotation(self, angle: f64) -> Matrix3<f64> {
        let (s, c) = sin_cos(angle);
        match self {
            Self::X => Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c),
            Self::Y => Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c),
            Self::Z => Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0),
        }
    }
}

/// Sine and cosine, exact at multiples of 90°: a table at 90° is square to the machine, not square
/// but for 6e-17.
#[must_use]
#[inline]
pub fn sin_cos(angle: f64) -> (f64, f64) {
    let quarters = angle / std::f64::consts::FRAC_PI_2;
    if quarters == nearest(quarters) && quarters.abs() < 1e6 {
        return match (quarters as i64).rem_euclid(4) {
            0 => (0.0, 1.0),
            1 => (1.0, 0.0),
            2 => (0.0, -1.0),
            _ => (-1.0, 0.0),
        };
    }
    angle.sin_cos()
}

/// The nearest whole number, the even one of two, below 2⁵¹: adding 1.5 · 2⁵² leaves no room for a
/// fraction, and needs no call as rounding does.
#[must_use]
#[inline]
pub fn nearest(value: f64) -> f64 {
    let shift = 6_755_399_441_055_744.0;
    (value + shift) - shift
}

/// R(α, β, γ) = Rx(α) Ry(β) Rz(γ), angles in rad.
#[must_use]
pub fn rotation_xyz(alpha: f64, beta: f64, gamma: f64) -> Matrix3<f64> {
    let ((sa, ca), (sb, cb), (sg, cg)) = (sin_cos(alpha), sin_cos(beta), sin_cos(gamma));
    Matrix3::new(
        cb * cg,
        -cb * sg,
        sb,
        ca * sg + sa * sb * cg,
        ca * cg - sa * sb * sg,
        -sa * cb,
        sa * sg - ca * sb * cg,
        sa * cg + ca * sb * sg,
        ca * cb,
    )
}

/// A rigid pose: p ↦ R p + t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// R, a rotation.
    pub rotation: Matrix3<f64>,
    /// t in mm.
    pub translation: Vector3<f64>,
}

impl Pose {
    /// The pose that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// `self` after `inner`: coordinates go through `inner` first.
    #[must_use]
    pub fn then(&self, inner: &Self) -> Self {
        Self {
            rotation: self.rotation * inner.rotation,
            translation: self.rotation * inner.translation + self.translation,
        }
    }

    /// R p + t.
    #[must_use]
    pub fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    /// The point whose image is `point`: Rᵀ (p − t).
    #[must_use]
    pub fn undo(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(&(point - self.translation))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::DEG;

    #[test]
    fn quarter_turns_are_exact() {
        for quarter in -8..=8 {
            let (s, c) = sin_cos(f64::from(quarter) * 90.0 * DEG);
            assert!((s.abs() == 1.0 && c == 0.0) || (c.abs() == 1.0 && s == 0.0));
        }
    }

    #[test]
    fn xyz_is_the_product_of_three_turns() {
        let product =
            Direction::X.rotation(0.1) * Direction::Y.rotation(-0.2) * Direction::Z.rotation(0.3);
        assert!((product - rotation_xyz(0.1, -0.2, 0.3)).norm() < 1e-15);
    }
}
