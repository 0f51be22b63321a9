//! How large the region of likely states is: intervals and contours of the likelihood.
//!
//! # Algorithm
//! The profile of a function g is the least chi2 with g held at a value. Its root is
//! nearly linear in the value, and its slope is the multiplier of the held function, so
//! that a few constrained solves, each started from the last, find where it has risen
//! by the critical value. Where it never does the region is open. A contour of a pair of
//! functions is followed as a curve by steps along it and corrections across.
//!
//! # Source
//! Venzon & Moolgavkar 1988, A method for computing profile-likelihood-based confidence
//! intervals; Allgower & Georg, Introduction to Numerical Continuation Methods, chapter 2.

use alloc::vec;
use alloc::vec::Vec;

use super::gauss_newton::{Hold, Options, Solution, minimize};
use super::other_solutions::beside;
use super::{Function, Model};
use crate::numbers::algebra::dot_slices as dot;
use crate::observability::Observability;

/// How far from the estimate an end is looked for, in units of the larger of its
/// distance from the least value and of the interval of the local approximation.
const FAR: f64 = 1e3;
/// How near to the least value of a function.
const NEAR: f64 = 1e-3;

/// How small the next step is, in deviations, where a constrained solve ends: on the way to
/// an end, at it, and where only the side of the limit is asked for. chi2 is off by the
/// square of it.
const WALK: f64 = 1e-3;
const EDGE: f64 = 1e-5;
const PROBE: f64 = 0.03;
/// Steps of a constrained solve that lower chi2 no more.
const PATIENCE: u32 = 25;

/// How finely a contour is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fineness {
    /// From point to point, as a share of one and the distance from the centre, where the
    /// local region is a circle.
    pub step: f64,
    /// By how much chi2 may be off at a point, before the last correction.
    pub rise: f64,
    /// How small the next step is, in deviations, where a constrained solve ends.
    pub tolerance: f64,
    /// How far out a contour that does not close is followed, in deviations.
    pub far: f64,
}

impl Fineness {
    /// While a hand moves the scene: points within a few thousandths of the region's width, in
    /// a fraction of the solves.
    pub const ROUGH: Self = Self {
        step: 0.22,
        rise: 0.25,
        tolerance: 0.1,
        far: 50.0,
    };
}

impl Default for Fineness {
    /// For numbers: chi2 to a millionth.
    fn default() -> Self {
        Self {
            step: 0.12,
            rise: 1e-6,
            tolerance: EDGE,
            far: FAR,
        }
    }
}

/// One piece of an interval; `None` for an end that does not exist.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Its lower end.
    pub low: Option<f64>,
    /// Its upper end.
    pub high: Option<f64>,
    /// Whether each end is one: not where the constrained solve beyond it ended neither
    /// at a least chi2 nor for want of a state with that value.
    pub certain: [bool; 2],
}

/// An end of a piece, and whether it is certain.
#[derive(Clone, Copy, Debug)]
struct End {
    value: Option<f64>,
    certain: bool,
}

/// The values of a function that the measurements allow.
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// Its pieces, ascending.
    pub pieces: Vec<Piece>,
    /// Half the length of the interval of the local Gaussian approximation.
    pub local: f64,
    /// A state that fits better than the one asked about, where one was met on the way.
    pub better: Option<Solution>,
    /// Constrained solves.
    pub solves: usize,
}

/// A curve around a piece of a region, in the values of two functions.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// Points along it.
    pub points: Vec<[f64; 2]>,
    /// Whether it comes back to where it began.
    pub closed: bool,
    /// Whether it was followed as far as it goes: not where a constrained solve did not
    /// converge on the way.
    pub complete: bool,
}

/// The profile of some functions of the states.
struct Profile<'a, M: ?Sized> {
    model: &'a M,
    functions: &'a [&'a dyn Function],
    options: Options,
    /// Of a solve whose answer may become the estimate.
    whole: Options,
    solves: usize,
    best: f64,
    limit: f64,
    better: Option<Solution>,
    /// Whether the last value without an answer has states, none of which was shown to be
    /// the least: it may be allowed.
    doubt: bool,
}

