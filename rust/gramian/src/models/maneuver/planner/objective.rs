//! What a set of paths tells of its targets, as a cost with its gradient.

use alloc::sync::Arc;
use alloc::vec;
use alloc::vec::Vec;

use super::bearings::{self, ByRow, Line, Pulls, Rows};
use super::paths::{Pull, Track};
use super::{Aim, Criterion, Over, Problem, Sensor};
use crate::batch::lanes::LANES;
use crate::batch::simd::Path;
use crate::maneuver::plan::{self, differentiate};
use crate::numbers::dual::Dual;
use crate::numbers::lane::Lane;
use crate::scalar::wrapped;
use crate::square_root::SquareRootInformation;
use crate::tracks::scene::Kind;
use crate::tracks::sensors::{
    Bearing, ConeAngle, Frequency, Range, RangeRate, Reading, Sensor as _, Sight, SignalStrength,
};

/// States at most: of all targets together, and of the sensors.
pub const MOST_STATES: usize = 12;

/// How sharp the smooth stand-ins of corners are: of the smallest eigenvalue, of the
/// worst of several beliefs, of the edges of a field of view. Infinite: the corners
/// themselves.
pub(super) type Sharpness = f64;

/// What the bound of any path needs of a criterion, at one information matrix for each
/// belief: its value there, and its gradient G by the information in physical states.
#[derive(Clone, Debug)]
pub(super) struct Tangent {
    /// Of each belief: the value of the criterion.
    pub values: Vec<f64>,
    /// Of each belief: row-major n x n.
    pub gradients: Vec<Vec<f64>>,
}

/// A criterion of the information for one number of states.
pub(super) trait Objective: Send + Sync + core::fmt::Debug {
    /// The cost, and its derivatives added to `pulls`; infinite where the states are
    /// not determined. What is in `space` does not matter.
    fn cost(
        &self,
        tracks: &[Track],
        sharpness: Sharpness,
        pulls: Option<&mut [Pull]>,
        space: &mut Vec<f64>,
    ) -> f64;
    /// The cost after each sample.
    fn along(&self, tracks: &[Track]) -> Vec<f64>;
    /// The bound on the covariance (xx, xy, yy) of the first two states of the first
    /// belief after each sample; NaN while there is none.
    fn covariances(&self, tracks: &[Track]) -> Vec<[f64; 3]>;
    /// A square root of the information of each belief in physical states, row-major,
    /// prior included.
    fn roots(&self, tracks: &[Track]) -> Vec<Vec<f64>>;
    /// Value and gradient of the criterion at these matrices; `None` where one is singular.
    fn tangent(&self, informations: &[Vec<f64>]) -> Option<Tangent>;
}

/// The objective of a problem; `None` for more states than [`MOST_STATES`].
pub(super) fn objective(problem: &Problem) -> Option<Arc<dyn Objective>> {
    macro_rules! sized {
        ($($n:literal)*) => {
            match problem.states() {
                $($n => Some(Arc::new(Sized::<$n>::new(problem)) as Arc<dyn Objective>),)*
                _ => None,
            }
        };
    }
    sized!(2 3 4 5 6 7 8 9 10 11 12)
}

/// Cost, value, and derivative of the value by the scaled information.
type Judged<const N: usize> = (f64, f64, [[f64; N]; N]);

#[derive(Clone, Debug)]
struct Sized<const N: usize> {
    dt: f64,
    dimension: usize,
    aim: Aim,
    scale: [f64; N],
    sensors: Vec<Vec<Sensor>>,
    beliefs: Vec<Belief<N>>,
    /// First state of the sensors.
    nuisance: usize,
}

#[derive(Clone, Debug)]
struct Belief<const N: usize> {
    targets: Vec<[f64; 4]>,
    weight: f64,
    /// What is known beforehand, on the scaled states.
    prior: SquareRootInformation<f64, N>,
    combination: [f64; N],
}

