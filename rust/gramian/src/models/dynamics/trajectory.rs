//! A trajectory and the transitions along it.

use alloc::vec;
use alloc::vec::Vec;

use super::blocks;
use crate::linear::window::solve;
use crate::scalar::{NumberError, all_finite, check_finite, check_length};

/// A system given as functions, each called for several points at once: times (k), states
/// (k x n, row-major). What they return they write to `out`.
pub trait System {
    /// What can go wrong in a call.
    type Error;
    /// Number of states.
    fn states(&self) -> usize;
    /// Number of outputs.
    fn outputs(&self) -> usize;
    /// Whether its functions take many points in little more time than one: then they are
    /// asked about many at once, of which some are guesses far from the trajectory.
    fn takes_many(&self) -> bool {
        false
    }
    /// Whether an error ends everything, even where a guess may be what caused it.
    fn is_final(&self, _: &Self::Error) -> bool {
        true
    }
    /// f: k x n.
    ///
    /// # Errors
    /// Whatever the function reports.
    fn rate(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> Result<(), Self::Error>;
    /// df / dx: k x n x n.
    ///
    /// # Errors
    /// Whatever the function reports.
    fn rate_jacobian(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> Result<(), Self::Error>;
    /// h: k x p.
    ///
    /// # Errors
    /// Whatever the function reports.
    fn output(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> Result<(), Self::Error>;
    /// dh / dx: k x p x n; `error` receives how wrong each entry may be, where it is not
    /// exact.
    ///
    /// # Errors
    /// Whatever the function reports.
    fn output_jacobian(
        &mut self,
        t: &[f64],
        x: &[f64],
        out: &mut [f64],
        error: &mut [f64],
    ) -> Result<(), Self::Error>;
}

/// Why there is no trajectory.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Failure<E> {
    /// An argument.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// A function of the system.
    #[error("a function of the system failed")]
    System(E),
    /// A step that no halving made small enough.
    #[error(
        "the trajectory cannot be followed beyond t = {time}: steps of {step:.1e} are not accurate \
         enough; is f smooth, and finite there?"
    )]
    Stuck {
        /// Where.
        time: f64,
        /// The smallest step tried.
        step: f64,
    },
    /// As many steps as may be taken.
    #[error(
        "the integrator took {most} steps and came no farther than t = {time}: give later times \
         apart, or let it take more"
    )]
    TooFar {
        /// As many as may be taken, those that were tried and thrown away among them.
        most: usize,
        /// Where it was.
        time: f64,
    },
    /// A state that is not finite.
    #[error("state {state} is not finite at t = {time}")]
    Infinite {
        /// Which.
        state: usize,
        /// When.
        time: f64,
    },
}

/// States, outputs and their derivatives at K times.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// K x n.
    pub states: Vec<f64>,
    /// K x p.
    pub outputs: Vec<f64>,
    /// d `x[k+1]` / d `x[k]`: K - 1 x n x n.
    pub transitions: Vec<f64>,
    /// dh / dx: K x p x n.
    pub jacobians: Vec<f64>,
    /// How far each transition is from that of steps twice as long, K - 1 x n x n: many
    /// times its error, and never less than rounding.
    pub transition_changes: Vec<f64>,
    /// How wrong each entry of `jacobians` may be: by differences, and by the error of the
    /// state where it was taken.
    pub jacobian_errors: Vec<f64>,
    /// Steps of the integrator, all in all.
    pub steps: usize,
}

/// Gauss-Legendre, three stages, order six.
pub(super) mod gauss {
    const ROOT: f64 = 3.872_983_346_207_417; // sqrt(15)
    pub const NODES: [f64; 3] = [0.5 - ROOT / 10.0, 0.5, 0.5 + ROOT / 10.0];
    pub const WEIGHTS: [f64; 3] = [5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0];
    pub const MATRIX: [[f64; 3]; 3] = [
        [
            5.0 / 36.0,
            2.0 / 9.0 - ROOT / 15.0,
            5.0 / 36.0 - ROOT / 30.0,
        ],
        [
            5.0 / 36.0 + ROOT / 24.0,
            2.0 / 9.0,
            5.0 / 36.0 - ROOT / 24.0,
        ],
        [
            5.0 / 36.0 + ROOT / 30.0,
            2.0 / 9.0 + ROOT / 15.0,
            5.0 / 36.0,
        ],
    ];
}