impl<M: Model + ?Sized> Profile<'_, M> {
    /// A state with these values near another one, whatever its chi2: of one function alone.
    fn attained(&self, values: &[f64], start: &[f64]) -> Option<Vec<f64>> {
        match (self.functions, values) {
            (&[function], &[value]) => reached(function, value, start),
            _ => None,
        }
    }

    /// The least chi2 at these values, from the better of some starts.
    fn at(&mut self, values: &[f64], starts: &[Vec<f64>]) -> Option<Solution> {
        let hold: Vec<Hold<'_>> = self
            .functions
            .iter()
            .zip(values)
            .map(|(f, &v)| (*f, v))
            .collect();
        let mut found: Option<Solution> = None;
        self.doubt = false;
        for start in starts {
            let mut solution = minimize(self.model, start, &hold, self.options);
            self.solves += 1;
            if !solution.converged
                && !solution.held
                && let Some(there) = self.attained(values, start)
            {
                // The steps did not come to that value, and yet there are states with it.
                solution = minimize(self.model, &there, &hold, self.options);
                self.solves += 1;
                self.doubt |= !solution.converged;
            }
            // Not at the least chi2, but low enough already: allowed all the same.
            if !(solution.converged || solution.held && solution.chi2 <= self.limit) {
                self.doubt |= solution.held;
                continue;
            }
            if solution.converged
                && solution.chi2 < self.best - 1e-6 * (1.0 + self.best)
                && self.better.as_ref().is_none_or(|b| solution.chi2 < b.chi2)
            {
                let free = minimize(self.model, &solution.x, &[], self.whole);
                self.better = Some(if free.converged {
                    free
                } else {
                    solution.clone()
                });
            }
            if found.as_ref().is_none_or(|f| solution.chi2 < f.chi2) {
                found = Some(solution);
            }
        }
        found
    }
}

/// A state near another one where a function has a value, whatever the measurements say: by
/// Newton's method along its gradient; `None` where that does not come there.
pub(super) fn reached(function: &dyn Function, value: f64, start: &[f64]) -> Option<Vec<f64>> {
    let (mut x, mut gradient) = (start.to_vec(), vec![0.0; start.len()]);
    let mut left = value - function.value(&x, &mut gradient);
    // The value may be zero.
    let size = value.abs().max(left.abs());
    for _ in 0..60 {
        if left.abs() <= 1e-9 * size || !left.is_finite() {
            break;
        }
        let square = dot(&gradient, &gradient);
        let (from, mut share) = (x.clone(), 1.0);
        loop {
            for ((x, from), g) in x.iter_mut().zip(&from).zip(&gradient) {
                *x = from + share * left * g / square;
            }
            let mut there = vec![0.0; x.len()];
            let rest = value - function.value(&x, &mut there);
            if rest.abs() < left.abs() {
                (left, gradient) = (rest, there);
                break;
            }
            share *= 0.25;
            if share < 1e-6 {
                return None;
            }
        }
    }
    (left.abs() <= 1e-6 * size).then_some(x)
}

