//! Numbers and directions in words, as every face of the library writes them.

use alloc::format;
use alloc::string::String;
use core::fmt::Write as _;

/// A number in so many digits, for a sentence: 580, not 5.8e+02.
///
/// ```
/// use gramian::numbers::words::brief;
/// assert_eq!(brief(583.2, 2), "580");
/// assert_eq!(brief(0.012_345_6, 3), "0.0123");
/// assert_eq!(brief(4.2e-9, 2), "4.2e-09");
/// assert_eq!(brief(f64::INFINITY, 3), "inf");
/// ```
pub fn brief(value: f64, digits: usize) -> String {
    if value.is_nan() {
        return String::from("nan");
    }
    if value.is_infinite() {
        return String::from(if value > 0.0 { "inf" } else { "-inf" });
    }
    let decimals = digits.max(1) - 1;
    let text = format!("{value:.decimals$e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let places = i32::try_from(decimals).unwrap_or(i32::MAX) - exponent;
    if exponent >= -4
        && let Ok(places) = usize::try_from(places)
    {
        return String::from(trimmed(&format!("{value:.places$}")));
    }
    if (1.0..1e6).contains(&value.abs()) {
        let rounded: f64 = text.parse().unwrap_or(value);
        return format!("{rounded:.0}");
    }
    let sign = if exponent < 0 { '-' } else { '+' };
    format!("{}e{sign}{:02}", trimmed(mantissa), exponent.abs())
}

/// Without zeros at the end of a fraction.
fn trimmed(text: &str) -> &str {
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        text
    }
}

/// How states move together: "x0 +1, vx -0.42", without those that stay.
///
/// ```
/// use gramian::numbers::words::moves;
/// assert_eq!(moves(&[1.0, 0.0, -0.42], &["x0", "y0", "vx"]), "x0 +1, vx -0.42");
/// ```
pub fn moves<S: AsRef<str>>(change: &[f64], names: &[S]) -> String {
    let mut out = String::new();
    for (value, name) in change.iter().zip(names) {
        if *value != 0.0 {
            let sign = if *value < 0.0 { '-' } else { '+' };
            let gap = if out.is_empty() { "" } else { ", " };
            // A string takes every text.
            let _ = write!(
                out,
                "{gap}{} {sign}{}",
                name.as_ref(),
                brief(value.abs(), 4)
            );
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::brief;

    #[test]
    fn numbers_in_few_digits() {
        for (value, digits, text) in [
            (0.0, 3, "0"),
            (1.0, 4, "1"),
            (-2.5, 3, "-2.5"),
            (9.999, 3, "10"),
            (999.6, 3, "1000"),
            (123_456.0, 3, "123000"),
            (1e6, 3, "1e+06"),
            (1.5e22, 3, "1.5e+22"),
            (1e-4, 3, "0.0001"),
            (9.9996e-5, 3, "0.0001"),
            (1.25e-7, 2, "1.2e-07"),
            (1e100, 1, "1e+100"),
            (f64::NEG_INFINITY, 3, "-inf"),
            (f64::NAN, 3, "nan"),
        ] {
            assert_eq!(brief(value, digits), text);
        }
    }
}
