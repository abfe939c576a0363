//! The room as a whole: closed-form inverse against Newton, derivatives against differences of the
//! full solution, the facts of the over-constraint.

use nalgebra::Vector3;
use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng, SeedableRng};

use super::batch::Batch;
use super::*;
use crate::Error;
use crate::units::{ARCSEC, DEG, UM, Unit};

fn example() -> Mechanism {
    Mechanism::new(Mechanism::example_dimensions(), Vector3::new(0.0, -350.0, -1400.0)).unwrap()
}

const POSE_A: [f64; ACTIVE] = [1100.0, 1150.0, 1100.0, 0.0, 18.0 * DEG];
const POSE_B: [f64; ACTIVE] = [1180.0, 1120.0, 1060.0, 25.0 * DEG, -15.0 * DEG];

/// Uniform in (−1, 1).
fn uniform(random: &mut Pcg64) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

fn random_active(random: &mut Pcg64) -> [f64; ACTIVE] {
    let [a, b, c] = [1100.0, 1130.0, 1100.0].map(|l| l + 60.0 * uniform(random));
    [a, b, c, 1.5 * uniform(random), 0.5 * uniform(random)]
}

#[test]
fn newton_from_home_reaches_the_poses_of_the_notes() {
    let mechanism = example();
    let geometry = mechanism.with(&[]);
    for (active, tip) in [
        (POSE_A, Vector3::new(0.0, -374.452497, -1415.817953)),
        (POSE_B, Vector3::new(186.708307, -277.502561, -1452.201914)),
    ] {
        let solution = mechanism.solve(&geometry, &active, &Closure::default()).unwrap();
        assert!((solution.posture.tip() - tip).norm() < 1e-6);
        assert!(solution.steps <= 6, "{}", solution.steps);
    }
}

#[test]
fn closed_form_inverse_undoes_the_forward_solution_on_both_branches() {
    let mechanism = example();
    let geometry = mechanism.with(&[]);
    let mut random = Pcg64::seed_from_u64(1);
    for _ in 0..50 {
        let active = random_active(&mut random);
        let solution = mechanism.solve(&geometry, &active, &Closure::default()).unwrap();
        let pose =
            ToolPose { tip: *solution.posture.tip(), direction: solution.posture.direction() };
        let inverse = mechanism.nominal_inverse(&pose, 0.0).unwrap();
        for (found, is) in inverse.passive.iter().zip(solution.joints.passive) {
            assert!((found - is).abs() < 1e-11, "{found} {is}");
        }
        let branch = if active[4] < 0.0 { Branch::Negative } else { Branch::Positive };
        for (found, is) in inverse.branch(branch).iter().zip(active) {
            assert!((found - is).abs() < 1e-9, "{found} {is}");
        }
        for branch in &inverse.active {
            let again = mechanism.solve(&geometry, branch, &Closure::default()).unwrap();
            assert!((again.posture.tip() - pose.tip).norm() < 1e-9);
            assert!((again.posture.direction() - pose.direction).norm() < 1e-12);
        }
    }
}

#[test]
fn every_derivative_agrees_with_differences_of_the_full_solution() {
    let mechanism = example();
    let mut random = Pcg64::seed_from_u64(2);
    // Weighted least squares is differenced for the 17, which leave no strain; the paper's eight
    // equations close exactly, so there every component at every place can be differenced.
    for (closure, all) in [(Closure::default(), false), (Closure::PAPER, true)] {
        for _ in 0..4 {
            let active = random_active(&mut random);
            let mut errors: Vec<(Parameter, f64)> = Parameter::paper()
                .into_iter()
                .map(|p| (p, uniform(&mut random) * if p.unit() == Unit::Um { 2.0 } else { 2e-3 }))
                .collect();
            if all {
                errors.extend(Parameter::outside().map(|p| (p, 1e-3 * uniform(&mut random))));
            }
            let geometry = mechanism.with(&errors);
            let solution = mechanism.solve(&geometry, &active, &closure).unwrap();
            let differential = solution.differential(&geometry);
            for i in 0..errors.len() {
                let parameter = errors[i].0;
                let step = if parameter.unit() == Unit::Um { 0.3 } else { 3e-4 };
                // Five points over a wide step: truncation (0.3/1000)⁴, rounding 1e-12/0.3.
                let at = |factor: f64| {
                    let mut moved = errors.clone();
                    moved[i].1 += factor * step;
                    mechanism.solve(&mechanism.with(&moved), &active, &closure).unwrap()
                };
                let [m2, m1, p1, p2] = [-2.0, -1.0, 1.0, 2.0].map(at);
                let five = |m2: f64, m1: f64, p1: f64, p2: f64| {
                    (m2 - 8.0 * m1 + 8.0 * p1 - p2) / (12.0 * step)
                };
                let found = differential.of(parameter);
                let scale = found.tool.fixed_rows::<3>(0).norm().max(1.0);
                for k in 0..3 {
                    let tip = |s: &Solution| s.posture.tip()[k];
                    let difference = five(tip(&m2), tip(&m1), tip(&p1), tip(&p2));
                    let off = (found.tool[k] - difference).abs() / scale;
                    assert!(off < 1e-8, "{} tip {k}: {off:e}", parameter.name());
                }
                for k in 0..PASSIVE {
                    let joint = |s: &Solution| s.joints.passive[k];
                    let difference = five(joint(&m2), joint(&m1), joint(&p1), joint(&p2));
                    let scale = found.passive.norm().max(1e-3);
                    let off = (found.passive[k] - difference).abs() / scale;
                    assert!(off < 1e-8, "{} joint {k}: {off:e}", parameter.name());
                }
                let turn: Vector3<f64> = found.tool.fixed_rows::<3>(3).into();
                let swing = turn.cross(&solution.posture.direction());
                for k in 0..3 {
                    let direction = |s: &Solution| s.posture.direction()[k];
                    let difference =
                        five(direction(&m2), direction(&m1), direction(&p1), direction(&p2));
                    let off = (swing[k] - difference).abs() / turn.norm().max(1e-3);
                    assert!(off < 1e-8, "{} direction {k}: {off:e}", parameter.name());
                }
            }
        }
    }
}

