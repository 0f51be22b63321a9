//! The least-squares fit with the moment eliminated.
//!
//! The field is linear in the moment, so that for each position and velocity the
//! best moment follows at once and at most six numbers are searched for. The
//! search steps of Gauss and Newton in these, with the moment following, are
//! those of the whole problem with its moment columns projected out.
//!
//! # Source
//! Golub & Pereyra 1973, in the form of Kaufman 1975, under the step control of
//! Levenberg and Marquardt; all projections by Householder reflections.

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::columns::{Columns, center};
use super::knowledge::{Knowledge, MOMENT, SPEED};
use crate::dipole::sensors::{Head, excess};
use crate::dipole::{MU0_OVER_4PI, Sensors, moment_tensor, position_tensor};
use crate::numbers::algebra::{cholesky, cholesky_solve, dot};
use crate::solve::noise::Whitening;

/// Rows that knowledge may add: nine states, speed, size of the moment.
const PRIOR_ROWS: usize = 11;

/// One recording, ready to be fitted.
#[derive(Clone, Debug)]
pub struct Record<'a> {
    /// Counted from the instant of the state.
    pub times: &'a [f64],
    /// The total field counts as it is near the ambient one: by its component along that.
    pub sensors: Sensors<'a>,
    /// (K, S, components), the background taken off unless it is fitted.
    pub field: &'a [f64],
    /// Whether a constant is fitted to each channel.
    pub offsets: bool,
}

impl Record<'_> {
    pub fn channels(&self) -> usize {
        self.sensors.channels()
    }
}

/// A position and velocity with the best moment for it.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    pub place: [f64; 6],
    pub moment: [f64; 3],
    /// Half of minus two log likelihoods: the sum of squares, priors included.
    pub cost: f64,
    pub iterations: u32,
    pub converged: bool,
}

impl Point {
    pub fn state(&self) -> [f64; 9] {
        let mut state = [0.0; 9];
        state[..6].copy_from_slice(&self.place);
        state[6..].copy_from_slice(&self.moment);
        state
    }
}

/// Evaluates and improves points for one record and one set of weights.
pub struct Fitter<'a> {
    record: Record<'a>,
    knowledge: &'a Knowledge,
    /// What whitens the numbers of the field.
    noise: Whitening,
    /// A constant, whitened, and the sum of its squares in each channel.
    constant: Vec<f64>,
    sums: Vec<f64>,
    /// Whitened field, centred where offsets are fitted.
    data: Vec<f64>,
    data_size: f64,
    /// Three columns of the moment and one of the field, and the position and velocity that
    /// they are of.
    linear: Columns,
    filled: Option<[f64; 6]>,
    /// Moment, position and velocity, residual.
    system: Columns,
    by_position: Columns,
    directions: Vec<[f64; 6]>,
    moment_directions: Vec<[f64; 3]>,
}

impl<'a> Fitter<'a> {
    pub fn new(record: Record<'a>, knowledge: &'a Knowledge) -> Self {
        let rows = record.field.len();
        let channels = record.channels();
        let mut fitter = Self {
            noise: Whitening::white(vec![1.0; rows], channels),
            constant: vec![1.0; rows],
            sums: vec![0.0; channels],
            data: vec![0.0; rows],
            data_size: 0.0,
            linear: Columns::new(rows, 4),
            filled: None,
            system: Columns::new(rows + PRIOR_ROWS, 10),
            by_position: Columns::new(rows, 6),
            directions: Vec::new(),
            moment_directions: Vec::new(),
            record,
            knowledge,
        };
        fitter.weigh();
        fitter
    }

