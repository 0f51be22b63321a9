//! What is measured: each kernel once, on fixed inputs. Shared by the timings
//! (`cargo bench`) and by the instruction counts (`examples/count_kernel.rs`).

use std::hint::black_box;

use gramian::batch::{self, Items, Stream, Threads, simd::Path};
use gramian::bearings::batch::{
    self as bearings_batch, Method, Motion, Target, localize as bearings_localize,
};
use gramian::bearings::{self, Monitor};
use gramian::bounds::batch::{self as bounds_batch, Recursion};
use gramian::dipole::batch::{self as dipole_batch, Passes, Simulated};
use gramian::dipole::localize::{Knowledge, Options};
use gramian::dipole::{Pass, Sensors};
use gramian::linear::batch::{self as linear_batch, Span};
use gramian::maneuver::batch::closed_loop::{
    self, Guidance, Happens, LostBearing, PER_SAMPLE, Setting,
};
use gramian::maneuver::batch::plan::{self, Course};
use gramian::maneuver::batch::{self as maneuver_batch, Paths, Sightings};
use gramian::maneuver::planner;
use gramian::maneuver::steer::Limits;
use gramian::maneuver::{AtStandoff, Law, Side};
use gramian::posterior::Form;
use gramian::registration::batch as biases;
use gramian::registration::estimate::{self, Question};
use gramian::registration::{Layout, report};
use gramian::tracks::carrier::Carrier;
use gramian::tracks::scene::estimate::{self as tracks, Task};
use gramian::tracks::scene::{Channel, Kind, Moving, Scene, TurnTimes};

/// A kernel, ready to be called.
pub type Work = Box<dyn FnMut()>;

/// What makes a kernel's inputs.
pub type Make = fn() -> Work;

/// Every kernel, by name.
pub const ALL: &[(&str, Make)] = &[
    ("rows_gram_64x100x4", gram),
    ("rows_bounds_64x60x4", bounds),
    ("normals_64x100", noise),
    ("moments_4096x4", moments),
    ("bearings_rows_64x100", bearing_rows),
    ("bearings_motion_rows_64x100", motion_rows),
    ("bearings_gram_64x100", bearing_gram),
    ("discriminant_direct_128", || {
        discriminant_sum(128, Method::Direct)
    }),
    ("discriminant_factored_128", || {
        discriminant_sum(128, Method::Factored)
    }),
    ("discriminant_qr_1024", || {
        discriminant_sum(1024, Method::Qr)
    }),
    ("bearings_discriminants_64", discriminants),
    ("bearings_fixed_target_64x100", fixed_target_sum),
    ("bearings_test_64x100", bearing_test),
    ("bearings_quadruple_64", best_quadruple),
    ("bearings_quadruples_64x16", best_quadruples),
    ("bearings_log_det_64x60", log_det_trials),
    ("bearings_localize_64x60", localize),
    ("bearings_trials_64x60", localize_trials),
    ("maneuver_fisher_64x100", maneuver_fisher),
    ("maneuver_det_64x100", maneuver_det),
    ("maneuver_headings_64", maneuver_headings),
    ("maneuver_paths_64x100", maneuver_paths),
    ("plan_search_40", plan_search),
    ("plan_steered_100", plan_steered),
    ("closed_loop_8x40", flown),
    ("dipole_fisher_64x200", dipole_fisher),
    ("dipole_rows_64x50", dipole_rows),
    ("dipole_field_64", dipole_field),
    ("dipole_jacobian_64", dipole_jacobian),
    ("dipole_measure_64x50", dipole_measure),
    ("dipole_localize_21", dipole_localize),
    ("dipole_trials_21", dipole_trials),
    ("tracks_two_legs_1024x60", tracks_two_legs),
    ("tracks_rows_120", tracks_rows),
    ("registration_fisher_64x100", registration_fisher),
    ("registration_rows_64x100", registration_rows),
    ("registration_eta_64x100", registration_eta),
    ("registration_running_eta_4x100", registration_running_eta),
    ("registration_degrees_64x100", registration_degrees),
    ("registration_reports_64x100", registration_reports),
    ("registration_places_64x100", registration_places),
    ("registration_estimate_200", registration_estimate),
    ("registration_trials_200", registration_trials),
    ("posterior_covariance_64x50", || posterior(Form::Covariance)),
    ("posterior_information_64x50", || {
        posterior(Form::Information)
    }),
    ("linear_levels_16x15x3", linear_levels),
    ("linear_powers_16x15x3", linear_powers),
    ("linear_gramian_16x6x3", linear_gramian),
    ("monitor_push_f32_1000", || monitor(1000, 0)),
    ("monitor_answer_f32_1000", || monitor(0, 1000)),
];

