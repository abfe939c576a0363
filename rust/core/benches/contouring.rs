//! Control steps of the coupled five-axis loop, reference samples, whole simulations.

#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use trunnion_core::contouring::simulation::Loop;
use trunnion_core::contouring::{
    Axis, Case, Coupling, Feed, Feedback, Gains, Order, OrientationModel, Path, Piece,
    PositionModel, Reference, Simulation, sweep,
};
use trunnion_core::machine::{FiveAxis, Machine, Places};
use trunnion_core::units::MM_PER_MIN;

/// Eq. (8) of the paper with the tool along the normal of its surface.
fn path() -> Path {
    let mut c = vec![[0.0; 6]; 7];
    c[0] = [0.0, 0.0, 15.0, 0.0, 0.0, 1.0];
    c[1] = [15.0, -80.0, 0.0, 2.0, -0.16, 0.0];
    c[2][2] = -21.4;
    c[3] = [0.0, 80.0, 0.0, 0.0, 0.16, 0.0];
    c[4][2] = 12.8;
    c[6][2] = -6.4;
    let piece = Piece {
        start: 0.0,
        end: 1.0,
        coefficients: c,
        omega: 0.0,
        cosine: [0.0; 6],
        sine: [0.0; 6],
    };
    Path::new(vec![piece]).unwrap()
}

fn coupling() -> Coupling {
    Coupling {
        position: PositionModel::Circle,
        orientation: OrientationModel::Proposed,
        gains: [Gains { proportional: 7.0, integral: 5.5, derivative: 2.5e-4 }; 5],
        order: Order::ControllerLast,
    }
}

fn bench(criterion: &mut Criterion) {
    let path = path();
    let machine = Machine::of_code("[w C' A' b X Y Z t]", 1.0).unwrap();
    let machine = FiveAxis::new(&machine, &Places::default()).unwrap();
    let feed = Feed {
        feed: 1000.0 * MM_PER_MIN,
        acceleration_time: 0.15,
        decelerate: false,
        normal_acceleration: f64::INFINITY,
        dwell: 0.0,
    };
    let reference = Reference::new(&path, feed, 1e-3, &machine).unwrap();
    let axes = [Axis::linear(81.0, 5.7e-3); 5];
    let simulation = Simulation {
        reference: &reference,
        axes,
        feedback: Feedback::Motor,
        coupling: Some(coupling()),
        machine: &machine,
    };
    let steps = reference.len();
    let mut group = criterion.benchmark_group("contouring");
    group.throughput(Throughput::Elements(steps as u64));
    group.bench_function("coupled control steps", |bencher| {
        bencher.iter_batched(
            || Loop::new(&simulation).unwrap(),
            |mut state| {
                for _ in 0..steps {
                    state.step();
                }
                black_box(state.loads())
            },
            BatchSize::SmallInput,
        );
    });
    group.bench_function("reference samples", |bencher| {
        bencher.iter(|| Reference::new(&path, feed, 1e-3, &machine).unwrap());
    });
    let case = Case {
        path: 0,
        feed,
        period: 1e-3,
        axes,
        feedback: Feedback::Motor,
        coupling: Some(coupling()),
    };
    let paths = [path.clone()];
    group.bench_function("steps of whole simulations with true errors", |bencher| {
        bencher.iter(|| sweep(&paths, std::slice::from_ref(&case), &machine, &machine).unwrap());
    });
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
