//! The hot paths: kinematics, contact, a whole virtual calibration, an identification.
//!
//! One thread each; `cargo bench -p trunnion-core`, or with a name after `--` only that one.

use std::error::Error;
use std::hint::black_box;

use criterion::{Criterion, Throughput};
use nalgebra::Vector3;
use trunnion_core::artefact::Layout;
use trunnion_core::artefact::{Artefact, Fixture, Line, Search};
use trunnion_core::identification::least_squares::{self, Options};
use trunnion_core::machine::batch::{ForwardBatch, TOOL};
use trunnion_core::machine::kinematics::AxisPositions;
use trunnion_core::machine::{Machine, Places};
use trunnion_core::moves::Moves;
use trunnion_core::plan::collision::Stylus;
use trunnion_core::plan::{Arrangement, PlanOptions, PlanRequest, PlannedTouch, plan};
use trunnion_core::probe::Probe;
use trunnion_core::studies::{self, Measurement};
use trunnion_core::touch::{Simulation, TouchModel};
use trunnion_core::units::{DEG, UM};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Table 2 of the paper and a placement, µm and arcsec.
const TRUTH: [f64; 14] =
    [3.6, 18.0, 10.8, 17.0, 20.0, 25.2, 15.0, 21.0, 40.0, -30.0, 20.0, 15.0, -25.0, 30.0];

/// The paper's 72 touches of the cross.
struct Paper {
    model: TouchModel,
    rotary: Vec<f64>,
    start: Vec<f64>,
    direction: Vec<f64>,
    labels: Vec<i64>,
}

impl Paper {
    fn new() -> Outcome<Self> {
        let machine = Machine::of_code("[w C' A' b X Y Z t]", 150.0)?;
        let artefact = Artefact::of("cross", &[100.0, 25.0, 25.0])?;
        let options = PlanOptions {
            clearance: 5.0,
            overtravel: 5.0,
            linear_resolution: 1e-4,
            rotary_resolution: 1e-4 * DEG,
            stylus: Stylus { ball_radius: 1.0, stem_radius: 0.5, length: 100.0, body: [0.0; 2] },
            layout: Layout::Side,
            all_faces: false,
        };
        let request = PlanRequest {
            turning: [0.0, 90.0, 180.0, 270.0].map(|angle| angle * DEG).to_vec(),
            tilting: [90.0, -90.0].map(|angle| angle * DEG).to_vec(),
            pairs: vec![],
            feeds: vec![10.0],
            both_senses: false,
            repeats: 1,
        };
        let (places, fixture) = (machine.nominal(), Fixture::default());
        let table = [150.0, 30.0];
        let arrangement =
            Arrangement::new(machine.clone(), &places, artefact, &fixture, table, 0.0)?;
        let touches = plan(&arrangement, &request, &options)?;
        let flat = |of: fn(&PlannedTouch) -> Vector3<f64>| {
            touches.iter().flat_map(|touch| <[f64; 3]>::from(of(touch))).collect()
        };
        let model = TouchModel::new(machine, artefact, Probe::new(1.0, 1e-4)?, vec![]);
        Ok(Self {
            model,
            rotary: touches.iter().flat_map(|touch| touch.rotary[..2].to_vec()).collect(),
            start: flat(|touch| touch.start),
            direction: flat(|touch| touch.direction),
            labels: touches.iter().map(|touch| touch.label).collect(),
        })
    }

    fn moves<'a>(&'a self, point: &'a [f64]) -> Moves<'a> {
        let (rotary, direction) = (&self.rotary, &self.direction);
        Moves { rotary, point, direction, feed: None, time: None, sense: None }
    }

    fn recorded(&self, simulation: &Simulation) -> Outcome<Vec<f64>> {
        let values = truth(&self.model);
        let mut travel = vec![0.0; self.labels.len()];
        self.model.simulate(&self.moves(&self.start), &values, simulation, 0, &mut travel)?;
        let along = travel.iter().flat_map(|&travel| [travel; 3]).zip(&self.direction);
        Ok(self.start.iter().zip(along).map(|(start, (travel, d))| start + travel * d).collect())
    }
}

/// [`TRUTH`] in mm and rad.
fn truth(model: &TouchModel) -> Vec<f64> {
    let names = model.parameter_names();
    names.iter().zip(TRUTH).map(|(name, value)| value * name.unit.to_internal()).collect()
}

fn kinematics(bench: &mut Criterion, machine: &Machine) {
    let mut places = Places::default();
    for (error, value) in machine.location_errors().iter().zip(TRUTH) {
        machine.add_location_error(&mut places, error, value * error.unit().to_internal());
    }
    let positions =
        AxisPositions { linear: Vector3::new(10.0, -20.0, 30.0), rotary: [0.4, 2.0, 0.0] };
    bench.bench_function("forward kinematics, one pose", |b| {
        b.iter(|| machine.forward(black_box(&positions), black_box(&places)));
    });
    let many = ForwardBatch::new(machine, &places);
    let (rows, mut tools) = ([10.0, -20.0, 30.0, 25.0, 110.0].repeat(1000), vec![0.0; TOOL * 1000]);
    bench.bench_function("forward kinematics, a thousand poses", |b| {
        b.iter(|| many.tools(black_box(&rows), &mut tools));
    });
}

fn contact(bench: &mut Criterion, artefact: &Artefact) {
    let solid = artefact.solid(&Places::default());
    let line =
        Line { origin: Vector3::new(60.0, 0.1, 12.5), direction: Vector3::new(-1.0, 1e-4, 2e-4) };
    bench.bench_function("contact", |b| {
        b.iter(|| solid.first_contact(black_box(&line), 1.0, Search::Ahead));
    });
}

fn main() -> Outcome<()> {
    let mut bench = Criterion::default().configure_from_args();
    let paper = Paper::new()?;
    kinematics(&mut bench, paper.model.machine());
    contact(&mut bench, paper.model.artefact());

    let simulation = Simulation { search: Search::Ahead, reach: 20.0, noise: 0.3 * UM, seed: 1 };
    let threads = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let samples = 100;
    let truths = truth(&paper.model).repeat(samples);
    let mut group = bench.benchmark_group("array call");
    group.throughput(Throughput::Elements(samples as u64));
    let moves = paper.moves(&paper.start);
    let measurement = Measurement {
        model: &paper.model,
        moves: &moves,
        labels: &paper.labels,
        simulation,
        first_sample: 0,
    };
    let work = || studies::calibrations(&measurement, &truths, None);
    work()?;
    group.bench_function("calibration", |b| {
        b.iter(|| threads.install(|| black_box(work()).is_ok()))
    });

    let points = paper.recorded(&simulation)?.repeat(samples);
    let moves = paper.moves(&points[..3 * paper.labels.len()]);
    let options = Options::default();
    let work = || least_squares::fit_many(&paper.model, &moves, &points, &[0.0; 14], &options);
    work()?;
    group.bench_function("identification", |b| {
        b.iter(|| threads.install(|| black_box(work()).is_ok()));
    });
    group.finish();
    bench.final_summary();
    Ok(())
}