#[test]
fn readings_along_a_path_are_those_of_each_row_by_itself() {
    let mechanism = example();
    let mut random = Pcg64::seed_from_u64(5);
    let errors: Vec<_> = Parameter::paper()
        .into_iter()
        .map(|p| (p, uniform(&mut random) * if p.unit() == Unit::Um { 0.05 } else { 1e-4 }))
        .collect();
    let parameters: Vec<_> = Parameter::paper().into_iter().chain(Parameter::outside()).collect();
    let closure = Closure::default();
    let batch = Batch { mechanism: &mechanism, geometry: mechanism.with(&errors), closure };
    // a slow path, longer than a run, and then jumps
    let mut joints: Vec<[f64; ACTIVE]> = (0..300)
        .map(|row| {
            let (s, c) = (f64::from(row) * 0.01).sin_cos();
            [1100.0 + 60.0 * s, 1130.0 + 60.0 * c, 1100.0 - 60.0 * s, 0.1 * s, 0.2 * c]
        })
        .collect();
    joints.extend((0..40).map(|_| random_active(&mut random)));
    let centre = Vector3::new(0.0, -350.0, -1300.0);
    let centres = [centre.x, centre.y, centre.z].repeat(joints.len());
    let rows = batch.ballbar(&joints.concat(), &centres, &parameters).unwrap();
    for (own, row) in joints.iter().zip(rows.chunks_exact(4 + parameters.len())) {
        let solution = mechanism.solve(&batch.geometry, own, &closure).unwrap();
        let bar = solution.posture.tip() - centre;
        assert!((row[0] - bar.norm()).abs() < 1e-10, "{own:?}");
        let differential = solution.differential(&batch.geometry);
        for (&parameter, found) in parameters.iter().zip(&row[4..]) {
            let tip = differential.of(parameter).tool.fixed_rows::<3>(0).into_owned();
            let expected = tip.dot(&bar) / bar.norm();
            let off = (found - expected).abs() / tip.norm().max(1.0);
            // rounding of a metre's lever, times the condition of the loops
            assert!(off < 1e-10, "{}: {off:e}", parameter.name());
        }
    }
}

#[test]
fn ten_independent_equations_hold_three_freedoms_and_two_states_of_self_stress() {
    let mechanism = example();
    let mut random = Pcg64::seed_from_u64(3);
    for _ in 0..10 {
        let active = random_active(&mut random);
        let solution = mechanism.solve(&mechanism.with(&[]), &active, &Closure::default()).unwrap();
        let constraint = Constraint::at(&solution);
        assert_eq!((constraint.rank, constraint.mobility), (10, 3));
        assert_eq!(constraint.self_stress.len(), 2);
        assert!(constraint.singular_values[9] > 1e-3 * constraint.singular_values[0]);
    }
}

#[test]
fn the_paper_s_errors_leave_no_strain_and_others_do() {
    let mechanism = example();
    let mut random = Pcg64::seed_from_u64(4);
    for _ in 0..20 {
        let active = random_active(&mut random);
        let errors: Vec<_> = Parameter::paper()
            .into_iter()
            .map(|p| (p, uniform(&mut random) * if p.unit() == Unit::Um { 2.0 } else { 2e-3 }))
            .collect();
        let geometry = mechanism.with(&errors);
        let solution = mechanism.solve(&geometry, &active, &Closure::default()).unwrap();
        for residual in solution.residuals() {
            assert!(residual.gap.iter().all(|gap| gap.abs() < 1e-11));
            assert!(residual.along.abs() < 2e-13 && residual.about.abs() < 2e-13);
        }
    }
    // The notes' two examples, at pose A under the paper's eight equations.
    for (name, value, strain) in
        [("base3_y_um", 10.0 * UM, 1.76), ("base3_c_arcsec", 10.0 * ARCSEC, 10.2)]
    {
        let geometry = mechanism.with(&[(Parameter::parse(name).unwrap(), value)]);
        let solution = mechanism.solve(&geometry, &POSE_A, &Closure::PAPER).unwrap();
        let about = solution.residuals().map(|r| r.about / ARCSEC);
        let largest = about[0].abs().max(about[1].abs());
        assert!((largest - strain).abs() < 0.05, "{name}: {about:?}");
    }
}

