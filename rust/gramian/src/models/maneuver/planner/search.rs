//! The search: first guesses of every kind, the best of them refined, the best of those
//! disturbed and refined again, and a polish of what is best in the end.

use alloc::sync::Arc as Shared;
use alloc::vec;
use alloc::vec::Vec;
use core::f64::consts::{PI, TAU};

use super::descend::{Effort, Program};
use super::objective::{Objective, objective};
use super::paths::{Layout, Track};
use super::{Criterion, Error, Over, Problem, Violation};
use crate::batch::Stream;
use crate::maneuver::batch::plan::by_law;
use crate::maneuver::steer::{Arc, Limits, Place, follow};
use crate::maneuver::{Law, Side};
use crate::scalar::{check_finite, check_length, hypot, wrapped};

/// How hard is searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// How many of the best different guesses are refined.
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
}

/// Paths whose costs differ by less are alike.
const ALIKE: f64 = 1e-3;

/// Coarse paths tried for each start that is refined.
const COARSE: usize = 40;
/// Legs of the coarsest paths.
const COARSEST: usize = 6;
/// Coarse paths for each path round the target.
const ROUND: usize = 10;
/// Changes that are tried on a path round the target.
const CHANGES: usize = 300;
/// Coarse paths that are refined, for each start.
const SPREAD: usize = 2;

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
            COARSE * options.starts
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
    /// the variance) and its derivatives by headings and speeds. With a finite `sharpness`
    /// corners are smooth.
    ///
    /// # Errors
    /// Arrays that do not match.
    #[allow(clippy::type_complexity)]
    pub fn gradient(
        &self,
        counts: &[usize],
        headings: &[Vec<f64>],
        speeds: &[Vec<f64>],
        sharpness: f64,
    ) -> Result<(f64, Vec<Vec<f64>>, Vec<Vec<f64>>), Error> {
        let mut keep = || true;
        let mut program = self.program(counts, &mut keep)?;
        program.layout.free.fill(true);
        let x = self.unknowns(&program.layout, headings, speeds)?;
        let mut gradient = vec![0.0; x.len()];
        let cost = program.cost(&x, sharpness, &mut gradient);
        let mut by_heading = Vec::new();
        let mut by_speed = Vec::new();
        for (index, observer) in self.problem.observers.iter().enumerate() {
            by_heading.push(program.layout.headings(&gradient, index).to_vec());
            let shares = program.layout.shares(&gradient, index).unwrap_or(&[]);
            by_speed.push(shares.iter().map(|g| g / observer.speed[1]).collect());
        }
        Ok((cost, by_heading, by_speed))
    }

    fn program<'a>(
        &'a self,
        counts: &[usize],
        look: &'a mut dyn FnMut() -> bool,
    ) -> Result<Program<'a>, Error> {
        let moves = counts.iter().sum::<usize>();
        if moves != self.problem.moves {
            return Err(Error::Count {
                name: "sum of counts",
                given: moves,
                allowed: "the number of moves",
            });
        }
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
                let last = self.problem.legs.map_or(MOST_LEGS, |_| 0);
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

    // --- guesses -------------------------------------------------------------------

    /// Family `kind`: 0 laws and arcs (or all of a given number of legs), then paths of
    /// `kind` legs.
    fn guess(&mut self, kind: usize, look: &mut dyn FnMut() -> bool) {
        if let Some(legs) = self.problem.legs {
            self.guess_legs(legs, look);
        } else if kind == 0 {
            self.guess_laws(look);
        } else if kind <= self.problem.moves {
            self.guess_legs(kind, look);
        }
        let key = |guess: &Candidate| guess.merit();
        self.guesses.sort_by(|a, b| key(a).total_cmp(&key(b)));
        self.guesses.truncate(400);
    }

    fn aim_bearing(&self, from: [f64; 2]) -> f64 {
        let aim = self.problem.aim_at();
        (aim[0] - from[0]).atan2(aim[1] - from[1])
    }

    fn offer(&mut self, program: &mut Program<'_>, family: &'static str, legs: usize, x: Vec<f64>) {
        let (cost, broken) = program.judge(&x, f64::INFINITY);
        self.guessed += 1;
        if cost.is_finite() {
            self.guesses.push(Candidate {
                family,
                legs,
                counts: program.layout.counts.clone(),
                x,
                guess: cost,
                cost,
                broken,
                projected: f64::INFINITY,
                tried: 0,
            });
        }
    }

    /// Paths of `legs` straight legs; with free headings they are turned aside from what
    /// they must not enter.
    fn guess_legs(&mut self, legs: usize, look: &mut dyn FnMut() -> bool) {
        let problem = self.problem.clone();
        let objective = Shared::clone(&self.objective);
        let observers = problem.observers.len();
        let bearings: Vec<f64> = problem
            .observers
            .iter()
            .map(|observer| self.aim_bearing(observer.start))
            .collect();
        let grid: usize = match legs {
            1 => 36,
            2 => 24,
            3 => 12,
            _ => 0,
        };
        // Long paths are guessed more sparsely.
        let sparse = 1 + (problem.moves * problem.beliefs.len()) as u64 / 200;
        let splits = splits(problem.moves, legs, &mut self.stream);
        let each = if grid > 0 && observers == 1 {
            core::iter::repeat_n(grid, legs).product()
        } else {
            2400 / splits.len().max(1)
        };
        for counts in splits {
            let given = if problem.legs.is_some() {
                counts.clone()
            } else {
                vec![1; problem.moves]
            };
            let mut program = Program::new(&problem, &*objective, given, look);
            for number in 0..each {
                if program.stopped {
                    break;
                }
                if (number as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40 & 0xFFFF
                    >= 0x10000 / sparse
                {
                    continue;
                }
                let mut wanted = Vec::with_capacity(observers);
                for bearing in &bearings {
                    let mut rest = number;
                    let headings: Vec<f64> = (0..legs)
                        .map(|_| {
                            if grid > 0 && observers == 1 {
                                let index = rest % grid;
                                rest /= grid;
                                bearing + TAU * (index as f64 + 0.37) / grid as f64
                            } else {
                                TAU * self.stream.uniform()
                            }
                        })
                        .collect();
                    wanted.push(headings);
                }
                let x = if problem.legs.is_some() {
                    packed(&program.layout, &wanted)
                } else {
                    let spread: Vec<Vec<f64>> = wanted
                        .iter()
                        .map(|headings| spread(headings, &counts))
                        .collect();
                    steered(&problem, &program.layout, |observer, place| {
                        spread[observer][place.step]
                    })
                };
                self.offer(&mut program, "straight legs", legs, x);
            }
        }
    }

    /// Laws to either side, and straight on then round the target.
    fn guess_laws(&mut self, look: &mut dyn FnMut() -> bool) {
        let problem = self.problem.clone();
        let objective = Shared::clone(&self.objective);
        let aim = problem.aim_at();
        let moves = problem.moves;
        let mut program = Program::new(&problem, &*objective, vec![1; moves], look);
        let pick = |index: usize, observer: usize| {
            // Observers go to either side in turn, or all to one.
            let flip = index % 2 == 1;
            if (observer % 2 == 1) == flip {
                Side::Right
            } else {
                Side::Left
            }
        };
        for law in [
            Law::MaxDet,
            Law::HammelLiu,
            Law::BearingRate,
            Law::Circle,
            Law::Perpendicular,
        ] {
            for index in 0..4 {
                let x = steered(&problem, &program.layout, |observer, place| {
                    let side = pick(index + if index > 1 { observer } else { 0 }, observer);
                    let point = crate::bearings::moved(&aim, place.time);
                    let range = hypot(point[0] - place.at[0], point[1] - place.at[1]);
                    let bearing = crate::bearings::sight(place.at, point);
                    let length = problem.observers[observer].speed[1] * problem.dt;
                    by_law(law, side, bearing, range, length)
                });
                self.offer(&mut program, "law", 0, x);
            }
        }
        for share in [1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.35, 0.2] {
            for offset in 0..13 {
                let offset = PI * (0.02 + 0.08 * f64::from(offset)).powf(1.5);
                for index in 0..4 {
                    let mut arcs: Vec<_> = (0..problem.observers.len())
                        .map(|observer| {
                            let side = pick(index + if index > 1 { observer } else { 0 }, observer);
                            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                            let turn_back = (share * moves as f64).round() as usize;
                            Arc {
                                offset,
                                side: side.sign::<f64>(),
                                turn_back,
                            }
                            .wanted(aim)
                        })
                        .collect();
                    let x = steered(&problem, &program.layout, |observer, place| {
                        arcs[observer](place)
                    });
                    self.offer(&mut program, "straight, then round", 0, x);
                    if problem.observers.len() == 1 && index == 1 {
                        break;
                    }
                }
            }
        }
    }

    /// Leaves the best guesses that differ: mirror images do not.
    fn choose(&mut self) {
        let mut chosen: Vec<Candidate> = Vec::new();
        for guess in core::mem::take(&mut self.guesses) {
            let alike = |other: &Candidate| {
                (other.cost - guess.cost).abs() < 1e-4 * (1.0 + guess.cost.abs())
            };
            let same = chosen
                .iter()
                .filter(|other| other.family == guess.family && other.legs == guess.legs)
                .count();
            let most = if self.problem.legs.is_some() {
                self.options.starts
            } else {
                4
            };
            if same < most && !chosen.iter().any(alike) {
                chosen.push(guess);
            }
            if chosen.len() == self.options.starts {
                break;
            }
        }
        self.guesses = chosen;
    }

    // --- coarse paths --------------------------------------------------------------

    /// Goes downhill from a random path of few equal legs: where a path has few unknowns
    /// so many can be tried that the best of the basins is among them.
    fn coarse(&mut self, round: usize, look: &mut dyn FnMut() -> bool) {
        let mut stream = Stream::new(self.options.seed ^ 0x5EED, 1 + round as u64);
        let moves = self.problem.moves;
        let legs = [6, 8, 10, 12, 15][round % 5].min(moves);
        let counts = whole_counts(&vec![1.0; legs], moves);
        let mut relaxed = self.problem.clone();
        for observer in &mut relaxed.observers {
            observer.max_turn = f64::INFINITY;
        }
        let headings: Vec<Vec<f64>> = relaxed
            .observers
            .iter()
            .map(|observer| {
                let ahead = self.aim_bearing(observer.start);
                let parts = 1 + index(&mut stream, legs.min(6));
                let mut ends: Vec<usize> = (1..parts).map(|_| index(&mut stream, legs)).collect();
                ends.sort_unstable();
                let mut heading = 0.0;
                let mut part = usize::MAX;
                (0..legs)
                    .map(|leg| {
                        let now = ends.iter().filter(|&&end| end <= leg).count();
                        if now != part {
                            part = now;
                            heading = if stream.uniform() < 0.5 {
                                TAU * stream.uniform()
                            } else {
                                ahead + 1.2 * stream.normal()
                            };
                        }
                        heading
                    })
                    .collect()
            })
            .collect();
        let mut program = Program::new(&relaxed, &*self.objective, counts.clone(), look);
        let mut x = packed(&program.layout, &headings);
        let ladder: &[f64] = if self.corners { &[8.0, 64.0] } else { &[512.0] };
        for &sharpness in ladder {
            x = program
                .descend(
                    &x,
                    Effort {
                        rounds: 4,
                        steps: 40,
                        sharpness,
                        tolerance: 1e-3,
                        warm: false,
                    },
                )
                .x;
        }
        let (cost, broken) = program.judge(&x, f64::INFINITY);
        self.guessed += 1;
        if !cost.is_finite() {
            return;
        }
        let found = Candidate {
            family: "coarse",
            legs,
            counts,
            x,
            guess: cost,
            cost,
            broken,
            projected: f64::INFINITY,
            tried: 0,
        };
        self.keep_coarse(found);
    }

    fn keep_coarse(&mut self, found: Candidate) {
        let alike = self
            .coarse
            .iter()
            .position(|other| (other.merit() - found.merit()).abs() < ALIKE);
        match alike {
            Some(index) if found.merit() < self.coarse[index].merit() => self.coarse[index] = found,
            Some(_) => return,
            None => self.coarse.push(found),
        }
        self.coarse.sort_by(|a, b| a.merit().total_cmp(&b.merit()));
        self.coarse.truncate(SPREAD * self.options.starts);
    }

    /// A path straight in, then round the target at the stand-off range, with the changes
    /// of side that make it best: the side is a choice for each step that no descent makes.
    fn round(&mut self, number: usize, look: &mut dyn FnMut() -> bool) {
        let mut stream = Stream::new(self.options.seed ^ 0x51DE, 1 + number as u64);
        let moves = self.problem.moves;
        let observers = self.problem.observers.len();
        let problem = self.problem.clone();
        let objective = Shared::clone(&self.objective);
        let mut program = Program::new(&problem, &*objective, vec![1; moves], look);
        let mut best: Vec<Round> = (0..observers)
            .map(|_| {
                let mut round = Round {
                    offset: 0.4 * stream.normal(),
                    sides: vec![stream.uniform() < 0.5; moves],
                };
                for _ in 0..index(&mut stream, 6) {
                    let from = index(&mut stream, moves);
                    round.flip(from, moves);
                }
                round
            })
            .collect();
        let aim = problem.aim_at();
        let mut judge = |rounds: &[Round]| {
            let mut arrived = vec![false; observers];
            let starts: Vec<f64> = problem
                .observers
                .iter()
                .map(|observer| crate::bearings::sight(observer.start, [aim[0], aim[1]]))
                .collect();
            let x = steered(&problem, &program.layout, |observer, place| {
                arrived[observer] |= place.deflected;
                if arrived[observer] {
                    let side = if rounds[observer].sides[place.step] {
                        1e-3
                    } else {
                        -1e-3
                    };
                    // A circle stands where its target is at the end of the step.
                    let point = crate::bearings::moved(&aim, place.ends);
                    crate::bearings::sight(place.at, point) + side
                } else {
                    starts[observer] + rounds[observer].offset
                }
            });
            let (cost, broken) = program.judge(&x, f64::INFINITY);
            (
                cost + if broken > 1e-9 {
                    1.0 + 100.0 * broken
                } else {
                    0.0
                },
                cost,
                broken,
                x,
            )
        };
        let mut now = judge(&best);
        self.guessed += CHANGES;
        for _ in 0..CHANGES {
            let mut changed = best.clone();
            let one = index(&mut stream, observers);
            changed[one].change(&mut stream);
            let new = judge(&changed);
            if new.0 < now.0 {
                (best, now) = (changed, new);
            }
        }
        let (_, cost, broken, x) = now;
        if cost.is_finite() {
            self.keep_coarse(Candidate {
                family: "straight, then round",
                legs: 0,
                counts: vec![1; moves],
                x,
                guess: cost,
                cost,
                broken,
                projected: f64::INFINITY,
                tried: 0,
            });
        }
    }

    /// Hands the best coarse paths on, with a heading for every step.
    fn spread_coarse(&mut self) {
        for mut path in core::mem::take(&mut self.coarse) {
            let layout = Layout::new(&self.problem, path.counts.clone());
            let fine = Layout::new(&self.problem, vec![1; self.problem.moves]);
            let wanted: Vec<Vec<f64>> = (0..self.problem.observers.len())
                .map(|o| spread(layout.headings(&path.x, o), &path.counts))
                .collect();
            let turns = self
                .problem
                .observers
                .iter()
                .any(|o| o.max_turn.is_finite());
            let mut x = if turns {
                steered(&self.problem, &fine, |o, place| wanted[o][place.step])
            } else {
                packed(&fine, &wanted)
            };
            for o in 0..wanted.len() {
                if let Some(shares) = layout.shares(&path.x, o) {
                    let first = fine.first(o) + fine.legs();
                    x[first..first + fine.legs()].copy_from_slice(&spread(shares, &path.counts));
                }
            }
            path.x = x;
            path.counts = fine.counts;
            path.cost = f64::INFINITY;
            self.guesses.push(path);
        }
    }

    // --- refinement ----------------------------------------------------------------

    fn effort(&self, whole: bool) -> Effort {
        Effort {
            rounds: if whole { 14 } else { 5 },
            steps: if whole && self.corners {
                self.options.iterations.min(150)
            } else if whole {
                self.options.iterations
            } else {
                self.options.iterations.min(60)
            },
            sharpness: 512.0,
            tolerance: if whole { 1e-6 } else { 1e-4 },
            warm: false,
        }
    }

    fn refine(
        &self,
        candidate: &Candidate,
        whole: bool,
        look: &mut dyn FnMut() -> bool,
    ) -> Candidate {
        self.descended(candidate, self.effort(whole), whole, look)
    }

    fn descended(
        &self,
        candidate: &Candidate,
        effort: Effort,
        sharp: bool,
        look: &mut dyn FnMut() -> bool,
    ) -> Candidate {
        let mut program = Program::new(
            &self.problem,
            &*self.objective,
            candidate.counts.clone(),
            look,
        );
        let ladder: &[f64] = if !self.corners {
            &[512.0]
        } else if sharp {
            &[8.0, 32.0, 128.0, 512.0, 2048.0]
        } else {
            &[8.0, 64.0]
        };
        let mut best = candidate.clone();
        let mut x = candidate.x.clone();
        for &sharpness in ladder {
            let found = program.descend(
                &x,
                Effort {
                    sharpness,
                    ..effort
                },
            );
            x.clone_from(&found.x);
            let (cost, broken) = program.judge(&found.x, f64::INFINITY);
            let new = Candidate {
                x: found.x,
                cost,
                broken,
                projected: found.projected,
                ..candidate.clone()
            };
            if new.merit() <= best.merit() {
                best = new;
            }
            if program.stopped {
                break;
            }
        }
        if !best.projected.is_finite() {
            best.projected = program.projected_gradient(&best.x, 512.0);
        }
        best
    }

    fn polish(&self, candidate: &Candidate, look: &mut dyn FnMut() -> bool) -> Candidate {
        let effort = Effort {
            rounds: 30,
            steps: 4 * self.options.iterations,
            sharpness: 512.0,
            tolerance: 1e-7,
            warm: false,
        };
        let mut found = self.descended(candidate, effort, true, look);
        // Many limits at once: on from where it came to, with what holds it there.
        // A search without restarts is to be quick.
        for _ in 0..self.options.restarts.min(4) {
            if found.projected < 1e-3 || !look() {
                break;
            }
            let again = Effort {
                warm: true,
                ..effort
            };
            let before = found.projected;
            found = self.descended(&found, again, true, look);
            if found.projected > 0.5 * before {
                break;
            }
        }
        if self.problem.legs.is_some_and(|legs| legs > 1) {
            return self.exchange(found, look);
        }
        found
    }

    /// Moves the turns by whole steps as long as that makes the path better.
    fn exchange(&self, candidate: Candidate, look: &mut dyn FnMut() -> bool) -> Candidate {
        let mut best = candidate;
        let mut shift = (self.problem.moves / 8).max(1);
        let mut going = true;
        while shift > 0 && going {
            let mut better = true;
            while better && going {
                better = false;
                for moves in shifts(best.counts.len(), shift) {
                    let Some(counts) = shifted(&best.counts, &moves) else {
                        continue;
                    };
                    let mut moved = best.clone();
                    moved.counts = counts;
                    moved.cost = f64::INFINITY;
                    let mut inner = || {
                        going = going && look();
                        going
                    };
                    let moved = self.refine(&moved, false, &mut inner);
                    if moved.merit() < best.merit() - 1e-8 {
                        best = moved;
                        better = true;
                    }
                }
            }
            shift /= 2;
        }
        self.refine(&best, true, look)
    }

    // --- disturbances --------------------------------------------------------------

    /// Disturbs one of the best paths and refines it again.
    fn disturb(&mut self, round: usize, look: &mut dyn FnMut() -> bool) {
        let mut stream = Stream::new(self.options.seed, 1 + round as u64);
        let pick = if stream.uniform() < 0.6 {
            0
        } else {
            index(&mut stream, self.pool.len().min(5))
        };
        let mut moved = self.pool[pick].clone();
        let layout = Layout::new(&self.problem, moved.counts.clone());
        let observer = index(&mut stream, self.problem.observers.len());
        let first = layout.first(observer);
        let legs = layout.legs();
        moved.family = "disturbed";
        moved.guess = f64::NAN;
        let headings = &mut moved.x[first..first + legs];
        let begin = index(&mut stream, legs);
        let end = begin + 1 + index(&mut stream, legs - begin);
        match index(&mut stream, 5) {
            0 => {
                // A part of the path turned.
                let turn = 0.7 * stream.normal();
                for heading in &mut headings[begin..end] {
                    *heading += turn;
                }
            }
            1 => {
                // All that follows mirrored about the line of sight.
                let mut tracks = Vec::new();
                layout.walk(&self.problem, &self.pool[pick].x, &mut tracks);
                let step: usize = moved.counts[..begin].iter().sum();
                let axis = self.aim_bearing(tracks[observer].at[step]);
                for heading in &mut headings[begin..] {
                    *heading = 2.0 * axis - *heading;
                }
            }
            2 => {
                // A part of the path straight, anywhere.
                let straight = TAU * stream.uniform();
                headings[begin..end].fill(straight);
            }
            3 => {
                // The end of another path.
                let other = &self.pool[index(&mut stream, self.pool.len())];
                if other.counts == moved.counts {
                    headings[begin..].copy_from_slice(&other.x[first + begin..first + legs]);
                }
            }
            _ => {
                for heading in headings.iter_mut() {
                    *heading += 0.3 * stream.normal();
                }
                if self.problem.legs.is_some() && legs > 1 {
                    moved.counts = disturbed_counts(&moved.counts, &mut stream);
                }
            }
        }
        if self.problem.legs.is_none() {
            let layout = Layout::new(&self.problem, moved.counts.clone());
            let wanted: Vec<Vec<f64>> = (0..self.problem.observers.len())
                .map(|o| layout.headings(&moved.x, o).to_vec())
                .collect();
            let steered = steered(&self.problem, &layout, |o, place| wanted[o][place.step]);
            // The speeds stay.
            for o in 0..wanted.len() {
                let first = layout.first(o);
                moved.x[first..first + legs].copy_from_slice(&steered[first..first + legs]);
            }
        }
        moved.cost = f64::INFINITY;
        moved.projected = f64::INFINITY;
        let mut found = self.refine(&moved, false, look);
        let best = self.pool[0].merit();
        let near = if self.problem.legs.is_some() || self.corners {
            0.15
        } else {
            0.02
        };
        if found.merit() < best + near {
            found = self.refine(&found, true, look);
            if self.problem.legs.is_some_and(|legs| legs > 1) {
                found = self.exchange(found, look);
            }
        }
        self.keep(found);
    }
}