/// The values of `function` at which the least chi2 is at most `rise` above that of
/// `best`: with the critical value of chi-square with one degree of freedom an interval
/// of that confidence. A piece around each of `others` that reaches so low is found too.
pub fn interval<M: Model + ?Sized>(
    model: &M,
    best: &Solution,
    others: &[Solution],
    function: &dyn Function,
    rise: f64,
    options: Options,
) -> Interval {
    let function: &dyn Function = &Within::of(function, model, &best.x);
    let functions = [function];
    let others: Vec<Solution> = others
        .iter()
        .filter_map(|other| {
            let x = beside(model, &best.x, &other.x)?;
            Some(Solution { x, ..other.clone() })
        })
        .collect();
    let mut profile = Profile {
        model,
        functions: &functions,
        options: Options {
            patience: PATIENCE,
            ..options
        },
        whole: options,
        solves: 0,
        best: best.chi2,
        limit: best.chi2 + rise,
        better: None,
        doubt: false,
    };
    let mut pieces = Vec::new();
    let local = deviation(model, &best.x, function) * rise.sqrt();
    let limit = best.chi2 + rise;
    for seed in core::iter::once(best).chain(&others) {
        if seed.chi2 < limit {
            let (seed, step) = nearer(&mut profile, seed, limit);
            let mut low = side(&mut profile, &seed, -1.0, step, limit);
            let mut high = side(&mut profile, &seed, 1.0, step, limit);
            pieces.push(piece(low.remove(0), high.remove(0)));
            // Further pieces: pairs of a near and a far end.
            for pair in low.chunks_exact(2) {
                pieces.push(piece(pair[1], pair[0]));
            }
            for pair in high.chunks_exact(2) {
                pieces.push(piece(pair[0], pair[1]));
            }
        }
    }
    Interval {
        pieces: union(pieces),
        local,
        better: profile.better,
        solves: profile.solves,
    }
}

fn piece(low: End, high: End) -> Piece {
    Piece {
        low: low.value,
        high: high.value,
        certain: [low.certain, high.certain],
    }
}

/// A function, a state of a model at values that it is written with.
struct Within<'a> {
    function: &'a dyn Function,
    range: (f64, f64),
}

impl<'a> Within<'a> {
    fn of<M: Model + ?Sized>(function: &'a dyn Function, model: &M, x: &[f64]) -> Self {
        let (low, high) = function.range();
        let extent = function.state().map(|k| model.extent(x, k));
        let (least, most) = extent.unwrap_or((low, high));
        let range = (low.max(least), high.min(most));
        Self { function, range }
    }
}

impl Function for Within<'_> {
    fn value(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        self.function.value(x, gradient)
    }

    fn range(&self) -> (f64, f64) {
        self.range
    }
}

/// The standard deviation of a function in the local approximation.
fn deviation<M: Model + ?Sized>(model: &M, x: &[f64], function: &dyn Function) -> f64 {
    let (m, n) = (model.measurements(), model.states());
    let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
    let mut gradient = vec![0.0; n];
    function.value(x, &mut gradient);
    if model.linearize(x, &mut residuals, Some(&mut rows)).is_err() {
        return f64::INFINITY;
    }
    Observability::new(&rows, n, None)
        .and_then(|found| found.combination_std(&gradient))
        .unwrap_or(f64::INFINITY)
}

/// Where to begin with the piece around a state, and the length of the first step. Where the
/// likelihood is level out to an infinite value, the state may be anywhere out there: the
/// nearest one to the least value at which it still is.
fn nearer<M: Model + ?Sized>(
    profile: &mut Profile<'_, M>,
    seed: &Solution,
    limit: f64,
) -> (Solution, f64) {
    let function = profile.functions[0];
    let mut seed = seed.clone();
    let least = function.range().0;
    let mut value = function.value(&seed.x, &mut vec![0.0; seed.x.len()]);
    let mut step = deviation(profile.model, &seed.x, function) * (limit - seed.chi2).sqrt();
    if !least.is_finite() || step < value - least {
        return (seed, step);
    }
    profile.options.tolerance = WALK;
    for _ in 0..40 {
        let next = least + 0.125 * (value - least);
        match profile.at(&[next], core::slice::from_ref(&seed.x)) {
            Some(found) if found.chi2 - seed.chi2 < 0.02 * (limit - seed.chi2) => {
                // The rise counts from where chi2 is least all the same.
                seed.x = found.x;
                value = next;
                step = value - least;
            }
            _ => break,
        }
    }
    (seed, step)
}

/// A value of the function, and the state with the least chi2 there.
#[derive(Clone)]
struct Point {
    value: f64,
    solution: Solution,
}