#[test]
fn strained_least_squares_is_off_by_its_stated_order_only() {
    // The curvature term left out is of relative size strain / leg: 10 µm in 1100 mm.
    let mechanism = example();
    let parameter = Parameter::parse("base3_y_um").unwrap();
    let at = |value: f64| {
        let geometry = mechanism.with(&[(parameter, value)]);
        mechanism.solve(&geometry, &POSE_B, &Closure::default()).unwrap()
    };
    let step = 1e-3;
    let centre = 10.0 * UM;
    let difference =
        (at(centre + step).posture.tip() - at(centre - step).posture.tip()) / (2.0 * step);
    let geometry = mechanism.with(&[(parameter, centre)]);
    let found = at(centre).differential(&geometry).of(parameter).tool;
    let off = (difference - found.fixed_rows::<3>(0)).norm() / difference.norm();
    assert!(off < 3e-5, "{off:e}");
}

#[test]
fn the_inverse_of_the_erroneous_machine_reaches_the_pose() {
    let mechanism = example();
    let errors: Vec<_> = Parameter::paper()
        .into_iter()
        .enumerate()
        .map(|(i, p)| (p, if p.unit() == Unit::Um { 0.1 * (i as f64 - 8.0) } else { 1e-4 }))
        .collect();
    let geometry = mechanism.with(&errors);
    let pose = ToolPose { tip: Vector3::new(60.0, -320.0, -1420.0), direction: -Vector3::z() };
    for start in mechanism.nominal_inverse(&pose, 0.0).unwrap().active {
        let solution = mechanism.inverse(&geometry, &pose, &start, &Closure::default()).unwrap();
        assert!((solution.posture.tip() - pose.tip).norm() < 1e-9);
        assert!((solution.posture.direction() - pose.direction).norm() < 1e-11);
    }
}

#[test]
fn failures_say_what_is_wrong() {
    let mechanism = example();
    let geometry = mechanism.with(&[]);
    let fail =
        |active: [f64; ACTIVE]| match mechanism.solve(&geometry, &active, &Closure::default()) {
            Err(Error::Kinematics(message)) => message,
            other => panic!("{active:?}: {other:?}"),
        };
    assert!(fail([300.0, 2500.0, 300.0, 0.0, 0.0]).contains("out of reach"));
    assert!(fail([100.0, 1100.0, 1900.0, 0.0, 0.0]).contains("out of reach"));
    let not_finite = mechanism.solve(&geometry, &[f64::NAN; ACTIVE], &Closure::default());
    assert!(matches!(not_finite, Err(Error::Input { .. })));
}

#[test]
fn another_mechanism_with_offsets_of_its_own_works_as_well() {
    let mut dimensions = Mechanism::example_dimensions();
    for (i, value) in [(0, 3.0), (1, -5.0), (2, 4.0), (3, 300.0), (7, 500.0), (8, 150.0)] {
        dimensions[i] = value;
    }
    for (i, value) in [(9, 100.0), (10, 170.0), (11, 12.0), (12, 150.0), (13, 2.0), (14, 180.0)] {
        dimensions[i] = value;
    }
    let mechanism = Mechanism::new(dimensions, Vector3::new(0.0, -250.0, -1100.0)).unwrap();
    let geometry = mechanism.with(&[]);
    let [l1, l2, l3] = *mechanism.home_legs();
    let active = [l1 + 30.0, l2 - 20.0, l3 - 10.0, 0.4, -0.2];
    let solution = mechanism.solve(&geometry, &active, &Closure::default()).unwrap();
    assert!(solution.residuals().iter().all(|r| r.along.abs() < 1e-12 && r.about.abs() < 1e-12));
    assert_eq!(Constraint::at(&solution).rank, 10);
    let pose = ToolPose { tip: *solution.posture.tip(), direction: solution.posture.direction() };
    let refused = mechanism.nominal_inverse(&pose, 0.0);
    assert!(matches!(refused, Err(Error::Input { .. })));
    let again = mechanism.inverse(&geometry, &pose, &active, &Closure::default()).unwrap();
    assert!((again.posture.tip() - pose.tip).norm() < 1e-9);
}

#[test]
fn names_are_read_back() {
    for parameter in Parameter::paper().into_iter().chain(Parameter::outside()) {
        assert_eq!(Parameter::parse(&parameter.name()).unwrap(), parameter);
    }
    assert_eq!(Parameter::parse("E5").unwrap(), Parameter::Paper(4));
    assert!(Parameter::parse("e18").is_err());
}