impl<const N: usize> Sized<N> {
    fn new(problem: &Problem) -> Self {
        let array = |values: &[f64]| -> [f64; N] {
            core::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0))
        };
        let scale = core::array::from_fn(|i| problem.scale.get(i).copied().unwrap_or(1.0));
        Self {
            dt: problem.dt,
            dimension: problem.dimension,
            aim: problem.aim,
            scale,
            sensors: problem
                .observers
                .iter()
                .map(|observer| observer.sensors.clone())
                .collect(),
            beliefs: problem
                .beliefs
                .iter()
                .map(|belief| Belief {
                    targets: belief.targets.clone(),
                    weight: belief.weight,
                    prior: {
                        let mut root = SquareRootInformation::new();
                        for line in belief.prior.chunks_exact(N) {
                            root.absorb(&core::array::from_fn(|i| line[i] * scale[i]));
                        }
                        root
                    },
                    combination: array(&belief.combination),
                })
                .collect(),
            nuisance: problem.dimension * problem.targets(),
        }
    }

    fn criterion(&self, belief: &Belief<N>, sharpness: Sharpness) -> plan::Criterion<f64, N> {
        match self.aim.criterion {
            Criterion::Determinant => plan::Criterion::LogDet,
            Criterion::Trace => plan::Criterion::Trace,
            Criterion::Eigenvalue => plan::Criterion::SmallestEigenvalue { sharpness },
            Criterion::Combination => plan::Criterion::Combination(belief.combination),
        }
    }

    /// Rows of one belief with those that fill up lanes: of all readings of all samples.
    fn length(&self, tracks: &[Track]) -> usize {
        let samples = tracks.first().map_or(0, |track| track.at.len());
        let sensors: usize = self.sensors.iter().map(Vec::len).sum();
        let targets = self.beliefs.first().map_or(0, |b| b.targets.len());
        sensors * targets * samples.next_multiple_of(LANES)
    }

    /// What all samples and the prior tell. `columns` has room for N columns of the
    /// [`length`](Self::length), `inverses` for one: what [`pull`](Self::pull) needs of it.
    fn whole(
        &self,
        belief: &Belief<N>,
        tracks: &[Track],
        sharpness: Sharpness,
        columns: &mut [f64],
        inverses: &mut [f64],
    ) -> SquareRootInformation<f64, N> {
        let length = inverses.len();
        columns.fill(0.0);
        let (mut start, mut count) = (0, 0);
        for (track, sensors) in tracks.iter().zip(&self.sensors) {
            let samples = track.at.len();
            for (target, state) in belief.targets.iter().enumerate() {
                for sensor in sensors {
                    let end = start + samples.next_multiple_of(LANES);
                    if is_plain_bearing(sensor) {
                        let weight = sensor.detection.sqrt() / sensor.sigma;
                        let first = target * self.dimension;
                        let mut of = columns[first * length..].chunks_exact_mut(length);
                        let mut column = |skip| &mut of.nth(skip).unwrap_or_default()[start..end];
                        let [x, y] = [column(0), column(0)];
                        let [u, v] = if self.dimension == 4 {
                            [column(0), column(0)]
                        } else {
                            Default::default()
                        };
                        let known = first + self.dimension;
                        let bias = sensor.bias.map(|state| self.nuisance + state);
                        bearings::rows(
                            Path::Best,
                            Rows {
                                line: self.line(track, state),
                                weight,
                                units: &self.scale[first..known],
                                columns: [x, y, u, v],
                                bias: bias.map_or((&mut [], 0.0), |state| {
                                    (column(state - known), self.scale[state])
                                }),
                                inverses: &mut inverses[start..end],
                            },
                        );
                    } else {
                        for sample in 0..samples {
                            let row =
                                self.whitened(sensor, state, target, track, sample, sharpness);
                            for (j, value) in row.into_iter().flatten().enumerate() {
                                columns[j * length + start + sample] = value;
                            }
                        }
                    }
                    (start, count) = (end, count + samples);
                }
            }
        }
        let mut root = belief.prior;
        root.absorb_columns(Path::Best, columns, count);
        root
    }

    fn line<'a>(&self, track: &'a Track, state: &[f64; 4]) -> Line<'a> {
        Line {
            at: &track.at,
            target: *state,
            dt: self.dt,
        }
    }

    /// Adds what one sample of all observers tells.
    fn absorb(
        &self,
        root: &mut SquareRootInformation<f64, N>,
        belief: &Belief<N>,
        tracks: &[Track],
        sample: usize,
        sharpness: Sharpness,
    ) {
        for (track, sensors) in tracks.iter().zip(&self.sensors) {
            for (target, state) in belief.targets.iter().enumerate() {
                for sensor in sensors {
                    if let Some(row) =
                        self.whitened(sensor, state, target, track, sample, sharpness)
                    {
                        root.absorb(&row);
                    }
                }
            }
        }
    }

    /// The whitened row of a reading, on the scaled states; `None` where nothing is seen.
    #[inline]
    fn whitened(
        &self,
        sensor: &Sensor,
        state: &[f64; 4],
        target: usize,
        track: &Track,
        sample: usize,
        sharpness: Sharpness,
    ) -> Option<[f64; N]> {
        let time = self.dt * sample as f64;
        let (at, velocity, axis) = track.sample(sample);
        let sight = sight_of(state, time, at, velocity, axis);
        let seen = if is_plain_bearing(sensor) {
            Seen::bearing(sight.offset, time, sensor.detection)
        } else {
            Seen::of(sensor, &sight, time, sharpness)
        };
        if seen.weight <= 0.0 {
            return None;
        }
        let root_weight = seen.weight.sqrt() / sensor.sigma;
        let row = self.row(&seen, sensor, target);
        Some(core::array::from_fn(|i| {
            row[i] * self.scale[i] * root_weight
        }))
    }

    /// The row of all states, in physical units and not whitened.
    fn row(&self, seen: &Seen<f64>, sensor: &Sensor, target: usize) -> [f64; N] {
        let mut row = [0.0; N];
        let first = target * self.dimension;
        row[first..first + self.dimension].copy_from_slice(&seen.by_state[..self.dimension]);
        for (parameter, state) in sensor.parameter_states.iter().enumerate() {
            if let Some(state) = state {
                row[self.nuisance + state] += seen.by_parameter[parameter];
            }
        }
        if let Some(state) = sensor.bias {
            row[self.nuisance + state] += 1.0;
        }
        row
    }

    /// Adds the derivatives of one belief; `by` is the derivative of the cost by the
    /// information on the scaled states, `inverses` what [`whole`](Self::whole) left there.
    fn pull(
        &self,
        belief: &Belief<N>,
        by: &[[f64; N]; N],
        tracks: &[Track],
        sharpness: Sharpness,
        inverses: &[f64],
        pulls: &mut [Pull],
    ) {
        let mut start = 0;
        for ((track, sensors), pull) in tracks.iter().zip(&self.sensors).zip(pulls) {
            let samples = track.at.len();
            for (target, state) in belief.targets.iter().enumerate() {
                for sensor in sensors {
                    let end = start + samples.next_multiple_of(LANES);
                    if is_plain_bearing(sensor) {
                        bearings::pull(
                            Path::Best,
                            Pulls {
                                line: self.line(track, state),
                                inverses: &inverses[start..end],
                                weight: 2.0 * sensor.detection / (sensor.sigma * sensor.sigma),
                                by: self.by_bearing(by, sensor, target),
                                out: &mut pull.at,
                            },
                        );
                    } else {
                        let places = matches!(
                            sensor.kind,
                            Kind::Bearing | Kind::Range | Kind::SignalStrength
                        );
                        for sample in 0..samples {
                            let found = if places && sensor.blind.is_empty() {
                                self.by_path::<2>(
                                    sensor, state, target, by, track, sample, sharpness,
                                )
                            } else {
                                self.by_path::<6>(
                                    sensor, state, target, by, track, sample, sharpness,
                                )
                            };
                            pull.add(sample, &found);
                        }
                    }
                    start = end;
                }
            }
        }
    }

    /// What [`Pulls`] needs of the derivative by the information.
    fn by_bearing(&self, by: &[[f64; N]; N], sensor: &Sensor, target: usize) -> ByRow {
        let g = |i: usize, j: usize| by[i][j] * self.scale[i] * self.scale[j];
        let x = target * self.dimension;
        let y = x + 1;
        let mut found = ByRow::default();
        found.place[0] = [g(x, x), g(x, y), g(y, y)];
        let bias = sensor.bias.map(|bias| self.nuisance + bias);
        if let Some(bias) = bias {
            found.bias[0] = [g(x, bias), g(y, bias)];
        }
        if self.dimension == 4 {
            let (u, v) = (x + 2, x + 3);
            found.place[1] = [2.0 * g(x, u), g(x, v) + g(y, u), 2.0 * g(y, v)];
            found.place[2] = [g(u, u), g(u, v), g(v, v)];
            if let Some(bias) = bias {
                found.bias[1] = [g(u, bias), g(v, bias)];
            }
        }
        found
    }

    /// G h for G on the scaled states, back in physical ones.
    #[inline]
    fn through(&self, by: &[[f64; N]; N], row: &[f64; N]) -> [f64; N] {
        let mut out = [0.0; N];
        for i in 0..N {
            let mut sum = 0.0;
            for j in 0..N {
                sum += by[i][j] * row[j] * self.scale[j];
            }
            out[i] = sum * self.scale[i];
        }
        out
    }

    /// The derivatives by the offset of the target, the velocity of the carrier and its
    /// axis.
    #[allow(clippy::too_many_arguments)]
    fn by_path<const K: usize>(
        &self,
        sensor: &Sensor,
        state: &[f64; 4],
        target: usize,
        by: &[[f64; N]; N],
        track: &Track,
        sample: usize,
        sharpness: Sharpness,
    ) -> [f64; 6] {
        let time = self.dt * sample as f64;
        let (at, velocity, axis) = track.sample(sample);
        let variable = |value: f64, k: usize| {
            if k < K {
                Dual::<K>::variable(value, k)
            } else {
                Dual::constant(value)
            }
        };
        let plain = sight_of(state, time, at, velocity, axis);
        let pair = |values: [f64; 2], first: usize| {
            [variable(values[0], first), variable(values[1], first + 1)]
        };
        let sight = Sight {
            offset: pair(plain.offset, 0),
            target: plain.target.map(Dual::constant),
            carrier: pair(plain.carrier, 2),
            axis: pair(plain.axis, 4),
        };
        let seen = Seen::of(sensor, &sight, time, sharpness);
        if seen.weight.value <= 0.0 {
            return [0.0; 6];
        }
        let row = self.row(&seen.values(), sensor, target);
        let through = self.through(by, &row);
        let square: f64 = through.iter().zip(&row).map(|(a, b)| a * b).sum();
        let first = target * self.dimension;
        let mut change = Dual::<K>::constant(0.0);
        for (entry, factor) in seen
            .by_state
            .iter()
            .zip(&through[first..first + self.dimension])
        {
            change = change + entry.times(*factor);
        }
        for (parameter, state) in sensor.parameter_states.iter().enumerate() {
            if let Some(state) = state {
                let factor = through[self.nuisance + state];
                change = change + seen.by_parameter[parameter].times(factor);
            }
        }
        let whitening = 1.0 / (sensor.sigma * sensor.sigma);
        let mut out = [0.0; 6];
        for (k, out) in out.iter_mut().enumerate().take(K) {
            *out =
                whitening * (2.0 * seen.weight.value * change.by[k] + seen.weight.by[k] * square);
        }
        out
    }

    /// Of each belief: the cost, the value, and its derivative by the scaled information.
    fn costs(
        &self,
        tracks: &[Track],
        sharpness: Sharpness,
        columns: &mut [f64],
        inverses: &mut [f64],
    ) -> Option<Vec<Judged<N>>> {
        let mut out = Vec::with_capacity(self.beliefs.len());
        let length = inverses.len() / self.beliefs.len();
        for (belief, inverses) in self.beliefs.iter().zip(inverses.chunks_exact_mut(length)) {
            let root = self.whole(belief, tracks, sharpness, columns, inverses);
            if !root.is_sound() {
                return None;
            }
            let (value, by) = differentiate(&root, &self.scale, &self.criterion(belief, sharpness));
            out.push((self.to_cost(value), value, by));
        }
        Some(out)
    }

    fn to_cost(&self, value: f64) -> f64 {
        let cost = match self.aim.criterion {
            Criterion::Determinant => -value,
            Criterion::Eigenvalue => -value.ln(),
            _ => value.ln(),
        };
        if cost.is_nan() { f64::INFINITY } else { cost }
    }

    /// The cost over all beliefs and its derivatives by the cost of each.
    fn together(&self, costs: &[f64], sharpness: Sharpness) -> (f64, Vec<f64>) {
        let weights: Vec<f64> = self.beliefs.iter().map(|b| b.weight).collect();
        let worst = costs.iter().fold(f64::NEG_INFINITY, |m, &c| m.max(c));
        if !worst.is_finite() {
            return (worst, vec![0.0; costs.len()]);
        }
        match self.aim.over {
            Over::Expectation => match self.aim.criterion {
                Criterion::Determinant => {
                    let sum = costs.iter().zip(&weights).map(|(c, w)| c * w).sum();
                    (sum, weights)
                }
                Criterion::Eigenvalue => soft(costs, &weights, -1.0),
                _ => soft(costs, &weights, 1.0),
            },
            Over::Worst if sharpness.is_finite() && costs.len() > 1 => {
                let even = vec![1.0 / costs.len() as f64; costs.len()];
                soft(costs, &even, sharpness)
            }
            Over::Chance(level) if costs.len() > 1 => quantile(costs, &weights, level, sharpness),
            Over::Worst | Over::Chance(_) => {
                let by = costs
                    .iter()
                    .map(|&c| f64::from(u8::from(c == worst)))
                    .collect();
                (worst, by)
            }
        }
    }
}