/// A path straight in and then round the target: how far off the line of sight it goes in,
/// and whether each step goes to the right once it is there.
#[derive(Clone, Debug)]
struct Round {
    offset: f64,
    sides: Vec<bool>,
}

impl Round {
    fn flip(&mut self, from: usize, to: usize) {
        for side in &mut self.sides[from..to] {
            *side = !*side;
        }
    }

    /// Changes the sides of some steps in a row, moves a change of side, or the way in.
    fn change(&mut self, stream: &mut Stream) {
        let moves = self.sides.len();
        let turns: Vec<usize> = (1..moves)
            .filter(|&step| self.sides[step] != self.sides[step - 1])
            .collect();
        let draw = stream.uniform();
        if draw < 0.15 {
            self.offset += 0.15 * stream.normal();
        } else if draw < 0.6 && !turns.is_empty() {
            let turn = turns[index(stream, turns.len())];
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let by = 1 + (4.0 * stream.normal().abs()) as usize;
            if stream.uniform() < 0.5 {
                self.flip(turn.saturating_sub(by), turn);
            } else {
                self.flip(turn, (turn + by).min(moves));
            }
        } else {
            let from = index(stream, moves);
            let to = if draw > 0.8 {
                moves
            } else {
                (from + 1 + index(stream, 1 + moves / 4)).min(moves)
            };
            self.flip(from, to);
        }
    }
}