pub(super) const STAGES: usize = 3;

/// Follows x' = f(t, x) from `x0` at `times[0]` through all `times`.
///
/// Between two times there are as many equal steps as it takes: their number is doubled
/// until state and transition change by less than `rtol` of their size. At most `most`
/// steps are taken, those of rejected attempts among them.
///
/// # Errors
/// [`Failure`].
///
/// # Source
/// Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, II.7 (Gauss
/// methods), I.14 (variational equations).
pub fn integrate<S: System>(
    system: &mut S,
    x0: &[f64],
    times: &[f64],
    rtol: f64,
    most: usize,
) -> Result<Trajectory, Failure<S::Error>> {
    let n = check(system, x0, times)?;
    if !(rtol > 0.0 && rtol < 1.0) {
        return Err(NumberError::OutOfRange {
            name: "rtol",
            given: rtol,
            allowed: "between 0 and 1",
        }
        .into());
    }
    let mut way = Way {
        states: x0.to_vec(),
        transitions: Vec::new(),
        changes: Changes::new(n),
        substeps: 1,
        steps: 0,
        tried: 0,
        most,
    };
    let (mut first, mut length) = (0, 32);
    while first + 1 < times.len() {
        let last = (first + length).min(times.len() - 1);
        if system.takes_many()
            && last > first + 1
            && way.many(system, &times[first..=last], rtol)?
        {
            (first, length) = (last, (2 * length).min(256));
            continue;
        }
        way.one(system, times[first], times[first + 1], rtol)?;
        (first, length) = (first + 1, (length / 4).max(2));
    }
    let (states, transitions) = (way.states, way.transitions);
    look(system, states, transitions, &way.changes, times, way.steps)
}

/// A trajectory as far as it has come.
struct Way {
    states: Vec<f64>,
    transitions: Vec<f64>,
    changes: Changes,
    /// What the last interval took.
    substeps: usize,
    steps: usize,
    /// Steps that were taken, those of rejected attempts among them.
    tried: usize,
    most: usize,
}

impl Way {
    fn allow<E>(&mut self, steps: usize, time: f64) -> Result<(), Failure<E>> {
        self.tried += steps;
        let most = self.most;
        if self.tried > most {
            return Err(Failure::TooFar { most, time });
        }
        Ok(())
    }

    /// One interval.
    fn one<S: System>(
        &mut self,
        system: &mut S,
        from: f64,
        to: f64,
        rtol: f64,
    ) -> Result<(), Failure<S::Error>> {
        let n = system.states();
        let x = self.states[self.states.len() - n..].to_vec();
        // What served before, or half of it.
        let mut substeps = (self.substeps / 2).max(1);
        self.allow(substeps, from)?;
        let mut coarse = leap(system, &x, from, to, substeps)?;
        loop {
            substeps *= 2;
            if substeps > 1 << 14 {
                return Err(Failure::Stuck {
                    time: from,
                    step: (to - from) / substeps as f64,
                });
            }
            self.allow(substeps, from)?;
            let fine = leap(system, &x, from, to, substeps)?;
            self.steps += substeps;
            if let (Some(a), Some(b)) = (&coarse, &fine)
                && close(&a.0, &b.0, rtol)
                && close(&a.1, &b.1, rtol)
            {
                self.states.extend_from_slice(&b.0);
                self.transitions.extend_from_slice(&b.1);
                self.changes.add([&a.0, &a.1], [&b.0, &b.1]);
                // The difference is that of the coarse one: these were enough.
                self.substeps = substeps / 2;
                return Ok(());
            }
            coarse = fine;
        }
    }