/// The cost that is not exceeded with a probability, and its derivatives by the costs. Its
/// smooth stand-in is that of costs with a logistic error of width 1 / sharpness.
fn quantile(costs: &[f64], weights: &[f64], level: f64, sharpness: Sharpness) -> (f64, Vec<f64>) {
    let total: f64 = weights.iter().sum();
    let wanted = level * total;
    let mut order: Vec<usize> = (0..costs.len()).collect();
    order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
    let mut sum = 0.0;
    let mut found = order.last().copied().unwrap_or(0);
    for &index in &order {
        sum += weights[index];
        if sum >= wanted * (1.0 - 1e-12) {
            found = index;
            break;
        }
    }
    if !sharpness.is_finite() {
        let by = (0..costs.len()).map(|i| f64::from(u8::from(i == found)));
        return (costs[found], by.collect());
    }
    let rise = |cost: f64, at: f64| 1.0 / (1.0 + (-sharpness * (at - cost)).exp());
    let mass = |at: f64| -> f64 {
        costs
            .iter()
            .zip(weights)
            .map(|(&c, w)| w * rise(c, at))
            .sum()
    };
    let away = 40.0 / sharpness + (costs[*order.last().unwrap_or(&0)] - costs[order[0]]).abs();
    let (mut low, mut high) = (costs[found] - away, costs[found] + away);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if mass(middle) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    let at = 0.5 * (low + high);
    let slopes: Vec<f64> = costs
        .iter()
        .zip(weights)
        .map(|(&c, w)| w * rise(c, at) * rise(-c, -at))
        .collect();
    let sum: f64 = slopes.iter().sum();
    (
        at,
        slopes.iter().map(|slope| slope / sum.max(1e-300)).collect(),
    )
}

