//! The estimator on every vector path and number of threads, and its answers
//! where none exists.

#![cfg(feature = "std")]
#![allow(clippy::unwrap_used)]

use gramian::batch::simd::Path;
use gramian::batch::{Items, Threads};
use gramian::bearings::batch::localize::{
    Layout, Options, Status, Track, localize, simulate_and_localize,
};
use gramian::bearings::{bearing, position};

const TRUTH: [f64; 4] = [1000.0, 9000.0, 3.0, -1.0];
const TRIAL: usize = Layout { states: 4 }.trial_size();

/// An observer that turns by `turn` (rad) halfway, bearings every 15 s.
fn leg(m: usize, turn: f64) -> (Vec<f64>, Vec<f64>) {
    let times: Vec<f64> = (0..m).map(|i| 15.0 * i as f64).collect();
    let half = times[m / 2];
    let observer = times
        .iter()
        .flat_map(|&t| {
            let (first, second) = (t.min(half), (t - half).max(0.0));
            [
                5.0 * second * turn.sin(),
                5.0 * (first + second * turn.cos()),
            ]
        })
        .collect();
    (times, observer)
}

fn track<'a>(times: &'a [f64], observer: &'a [f64], sigma: &'a [f64]) -> Track<'a> {
    Track {
        times: Items::shared(times),
        observer: Items::shared(observer),
        sigma: Items::shared(sigma),
        prior: None,
    }
}

fn simulated(track: &Track<'_>, first: u64, path: Path, threads: Threads, out: &mut [f64]) {
    let (truth, options) = (Items::shared(&TRUTH), Options::default());
    simulate_and_localize(track, truth, 5, first, options, threads, path, out).unwrap();
}

#[test]
fn every_path_and_thread_count_gives_the_same() {
    // 61: the last block is not full.
    let (times, observer) = leg(61, 1.0);
    let track = track(&times, &observer, &[2e-3]);
    let mut best = vec![0.0; 400 * TRIAL];
    simulated(&track, 0, Path::Best, Threads::Auto, &mut best);
    let mut other = vec![0.0; 400 * TRIAL];
    let (head, tail) = other.split_at_mut(100 * TRIAL);
    simulated(&track, 0, Path::Best, Threads::One, head);
    simulated(&track, 100, Path::Best, Threads::One, tail);
    assert_eq!(best, other);
    for path in Path::available() {
        simulated(&track, 0, path, Threads::One, &mut other);
        for (a, b) in other.chunks(TRIAL).zip(best.chunks(TRIAL)) {
            for i in 0..4 {
                // In deviations.
                assert!((a[i] - b[i]).abs() < 1e-5 * b[4 + i], "{path:?}");
                assert!((a[4 + i] / b[4 + i] - 1.0).abs() < 1e-5, "{path:?}");
            }
        }
    }
}

#[test]
fn exact_bearings_give_the_exact_state() {
    let (times, observer) = leg(20, 0.5);
    let bearings: Vec<f64> = times
        .iter()
        .zip(observer.chunks(2))
        .map(|(&t, o)| bearing([o[0], o[1]], position(&TRUTH, t).unwrap()).unwrap())
        .collect();
    let track = track(&times, &observer, &[1e-3]);
    let mut out = vec![0.0; Layout { states: 4 }.size()];
    for path in Path::available() {
        localize(
            &track,
            Items::shared(&bearings),
            4,
            Options::default(),
            Threads::One,
            path,
            &mut out,
        );
        assert_eq!(out[out.len() - 4], Status::Converged.code());
        for (x, truth) in out.iter().zip(TRUTH) {
            assert!((x / truth - 1.0).abs() < 1e-8, "{path:?}: {x}");
        }
    }
}

#[test]
fn a_straight_observer_determines_nothing() {
    let (times, observer) = leg(40, 0.0);
    let track = track(&times, &observer, &[1e-2]);
    let mut out = vec![0.0; 200 * TRIAL];
    simulated(&track, 0, Path::Best, Threads::One, &mut out);
    for trial in out.chunks(TRIAL) {
        assert_eq!(trial[TRIAL - 2], Status::Unobservable.code());
        assert!(trial[..4].iter().all(|x| x.is_nan()));
        assert!(trial[4..8].iter().all(|x| *x == f64::INFINITY));
    }
}

#[test]
fn an_observer_on_the_target_is_an_error() {
    let (times, mut observer) = leg(10, 0.5);
    observer[14..16].copy_from_slice(&position(&TRUTH, times[7]).unwrap());
    let track = track(&times, &observer, &[1e-2]);
    let mut out = vec![0.0; TRIAL];
    let error = simulate_and_localize(
        &track,
        Items::shared(&TRUTH),
        1,
        0,
        Options::default(),
        Threads::One,
        Path::Best,
        &mut out,
    )
    .unwrap_err();
    assert_eq!(error.1, gramian::bearings::Error::OnTarget { index: 7 });
}