    /// All intervals of `times` at once, by the same criterion; whether they could be.
    fn many<S: System>(
        &mut self,
        system: &mut S,
        times: &[f64],
        rtol: f64,
    ) -> Result<bool, Failure<S::Error>> {
        let n = system.states();
        let x = self.states[self.states.len() - n..].to_vec();
        let count = times.len() - 1;
        let mut substeps = vec![2 * self.substeps.div_ceil(2).max(1); count];
        // States at the beginnings of the intervals, and at the end.
        let mut path = x.repeat(count + 1);
        for _ in 0..6 {
            let steps = substeps.iter().sum::<usize>() * 3 / 2;
            if steps > self.most.saturating_sub(self.tried) {
                // One by one they may come farther.
                return Ok(false);
            }
            self.allow(steps, times[0])?;
            let mesh = blocks::mesh(times, &substeps, false);
            let fine = match blocks::ends(system, &mesh, &substeps, &x, &path) {
                Ok(Some(fine)) => fine,
                Err(error) if system.is_final(&error) => return Err(Failure::System(error)),
                Ok(None) | Err(_) => return Ok(false),
            };
            path.truncate(n);
            path.extend_from_slice(&fine.states);
            let half: Vec<usize> = substeps.iter().map(|s| s / 2).collect();
            let mesh = blocks::mesh(times, &half, true);
            let long = match blocks::ends(system, &mesh, &half, &path[..count * n], &path) {
                Ok(Some(long)) => long,
                Err(error) if system.is_final(&error) => return Err(Failure::System(error)),
                Ok(None) | Err(_) => return Ok(false),
            };
            self.steps += substeps.iter().sum::<usize>();
            let ends = |of: &blocks::Ends, k: usize| -> [Vec<f64>; 2] {
                [
                    of.states[k * n..(k + 1) * n].to_vec(),
                    of.transitions[k * n * n..(k + 1) * n * n].to_vec(),
                ]
            };
            let mut done = true;
            for (k, substeps) in substeps.iter_mut().enumerate() {
                let (a, b) = (ends(&long, k), ends(&fine, k));
                if !(close(&a[0], &b[0], rtol) && close(&a[1], &b[1], rtol)) {
                    *substeps *= 2;
                    done = false;
                }
            }
            if done {
                for k in 0..count {
                    let (a, b) = (ends(&long, k), ends(&fine, k));
                    self.changes.add([&a[0], &a[1]], [&b[0], &b[1]]);
                }
                self.states.extend_from_slice(&fine.states);
                self.transitions.extend_from_slice(&fine.transitions);
                self.substeps = substeps[count - 1] / 2;
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// What steps twice as long would have changed.
struct Changes {
    transitions: Vec<f64>,
    /// Of the states, carried on by the transitions.
    states: Vec<f64>,
}

impl Changes {
    fn new(n: usize) -> Self {
        Self {
            transitions: Vec::new(),
            states: vec![0.0; n],
        }
    }

    /// One more interval: state and transition at its end by long steps, and by short ones.
    fn add(&mut self, long: [&[f64]; 2], short: [&[f64]; 2]) {
        let n = short[0].len();
        let before = self.states[self.states.len() - n..].to_vec();
        for i in 0..n {
            let carried: f64 = (0..n).map(|j| short[1][i * n + j] * before[j]).sum();
            self.states.push(carried + long[0][i] - short[0][i]);
        }
        for (x, y) in long[1].iter().zip(short[1]) {
            // A few units in the last place, up and down without a pattern.
            let place = self.transitions.len() as u64;
            let sign = if place.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 63 == 0 {
                1.0
            } else {
                -1.0
            };
            self.transitions
                .push(x - y + sign * 4.0 * f64::EPSILON * y.abs());
        }
    }
}

/// Follows `x[k+1] = f(t[k], x[k])`.
///
/// # Errors
/// [`Failure`].
pub fn iterate<S: System>(
    system: &mut S,
    x0: &[f64],
    times: &[f64],
) -> Result<Trajectory, Failure<S::Error>> {
    let n = check(system, x0, times)?;
    let mut states = x0.to_vec();
    let mut next = vec![0.0; n];
    for (k, t) in times.iter().enumerate().take(times.len() - 1) {
        system
            .rate(
                core::slice::from_ref(t),
                &states[k * n..(k + 1) * n],
                &mut next,
            )
            .map_err(Failure::System)?;
        states.extend_from_slice(&next);
    }
    let count = times.len() - 1;
    let mut transitions = vec![0.0; count * n * n];
    system
        .rate_jacobian(&times[..count], &states[..count * n], &mut transitions)
        .map_err(Failure::System)?;
    let mut changes = Changes::new(n);
    for (x, phi) in states[n..]
        .chunks_exact(n)
        .zip(transitions.chunks_exact(n * n))
    {
        changes.add([x, phi], [x, phi]);
    }
    look(system, states, transitions, &changes, times, count)
}

fn check<S: System>(system: &S, x0: &[f64], times: &[f64]) -> Result<usize, NumberError> {
    let n = system.states();
    check_length("x0", x0.len(), n)?;
    check_finite("x0", x0)?;
    check_length("times", times.len(), times.len().max(1))?;
    check_finite("times", times)?;
    Ok(n)
}

fn look<S: System>(
    system: &mut S,
    states: Vec<f64>,
    transitions: Vec<f64>,
    changes: &Changes,
    times: &[f64],
    steps: usize,
) -> Result<Trajectory, Failure<S::Error>> {
    let (n, p) = (system.states(), system.outputs());
    if let Some(bad) = states.iter().position(|x| !x.is_finite()) {
        return Err(Failure::Infinite {
            state: bad % n,
            time: times[bad / n],
        });
    }
    let mut outputs = vec![0.0; times.len() * p];
    let mut jacobians = vec![0.0; times.len() * p * n];
    let mut errors = vec![0.0; times.len() * p * n];
    system
        .output(times, &states, &mut outputs)
        .and_then(|()| system.output_jacobian(times, &states, &mut jacobians, &mut errors))
        .map_err(Failure::System)?;
    check_finite("h", &outputs)?;
    check_finite("dh/dx", &jacobians)?;
    check_finite("df/dx", &transitions)?;
    if changes.states.iter().any(|x| *x != 0.0) {
        // What the error of the states makes of the Jacobians.
        let moved: Vec<f64> = states
            .iter()
            .zip(&changes.states)
            .map(|(x, d)| x + d)
            .collect();
        let (mut there, mut off) = (vec![0.0; errors.len()], vec![0.0; errors.len()]);
        system
            .output_jacobian(times, &moved, &mut there, &mut off)
            .map_err(Failure::System)?;
        for ((error, x), y) in errors.iter_mut().zip(&there).zip(&jacobians) {
            let change = (x - y).abs();
            *error += if change.is_finite() { change } else { 0.0 };
        }
    }
    Ok(Trajectory {
        states,
        outputs,
        transitions,
        jacobians,
        transition_changes: changes.transitions.clone(),
        jacobian_errors: errors,
        steps,
    })
}

/// A derivative that differences at two steps do not agree on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// Which point, value and state.
    pub point: usize,
    /// Which of the values.
    pub value: usize,
    /// Which of the states.
    pub state: usize,
    /// The two slopes.
    pub slopes: [f64; 2],
    /// The two steps.
    pub steps: [f64; 2],
}

/// The derivative (k x m x n) of a function of k points (k x n) with m values each, by
/// central differences at two steps, extrapolated: steps of `scale`/1000 and twice that,
/// all points in one call. `error` receives how wrong each may be by rounding and by the
/// next term. Returns the first derivative on which the two steps do not agree at all: the
/// function jumps there, or bends within the step.
///
/// # Errors
/// What the function reports.
pub fn differences<E>(
    mut f: impl FnMut(&[f64], &[f64], &mut [f64]) -> Result<(), E>,
    t: &[f64],
    x: &[f64],
    values: usize,
    scale: &[f64],
    out: &mut [f64],
    error: &mut [f64],
) -> Result<Option<Disagreement>, E> {
    let n = scale.len();
    let count = t.len();
    let moves = [-2.0, -1.0, 1.0, 2.0];
    let per_point = moves.len() * n;
    let mut times = Vec::with_capacity(count * per_point);
    let mut points = Vec::with_capacity(count * per_point * n);
    for (&t, x) in t.iter().zip(x.chunks_exact(n)) {
        for j in 0..n {
            for factor in moves {
                times.push(t);
                let from = points.len();
                points.extend_from_slice(x);
                points[from + j] += factor * 1e-3 * scale[j];
            }
        }
    }
    let mut results = vec![0.0; times.len() * values];
    f(&times, &points, &mut results)?;
    let mut disagreement = None;
    for k in 0..count {
        for j in 0..n {
            let first = (k * n + j) * moves.len();
            // The steps that were taken, after rounding.
            let at = |m: usize| points[(first + m) * n + j];
            let (narrow, wide) = (at(2) - at(1), at(3) - at(0));
            for i in 0..values {
                let y = |m: usize| results[(first + m) * values + i];
                let (near, far) = ((y(2) - y(1)) / narrow, (y(3) - y(0)) / wide);
                let size = (0..moves.len()).fold(0.0_f64, |top, m| top.max(y(m).abs()));
                let rounding = 4.0 * f64::EPSILON * size / narrow.abs();
                let place = (k * values + i) * n + j;
                out[place] = near + (near - far) / 3.0;
                error[place] = 0.01 * (near - far).abs() + rounding;
                // What a longer step does not see makes the short one's slope the larger: a
                // jump, or detail between the two. Third derivatives do the opposite.
                if disagreement.is_none() && near.abs() > 1.2 * far.abs() + 1e3 * rounding {
                    disagreement = Some(Disagreement {
                        point: k,
                        value: i,
                        state: j,
                        slopes: [near, far],
                        steps: [narrow / 2.0, wide / 2.0],
                    });
                }
            }
        }
    }
    Ok(disagreement)
}

/// Whether all differences are below `rtol` of the largest entry.
fn close(a: &[f64], b: &[f64], rtol: f64) -> bool {
    let top = b.iter().fold(f64::MIN_POSITIVE, |top, x| top.max(x.abs()));
    a.iter().zip(b).all(|(x, y)| (x - y).abs() <= rtol * top)
}

type End = Option<(Vec<f64>, Vec<f64>)>;

/// State and transition after `count` equal steps; `None` where a step has no solution.
fn leap<S: System>(
    system: &mut S,
    x0: &[f64],
    from: f64,
    to: f64,
    count: usize,
) -> Result<End, Failure<S::Error>> {
    let n = x0.len();
    let h = (to - from) / count as f64;
    let mut x = x0.to_vec();
    let mut phi = vec![0.0; n * n];
    for i in 0..n {
        phi[i * n + i] = 1.0;
    }
    let mut local = vec![0.0; STAGES * n * n];
    let mut first = true;
    for k in 0..count {
        let t = from + h * k as f64;
        let stage_times = gauss::NODES.map(|c| t + c * h);
        if first {
            let here: Vec<f64> = x.iter().copied().cycle().take(STAGES * n).collect();
            system
                .rate_jacobian(&stage_times, &here, &mut local)
                .map_err(Failure::System)?;
            first = false;
        }
        let Some(rates) = stages(system, &x, &stage_times, h, &local)? else {
            return Ok(None);
        };
        let points = stage_points(&x, &rates, h);
        system
            .rate_jacobian(&stage_times, &points, &mut local)
            .map_err(Failure::System)?;
        let step = all_finite(&local)
            .then(|| blocks::transition(&local, h, n))
            .flatten();
        let Some(step) = step else {
            return Ok(None);
        };
        blocks::advance(&mut x, &rates, h);
        phi = product(&step, &phi, n);
    }
    Ok((all_finite(&x) && all_finite(&phi)).then_some((x, phi)))
}

pub(super) fn product(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for (row, line) in out.chunks_exact_mut(n).zip(a.chunks_exact(n)) {
        for (&factor, b) in line.iter().zip(b.chunks_exact(n)) {
            for (y, x) in row.iter_mut().zip(b) {
                *y += factor * x;
            }
        }
    }
    out
}

fn stage_points(x: &[f64], rates: &[f64], h: f64) -> Vec<f64> {
    let n = x.len();
    let mut points = Vec::with_capacity(STAGES * n);
    for row in &gauss::MATRIX {
        for i in 0..n {
            let sum: f64 = (0..STAGES).map(|s| row[s] * rates[s * n + i]).sum();
            points.push(x[i] + h * sum);
        }
    }
    points
}

/// The rates at the stages by Newton's method with the derivative at the beginning.
fn stages<S: System>(
    system: &mut S,
    x: &[f64],
    times: &[f64; STAGES],
    h: f64,
    jacobian: &[f64],
) -> Result<Option<Vec<f64>>, Failure<S::Error>> {
    let n = x.len();
    let mut rates = vec![0.0; STAGES * n];
    let mut values = vec![0.0; STAGES * n];
    let mut before = f64::INFINITY;
    for round in 0..20 {
        let points = stage_points(x, &rates, h);
        if !all_finite(&points) {
            return Ok(None);
        }
        system
            .rate(times, &points, &mut values)
            .map_err(Failure::System)?;
        if !all_finite(&values) {
            return Ok(None);
        }
        let residual: Vec<f64> = values.iter().zip(&rates).map(|(f, k)| f - k).collect();
        let size = residual.iter().fold(0.0_f64, |top, r| top.max(r.abs()));
        let top = values.iter().fold(0.0_f64, |top, f| top.max(f.abs()));
        if size <= 4.0 * f64::EPSILON * top || (round > 2 && size >= 0.5 * before) {
            // Rounding does not let it go further; or it does not converge.
            return Ok((size <= 1e-10 * top).then_some(values));
        }
        before = size;
        if !all_finite(jacobian) {
            return Ok(None);
        }
        let Some(step) = solve_block(jacobian, h, n, residual, 1) else {
            return Ok(None);
        };
        for (k, d) in rates.iter_mut().zip(step) {
            *k += d;
        }
    }
    Ok(None)
}

/// Solves (I - h A (x) J) y = rhs, `columns` columns, for the three stages at once.
pub(super) fn solve_block(
    jacobian: &[f64],
    h: f64,
    n: usize,
    rhs: Vec<f64>,
    columns: usize,
) -> Option<Vec<f64>> {
    let m = STAGES * n;
    let mut matrix = vec![0.0; m * m];
    for r in 0..STAGES {
        for i in 0..n {
            for s in 0..STAGES {
                for j in 0..n {
                    let entry = -h * gauss::MATRIX[r][s] * jacobian[(r * n + i) * n + j];
                    matrix[(r * n + i) * m + s * n + j] = entry;
                }
            }
            matrix[(r * n + i) * m + r * n + i] += 1.0;
        }
    }
    solve(matrix, rhs, m, columns)
}

#[cfg(test)]
#[allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap
)]
mod tests {
    use super::*;

