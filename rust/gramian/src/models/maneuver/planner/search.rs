//! The search: first guesses of every kind, the best of them refined, the best of those
//! disturbed and refined again, and a polish of what is best in the end.

use alloc::sync::Arc as Shared;
use alloc::vec;
use alloc::vec::Vec;

use super::descend::Program;
use super::objective::{Objective, objective};
use super::paths::{Layout, Pull, Track};
use super::{Criterion, Error, Over, Problem, Violation};
use crate::batch::Stream;
use crate::scalar::{check_finite, check_length};

mod coarse;
mod disturb;
mod draft;
mod guess;
mod refine;

/// How hard is searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// How many of the best different guesses are refined. One refines the best law or arc
    /// (with a number of legs, the best of few); each more brings its share of straight legs
    /// and coarse paths to choose from.
    pub starts: usize,
    /// How often the best paths are disturbed and refined again.
    pub restarts: usize,
    /// Steps of a refinement at most.
    pub iterations: usize,
    /// Of the random guesses and disturbances.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            starts: 24,
            restarts: 32,
            iterations: 400,
            seed: 0,
        }
    }
}

/// A first guess and what became of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Tried {
    /// Where the guess came from.
    pub family: &'static str,
    /// Number of legs it was made of.
    pub legs: usize,
    /// The criterion of the guess; NaN where it was the disturbance of a path.
    pub guess: f64,
    /// Of the path it led to.
    pub value: f64,
    /// The largest part of the projected gradient there.
    pub projected_gradient: f64,
    /// Whether that path keeps all limits.
    pub kept: bool,
    /// Its places (observers, samples).
    pub paths: Vec<Vec<[f64; 2]>>,
}

/// A path that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Steps of each leg.
    pub counts: Vec<usize>,
    /// Headings (observers, legs), clockwise from north.
    pub headings: Vec<Vec<f64>>,
    /// Speeds through the water (observers, legs), m/s.
    pub speeds: Vec<Vec<f64>>,
    /// Places, velocities and axes.
    pub tracks: Vec<Track>,
    /// The criterion.
    pub value: f64,
    /// The largest derivative of the log of the criterion (of log det itself) by a
    /// heading, rad, or a speed as a share of the largest, that the limits do not hold.
    pub projected_gradient: f64,
    /// The least distance from what bounds the path, m.
    pub clearance: f64,
    /// By how much the worst limit is broken, relative; 0 for none.
    pub broken: f64,
    /// The limits that are broken, each kind once, the worst first.
    pub violations: Vec<Violation>,
    /// Where it came from.
    pub family: &'static str,
}

/// How far a search is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Pieces of work that are done.
    pub done: usize,
    /// Of so many.
    pub total: usize,
    /// The best criterion so far; NaN before there is one.
    pub value: f64,
}

#[derive(Clone, Debug)]
struct Candidate {
    family: &'static str,
    legs: usize,
    counts: Vec<usize>,
    x: Vec<f64>,
    guess: f64,
    cost: f64,
    broken: f64,
    projected: f64,
    /// Its place in what was tried.
    tried: usize,
}

