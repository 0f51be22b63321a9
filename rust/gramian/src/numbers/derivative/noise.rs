//! How noisy a function is, by tables of its differences.

use alloc::vec;
use alloc::vec::Vec;

use super::column::Column;
use super::ladder::Pair;
use super::{Options, change};

/// How far apart the points are at which noise is measured, close and wide.
pub(super) fn noise_spacing(
    columns: &[Column<'_>],
    weight: &[f64],
    noise: &[f64],
) -> Vec<[f64; 2]> {
    // Of one state they are steps of its ladder.
    let longest = if columns.len() == 1 { 0.125 } else { 1.0 };
    columns
        .iter()
        .map(|column| [false, true].map(|wide| column.spacing(wide, longest, weight, noise)))
        .collect()
}

/// Where noise is measured.
pub(super) struct Line<'a> {
    /// For each state how far apart the points are, close and wide.
    pub spacing: &'a [[f64; 2]],
    /// How many close ones there are on one side.
    pub close: usize,
    /// How many wide ones there are on either side.
    pub wide: usize,
    /// For each output whether its noise is known.
    pub given: &'a [bool],
}

/// Noise along one direction in which all states move a little, from the differences of
/// equally spaced values: close ones for rounding, wide ones for what changes now and
/// then, such as printed digits or the steps of a solver. Returns the values at the wide
/// ones: below and above x, the nearest first; and the noise that the close ones alone show,
/// 0 where the wide ones show as much.
pub(super) fn measure_noise<E>(
    x: &[f64],
    at: &[f64],
    options: &Options<'_>,
    line: &Line<'_>,
    noise: &mut [f64],
    evaluate: &mut impl FnMut(&[f64], &mut [f64]) -> Result<(), E>,
) -> Result<[Vec<f64>; 2], E> {
    let (n, m, wide) = (x.len(), at.len(), line.wide);
    let close: Vec<f64> = (1..=line.close).map(|k| k as f64).collect();
    let far: Vec<f64> = (1..=wide).flat_map(|k| [-(k as f64), k as f64]).collect();
    let mut points = Vec::with_capacity((close.len() + far.len()) * n);
    for (place, multiples) in [&close, &far].into_iter().enumerate() {
        for k in multiples {
            points.extend((0..n).map(|j| x[j] + line.spacing[j][place] * k));
        }
    }
    let mut values = vec![f64::NAN; (close.len() + far.len()) * m];
    evaluate(&points, &mut values)?;
    let mut alone = vec![0.0; m];
    for i in (0..m).filter(|&i| !line.given[i]) {
        let value = |k: usize| change(values[k * m + i], at[i], options.period[i]);
        let near: Vec<f64> = core::iter::once(0.0)
            .chain((0..close.len()).map(value))
            .collect();
        let near = close_noise(near);
        // In order: from the last point below x to the last above.
        let below = (0..wide).rev().map(|k| value(close.len() + 2 * k));
        let above = (0..wide).map(|k| value(close.len() + 2 * k + 1));
        let apart = wide_noise(below.chain([0.0]).chain(above).collect());
        if near > apart {
            alone[i] = near;
        }
        noise[i] = noise[i].max(near).max(apart);
    }
    Ok([values.split_off(close.len() * m), alone])
}

/// Noise by the differences of each order of equally spaced values; 0 for values that
/// are not finite.
fn levels(mut table: Vec<f64>) -> Vec<f64> {
    let count = table.len();
    if table.iter().any(|v| !v.is_finite()) {
        return vec![0.0; count];
    }
    let (mut levels, mut gamma) = (vec![0.0; count], 1.0);
    for order in 1..count {
        let left = count - order;
        for k in 0..left {
            table[k] = table[k + 1] - table[k];
        }
        // (k!)^2 / (2k)!
        gamma *= order as f64 / (2.0 * (2.0 * order as f64 - 1.0));
        let square: f64 = table[..left].iter().map(|d| d * d).sum();
        levels[order] = (gamma * square / left as f64).sqrt();
    }
    levels
}

/// Of values so close that differences of order 3 to 5 hold nothing of a smooth function.
fn close_noise(line: Vec<f64>) -> f64 {
    let levels = levels(line);
    levels
        .iter()
        .skip(3)
        .take(3)
        .fold(0.0, |most, x| most.max(*x))
}

/// Of values so far apart that a smooth function still shows in all differences, but
/// falls from one order to the next, as noise does not.
fn wide_noise(line: Vec<f64>) -> f64 {
    let levels = levels(line);
    let [.., a, b, c] = levels.as_slice() else {
        return 0.0;
    };
    if *c > 0.2 * a && *b > 0.2 * a {
        b.max(*c)
    } else {
        0.0
    }
}

/// Noise that the ladders show and the table did not, such as that of a solver whose
/// steps change: the even part without its square, which should fall sixteenfold.
pub(super) fn from_ladders(columns: &[Column<'_>], noise: &mut [f64], given: &[bool]) {
    let m = noise.len();
    let (mut sum, mut count) = (vec![0.0; m], vec![0.0; m]);
    for column in columns {
        let pairs: Vec<&Pair> = column.used().collect();
        for window in pairs.windows(3) {
            for (k, i) in column.each(m).enumerate() {
                let quartic = |a: &Pair, b: &Pair| {
                    let ratio = a.step / b.step;
                    a.even[k] - ratio * ratio * b.even[k]
                };
                let (first, second) =
                    (quartic(window[0], window[1]), quartic(window[1], window[2]));
                let ratio = window[1].step / window[2].step;
                let spread = (0.5 + 0.5 * ratio.powi(4) + (ratio * ratio - 1.0).powi(2)).sqrt();
                let sample = second.abs() / spread;
                let [a, b, c] = [0, 1, 2].map(|k| window[k].step * window[k].step);
                let fall = b * (b - c) / (a * (a - b));
                if second.abs() > 6.4 * fall * first.abs() && sample > 4.0 * noise[i] {
                    sum[i] += sample * sample;
                    count[i] += 1.0;
                }
            }
        }
    }
    for i in 0..m {
        if count[i] > 0.0 && !given[i] {
            noise[i] = noise[i].max((sum[i] / count[i]).sqrt());
        }
    }
}
