//! The four instants of a track with the largest discriminant.

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;

use super::discriminant::{Method, Quadruples, SHARED, Scratch, cost};
use crate::batch::simd::Path;
use crate::batch::{Items, Threads};
use crate::bearings::{self, Form};
use crate::numbers::algebra::dot;

/// Four instants and their discriminant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quadruple {
    /// Their indices, ascending.
    pub indices: [usize; 4],
    /// D, with its sign.
    pub value: f64,
}

/// Up to this many bearings [`best_quadruple`] searches all quadruples.
pub const EXACT: usize = 200;

/// The four instants with the largest |D| in a track of at least four.
///
/// Exact up to [`EXACT`] bearings. Above, rows of maximum volume are selected
/// and then improved by exchanging any two of the four at once until nothing
/// better is found, which reaches a local maximum, in practice the global one.
///
/// # Errors
/// As [`bearings::check_track`], with four bearings at least.
pub fn best_quadruple(
    times: &[f64],
    bearings: &[f64],
    threads: Threads,
) -> Result<Quadruple, bearings::Error> {
    bearings::check_track(times, bearings, None, 4)?;
    let value = |indices: [usize; 4]| -> Result<Quadruple, bearings::Error> {
        let value = bearings::discriminant(
            &indices.map(|i| times[i]),
            &indices.map(|i| bearings[i]),
            Form::Sines,
        )?;
        Ok(Quadruple { indices, value })
    };
    if times.len() > EXACT {
        return value(select(times, bearings));
    }
    let mut all = Quadruples::new(times.len(), Method::Direct, Path::Best);
    all.load(times, bearings, None)?;
    let m = times.len();
    let mut parts = vec![0.0; 2 * m];
    let cost = 4.0 * cost(m, Method::Direct) / m as f64;
    let each = |scratch: &mut Scratch, j: usize, out: &mut [f64]| -> Result<(), Infallible> {
        let (largest, k) = all.largest(j, scratch);
        (out[0], out[1]) = (largest, k as f64);
        Ok(())
    };
    let Ok(()) = threads.over_with(&mut parts, 2, cost, || all.scratch(), each);
    let mut middle = (-1.0, 0, 0);
    for (j, part) in parts.chunks_exact(2).enumerate() {
        if part[0] > middle.0 {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let k = part[1] as usize;
            middle = (part[0], j, k);
        }
    }
    let (_, j, k) = middle;
    let mut best = value([0, j, k, m - 1])?;
    for i in 0..j {
        for l in k + 1..m {
            let other = value([i, j, k, l])?;
            if other.value.abs() > best.value.abs() {
                best = other;
            }
        }
    }
    Ok(best)
}

/// Four rows of (locally) maximum volume.
fn select(times: &[f64], bearings: &[f64]) -> [usize; 4] {
    let m = times.len();
    let (origin, half) = bearings::middle(times);
    let rows: Vec<[f64; 4]> = (0..m)
        .map(|i| {
            let (s, c) = (bearings[i] - bearings[m / 2]).sin_cos();
            let time = (times[i] - origin) / half;
            [c, time * c, s, time * s]
        })
        .collect();
    // Greedy start: always the row farthest from the span of those chosen.
    let mut left = rows.clone();
    let mut chosen = [0; 4];
    for n in 0..4 {
        let (best, norm) = largest(&left);
        chosen[n] = best;
        if norm > 0.0 {
            let direction = left[best].map(|x| x / norm.sqrt());
            remove(&mut left, &direction);
        }
    }
    // Exchange two of the four at a time: with the other two fixed, the volume
    // is the area that the rows span in the plane orthogonal to these.
    for _ in 0..20 {
        let before = chosen;
        for a in 0..4 {
            for b in a + 1..4 {
                let fixed: Vec<usize> = (0..4).filter(|n| *n != a && *n != b).collect();
                let mut left = rows.clone();
                for &n in &fixed {
                    let norm = dot(&left[chosen[n]], &left[chosen[n]]);
                    if norm > 0.0 {
                        let direction = left[chosen[n]].map(|x| x / norm.sqrt());
                        remove(&mut left, &direction);
                    }
                }
                if let Some(pair) = widest_pair(&left, chosen[a], chosen[b]) {
                    (chosen[a], chosen[b]) = pair;
                }
            }
        }
        if chosen == before {
            break;
        }
    }
    chosen.sort_unstable();
    chosen
}

fn largest(rows: &[[f64; 4]]) -> (usize, f64) {
    let mut best = (0, -1.0);
    for (i, row) in rows.iter().enumerate() {
        let norm = dot(row, row);
        if norm > best.1 {
            best = (i, norm);
        }
    }
    best
}

