//! Derivatives of a function that is only known by its values, with the error of each.
//!
//! A wrong derivative is worse than none: it turns what cannot be determined into a
//! plausible number. The step is therefore searched for, not assumed; the noise of the
//! function is measured; and each entry comes with an error that covers truncation,
//! noise and rounding.
//!
//! # Source
//! Noise from a difference table: More & Wild 2011, "Estimating computational noise",
//! SIAM J. Sci. Comput. 33. Extrapolation with an error estimate: Ridders 1982, Adv. Eng.
//! Software 4. Groups of columns: Curtis, Powell & Reid 1974, IMA J. Appl. Math. 13.

mod column;
mod ladder;
mod noise;
mod printed;

use alloc::vec;
use alloc::vec::Vec;

use self::column::{Column, Phase};
use self::noise::{Line, from_ladders, measure_noise, noise_spacing};
use self::printed::Printed;

/// Pairs of evaluations a state may take: 6 evaluations where all goes well, 12 more
/// where the scale must be searched for. What measures the noise is part of them, and the
/// value at x, so that n states take no more than 18 n evaluations in all.
const MOST_PAIRS: usize = 9;
/// Points beside x at which noise is measured; of one state fewer, as its steps need the rest.
const NOISE_POINTS: usize = 6;
const NOISE_POINTS_ALONE: usize = 4;
/// Noise by the differences of so few points may be a third of what it is, once in a hundred
/// times, and by the fewer of one state a fifth: errors are stated for as many times what was
/// measured.
const FEW: f64 = 1.5;
const FEW_ALONE: f64 = 2.0;
/// As few points either side of x tell noise that changes now and then.
const LEAST_WIDE: usize = 3;
/// Error of an entry of which nothing is known.
const UNKNOWN: f64 = 1e150;
/// Outputs of no more decimals than this are taken for rounded ones.
const DECIMALS: i32 = 7;

/// What is known of a function beforehand.
#[derive(Clone, Copy, Debug)]
pub struct Options<'a> {
    /// For each state the change that matters, NaN where that is not known: the search
    /// for the step starts there.
    pub scale: &'a [f64],
    /// For each output one over its standard deviation: what weighs in the choice of steps.
    pub weight: &'a [f64],
    /// For each output its period, 0 for one that is no angle.
    pub period: &'a [f64],
    /// For each output its noise where that is known, NaN where it is to be measured.
    pub noise: &'a [f64],
    /// For each state the longest step, NaN for one that is searched for.
    pub step: &'a [f64],
    /// For each state the outputs it may move, ascending; `None`: all of them.
    pub pattern: Option<&'a [Vec<usize>]>,
}

/// Derivatives and how far they may be off.
#[derive(Clone, Debug)]
pub struct Jacobian {
    /// Derivatives (m, n), row-major.
    pub values: Vec<f64>,
    /// Error of each, (m, n): at most this, save for one in a few hundred.
    pub error: Vec<f64>,
    /// Standard deviation of the noise of each output.
    pub noise: Vec<f64>,
    /// The longest step used for each state.
    pub step: Vec<f64>,
    /// How often the function was evaluated, the value at x not counted.
    pub evaluations: usize,
    /// Groups of states that were moved together.
    pub groups: usize,
}

/// Why there is no derivative.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error<E> {
    /// The function itself failed.
    #[error("the function failed")]
    Function(E),
    /// An output jumps at x.
    #[error(
        "output {output} jumps from {below} to {above} as state {state} moves by {step} either way"
    )]
    Jump {
        /// Which output.
        output: usize,
        /// Which state.
        state: usize,
        /// Its value just below.
        below: f64,
        /// Its value just above.
        above: f64,
        /// How far below and above.
        step: f64,
    },
    /// An output has a kink at x.
    #[error("output {output} has a kink where state {state} moves by {step} either way")]
    Kink {
        /// Which output.
        output: usize,
        /// Which state.
        state: usize,
        /// The shortest step at which it shows.
        step: f64,
    },
    /// No finite values around x.
    #[error("output {output} is not finite where state {state} moves by {step}")]
    NotFinite {
        /// Which output.
        output: usize,
        /// Which state.
        state: usize,
        /// How far from x.
        step: f64,
    },
}