    struct Pendulum;

    impl System for Pendulum {
        type Error = core::convert::Infallible;
        fn states(&self) -> usize {
            2
        }
        fn outputs(&self) -> usize {
            1
        }
        fn rate(&mut self, _: &[f64], x: &[f64], out: &mut [f64]) -> Result<(), Self::Error> {
            for (x, out) in x.chunks_exact(2).zip(out.chunks_exact_mut(2)) {
                out.copy_from_slice(&[x[1], -x[0].sin()]);
            }
            Ok(())
        }
        fn rate_jacobian(
            &mut self,
            _: &[f64],
            x: &[f64],
            out: &mut [f64],
        ) -> Result<(), Self::Error> {
            for (x, out) in x.chunks_exact(2).zip(out.chunks_exact_mut(4)) {
                out.copy_from_slice(&[0.0, 1.0, -x[0].cos(), 0.0]);
            }
            Ok(())
        }
        fn output(&mut self, _: &[f64], x: &[f64], out: &mut [f64]) -> Result<(), Self::Error> {
            for (x, out) in x.chunks_exact(2).zip(out) {
                *out = x[0];
            }
            Ok(())
        }
        fn output_jacobian(
            &mut self,
            _: &[f64],
            _: &[f64],
            out: &mut [f64],
            _: &mut [f64],
        ) -> Result<(), Self::Error> {
            for out in out.chunks_exact_mut(2) {
                out.copy_from_slice(&[1.0, 0.0]);
            }
            Ok(())
        }
    }