    pub fn record(&self) -> &Record<'a> {
        &self.record
    }

    pub fn noise(&self) -> &Whitening {
        &self.noise
    }

    /// Sets what whitens the numbers of the field.
    pub fn set_noise(&mut self, noise: Whitening) {
        self.noise = noise;
        self.weigh();
    }

    fn weigh(&mut self) {
        self.filled = None;
        let channels = self.record.channels();
        self.constant.fill(1.0);
        self.noise.apply(&mut self.constant);
        self.sums.fill(0.0);
        for (i, &w) in self.constant.iter().enumerate() {
            self.sums[i % channels] += w * w;
        }
        self.data.copy_from_slice(self.record.field);
        self.noise.apply(&mut self.data);
        if self.record.offsets {
            center(&mut self.data, &self.constant, &self.sums);
        }
        self.data_size = self.data.iter().map(|x| x * x).sum();
    }

    /// The best moment and the cost at a position and velocity; an infinite cost
    /// where the dipole meets a sensor.
    pub fn evaluate(&mut self, place: &[f64; 6]) -> Point {
        self.fill_linear(place);
        let mut triangle = Matrix3::zeros();
        let mut rhs = Vector3::zeros();
        {
            let work = &mut self.system;
            work.resize(self.linear.rows());
            for j in 0..4 {
                work.column_mut(j).copy_from_slice(self.linear.column(j));
            }
            work.reduce(3, 4);
            for i in 0..3.min(work.rows()) {
                for j in i..3 {
                    triangle[(i, j)] = work.column(j)[i];
                }
                rhs[i] = work.column(3)[i];
            }
        }
        let moment = self.best_moment(&triangle, &rhs);
        let mut cost = self
            .prior_residuals(place, &moment)
            .iter()
            .flatten()
            .map(|(_, r)| r * r)
            .sum::<f64>();
        let [a, b, c] = [0, 1, 2].map(|j| self.linear.column(j));
        for (i, y) in self.linear.column(3).iter().enumerate() {
            let r = y - (a[i] * moment[0] + b[i] * moment[1] + c[i] * moment[2]);
            cost += r * r;
        }
        Point {
            place: *place,
            moment,
            cost: if cost.is_finite() {
                cost
            } else {
                f64::INFINITY
            },
            iterations: 0,
            converged: false,
        }
    }

    /// Columns of the moment and the field, weighted and centred.
    fn fill_linear(&mut self, place: &[f64; 6]) {
        // A step that was just taken was evaluated before.
        if self.filled.as_ref() == Some(place) {
            return;
        }
        self.filled = Some(*place);
        if self.record.sensors.plain() {
            self.fill_moments::<true>(place);
        } else {
            self.fill_moments::<false>(place);
        }
        for j in 0..3 {
            if !self.noise.is_white() {
                self.noise.apply(self.linear.column_mut(j));
            }
            if self.record.offsets {
                center(self.linear.column_mut(j), &self.constant, &self.sums);
            }
        }
        self.linear.column_mut(3).copy_from_slice(&self.data);
    }

    fn fill_moments<const PLAIN: bool>(&mut self, place: &[f64; 6]) {
        let (times, sensors) = (self.record.times, self.record.sensors);
        let (noise, mut columns) = (&self.noise, self.linear.first_three_mut());
        let (along, components) = read_by::<PLAIN>(&sensors);
        let mut row = 0;
        for &t in times {
            for sensor in 0..sensors.places.len() {
                each_head::<PLAIN>(&sensors, sensor, |index, head| {
                    let (n, inverse) = unit(&seen_from(place, t, &head.place));
                    let cube = head.sign * MU0_OVER_4PI * inverse * inverse * inverse;
                    let tensor = |i, j| moment_tensor(&n, i, j);
                    let factors = filled_with::<PLAIN>(noise, row, components, cube);
                    read(along.as_ref(), tensor, |i, j, value| {
                        let value = factors[i] * value;
                        let out = &mut columns[j][row + i];
                        *out = if index == 0 { value } else { *out + value };
                    });
                });
                row += components;
            }
        }
    }

    /// The moment that fits best, priors included.
    fn best_moment(&self, triangle: &Matrix3<f64>, rhs: &Vector3<f64>) -> [f64; 3] {
        let knowledge = self.knowledge;
        let mut moment = knowledge.solve_moment(triangle, rhs);
        let priors = &knowledge.prior;
        if priors[6..9].iter().all(Option::is_none) && priors[MOMENT].is_none() {
            return moment.into();
        }
        // The prior of the size is a row along the moment, which it turns a
        // little: a few rounds settle it.
        for _ in 0..if priors[MOMENT].is_some() { 8 } else { 1 } {
            let mut stacked = SMatrix::<f64, 7, 4>::zeros();
            stacked.fixed_view_mut::<3, 3>(0, 0).copy_from(triangle);
            stacked.fixed_view_mut::<3, 1>(0, 3).copy_from(rhs);
            for i in 0..3 {
                if let Some((mean, sigma)) = priors[6 + i] {
                    stacked[(3 + i, i)] = 1.0 / sigma;
                    stacked[(3 + i, 3)] = mean / sigma;
                }
            }
            if let (Some((mean, sigma)), size) = (priors[MOMENT], moment.norm())
                && size > 0.0
            {
                for i in 0..3 {
                    stacked[(6, i)] = moment[i] / (size * sigma);
                }
                stacked[(6, 3)] = mean / sigma;
            }
            let r = stacked.qr().r();
            let triangle = r.fixed_view::<3, 3>(0, 0).into_owned();
            let rhs = r.fixed_view::<3, 1>(0, 3).into_owned();
            moment = knowledge.solve_moment(&triangle, &rhs);
        }
        moment.into()
    }

    /// For each prior its derivative by the state and its whitened residual.
    fn prior_residuals(
        &self,
        place: &[f64; 6],
        moment: &[f64; 3],
    ) -> [Option<([f64; 9], f64)>; PRIOR_ROWS] {
        let mut out = [None; PRIOR_ROWS];
        let mut state = [0.0; 9];
        state[..6].copy_from_slice(place);
        state[6..].copy_from_slice(moment);
        for (i, prior) in self.knowledge.prior.iter().enumerate() {
            let Some((mean, sigma)) = *prior else {
                continue;
            };
            let mut row = [0.0; 9];
            let value = match i {
                SPEED | MOMENT => {
                    let first = if i == SPEED { 3 } else { 6 };
                    let size = state[first..first + 3]
                        .iter()
                        .map(|x| x * x)
                        .sum::<f64>()
                        .sqrt();
                    if size > 0.0 {
                        for k in first..first + 3 {
                            row[k] = state[k] / (size * sigma);
                        }
                    }
                    size
                }
                _ => {
                    row[i] = 1.0 / sigma;
                    state[i]
                }
            };
            out[i] = Some((row, (mean - value) / sigma));
        }
        out
    }

    /// Improves a point until nothing changes, at most `limit` rounds.
    pub fn refine(&mut self, start: &Point, limit: u32) -> Point {
        let mut best = *start;
        best.converged = false;
        let mut damping = 1e-3;
        // A step that moves the predicted field by less than this is none.
        let still = 1e-13 * self.data_size.sqrt();
        for _ in 0..limit {
            best.iterations += 1;
            let Some((gram, gradient)) = self.normal_equations(&best) else {
                best.converged = true;
                return best;
            };
            let count = self.directions.len();
            let scale: [f64; 6] = core::array::from_fn(|i| {
                if i < count && gram[(i, i)] > 0.0 {
                    gram[(i, i)].sqrt()
                } else {
                    1.0
                }
            });
            loop {
                let step = damped_step(&gram, &gradient, &scale, count, damping);
                let moved: f64 = (0..count)
                    .map(|i| (step[i] * scale[i]).powi(2))
                    .sum::<f64>()
                    .sqrt();
                if moved <= still.max(1e-10 * best.cost.sqrt()) {
                    best.converged = true;
                    // The last step costs nothing and still gains digits.
                    let last = self.moved(&best, &step);
                    if last.cost <= best.cost {
                        best.place = last.place;
                        best.moment = last.moment;
                        best.cost = last.cost;
                    }
                    return best;
                }
                let next = self.moved(&best, &step);
                if next.cost < best.cost {
                    let (iterations, gain) = (best.iterations, best.cost - next.cost);
                    damping = if damping < 1e-9 { 0.0 } else { 0.1 * damping };
                    best = Point { iterations, ..next };
                    if best.cost <= 1e-30 * self.data_size || gain < 1e-15 * best.cost {
                        best.converged = true;
                        return best;
                    }
                    break;
                }
                damping = if damping == 0.0 { 1e-9 } else { 8.0 * damping };
                if damping > 1e12 {
                    best.converged = true;
                    return best;
                }
            }
        }
        best
    }

    fn moved(&mut self, point: &Point, step: &SVector<f64, 6>) -> Point {
        let mut place = point.place;
        for (direction, &amount) in self.directions.iter().zip(step.iter()) {
            for i in 0..6 {
                place[i] += amount * direction[i];
            }
        }
        self.knowledge.project(&mut place);
        self.evaluate(&place)
    }

    /// Gram matrix and gradient of the allowed moves of position and velocity,
    /// the moment following. `None` where nothing may move.
    fn normal_equations(&mut self, point: &Point) -> Option<(SMatrix<f64, 6, 6>, SVector<f64, 6>)> {
        let mut directions = core::mem::take(&mut self.directions);
        let mut moment_directions = core::mem::take(&mut self.moment_directions);
        self.knowledge.tangent(&point.place, &mut directions);
        self.knowledge
            .moment_tangent(&point.moment, &mut moment_directions);
        let (moving, following) = (directions.len(), moment_directions.len());
        self.directions = directions;
        self.moment_directions = moment_directions;
        if moving == 0 {
            return None;
        }
        self.fill_linear(&point.place);
        self.fill_by_position(point);
        let rows = self.linear.rows();
        self.system.resize(rows + PRIOR_ROWS);
        let priors = self.prior_residuals(&point.place, &point.moment);
        for (j, direction) in self.moment_directions.iter().enumerate() {
            let column = self.system.column_mut(j);
            self.linear.combine(direction, &mut column[..rows]);
            for (place, prior) in column[rows..].iter_mut().zip(&priors) {
                *place = prior.map_or(0.0, |(row, _)| {
                    (0..3).map(|i| row[6 + i] * direction[i]).sum()
                });
            }
        }
        for (j, direction) in self.directions.iter().enumerate() {
            let column = self.system.column_mut(following + j);
            self.by_position.combine(direction, &mut column[..rows]);
            for (place, prior) in column[rows..].iter_mut().zip(&priors) {
                *place = prior.map_or(0.0, |(row, _)| (0..6).map(|i| row[i] * direction[i]).sum());
            }
        }
        let last = following + moving;
        let column = self.system.column_mut(last);
        let [a, b, c] = [0, 1, 2].map(|j| self.linear.column(j));
        let m = &point.moment;
        for (i, y) in self.linear.column(3).iter().enumerate() {
            column[i] = y - (a[i] * m[0] + b[i] * m[1] + c[i] * m[2]);
        }
        for (place, prior) in column[rows..].iter_mut().zip(&priors) {
            *place = prior.map_or(0.0, |(_, residual)| residual);
        }
        self.system.reduce(last, last + 1);
        let mut gram = SMatrix::zeros();
        let mut gradient = SVector::zeros();
        let height = last.min(self.system.rows());
        for i in 0..moving {
            let left = self.system.column(following + i);
            for j in 0..=i {
                let right = self.system.column(following + j);
                let sum: f64 = (following..height).map(|k| left[k] * right[k]).sum();
                gram[(i, j)] = sum;
                gram[(j, i)] = sum;
            }
            let residual = self.system.column(last);
            gradient[i] = (following..height).map(|k| left[k] * residual[k]).sum();
        }
        Some((gram, gradient))
    }

    /// Derivatives by position and velocity, weighted and centred.
    fn fill_by_position(&mut self, point: &Point) {
        if self.record.sensors.plain() {
            self.fill_positions::<true>(point);
        } else {
            self.fill_positions::<false>(point);
        }
        for j in 0..6 {
            let column = self.by_position.column_mut(j);
            if !self.noise.is_white() {
                self.noise.apply(column);
            }
            if self.record.offsets {
                center(column, &self.constant, &self.sums);
            }
        }
    }

    fn fill_positions<const PLAIN: bool>(&mut self, point: &Point) {
        let (place, m) = (&point.place, &point.moment);
        let (times, sensors) = (self.record.times, self.record.sensors);
        let (noise, columns) = (&self.noise, &mut self.by_position);
        let (along, components) = read_by::<PLAIN>(&sensors);
        let mut row = 0;
        for &t in times {
            for sensor in 0..sensors.places.len() {
                each_head::<PLAIN>(&sensors, sensor, |index, head| {
                    let (n, inverse) = unit(&seen_from(place, t, &head.place));
                    let part = dot(&n, m);
                    let squared = inverse * inverse;
                    let quartic = head.sign * 3.0 * MU0_OVER_4PI * squared * squared;
                    let tensor = |i, j| position_tensor(&n, m, part, i, j);
                    let factors = filled_with::<PLAIN>(noise, row, components, quartic);
                    read(along.as_ref(), tensor, |i, j, value| {
                        let value = factors[i] * value;
                        let later = t * value;
                        for (column, value) in [(j, value), (3 + j, later)] {
                            let out = &mut columns.column_mut(column)[row + i];
                            *out = if index == 0 { value } else { *out + value };
                        }
                    });
                });
                row += components;
            }
        }
    }

    /// Residuals in tesla, and the offsets of the channels where they are fitted.
    pub fn residuals(&self, point: &Point, out: &mut [f64]) -> Vec<f64> {
        let (channels, sensors) = (self.record.channels(), self.record.sensors);
        // Heads of such a size that they swallow the field are summed up before.
        out.fill(0.0);
        let mut row = 0;
        for &t in self.record.times {
            for sensor in 0..sensors.places.len() {
                for head in sensors.heads(sensor) {
                    let r = seen_from(&point.place, t, &head.place);
                    let h = crate::dipole::field(&r, &point.moment).unwrap_or([f64::INFINITY; 3]);
                    match &sensors.ambient {
                        None => (0..3).for_each(|i| out[row + i] += head.sign * h[i]),
                        Some(ambient) => {
                            let value = excess(ambient, &h).map_or(f64::INFINITY, |(x, _)| x);
                            out[row] += head.sign * value;
                        }
                    }
                }
                row += sensors.components();
            }
        }
        for (seen, field) in out.iter_mut().zip(self.record.field) {
            *seen = field - *seen;
        }
        let mut offsets = vec![0.0; channels];
        if self.record.offsets {
            let mut left = out.to_vec();
            self.noise.apply(&mut left);
            for (i, (r, c)) in left.iter().zip(&self.constant).enumerate() {
                if self.sums[i % channels] > 0.0 {
                    offsets[i % channels] += c * r / self.sums[i % channels];
                }
            }
            for (i, r) in out.iter_mut().enumerate() {
                *r -= offsets[i % channels];
            }
        }
        offsets
    }
}

