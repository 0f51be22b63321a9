//! What no path can exceed: an upper bound on the criterion by methods of its own.
//!
//! # Algorithm
//! The bound is the lesser of two: that of [`tuples`](super::tuples), and the following.
//! Each criterion is a concave function of the information, homogeneous up to a power, so
//! that its tangent at any matrix J0 bounds it. With M the largest value over all paths of
//! tr(G J), G the gradient at J0:
//!
//! | criterion | G | bound |
//! |---|---|---|
//! | log det J | J0^-1 | log det J0 + n log(M / n) |
//! | tr J^-1 | J0^-2 | (tr J0^-1)^2 / M, from below |
//! | smallest eigenvalue | any Y >= 0 with tr Y = 1 | M |
//! | c^T J^-1 c | (J0^-1 c)(J0^-1 c)^T | (c^T J0^-1 c)^2 / M, from below |
//!
//! tr(G J) is a sum over the samples of a number that depends on the place of the sample
//! alone, so M is bounded by dynamic programming over time and square cells: the reward of
//! a cell is the largest of its points, a step leads from a cell to every cell with a point
//! within reach, and at step k only cells within reach of the start count. Every path is
//! among those of cells, so M is certified, whatever G.
//!
//! J0 is improved by the method of Frank and Wolfe: it moves toward the information of the
//! best cells, where the gap of the tangent closes. What is left is the gap between a
//! path and a mixture of paths. It is closed by branching: paths are divided by the
//! direction from which they see the target at chosen times, each class has its own J0,
//! and the bound is the largest of the classes.
//!
//! Cells that no path can pass on the way to where it must end, or within its longest length,
//! and cells inside of discs and polygons do not count. Turn rates, legs, separations and
//! least speeds are not looked at: the bound holds for paths without them, and so for those
//! with them.
//!
//! # Source
//! The dual of D-optimal design (Pukelsheim 1993, chapter 7); Frank & Wolfe 1956. The
//! certificate by cells is ours; the proof is in the documentation of the planner.

use alloc::vec;
use alloc::vec::Vec;
use core::f64::consts::{PI, TAU};

use super::limits::signed;
use super::objective::{Objective, objective};
use super::{Criterion, Error, Over, Problem};
use crate::scalar::{hypot, wrapped};
use crate::tracks::scene::Kind;

/// How much work goes into a bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Passes of dynamic programming on coarse cells.
    pub passes: usize,
    /// Work of the last passes on fine cells, in cells.
    pub cells: f64,
}

impl Default for Effort {
    fn default() -> Self {
        Self {
            passes: 40,
            cells: 4e7,
        }
    }
}

/// Where an observer is at one time: in this sector as seen from the first target.
#[derive(Clone, Copy, Debug)]
struct Sector {
    observer: usize,
    step: usize,
    from: f64,
    width: f64,
}

/// Paths in some sectors, and what bounds them.
#[derive(Clone, Debug)]
struct Class {
    sectors: Vec<Sector>,
    /// The information of each belief at which the tangent is taken.
    mixture: Vec<Vec<f64>>,
    /// Utility: log det, or minus the log of a variance.
    bound: f64,
    /// Where the last best cells of each observer are, at each step.
    places: Vec<Vec<[f64; 2]>>,
    /// Places of the best cells before, to see where paths of the mixture differ.
    others: Vec<Vec<Vec<[f64; 2]>>>,
}

