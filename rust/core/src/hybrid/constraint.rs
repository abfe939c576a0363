//! Over-constraint: the Jacobian of all twelve loop equations by all thirteen joints.

use nalgebra::{SMatrix, Vector3};

use super::parameter::{ACTIVE, PASSIVE};
use super::posture::{LOOP_LEGS, Posture, Reach, Twist};
use super::solution::Solution;

/// Equations of two loops: position and orientation of each.
pub const LOOP_EQUATIONS: usize = 12;
/// Y, L1, L2, L3 and the two outer platform revolutes.
pub const LOOP_JOINTS: usize = PASSIVE + 3 + 2;
/// Lever (mm) that makes lengths of the three orientation equations.
pub const LEVER_MM: f64 = 1000.0;
/// Singular values below this fraction of the largest count as zero.
const RANK_TOLERANCE: f64 = 1e-10;

/// Force and moment that one loop carries without any load from outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopWrench {
    /// Force of the leg's end on the platform, machine frame.
    pub force: [f64; 3],
    /// Moment about the seat, times mm, machine frame.
    pub moment: [f64; 3],
}

/// What the loops' full Jacobian says at a posture.
#[derive(Clone, Debug, PartialEq)]
pub struct Constraint {
    /// Rank of the 12 × 13 Jacobian.
    pub rank: usize,
    /// Degrees of freedom: joints minus rank.
    pub mobility: usize,
    /// Singular values, largest first; rows of orientation times [`LEVER_MM`], mm per mm or rad.
    pub singular_values: [f64; LOOP_EQUATIONS],
    /// States of self-stress: for each, the wrenches in the loops of leg 1 and leg 3, of unit size
    /// (moments divided by [`LEVER_MM`]). One for each redundant equation.
    pub self_stress: Vec<[LoopWrench; 2]>,
}

impl Constraint {
    /// At a solution.
    #[must_use]
    pub fn at(solution: &Solution) -> Self {
        let jacobian = loop_jacobian(&solution.posture);
        // Twelve rows, thirteen columns: the left vectors come from the SVD as U.
        let svd = jacobian.svd(true, false);
        let mut order: Vec<usize> = (0..LOOP_EQUATIONS).collect();
        order.sort_by(|&i, &j| svd.singular_values[j].total_cmp(&svd.singular_values[i]));
        let values: [f64; LOOP_EQUATIONS] = std::array::from_fn(|k| svd.singular_values[order[k]]);
        let rank = values.iter().filter(|&&v| v > RANK_TOLERANCE * values[0]).count();
        let self_stress = svd.u.map_or_else(Vec::new, |u| {
            order[rank..]
                .iter()
                .map(|&k| {
                    let column = u.column(k);
                    [0, 1].map(|side| {
                        let at = 6 * side;
                        LoopWrench {
                            force: [column[at], column[at + 1], column[at + 2]],
                            moment: [3, 4, 5].map(|row| column[at + row] * LEVER_MM),
                        }
                    })
                })
                .collect()
        });
        Self { rank, mobility: LOOP_JOINTS - rank, singular_values: values, self_stress }
    }
}

/// Seat minus end of each loop: velocity of the point (3) and turn times [`LEVER_MM`] (3).
#[must_use]
pub fn loop_jacobian(posture: &Posture) -> SMatrix<f64, LOOP_EQUATIONS, LOOP_JOINTS> {
    let mut jacobian = SMatrix::<f64, LOOP_EQUATIONS, LOOP_JOINTS>::zeros();
    let mut put = |column: usize, twist: &Twist, reach: Reach| {
        for side in 0..2 {
            let (point, sign) = match reach {
                Reach::Central => (posture.seats[side].translation, 1.0),
                Reach::Seat(at) if at == side => (posture.seats[side].translation, 1.0),
                Reach::Leg(at) if at == side => (posture.ends[side].translation, -1.0),
                Reach::Seat(_) | Reach::Leg(_) | Reach::Wrist => continue,
            };
            let velocity: Vector3<f64> = twist.at(&point) * sign;
            let turn = twist.turn * (sign * LEVER_MM);
            jacobian.fixed_view_mut::<3, 1>(6 * side, column).copy_from(&velocity);
            jacobian.fixed_view_mut::<3, 1>(6 * side + 3, column).copy_from(&turn);
        }
    };
    for (joint, twist) in posture.passive.iter().enumerate() {
        put(joint, twist, Posture::passive_reach(joint));
    }
    for (joint, twist) in posture.active.iter().enumerate().take(ACTIVE - 2) {
        put(PASSIVE + joint, twist, Posture::active_reach(joint));
    }
    for side in 0..LOOP_LEGS.len() {
        put(PASSIVE + 3 + side, &posture.revolute(side), Reach::Leg(side));
    }
    jacobian
}