/// Along which direction sensors read the field, if not all of it, and how many numbers each
/// gives: known to the compiler for sensors of one head and three components (`PLAIN`).
#[inline(always)]
fn read_by<const PLAIN: bool>(sensors: &Sensors<'_>) -> (Option<[f64; 3]>, usize) {
    if PLAIN {
        (None, 3)
    } else {
        (sensors.along(), sensors.components())
    }
}

/// Calls with each head of a sensor and its number.
#[inline(always)]
fn each_head<const PLAIN: bool>(
    sensors: &Sensors<'_>,
    sensor: usize,
    mut each: impl FnMut(usize, &Head<f64>),
) {
    if PLAIN {
        let place = sensors.places[sensor];
        each(0, &Head { place, sign: 1.0 });
    } else {
        for (index, head) in sensors.heads(sensor).enumerate() {
            each(index, &head);
        }
    }
}

/// The factors that the numbers of a reading are filled in with, times `scale`: the rest of the
/// whitening follows.
#[inline(always)]
fn filled_with<const PLAIN: bool>(
    noise: &Whitening,
    row: usize,
    components: usize,
    scale: f64,
) -> [f64; 3] {
    let mut factors = [scale; 3];
    if noise.is_white() {
        let components = if PLAIN { 3 } else { components };
        let of = &noise.factors()[row..row + components];
        for (factor, of) in factors.iter_mut().zip(of) {
            *factor = of * scale;
        }
    }
    factors
}

