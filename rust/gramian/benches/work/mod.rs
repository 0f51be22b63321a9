//! What is measured: each kernel once, on fixed inputs. Shared by the timings
//! (`cargo bench`) and by the instruction counts (`examples/count_kernel.rs`).

use std::hint::black_box;

use gramian::batch::{self, Items, Method, Stream, Target, Threads, simd::Path};

/// A kernel, ready to be called.
pub type Work = Box<dyn FnMut()>;

/// What makes a kernel's inputs.
pub type Make = fn() -> Work;

/// Every kernel, by name.
pub const ALL: &[(&str, Make)] = &[
    ("rows_gram_64x100x4", gram),
    ("rows_bounds_64x60x4", bounds),
    ("bearings_rows_64x100", bearing_rows),
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

fn gram() -> Work {
    let (trials, size) = (64, 100 * 4);
    let rows = normals(trials * size);
    let mut out = vec![0.0; trials * 16];
    Box::new(move || {
        batch::gram(
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
        batch::crlb_std(Items::each(&rows, size), 4, None, Threads::One, &mut out);
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
        let done = batch::bearing_rows(
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
    let mut out = vec![0.0; 64 * batch::GRAM_SIZE];
    Box::new(move || {
        batch::bearing_gram(
            Items::shared(&times),
            Items::each(&bearings, 100),
            None,
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
        let done = batch::discriminant_sum(
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
