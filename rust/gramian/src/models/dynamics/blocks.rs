//! Many intervals of a trajectory at once: one Newton iteration for the stages of all their
//! steps, so that each function is called once for all of them. It is for systems whose
//! functions take many points nearly as quickly as one.
//!
//! # Source
//! Ascher, Mattheij & Russell, Numerical Solution of Boundary Value Problems for Ordinary
//! Differential Equations, 5.4 (quasilinearisation of collocation over a whole mesh).

use alloc::vec;
use alloc::vec::Vec;

use super::trajectory::{STAGES, System, gauss, product, solve_block};
use crate::scalar::all_finite;

/// One step of the integrator.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub from: f64,
    pub size: f64,
    /// Begins anew, at a state that is given, and not where the step before ended.
    pub anew: bool,
}

/// Equal steps in each interval of `times`; `anew`: every interval from a state of its own.
pub(super) fn mesh(times: &[f64], substeps: &[usize], anew: bool) -> Vec<Step> {
    let mut steps = Vec::new();
    for (k, (pair, &count)) in times.windows(2).zip(substeps).enumerate() {
        let size = (pair[1] - pair[0]) / count as f64;
        for i in 0..count {
            steps.push(Step {
                from: pair[0] + size * i as f64,
                size,
                anew: i == 0 && (anew || k == 0),
            });
        }
    }
    steps
}

/// States and transitions at the end of each interval.
#[derive(Debug)]
pub(super) struct Ends {
    pub states: Vec<f64>,
    pub transitions: Vec<f64>,
}

/// A solution on a mesh.
#[derive(Debug)]
struct Stages {
    /// The states at the stages: steps x 3 x n.
    points: Vec<f64>,
    /// The rates there.
    rates: Vec<f64>,
}

/// The ends of all intervals. `starts` holds the state of every step that begins anew, `guess`
/// the states at the beginnings of all intervals as far as they are known; `None` where the
/// iteration does not settle.
pub(super) fn ends<S: System>(
    system: &mut S,
    mesh: &[Step],
    substeps: &[usize],
    starts: &[f64],
    guess: &[f64],
) -> Result<Option<Ends>, S::Error> {
    let n = system.states();
    let mut points = Vec::with_capacity(mesh.len() * STAGES * n);
    let intervals = substeps.len();
    for (k, &count) in substeps.iter().enumerate() {
        let (x, y) = (
            &guess[k * n..(k + 1) * n],
            &guess[(k + 1).min(intervals) * n..],
        );
        for i in 0..count {
            for c in gauss::NODES {
                let part = (i as f64 + c) / count as f64;
                points.extend(x.iter().zip(y).map(|(x, y)| x + part * (y - x)));
            }
        }
    }
    let times: Vec<f64> = mesh
        .iter()
        .flat_map(|step| gauss::NODES.map(|c| step.from + c * step.size))
        .collect();
    let Some(stages) = settle(system, mesh, &times, starts, points)? else {
        return Ok(None);
    };
    let mut local = vec![0.0; mesh.len() * STAGES * n * n];
    system.rate_jacobian(&times, &stages.points, &mut local)?;
    if !all_finite(&local) {
        return Ok(None);
    }
    let mut found = Ends {
        states: Vec::with_capacity(intervals * n),
        transitions: Vec::with_capacity(intervals * n * n),
    };
    let mut begins = starts.chunks_exact(n);
    let (mut x, mut k) = (vec![0.0; n], 0);
    for &count in substeps {
        let mut phi: Vec<f64> = Vec::new();
        for _ in 0..count {
            if mesh[k].anew {
                let Some(begin) = begins.next() else {
                    return Ok(None);
                };
                x.copy_from_slice(begin);
            }
            let h = mesh[k].size;
            advance(
                &mut x,
                &stages.rates[k * STAGES * n..(k + 1) * STAGES * n],
                h,
            );
            let jacobian = &local[k * STAGES * n * n..(k + 1) * STAGES * n * n];
            let Some(step) = transition(jacobian, h, n) else {
                return Ok(None);
            };
            phi = if phi.is_empty() {
                step
            } else {
                product(&step, &phi, n)
            };
            k += 1;
        }
        found.states.extend_from_slice(&x);
        found.transitions.extend(phi);
    }
    let fine = all_finite(&found.states) && all_finite(&found.transitions);
    Ok(fine.then_some(found))
}