/// The work of this name.
pub fn named(name: &str) -> Option<Work> {
    ALL.iter()
        .find(|(known, _)| *known == name)
        .map(|(_, make)| make())
}

fn normals(count: usize) -> Vec<f64> {
    let mut stream = Stream::new(1, 0);
    (0..count).map(|_| stream.normal()).collect()
}

/// A kernel that fills `size` numbers and says whether it could.
fn filling(size: usize, mut kernel: impl FnMut(&mut [f64]) -> bool + 'static) -> Work {
    let mut out = vec![0.0; size];
    Box::new(move || {
        assert!(kernel(&mut out));
        black_box(&out);
    })
}

fn noise() -> Work {
    filling(64 * 100, |out| {
        batch::normals(1, 0, 100, Threads::One, out);
        true
    })
}

fn moments() -> Work {
    let (values, ok) = (normals(4096 * 4), [true; 4096]);
    filling(batch::moments::size(4), move |out| {
        batch::moments::moments(&values, &ok, 4, out);
        true
    })
}

fn gram() -> Work {
    let (trials, size) = (64, 100 * 4);
    let rows = normals(trials * size);
    let mut out = vec![0.0; trials * 16];
    Box::new(move || {
        gramian::spine::batch_gram::gram(
            Items::each(&rows, size),
            None,
            4,
            Threads::One,
            Path::Best,
            &mut out,
        );
        black_box(&out);
    })
}

fn bounds() -> Work {
    let (trials, size) = (64, 60 * 4);
    let rows = normals(trials * size);
    let mut out = vec![0.0; trials * 4];
    Box::new(move || {
        bounds_batch::crlb_std(
            Items::each(&rows, size),
            4,
            None,
            Threads::One,
            Path::Best,
            &mut out,
        );
        black_box(&out);
    })
}

/// Times, and for each of 64 trials an observer that turns and a target state.
fn tracks(m: usize) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let times: Vec<f64> = (0..m).map(|i| 10.0 * i as f64).collect();
    let turn = times[m / 2];
    let observer = times
        .iter()
        .flat_map(|&t| [5.0 * (t - turn).max(0.0), 5.0 * t.min(turn)])
        .collect();
    let noise = normals(64 * 4);
    let states = noise
        .chunks_exact(4)
        .flat_map(|e| [500.0 * e[0], 9000.0 + 500.0 * e[1], 3.0 + e[2], -1.0 + e[3]])
        .collect();
    (times, observer, states)
}

fn bearing_rows() -> Work {
    let (times, observer, states) = tracks(100);
    let mut out = vec![0.0; 64 * 100 * 4];
    Box::new(move || {
        let done = bearings_batch::bearing_rows(
            Items::shared(&times),
            Items::shared(&observer),
            Target::State(Items::each(&states, 4)),
            Items::shared(&[0.01]),
            Threads::One,
            &mut out,
        );
        assert!(done.is_ok());
        black_box(&out);
    })
}

fn motion_rows() -> Work {
    let (times, observer, states) = tracks(100);
    filling(64 * 100 * 4, move |out| {
        bearings_batch::motion_rows(
            Items::shared(&times),
            Items::shared(&observer),
            Motion::State(Items::each(&states, 4)),
            Items::shared(&[0.01]),
            2,
            1,
            Threads::One,
            out,
        )
        .is_ok()
    })
}

/// Bearings of the 64 tracks, m each.
fn bearings(m: usize) -> (Vec<f64>, Vec<f64>) {
    let (times, observer, states) = tracks(m);
    let bearings = states
        .chunks_exact(4)
        .flat_map(|x| {
            times
                .iter()
                .zip(observer.chunks_exact(2))
                .map(|(&t, o)| (x[0] + t * x[2] - o[0]).atan2(x[1] + t * x[3] - o[1]))
                .collect::<Vec<_>>()
        })
        .collect();
    (times, bearings)
}