/// The end on one side; after it, where the profile comes down again far out, the near
/// and the far end of another piece.
#[allow(clippy::too_many_lines)] // One walk outward.
fn side<M: Model + ?Sized>(
    profile: &mut Profile<'_, M>,
    seed: &Solution,
    sign: f64,
    step: f64,
    limit: f64,
) -> Vec<End> {
    const OPEN: End = End {
        value: None,
        certain: true,
    };
    let function = profile.functions[0];
    let n = seed.x.len();
    let start = function.value(&seed.x, &mut vec![0.0; n]);
    let bound = if sign < 0.0 {
        function.range().0
    } else {
        function.range().1
    };
    let size = if bound.is_finite() {
        (bound - start).abs()
    } else {
        let other = if sign < 0.0 {
            function.range().1
        } else {
            function.range().0
        };
        if other.is_finite() {
            start - other
        } else {
            0.0
        }
        .abs()
    };
    let step = if step.is_finite() && step > 0.0 {
        step
    } else {
        size.max(start.abs()).max(1.0)
    };
    let far = FAR * step.max(size);
    let outward = |from: f64, by: f64| {
        let value = from + sign * by;
        if bound.is_finite() && (value - bound) * sign >= 0.0 {
            0.5 * (from + bound)
        } else {
            value
        }
    };
    let ended = |value: f64| {
        if bound.is_finite() {
            (value - bound).abs() < NEAR * size
        } else {
            (value - start).abs() > far
        }
    };
    let mut inside = vec![Point {
        value: start,
        solution: seed.clone(),
    }];
    let mut ends = Vec::new();
    let mut next = outward(start, step);
    // Out to the first value that is not allowed.
    profile.options.tolerance = WALK;
    let mut halvings = 0;
    let outside = loop {
        let found = visit(profile, &inside, next);
        if found.is_none() && profile.doubt && halvings < 8 {
            // Not as far at once: a shorter step keeps to its branch.
            halvings += 1;
            let last = inside[inside.len() - 1].value;
            next = last + 0.25 * (next - last);
            continue;
        }
        let rises = found.as_ref().is_none_or(|f| f.chi2 > limit);
        if rises {
            break (next, found);
        }
        if let Some(solution) = found {
            inside.push(Point {
                value: next,
                solution,
            });
        }
        if ended(next) || inside.len() > 60 {
            return vec![OPEN];
        }
        let reach = (next - start).abs();
        next = outward(
            next,
            guess(&inside, limit, seed.chi2).clamp(0.2 * reach, reach),
        );
    };
    let (edge, beyond, certain) = cross(profile, &inside, outside, limit, seed.chi2);
    ends.push(End {
        value: Some(edge),
        certain,
    });
    // Farther out it may come down again, for ever: a target that may be anywhere.
    let Some(beyond) = beyond else { return ends };
    let mut trail = vec![beyond];
    profile.options.tolerance = PROBE;
    for factor in [3.0, 30.0, 300.0] {
        let value = if bound.is_finite() {
            bound + (edge - bound) / factor
        } else {
            edge + sign * (factor - 1.0) * (edge - start).abs().max(step)
        };
        if ended(value) {
            break;
        }
        let Some(found) = visit(profile, &trail, value) else {
            break;
        };
        let point = Point {
            value,
            solution: found,
        };
        if point.solution.chi2 <= limit {
            profile.options.tolerance = WALK;
            let Some(last) = trail.last().cloned() else {
                break;
            };
            let (near, _, certain) = cross(
                profile,
                core::slice::from_ref(&point),
                (last.value, Some(last.solution)),
                limit,
                seed.chi2,
            );
            ends.push(End {
                value: Some(near),
                certain,
            });
            ends.push(outermost(profile, point, sign, bound, far, limit));
            break;
        }
        trail.push(point);
    }
    ends
}