/// (1 / p) log sum w exp(p c), and its derivatives by c.
fn soft(costs: &[f64], weights: &[f64], p: f64) -> (f64, Vec<f64>) {
    let top = costs.iter().fold(f64::NEG_INFINITY, |m, &c| m.max(p * c));
    let terms: Vec<f64> = costs
        .iter()
        .zip(weights)
        .map(|(c, w)| w * (p * c - top).exp())
        .collect();
    let sum: f64 = terms.iter().sum();
    (
        (top + sum.ln()) / p,
        terms.iter().map(|term| term / sum).collect(),
    )
}

impl<const N: usize> Objective for Sized<N> {
    fn cost(
        &self,
        tracks: &[Track],
        sharpness: Sharpness,
        pulls: Option<&mut [Pull]>,
        space: &mut Vec<f64>,
    ) -> f64 {
        let length = self.length(tracks);
        space.resize((N + self.beliefs.len()) * length, 0.0);
        let (columns, inverses) = space.split_at_mut(N * length);
        let Some(found) = self.costs(tracks, sharpness, columns, inverses) else {
            return f64::INFINITY;
        };
        let costs: Vec<f64> = found.iter().map(|(cost, ..)| *cost).collect();
        let (cost, shares) = self.together(&costs, sharpness);
        let Some(pulls) = pulls.filter(|_| cost.is_finite()) else {
            return cost;
        };
        let of = self.beliefs.iter().zip(inverses.chunks_exact(length));
        for (((belief, inverses), (_, value, by)), share) in of.zip(&found).zip(shares) {
            if share == 0.0 {
                continue;
            }
            let mut by = *by;
            let slope = share
                * match self.aim.criterion {
                    Criterion::Determinant => -1.0,
                    Criterion::Eigenvalue => -1.0 / value,
                    _ => 1.0 / value,
                };
            for entry in by.as_flattened_mut() {
                *entry *= slope;
            }
            self.pull(belief, &by, tracks, sharpness, inverses, pulls);
        }
        cost
    }