fn bearing_gram() -> Work {
    let (times, bearings) = bearings(100);
    let mut out = vec![0.0; 64 * bearings_batch::GRAM_SIZE];
    Box::new(move || {
        bearings_batch::bearing_gram(
            Items::shared(&times),
            Items::each(&bearings, 100),
            None,
            true,
            Threads::One,
            Path::Best,
            &mut out,
        );
        black_box(&out);
    })
}

fn discriminant_sum(m: usize, method: Method) -> Work {
    let (times, bearings) = bearings(m);
    let mut out = [0.0];
    Box::new(move || {
        let done = bearings_batch::discriminant_sum(
            Items::shared(&times),
            Items::each(&bearings, m),
            None,
            method,
            Threads::One,
            &mut out,
        );
        assert!(done.is_ok());
        black_box(&out);
    })
}

fn discriminants() -> Work {
    let (times, bearings) = bearings(4);
    filling(64, move |out| {
        let (times, bearings) = (Items::shared(&times), Items::each(&bearings, 4));
        bearings_batch::discriminants(times, bearings, bearings::Form::Sines, Threads::One, out)
            .is_ok()
    })
}

fn fixed_target_sum() -> Work {
    let (times, bearings) = bearings(100);
    filling(64, move |out| {
        let (times, bearings) = (Items::shared(&times), Items::each(&bearings, 100));
        bearings_batch::fixed_target_sum(times, bearings, None, Method::Qr, Threads::One, out)
            .is_ok()
    })
}

fn best_quadruples() -> Work {
    let (times, bearings) = bearings(16);
    filling(64 * 5, move |out| {
        let (times, bearings) = (Items::shared(&times), Items::each(&bearings, 16));
        bearings_batch::best_quadruples(times, bearings, Threads::One, out).is_ok()
    })
}

fn bearing_test() -> Work {
    let (times, bearings) = bearings(100);
    let mut out = vec![0.0; 64 * bearings_batch::TEST_SIZE];
    Box::new(move || {
        let done = bearings_batch::observability_tests(
            Items::shared(&times),
            Items::each(&bearings, 100),
            Items::shared(&[0.01]),
            Threads::One,
            Path::Best,
            &mut out,
        );
        assert!(done.is_ok());
        black_box(&out);
    })
}

fn best_quadruple() -> Work {
    let (times, bearings) = bearings(64);
    Box::new(move || {
        let best = bearings_batch::best_quadruple(&times, &bearings[..64], Threads::One);
        assert!(best.is_ok());
        let _ = black_box(best);
    })
}

fn log_det_trials() -> Work {
    let (times, bearings) = bearings(60);
    let mut out = vec![0.0; 64];
    Box::new(move || {
        bearings_batch::bearing_log_det_trials(
            &times,
            &bearings[..60],
            &[0.01],
            1,
            0,
            Threads::One,
            Path::Best,
            &mut out,
        );
        black_box(&out);
    })
}

fn localize() -> Work {
    let (times, observer, _) = tracks(60);
    let (_, mut bearings) = bearings(60);
    for (bearing, noise) in bearings.iter_mut().zip(normals(64 * 60)) {
        *bearing += 0.005 * noise;
    }
    let mut out = vec![0.0; 64 * bearings_localize::Layout { states: 4 }.size()];
    Box::new(move || {
        let track = bearings_localize::Track {
            times: Items::shared(&times),
            observer: Items::shared(&observer),
            sigma: Items::shared(&[0.005]),
            prior: None,
        };
        bearings_localize::localize(
            &track,
            Items::each(&bearings, 60),
            4,
            bearings_localize::Options::default(),
            Threads::One,
            Path::Best,
            &mut out,
        );
        black_box(&out);
    })
}

fn localize_trials() -> Work {
    let (times, observer, states) = tracks(60);
    let size = bearings_localize::Layout { states: 4 }.trial_size();
    filling(64 * size, move |out| {
        let track = bearings_localize::Track {
            times: Items::shared(&times),
            observer: Items::shared(&observer),
            sigma: Items::shared(&[0.005]),
            prior: None,
        };
        let options = bearings_localize::Options::default();
        let truth = Items::shared(&states[..4]);
        bearings_localize::simulate_and_localize(
            &track,
            truth,
            1,
            0,
            options,
            Threads::One,
            Path::Best,
            out,
        )
        .is_ok()
    })
}

