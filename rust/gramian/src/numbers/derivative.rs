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

use alloc::vec;
use alloc::vec::Vec;

/// Pairs of evaluations a state may take: 6 evaluations where all goes well, 12 more
/// where the scale must be searched for. What measures the noise is part of them, so that
/// n states, three or more, take no more than 18 n evaluations in all.
const MOST_PAIRS: usize = 9;
/// First step, as a part of the size of the state.
const FIRST: f64 = 1.0 / 64.0;
/// Points beside x at which noise is measured; of one state fewer, as its steps need the rest.
const NOISE_POINTS: usize = 6;
const NOISE_POINTS_ALONE: usize = 4;
/// Spacing of those points: no power of two, and another for each of a few states.
const PARTS: [f64; 8] = [1.625, 1.875, 1.0625, 1.1875, 1.3125, 1.4375, 1.5625, 1.6875];
/// As few points either side of x tell noise that changes now and then.
const LEAST_WIDE: usize = 3;
/// Stated over standard deviation, for the part of an error that is noise.
const COVERAGE: f64 = 3.0;
/// Part of the longest step down to which a law must hold to be taken for one all the way.
const FALLEN: f64 = 1.0 / 8192.0;
/// Part of a step at which detail that the step missed is straight.
const SHORT: f64 = 1.0 / (1u64 << 40) as f64;
/// Error of an entry of which nothing is known.
const UNKNOWN: f64 = 1e150;
/// Even over odd part of a change above which a step is too long.
const BENT: f64 = 0.25;
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

/// Values at x + s and x - s, as odd and even part of the change.
struct Pair {
    step: f64,
    odd: Vec<f64>,
    even: Vec<f64>,
    finite: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Phase {
    /// No step is known yet at which the function is nearly linear.
    Search,
    /// Shorter steps follow the first good one.
    Ladder,
    /// The ladder did not settle: far shorter steps tell noise from detail.
    Detail,
    Done,
}

/// Noise nearly as large as the change over a step: detail far finer than the step looks alike.
#[derive(Clone, Copy)]
struct Suspicion {
    /// Which pair tells: at a step so short that detail is straight, and noise as it was.
    pair: usize,
    /// What passes for noise, weighted.
    level: f64,
    /// Where the ladder goes on if it is noise.
    next: f64,
}

struct Column<'a> {
    state: usize,
    outputs: Option<&'a [usize]>,
    pairs: Vec<Pair>,
    next: f64,
    least: f64,
    most: f64,
    /// Whether the state may be a zero and its rounding: neither scale nor step is given.
    rounded: bool,
    phase: Phase,
    shrunk: usize,
    grown: usize,
    /// From which pair on they belong to the ladder.
    anchor: usize,
    /// Whether only detail far below the first steps is trusted, and from where on.
    detail: Option<usize>,
    /// Whether no step was found at which noise is small.
    noisy: bool,
    /// Which pair is at the shortest step, after others that all met about the same change.
    probe: Option<usize>,
    /// What passes for noise and may be detail that all steps have missed.
    suspicion: Option<Suspicion>,
    /// The shortest step at which there may be detail, where noise hides it.
    reach: f64,
    /// How many pairs it may take.
    room: usize,
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
                let far = measure_noise(x, at, options, &line, &mut noise, &mut |points, out| {
                    let done = evaluate(points, out);
                    printed.see(at, out);
                    done
                })
                .map_err(Error::Function)?;
                evaluations += noise_points + 2 * wide;
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
            let (value, error) =
                column.entry(k, if apart { rounding } else { out.noise[i] }, at[i]);
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

/// Outputs that are rounded to some decimals wherever they were seen, as printed numbers are.
struct Printed {
    /// How many decimals each has, `None` where it has more than [`DECIMALS`].
    decimals: Vec<Option<i32>>,
    /// Whether it moved by one digit, or has had three values: a constant is no rounded number,
    /// nor is one that is cut off at either end.
    moved: Vec<bool>,
    /// Up to three values other than that at x.
    others: Vec<[f64; 3]>,
}

impl Printed {
    fn new(at: &[f64], given: &[bool]) -> Self {
        let fits = |(&value, &given): (&f64, &bool)| if given { None } else { decimals(value, 0) };
        Self {
            decimals: at.iter().zip(given).map(fits).collect(),
            moved: vec![false; at.len()],
            others: vec![[f64::NAN; 3]; at.len()],
        }
    }

