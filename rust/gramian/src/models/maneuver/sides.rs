//! Changes of side along a path: which of them make the determinant largest.

use alloc::vec;
use alloc::vec::Vec;

use crate::scalar::wrapped;

/// Legs up to which every sequence of sides is tried.
const EXHAUSTIVE: usize = 16;
/// Places of a change that are tried in pairs: all of them on a path of so many legs,
/// evenly spaced ones on a longer path.
const PAIRED: usize = 512;
/// A change of side must shorten the sum by more than rounding does.
const GAIN: f64 = 1e-12;

/// A plane vector as a complex number.
type Plane = [f64; 2];

fn product(a: Plane, b: Plane) -> Plane {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

fn sum(a: Plane, b: Plane) -> Plane {
    [a[0] + b[0], a[1] + b[1]]
}

fn difference(a: Plane, b: Plane) -> Plane {
    [a[0] - b[0], a[1] - b[1]]
}

fn mirrored(a: Plane) -> Plane {
    [a[0], -a[1]]
}

fn squared(a: Plane) -> f64 {
    a[0] * a[0] + a[1] * a[1]
}

/// The sides of the legs of a path of a [`Law`](super::Law) that make the determinant of
/// the information at its end large: 1 for right and -1 for left, the first leg to the right.
///
/// `bearings` and `ranges` are those of the samples of the path flown to one side. Every
/// sequence is tried up to 16 legs. On a longer path changes are added, moved and
/// taken back one and two at a time, from the path to one side on, until none gains: a
/// local optimum, never below one side.
///
/// # Source
/// Ours. A law looks at the range alone, so all sequences of sides share the ranges
/// and the sizes of the changes of bearing. With weights w = 1 / r^2 and bearings b,
/// 4 R^2 det J = (sum w)^2 - abs(sum w exp(2 i b))^2, and a change of side mirrors what
/// follows it: the second sum is to be made small.
///
/// ```
/// use gramian::maneuver::best_sides;
/// // Steps of 50 deg: straight round, the third bearing comes near the opposite of the first.
/// let bearings = [0.0, -0.87, -1.74, -2.61, -3.48];
/// let mut sides = [0.0; 4];
/// best_sides(&bearings, &[1.0; 5], &mut sides);
/// assert!(sides.iter().all(|side| side.abs() == 1.0));
/// ```
pub fn best_sides(bearings: &[f64], ranges: &[f64], sides: &mut [f64]) {
    sides.fill(1.0);
    let samples = bearings.len().min(ranges.len()).min(sides.len() + 1);
    if samples < 3 {
        return;
    }
    let least = ranges[..samples]
        .iter()
        .fold(f64::INFINITY, |a, &b| a.min(b));
    if !(least > 0.0 && bearings[..samples].iter().all(|b| b.is_finite())) {
        return;
    }
    let steps: Vec<f64> = (1..samples)
        .map(|k| wrapped(bearings[k] - bearings[k - 1]))
        .collect();
    let weights: Vec<f64> = ranges[..samples]
        .iter()
        .map(|&range| (least / range).powi(2))
        .collect();
    let sides = &mut sides[..samples - 1];
    if sides.len() <= EXHAUSTIVE {
        exhaustive(&steps, &weights, sides);
    } else {
        local(&steps, &weights, sides);
    }
}

/// Twice the bearings as unit vectors, from the first on, weighted.
fn terms(steps: &[f64], weights: &[f64], sides: &[f64]) -> (Vec<Plane>, Vec<Plane>) {
    let mut angle = 0.0;
    let mut units = vec![[1.0, 0.0]];
    for (&step, &side) in steps.iter().zip(sides) {
        angle += 2.0 * side * step;
        let (sin, cos) = angle.sin_cos();
        units.push([cos, sin]);
    }
    let mut before = vec![[0.0; 2]];
    for (unit, &w) in units.iter().zip(weights) {
        let last = before[before.len() - 1];
        before.push(sum(last, [w * unit[0], w * unit[1]]));
    }
    (units, before)
}

fn exhaustive(steps: &[f64], weights: &[f64], sides: &mut [f64]) {
    let turns: Vec<Plane> = steps
        .iter()
        .map(|&step| {
            let (sin, cos) = (2.0 * step).sin_cos();
            [cos, sin]
        })
        .collect();
    let mut best = (f64::INFINITY, 0_u32);
    for pattern in 0..1_u32 << (steps.len() - 1) {
        let mut unit = [1.0, 0.0];
        let mut total = [weights[0], 0.0];
        for (leg, &turn) in turns.iter().enumerate() {
            let left = leg > 0 && pattern >> (leg - 1) & 1 == 1;
            unit = product(unit, if left { mirrored(turn) } else { turn });
            total = sum(
                total,
                [weights[leg + 1] * unit[0], weights[leg + 1] * unit[1]],
            );
        }
        let size = squared(total);
        if size < best.0 * (1.0 - GAIN) {
            best = (size, pattern);
        }
    }
    for (leg, side) in sides.iter_mut().enumerate().skip(1) {
        if best.1 >> (leg - 1) & 1 == 1 {
            *side = -1.0;
        }
    }
}

fn local(steps: &[f64], weights: &[f64], sides: &mut [f64]) {
    let legs = sides.len();
    let stride = legs.div_ceil(PAIRED);
    loop {
        let (units, before) = terms(steps, weights, sides);
        let all = before[legs + 1];
        // What a change of side after leg k makes of the samples behind it.
        let mirror = |k: usize| product(units[k], units[k]);
        let mut best = (squared(all) * (1.0 - GAIN), None);
        let mut offer = |total: Plane, changes: (usize, Option<usize>)| {
            let size = squared(total);
            if size < best.0 {
                best = (size, Some(changes));
            }
        };
        for k in 1..legs {
            let rest = mirrored(difference(all, before[k + 1]));
            offer(sum(before[k + 1], product(mirror(k), rest)), (k, None));
        }
        for k in (1..legs).step_by(stride) {
            let turned = mirror(k);
            for l in (k + stride..legs).step_by(stride) {
                let between = mirrored(difference(before[l + 1], before[k + 1]));
                let turn = product(turned, mirrored(mirror(l)));
                let rest = product(turn, difference(all, before[l + 1]));
                let total = sum(sum(before[k + 1], product(turned, between)), rest);
                offer(total, (k, Some(l)));
            }
        }
        let Some((k, other)) = best.1 else {
            return;
        };
        for change in [Some(k), other].into_iter().flatten() {
            for side in &mut sides[change..] {
                *side = -*side;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum to be made small, by its definition.
    fn size(bearings: &[f64], ranges: &[f64], sides: &[f64]) -> f64 {
        let mut bearing = 0.0;
        let mut total = [1.0 / ranges[0].powi(2), 0.0];
        for k in 1..bearings.len() {
            bearing += sides[k - 1] * wrapped(bearings[k] - bearings[k - 1]);
            let w = 1.0 / ranges[k].powi(2);
            total = sum(
                total,
                [w * (2.0 * bearing).cos(), w * (2.0 * bearing).sin()],
            );
        }
        squared(total)
    }

    #[test]
    fn the_search_of_long_paths_is_near_the_best_of_short_ones_and_never_below_one_side() {
        for legs in [3, 7, 12, 16] {
            for scale in [0.02, 0.1, 0.3, 0.8] {
                let bearings: Vec<f64> = (0..=legs)
                    .map(|k| -scale * k as f64 * (1.0 + 0.02 * k as f64))
                    .collect();
                let ranges: Vec<f64> = (0..=legs).map(|k| 100.0 - k as f64).collect();
                let mut best = vec![0.0; legs];
                best_sides(&bearings, &ranges, &mut best);
                let steps: Vec<f64> = (1..=legs)
                    .map(|k| wrapped(bearings[k] - bearings[k - 1]))
                    .collect();
                let weights: Vec<f64> = ranges.iter().map(|r| 1.0 / (r * r)).collect();
                let mut found = vec![1.0; legs];
                local(&steps, &weights, &mut found);
                let one = size(&bearings, &ranges, &vec![1.0; legs]);
                let all: f64 = weights.iter().sum();
                let (best, found) = (
                    size(&bearings, &ranges, &best),
                    size(&bearings, &ranges, &found),
                );
                assert!(best <= found * (1.0 + 1e-9) + 1e-15 * all * all);
                assert!(found <= one * (1.0 + 1e-9));
                // In terms of the determinant the two are near.
                assert!(all * all - found >= 0.9 * (all * all - best));
            }
        }
    }
}
