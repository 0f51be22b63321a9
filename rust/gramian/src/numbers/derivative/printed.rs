//! Outputs that were rounded, as printed numbers are.

use alloc::vec;
use alloc::vec::Vec;

use super::DECIMALS;

/// Outputs that are rounded to some decimals wherever they were seen, as printed numbers are.
pub(super) struct Printed {
    /// How many decimals each has, `None` where it has more than [`DECIMALS`].
    decimals: Vec<Option<i32>>,
    /// Whether it moved by one digit, or has had three values: a constant is no rounded number,
    /// nor is one that is cut off at either end.
    moved: Vec<bool>,
    /// Up to three values other than that at x.
    others: Vec<[f64; 3]>,
}

impl Printed {
    pub(super) fn new(at: &[f64], given: &[bool]) -> Self {
        let fits = |(&value, &given): (&f64, &bool)| if given { None } else { decimals(value, 0) };
        Self {
            decimals: at.iter().zip(given).map(fits).collect(),
            moved: vec![false; at.len()],
            others: vec![[f64::NAN; 3]; at.len()],
        }
    }

    /// Takes note of outputs, one point after the other.
    pub(super) fn see(&mut self, at: &[f64], values: &[f64]) {
        for point in values.chunks_exact(at.len().max(1)) {
            for (i, &value) in point.iter().enumerate() {
                if let Some(least) = self.decimals[i]
                    && value.is_finite()
                {
                    self.decimals[i] = decimals(value, least);
                    // By digits, not by rounding alone.
                    let digit = 10.0_f64.powi(-self.decimals[i].unwrap_or(DECIMALS));
                    let far = |from: f64, digits: f64| (value - from).abs() > digits * digit;
                    if far(at[i], 0.5) {
                        let others = &mut self.others[i];
                        if others.iter().all(|&x| x.is_nan() || far(x, 0.5)) {
                            self.moved[i] |= !far(at[i], 1.5) || !others[0].is_nan();
                            if let Some(free) = others.iter_mut().find(|x| x.is_nan()) {
                                *free = value;
                            }
                        }
                    }
                }
            }
        }
    }

    /// Whether one taken for rounded showed so few values that it may as well be cut off on
    /// either side of x, as a saturated sensor is: of its slope at x nothing is known.
    pub(super) fn cut_off(&self, i: usize) -> bool {
        self.moved[i] && self.decimals[i].is_some() && self.others[i][2].is_nan()
    }

    /// The noise that rounding to digits does not explain.
    pub(super) fn unexplained(&self, noise: &[f64]) -> Vec<f64> {
        let digits = self.with(&vec![0.0; noise.len()]);
        let each = noise.iter().zip(&digits);
        each.map(|(&noise, &digits)| if noise <= 4.0 * digits { 0.0 } else { noise })
            .collect()
    }

    /// The noise with that of rounding: of uniform errors of half a digit either way.
    pub(super) fn with(&self, noise: &[f64]) -> Vec<f64> {
        let seen = self.decimals.iter().zip(&self.moved);
        // One that never moved beside others that are rounded has as many as these.
        let others = seen.clone().filter(|s| *s.1).filter_map(|s| *s.0).max();
        let each = noise.iter().zip(seen);
        each.map(|(&noise, (&own, &moved))| {
            let digits = if moved {
                own
            } else {
                others.filter(|_| own.is_some() && own <= others)
            };
            digits.map_or(noise, |d| noise.max(0.29 * 10.0_f64.powi(-d)))
        })
        .collect()
    }
}

/// The number of decimals, `least` or more, with which a value is written; `None` past
/// [`DECIMALS`], and where so many cannot be told from rounding.
pub(super) fn decimals(value: f64, least: i32) -> Option<i32> {
    (least..=DECIMALS).find(|&d| {
        let scaled = value.abs() * 10.0_f64.powi(d);
        let slack = 4.0 * f64::EPSILON * scaled;
        slack < 1e-4 && (scaled - scaled.round()).abs() <= slack
    })
}