/// From a value that is allowed outward, by doubling: the far end.
fn outermost<M: Model + ?Sized>(
    profile: &mut Profile<'_, M>,
    from: Point,
    sign: f64,
    bound: f64,
    far: f64,
    limit: f64,
) -> End {
    let open = End {
        value: None,
        certain: true,
    };
    let base = from.solution.chi2;
    let mut inside = vec![from];
    for _ in 0..20 {
        let value = inside[inside.len() - 1].value;
        let next = if bound.is_finite() {
            0.5 * (value + bound)
        } else {
            value + sign * value.abs().max(0.01 * far)
        };
        if (next - inside[0].value).abs() > far {
            return open;
        }
        let found = visit(profile, &inside, next);
        match found {
            Some(solution) if solution.chi2 <= limit => inside.push(Point {
                value: next,
                solution,
            }),
            found => {
                let (edge, _, certain) = cross(profile, &inside, (next, found), limit, base);
                return End {
                    value: Some(edge),
                    certain,
                };
            }
        }
    }
    open
}

/// How far the root of the rise, nearly linear, needs to its limit.
fn guess(inside: &[Point], limit: f64, base: f64) -> f64 {
    let point = &inside[inside.len() - 1];
    let rise = (point.solution.chi2 - base).max(0.0);
    let slope = point.solution.slopes.first().map_or(0.0, |s| s.abs());
    let root = rise.sqrt();
    if slope > 0.0 && root > 0.0 {
        1.02 * ((limit - base).max(0.0).sqrt() - root) * 2.0 * root / slope
    } else {
        f64::INFINITY
    }
}

/// The least chi2 at a value, from the last points extrapolated and from the last.
fn visit<M: Model + ?Sized>(
    profile: &mut Profile<'_, M>,
    points: &[Point],
    value: f64,
) -> Option<Solution> {
    let last = points.last()?;
    let plain = last.solution.x.clone();
    if points.len() < 2 {
        return profile.at(&[value], &[plain]);
    }
    let before = &points[points.len() - 2];
    let span = last.value - before.value;
    let share = if span == 0.0 {
        0.0
    } else {
        (value - last.value) / span
    };
    let ahead: Vec<f64> = plain
        .iter()
        .zip(&before.solution.x)
        .map(|(a, b)| a + share * (a - b))
        .collect();
    profile
        .at(&[value], &[ahead])
        .or_else(|| profile.at(&[value], &[plain]))
}

/// Where the profile passes the limit between an allowed value and one that is not; the
/// point just beyond it; whether that is sure.
fn cross<M: Model + ?Sized>(
    profile: &mut Profile<'_, M>,
    inside: &[Point],
    outside: (f64, Option<Solution>),
    limit: f64,
    base: f64,
) -> (f64, Option<Point>, bool) {
    profile.options.tolerance = EDGE;
    // Where nothing was found beyond: whether there are states with that value.
    let mut doubt = outside.1.is_none() && profile.doubt;
    let mut low = inside[inside.len() - 1].clone();
    let (mut high, mut beyond) = (outside.0, outside.1);
    let wanted = (limit - base).max(0.0).sqrt();
    let root = |chi2: f64| (chi2 - base).max(0.0).sqrt() - wanted;
    let mut from_high = true;
    for round in 0..60 {
        let width = high - low.value;
        if width.abs() <= 1e-10 * low.value.abs().max(high.abs()) {
            break;
        }
        // Newton from the end that was found last, within the bracket.
        let newton = |value: f64, s: &Solution| {
            let rise = (s.chi2 - base).max(0.0).sqrt();
            let slope = s.slopes.first().copied().unwrap_or(0.0) / (2.0 * rise.max(1e-300));
            value - root(s.chi2) / slope
        };
        let mut next = match (&beyond, from_high) {
            (Some(s), true) => newton(high, s),
            _ => newton(low.value, &low.solution),
        };
        let place = (next - low.value) / width;
        if !(place > 0.0 && place < 1.0) || round % 8 == 7 {
            next = low.value + 0.5 * width;
        }
        let start = match &beyond {
            // Between the two, where the held function is nearly at its value.
            Some(s) => {
                let share = (next - low.value) / width;
                low.solution
                    .x
                    .iter()
                    .zip(&s.x)
                    .map(|(a, b)| a + share * (b - a))
                    .collect()
            }
            None => low.solution.x.clone(),
        };
        let mut found = profile.at(&[next], &[start]);
        let mut lost = found.is_none() && profile.doubt;
        if found.as_ref().is_none_or(|s| s.chi2 > limit) && (round == 0 || lost) {
            // A path that jumped to a worse branch would end the interval too early.
            let again = profile.at(&[next], &[low.solution.x.clone()]);
            lost = lost && again.is_none();
            if let Some(again) = again
                && found.as_ref().is_none_or(|s| again.chi2 < s.chi2)
            {
                found = Some(again);
            }
        }
        match found {
            Some(s) if s.chi2 <= limit => {
                let done = root(s.chi2).abs() < 1e-7 * wanted;
                low = Point {
                    value: next,
                    solution: s,
                };
                from_high = false;
                if done {
                    break;
                }
            }
            other => {
                let done = other
                    .as_ref()
                    .is_some_and(|s| root(s.chi2).abs() < 1e-7 * wanted);
                high = next;
                from_high = true;
                doubt = other.is_none() && lost;
                beyond = other;
                if done {
                    break;
                }
            }
        }
    }
    let edge = if from_high && beyond.is_some() {
        high
    } else {
        low.value
    };
    let point = beyond.map(|solution| Point {
        value: high,
        solution,
    });
    (edge, point, !doubt)
}