/// A whole number below `most`.
fn index(stream: &mut Stream, most: usize) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let drawn = (stream.uniform() * most as f64) as usize;
    drawn.min(most.saturating_sub(1))
}

fn disturbed_counts(counts: &[usize], stream: &mut Stream) -> Vec<usize> {
    let moves: usize = counts.iter().sum();
    let mut shares: Vec<f64> = counts.iter().map(|&count| count as f64).collect();
    for share in &mut shares {
        *share += 0.12 * moves as f64 * stream.normal();
        *share = share.max(1.0);
    }
    whole_counts(&shares, moves)
}

/// Whole counts >= 1 of this sum, near to the shares.
fn whole_counts(shares: &[f64], moves: usize) -> Vec<usize> {
    let total: f64 = shares.iter().sum();
    let legs = shares.len();
    let mut counts = Vec::with_capacity(legs);
    let (mut sum, mut last) = (0.0, 0);
    for (leg, share) in shares.iter().enumerate() {
        sum += share / total * moves as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let end = (sum.round() as usize).clamp(last + 1, moves - (legs - 1 - leg));
        counts.push(end - last);
        last = end;
    }
    counts
}

/// Ways to move the turns between `legs` legs: one of them, or two that follow each other.
fn shifts(legs: usize, shift: usize) -> Vec<Vec<(usize, bool, usize)>> {
    let mut out = Vec::new();
    for turn in 0..legs - 1 {
        for later in [true, false] {
            out.push(vec![(turn, later, shift)]);
            if turn + 2 < legs {
                for next in [true, false] {
                    out.push(vec![(turn, later, shift), (turn + 1, next, shift)]);
                }
            }
        }
    }
    out
}

