//! What no path can exceed, sample by sample: the determinant of the information is a sum
//! over pairs of bearings (of fours, where velocity is unknown), and each of them is bounded
//! by itself.
//!
//! # Algorithm
//! With rows h of the samples (Cauchy-Binet) det(sum of h h^T) is the sum of the squares of
//! the determinants of all sets of N rows.
//!
//! A pair, N = 2: that of the bearings at q and p, seen from the target, is
//! f = sin(q, p) / (|q| |p|) over both deviations. Where |q| >= A, |p| >= B <= A and
//! |q - p| <= D, its largest value is
//!
//! | where | f |
//! |---|---|
//! | A^2 + B^2 <= D^2 | 1 / (A B) |
//! | D < A and (A^2 - D^2)^2 >= B^2 (A^2 + D^2) | D / (A (A^2 - D^2)) |
//! | else, with c = (A^2 + B^2 - D^2) / (2 A B) | (1 - c^2)^(1/2) / (A B) |
//!
//! A four, N = 4, with rows (h, t h) at times t1 <= t2 <= t3 <= t4: of the products
//! P = f12 f34, Q = f13 f24, W = f14 f23 one is the sum of the others, Q = P + W with their
//! signs, so that the determinant has three forms, each with two of the three numbers
//! u = (t4 - t1)(t3 - t2), v = (t2 - t1)(t4 - t3) and u + v = (t3 - t1)(t4 - t2):
//! u P - v W = (u + v) P - v Q = u Q - (u + v) W. Its size is at most the least of the three
//! sums of sizes.
//!
//! # Source
//! Cauchy-Binet; the rest is ours, with its proof in the documentation of the planner.

use alloc::vec::Vec;

use super::{Belief, Criterion, Over, Problem};
use crate::scalar::hypot;
use crate::tracks::scene::Kind;

/// Samples of all observers of which pairs, and fours, are summed at most.
const MOST_PAIRS: usize = 4000;
const MOST_FOURS: usize = 200;

/// When and how near a bearing can be taken, and how much it counts.
#[derive(Clone, Copy, Debug)]
struct Sample {
    observer: usize,
    /// Number of the sample.
    step: usize,
    time: f64,
    /// The least range.
    near: f64,
    /// 1 / sigma^2 of all bearings taken here.
    weight: f64,
}

/// A bound on the utility (log det, or minus the log of a variance) of any path; infinite
/// where it says nothing. `look` is asked now and then whether to go on.
pub(super) fn most(problem: &Problem, look: &mut dyn FnMut() -> bool) -> f64 {
    let n = problem.states() as f64;
    let single = problem.beliefs.len() == 1;
    let combined = problem.aim.criterion == Criterion::Combination;
    if problem.nuisances > 0 || combined || (matches!(problem.aim.over, Over::Chance(_)) && !single)
    {
        return f64::INFINITY;
    }
    let total: f64 = problem.beliefs.iter().map(|belief| belief.weight).sum();
    let (mut mean, mut least) = (0.0, f64::INFINITY);
    for belief in &problem.beliefs {
        let mut log = 0.0;
        for target in 0..problem.targets() {
            // Of blocks on the diagonal the determinants multiply, at most (Fischer).
            log += of_target(problem, belief, target, look);
        }
        if belief.weight > 0.0 {
            mean += belief.weight / total * log;
            least = least.min(log);
        }
    }
    let log = if problem.aim.over == Over::Worst {
        least
    } else {
        mean
    };
    if problem.aim.criterion == Criterion::Determinant {
        return log;
    }
    // In scaled states the smallest eigenvalue is at most det^(1/n), and the trace of the
    // inverse at least n det^(-1/n). Means over beliefs are other ones than that of logs.
    if !single && problem.aim.over != Over::Worst {
        return f64::INFINITY;
    }
    let scales: f64 = problem.scale.iter().map(|scale| scale.ln()).sum();
    let root = (log + 2.0 * scales) / n;
    match problem.aim.criterion {
        Criterion::Trace => root - n.ln(),
        _ => root,
    }
}

