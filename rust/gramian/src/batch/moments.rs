//! Moments of what came of many trials, summed along one binary tree.
//!
//! The trials are the leaves of the tree: a leaf holds [`LEAF`] neighbouring
//! trials, and a node is the merge of its two children. A chunk of a power of two
//! of trials that begins at a multiple of its size is a whole subtree, so a run
//! cut in other chunks goes through the same additions and ends in the same bits.

use alloc::{vec, vec::Vec};

/// Trials that are summed directly.
pub const LEAF: usize = 16;

/// Numbers in a node for vectors of `d`: count (1), mean (d), sum of products of
/// deviations from the mean (d x d), sum of fourth powers of the values
/// themselves (d), lowest (d) and highest (d).
///
/// ```
/// use gramian::batch::moments::{moments, size};
/// let mut node = [0.0; size(1)];
/// moments(&[1.0, 3.0, 8.0], &[true; 3], 1, &mut node);
/// assert_eq!(node, [3.0, 4.0, 26.0, 4178.0, 1.0, 8.0]);
/// ```
pub const fn size(d: usize) -> usize {
    1 + 4 * d + d * d
}

/// Writes the node of the trials that are `ok` to `out`, [`size`] numbers.
/// `values` holds `d` for each trial of `ok`, `d` at least 1.
pub fn moments(values: &[f64], ok: &[bool], d: usize, out: &mut [f64]) {
    let size = size(d);
    // State by state, so that each sum runs over neighbours in memory.
    let mut columns = vec![[0.0; LEAF]; d];
    // Subtrees that wait for their other half, the latest last.
    let mut waiting: Vec<f64> = Vec::new();
    let leaves = values.chunks(LEAF * d.max(1)).zip(ok.chunks(LEAF));
    for (leaf, (values, ok)) in leaves.enumerate() {
        let mut weights = [0.0; LEAF];
        for (weight, &ok) in weights.iter_mut().zip(ok) {
            *weight = f64::from(u8::from(ok));
        }
        for (i, column) in columns.iter_mut().enumerate() {
            *column = [0.0; LEAF];
            let state = values.iter().skip(i).step_by(d);
            for ((entry, &value), &ok) in column.iter_mut().zip(state).zip(ok) {
                *entry = if ok { value } else { 0.0 };
            }
        }
        let start = waiting.len();
        waiting.resize(start + size, 0.0);
        write_leaf(&mut columns, &weights, &mut waiting[start..]);
        // Each leaf that fills a subtree closes it, and those that it fills.
        for _ in 0..(leaf + 1).trailing_zeros() {
            merge_last(&mut waiting, d);
        }
    }
    // The rest of the tree is empty.
    while waiting.len() > size {
        merge_last(&mut waiting, d);
    }
    if waiting.is_empty() {
        waiting.resize(size, 0.0);
        columns.fill([0.0; LEAF]);
        write_leaf(&mut columns, &[0.0; LEAF], &mut waiting);
    }
    out.copy_from_slice(&waiting);
}

fn merge_last(waiting: &mut Vec<f64>, d: usize) {
    let right = waiting.len() - size(d);
    let (rest, last) = waiting.split_at_mut(right);
    merge(d, &mut rest[right - size(d)..], last);
    waiting.truncate(right);
}

/// Replaces `left` by the node of both (Chan, Golub & `LeVeque` 1983).
///
/// Exactly `left` where `right` is empty, and the other way round, so padding
/// changes nothing.
pub fn merge(d: usize, left: &mut [f64], right: &[f64]) {
    let count = left[0] + right[0];
    let share = right[0] / count.max(1.0);
    let weight = left[0] * share;
    let [mean, scatter, fourth, low] = [1, 1 + d, 1 + d + d * d, 1 + 2 * d + d * d];
    for i in 0..d {
        let change = right[mean + i] - left[mean + i];
        for j in 0..d {
            // The other state's mean is still that of the left where j > i.
            let other = right[mean + j] - left[mean + j];
            let k = scatter + i * d + j;
            left[k] = left[k] + right[k] + change * other * weight;
        }
    }
    for i in 0..d {
        left[mean + i] += (right[mean + i] - left[mean + i]) * share;
        left[fourth + i] += right[fourth + i];
        left[low + i] = left[low + i].min(right[low + i]);
        left[low + d + i] = left[low + d + i].max(right[low + d + i]);
    }
    left[0] = count;
}