/// The bound of a problem on the criterion of any path, or `None` where it does not apply:
/// to other sensors than bearings, unknown biases, blind arcs, and chances.
///
/// `value` is the criterion of a path that is known: passes that cannot come below it are
/// left out. `look` is asked now and then whether to go on; the bound so far holds too.
///
/// # Errors
/// As [`Problem::check`].
pub fn upper_bound(
    problem: &Problem,
    paths: &[super::Track],
    value: f64,
    effort: Effort,
    look: &mut dyn FnMut() -> bool,
) -> Result<Option<f64>, Error> {
    problem.check()?;
    let objective = objective(problem).ok_or(Error::States {
        given: problem.states(),
    })?;
    // The mean of beliefs is no bound on a quantile of them.
    let applies = problem.nuisances == 0
        && !(matches!(problem.aim.over, Over::Chance(_)) && problem.beliefs.len() > 1)
        && problem.observers.iter().all(|observer| {
            observer
                .sensors
                .iter()
                .all(|sensor| sensor.kind == Kind::Bearing && sensor.blind.is_empty())
        });
    if !applies {
        return Ok(None);
    }
    let roots = objective.roots(paths);
    let n = problem.states();
    let mixture: Vec<Vec<f64>> = roots.iter().map(|root| square(root, n)).collect();
    let solver = Solver {
        problem,
        objective: &*objective,
        n,
    };
    let found = utility(problem, value);
    let tuples = super::tuples::most(problem, look);
    let most = solver
        .solve(mixture, found, effort, look)
        .map_or(tuples, |cells| cells.min(tuples));
    if most == f64::INFINITY {
        return Ok(None);
    }
    // Rounding must not put it below what is known to exist.
    let most = most.max(found);
    Ok(Some(match problem.aim.criterion {
        Criterion::Determinant => most,
        Criterion::Eigenvalue => most.exp(),
        _ => (-most).exp(),
    }))
}

/// What is large for a good path.
fn utility(problem: &Problem, value: f64) -> f64 {
    match problem.aim.criterion {
        Criterion::Determinant => value,
        Criterion::Eigenvalue => value.ln(),
        _ => -value.ln(),
    }
}

/// R^T R.
fn square(root: &[f64], n: usize) -> Vec<f64> {
    let mut sum = vec![0.0; n * n];
    for line in root.chunks_exact(n) {
        crate::numbers::algebra::add_square(line, 1.0, &mut sum);
    }
    sum
}

struct Solver<'a> {
    problem: &'a Problem,
    objective: &'a dyn Objective,
    n: usize,
}

/// A tangent, ready to be summed: for each belief and target the 2 x 2 blocks of the
/// gradient, by powers of time.
struct Tangents {
    /// weight G over the beliefs, row-major.
    gradients: Vec<Vec<f64>>,
    /// tr(G P) of the priors.
    constant: f64,
    /// The bound is made of M by this.
    offset: f64,
}