/// The counts after some turns came later or earlier; `None` where a leg has no step left.
fn shifted(counts: &[usize], moves: &[(usize, bool, usize)]) -> Option<Vec<usize>> {
    let mut ends: Vec<usize> = counts
        .iter()
        .scan(0, |sum, count| {
            *sum += count;
            Some(*sum)
        })
        .collect();
    for &(turn, later, by) in moves {
        ends[turn] = if later {
            ends[turn] + by
        } else {
            ends[turn].checked_sub(by)?
        };
    }
    let mut last = 0;
    let mut out = Vec::with_capacity(counts.len());
    for end in ends {
        if end <= last {
            return None;
        }
        out.push(end - last);
        last = end;
    }
    Some(out)
}

/// How many steps the legs of first guesses have.
fn splits(moves: usize, legs: usize, stream: &mut Stream) -> Vec<Vec<usize>> {
    let table: &[&[f64]] = match legs {
        1 => &[&[1.0]],
        2 => &[
            &[1.0, 1.0],
            &[1.0, 2.0],
            &[2.0, 1.0],
            &[1.0, 4.0],
            &[4.0, 1.0],
        ],
        3 => &[
            &[1.0, 1.0, 1.0],
            &[1.0, 2.0, 1.0],
            &[2.0, 1.0, 1.0],
            &[1.0, 1.0, 2.0],
            &[2.0, 2.0, 1.0],
            &[1.0, 2.0, 2.0],
        ],
        _ => &[],
    };
    let mut out: Vec<Vec<usize>> = table
        .iter()
        .map(|shares| whole_counts(shares, moves))
        .collect();
    if out.is_empty() {
        out.push(whole_counts(&vec![1.0; legs], moves));
        for _ in 0..11 {
            let shares: Vec<f64> = (0..legs).map(|_| 0.15 + stream.uniform()).collect();
            out.push(whole_counts(&shares, moves));
        }
    }
    out
}