/// 64 paths of 100 positions east of a target 10 km north.
fn paths() -> Vec<f64> {
    normals(64 * 100 * 2)
        .iter()
        .map(|e| 1000.0 * e.clamp(-3.0, 3.0))
        .collect()
}

const FAR: [f64; 2] = [8000.0, 9000.0];

fn maneuver_fisher() -> Work {
    let positions = paths();
    let mut out = vec![0.0; 64 * 4];
    Box::new(move || {
        let done = maneuver_batch::fisher(
            sightings(&positions),
            false,
            Threads::One,
            Path::Best,
            &mut out,
        );
        assert!(done.is_ok());
        black_box(&out);
    })
}

fn sightings(positions: &[f64]) -> Sightings<'_> {
    Sightings {
        positions: Items::each(positions, 200),
        target: Items::shared(&FAR),
        times: Items::shared(&[]),
        sigma: Items::shared(&[0.01]),
    }
}

fn maneuver_det() -> Work {
    let positions = paths();
    let mut out = vec![0.0; 64];
    Box::new(move || {
        let done = maneuver_batch::fisher_det(
            sightings(&positions),
            maneuver_batch::Determinant::Root,
            Threads::One,
            &mut out,
        );
        assert!(done.is_ok());
        black_box(&out);
    })
}

fn maneuver_headings() -> Work {
    let bearing = normals(64);
    filling(64, move |out| {
        maneuver_batch::headings(
            Items::each(&bearing, 1),
            Items::shared(&[5000.0]),
            Items::shared(&[20.0]),
            Items::shared(&[1.0]),
            Law::MaxDet,
            Threads::One,
            out,
        )
        .is_ok()
    })
}

fn maneuver_paths() -> Work {
    let start: Vec<f64> = normals(64 * 2).iter().map(|e| 1000.0 * e).collect();
    let mut out = vec![0.0; 64 * maneuver_batch::path_size(100)];
    Box::new(move || {
        let paths = Paths {
            target: Items::shared(&FAR),
            start: Items::each(&start, 2),
            step: Items::shared(&[20.0]),
            side: Items::shared(&[1.0]),
            sigma: Items::shared(&[1.0]),
            standoff: Items::shared(&[0.0]),
            law: Law::MaxDet,
            at_standoff: AtStandoff::Stop,
        };
        let done = maneuver_batch::trajectories(paths, 100, Threads::One, Path::Best, &mut out);
        assert!(done.is_ok());
        black_box(&out);
    })
}

const NORTH: [f64; 4] = [0.0, 1000.0, 0.0, 0.0];
const LENGTHS: [f64; 99] = [20.0; 99];

/// Bearings of a fixed target 1 km north of the start, from 40 places.
fn plan_search() -> Work {
    let problem =
        planner::Problem::bearings([0.0, 1000.0], [0.0; 2], 20.0, 1.0, 40, 0.03, 500.0).ok();
    let options = planner::Options {
        starts: 2,
        restarts: 0,
        ..planner::Options::default()
    };
    Box::new(move || {
        let best = problem.as_ref().and_then(|problem| {
            let mut search = planner::Search::new(problem, options).ok()?;
            search.run(&mut |_| true);
            search.best()
        });
        assert!(best.is_some());
        black_box(best);
    })
}

fn plan_steered() -> Work {
    filling(100, move |out| {
        let course = Course {
            start: [0.0; 2],
            dt: 1.0,
            lengths: &LENGTHS,
            first: None,
            limits: Limits {
                standoff: 500.0,
                targets: &[NORTH],
                keep_out: &[[300.0, 300.0, 100.0]],
                max_turn: 0.5,
            },
        };
        plan::steered(&course, Law::MaxDet, Side::Right, NORTH, out);
        true
    })
}