/// Pieces that touch made one, ascending.
fn union(mut pieces: Vec<Piece>) -> Vec<Piece> {
    let low = |p: &Piece| p.low.unwrap_or(f64::NEG_INFINITY);
    let high = |p: &Piece| p.high.unwrap_or(f64::INFINITY);
    pieces.sort_by(|a, b| low(a).total_cmp(&low(b)));
    let mut out: Vec<Piece> = Vec::new();
    for piece in pieces {
        match out.last_mut() {
            Some(last) if low(&piece) <= high(last) => {
                if high(&piece) > high(last) {
                    last.high = piece.high;
                    last.certain[1] = piece.certain[1];
                }
            }
            _ => out.push(piece),
        }
    }
    out
}

/// Whether `x` is in the region of all states: chi2 at most `rise` above the least.
///
/// # Errors
/// Where the model has no value at `x`.
pub fn contains<M: Model + ?Sized>(
    model: &M,
    best: &Solution,
    x: &[f64],
    rise: f64,
) -> Result<bool, M::Error> {
    let mut residuals = vec![0.0; model.measurements()];
    model.linearize(x, &mut residuals, None)?;
    Ok(dot(&residuals, &residuals) <= best.chi2 + rise)
}

/// The contours of a pair of functions at which the least chi2 is `rise` above that of
/// `best`, one for each piece of the region that holds `best` or one of `others`. Empty
/// where the measurements do not determine the pair.
pub fn contours<M: Model + ?Sized>(
    model: &M,
    best: &Solution,
    others: &[Solution],
    functions: [&dyn Function; 2],
    rise: f64,
    fineness: Fineness,
    options: Options,
) -> Vec<Contour> {
    let mut profile = Profile {
        model,
        functions: &functions,
        options: Options {
            tolerance: fineness.tolerance,
            patience: PATIENCE,
            ..options
        },
        whole: options,
        solves: 0,
        best: best.chi2,
        limit: best.chi2 + rise,
        better: None,
        doubt: false,
    };
    let limit = best.chi2 + rise;
    let mut found: Vec<Contour> = Vec::new();
    for seed in core::iter::once(best).chain(others) {
        let mut scratch = vec![0.0; seed.x.len()];
        let centre = functions.map(|f| f.value(&seed.x, &mut scratch));
        if seed.chi2 >= limit
            || found
                .iter()
                .any(|c| c.closed && encloses(&c.points, centre))
        {
            continue;
        }
        if let Some(plane) = Plane::new(model, seed, functions, centre, fineness)
            && let Some(contour) = plane.follow(&mut profile, seed, limit)
        {
            found.push(contour);
        }
    }
    found
}