/// The derivatives at `x` of the function with the value `at` there.
///
/// `evaluate` is given points, n numbers each, and writes the outputs, m numbers each;
/// NaN where the function has no value.
///
/// # Errors
/// [`Error`].
///
/// # Panics
/// Never; slices of another length than stated give an empty answer.
///
/// ```
/// use gramian::numbers::derivative::{Options, jacobian};
/// // Detail of 10 m at 5300 km: a step made from the size of x would miss it.
/// let range = |x: f64| (x - 5.3e6).hypot(10.0);
/// let x = [5.3e6 + 5.0];
/// let found = jacobian::<()>(
///     &x,
///     &[range(x[0])],
///     &Options {
///         scale: &[f64::NAN], weight: &[1.0], period: &[0.0], noise: &[f64::NAN],
///         step: &[f64::NAN], pattern: None,
///     },
///     |points, out| { for (p, o) in points.iter().zip(out) { *o = range(*p); } Ok(()) },
/// ).unwrap();
/// assert!((found.values[0] - 5.0 / 125.0_f64.sqrt()).abs() < 3.0 * found.error[0] + 1e-15);
/// assert!(found.error[0] < 1e-7);
/// ```
#[allow(clippy::too_many_lines)] // One loop, whose parts share all they have.
pub fn jacobian<E>(
    x: &[f64],
    at: &[f64],
    options: &Options<'_>,
    mut evaluate: impl FnMut(&[f64], &mut [f64]) -> Result<(), E>,
) -> Result<Jacobian, Error<E>> {
    let (n, m) = (x.len(), at.len());
    let groups = match options.pattern {
        Some(pattern) => color(pattern, m),
        None => (0..n).map(|j| vec![j]).collect(),
    };
    let mut columns: Vec<Column<'_>> = (0..n)
        .map(|j| {
            Column::new(
                j,
                x[j],
                options.scale[j],
                options.step[j],
                options.pattern.map(|p| p[j].as_slice()),
            )
        })
        .collect();
    let mut noise: Vec<f64> = (0..m)
        .map(|i| {
            let rounding = 2.0 * f64::EPSILON * at[i].abs();
            if options.noise[i] >= 0.0 {
                options.noise[i].max(rounding)
            } else {
                rounding
            }
        })
        .collect();
    let given: Vec<bool> = options.noise.iter().map(|&x| x >= 0.0).collect();
    let mut printed = Printed::new(at, &given);
    let mut evaluations = 0;
    let mut measured = given.iter().all(|&g| g);
    let mut kept: Option<(Vec<[f64; 2]>, Vec<f64>)> = None;
    let (mut points, mut values) = (Vec::new(), Vec::new());
    let mut few = vec![0.0; m];
    let noise_points = if n == 1 {
        NOISE_POINTS_ALONE
    } else {
        NOISE_POINTS
    };
    // With the value at x.
    let most = 2 * MOST_PAIRS * n - 1;
    loop {
        let reserve = if measured || kept.is_some() {
            0
        } else {
            noise_points
        };
        let left = most.saturating_sub(evaluations + reserve);
        let unfinished = groups
            .iter()
            .filter(|group| group.iter().any(|&j| columns[j].phase != Phase::Done))
            .count();
        let share = left / (2 * unfinished.max(1));
        for column in &mut columns {
            column.room = MOST_PAIRS.min(column.pairs.len() + share);
            if share == 0 {
                column.stop()?;
            }
        }
        for column in &mut columns {
            while column.wants(measured) && column.take_again() {
                column.decide(options.weight, &printed.with(&noise), &noise, at)?;
            }
        }
        // One round: a pair for each group that has a state left to move.
        let active: Vec<&Vec<usize>> = groups
            .iter()
            .filter(|group| group.iter().any(|&j| columns[j].wants(measured)))
            .collect();
        if active.is_empty() {
            if measured {
                break;
            }
            let spacing = noise_spacing(&columns, options.weight, &printed.with(&noise));
            let out_of_points = evaluations + noise_points > most;
            if let Some((_, found)) = kept
                .as_ref()
                .filter(|(at, _)| *at == spacing || out_of_points)
            {
                // The same points as before, or none left for others.
                noise.copy_from_slice(found);
            } else {
                // Of one state the wide points are pairs of its ladder; of more, two pairs
                // for each are left to the ladders.
                let ladders = if n > 1 { 4 * unfinished } else { 0 };
                let wide = match noise_points.min(left.saturating_sub(ladders) / 2) {
                    few if kept.is_some() || few < LEAST_WIDE => 0,
                    _ if n < 3 => LEAST_WIDE,
                    enough => enough,
                };
                // Points of their own where some were asked before.
                let factor = if kept.is_some() { 1.25 } else { 1.0 };
                let own: Vec<[f64; 2]> = spacing.iter().map(|s| s.map(|s| factor * s)).collect();
                let line = Line {
                    spacing: &own,
                    close: noise_points,
                    wide,
                    given: &given,
                };
                let [far, alone] =
                    measure_noise(x, at, options, &line, &mut noise, &mut |points, out| {
                        let done = evaluate(points, out);
                        printed.see(at, out);
                        done
                    })
                    .map_err(Error::Function)?;
                evaluations += noise_points + 2 * wide;
                few = alone;
                if let [column] = columns.as_mut_slice() {
                    column.take_line(at, &far, own[0][1], options);
                }
                kept = Some((spacing, noise.clone()));
            }
            measured = true;
            // Is there enough to see whether noise is detail?
            let enough = evaluations + 2 * unfinished <= most;
            let level = printed.with(&noise);
            let unexplained = printed.unexplained(&noise);
            let again = columns
                .iter_mut()
                .filter_map(|c| {
                    c.after_noise(enough, options.weight, &level, &unexplained)
                        .then_some(())
                })
                .count();
            if again > 0 {
                measured = given.iter().all(|&g| g);
                for i in (0..m).filter(|&i| !given[i]) {
                    noise[i] = 2.0 * f64::EPSILON * at[i].abs();
                }
            }
            continue;
        }
        points.clear();
        for group in &active {
            for sign in [1.0, -1.0] {
                let start = points.len();
                points.extend_from_slice(x);
                for &j in *group {
                    if columns[j].wants(measured) {
                        points[start + j] += sign * columns[j].next;
                    }
                }
            }
        }
        values.clear();
        values.resize(points.len() / n * m, f64::NAN);
        evaluations += points.len() / n;
        evaluate(&points, &mut values).map_err(Error::Function)?;
        printed.see(at, &values);
        let level = printed.with(&noise);
        for (group, pair) in active.iter().zip(values.chunks_exact(2 * m)) {
            let (above, below) = pair.split_at(m);
            for &j in *group {
                if columns[j].wants(measured) {
                    columns[j].take(at, above, below, options.period);
                    columns[j].decide(options.weight, &level, &noise, at)?;
                }
            }
        }
    }
    let mut noise = printed.with(&noise);
    from_ladders(&columns, &mut noise, &given);
    let mut out = Jacobian {
        values: vec![0.0; m * n],
        error: vec![0.0; m * n],
        noise,
        step: columns.iter().map(Column::longest).collect(),
        evaluations,
        groups: groups.len(),
    };
    for column in &columns {
        for (k, i) in column.each(m).enumerate() {
            // A state that does not move an output that is cut off is no part of it.
            let cut_off = printed.cut_off(i);
            let apart = cut_off && !column.moves(k);
            let rounding = 2.0 * f64::EPSILON * at[i].abs();
            let level = if apart {
                rounding
            } else if out.noise[i] <= few[i] {
                out.noise[i] * if n == 1 { FEW_ALONE } else { FEW }
            } else {
                out.noise[i]
            };
            let (value, error) = column.entry(k, level, at[i]);
            // Where the function overflows beside x nothing is known, which is a number too.
            out.values[i * n + column.state] = value;
            let known = error < UNKNOWN && (apart || !cut_off);
            out.error[i * n + column.state] = if known { error } else { UNKNOWN };
        }
    }
    Ok(out)
}