fn flown() -> Work {
    let (steps, trials) = (40, 8);
    let noise = normals(trials * (steps + 1));
    let lost: Vec<f64> = (0..noise.len()).map(|i| f64::from(i % 5 == 4)).collect();
    filling(trials * (steps + 1) * PER_SAMPLE, move |out| {
        let setting = Setting {
            start: [0.0; 2],
            dt: 1.0,
            length: 20.0,
            steps,
            sigma: 0.03,
            range: (900.0, 200.0),
            speed: None,
            gate: f64::INFINITY,
            opening: 2,
            lost: LostBearing::Predict,
            standoff: 200.0,
            keep_out: &[],
            max_turn: f64::INFINITY,
        };
        let guide = Guidance::Law(Law::MaxDet, Side::Right);
        let none = [f64::MAX; 41];
        let target = [NORTH[0], NORTH[1], 0.0, 0.0];
        let happens = Happens {
            targets: Items::shared(&target),
            noise: Items::each(&noise, steps + 1),
            lost: Items::each(&lost, steps + 1),
            alarms: Items::shared(&none),
        };
        closed_loop::closed_loop(&setting, guide, happens, Threads::One, out);
        true
    })
}

/// Sixty times, and an observer that turns three times.
#[allow(clippy::unwrap_used)] // What is given are constants.
fn zigzag() -> (Vec<f64>, Carrier) {
    let times = (0..60).map(|i| 20.0 * f64::from(i)).collect();
    let turns = [0.0, 300.0, 600.0, 900.0, 1200.0];
    let path = [
        0.0, 0.0, 1060.0, 1060.0, 2120.0, 0.0, 3180.0, 1060.0, 4240.0, 0.0,
    ];
    (times, Carrier::along(2, &turns, &path, None, None).unwrap())
}

#[allow(clippy::unwrap_used)] // What is given are constants.
fn tracks_two_legs() -> Work {
    let (times, carrier) = zigzag();
    let seen = carrier.at(&times).unwrap();
    let bearings = Channel::new(Kind::Bearing, times, Some(seen), 0.005);
    let motion = Moving::Legs(TurnTimes::Unknown(1));
    let scene = Scene::new(2, motion, 0.0, 0, vec![bearings]).unwrap();
    let truth = [1500.0, 3700.0, 3.0, -4.0, -2.0, -4.6, 610.0];
    let start = [1575.0, 3515.0, 2.4, -4.8, -2.4, -4.1, 640.0];
    let (n, m) = (scene.states(), scene.measurements());
    let exact = scene.values(&truth).unwrap();
    let mut measured = vec![0.0; 1024 * m];
    for (trial, out) in measured.chunks_exact_mut(m).enumerate() {
        scene.simulate(&exact, 1, trial as u64, out);
    }
    let size = tracks::Layout { states: n }.size();
    filling(1024 * size, move |out| {
        let task = Task {
            scene: &scene,
            known: &[f64::NAN; 7],
            mean: &[0.0; 7],
            sigma: &[f64::INFINITY; 7],
            options: tracks::Options::default(),
        };
        let items = Items::each(&measured, m);
        tracks::estimate(task, items, Some(Items::shared(&start)), Threads::One, out).is_ok()
    })
}

/// Rows of bearings and ranges.
#[allow(clippy::unwrap_used)] // What is given are constants.
fn tracks_rows() -> Work {
    let (times, carrier) = zigzag();
    let channel = |kind, sigma| {
        let seen = carrier.at(&times).unwrap();
        Channel::new(kind, times.clone(), Some(seen), sigma)
    };
    let channels = vec![channel(Kind::Bearing, 0.005), channel(Kind::Range, 10.0)];
    let scene = Scene::new(2, Moving::Polynomial { order: 1 }, 0.0, 0, channels).unwrap();
    filling(120 * 4, move |out| {
        scene.rows_into(&[1500.0, 3700.0, 3.0, -4.0], out).is_ok()
    })
}

/// Positions, velocities and moments of 64 passes, and times.
fn passes(samples: usize) -> [Vec<f64>; 4] {
    let noise = normals(64 * 9);
    let part = |first: usize, size: [f64; 3], at: [f64; 3]| -> Vec<f64> {
        noise
            .chunks_exact(9)
            .flat_map(|e| [0, 1, 2].map(|i| at[i] + size[i] * e[first + i]))
            .collect()
    };
    let step = 20.0 / samples as f64;
    [
        part(0, [10.0, 10.0, 1.0], [0.0, 0.0, 30.0]),
        part(3, [1.0, 1.0, 0.1], [0.0; 3]),
        part(6, [30.0; 3], [0.0; 3]),
        (0..samples).map(|i| step * i as f64).collect(),
    ]
}