/// The headings of legs as headings of steps.
fn spread(headings: &[f64], counts: &[usize]) -> Vec<f64> {
    let mut out = Vec::new();
    for (&heading, &count) in headings.iter().zip(counts) {
        out.extend(core::iter::repeat_n(heading, count));
    }
    out
}

fn packed(layout: &Layout, headings: &[Vec<f64>]) -> Vec<f64> {
    let mut x = vec![1.0; layout.unknowns()];
    for (observer, headings) in headings.iter().enumerate() {
        let first = layout.first(observer);
        x[first..first + headings.len()].copy_from_slice(headings);
    }
    x
}

/// Paths at full speed that go as `wanted` asks, turned aside from targets and discs.
fn steered(
    problem: &Problem,
    layout: &Layout,
    mut wanted: impl FnMut(usize, &Place<f64>) -> f64,
) -> Vec<f64> {
    let targets: Vec<[f64; 4]> = problem
        .beliefs
        .iter()
        .flat_map(|belief| belief.targets.iter().copied())
        .collect();
    let mut all = Vec::with_capacity(problem.observers.len());
    for (index, observer) in problem.observers.iter().enumerate() {
        let limits = Limits {
            standoff: problem.standoff * (1.0 + 1e-9),
            targets: &targets,
            keep_out: &problem.discs,
            max_turn: observer.max_turn * (1.0 - 1e-9),
        };
        let lengths = vec![observer.speed[1] * problem.dt; problem.moves];
        let mut headings = vec![0.0; problem.moves];
        follow(
            observer.start,
            problem.dt,
            &lengths,
            observer.heading,
            &limits,
            |place| wanted(index, place),
            &mut headings,
        );
        // Without jumps of whole turns.
        let mut before = headings.first().copied().unwrap_or(0.0);
        for heading in &mut headings {
            *heading = before + wrapped(*heading - before);
            before = *heading;
        }
        all.push(headings);
    }
    packed(layout, &all)
}