/// Part of the longest step at which [`at_known_steps`] starts: what is nearly a straight line
/// over that step is nearly a cubic here.
const KNOWN: f64 = 1.0 / 16.0;
/// How well the difference at the shorter step and what is extrapolated must agree, as a part of
/// the largest whitened entry of the column: the extrapolated one is then off by about its square.
const AGREE: f64 = 1e-4;

/// The derivatives (m, n) at `x`, where steps that suit each state are known from a place near
/// by ([`Jacobian::step`]): central differences at two steps, extrapolated. Four evaluations a
/// state, and nothing measured.
///
/// `evaluate` writes the outputs at a point, NaN where there are none; an output of weight 0 is
/// left out, with a derivative of 0. Returns whether the steps serve here too, and the derivatives are right to some eight digits; where not,
/// [`jacobian`] searches.
///
/// # Source
/// Ridders 1982, Adv. Eng. Software 4.
pub fn at_known_steps(
    x: &[f64],
    steps: &[f64],
    weight: &[f64],
    period: &[f64],
    mut evaluate: impl FnMut(&[f64], &mut [f64]),
    out: &mut [f64],
) -> bool {
    let (n, m) = (x.len(), period.len());
    let mut point = x.to_vec();
    let (mut above, mut below) = (vec![0.0; m], vec![0.0; m]);
    let mut slopes = vec![[0.0; 2]; m];
    for j in 0..n {
        let mut step = KNOWN * steps[j];
        for level in 0..2 {
            point[j] = x[j] + step;
            let up = point[j];
            evaluate(&point, &mut above);
            point[j] = x[j] - step;
            // The step that was made, rounding of the state included.
            let width = up - point[j];
            evaluate(&point, &mut below);
            for i in 0..m {
                let mut change = above[i] - below[i];
                if period[i] > 0.0 {
                    change -= period[i] * (change / period[i]).round();
                }
                slopes[i][level] = change / width;
            }
            step *= 0.5;
        }
        point[j] = x[j];
        let (mut off, mut size) = (0.0_f64, 0.0_f64);
        for (i, [far, near]) in slopes.iter().enumerate() {
            let more = (near - far) / 3.0;
            let best = near + more;
            out[i * n + j] = if weight[i] > 0.0 { best } else { 0.0 };
            if weight[i] > 0.0 {
                // NaN would be lost in the largest.
                if !best.is_finite() {
                    return false;
                }
                off = off.max(weight[i] * more.abs());
                size = size.max(weight[i] * best.abs());
            }
        }
        if off > AGREE * size {
            return false;
        }
    }
    true
}

