//! Forward solutions of the hybrid machine with all 17 sensitivities: 100,000 a second on one core
//! are expected.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Vector3;
use trunnion_core::hybrid::{ACTIVE, Closure, Mechanism};

fn forward(criterion: &mut Criterion) {
    let home = Vector3::new(0.0, -350.0, -1400.0);
    let Ok(mechanism) = Mechanism::new(Mechanism::example_dimensions(), home) else { return };
    let geometry = mechanism.with(&[]);
    let poses: Vec<[f64; ACTIVE]> = (0..1000)
        .map(|i| {
            let t = f64::from(i) * 0.1;
            let [a, b, c] = [1100.0, 1130.0, 1100.0];
            let legs = [60.0 * t.sin(), 50.0 * (1.3 * t).cos(), 60.0 * (0.7 * t).sin()];
            [a + legs[0], b + legs[1], c + legs[2], t.sin(), 0.4 * t.cos()]
        })
        .collect();
    let mut group = criterion.benchmark_group("hybrid");
    group.throughput(Throughput::Elements(poses.len() as u64));
    group.bench_function("forward", |bencher| {
        bencher.iter(|| {
            for pose in &poses {
                black_box(mechanism.solve(&geometry, pose, &Closure::default())).ok();
            }
        });
    });
    group.bench_function("forward and 17 sensitivities", |bencher| {
        bencher.iter(|| {
            for pose in &poses {
                let solution = mechanism.solve(&geometry, pose, &Closure::default());
                black_box(solution.map(|s| s.paper_sensitivities(&geometry))).ok();
            }
        });
    });
    group.finish();
}

criterion_group!(benches, forward);
criterion_main!(benches);