/// The unit vector along r, and 1 / |r|; infinite, and no numbers, where r is 0.
#[inline(always)]
fn unit(r: &[f64; 3]) -> ([f64; 3], f64) {
    let inverse = 1.0 / (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt();
    ([r[0] * inverse, r[1] * inverse, r[2] * inverse], inverse)
}

/// Where the dipole is at a time, seen from a head.
#[inline(always)]
fn seen_from(place: &[f64; 6], t: f64, head: &[f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| place[i] + t * place[3 + i] - head[i])
}

/// Gives the entries of a matrix of the field's derivatives, or those of its component
/// along a direction.
#[inline(always)]
fn read(
    along: Option<&[f64; 3]>,
    tensor: impl Fn(usize, usize) -> f64,
    mut put: impl FnMut(usize, usize, f64),
) {
    for j in 0..3 {
        match along {
            None => (0..3).for_each(|i| put(i, j, tensor(i, j))),
            Some(u) => put(0, j, (0..3).map(|i| u[i] * tensor(i, j)).sum()),
        }
    }
}

fn damped_step(
    gram: &SMatrix<f64, 6, 6>,
    gradient: &SVector<f64, 6>,
    scale: &[f64; 6],
    count: usize,
    damping: f64,
) -> SVector<f64, 6> {
    let mut damping = damping;
    loop {
        let matrix: [[f64; 6]; 6] = core::array::from_fn(|i| {
            core::array::from_fn(|j| {
                let unit = if i == j { 1.0 } else { 0.0 };
                if i < count && j < count {
                    gram[(i, j)] / (scale[i] * scale[j]) + damping * unit
                } else {
                    unit
                }
            })
        });
        if let Some(factor) = cholesky(&matrix) {
            let rhs = core::array::from_fn(|i| {
                if i < count {
                    gradient[i] / scale[i]
                } else {
                    0.0
                }
            });
            let step = cholesky_solve(&factor, &rhs);
            return SVector::from_fn(|i, _| step[i] / scale[i]);
        }
        // Not determined without damping: an unobservable direction.
        damping = (10.0 * damping).max(1e-12);
        if !(damping < 1e20) {
            return SVector::zeros();
        }
    }
}