/// The values of two functions in coordinates in which the local region is a circle.
struct Plane {
    centre: [f64; 2],
    /// Lower triangular root of the covariance.
    root: [f64; 3],
    low: [f64; 2],
    high: [f64; 2],
    fineness: Fineness,
}

impl Plane {
    fn new<M: Model + ?Sized>(
        model: &M,
        seed: &Solution,
        functions: [&dyn Function; 2],
        centre: [f64; 2],
        fineness: Fineness,
    ) -> Option<Self> {
        let (m, n) = (model.measurements(), model.states());
        let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
        let linear = model.linearize(&seed.x, &mut residuals, Some(&mut rows));
        linear.ok()?;
        let covariance = Observability::new(&rows, n, None).ok()?.crlb()?;
        let mut gradients = [vec![0.0; n], vec![0.0; n]];
        for (function, gradient) in functions.iter().zip(&mut gradients) {
            function.value(&seed.x, gradient);
        }
        let product = |a: &[f64], b: &[f64]| -> f64 {
            (0..n)
                .map(|i| a[i] * dot(&covariance[i * n..][..n], b))
                .sum()
        };
        let first = product(&gradients[0], &gradients[0]).sqrt();
        let shared = product(&gradients[0], &gradients[1]) / first;
        let second = (product(&gradients[1], &gradients[1]) - shared * shared).sqrt();
        let sound = first > 0.0 && second > 0.0 && first.is_finite() && second.is_finite();
        sound.then(|| Self {
            centre,
            root: [first, shared, second],
            low: functions.map(|f| f.range().0),
            high: functions.map(|f| f.range().1),
            fineness,
        })
    }

    fn values(&self, u: [f64; 2]) -> [f64; 2] {
        [
            self.centre[0] + self.root[0] * u[0],
            self.centre[1] + self.root[1] * u[0] + self.root[2] * u[1],
        ]
    }

    fn gradient(&self, slopes: &[f64]) -> [f64; 2] {
        [
            self.root[0] * slopes[0] + self.root[1] * slopes[1],
            self.root[2] * slopes[1],
        ]
    }

    fn allowed(&self, u: [f64; 2]) -> bool {
        let v = self.values(u);
        (0..2).all(|i| v[i] > self.low[i] && v[i] < self.high[i])
            && u[0].hypot(u[1]) < self.fineness.far
    }

    /// Brings a point onto the contour along the gradient.
    fn correct<M: Model + ?Sized>(
        &self,
        profile: &mut Profile<'_, M>,
        mut u: [f64; 2],
        start: &[f64],
        limit: f64,
    ) -> Option<([f64; 2], Solution)> {
        let mut x = start.to_vec();
        for _ in 0..12 {
            if !self.allowed(u) {
                return None;
            }
            let found = profile.at(&self.values(u), core::slice::from_ref(&x))?;
            let excess = found.chi2 - limit;
            let near = excess.abs() < self.fineness.rise;
            let g = self.gradient(&found.slopes);
            let square = g[0] * g[0] + g[1] * g[1];
            // No farther at once than the region is wide.
            let share = (excess / square).clamp(-1.0 / square.sqrt(), 1.0 / square.sqrt());
            let next = [u[0] - share * g[0], u[1] - share * g[1]];
            if near {
                // The last correction is so short that its end needs no solve.
                let whole = next.iter().all(|value| value.is_finite());
                return Some((if whole { next } else { u }, found));
            }
            u = next;
            x.clone_from(&found.x);
        }
        None
    }