fn passing([position, velocity, moment, times]: &[Vec<f64>; 4]) -> Passes<'_> {
    Passes {
        position: Items::each(position, 3),
        velocity: Items::each(velocity, 3),
        moment: Items::each(moment, 3),
        times: Items::shared(times),
        sigma: Items::shared(&[1e-9]),
        sensors: Items::shared(&[0.0; 3]),
        baselines: &[],
        ambient: None,
        quadrupole: None,
    }
}

fn dipole_fisher() -> Work {
    let given = passes(200);
    let mut out = vec![0.0; 64 * 81];
    Box::new(move || {
        out.fill(0.0);
        let done =
            dipole_batch::dipole_fisher(&passing(&given), Threads::One, Path::Best, &mut out);
        assert!(done.is_ok());
        black_box(&out);
    })
}

fn dipole_rows() -> Work {
    let given = passes(50);
    let mut out = vec![0.0; 64 * 50 * 27];
    Box::new(move || {
        let done = dipole_batch::dipole_rows(&passing(&given), Threads::One, &mut out);
        assert!(done.is_ok());
        black_box(&out);
    })
}

fn dipole_field() -> Work {
    let [position, _, moment, _] = passes(1);
    filling(64 * 3, move |out| {
        let (position, moment) = (Items::each(&position, 3), Items::each(&moment, 3));
        dipole_batch::dipole_field(position, moment, Threads::One, out).is_ok()
    })
}

fn dipole_jacobian() -> Work {
    let [position, _, moment, _] = passes(1);
    filling(64 * 18, move |out| {
        let (position, moment) = (Items::each(&position, 3), Items::each(&moment, 3));
        dipole_batch::dipole_jacobian(position, moment, Threads::One, out).is_ok()
    })
}

fn dipole_measure() -> Work {
    let given = passes(50);
    filling(64 * 50 * 3, move |out| {
        dipole_batch::dipole_measure(&passing(&given), Threads::One, out).is_ok()
    })
}

/// Table 1 of Dai et al. 2020, of which z0 and vz are known.
const TABLE_1: [[f64; 3]; 3] = [[-10.0, -10.0, 5.0], [1.0, 1.0, 0.0], [10.0, 20.0, 10.0]];

fn height_known() -> Knowledge {
    let mut exact = [None; 11];
    (exact[2], exact[5]) = (Some(5.0), Some(0.0));
    Knowledge {
        exact,
        prior: [None; 11],
    }
}

fn dipole_trials() -> Work {
    let times: Vec<f64> = (0..21).map(f64::from).collect();
    let [position, velocity, moment] = TABLE_1;
    let pass = Pass {
        position,
        velocity,
        moment,
    };
    let knowledge = height_known();
    filling(12, move |out| {
        let simulated = Simulated {
            times: &times,
            pass: &pass,
            sensors: Sensors::vector(&[[0.0; 3]]),
            sigma: 1e-9,
            seed: 1,
            first: 0,
        };
        let options = Options::default();
        dipole_batch::dipole_localize_trials(&simulated, &knowledge, &options, Threads::One, out)
            .is_ok()
    })
}

fn dipole_localize() -> Work {
    let times: Vec<f64> = (0..21).map(f64::from).collect();
    let state = &TABLE_1;
    let mut field = vec![0.0; 63];
    let passes = Passes {
        position: Items::shared(&state[0]),
        velocity: Items::shared(&state[1]),
        moment: Items::shared(&state[2]),
        times: Items::shared(&times),
        sigma: Items::shared(&[1e-9]),
        sensors: Items::shared(&[0.0; 3]),
        baselines: &[],
        ambient: None,
        quadrupole: None,
    };
    let done = dipole_batch::dipole_measure(&passes, Threads::One, &mut field);
    assert!(done.is_ok());
    let knowledge = height_known();
    let sensors = [[0.0; 3]];
    let mut out = vec![0.0; dipole_batch::dipole_localized_size(21, 3)];
    Box::new(move || {
        let done = dipole_batch::dipole_localize(
            Items::shared(&times),
            Items::each(&field, 63),
            &Sensors::vector(&sensors),
            &knowledge,
            &Options::default(),
            Threads::One,
            &mut out,
        );
        assert!(done.is_ok());
        black_box(&out);
    })
}

