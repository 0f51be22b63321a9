//! What central differences at a ladder of steps tell of a derivative: its limit, and how far
//! it may be off where they do not fall as those of a smooth function.

use alloc::vec::Vec;

use super::UNKNOWN;

/// Values at x + s and x - s, as odd and even part of the change.
pub(super) struct Pair {
    pub step: f64,
    pub odd: Vec<f64>,
    pub even: Vec<f64>,
    pub finite: bool,
}

/// How far `value` may be off where the differences do not fall with the square of
/// the step, as those of x |x| at 0. The shortest step is off by c^q / (b^q - c^q) of the last
/// difference, with the power q that the last two show. 0 where they fall as they should, or
/// to rounding.
pub(super) fn slow(pairs: &[&Pair], k: usize, noise: f64, value: f64) -> f64 {
    let [.., a, b, c] = pairs else {
        return 0.0;
    };
    let [first, second] = differences(a, b, c, k);
    // Halved steps leave a quarter where the function is smooth, half where it is as x |x|.
    if !falls_slowly([first, second], [a, b, c], 1.5) || second <= 20.0 * noise / c.step {
        return 0.0;
    }
    let power = |step: f64, q: f64| (step / a.step).powf(q);
    let fall = |q: f64| (1.0 - power(b.step, q)) / (power(b.step, q) - power(c.step, q));
    let (mut low, mut high) = (1.0 / 16.0, 2.0);
    if fall(low) * second >= first {
        // Slopes that grow as the step falls, as of what is cut off, have no limit to speak of.
        return UNKNOWN;
    }
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if fall(middle) * second < first {
            low = middle;
        } else {
            high = middle;
        }
    }
    let rest = second * power(c.step, low) / (power(b.step, low) - power(c.step, low));
    rest + (value - c.odd[k] / c.step).abs()
}

/// How much odd / step changes from the first to the second step and on to the third.
pub(super) fn differences(a: &Pair, b: &Pair, c: &Pair, k: usize) -> [f64; 2] {
    let d = |p: &Pair| p.odd[k] / p.step;
    [(d(a) - d(b)).abs(), (d(b) - d(c)).abs()]
}

/// Whether the second difference is more than so many times what the first becomes where it
/// falls with the square of the step.
pub(super) fn falls_slowly([first, second]: [f64; 2], pairs: [&Pair; 3], times: f64) -> bool {
    let [x, y, z] = pairs.map(|p| p.step * p.step);
    second > times * (y - z) / (x - y) * first
}

/// Whether a difference stays where it should fall.
pub(super) fn irregular(a: &Pair, b: &Pair, c: &Pair, k: usize, noise: f64) -> bool {
    let both = differences(a, b, c, k);
    falls_slowly(both, [a, b, c], 2.4) && both[1] > 20.0 * noise / c.step
}

/// Whether the even part of an output is proportional to the step, from the longest to the
/// shortest, where that of a smooth function falls with its square. The steps must differ by
/// the factor `span`.
pub(super) fn kinked(pairs: &[&Pair], k: usize, noise: f64, span: f64) -> bool {
    let (Some(long), Some(short)) = (pairs.first(), pairs.last()) else {
        return false;
    };
    let least = 20.0 * (noise + f64::EPSILON * long.even[k].abs());
    long.step >= span * short.step
        && short.even[k].abs() > least
        && pairs.windows(2).all(|w| {
            let ratio = w[0].even[k] / w[0].step * (w[1].step / w[1].even[k]);
            (ratio - 1.0).abs() < 0.1
        })
}

/// The limit of odd / step as the step goes to zero, a polynomial in its square, and
/// the weight of each pair in it.
pub(super) fn extrapolate(pairs: &[&Pair], k: usize) -> (f64, [f64; 3]) {
    let mut weights = [0.0; 3];
    let mut value = 0.0;
    for (a, p) in pairs.iter().enumerate() {
        let mut weight = 1.0;
        for (b, q) in pairs.iter().enumerate() {
            if a != b {
                let ratio = p.step / q.step;
                weight /= 1.0 - ratio * ratio;
            }
        }
        weights[a] = weight;
        value += weight * p.odd[k] / p.step;
    }
    (value, weights)
}
