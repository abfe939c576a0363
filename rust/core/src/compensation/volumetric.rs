//! The volumetric error: where the tool point is on the work, minus where the program wants it.
//!
//! The program asks for a point p of the work at rotary positions q. The control sends linear
//! positions l(p, q) from the machine it assumes and the rotary positions q + zeros; the machine
//! as it is puts the tool point in T(q + zeros)⁻¹ actual(l) of the work's frame. Errors of the
//! catalogue do not depend on X, Y, Z beyond the linear gain Λ, so at one set of rotary positions
//! the error is affine in p, exactly: e(p) = M p + t. Its largest length over a box is in a corner
//! (a convex function), its mean square over a grid follows from means and variances of the grid.
//!
//! Between the frames of machine and work only the components change, not the length:
//! |T⁻¹ m − p| = |m − T p|, at A = C = 0 the |p_machine − p| of Kang, Kim and Jee (2022), Table 3.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::Model;
use crate::Result;
use crate::machine::posture::{Joint, linear};
use crate::machine::{Component, MAX_ROTARY, Place, Places, Posture, Side};
use crate::pose::Direction;

/// p ↦ `gain` p + `offset`, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// Derivative, per mm.
    pub gain: Matrix3<f64>,
    /// Value at the origin, mm.
    pub offset: Vector3<f64>,
}

impl Affine {
    const ZERO: Self = Self {
        gain: Matrix3::new(0., 0., 0., 0., 0., 0., 0., 0., 0.),
        offset: Vector3::new(0., 0., 0.),
    };

    const fn constant(offset: Vector3<f64>) -> Self {
        Self { gain: Self::ZERO.gain, offset }
    }

    /// Value at `point`.
    #[must_use]
    pub fn at(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.gain * point + self.offset
    }

    /// `matrix` times this.
    #[must_use]
    pub fn mapped(&self, matrix: &Matrix3<f64>) -> Self {
        Self { gain: matrix * self.gain, offset: matrix * self.offset }
    }

    fn plus(&self, other: &Self) -> Self {
        Self { gain: self.gain + other.gain, offset: self.offset + other.offset }
    }

    fn shifted(&self, offset: &Vector3<f64>) -> Self {
        Self { gain: self.gain, offset: self.offset + offset }
    }

    /// axis × (this − origin).
    fn turned(&self, axis: &Vector3<f64>, origin: &Vector3<f64>) -> Self {
        self.shifted(&-origin).mapped(&axis.cross_matrix())
    }

    /// The twelve numbers row by row: gain | offset.
    #[must_use]
    pub fn rows(&self) -> [f64; 12] {
        std::array::from_fn(
            |i| {
                if i % 4 == 3 { self.offset[i / 4] } else { self.gain[(i / 4, i % 4)] }
            },
        )
    }

    /// From the twelve numbers row by row.
    #[must_use]
    pub fn from_rows(rows: &[f64; 12]) -> Self {
        Self {
            gain: Matrix3::from_fn(|i, j| rows[4 * i + j]),
            offset: Vector3::from_fn(|i, _| rows[4 * i + 3]),
        }
    }

    /// Values at `points` (x, y, z one after the other), in parallel.
    pub fn at_points(&self, points: &[f64], out: &mut [f64]) {
        let chunk = 3 * CHUNK;
        out.par_chunks_mut(chunk).zip(points.par_chunks(chunk)).for_each(|(out, points)| {
            for (out, p) in out.chunks_exact_mut(3).zip(points.chunks_exact(3)) {
                let value = self.at(&Vector3::new(p[0], p[1], p[2]));
                out.copy_from_slice(value.as_slice());
            }
        });
    }