    fn along(&self, tracks: &[Track]) -> Vec<f64> {
        let samples = tracks.first().map_or(0, |track| track.at.len());
        let mut roots: Vec<_> = self.beliefs.iter().map(|b| b.prior).collect();
        let mut out = Vec::with_capacity(samples);
        for sample in 0..samples {
            let costs: Vec<f64> = self
                .beliefs
                .iter()
                .zip(&mut roots)
                .map(|(belief, root)| {
                    self.absorb(root, belief, tracks, sample, f64::INFINITY);
                    let criterion = self.criterion(belief, f64::INFINITY);
                    self.to_cost(differentiate(root, &self.scale, &criterion).0)
                })
                .collect();
            out.push(self.together(&costs, f64::INFINITY).0);
        }
        out
    }

    fn covariances(&self, tracks: &[Track]) -> Vec<[f64; 3]> {
        let samples = tracks.first().map_or(0, |track| track.at.len());
        let Some(belief) = self.beliefs.first() else {
            return Vec::new();
        };
        let mut root = belief.prior;
        (0..samples)
            .map(|sample| {
                self.absorb(&mut root, belief, tracks, sample, f64::INFINITY);
                root.crlb().map_or([f64::NAN; 3], |bound| {
                    [(0, 0), (0, 1), (1, 1)]
                        .map(|(i, j)| bound[i][j] * self.scale[i] * self.scale[j])
                })
            })
            .collect()
    }