impl Candidate {
    /// The cost, and for a broken limit more than any cost gains.
    fn merit(&self) -> f64 {
        if self.cost.is_finite() {
            let penalty = if self.broken > 1e-9 {
                1.0 + 100.0 * self.broken
            } else {
                0.0
            };
            self.cost + penalty
        } else {
            f64::INFINITY
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Guess(usize),
    Coarse(usize),
    Round(usize),
    Refine(usize),
    Finish(usize),
    Disturb(usize),
    Polish,
    Done,
}

/// Looks for the best path of a problem, piece by piece.
#[derive(Debug)]
pub struct Search {
    problem: Problem,
    objective: Shared<dyn Objective>,
    options: Options,
    stage: Stage,
    stream: Stream,
    guesses: Vec<Candidate>,
    guessed: usize,
    /// Rounds of coarse paths, and the best of them.
    rounds: usize,
    coarse: Vec<Candidate>,
    /// What was refined, best first.
    pool: Vec<Candidate>,
    tried: Vec<Tried>,
    /// Whether something has corners, so that smooth stand-ins are wanted.
    corners: bool,
    done: usize,
    total: usize,
    scratch: Scratch,
}

/// What a gradient is worked out in.
#[derive(Debug, Default)]
struct Scratch {
    layout: Layout,
    x: Vec<f64>,
    gradient: Vec<f64>,
    tracks: Vec<Track>,
    pulls: Vec<Pull>,
    space: Vec<f64>,
}

/// Paths whose costs differ by less are alike.
const ALIKE: f64 = 1e-3;

/// Coarse paths tried for each start after the first.
const COARSE: usize = 44;
/// Legs of the coarsest paths.
const COARSEST: usize = 6;
/// Coarse paths for each path round the target.
const ROUND: usize = 10;
/// So many starts compare all guesses of straight legs, fewer their share.
const ALL: usize = 12;

/// Legs of which free paths are made at most.
const MOST_LEGS: usize = 6;

impl Search {
    /// A search that has not begun.
    ///
    /// # Errors
    /// As [`Problem::check`].
    pub fn new(problem: &Problem, options: Options) -> Result<Self, Error> {
        problem.check()?;
        let objective = objective(problem).ok_or(Error::States {
            given: problem.states(),
        })?;
        let seen_partly = problem
            .observers
            .iter()
            .flat_map(|observer| &observer.sensors)
            .any(|sensor| !sensor.blind.is_empty() || sensor.reach.is_finite());
        let corners = problem.aim.criterion == Criterion::Eigenvalue
            || (problem.aim.over != Over::Expectation && problem.beliefs.len() > 1)
            || seen_partly;
        let rounds = if problem.legs.is_none() && problem.moves >= 2 * COARSEST {
            COARSE * options.starts.saturating_sub(1)
        } else {
            0
        };
        Ok(Self {
            rounds,
            coarse: Vec::new(),
            problem: problem.clone(),
            objective,
            options,
            stage: Stage::Guess(0),
            stream: Stream::new(options.seed, 0),
            guesses: Vec::new(),
            guessed: 0,
            pool: Vec::new(),
            tried: Vec::new(),
            corners,
            done: 0,
            total: MOST_LEGS
                + 1
                + rounds
                + rounds / ROUND
                + options.starts
                + 3
                + options.restarts
                + 1,
            scratch: Scratch::default(),
        })
    }

    /// Goes on until it is done or `look` says no; returns whether it is done. `look` is
    /// asked before each evaluation of the criterion.
    pub fn run(&mut self, look: &mut dyn FnMut(Progress) -> bool) -> bool {
        loop {
            if self.stage == Stage::Done {
                return true;
            }
            let progress = Progress {
                done: self.done,
                total: self.total,
                value: self
                    .pool
                    .first()
                    .map_or(f64::NAN, |best| self.value(best.cost)),
            };
            let mut going = true;
            let mut inner = || {
                going = going && look(progress);
                going
            };
            self.advance(&mut inner);
            self.done += 1;
            if !going {
                return false;
            }
        }
    }

    /// The best path so far; `None` where none determines the states.
    pub fn best(&self) -> Option<Found> {
        let best = self.pool.first().or(self.guesses.first())?;
        if !best.cost.is_finite() {
            return None;
        }
        let mut keep = || true;
        let mut program = Program::new(
            &self.problem,
            &*self.objective,
            best.counts.clone(),
            &mut keep,
        );
        Some(self.found(&mut program, best))
    }

    fn found(&self, program: &mut Program<'_>, path: &Candidate) -> Found {
        let tracks = program.tracks(&path.x).to_vec();
        let clearance = program.limits.clearance(&self.problem, &tracks);
        let layout = &program.layout;
        let limits = &program.limits;
        let violations = limits.violations(&self.problem, layout, &path.x, &tracks);
        let observers = 0..self.problem.observers.len();
        Found {
            counts: path.counts.clone(),
            headings: observers
                .clone()
                .map(|o| layout.headings(&path.x, o).to_vec())
                .collect(),
            speeds: observers
                .map(|o| {
                    let most = self.problem.observers[o].speed[1];
                    match layout.shares(&path.x, o) {
                        Some(shares) => shares.iter().map(|share| share * most).collect(),
                        None => vec![most; layout.legs()],
                    }
                })
                .collect(),
            tracks,
            value: self.value(path.cost),
            projected_gradient: path.projected,
            clearance,
            broken: path.broken,
            violations,
            family: path.family,
        }
    }

    /// What any path of this problem is worth: `counts` steps on `headings` (observers,
    /// legs) at `speeds` (observers, legs).
    ///
    /// # Errors
    /// Arrays that do not match.
    pub fn judge(
        &self,
        counts: &[usize],
        headings: &[Vec<f64>],
        speeds: &[Vec<f64>],
    ) -> Result<Found, Error> {
        let mut keep = || true;
        let mut program = self.program(counts, &mut keep)?;
        let x = self.unknowns(&program.layout, headings, speeds)?;
        let (cost, broken) = program.judge(&x, f64::INFINITY);
        let path = Candidate {
            family: "given",
            legs: counts.len(),
            counts: counts.to_vec(),
            guess: cost,
            cost,
            broken,
            projected: f64::NAN,
            tried: 0,
            x,
        };
        Ok(self.found(&mut program, &path))
    }

    /// The cost of a path (minus log det, or minus the log of the eigenvalue, or the log of
    /// the variance); its derivatives are written to `by_heading` and `by_speed`. These, the
    /// headings and the speeds are (observers, legs), row by row. With a finite `sharpness`
    /// corners are smooth. Where the states are not determined the cost is infinite, and the
    /// derivatives are zero.
    ///
    /// # Errors
    /// Arrays that do not match; headings and speeds that are not finite.
    pub fn gradient(
        &mut self,
        counts: &[usize],
        headings: &[f64],
        speeds: &[f64],
        sharpness: f64,
        by_heading: &mut [f64],
        by_speed: &mut [f64],
    ) -> Result<f64, Error> {
        self.check_counts(counts)?;
        let observers = &self.problem.observers;
        let legs = counts.len();
        for (name, given) in [
            ("headings", headings.len()),
            ("speeds", speeds.len()),
            ("by_heading", by_heading.len()),
            ("by_speed", by_speed.len()),
        ] {
            check_length(name, given, observers.len() * legs)?;
        }
        check_finite("headings", headings)?;
        check_finite("speeds", speeds)?;
        let Scratch {
            layout,
            x,
            gradient,
            tracks,
            pulls,
            space,
        } = &mut self.scratch;
        layout.counts.clear();
        layout.counts.extend_from_slice(counts);
        layout.free.resize(observers.len(), true);
        x.clear();
        for (index, observer) in observers.iter().enumerate() {
            let of = index * legs..(index + 1) * legs;
            x.extend_from_slice(&headings[of.clone()]);
            x.extend(speeds[of].iter().map(|speed| speed / observer.speed[1]));
        }
        layout.walk(&self.problem, x, tracks);
        pulls.resize_with(observers.len(), || Pull::new(self.problem.moves));
        for pull in &mut *pulls {
            pull.clear();
        }
        let cost = self.objective.cost(tracks, sharpness, Some(pulls), space);
        gradient.clear();
        gradient.resize(x.len(), 0.0);
        layout.back(&self.problem, x, tracks, pulls, gradient);
        for (index, observer) in observers.iter().enumerate() {
            let of = index * legs..(index + 1) * legs;
            let (headings, speeds) =
                gradient[2 * index * legs..2 * (index + 1) * legs].split_at(legs);
            by_heading[of.clone()].copy_from_slice(headings);
            let inverse = 1.0 / observer.speed[1];
            for (to, by) in by_speed[of].iter_mut().zip(speeds) {
                *to = by * inverse;
            }
        }
        Ok(cost)
    }

    fn check_counts(&self, counts: &[usize]) -> Result<(), Error> {
        let moves = counts
            .iter()
            .fold(0, |sum: usize, &n| sum.saturating_add(n));
        if moves == self.problem.moves {
            return Ok(());
        }
        Err(Error::Count {
            name: "sum of counts",
            given: moves,
            allowed: "the number of moves",
        })
    }

    fn program<'a>(
        &'a self,
        counts: &[usize],
        look: &'a mut dyn FnMut() -> bool,
    ) -> Result<Program<'a>, Error> {
        self.check_counts(counts)?;
        Ok(Program::new(
            &self.problem,
            &*self.objective,
            counts.to_vec(),
            look,
        ))
    }