    #[test]
    fn energy_stays_and_the_transition_is_symplectic_and_the_derivative() {
        let times = [0.0, 1.0, 5.0, 6.0];
        let follow =
            |x0: [f64; 2]| integrate(&mut Pendulum, &x0, &times, 1e-12, usize::MAX).unwrap();
        let found = follow([1.0, 0.3]);
        let energy = |x: &[f64]| 0.5 * x[1] * x[1] - x[0].cos();
        for x in found.states.chunks_exact(2) {
            assert!((energy(x) - energy(&[1.0, 0.3])).abs() < 1e-12);
        }
        for phi in found.transitions.chunks_exact(4) {
            assert!((phi[0] * phi[3] - phi[1] * phi[2] - 1.0).abs() < 1e-11);
        }
        let step = 1e-6;
        let (high, low) = (follow([1.0 + step, 0.3]), follow([1.0 - step, 0.3]));
        for i in 0..2 {
            let difference = (high.states[2 + i] - low.states[2 + i]) / (2.0 * step);
            assert!((difference - found.transitions[2 * i]).abs() < 1e-9);
        }
    }

    #[test]
    fn no_more_steps_than_allowed_are_taken() {
        let times = [0.0, 1.0, 1e3, 1e9];
        let found = integrate(&mut Pendulum, &[1.0, 0.3], &times, 1e-9, 5000);
        assert_eq!(
            found.unwrap_err(),
            Failure::TooFar {
                most: 5000,
                time: 1.0
            }
        );
    }
}