impl Solver<'_> {
    /// The bound by cells on the utility; `None` without one.
    fn solve(
        &self,
        mixture: Vec<Vec<f64>>,
        found: f64,
        effort: Effort,
        look: &mut dyn FnMut() -> bool,
    ) -> Option<f64> {
        let coarse = self.division(0.01 * effort.cells);
        let middle = self.division(0.1 * effort.cells);
        let fine = self.division(effort.cells);
        let mut passes = effort.passes;
        let mut going = true;
        let mut root = Class {
            sectors: Vec::new(),
            mixture,
            bound: f64::INFINITY,
            places: Vec::new(),
            others: Vec::new(),
        };
        self.improve(&mut root, coarse, 12, &mut passes, &mut going, look);
        self.improve(&mut root, middle, 4, &mut passes, &mut going, look);
        if !root.bound.is_finite() {
            return None;
        }
        let mut classes = vec![root];
        while passes > 0 && going {
            let Some(worst) =
                (0..classes.len()).max_by(|&a, &b| classes[a].bound.total_cmp(&classes[b].bound))
            else {
                break;
            };
            if classes[worst].bound <= found + 1e-3 {
                break;
            }
            let class = classes.swap_remove(worst);
            for mut half in self.halves(&class, self.problem.moves) {
                self.improve(&mut half, coarse, 3, &mut passes, &mut going, look);
                self.improve(&mut half, middle, 2, &mut passes, &mut going, look);
                half.bound = half.bound.min(class.bound);
                classes.push(half);
            }
        }
        // The classes that bind once more, on the finest cells: until one of them binds again.
        let mut settled = f64::NEG_INFINITY;
        for _ in 0..4 {
            let Some(worst) =
                (0..classes.len()).max_by(|&a, &b| classes[a].bound.total_cmp(&classes[b].bound))
            else {
                break;
            };
            if !going || classes[worst].bound <= settled.max(found) || fine <= middle {
                break;
            }
            let class = classes.swap_remove(worst);
            let Some(tangents) = self.tangents(&class.mixture) else {
                settled = settled.max(class.bound);
                continue;
            };
            let best = self.pass(&tangents, &class.sectors, fine, None, look);
            going = best.is_some();
            let bound = best.map_or(class.bound, |best| {
                class.bound.min(self.bound(&tangents, best))
            });
            settled = settled.max(bound);
        }
        let bound = classes
            .iter()
            .fold(settled, |m: f64, class| m.max(class.bound));
        Some(bound)
    }

    /// Cells to a step, so that a pass takes about so many cells.
    fn division(&self, cells: f64) -> f64 {
        let moves = self.problem.moves as f64;
        let share = self.problem.observers.len() as f64
            * (6.0 + 6.0 * (self.problem.beliefs.len() * self.problem.targets()) as f64);
        let mut best = 0.125;
        for division in [0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0] {
            let work = 1.3 * moves.powi(3) * division * division * (2.0 * division + share);
            if work <= cells {
                best = division;
            }
        }
        best
    }

    fn tangents(&self, mixture: &[Vec<f64>]) -> Option<Tangents> {
        let found = self.objective.tangent(mixture)?;
        let n = self.n;
        let sign = match self.problem.aim.criterion {
            Criterion::Trace | Criterion::Combination => -1.0,
            _ => 1.0,
        };
        let mut gradients = Vec::new();
        let (mut constant, mut sum) = (0.0, 0.0);
        let total: f64 = self.problem.beliefs.iter().map(|b| b.weight).sum();
        for ((belief, value), gradient) in self
            .problem
            .beliefs
            .iter()
            .zip(&found.values)
            .zip(found.gradients)
        {
            let weight = belief.weight / total;
            let scaled: Vec<f64> = gradient.iter().map(|g| sign * weight * g).collect();
            let prior = square(&belief.prior, n);
            constant += trace_of_product(&scaled, &prior);
            sum += weight * value;
            gradients.push(scaled);
        }
        Some(Tangents {
            gradients,
            constant,
            offset: sum,
        })
    }

    /// The bound on the utility where no path has more than this sum of rewards.
    fn bound(&self, tangents: &Tangents, rewards: f64) -> f64 {
        let most = (rewards + tangents.constant) * (1.0 + 1e-12);
        let n = self.n as f64;
        match self.problem.aim.criterion {
            Criterion::Determinant => tangents.offset + n * (most / n).ln(),
            Criterion::Eigenvalue => most.ln(),
            _ => most.ln() - 2.0 * tangents.offset.ln(),
        }
    }

    /// Moves the tangent of a class toward the information of its best cells.
    fn improve(
        &self,
        class: &mut Class,
        division: f64,
        rounds: usize,
        passes: &mut usize,
        going: &mut bool,
        look: &mut dyn FnMut() -> bool,
    ) {
        for round in 0..rounds {
            if *passes == 0 || !*going {
                return;
            }
            let Some(tangents) = self.tangents(&class.mixture) else {
                return;
            };
            let mut places = Vec::new();
            let best = self.pass(&tangents, &class.sectors, division, Some(&mut places), look);
            *passes -= 1;
            let Some(best) = best else {
                *going = false;
                return;
            };
            if best == f64::NEG_INFINITY {
                // No path is in these sectors.
                class.bound = f64::NEG_INFINITY;
                return;
            }
            class.bound = class.bound.min(self.bound(&tangents, best));
            let new = self.informations(&places);
            if !class.places.is_empty() {
                class.others.push(core::mem::take(&mut class.places));
                if class.others.len() > 3 {
                    class.others.remove(0);
                }
            }
            class.places = places;
            // The best mixture of the two, by golden section on the utility.
            let at = |share: f64| -> f64 {
                let mixed = mix(&class.mixture, &new, share);
                self.tangents(&mixed).map_or(f64::NEG_INFINITY, |t| {
                    match self.problem.aim.criterion {
                        Criterion::Determinant => t.offset,
                        Criterion::Eigenvalue => t.offset.ln(),
                        _ => -t.offset.ln(),
                    }
                })
            };
            let (mut low, mut high) = (0.0, if round == 0 { 0.98 } else { 0.9 });
            for _ in 0..18 {
                let (a, b) = (low + 0.382 * (high - low), low + 0.618 * (high - low));
                if at(a) > at(b) {
                    high = b;
                } else {
                    low = a;
                }
            }
            let share = 0.5 * (low + high);
            if share < 1e-3 {
                return;
            }
            class.mixture = mix(&class.mixture, &new, share);
        }
    }

    /// The information along places.
    fn informations(&self, places: &[Vec<[f64; 2]>]) -> Vec<Vec<f64>> {
        let problem = self.problem;
        let d = problem.dimension;
        let mut out = Vec::new();
        for belief in &problem.beliefs {
            let mut sum = square(&belief.prior, self.n);
            for (observer, places) in problem.observers.iter().zip(places) {
                for (step, place) in places.iter().enumerate() {
                    let time = problem.dt * step as f64;
                    for (target, [x, y, u, v]) in belief.targets.iter().enumerate() {
                        let (x, y) = (x + time * u - place[0], y + time * v - place[1]);
                        let range = hypot(x, y).max(problem.standoff).max(1e-9);
                        let length = hypot(x, y).max(1e-300);
                        let (a, b) = (y / (length * range), -x / (length * range));
                        let mut row = vec![0.0; self.n];
                        let whole = [a, b, time * a, time * b];
                        row[target * d..(target + 1) * d].copy_from_slice(&whole[..d]);
                        for sensor in &observer.sensors {
                            let weight = sensor.detection / (sensor.sigma * sensor.sigma);
                            crate::numbers::algebra::add_square(&row, weight, &mut sum);
                        }
                    }
                }
            }
            out.push(sum);
        }
        out
    }

    /// Two classes that cover one: divided where the best cells of its mixture differ most.
    fn halves(&self, class: &Class, moves: usize) -> Vec<Class> {
        let mut best = (0, moves, 0.0_f64);
        for observer in 0..self.problem.observers.len() {
            for step in [moves, moves * 2 / 3, moves / 3] {
                if step == 0 {
                    continue;
                }
                let angle = |places: &Vec<Vec<[f64; 2]>>| self.seen(places[observer][step], step);
                let here = angle(&class.places);
                let spread = class
                    .others
                    .iter()
                    .filter(|places| !places.is_empty())
                    .map(|places| wrapped(angle(places) - here).abs())
                    .fold(0.0, f64::max);
                if spread > best.2 * 1.2 {
                    best = (observer, step, spread);
                }
            }
        }
        let (observer, step, _) = best;
        let known = class
            .sectors
            .iter()
            .position(|sector| sector.observer == observer && sector.step == step);
        let (from, width) = match known {
            Some(index) => (class.sectors[index].from, class.sectors[index].width),
            // Cut first along the line of sight from the start.
            None => (self.seen(self.problem.observers[observer].start, 0), TAU),
        };
        [0.0, 0.5]
            .iter()
            .map(|share| {
                let sector = Sector {
                    observer,
                    step,
                    from: from + share * width,
                    width: 0.5 * width,
                };
                let mut half = class.clone();
                half.others.clear();
                match known {
                    Some(index) => half.sectors[index] = sector,
                    None => half.sectors.push(sector),
                }
                half
            })
            .collect()
    }

    /// The direction of a place from the first target.
    fn seen(&self, place: [f64; 2], step: usize) -> f64 {
        let [x, y, u, v] = self.problem.beliefs[0].targets[0];
        let time = self.problem.dt * step as f64;
        (place[0] - x - time * u).atan2(place[1] - y - time * v)
    }

    /// The largest sum of rewards over all paths of cells; `None` where `look` said no.
    fn pass(
        &self,
        tangents: &Tangents,
        sectors: &[Sector],
        division: f64,
        mut places: Option<&mut Vec<Vec<[f64; 2]>>>,
        look: &mut dyn FnMut() -> bool,
    ) -> Option<f64> {
        let mut sum = 0.0;
        for observer in 0..self.problem.observers.len() {
            let trace = places.is_some();
            let (best, path) = self.walk(tangents, sectors, observer, division, trace, look)?;
            sum += best;
            if let Some(places) = places.as_deref_mut() {
                places.push(path);
            }
        }
        Some(sum)
    }

    #[allow(clippy::too_many_lines)]
    fn walk(
        &self,
        tangents: &Tangents,
        sectors: &[Sector],
        observer: usize,
        division: f64,
        trace: bool,
        look: &mut dyn FnMut() -> bool,
    ) -> Option<(f64, Vec<[f64; 2]>)> {
        let problem = self.problem;
        let who = &problem.observers[observer];
        let step = who.speed[1] * problem.dt;
        let side = step / division;
        let radius = side * core::f64::consts::FRAC_1_SQRT_2;
        // Offsets (rows, half width) of cells with a point within a step.
        let reach = division * (1.0 + 1e-12);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let far = (reach.floor() as usize) + 1;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let widths: Vec<usize> = (0..=far)
            .map(|row| {
                let away = row.saturating_sub(1) as f64;
                ((reach * reach - away * away).max(0.0).sqrt().floor() as usize) + 1
            })
            .collect();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let extent =
            |k: usize| -> usize { ((k as f64 * division).ceil() as usize) + usize::from(k > 0) };
        let mut levels: Vec<Vec<f64>> = Vec::new();
        let first = self.rewards(
            tangents,
            observer,
            0,
            [who.start].iter().copied(),
            0.0,
            sectors,
        );
        let mut level = first;
        if trace {
            levels.push(level.clone());
        }
        let mut padded: Vec<Vec<f64>> = Vec::new();
        for k in 1..=problem.moves {
            if !look() {
                return None;
            }
            let (old, new) = (extent(k - 1), extent(k));
            let (old_side, new_side) = (2 * old + 1, 2 * new + 1);
            let mut next = vec![f64::NEG_INFINITY; new_side * new_side];
            let pad = far + new - old;
            for row in 0..old_side {
                let source = &level[row * old_side..(row + 1) * old_side];
                // Maxima over windows of 1, 2, 4 .. cells.
                let length = old_side + 2 * pad;
                padded.resize(1, Vec::new());
                padded[0].clear();
                padded[0].resize(length, f64::NEG_INFINITY);
                padded[0][pad..pad + old_side].copy_from_slice(source);
                let mut window = 1;
                while 2 * window <= 2 * widths[0] + 1 {
                    let last = padded.last().cloned().unwrap_or_default();
                    let mut wider = last.clone();
                    for (w, l) in wider.iter_mut().zip(&last[window.min(last.len())..]) {
                        *w = w.max(*l);
                    }
                    padded.push(wider);
                    window *= 2;
                }
                for (away, &half) in widths.iter().enumerate() {
                    let whole = 2 * half + 1;
                    let power = usize::BITS as usize - 1 - whole.leading_zeros() as usize;
                    let maxima = &padded[power];
                    let shift = whole - (1 << power);
                    // Cell i of the new row sees cells i - half .. i + half.
                    let begin = far - half;
                    let (a, b) = (&maxima[begin..], &maxima[begin + shift..]);
                    let at = row + new - old;
                    for (up, target) in [(true, at.checked_sub(away)), (false, Some(at + away))] {
                        let Some(target) = target.filter(|&t| t < new_side) else {
                            continue;
                        };
                        if away == 0 && up {
                            continue;
                        }
                        let out = &mut next[target * new_side..(target + 1) * new_side];
                        for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
                            *out = out.max(a.max(*b));
                        }
                    }
                }
            }
            let bound = k as f64 * step * (1.0 + 1e-12) + radius;
            let drift = problem.dt * k as f64;
            let origin = [
                who.start[0] + drift * problem.current[0],
                who.start[1] + drift * problem.current[1],
            ];
            let mut places = Vec::with_capacity(new_side);
            for row in 0..new_side {
                places.clear();
                let y = side * (row as f64 - new as f64);
                let line = &mut next[row * new_side..(row + 1) * new_side];
                places.extend((0..new_side).map(|column| {
                    let x = side * (column as f64 - new as f64);
                    [x + origin[0], y + origin[1]]
                }));
                // Only cells within reach of the start, a run of columns, count.
                let left = bound * bound - y * y;
                let half = if left < 0.0 { -1.0 } else { left.sqrt() / side };
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                let half = if half < 0.0 {
                    line.fill(f64::NEG_INFINITY);
                    continue;
                } else {
                    half.floor() as usize
                };
                let (from, to) = (new.saturating_sub(half), (new + half + 1).min(new_side));
                line[..from].fill(f64::NEG_INFINITY);
                line[to..].fill(f64::NEG_INFINITY);
                let gains = self.rewards(
                    tangents,
                    observer,
                    k,
                    places[from..to].iter().copied(),
                    radius,
                    sectors,
                );
                for (entry, gain) in line[from..to].iter_mut().zip(gains) {
                    *entry += gain;
                }
            }
            level = next;
            if trace {
                levels.push(level.clone());
            }
        }
        let best = level.iter().fold(f64::NEG_INFINITY, |m: f64, &v| m.max(v));
        if !trace || best == f64::NEG_INFINITY {
            return Some((best, Vec::new()));
        }
        // Back along the best cells.
        let index = level.iter().position(|&v| v == best)?;
        let last = extent(problem.moves);
        let width = 2 * last + 1;
        let (mut row, mut column) = (index / width, index % width);
        let mut path = vec![who.start; problem.moves + 1];
        for k in (1..=problem.moves).rev() {
            let (old, new) = (extent(k - 1), extent(k));
            let drift = problem.dt * k as f64;
            path[k] = [
                who.start[0] + drift * problem.current[0] + side * (column as f64 - new as f64),
                who.start[1] + drift * problem.current[1] + side * (row as f64 - new as f64),
            ];
            let old_side = 2 * old + 1;
            let mut found = (f64::NEG_INFINITY, old, old);
            for (away, &half) in widths.iter().enumerate() {
                for r in [
                    (row + old).checked_sub(new + away),
                    (row + old + away).checked_sub(new),
                ] {
                    let Some(r) = r.filter(|&r| r < old_side) else {
                        continue;
                    };
                    // Column c of the level before lies at c + new - old here.
                    let low = (column + old).saturating_sub(new + half);
                    let high = (column + old + half + 1).saturating_sub(new).min(old_side);
                    for c in low..high {
                        let value = levels[k - 1][r * old_side + c];
                        if value > found.0 {
                            found = (value, r, c);
                        }
                    }
                }
            }
            (row, column) = (found.1, found.2);
        }
        Some((best, path))
    }

    /// Whether no point of a cell at a step can be passed on the way to the place to be at
    /// in the end, or on a path of the longest length.
    fn out_of_reach(&self, observer: usize, step: usize, center: [f64; 2], radius: f64) -> bool {
        let problem = self.problem;
        let who = &problem.observers[observer];
        // Distances through the water.
        let away = |place: [f64; 2], steps: f64| {
            let drift = problem.dt * steps;
            hypot(
                center[0] - place[0] - drift * problem.current[0],
                center[1] - place[1] - drift * problem.current[1],
            )
        };
        let left = (problem.moves - step) as f64;
        let out = away(who.start, step as f64);
        let home = who
            .home
            .map_or(0.0, |(place, within)| away(place, -left) - within);
        let slack = 1e-9 * (out + home.abs());
        home > left * who.speed[1] * problem.dt + radius + slack
            || out + home.max(0.0) > who.distance + 2.0 * radius + slack
    }

    /// The largest reward of a sample in cells of this radius about some centres; minus
    /// infinity where no path may be.
    fn rewards(
        &self,
        tangents: &Tangents,
        observer: usize,
        step: usize,
        centers: impl Iterator<Item = [f64; 2]>,
        radius: f64,
        sectors: &[Sector],
    ) -> Vec<f64> {
        let problem = self.problem;
        let (n, d) = (self.n, problem.dimension);
        let time = problem.dt * step as f64;
        // (target, 2 x 2 form, its largest eigenvalue) of each belief and target.
        let mut forms = Vec::new();
        for (belief, gradient) in problem.beliefs.iter().zip(&tangents.gradients) {
            for (target, [x, y, u, v]) in belief.targets.iter().enumerate() {
                let first = target * d;
                let entry = |i: usize, j: usize| gradient[(first + i) * n + first + j];
                let form = |i: usize, j: usize| {
                    let mut sum = entry(i, j);
                    if d == 4 {
                        sum += time * (entry(i + 2, j) + entry(i, j + 2))
                            + time * time * entry(i + 2, j + 2);
                    }
                    sum
                };
                let (a, b, c) = (form(0, 0), 0.5 * (form(0, 1) + form(1, 0)), form(1, 1));
                let top = 0.5 * (a + c) + hypot(0.5 * (a - c), b);
                forms.push(([x + time * u, y + time * v], [a, b, c], top.max(0.0).sqrt()));
            }
        }
        let sensors: Vec<(f64, f64)> = problem.observers[observer]
            .sensors
            .iter()
            .map(|sensor| {
                (
                    sensor.detection / (sensor.sigma * sensor.sigma),
                    sensor.reach,
                )
            })
            .collect();
        let mine: Vec<&Sector> = sectors
            .iter()
            .filter(|sector| sector.observer == observer && sector.step == step)
            .collect();
        let standoff = if step > 0 { problem.standoff } else { 0.0 };
        centers
            .map(|center| {
                for sector in &mine {
                    let [x, y, u, v] = problem.beliefs[0].targets[0];
                    let away = [center[0] - x - time * u, center[1] - y - time * v];
                    let range = hypot(away[0], away[1]);
                    let slack = if radius < range {
                        (radius / range).asin()
                    } else {
                        PI
                    };
                    let off = wrapped(away[0].atan2(away[1]) - sector.from - 0.5 * sector.width);
                    if off.abs() > 0.5 * sector.width + slack + 1e-9 {
                        return f64::NEG_INFINITY;
                    }
                }
                if self.out_of_reach(observer, step, center, radius) {
                    return f64::NEG_INFINITY;
                }
                if step > 0 {
                    for polygon in &problem.polygons {
                        if signed(polygon, center).0 < -radius {
                            return f64::NEG_INFINITY;
                        }
                    }
                    for &[x, y, disc] in &problem.discs {
                        if hypot(x - center[0], y - center[1]) + radius < disc {
                            return f64::NEG_INFINITY;
                        }
                    }
                }
                let mut sum = 0.0;
                for (target, [a, b, c], top) in &forms {
                    let (x, y) = (target[0] - center[0], target[1] - center[1]);
                    let square = x * x + y * y;
                    let range = square.sqrt();
                    if range + radius < standoff {
                        return f64::NEG_INFINITY;
                    }
                    let near = (range - radius).max(standoff);
                    // (b^T Q b)^(1/2), and by how much it changes where the direction
                    // differs by the angle that the cell is seen under.
                    let across = if square > 0.0 {
                        ((a * y * y - 2.0 * b * x * y + c * x * x) / square)
                            .max(0.0)
                            .sqrt()
                    } else {
                        *top
                    };
                    let turn = if radius < range {
                        radius / (square - radius * radius).sqrt()
                    } else {
                        PI
                    };
                    let turn = if radius > 0.0 { turn } else { 0.0 };
                    let most = (across + top * turn).min(*top) / near.max(1e-300);
                    for (weight, limit) in &sensors {
                        if near <= *limit {
                            sum += weight * most * most;
                        }
                    }
                }
                sum
            })
            .collect()
    }
}

fn mix(a: &[Vec<f64>], b: &[Vec<f64>], share: f64) -> Vec<Vec<f64>> {
    a.iter()
        .zip(b)
        .map(|(a, b)| {
            a.iter()
                .zip(b)
                .map(|(a, b)| (1.0 - share) * a + share * b)
                .collect()
        })
        .collect()
}

fn trace_of_product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