/// Of the log of the determinant of the information of one target.
fn of_target(
    problem: &Problem,
    belief: &Belief,
    target: usize,
    look: &mut dyn FnMut() -> bool,
) -> f64 {
    let state = belief.targets[target];
    // How far the water moves against the target in a step.
    let drift = [
        problem.dt * (problem.current[0] - state[2]),
        problem.dt * (problem.current[1] - state[3]),
    ];
    let Some(samples) = samples(problem, state, drift) else {
        return f64::INFINITY;
    };
    let count = samples.len();
    let d = problem.dimension;
    if count > if d == 2 { MOST_PAIRS } else { MOST_FOURS } {
        return f64::INFINITY;
    }
    let mut pairs = Vec::with_capacity(count * count);
    for one in &samples {
        if !look() {
            return f64::INFINITY;
        }
        for two in &samples {
            let weight = (one.weight * two.weight).sqrt();
            let apart = apart(problem, one, two, drift);
            pairs.push(weight * cross(one.near, two.near, apart));
        }
    }
    let n = problem.states();
    let prior = diagonal_block(&belief.prior, n, target * d, d);
    let known = prior.iter().any(|&entry| entry != 0.0);
    if d == 2 {
        let sum: f64 = (0..count)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| pairs[i * count + j] * pairs[i * count + j])
            .sum();
        // h^T adj(P) h is at most the larger eigenvalue of P times h^T h.
        let [a, b, _, c] = [prior[0], prior[1], prior[2], prior[3]];
        let top = 0.5 * (a + c) + hypot(0.5 * (a - c), b);
        let rows: f64 = samples.iter().map(|s| s.weight / (s.near * s.near)).sum();
        ((a * c - b * b).max(0.0) + top * rows + sum).ln()
    } else if known {
        f64::INFINITY
    } else {
        fours(&samples, &pairs, look).ln()
    }
}

/// All samples that can bear on a target, in the order of their times; `None` where one can
/// be taken on it.
fn samples(problem: &Problem, state: [f64; 4], drift: [f64; 2]) -> Option<Vec<Sample>> {
    let mut out = Vec::new();
    for step in 0..=problem.moves {
        for (observer, who) in problem.observers.iter().enumerate() {
            let k = step as f64;
            let away = hypot(
                who.start[0] + k * drift[0] - state[0],
                who.start[1] + k * drift[1] - state[1],
            );
            let near = away - k * who.speed[1] * problem.dt;
            let near = if step > 0 {
                near.max(problem.standoff)
            } else {
                near
            };
            // Rounding of coordinates must not make it larger.
            let near = near * (1.0 - 1e-12) - 1e-15 * away;
            if !(near > 0.0) {
                return None;
            }
            let weight: f64 = who
                .sensors
                .iter()
                .filter(|sensor| sensor.kind == Kind::Bearing && near <= sensor.reach)
                .map(|sensor| sensor.detection / (sensor.sigma * sensor.sigma))
                .sum();
            out.push(Sample {
                observer,
                step,
                time: problem.dt * k,
                near,
                weight,
            });
        }
    }
    Some(out)
}

/// How far two samples can be from each other, seen from the target.
fn apart(problem: &Problem, one: &Sample, two: &Sample, drift: [f64; 2]) -> f64 {
    let (a, b) = (
        &problem.observers[one.observer],
        &problem.observers[two.observer],
    );
    let steps = two.step as f64 - one.step as f64;
    let moved = |k: f64, speed: f64| k * speed * problem.dt;
    let away = if one.observer == two.observer {
        hypot(steps * drift[0], steps * drift[1]) + moved(steps.abs(), a.speed[1])
    } else {
        hypot(
            b.start[0] - a.start[0] + steps * drift[0],
            b.start[1] - a.start[1] + steps * drift[1],
        ) + moved(one.step as f64, a.speed[1])
            + moved(two.step as f64, b.speed[1])
    };
    away * (1.0 + 1e-12)
}

/// The largest sin(q, p) / (|q| |p|) of points no nearer than `a` and `b`, at most `apart`
/// from each other.
fn cross(a: f64, b: f64, apart: f64) -> f64 {
    let (a, b) = (a.max(b), a.min(b));
    if hypot(a, b) <= apart {
        return 1.0 / (a * b);
    }
    let inner = (a - apart) * (a + apart);
    if inner > 0.0 && inner >= b * hypot(a, apart) {
        return apart / (a * inner);
    }
    // 1 - c^2 as a product, so that near angles keep their digits.
    let (less, more) = (apart - (a - b), apart + (a - b));
    let other = (a + b - apart) * (a + b + apart);
    (less * more * other).max(0.0).sqrt() / (2.0 * (a * b) * (a * b))
}