    /// Takes note of outputs, one point after the other.
    fn see(&mut self, at: &[f64], values: &[f64]) {
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
    fn cut_off(&self, i: usize) -> bool {
        self.moved[i] && self.decimals[i].is_some() && self.others[i][2].is_nan()
    }

    /// The noise that rounding to digits does not explain.
    fn unexplained(&self, noise: &[f64]) -> Vec<f64> {
        let digits = self.with(&vec![0.0; noise.len()]);
        let each = noise.iter().zip(&digits);
        each.map(|(&noise, &digits)| if noise <= 4.0 * digits { 0.0 } else { noise })
            .collect()
    }

    /// The noise with that of rounding: of uniform errors of half a digit either way.
    fn with(&self, noise: &[f64]) -> Vec<f64> {
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
fn decimals(value: f64, least: i32) -> Option<i32> {
    (least..=DECIMALS).find(|&d| {
        let scaled = value.abs() * 10.0_f64.powi(d);
        let slack = 4.0 * f64::EPSILON * scaled;
        slack < 1e-4 && (scaled - scaled.round()).abs() <= slack
    })
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

impl<'a> Column<'a> {
    fn new(state: usize, x: f64, scale: f64, step: f64, outputs: Option<&'a [usize]>) -> Self {
        let size = if scale > 0.0 {
            scale
        } else if x == 0.0 {
            1.0
        } else {
            x.abs()
        };
        let ulp = power(x.abs().max(f64::MIN_POSITIVE)) * f64::EPSILON;
        let least = 4.0 * ulp;
        let given = step > 0.0;
        let first = if given { step } else { FIRST * size };
        Self {
            state,
            outputs,
            pairs: Vec::new(),
            next: power(first).max(least),
            least,
            // Past eight times its own size a state is somewhere else.
            most: if given {
                step
            } else if x == 0.0 || scale > 0.0 {
                f64::INFINITY
            } else {
                8.0 * size
            },
            rounded: !(given || scale > 0.0),
            phase: Phase::Search,
            shrunk: 0,
            grown: 0,
            anchor: 0,
            detail: None,
            noisy: false,
            probe: None,
            suspicion: None,
            reach: 0.0,
            room: MOST_PAIRS,
        }
    }

    fn each(&self, m: usize) -> impl Iterator<Item = usize> + '_ {
        let count = self.outputs.map_or(m, <[usize]>::len);
        (0..count).map(move |k| self.outputs.map_or(k, |o| o[k]))
    }

    fn wants(&self, measured: bool) -> bool {
        match self.phase {
            Phase::Done => false,
            Phase::Search => true,
            Phase::Ladder | Phase::Detail => measured,
        }
    }

    /// Ends where no evaluation is left.
    fn stop<E>(&mut self) -> Result<(), Error<E>> {
        if self.phase == Phase::Search {
            let Some(last) = self.pairs.iter().rposition(|p| p.finite) else {
                return Err(self.not_finite());
            };
            self.anchor = last;
            if self.shrunk > 0 && self.grown == 0 {
                self.reach = self.unresolved();
            }
        }
        self.phase = Phase::Done;
        Ok(())
    }

    /// How short detail may be that was not found.
    fn unresolved(&self) -> f64 {
        if self.least > 1e-300 {
            return self.least;
        }
        let steps = self.pairs.iter().map(|p| p.step);
        steps.fold(f64::INFINITY, f64::min) * 1e-12
    }

    /// The error of the last pair, which is not finite.
    fn not_finite<E>(&self) -> Error<E> {
        let place = self.pairs.last().and_then(|pair| {
            let mut parts = pair.odd.iter().zip(&pair.even);
            parts.position(|(o, e)| !(o + e).is_finite())
        });
        let output = place.unwrap_or(0);
        Error::NotFinite {
            output: self.output(output),
            state: self.state,
            step: self.pairs.last().map_or(self.next, |pair| pair.step),
        }
    }

    fn longest(&self) -> f64 {
        self.used().map(|p| p.step).fold(0.0, f64::max)
    }

    fn take(&mut self, at: &[f64], above: &[f64], below: &[f64], period: &[f64]) {
        let (mut odd, mut even) = (Vec::new(), Vec::new());
        for i in self.each(at.len()) {
            let up = change(above[i], at[i], period[i]);
            let down = change(below[i], at[i], period[i]);
            odd.push(0.5 * (up - down));
            even.push(0.5 * (up + down));
        }
        let finite = odd.iter().chain(&even).all(|x| x.is_finite());
        self.pairs.push(Pair {
            step: self.next,
            odd,
            even,
            finite,
        });
    }

    /// Takes the two nearest pairs of the line along which noise was measured, where there
    /// is no other state: they are steps of the ladder as any.
    fn take_line(&mut self, at: &[f64], far: &[f64], spacing: f64, options: &Options<'_>) {
        if self.phase != Phase::Ladder {
            return;
        }
        let next = self.next;
        for (k, pair) in far.chunks_exact(2 * at.len()).take(2).enumerate() {
            let (mut below, mut above) = pair.split_at(at.len());
            if spacing < 0.0 {
                core::mem::swap(&mut below, &mut above);
            }
            self.next = spacing.abs() * (k + 1) as f64;
            self.take(at, above, below, options.period);
        }
        self.next = next;
    }

    /// Takes the pair that is wanted next from those there are; false where it is new.
    fn take_again(&mut self) -> bool {
        let next = self.next;
        let Some(pair) = self.pairs.iter_mut().find(|p| p.step == next) else {
            return false;
        };
        pair.finite = false;
        let (odd, even) = (pair.odd.clone(), pair.even.clone());
        let finite = odd.iter().chain(&even).all(|x| x.is_finite());
        self.pairs.push(Pair {
            step: self.next,
            odd,
            even,
            finite,
        });
        true
    }

    /// Which output the k-th of those that the state may move is.
    fn output(&self, k: usize) -> usize {
        self.outputs
            .map_or(Some(k), |o| o.get(k).copied())
            .unwrap_or(0)
    }

    /// Refuses an output with a kink that shows at every step down to its noise.
    fn check_kink<E>(&self, noise: &[f64]) -> Result<(), Error<E>> {
        for (k, i) in self.each(noise.len()).enumerate() {
            let above = |p: &&Pair| p.finite && p.even[k].abs() > 100.0 * noise[i];
            let seen: Vec<&Pair> = self.pairs.iter().filter(above).collect();
            if self.shrunk > 1 && seen.len() > 2 && kinked(&seen, k, noise[i], 4.0) {
                return Err(Error::Kink {
                    output: i,
                    state: self.state,
                    step: seen[seen.len() - 1].step,
                });
            }
        }
        Ok(())
    }

    fn bent(&self, pair: usize, weight: &[f64], noise: &[f64]) -> bool {
        let [odd, even, _] = self.sizes(&self.pairs[pair], weight, noise);
        even > BENT * odd
    }

    /// Lengths of the odd part, the even part and the noise of a pair, weighted.
    fn sizes(&self, pair: &Pair, weight: &[f64], noise: &[f64]) -> [f64; 3] {
        let m = noise.len();
        let of = |values: &[f64]| norm(self.each(m).zip(values).map(|(i, x)| x * weight[i]));
        [
            of(&pair.odd),
            of(&pair.even),
            norm(self.each(m).map(|i| noise[i] * weight[i])),
        ]
    }

    /// How far apart the points are at which noise is measured: parts of a power of two
    /// that leave x + k s exact, yet are none themselves, or numbers of fewer digits would
    /// not be seen. Each state has a part of its own: a difference of two states that move
    /// alike would stand still, and be taken for a rounded one.
    ///
    /// `longest` is that of the wide ones, as a part of the step, but for a noise that wants more.
    fn spacing(&self, wide: bool, longest: f64, weight: &[f64], noise: &[f64]) -> f64 {
        let Some(pair) = self.pairs.get(self.detail.unwrap_or(self.anchor)) else {
            return 0.0;
        };
        let [odd, even, level] = self.sizes(pair, weight, noise);
        let own = PARTS[self.state % PARTS.len()];
        let part = if wide {
            // Where nothing moved nothing is bent, but farther away it may be.
            let (bent, longest) = if odd > 0.0 {
                (even / odd, if level > 1e-3 * odd { 1.0 } else { longest })
            } else {
                (0.0, 0.125)
            };
            own * power((0.02 / bent).clamp(2.0_f64.powi(-20), longest))
        } else {
            own / 8192.0
        };
        let sign = if (self.state * 7 + 3) % 5 < 2 {
            -1.0
        } else {
            1.0
        };
        sign * (pair.step * part).max(0.5 * self.least)
    }

    fn shorter<E>(
        &mut self,
        bits: i32,
        at: &[f64],
        weight: &[f64],
        noise: &[f64],
    ) -> Result<(), Error<E>> {
        let last = self.pairs.len() - 1;
        let pair = &self.pairs[last];
        let level = self.level_off(weight, noise);
        let short = power((self.pairs[0].step * SHORT).max(4.0 * self.least));
        if level && self.probe.is_none() && self.pairs.len() < self.room && short < pair.step / 64.0
        {
            self.probe = Some(self.pairs.len());
            self.next = short;
            self.shrunk += 1;
            return Ok(());
        }
        // The same change from long steps to the shortest is noise, not detail.
        let settled = level && self.probe == Some(last);
        // At zero a law such as x |x| is followed at once to where nothing is left of it.
        let law = self.least < 1e-300 && self.shrunk == 0 && last > 0;
        let bits = if law && self.falls(weight, noise.len()) {
            let [before, ..] = self.sizes(&self.pairs[last - 1], weight, noise);
            let [odd, _, level] = self.sizes(pair, weight, noise);
            let far = if odd < 0.18 * before { 14 } else { 28 };
            // Only as far as rounding leaves something of it.
            if odd * 4.0_f64.powi(-far) > 8.0 * level {
                far
            } else {
                bits
            }
        } else {
            bits
        };
        let next = (pair.step * 2.0_f64.powi(-bits)).max(self.least);
        if !settled && self.pairs.len() + 2 < self.room && next < pair.step {
            self.next = power(next);
            self.shrunk += 1;
            return Ok(());
        }
        // No step is short enough: noise, a kink or a jump.
        self.check_kink(noise)?;
        let m = at.len();
        let size = |x: &[f64]| norm(self.each(m).zip(x).map(|(i, x)| weight[i] * x));
        if let Some(longest) = self.pairs.iter().position(|p| p.finite)
            && pair.finite
            && !self.jumps(weight, m)
        {
            let local = 5.0 * size(&pair.odd).max(size(&pair.even));
            // The shortest step at which the change is above what is left at the end.
            let best = (0..last)
                .filter(|&k| self.pairs[k].finite && size(&self.pairs[k].odd) > local)
                .min_by(|&a, &b| self.pairs[a].step.total_cmp(&self.pairs[b].step))
                .unwrap_or(longest);
            if self.falls_to_nothing(weight, m) {
                // As x^3 at 0: straight nowhere, but with a slope that goes to zero.
                self.anchor = longest;
                self.phase = Phase::Done;
                return Ok(());
            }
            let first = self.pairs[best].step;
            self.reach = if settled { 0.0 } else { self.unresolved() };
            for p in &mut self.pairs {
                p.finite &= p.step >= first;
            }
            self.noisy = true;
            self.anchor = best;
            self.phase = Phase::Ladder;
            self.next = 0.5 * first;
            return Ok(());
        }
        let pair = &self.pairs[last];
        if !pair.finite {
            return Err(self.not_finite());
        }
        let (mut place, mut largest) = (0, -1.0);
        for (k, i) in self.each(m).enumerate() {
            let size = weight[i] * (pair.odd[k].abs() + pair.even[k].abs());
            if size > largest {
                (place, largest) = (k, size);
            }
        }
        let output = self.each(m).nth(place).unwrap_or(0);
        if self.turns(weight, m) {
            return Err(Error::Kink {
                output,
                state: self.state,
                step: pair.step,
            });
        }
        Err(Error::Jump {
            output,
            state: self.state,
            below: at[output] + pair.even[place] - pair.odd[place],
            above: at[output] + pair.even[place] + pair.odd[place],
            step: pair.step,
        })
    }

    /// Whether the last step meets about the same change as one far longer, but not the very
    /// same, as at a jump.
    fn level_off(&self, weight: &[f64], noise: &[f64]) -> bool {
        let Some((short, longer)) = self.pairs.split_last() else {
            return false;
        };
        let Some(long) = longer.iter().rfind(|p| p.step > 16.0 * short.step) else {
            return false;
        };
        let change = |pair: &Pair| {
            let [odd, even, level] = self.sizes(pair, weight, noise);
            (odd.max(even), level)
        };
        let ((first, _), (second, level)) = (change(long), change(short));
        long.finite
            && short.finite
            && second > 0.3 * first
            && second > 8.0 * level
            && !self.jumps(weight, noise.len())
    }

    /// Whether the shortest steps all meet the same change, which noise does not.
    fn jumps(&self, weight: &[f64], m: usize) -> bool {
        let Some([.., a, b]) = self.pairs.get(self.pairs.len().saturating_sub(2)..) else {
            return false;
        };
        let size = |x: &[f64], y: &[f64]| {
            norm(
                self.each(m)
                    .enumerate()
                    .map(|(k, i)| weight[i] * (x[k] - y[k])),
            )
        };
        let none = vec![0.0; a.odd.len()];
        let apart = size(&a.odd, &b.odd) + size(&a.even, &b.even);
        apart < 0.05 * (size(&none, &b.odd) + size(&none, &b.even)) || self.turns(weight, m)
    }

    /// Whether the even part falls with the step, as fast as it is long, down to the shortest
    /// steps: a kink.
    fn turns(&self, weight: &[f64], m: usize) -> bool {
        let Some([a, b]) = self.pairs.get(self.pairs.len().saturating_sub(2)..) else {
            return false;
        };
        let ratio = b.step / a.step;
        let (mut off, mut whole) = (0.0, 0.0);
        for (k, i) in self.each(m).enumerate() {
            off = crate::scalar::hypot(off, weight[i] * (a.even[k] * ratio - b.even[k]));
            whole = crate::scalar::hypot(whole, weight[i] * b.even[k]);
        }
        off < 0.05 * whole
    }

    /// Whether slope and bend fall all along, by half the decades of the steps or more: that
    /// of noise, of a jump or of a kink does not.
    fn falls_to_nothing(&self, weight: &[f64], m: usize) -> bool {
        let steps = || self.pairs.iter().filter(|p| p.finite).map(|p| p.step);
        let longest = steps().fold(0.0, f64::max);
        let shortest = steps().fold(f64::INFINITY, f64::min);
        // The size of a state that is not zero says nothing of how short is short.
        let least = if self.least < 1e-300 {
            FALLEN
        } else {
            FALLEN * FALLEN
        };
        steps().count() > 3 && shortest < least * longest && self.falls(weight, m)
    }

    /// The same of fewer steps.
    fn falls(&self, weight: &[f64], m: usize) -> bool {
        let size = |x: &[f64]| norm(self.each(m).zip(x).map(|(i, x)| weight[i] * x));
        let mut pairs: Vec<&Pair> = self.pairs.iter().filter(|p| p.finite).collect();
        pairs.sort_by(|a, b| b.step.total_cmp(&a.step));
        pairs.len() > 1
            && pairs.windows(2).all(|w| {
                let least = (w[1].step / w[0].step).sqrt();
                let slope = |x: &[f64], p: &Pair| size(x) / p.step;
                slope(&w[1].odd, w[1]) <= least * slope(&w[0].odd, w[0])
                    && slope(&w[1].even, w[1]) <= least * slope(&w[0].even, w[0])
            })
    }

    /// What to do after the last pair.
    ///
    /// `plain` is the noise without that of printed digits, which a longer step does not better.
    fn decide<E>(
        &mut self,
        weight: &[f64],
        noise: &[f64],
        plain: &[f64],
        at: &[f64],
    ) -> Result<(), Error<E>> {
        match self.phase {
            Phase::Search => self.search(weight, noise, plain, at),
            Phase::Ladder => {
                self.climb(weight, noise);
                Ok(())
            }
            Phase::Detail => {
                self.compare(weight, noise);
                Ok(())
            }
            Phase::Done => Ok(()),
        }
    }

    fn search<E>(
        &mut self,
        weight: &[f64],
        noise: &[f64],
        plain: &[f64],
        at: &[f64],
    ) -> Result<(), Error<E>> {
        let last = self.pairs.len() - 1;
        let pair = &self.pairs[last];
        // Far steps first cost little; then as far as the numbers reach in a few.
        let bits = [5, 10, 14, 14, 14, 14, 14, 14, 14][self.shrunk.min(8)];
        if !pair.finite {
            return self.shorter(bits, at, weight, noise);
        }
        let [odd, even, level] = self.sizes(pair, weight, noise);
        if let Some(Suspicion {
            level: seen, next, ..
        }) = self.suspicion.filter(|suspicion| suspicion.pair == last)
        {
            let detail = 0.05 * seen * pair.step / odd;
            let rounding = odd.max(even) < 8.0 * level;
            if rounding || odd.max(even) > 0.1 * seen || !(detail < self.pairs[self.anchor].step) {
                self.pairs[last].finite = false;
                self.phase = Phase::Ladder;
                self.next = next;
            } else {
                self.next = power(detail).max(self.least);
            }
            return Ok(());
        }
        if self.probe == Some(last) && odd < 8.0 * level && even < 8.0 * level {
            // Nothing moves at so short a step: half way.
            self.next = power((pair.step * self.pairs[last - 1].step).sqrt());
            self.pairs[last].finite = false;
            return Ok(());
        }
        if self.probe == Some(last) && odd > 8.0 * level && even <= BENT * odd {
            let [long_odd, long_even, _] = self.sizes(&self.pairs[last - 1], weight, noise);
            let whole = long_odd.max(long_even);
            let next = power(0.05 * whole * pair.step / odd);
            if odd < 0.1 * whole && next > 4.0 * pair.step && next < self.pairs[last - 1].step {
                // Straight here: as far as a twentieth of the whole change.
                self.next = next;
                return Ok(());
            }
        }
        if odd < 8.0 * level && even < 8.0 * level {
            // Nothing moves.
            let longer = power((pair.step * 4096.0).min(self.most));
            self.check_kink(noise)?;
            if self.shrunk > 0 && self.grown > 0 && self.bent(last - 1, weight, noise) {
                // Flat at x, and something else far away.
                self.anchor = last;
                self.phase = Phase::Ladder;
                self.next = 0.5 * pair.step;
            } else if self.shrunk > 0 {
                // Not below the last step that moved something: that was noise.
                self.anchor = (0..last).rfind(|&k| self.pairs[k].finite).unwrap_or(last);
                self.phase = Phase::Ladder;
                self.next = power((pair.step * self.pairs[self.anchor].step).sqrt());
            } else if self.grown < 4 && longer > 2.0 * pair.step {
                self.grown += 1;
                self.next = longer;
            } else if !self.as_zero() {
                self.anchor = last;
                self.phase = Phase::Ladder;
                self.next = 0.5 * self.pairs[last].step;
            }
            return Ok(());
        }
        let longer = power((pair.step * 4096.0).min(self.most));
        let [.., digits] = self.sizes(pair, weight, plain);
        if self.shrunk == 0 && self.grown < 4 && odd < 1e7 * digits && even < 8.0 * digits {
            // Straight, and little above rounding: a longer step has more digits.
            if longer > 2.0 * pair.step {
                self.grown += 1;
                self.next = longer;
                return Ok(());
            }
            if self.as_zero() {
                return Ok(());
            }
        }
        let pair = &self.pairs[last];
        let lawful = last > 0 && self.pairs[last - 1].finite && {
            let before = &self.pairs[last - 1];
            let ratio = pair.step / before.step;
            let m = noise.len();
            let off = |a: &[f64], b: &[f64], power: f64| {
                norm(
                    self.each(m)
                        .zip(a.iter().zip(b))
                        .map(|(i, (x, y))| weight[i] * (x - power * y)),
                )
            };
            off(&pair.odd, &before.odd, ratio) <= 0.1 * odd + 8.0 * level
                && off(&pair.even, &before.even, ratio * ratio)
                    <= 0.3 * even + 0.05 * odd + 8.0 * level
        };
        let confirming = last > 0 && self.pairs[last - 1].step <= 2.5 * pair.step;
        if lawful {
            self.anchor = if confirming { last - 1 } else { last };
            self.phase = Phase::Ladder;
            self.next = 0.5 * pair.step;
            return Ok(());
        }
        // One step that looks straight may be chance: the next must agree.
        let next = 0.5 * pair.step;
        if even > BENT * odd || confirming || next < self.least || last + 2 > self.room {
            return self.shorter(bits, at, weight, noise);
        }
        self.next = next;
        Ok(())
    }

    /// Moves a state as a zero is moved, once: what shows little or nothing within its own size
    /// may be a zero and its rounding, the cosine of a right angle.
    fn as_zero(&mut self) -> bool {
        let shown = self.pairs.last().is_some_and(|pair| pair.step < FIRST);
        if !(self.rounded && shown) {
            return false;
        }
        self.rounded = false;
        self.most = f64::INFINITY;
        self.next = FIRST;
        true
    }

    /// Once the noise is known, a longer step may be better.
    ///
    /// Returns whether the step was chance instead, and the search goes on.
    ///
    /// `unexplained` is the noise that is not that of printed digits.
    fn after_noise(
        &mut self,
        enough: bool,
        weight: &[f64],
        noise: &[f64],
        unexplained: &[f64],
    ) -> bool {
        if self.phase != Phase::Ladder {
            return false;
        }
        let pair = &self.pairs[self.anchor];
        let [odd, even, level] = self.sizes(pair, weight, noise);
        if odd == 0.0 {
            return false;
        }
        let [.., unexplained] = self.sizes(pair, weight, unexplained);
        if unexplained > 0.02 * odd && !self.noisy && self.suspicion.is_none() && enough {
            // What looks like noise may be detail that all steps so far have missed.
            let next = power((pair.step * SHORT).max(4.0 * self.least));
            if next < pair.step / 64.0 {
                self.suspicion = Some(Suspicion {
                    pair: self.pairs.len(),
                    level,
                    next: self.next,
                });
                self.phase = Phase::Search;
                self.next = next;
                self.shrunk = self.shrunk.max(3);
                return true;
            }
        }
        let bend = (even / odd).max(2.0 * level / odd);
        // Error of the ladder from noise, and how much longer the step may be.
        let wanted = if level > 1e-3 * odd { 0.15 } else { 0.06 };
        let factor = if level > 0.02 * odd && even < 3.0 * level {
            // Nothing is seen of a bend.
            (200.0 * level / odd).min(64.0)
        } else {
            (wanted / bend).min(64.0)
        };
        if level > 1e-11 * odd && factor > 2.0 {
            let longer = power((pair.step * factor).min(self.most));
            if longer > pair.step {
                self.next = longer;
            }
        }
        false
    }

    /// The pairs of the ladder, from long to short steps.
    fn used(&self) -> impl DoubleEndedIterator<Item = &Pair> {
        let first = self.detail.unwrap_or(self.anchor);
        let mut pairs: Vec<&Pair> = self.pairs[first.min(self.pairs.len())..]
            .iter()
            .filter(|p| p.finite)
            .collect();
        pairs.sort_by(|a, b| b.step.total_cmp(&a.step));
        pairs.into_iter()
    }

    fn climb(&mut self, weight: &[f64], noise: &[f64]) {
        let last = self.pairs.len() - 1;
        let m = noise.len();
        if !self.pairs[last].finite {
            // A step too long was tried.
            self.most = self.most.min(0.5 * self.pairs[last].step);
        } else if self.pairs[last].step > self.pairs[self.anchor].step {
            let [odd, even, level] = self.sizes(&self.pairs[last], weight, noise);
            let ratio = self.pairs[last].step / self.pairs[self.anchor].step;
            let [first, ..] = self.sizes(&self.pairs[self.anchor], weight, noise);
            if even > BENT * odd || !(odd > 0.5 * ratio * (first - 4.0 * level)) {
                // Bent: not part of the ladder.
                self.pairs[last].finite = false;
            }
        }
        let steps: Vec<f64> = self.used().map(|p| p.step).collect();
        let room = self.pairs.len() < self.room;
        if steps.len() < 3 {
            if !room || steps.is_empty() {
                self.phase = Phase::Done;
                return;
            }
            self.next = if steps.len() == 2 && steps[0] > 2.5 * steps[1] {
                power((steps[0] * steps[1]).sqrt() * 1.42)
            } else {
                0.5 * steps[steps.len() - 1]
            };
            if self.next < self.least || steps.contains(&self.next) {
                self.phase = Phase::Done;
            }
            return;
        }
        if self.noisy && self.lawful(weight, noise) {
            self.reach = 0.0;
        }
        let (mut value, mut random, mut rest, mut odd_one) = (0.0, 0.0, 0.0, false);
        for (k, i) in self.each(m).enumerate() {
            let (d, error) = self.entry(k, noise[i], 0.0);
            let floor = self.floor(k, noise[i]);
            value = crate::scalar::hypot(value, d * weight[i]);
            random = crate::scalar::hypot(random, floor * weight[i]);
            rest = crate::scalar::hypot(rest, (error - floor).max(0.0) * weight[i]);
            odd_one |= self.irregular(k, noise[i]);
        }
        if rest <= 1e-8 * value || (rest <= random && !odd_one) {
            self.phase = Phase::Done;
            return;
        }
        if !room {
            self.phase = Phase::Done;
            return;
        }
        // Where short steps have all the noise, the longest one wants others beside it.
        for k in 0..2 {
            let share = random * steps[0] / steps[k + 1];
            if steps[k] > 2.5 * steps[k + 1] && !odd_one && rest <= 4.0 * share {
                self.next = 0.5 * steps[k];
                return;
            }
        }
        let shortest = steps[steps.len() - 1];
        if odd_one && self.detail.is_none() && self.pairs.len() + 3 <= self.room {
            // Noise that the table of differences did not show, or detail far finer.
            let next = power((shortest / 1024.0).max(self.least));
            if next < 0.25 * shortest {
                self.phase = Phase::Detail;
                self.next = next;
                return;
            }
        }
        let next = 0.25 * shortest;
        if next < self.least || rest <= 4.0 * random {
            self.phase = Phase::Done;
        } else {
            self.next = next;
        }
    }

    /// Whether the change is proportional to the step, all along the ladder.
    fn lawful(&self, weight: &[f64], noise: &[f64]) -> bool {
        let pairs: Vec<&Pair> = self.used().collect();
        pairs.windows(2).all(|w| {
            let [odd, even, level] = self.sizes(w[1], weight, noise);
            let ratio = w[1].step / w[0].step;
            let off = norm(
                self.each(noise.len())
                    .enumerate()
                    .map(|(k, i)| weight[i] * (w[1].odd[k] - ratio * w[0].odd[k])),
            );
            odd > 10.0 * level && even < BENT * odd && off < 0.1 * odd
        })
    }

    fn compare(&mut self, weight: &[f64], noise: &[f64]) {
        let last = self.pairs.len() - 1;
        let m = noise.len();
        let short: Vec<usize> = (0..=last)
            .filter(|&k| {
                self.pairs[k].finite && self.pairs[k].step <= self.pairs[self.anchor].step / 500.0
            })
            .collect();
        if short.len() < 2 {
            self.next = 0.5 * self.pairs[last].step;
            if self.next < self.least || self.pairs.len() >= self.room {
                self.phase = Phase::Done;
            }
            return;
        }
        self.phase = Phase::Done;
        // The derivative by short steps against that by long ones.
        let (a, b) = (&self.pairs[short[0]], &self.pairs[short[1]]);
        let (mut apart, mut apart_short, mut size) = (0.0, 0.0, 0.0);
        let mut allowed = 0.0;
        for (k, i) in self.each(m).enumerate() {
            let (long, error) = self.entry(k, noise[i], 0.0);
            let (da, db) = (a.odd[k] / a.step, b.odd[k] / b.step);
            apart = crate::scalar::hypot(apart, (da - long) * weight[i]);
            apart_short = crate::scalar::hypot(apart_short, (da - db) * weight[i]);
            allowed = crate::scalar::hypot(allowed, error * weight[i]);
            size = crate::scalar::hypot(size, da * weight[i]);
        }
        if apart > 10.0 * allowed && apart_short < 0.05 * size {
            // Detail: a smooth function where steps are short.
            self.detail = Some(short[0]);
            if self.pairs.len() + 2 <= self.room {
                self.phase = Phase::Ladder;
                self.next = 0.5 * b.step;
            }
        } else {
            // Noise: the short steps only amplify it.
            for k in short {
                self.pairs[k].finite = false;
            }
        }
    }

    /// Whether differences of one output stay where they should fall with the step.
    fn irregular(&self, k: usize, noise: f64) -> bool {
        let pairs: Vec<&Pair> = self.used().collect();
        pairs
            .windows(3)
            .any(|w| irregular(w[0], w[1], w[2], k, noise))
    }

    /// Whether the output was seen to move with the state.
    fn moves(&self, k: usize) -> bool {
        let moved = |p: &Pair| p.odd[k] != 0.0 || p.even[k] != 0.0;
        self.pairs.iter().any(moved)
    }

    /// What noise leaves of the best estimate.
    fn floor(&self, k: usize, noise: f64) -> f64 {
        let longest = self.longest();
        let largest = self
            .used()
            .map(|p| p.odd[k].abs().max(p.even[k].abs()))
            .fold(0.0, f64::max);
        COVERAGE * (noise + f64::EPSILON * largest) / longest.max(f64::MIN_POSITIVE)
    }

    /// Derivative and error of one output.
    fn entry(&self, k: usize, noise: f64, at: f64) -> (f64, f64) {
        let pairs: Vec<&Pair> = self.used().collect();
        if pairs.is_empty() {
            return (0.0, f64::INFINITY);
        }
        let level =
            |p: &Pair| noise.max(f64::EPSILON * (at.abs() + p.odd[k].abs() + p.even[k].abs()));
        // The shortest step alone: how bent the function is, and what another step gives, as
        // that of an odd function bends where the even part is zero.
        let mut best = {
            let p = pairs[pairs.len() - 1];
            let value = p.odd[k] / p.step;
            let even = p.even[k].abs().min(p.odd[k].abs());
            let apart = match pairs.as_slice() {
                [.., q, _] => (q.odd[k] / q.step - value).abs(),
                _ => value.abs(),
            };
            let error = apart + (even + COVERAGE * level(p)) / p.step;
            (value, error.max(slow(&pairs, k, noise, value)))
        };
        for width in 2..=3.min(pairs.len()) {
            for (start, window) in pairs.windows(width).enumerate() {
                let (value, weights) = extrapolate(window, k);
                let shorter = extrapolate(&window[1..], k).0;
                let mut gap = (value - shorter).abs();
                if let [long, short] = pairs.as_slice() {
                    // No third step tells whether the error falls as the square of the step:
                    // as its root, then.
                    let apart = (long.odd[k] / long.step - short.odd[k] / short.step).abs();
                    gap = gap.max(apart / ((long.step / short.step).sqrt() - 1.0));
                }
                if width == 3 {
                    // The gap is the error of two steps; that of three is smaller as
                    // the gap is smaller than the one before it.
                    let before = (shorter - window[2].odd[k] / window[2].step).abs();
                    let bend = 4.0 * (window[0].even[k] / window[0].odd[k]).powi(2);
                    let fall = if before > 0.0 { gap / before } else { 1.0 };
                    gap *= (10.0 * fall.max(bend)).clamp(1e-3, 1.0);
                    if !gap.is_finite() {
                        continue;
                    }
                }
                let random = norm(
                    window
                        .iter()
                        .zip(&weights)
                        .map(|(p, w)| w * level(p) / p.step),
                ) * core::f64::consts::FRAC_1_SQRT_2;
                let seen = (start + width).max(3).min(pairs.len());
                let error = (gap + COVERAGE * random).max(slow(&pairs[..seen], k, noise, value));
                if error < best.1 && value.is_finite() {
                    best = (value, error);
                }
            }
        }
        if let [.., q, p] = pairs.as_slice()
            && p.odd[k].abs() > 8.0 * level(p)
            && p.odd[k].abs() > q.odd[k].abs() * (p.step / q.step).sqrt()
        {
            // The change hardly falls with the step: what is cut off beside x, or a root at 0.
            best.1 = UNKNOWN;
        }
        // Over many steps that is no noise, which a kink passes for where noise is measured.
        let wide = pairs.len() > 3 && kinked(&pairs, k, 0.0, 16.0);
        if let Some(p) = pairs.last()
            && (wide || kinked(&pairs, k, noise, 4.0))
        {
            // Between the slopes on either side there is no telling.
            let largest = at.abs() + p.odd[k].abs() + p.even[k].abs();
            let rounding = 4.0 * f64::EPSILON * largest;
            best.1 = best.1.max((p.even[k].abs() + rounding) / p.step);
        }
        if self.reach > 0.0 {
            // Unresolved: there may be detail as short as the shortest step.
            let largest = self
                .pairs
                .iter()
                .map(|p| p.odd[k].abs().max(p.even[k].abs()));
            let largest = largest.filter(|x| x.is_finite()).fold(noise, f64::max);
            best.1 = best.1.max(largest / self.reach);
        }
        best
    }
}

/// How far `value` may be off where the differences do not fall with the square of
/// the step, as those of x |x| at 0. The shortest step is off by c^q / (b^q - c^q) of the last
/// difference, with the power q that the last two show. 0 where they fall as they should, or
/// to rounding.
fn slow(pairs: &[&Pair], k: usize, noise: f64, value: f64) -> f64 {
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
fn differences(a: &Pair, b: &Pair, c: &Pair, k: usize) -> [f64; 2] {
    let d = |p: &Pair| p.odd[k] / p.step;
    [(d(a) - d(b)).abs(), (d(b) - d(c)).abs()]
}

/// Whether the second difference is more than so many times what the first becomes where it
/// falls with the square of the step.
fn falls_slowly([first, second]: [f64; 2], pairs: [&Pair; 3], times: f64) -> bool {
    let [x, y, z] = pairs.map(|p| p.step * p.step);
    second > times * (y - z) / (x - y) * first
}

/// Whether a difference stays where it should fall.
fn irregular(a: &Pair, b: &Pair, c: &Pair, k: usize, noise: f64) -> bool {
    let both = differences(a, b, c, k);
    falls_slowly(both, [a, b, c], 2.4) && both[1] > 20.0 * noise / c.step
}

/// Whether the even part of an output is proportional to the step, from the longest to the
/// shortest, where that of a smooth function falls with its square. The steps must differ by
/// the factor `span`.
fn kinked(pairs: &[&Pair], k: usize, noise: f64, span: f64) -> bool {
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
fn extrapolate(pairs: &[&Pair], k: usize) -> (f64, [f64; 3]) {
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

/// How far apart the points are at which noise is measured, close and wide.
fn noise_spacing(columns: &[Column<'_>], weight: &[f64], noise: &[f64]) -> Vec<[f64; 2]> {
    // Of one state they are steps of its ladder.
    let longest = if columns.len() == 1 { 0.125 } else { 1.0 };
    columns
        .iter()
        .map(|column| [false, true].map(|wide| column.spacing(wide, longest, weight, noise)))
        .collect()
}

/// Where noise is measured.
struct Line<'a> {
    /// For each state how far apart the points are, close and wide.
    spacing: &'a [[f64; 2]],
    /// How many close ones there are on one side.
    close: usize,
    /// How many wide ones there are on either side.
    wide: usize,
    /// For each output whether its noise is known.
    given: &'a [bool],
}

/// Noise along one direction in which all states move a little, from the differences of
/// equally spaced values: close ones for rounding, wide ones for what changes now and
/// then, such as printed digits or the steps of a solver. Returns the values at the wide
/// ones: below and above x, the nearest first.
fn measure_noise<E>(
    x: &[f64],
    at: &[f64],
    options: &Options<'_>,
    line: &Line<'_>,
    noise: &mut [f64],
    evaluate: &mut impl FnMut(&[f64], &mut [f64]) -> Result<(), E>,
) -> Result<Vec<f64>, E> {
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
    for i in (0..m).filter(|&i| !line.given[i]) {
        let value = |k: usize| change(values[k * m + i], at[i], options.period[i]);
        let near: Vec<f64> = core::iter::once(0.0)
            .chain((0..close.len()).map(value))
            .collect();
        noise[i] = noise[i].max(close_noise(near));
        // In order: from the last point below x to the last above.
        let below = (0..wide).rev().map(|k| value(close.len() + 2 * k));
        let above = (0..wide).map(|k| value(close.len() + 2 * k + 1));
        noise[i] = noise[i].max(wide_noise(below.chain([0.0]).chain(above).collect()));
    }
    Ok(values.split_off(close.len() * m))
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
fn from_ladders(columns: &[Column<'_>], noise: &mut [f64], given: &[bool]) {
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