const SENSORS: [f64; 4] = [0.0, 0.0, 60e3, 0.0];
const DEVIATIONS: [f64; 4] = [50.0, 0.00175, 50.0, 0.00175];

/// 64 targets that two radars look at 100 times each.
fn looks() -> Vec<f64> {
    (0..64 * 100)
        .flat_map(|i| {
            [
                -30e3 + 1.2e3 * f64::from(i % 100),
                40e3 + f64::from(i / 100),
            ]
        })
        .collect()
}

fn scene(positions: &[f64]) -> biases::Scene<'_> {
    biases::Scene {
        layout: Layout::PAIR,
        sensors: Items::shared(&SENSORS),
        sigma: Items::shared(&DEVIATIONS),
        biases: Items::shared(&[0.0; 4]),
        positions: Items::each(positions, 200),
    }
}

fn registration_fisher() -> Work {
    let looks = looks();
    filling(64 * 16, move |out| {
        biases::fisher(scene(&looks), Threads::One, Path::Best, out).is_ok()
    })
}

fn registration_rows() -> Work {
    let looks = looks();
    filling(64 * 100 * 8, move |out| {
        biases::rows(scene(&looks), Threads::One, out).is_ok()
    })
}

fn registration_eta() -> Work {
    let looks = looks();
    filling(64, move |out| {
        biases::eta(scene(&looks), Threads::One, out).is_ok()
    })
}

fn registration_running_eta() -> Work {
    let looks = looks();
    filling(4 * 100, move |out| {
        biases::running_eta(scene(&looks[..800]), Some(10), Threads::One, out).is_ok()
    })
}

fn registration_degrees() -> Work {
    let looks = looks();
    let pairs: Vec<[usize; 2]> = (0..99).map(|i| [i, i + 1]).collect();
    filling(64 * 99, move |out| {
        let degree = biases::Degree::Pair;
        biases::pair_degrees(scene(&looks), degree, &pairs, Threads::One, out).is_ok()
    })
}

fn registration_reports() -> Work {
    let looks = looks();
    filling(64 * 100 * 4, move |out| {
        biases::reports(scene(&looks), Threads::One, out).is_ok()
    })
}

fn registration_places() -> Work {
    let looks = looks();
    let mut reports = vec![0.0; 64 * 100 * 4];
    let done = biases::reports(scene(&looks), Threads::One, &mut reports);
    assert!(done.is_ok());
    filling(reports.len(), move |out| {
        let reports = Items::each(&reports, 400);
        let (sensors, none) = (Items::shared(&SENSORS), Items::shared(&[0.0; 4]));
        biases::places(Layout::PAIR, sensors, none, reports, Threads::One, out);
        true
    })
}

const QUESTION: Question<'_, f64> = Question {
    layout: Layout::PAIR,
    sensors: &SENSORS,
    sigma: &DEVIATIONS,
    prior: None,
    method: estimate::Method::MaximumLikelihood,
    iterations: 50,
    tolerance: 1e-6,
    noise_share: 0.5,
    bend: 0.05,
};
const BIASES: [f64; 4] = [300.0, 0.0087, -200.0, -0.007];

/// A target that passes between two radars, 200 looks.
fn passage() -> Vec<f64> {
    (0..200)
        .flat_map(|i| [-20e3 + 400.0 * f64::from(i), 25e3])
        .collect()
}

fn registration_trials() -> Work {
    let positions = passage();
    filling(biases::answer_size(&Layout::PAIR, 0), move |out| {
        biases::estimate_trials(&QUESTION, &positions, &BIASES, (1, 0), Threads::One, out).is_ok()
    })
}

fn registration_estimate() -> Work {
    let mut reports = vec![0.0; 800];
    let done = report(&Layout::PAIR, &SENSORS, &BIASES, &passage(), &mut reports);
    assert!(done.is_ok());
    for (report, (noise, sigma)) in reports
        .iter_mut()
        .zip(normals(800).iter().zip(DEVIATIONS.iter().cycle()))
    {
        *report += noise * sigma;
    }
    filling(biases::answer_size(&Layout::PAIR, 0), move |out| {
        let reports = Items::each(&reports, 800);
        biases::estimate(&QUESTION, reports, false, Threads::One, out).is_ok()
    })
}