fn remove(rows: &mut [[f64; 4]], direction: &[f64; 4]) {
    for row in rows {
        let along = dot(row, direction);
        for (x, d) in row.iter_mut().zip(direction) {
            *x -= along * d;
        }
    }
}

/// The two rows, all in one plane, that span the largest area; `None` where none
/// span more than `a` and `b` do.
///
/// Both are corners of the convex hull of the rows and their opposites.
fn widest_pair(rows: &[[f64; 4]], a: usize, b: usize) -> Option<(usize, usize)> {
    // Axes in the plane: along the longest row, and across.
    let (longest, norm) = largest(rows);
    if norm <= 0.0 {
        return None;
    }
    let first = rows[longest].map(|x| x / norm.sqrt());
    let mut rest = rows.to_vec();
    remove(&mut rest, &first);
    let (farthest, norm) = largest(&rest);
    if norm <= 0.0 {
        return None;
    }
    let second = rest[farthest].map(|x| x / norm.sqrt());
    let mut points: Vec<(f64, f64, usize)> = Vec::with_capacity(2 * rows.len());
    for (i, row) in rows.iter().enumerate() {
        let (x, y) = (dot(row, &first), dot(row, &second));
        points.extend([(x, y, i), (-x, -y, i)]);
    }
    let area = |p: &(f64, f64, usize), q: &(f64, f64, usize)| (p.0 * q.1 - p.1 * q.0).abs();
    let now = area(&points[2 * a], &points[2 * b]);
    let hull = convex_hull(points);
    let mut best = (now * (1.0 + 1e-12), None);
    for (n, p) in hull.iter().enumerate() {
        for q in &hull[n + 1..] {
            if area(p, q) > best.0 {
                best = (area(p, q), Some((p.2, q.2)));
            }
        }
    }
    best.1
}

/// The corners of the convex hull (Andrew's monotone chain).
fn convex_hull(mut points: Vec<(f64, f64, usize)>) -> Vec<(f64, f64, usize)> {
    points.sort_unstable_by(|p, q| p.0.total_cmp(&q.0).then(p.1.total_cmp(&q.1)));
    let mut hull: Vec<(f64, f64, usize)> = Vec::new();
    for pass in 0..2 {
        let start = hull.len();
        for &p in &points {
            while hull.len() >= start + 2 {
                let (o, q) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if (q.0 - o.0) * (p.1 - o.1) - (q.1 - o.1) * (p.0 - o.0) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
        if pass == 0 {
            points.reverse();
        }
    }
    hull
}

/// [`best_quadruple`] of each trial: four indices and D.
///
/// # Errors
/// As [`bearings::check_track`], with the trial.
pub fn best_quadruples(
    times: Items<'_>,
    bearings: Items<'_>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let cost = 4.0 * cost(times.get(0).len().min(EXACT), Method::Direct);
    let one = |trial: usize, out: &mut [f64], threads: Threads| {
        let best = best_quadruple(times.get(trial), bearings.get(trial), threads)
            .map_err(|error| (trial, error))?;
        for n in 0..4 {
            out[n] = best.indices[n] as f64;
        }
        out[4] = best.value;
        Ok(())
    };
    if cost > SHARED {
        for (trial, out) in out.chunks_exact_mut(5).enumerate() {
            one(trial, out, threads)?;
        }
        return Ok(());
    }
    threads.over(out, 5, cost, |trial, out| one(trial, out, Threads::One))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::discriminant::tests::{close, track};
    use super::*;

    #[test]
    fn the_best_quadruple_is_the_best() {
        for (m, turn) in [(4, 1.0), (9, 0.3), (20, 1.57), (31, -2.0)] {
            let (times, bearings) = track(m, turn);
            let found = best_quadruple(&times, &bearings, Threads::One).unwrap();
            let mut best = 0.0_f64;
            for i in 0..m {
                for j in i + 1..m {
                    for k in j + 1..m {
                        for l in k + 1..m {
                            let four = [i, j, k, l];
                            let d = bearings::discriminant(
                                &four.map(|i| times[i]),
                                &four.map(|i| bearings[i]),
                                Form::Sines,
                            );
                            best = best.max(d.unwrap().abs());
                        }
                    }
                }
            }
            close(found.value.abs(), best, 1e-14, "exact");
            let selected = select(&times, &bearings);
            let d = bearings::discriminant(
                &selected.map(|i| times[i]),
                &selected.map(|i| bearings[i]),
                Form::Sines,
            );
            close(d.unwrap().abs(), best, 0.05, "selected");
        }
    }
}