    fn unknowns(
        &self,
        layout: &Layout,
        headings: &[Vec<f64>],
        speeds: &[Vec<f64>],
    ) -> Result<Vec<f64>, Error> {
        let observers = self.problem.observers.len();
        check_length("headings", headings.len(), observers)?;
        check_length("speeds", speeds.len(), observers)?;
        let mut x = Vec::with_capacity(layout.unknowns());
        for (index, observer) in self.problem.observers.iter().enumerate() {
            for (name, values) in [("headings", &headings[index]), ("speeds", &speeds[index])] {
                check_length(name, values.len(), layout.legs())?;
                check_finite(name, values)?;
            }
            x.extend_from_slice(&headings[index]);
            if layout.free[index] {
                x.extend(speeds[index].iter().map(|speed| speed / observer.speed[1]));
            }
        }
        Ok(x)
    }

    /// What is searched for.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// What was refined, best first.
    pub fn tried(&self) -> &[Tried] {
        &self.tried
    }

    /// How many guesses were compared.
    pub fn guessed(&self) -> usize {
        self.guessed
    }

    /// The criterion after each sample of some paths.
    pub fn along(&self, tracks: &[Track]) -> Vec<f64> {
        let mut out = self.objective.along(tracks);
        for value in &mut out {
            *value = self.value(*value);
        }
        out
    }