fn posterior(form: Form) -> Work {
    let rows: Vec<f64> = normals(64 * 50)
        .iter()
        .flat_map(|e| [0.45 * e.cos(), 0.0, -0.45 * e.sin(), 0.0])
        .collect();
    // Position and velocity, east and north; F^T, or F^-1.
    let one = if form == Form::Covariance { 1.0 } else { -1.0 };
    let mut transition = [0.0; 16];
    for i in 0..4 {
        transition[5 * i] = 1.0;
    }
    if form == Form::Covariance {
        (transition[4], transition[14]) = (one, one);
    } else {
        (transition[1], transition[11]) = (one, one);
    }
    let mut root = [0.0; 16];
    let mut noise = [0.0; 16];
    for i in 0..4 {
        (root[5 * i], noise[5 * i]) = (2.0, 0.1);
    }
    let mut out = vec![0.0; 64 * (50 * 4 + 16)];
    Box::new(move || {
        let recursion = Recursion {
            form,
            states: 4,
            steps: 50,
            root: Items::shared(&root),
            rows: Items::each(&rows, 50 * 4),
            after: Items::shared(&[]),
            transition: Items::shared(&transition),
            noise: Items::shared(&noise),
            every_root: false,
        };
        bounds_batch::posterior(recursion, Threads::One, Path::Best, &mut out);
        black_box(&out);
    })
}

/// 16 systems: A (n, n), C (3, n).
fn systems(n: usize) -> (Vec<f64>, Vec<f64>) {
    let all = normals(16 * (n + 3) * n);
    let (a, c) = all.split_at(16 * n * n);
    let root = (n as f64).sqrt();
    (a.iter().map(|x| x / root).collect(), c.to_vec())
}

fn linear_levels() -> Work {
    let (a, c) = systems(15);
    let mut out = vec![0.0; 16 * 30];
    Box::new(move || {
        linear_batch::linear_levels(
            Items::each(&a, 225),
            Items::each(&c, 45),
            15,
            None,
            Threads::One,
            Path::Best,
            &mut out,
        );
        black_box(&out);
    })
}

fn linear_powers() -> Work {
    let (a, c) = systems(15);
    let mut out = vec![0.0; 16 * 45 * 15];
    Box::new(move || {
        let done = linear_batch::observability_matrix(
            Items::each(&a, 225),
            Items::each(&c, 45),
            15,
            14,
            Threads::One,
            Path::Best,
            &mut out,
        );
        assert!(done.is_ok());
        black_box(&out);
    })
}

fn linear_gramian() -> Work {
    let (a, c) = systems(6);
    let mut out = vec![0.0; 16 * 36];
    Box::new(move || {
        let done = linear_batch::linear_gramian(
            Items::each(&a, 36),
            Items::each(&c, 18),
            None,
            6,
            Span::Samples(50),
            Threads::One,
            Path::Best,
            &mut out,
        );
        assert!(done.is_ok());
        black_box(&out);
    })
}

/// Pushes bearings of a track into a monitor that has seen as many, and asks it.
fn monitor(pushes: u32, answers: u32) -> Work {
    let samples: Vec<(f32, f32)> = (0..1000 + pushes)
        .map(|i| {
            let t = i as f32;
            (
                t,
                (3.0 * t).atan2(10_000.0 - 6.0 * t) + 0.01 * (0.7 * t * t).sin(),
            )
        })
        .collect();
    let mut seen = Monitor::<f32>::new();
    let (before, after) = samples.split_at(1000);
    for &(time, bearing) in before {
        assert!(seen.push(time, bearing, 0.01, None).is_ok());
    }
    let after = after.to_vec();
    Box::new(move || {
        let mut monitor = black_box(seen);
        for &(time, bearing) in &after {
            assert!(monitor.push(time, bearing, 0.01, None).is_ok());
        }
        for _ in 0..answers {
            black_box(black_box(&monitor).answer());
        }
        black_box(&monitor);
    })
}