    /// Values on the grid x × y × z, z fastest, in parallel.
    pub fn on_grid(&self, x: &[f64], y: &[f64], z: &[f64], out: &mut [f64]) {
        let line = 3 * z.len();
        if line == 0 || y.is_empty() {
            return;
        }
        out.par_chunks_mut(line * y.len()).zip(x).for_each(|(out, &x)| {
            for (out, &y) in out.chunks_exact_mut(line).zip(y) {
                let start = self.at(&Vector3::new(x, y, 0.0));
                let along = self.gain.column(2);
                for (out, &z) in out.chunks_exact_mut(3).zip(z) {
                    for i in 0..3 {
                        out[i] = along[i].mul_add(z, start[i]);
                    }
                }
            }
        });
    }
}

/// Points that one task of a parallel loop takes.
const CHUNK: usize = 4096;

/// A box of the work space with its grid, as far as maximum and mean square depend on it.
#[derive(Clone, Copy, Debug)]
pub struct Volume {
    low: Vector3<f64>,
    high: Vector3<f64>,
    mean: Vector3<f64>,
    variance: Vector3<f64>,
}

impl Volume {
    /// The grid x × y × z.
    #[must_use]
    pub fn new(grid: [&[f64]; 3]) -> Self {
        let each = |value: fn(&[f64]) -> f64| Vector3::from_fn(|i, _| value(grid[i]));
        Self {
            low: each(|axis| axis.iter().copied().fold(f64::INFINITY, f64::min)),
            high: each(|axis| axis.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
            mean: each(mean),
            variance: each(|axis| {
                let centre = mean(axis);
                axis.iter().map(|v| (v - centre).powi(2)).sum::<f64>() / axis.len().max(1) as f64
            }),
        }
    }

    /// Largest length of the field over the box, mm: in one of the corners.
    #[must_use]
    pub fn largest(&self, field: &Affine) -> f64 {
        (0..8)
            .map(|corner: usize| {
                let point =
                    Vector3::from_fn(
                        |i, _| {
                            if corner >> i & 1 == 0 { self.low[i] } else { self.high[i] }
                        },
                    );
                field.at(&point).norm()
            })
            .fold(0.0, f64::max)
    }

    /// Mean square of the length of the field over the grid, mm².
    #[must_use]
    pub fn mean_square(&self, field: &Affine) -> f64 {
        let spread: f64 =
            (0..3).map(|j| field.gain.column(j).norm_squared() * self.variance[j]).sum();
        field.at(&self.mean).norm_squared() + spread
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// What the control assumes: the machine of its kinematic transformation, and the zeros that it
/// adds to the rotary positions it sends (rad).
#[derive(Clone, Debug)]
pub struct Control {
    /// The assumed machine.
    pub model: Model,
    /// Added to commanded rotary positions.
    pub zeros: [f64; MAX_ROTARY],
}

/// Machine and control at one set of rotary positions.
pub struct ControlledPose<'a> {
    truth: &'a Model,
    control: &'a Control,
    places: Places,
    rates: Vec<crate::effects::Rate>,
    posture: Posture,
    assumed: Posture,
    /// From the position that the control assumes to reach to X, Y, Z that are right for it.
    assumed_inverse: Matrix3<f64>,
    nominal: Posture,
    /// Recorded position of the tool point as a function of p.
    recorded: Affine,
    /// Actual position of the tool point, machine frame, as a function of p.
    actual: Affine,
}

impl<'a> ControlledPose<'a> {
    /// At commanded rotary positions, rad.
    ///
    /// # Errors
    /// The assumed I + Λ is singular.
    pub fn new(truth: &'a Model, control: &'a Control, commanded: &[f64]) -> Result<Self> {
        let mut sent = [0.0; MAX_ROTARY];
        for ((slot, position), zero) in sent.iter_mut().zip(commanded).zip(&control.zeros) {
            *slot = position + zero;
        }
        let sent = &sent[..commanded.len()];
        let machine = truth.machine();
        let mut rates = Vec::new();
        let places = truth.places_and_rates(sent, Some(&mut rates));
        let posture = Posture::new(machine, sent, &places);
        let nominal = Posture::new(machine, commanded, &machine.nominal());
        let assumed_places = control.model.places(commanded);
        let assumed = Posture::new(machine, commanded, &assumed_places);
        let assumed_inverse =
            (Matrix3::identity() + linear(&assumed_places)).try_inverse().ok_or_else(|| {
                crate::Error::Kinematics(
                    "errors of the linear axes leave no inverse: I + Λ is singular".into(),
                )
            })?;
        let shift = assumed.artefact.translation - assumed.head_shift - offset(&assumed_places);
        let assumed_field = Affine { gain: assumed.artefact.rotation, offset: shift };
        let recorded = assumed_field
            .mapped(&assumed_inverse)
            .shifted(&(posture.head_nominal - assumed.head_nominal));
        let gain = Matrix3::identity() + linear(&places);
        let actual = recorded.mapped(&gain).shifted(&(offset(&places) + posture.head_shift));
        Ok(Self {
            truth,
            control,
            places,
            rates,
            posture,
            assumed,
            assumed_inverse,
            nominal,
            recorded,
            actual,
        })
    }

    /// A change of the tool point in the machine frame, in the frame of the work.
    fn on_work(&self, change: &Affine) -> Affine {
        change.mapped(&self.posture.artefact.rotation.transpose())
    }

    /// Error of the tool point in the frame of the work, mm, as a function of p.
    #[must_use]
    pub fn error(&self) -> Affine {
        let pose = &self.posture.artefact;
        let mut error = self.on_work(&self.actual.shifted(&-pose.translation));
        error.gain -= Matrix3::identity();
        error
    }

    /// Angle between the tool's direction on the work and the one that the program means, rad.
    #[must_use]
    pub fn direction_error(&self) -> f64 {
        let direction = |posture: &Posture| {
            posture.artefact.rotation.tr_mul(&(posture.head.rotation * Vector3::z()))
        };
        let (is, expected) = (direction(&self.posture), direction(&self.nominal));
        is.cross(&expected).norm().atan2(is.dot(&expected))
    }

    /// Derivatives of the error with respect to the parameters of the machine as it is, in the
    /// order of [`Model::parameters`], per mm or rad: exact.
    #[must_use]
    pub fn truth_rates(&self) -> Vec<Affine> {
        let machine = self.truth.machine();
        let errors = self.truth.errors.iter().map(|error| {
            let places = machine.places_of(error);
            let rates = places.iter().map(|(place, factor)| self.place_rate(*place, *factor));
            rates.fold(Affine::ZERO, |sum, rate| sum.plus(&rate))
        });
        let mut all: Vec<Affine> = errors.collect();
        let first = all.len();
        all.resize(first + self.truth.values.len(), Affine::ZERO);
        for rate in &self.rates {
            let slot = &mut all[first + rate.parameter];
            *slot = slot.plus(&self.place_rate(rate.place, rate.rate));
        }
        all
    }

    /// Derivative with respect to the amount at a place of the machine, times `factor`.
    fn place_rate(&self, place: Place, factor: f64) -> Affine {
        let mut unit = Affine::ZERO;
        for (axis, rotary) in self.truth.machine().rotary().iter().enumerate() {
            for component in Component::ALL {
                if place == Place::frame(axis, component) {
                    unit = self.joint_rate(&self.posture.joints[axis], component, rotary.side);
                }
            }
            if place == Place::turn(axis) {
                unit = self.turn_rate(axis, rotary.side);
            }
        }
        for row in Direction::ALL {
            if place == Place::offset(row) {
                unit = Affine::constant(row.unit());
            }
            for column in Direction::ALL {
                if place == Place::linear(row, column) {
                    let pick = row.unit() * column.unit().transpose();
                    unit = self.recorded.mapped(&pick);
                }
            }
        }
        self.on_work(&Affine { gain: unit.gain * factor, offset: unit.offset * factor })
    }

    /// Displacement of the tool relative to the work, machine frame, for a unit rate of a joint.
    fn joint_rate(&self, joint: &Joint, component: Component, side: Side) -> Affine {
        match (component, side) {
            (Component::Offset(along), Side::Workpiece) => {
                Affine::constant(-joint.carrier.column(along.index()))
            }
            (Component::Offset(along), Side::Tool) => {
                Affine::constant(joint.carrier.column(along.index()).into())
            }
            (Component::Tilt(about), _) => {
                self.rotation_rate(joint, &joint.tilts.column(about.index()).into(), side)
            }
        }
    }

    fn turn_rate(&self, axis: usize, side: Side) -> Affine {
        let joint = &self.posture.joints[axis];
        self.rotation_rate(joint, &joint.turn, side)
    }

    fn rotation_rate(&self, joint: &Joint, axis: &Vector3<f64>, side: Side) -> Affine {
        match side {
            Side::Workpiece => self.actual.turned(&-axis, &joint.origin),
            Side::Tool => Affine::constant(axis.cross(&(self.posture.tool - joint.origin))),
        }
    }

    /// Derivatives of the error with respect to what a control has parameters for, in the order of
    /// [`parameters`], per rad or mm. Exact but for the change of effects with a
    /// changed zero (a part in 10⁴).
    #[must_use]
    pub fn control_rates(&self) -> Vec<Affine> {
        let machine = self.truth.machine();
        let gain = Matrix3::identity() + linear(&self.places);
        let zeros = machine.rotary().iter().enumerate().map(|(axis, rotary)| {
            let turn = self.turn_rate(axis, rotary.side);
            let spare = match rotary.side {
                Side::Workpiece => Vector3::zeros(),
                Side::Tool => {
                    let joint = &self.nominal.joints[axis];
                    linear(&self.places) * joint.turn.cross(&(self.nominal.tool - joint.origin))
                }
            };
            turn.shifted(&spare)
        });
        let centres = self.control.model.errors.iter().filter_map(|error| {
            let mut sum = Vector3::zeros();
            for (place, factor) in machine.places_of(error) {
                for (axis, rotary) in machine.rotary().iter().enumerate() {
                    let sign = if rotary.side == Side::Workpiece { factor } else { -factor };
                    for along in Direction::ALL {
                        if place == Place::frame(axis, Component::Offset(along)) {
                            let carrier = &self.assumed.joints[axis].carrier;
                            sum += carrier.column(along.index()) * sign;
                        }
                    }
                }
            }
            (error.unit() == crate::units::Unit::Um)
                .then(|| Affine::constant(gain * self.assumed_inverse * sum))
        });
        let work = Direction::ALL.into_iter().map(|along| {
            let carrier = &self.assumed.placement.carrier;
            Affine::constant(gain * self.assumed_inverse * carrier.column(along.index()))
        });
        zeros.chain(centres).chain(work).map(|rate| self.on_work(&rate)).collect()
    }
}

/// What a control has parameters for: a zero of each rotary axis ("zero_A", arcsec), the centres of
/// the axes under the names of their offsets ("EY0A", µm), the origin of the work ("dx" ..., µm).
#[must_use]
pub fn parameters(model: &Model) -> Vec<String> {
    let zeros = model.machine().rotary().iter().map(|axis| format!("zero_{}", axis.letter()));
    let centres = model.errors.iter().filter(|e| e.unit() == crate::units::Unit::Um);
    let work = ["dx", "dy", "dz"].map(str::to_owned);
    zeros.chain(centres.map(crate::machine::LocationError::name)).chain(work).collect()
}

fn offset(places: &Places) -> Vector3<f64> {
    Vector3::from_column_slice(places.offset())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;

    /// Random errors of Kang, Kim and Jee (2022), Table 2.
    const TABLE_2: [(&str, f64); 8] = [
        ("EA0A", 21.6),
        ("EB0A", 18.0),
        ("EC0A", 10.8),
        ("EB0C", 25.2),
        ("EX0C", 15.0),
        ("EY0A", 17.0),
        ("EZ0A", 12.0),
        ("EY0C", 21.0),
    ];

    fn model(errors: &[(&str, f64)]) -> Model {
        let mut model = Model::nominal(Machine::of_code("[w C' A' b X Y Z t]", 150.0).unwrap());
        for (name, value) in errors {
            let error = model.machine().location_error(name).unwrap();
            model.add_error(&error, value * error.unit().to_internal()).unwrap();
        }
        model
    }

    fn volume() -> Volume {
        Volume::new([&[-150.0, 150.0], &[-120.0, 120.0], &[0.0, 75.0, 150.0]])
    }

    #[test]
    fn the_largest_error_before_compensation_is_that_of_table_3() {
        let truth = model(&TABLE_2);
        let control = Control { model: model(&[]), zeros: [0.0; MAX_ROTARY] };
        let error = ControlledPose::new(&truth, &control, &[0.0, 0.0]).unwrap().error();
        assert!((volume().largest(&error) - 0.050_768).abs() < 5e-7);
    }

    #[test]
    fn errors_set_at_once_are_those_added_by_name() {
        let machine = Machine::of_code("[w C' A' b X Y Z t]", 150.0).unwrap();
        let named = |name: &str| TABLE_2.iter().find(|(given, _)| *given == name).unwrap().1;
        let amounts: Vec<f64> = machine
            .location_errors()
            .iter()
            .map(|error| named(&error.name()) * error.unit().to_internal())
            .collect();
        let mut at_once = model(&[("EX0C", 500.0)]);
        at_once.set_placement(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
        at_once.set_errors(&amounts).unwrap();
        let control = Control { model: model(&[]), zeros: [0.0; MAX_ROTARY] };
        let field =
            |truth: &Model| ControlledPose::new(truth, &control, &[0.3, -2.0]).unwrap().error();
        assert!(volume().largest(&field(&at_once)) > 0.01);
        assert_eq!(field(&at_once), field(&model(&TABLE_2)));
        assert!(at_once.set_errors(&amounts[1..]).is_err());
        assert!(at_once.set_errors(&[f64::NAN; 8]).is_err());
    }

    #[test]
    fn a_control_that_knows_the_machine_leaves_no_error_of_the_point() {
        let truth = model(&TABLE_2);
        let control = Control { model: model(&TABLE_2), zeros: [0.0; MAX_ROTARY] };
        for rotary in [[0.0, 0.0], [1.5, -2.0], [-1.0, 7.0]] {
            let pose = ControlledPose::new(&truth, &control, &rotary).unwrap();
            assert!(volume().largest(&pose.error()) < 1e-12);
            assert!(pose.direction_error() > 1e-5);
        }
    }

    #[test]
    fn statistics_are_those_of_the_grid() {
        let truth = model(&TABLE_2);
        let control = Control { model: model(&[]), zeros: [0.0; MAX_ROTARY] };
        let field = ControlledPose::new(&truth, &control, &[0.4, 1.0]).unwrap().error();
        let (x, y, z) = ([-150.0, 150.0], [-120.0, 120.0], [0.0, 75.0, 150.0]);
        let mut values = vec![0.0; 3 * 12];
        field.on_grid(&x, &y, &z, &mut values);
        let squares: Vec<f64> =
            values.chunks_exact(3).map(|v| v.iter().map(|c| c * c).sum()).collect();
        let largest = squares.iter().copied().fold(0.0, f64::max).sqrt();
        assert!((largest - volume().largest(&field)).abs() < 1e-15);
        let mean = squares.iter().sum::<f64>() / squares.len() as f64;
        assert!((mean - volume().mean_square(&field)).abs() < 1e-15);
    }

    #[test]
    fn only_effects_of_the_machine_are_taken() {
        let machine = Machine::of_code("[w C' A' b X Y Z t]", 150.0).unwrap();
        let artefact = crate::artefact::Artefact::of("cross", &[100.0, 25.0, 25.0]).unwrap();
        let catalogue = crate::effects::catalogue(&machine, &artefact);
        let mut model = Model::nominal(machine);
        for effect in catalogue {
            let of_machine = effect.owner == crate::effects::Owner::Machine;
            let values = vec![1.0; effect.parameters.len()];
            assert_eq!(model.add_effect(effect, &values).is_ok(), of_machine);
        }
    }
}