/// The power of two nearest below, so that x + s and x - s are exact.
fn power(step: f64) -> f64 {
    let rounded = f64::from_bits(step.to_bits() & 0x7ff0_0000_0000_0000);
    if rounded > 0.0 {
        rounded
    } else {
        f64::MIN_POSITIVE
    }
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, crate::scalar::hypot)
}

/// The difference of two outputs, to the nearest of its periods.
fn change(to: f64, from: f64, period: f64) -> f64 {
    let plain = to - from;
    if period > 0.0 {
        plain - period * (plain / period).round()
    } else {
        plain
    }
}

/// Groups of states none of which moves an output of another: greedy, those that move
/// most outputs first.
#[must_use]
pub fn color(pattern: &[Vec<usize>], outputs: usize) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..pattern.len()).collect();
    order.sort_by_key(|&j| (core::cmp::Reverse(pattern[j].len()), j));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut taken: Vec<Vec<bool>> = Vec::new();
    for j in order {
        let free = taken
            .iter()
            .position(|taken| pattern[j].iter().all(|&i| !taken[i]));
        let group = free.unwrap_or_else(|| {
            groups.push(Vec::new());
            taken.push(vec![false; outputs]);
            groups.len() - 1
        });
        groups[group].push(j);
        for &i in &pattern[j] {
            taken[group][i] = true;
        }
    }
    for group in &mut groups {
        group.sort_unstable();
    }
    groups
}