    fn follow<M: Model + ?Sized>(
        &self,
        profile: &mut Profile<'_, M>,
        seed: &Solution,
        limit: f64,
    ) -> Option<Contour> {
        let radius = (limit - seed.chi2).sqrt();
        // The first direction along which an end is found.
        let (first, solution) = (0..8).find_map(|k| {
            let angle = f64::from(k) * core::f64::consts::FRAC_PI_4;
            let mut x = seed.x.clone();
            for share in [0.25, 0.5, 0.75] {
                let u = [share * radius * angle.cos(), share * radius * angle.sin()];
                if self.allowed(u)
                    && let Some(found) = profile.at(&self.values(u), core::slice::from_ref(&x))
                {
                    x = found.x;
                }
            }
            let u = [radius * angle.cos(), radius * angle.sin()];
            self.correct(profile, u, &x, limit)
        })?;
        let (mut points, closed, mut complete) = self.trace(profile, first, &solution, limit, 1.0);
        if !closed {
            let (mut back, _, other) = self.trace(profile, first, &solution, limit, -1.0);
            complete &= other;
            back.reverse();
            back.pop();
            back.append(&mut points);
            points = back;
        }
        Some(Contour {
            points: points.into_iter().map(|u| self.values(u)).collect(),
            closed,
            complete,
        })
    }

    /// Along the contour until it closes or leaves what is looked at: whether it closes,
    /// and whether it was followed to its end.
    fn trace<M: Model + ?Sized>(
        &self,
        profile: &mut Profile<'_, M>,
        first: [f64; 2],
        solution: &Solution,
        limit: f64,
        turn: f64,
    ) -> (Vec<[f64; 2]>, bool, bool) {
        let mut points = vec![first];
        let (mut u, mut at) = (first, solution.clone());
        let mut share = 1.0;
        // Where the curve came from: its direction there, the way since then, and the state.
        let mut last: Option<([f64; 2], f64, Vec<f64>)> = None;
        while points.len() < 400 {
            let g = self.gradient(&at.slopes);
            let length = g[0].hypot(g[1]);
            let step = turn * share * self.fineness.step * (1.0 + u[0].hypot(u[1]));
            let along = [-g[1] / length, g[0] / length];
            // Along the circle of the last two directions, and the states as they went.
            let (mut bend, mut x) = (0.0, at.x.clone());
            if let Some((before, way, state)) = &last {
                let sine = before[0] * along[1] - before[1] * along[0];
                bend = (0.5 * sine.clamp(-0.5, 0.5) * step / way).clamp(-0.5, 0.5);
                for (x, from) in x.iter_mut().zip(state) {
                    *x += (*x - from) * (step / way).clamp(-2.0, 2.0);
                }
            }
            let ahead = [
                u[0] + step * (along[0] - bend * along[1]),
                u[1] + step * (along[1] + bend * along[0]),
            ];
            let corrected = self
                .correct(profile, ahead, &x, limit)
                .filter(|(to, _)| (to[0] - u[0]).hypot(to[1] - u[1]) < 2.0 * step.abs());
            let Some((to, found)) = corrected else {
                share *= 0.5;
                last = None;
                if share < 1e-3 {
                    let left = !self.allowed(ahead) || u[0].hypot(u[1]) > 0.9 * self.fineness.far;
                    return (points, false, left);
                }
                continue;
            };
            share = f64::min(1.0, 1.5 * share);
            let near = (to[0] - first[0]).hypot(to[1] - first[1]) < 0.9 * step.abs();
            if points.len() > 6 && near {
                points.push(first);
                return (points, true, true);
            }
            points.push(to);
            let way = turn * (to[0] - u[0]).hypot(to[1] - u[1]);
            last = Some((along, way, at.x));
            (u, at) = (to, found);
        }
        (points, false, false)
    }
}

/// Whether a closed curve goes around a point.
fn encloses(curve: &[[f64; 2]], at: [f64; 2]) -> bool {
    let mut inside = false;
    for pair in curve.windows(2) {
        let ([x0, y0], [x1, y1]) = (pair[0], pair[1]);
        if (y0 > at[1]) != (y1 > at[1]) && at[0] < x0 + (at[1] - y0) / (y1 - y0) * (x1 - x0) {
            inside = !inside;
        }
    }
    inside
}