/// The node of one leaf; entries of weight zero are zero. Spoils `columns`.
fn write_leaf(columns: &mut [[f64; LEAF]], weights: &[f64; LEAF], out: &mut [f64]) {
    let d = columns.len();
    let [mean, scatter, fourth, low] = [1, 1 + d, 1 + d + d * d, 1 + 2 * d + d * d];
    out[0] = sum(weights);
    for (i, column) in columns.iter_mut().enumerate() {
        out[mean + i] = sum(column) / out[0].max(1.0);
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut powers = [0.0; LEAF];
        for k in 0..LEAF {
            let value = column[k];
            if weights[k] > 0.0 {
                least = least.min(value);
                most = most.max(value);
            }
            powers[k] = value * value * (value * value);
            column[k] = (value - out[mean + i]) * weights[k];
        }
        out[fourth + i] = sum(&powers);
        out[low + i] = least;
        out[low + d + i] = most;
    }
    for i in 0..d {
        for j in 0..=i {
            let mut products = [0.0; LEAF];
            for k in 0..LEAF {
                products[k] = columns[i][k] * columns[j][k];
            }
            let product = sum(&products);
            out[scatter + i * d + j] = product;
            out[scatter + j * d + i] = product;
        }
    }
}

/// The sum by halves: one order on every machine.
#[inline]
fn sum(values: &[f64; LEAF]) -> f64 {
    let mut sums = *values;
    let mut half = LEAF / 2;
    while half > 0 {
        for k in 0..half {
            sums[k] += sums[k + half];
        }
        half /= 2;
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    fn node(values: &[[f64; 2]], keep: impl Fn(usize) -> bool) -> [f64; size(2)] {
        let ok: Vec<bool> = (0..values.len()).map(keep).collect();
        let mut out = [0.0; size(2)];
        moments(values.as_flattened(), &ok, 2, &mut out);
        out
    }

    fn drawn(trials: usize) -> Vec<[f64; 2]> {
        let mut stream = Stream::new(3, 0);
        (0..trials)
            .map(|_| [1e3 + stream.normal(), stream.normal() - 7.0])
            .collect()
    }

    #[test]
    fn they_are_the_moments() {
        for trials in [1, 2, 15, 16, 17, 100, 1000] {
            let values = drawn(trials);
            let keep = |trial: usize| trials < 3 || trial % 3 != 1;
            let found = node(&values, keep);
            let kept: Vec<[f64; 2]> = (0..trials)
                .filter(|&trial| keep(trial))
                .map(|trial| values[trial])
                .collect();
            let count = kept.len() as f64;
            assert_eq!(found[0], count);
            let mean = [0, 1].map(|i| kept.iter().map(|v| v[i]).sum::<f64>() / count);
            for i in 0..2 {
                assert!((found[1 + i] - mean[i]).abs() < 1e-9);
                for j in 0..2 {
                    let scatter: f64 = kept
                        .iter()
                        .map(|v| (v[i] - mean[i]) * (v[j] - mean[j]))
                        .sum();
                    assert!((found[3 + 2 * i + j] - scatter).abs() < 1e-8 * (1.0 + count));
                }
                let fourth: f64 = kept.iter().map(|v| v[i].powi(4)).sum();
                assert!((found[7 + i] / fourth - 1.0).abs() < 1e-12);
                let ordered = |best: fn(f64, f64) -> f64| kept.iter().map(|v| v[i]).reduce(best);
                assert_eq!(Some(found[9 + i]), ordered(f64::min));
                assert_eq!(Some(found[11 + i]), ordered(f64::max));
            }
        }
    }

    #[test]
    fn subtrees_merge_to_the_bits_of_the_whole() {
        let values = drawn(7 * 64 + 5);
        let keep = |trial: usize| trial % 5 != 2;
        let whole = node(&values, keep);
        // Chunks of 64 trials: seven, and the rest.
        let mut parts: Vec<[f64; size(2)]> = values
            .chunks(64)
            .enumerate()
            .map(|(chunk, part)| node(part, |trial| keep(64 * chunk + trial)))
            .collect();
        while parts.len() > 1 {
            parts = parts
                .chunks(2)
                .map(|pair| {
                    let mut both = pair[0];
                    if let Some(right) = pair.get(1) {
                        merge(2, &mut both, right);
                    }
                    both
                })
                .collect();
        }
        assert_eq!(parts[0], whole);
    }

    #[test]
    fn nothing_is_an_empty_node_and_changes_no_other() {
        let none = node(&[], |_| true);
        assert_eq!(none[0], 0.0);
        assert_eq!(none, node(&drawn(40), |_| false));
        assert_eq!([none[9], none[11]], [f64::INFINITY, f64::NEG_INFINITY]);
        let some = node(&drawn(20), |_| true);
        let (mut left, mut right) = (some, none);
        merge(2, &mut left, &none);
        merge(2, &mut right, &some);
        assert_eq!(left, some);
        assert_eq!(right, some);
    }
}