    fn roots(&self, tracks: &[Track]) -> Vec<Vec<f64>> {
        let length = self.length(tracks);
        let mut space = vec![0.0; (N + 1) * length];
        let (columns, inverses) = space.split_at_mut(N * length);
        self.beliefs
            .iter()
            .map(|belief| {
                let root = self.whole(belief, tracks, f64::INFINITY, columns, inverses);
                let lines = root.factor().iter();
                lines
                    .flat_map(|line| (0..N).map(|i| line[i] / self.scale[i]))
                    .collect()
            })
            .collect()
    }

    fn tangent(&self, informations: &[Vec<f64>]) -> Option<Tangent> {
        let mut out = Tangent {
            values: Vec::new(),
            gradients: Vec::new(),
        };
        for (belief, information) in self.beliefs.iter().zip(informations) {
            // A square root of the scaled matrix, row by row.
            let mut scaled = [[0.0; N]; N];
            for i in 0..N {
                for j in 0..N {
                    scaled[i][j] = information[i * N + j] * self.scale[i] * self.scale[j];
                }
            }
            let root = SquareRootInformation::of_factor(
                cholesky(&scaled)?,
                u32::try_from(N).unwrap_or(u32::MAX),
            );
            let criterion = self.criterion(belief, f64::INFINITY);
            let (value, mut by) = differentiate(&root, &self.scale, &criterion);
            if self.aim.criterion == Criterion::Eigenvalue {
                // Any matrix of trace 1 bounds the smallest eigenvalue: that of a smooth
                // stand-in is better where two are close.
                let smooth = plan::Criterion::SmallestEigenvalue { sharpness: 12.0 };
                by = differentiate(&root, &self.scale, &smooth).1;
                let trace: f64 = (0..N).map(|i| by[i][i]).sum();
                for entry in by.as_flattened_mut() {
                    *entry /= trace;
                }
            }
            if !self.to_cost(value).is_finite() {
                return None;
            }
            let mut gradient = vec![0.0; N * N];
            for i in 0..N {
                for j in 0..N {
                    gradient[i * N + j] = by[i][j] * self.scale[i] * self.scale[j];
                }
            }
            out.values.push(value);
            out.gradients.push(gradient);
        }
        Some(out)
    }
}

/// The upper triangle R with R^T R = matrix; `None` where it is not positive definite.
fn cholesky<const N: usize>(matrix: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let mut root = [[0.0; N]; N];
    for i in 0..N {
        let mut rest = matrix[i][i];
        for line in &root[..i] {
            rest -= line[i] * line[i];
        }
        if !(rest > 1e-14 * matrix[i][i]) {
            return None;
        }
        let pivot = rest.sqrt();
        root[i][i] = pivot;
        for j in i + 1..N {
            let mut sum = matrix[i][j];
            for line in &root[..i] {
                sum -= line[i] * line[j];
            }
            root[i][j] = sum / pivot;
        }
    }
    Some(root)
}