/// The derivative of one step: d rates from (I - h A (x) J) dK = J.
pub(super) fn transition(jacobian: &[f64], h: f64, n: usize) -> Option<Vec<f64>> {
    let derivative = solve_block(jacobian, h, n, jacobian.to_vec(), n)?;
    let mut step = vec![0.0; n * n];
    for i in 0..n {
        step[i * n + i] = 1.0;
    }
    for (s, weight) in gauss::WEIGHTS.iter().enumerate() {
        for (y, d) in step.iter_mut().zip(&derivative[s * n * n..]) {
            *y += h * weight * d;
        }
    }
    Some(step)
}

/// x at the end of a step.
pub(super) fn advance(x: &mut [f64], rates: &[f64], h: f64) {
    let n = x.len();
    for (s, weight) in gauss::WEIGHTS.iter().enumerate() {
        for (x, rate) in x.iter_mut().zip(&rates[s * n..]) {
            *x += h * weight * rate;
        }
    }
}

/// Newton's iteration for the stages of all steps.
fn settle<S: System>(
    system: &mut S,
    mesh: &[Step],
    times: &[f64],
    starts: &[f64],
    mut points: Vec<f64>,
) -> Result<Option<Stages>, S::Error> {
    let n = system.states();
    let block = STAGES * n;
    let mut rates = vec![0.0; points.len()];
    let mut jacobians = vec![0.0; points.len() * n];
    let mut before = f64::INFINITY;
    for round in 0..14 {
        system.rate(times, &points, &mut rates)?;
        // Near the solution the derivative changes no more.
        if !(before < 1e-6) {
            system.rate_jacobian(times, &points, &mut jacobians)?;
        }
        if !(all_finite(&rates) && all_finite(&jacobians)) {
            return Ok(None);
        }
        let mut begins = starts.chunks_exact(n);
        let mut x = vec![0.0; n];
        let (mut change, mut size) = (vec![0.0_f64; n], vec![0.0_f64; n]);
        for (k, step) in mesh.iter().enumerate() {
            if step.anew {
                let Some(begin) = begins.next() else {
                    return Ok(None);
                };
                x.copy_from_slice(begin);
            }
            let here = &mut points[k * block..(k + 1) * block];
            let jacobian = &jacobians[k * block * n..(k + 1) * block * n];
            // K = f + J (x + h A K - p)
            let mut right = rates[k * block..(k + 1) * block].to_vec();
            for r in 0..STAGES {
                for i in 0..n {
                    let line = &jacobian[(r * n + i) * n..(r * n + i + 1) * n];
                    let moved = line.iter().zip(&x).zip(&here[r * n..]);
                    right[r * n + i] += moved.map(|((j, x), p)| j * (x - p)).sum::<f64>();
                }
            }
            let Some(solved) = solve_block(jacobian, step.size, n, right, 1) else {
                return Ok(None);
            };
            for (r, row) in gauss::MATRIX.iter().enumerate() {
                for i in 0..n {
                    let sum: f64 = (0..STAGES).map(|s| row[s] * solved[s * n + i]).sum();
                    let point = x[i] + step.size * sum;
                    change[i] = change[i].max((point - here[r * n + i]).abs());
                    size[i] = size[i].max(point.abs());
                    here[r * n + i] = point;
                }
            }
            advance(&mut x, &solved, step.size);
            rates[k * block..(k + 1) * block].copy_from_slice(&solved);
        }
        if !all_finite(&points) {
            return Ok(None);
        }
        let now = change.iter().zip(&size).fold(0.0_f64, |top, (c, s)| {
            top.max(if *c > 0.0 { c / s } else { 0.0 })
        });
        // Rounding does not let it go further.
        if now <= 1e-14 || (now < 1e-10 && now >= 0.25 * before) {
            return Ok(Some(Stages { points, rates }));
        }
        if round > 5 && now >= 0.5 * before {
            return Ok(None);
        }
        before = now;
    }
    Ok(None)
}