    /// A square root of the information of each belief along some paths, prior included:
    /// n rows of n numbers.
    pub fn roots(&self, tracks: &[Track]) -> Vec<Vec<f64>> {
        self.objective.roots(tracks)
    }

    /// The bound on the covariance (xx, xy, yy) of the first target's position after each
    /// sample, by the first belief; NaN while there is none.
    pub fn covariances(&self, tracks: &[Track]) -> Vec<[f64; 3]> {
        self.objective.covariances(tracks)
    }

    fn value(&self, cost: f64) -> f64 {
        match self.problem.aim.criterion {
            Criterion::Determinant => -cost,
            Criterion::Eigenvalue => (-cost).exp(),
            _ => cost.exp(),
        }
    }

    fn advance(&mut self, look: &mut dyn FnMut() -> bool) {
        self.stage = match self.stage {
            Stage::Guess(kind) => {
                self.guess(kind, look);
                let single = self.problem.legs.is_some() || self.options.starts < 2;
                let last = if single { 0 } else { MOST_LEGS };
                if kind < last {
                    Stage::Guess(kind + 1)
                } else {
                    self.choose();
                    Stage::Coarse(0)
                }
            }
            Stage::Coarse(round) if round < self.rounds => {
                self.coarse(round, look);
                Stage::Coarse(round + 1)
            }
            Stage::Coarse(_) => {
                self.spread_coarse();
                Stage::Round(0)
            }
            Stage::Round(number) if number < self.rounds / ROUND => {
                self.round(number, look);
                Stage::Round(number + 1)
            }
            Stage::Round(_) => {
                self.guesses.append(&mut self.coarse);
                Stage::Refine(0)
            }
            Stage::Refine(index) if index < self.guesses.len() => {
                let guess = self.guesses[index].clone();
                let found = self.refine(&guess, false, look);
                self.keep(found);
                Stage::Refine(index + 1)
            }
            // The polish is all that one path needs.
            Stage::Refine(_) if self.pool.len() < 2 && self.options.restarts == 0 => Stage::Polish,
            Stage::Refine(_) => Stage::Finish(0),
            Stage::Finish(index) if index < self.pool.len().min(3) => {
                let mut found = self.refine(&self.pool[index], true, look);
                if self.problem.legs.is_some_and(|legs| legs > 1) {
                    found = self.exchange(found, look);
                }
                self.replace(index, found);
                Stage::Finish(index + 1)
            }
            Stage::Finish(_) => Stage::Disturb(0),
            Stage::Disturb(round) if round < self.options.restarts && !self.pool.is_empty() => {
                self.disturb(round, look);
                Stage::Disturb(round + 1)
            }
            Stage::Disturb(_) => Stage::Polish,
            Stage::Polish => {
                if let Some(best) = self.pool.first().cloned() {
                    let found = self.polish(&best, look);
                    self.replace(0, found);
                }
                Stage::Done
            }
            Stage::Done => Stage::Done,
        };
    }

    /// Remembers a path, and puts it into the pool, best first, unless one as good is there.
    fn keep(&mut self, mut found: Candidate) {
        found.tried = self.tried.len();
        self.tried.push(self.note(&found));
        if !found.cost.is_finite() {
            return;
        }
        let alike = self
            .pool
            .iter()
            .position(|other| (other.merit() - found.merit()).abs() < ALIKE);
        if let Some(index) = alike {
            if found.merit() < self.pool[index].merit() {
                self.pool[index] = found;
            }
        } else {
            self.pool.push(found);
        }
        self.pool.sort_by(|a, b| a.merit().total_cmp(&b.merit()));
        self.pool.truncate(12);
    }

    fn note(&self, found: &Candidate) -> Tried {
        let value = |cost: f64| {
            if cost.is_nan() {
                f64::NAN
            } else {
                self.value(cost)
            }
        };
        Tried {
            family: found.family,
            legs: found.legs,
            guess: value(found.guess),
            value: value(found.cost),
            projected_gradient: found.projected,
            kept: found.broken <= 1e-9,
            paths: {
                let layout = Layout::new(&self.problem, found.counts.clone());
                let mut tracks = Vec::new();
                layout.walk(&self.problem, &found.x, &mut tracks);
                tracks.into_iter().map(|track| track.at).collect()
            },
        }
    }

    fn replace(&mut self, index: usize, found: Candidate) {
        if found.merit() <= self.pool[index].merit() {
            let note = self.note(&found);
            self.tried[found.tried] = note;
            self.pool[index] = found;
            self.pool.sort_by(|a, b| a.merit().total_cmp(&b.merit()));
        }
    }
}