fn sight_of(
    state: &[f64; 4],
    time: f64,
    at: [f64; 2],
    velocity: [f64; 2],
    axis: [f64; 2],
) -> Sight<f64, 2> {
    let [x, y, u, v] = *state;
    Sight {
        offset: [x + time * u - at[0], y + time * v - at[1]],
        target: [u, v],
        carrier: velocity,
        axis,
    }
}

/// A reading: its derivatives by the states of its target and by the sensor's own
/// parameters, and how much it counts.
struct Seen<L> {
    by_state: [L; 4],
    by_parameter: [L; 2],
    weight: L,
}

/// Whether a sensor is a bearing that is seen from everywhere, which most are.
#[inline]
fn is_plain_bearing(sensor: &Sensor) -> bool {
    sensor.kind == Kind::Bearing && sensor.blind.is_empty() && !sensor.reach.is_finite()
}

impl Seen<f64> {
    /// A bearing, without its value.
    #[inline]
    fn bearing([x, y]: [f64; 2], time: f64, weight: f64) -> Self {
        let inverse = 1.0 / (x * x + y * y);
        let (a, b) = (y * inverse, -x * inverse);
        Self {
            by_state: [a, b, time * a, time * b],
            by_parameter: [0.0; 2],
            weight,
        }
    }
}

impl<L: Lane> Seen<L> {
    fn of(sensor: &Sensor, sight: &Sight<L, 2>, time: f64, sharpness: Sharpness) -> Self {
        let like = sight.offset[0];
        let parameters = sensor.parameters.map(|value| like.splat(value));
        let reading: Reading<L, 2> = match sensor.kind {
            Kind::Range => Range { factor: 1.0 }.read(sight, &parameters),
            Kind::RangeRate => RangeRate.read(sight, &parameters),
            Kind::Frequency(speed) => Frequency { speed }.read(sight, &parameters),
            Kind::ConeAngle => ConeAngle.read(sight, &parameters),
            Kind::SignalStrength => SignalStrength.read(sight, &parameters),
            _ => Bearing.read(sight, &parameters),
        };
        let [x, y] = reading.by_place;
        let [u, v] = reading.by_velocity;
        Self {
            by_state: [x, y, x.times(time) + u, y.times(time) + v],
            by_parameter: reading.by_parameter,
            weight: weight(sensor, sight, sharpness),
        }
    }
}

impl<const K: usize> Seen<Dual<K>> {
    fn values(&self) -> Seen<f64> {
        Seen {
            by_state: self.by_state.map(|x| x.value),
            by_parameter: self.by_parameter.map(|x| x.value),
            weight: self.weight.value,
        }
    }
}

/// The probability of a reading: what the field of view and the reach leave of it. The
/// smooth stand-in of an edge lies inside it, so that it never counts too much.
fn weight<L: Lane>(sensor: &Sensor, sight: &Sight<L, 2>, sharpness: Sharpness) -> L {
    let [x, y] = sight.offset;
    let like = x;
    let mut weight = like.splat(sensor.detection);
    let smooth = sharpness.is_finite();
    if sensor.reach.is_finite() {
        let range = x.mul_add(x, y * y).sqrt();
        let inside = like.splat(1.0) - range.times(1.0 / sensor.reach);
        weight = weight * edge(inside, 0.02, smooth);
    }
    if !sensor.blind.is_empty() {
        let [sin, cos] = sight.axis;
        let relative = (x * cos - y * sin).atan2(x * sin + y * cos);
        let turn = like.splat(core::f64::consts::TAU);
        for &(from, to) in &sensor.blind {
            let width = (to - from).rem_euclid(core::f64::consts::TAU);
            let middle = wrapped(from + 0.5 * width);
            let off = relative - like.splat(middle);
            let off = off - (off / turn).round() * turn;
            weight = weight * edge(off.abs() - like.splat(0.5 * width), 0.05, smooth);
        }
    }
    weight
}

/// 0 outside an edge, 1 from `width` inside it on; sharp: 1 from the edge on.
fn edge<L: Lane>(inside: L, width: f64, smooth: bool) -> L {
    let (zero, one) = (inside.splat(0.0), inside.splat(1.0));
    if !smooth {
        return zero.select_greater(inside, zero, one);
    }
    let u = inside.times(1.0 / width);
    let rise = u * u * (inside.splat(3.0) - u.times(2.0));
    let upper = u.select_greater(one, one, rise);
    zero.select_greater(u, zero, upper)
}