/// The sum of the squares of all fours, bounded.
fn fours(samples: &[Sample], pairs: &[f64], look: &mut dyn FnMut() -> bool) -> f64 {
    let n = samples.len();
    let time = |i: usize| samples[i].time;
    let mut sum = 0.0;
    for i in 0..n {
        if !look() {
            return f64::INFINITY;
        }
        for j in i + 1..n {
            for k in j + 1..n {
                for l in k + 1..n {
                    let first = pairs[i * n + j] * pairs[k * n + l];
                    let second = pairs[i * n + k] * pairs[j * n + l];
                    let third = pairs[i * n + l] * pairs[j * n + k];
                    let u = (time(l) - time(i)) * (time(k) - time(j));
                    let v = (time(j) - time(i)) * (time(l) - time(k));
                    let least = (u * first + v * third)
                        .min((u + v) * first + v * second)
                        .min(u * second + (u + v) * third);
                    sum += least * least;
                }
            }
        }
    }
    sum
}

/// Rows first .. first + d of R^T R, and the same columns.
fn diagonal_block(rows: &[f64], n: usize, first: usize, d: usize) -> Vec<f64> {
    let mut sum = alloc::vec![0.0; d * d];
    for row in rows.chunks_exact(n) {
        crate::numbers::algebra::add_square(&row[first..first + d], 1.0, &mut sum);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    #[test]
    fn no_pair_of_points_is_above_its_bound() {
        let mut stream = Stream::new(5, 0);
        for _ in 0..2000 {
            let (a, b) = (0.2 + stream.uniform(), 0.2 + stream.uniform());
            let apart = 2.0 * stream.uniform();
            let bound = cross(a, b, apart);
            let mut best = 0.0_f64;
            for _ in 0..200 {
                let reach = if stream.uniform() < 0.5 { 0.05 } else { 1.0 };
                let r = a + reach * stream.uniform() * apart;
                let t = b + reach * stream.uniform() * apart;
                // The widest angle that the distance allows.
                let c = (r * r + t * t - apart * apart) / (2.0 * r * t);
                if c <= 1.0 {
                    let c = c.max(0.0);
                    best = best.max((1.0 - c * c).sqrt() / (r * t));
                }
            }
            assert!(best <= bound * (1.0 + 1e-12), "{a} {b} {apart}");
        }
    }

    #[test]
    fn the_bound_of_a_pair_is_reached() {
        // In all three cases there are points that come up to it.
        for (a, b, apart, range) in [
            (1.0, 0.8, 2.0, (1.0, 0.8)),
            (1.0, 0.3, 0.3, (1.0, 0.91 / 1.09_f64.sqrt())),
            (1.0, 0.9, 0.4, (1.0, 0.9)),
        ] {
            let (r, t): (f64, f64) = range;
            let c = ((r * r + t * t - apart * apart) / (2.0 * r * t)).max(0.0);
            let reached = (1.0 - c * c).sqrt() / (r * t);
            assert!((reached / cross(a, b, apart) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn fours_are_what_their_products_say() {
        let mut stream = Stream::new(7, 0);
        for _ in 0..200 {
            let h: [[f64; 2]; 4] = core::array::from_fn(|_| [stream.normal(), stream.normal()]);
            let mut t: [f64; 4] = core::array::from_fn(|_| stream.normal());
            t.sort_by(f64::total_cmp);
            let f = |i: usize, j: usize| h[i][0] * h[j][1] - h[i][1] * h[j][0];
            let (p, q, w) = (f(0, 1) * f(2, 3), f(0, 2) * f(1, 3), f(0, 3) * f(1, 2));
            let matrix =
                nalgebra::Matrix4::from_fn(|i, j| h[i][j % 2] * if j < 2 { 1.0 } else { t[i] });
            let wanted = matrix.determinant();
            let u = (t[3] - t[0]) * (t[2] - t[1]);
            let v = (t[1] - t[0]) * (t[3] - t[2]);
            for form in [u * p - v * w, (u + v) * p - v * q, u * q - (u + v) * w] {
                assert!((form - wanted).abs() < 1e-9 * (1.0 + wanted.abs()));
            }
        }
    }
}
