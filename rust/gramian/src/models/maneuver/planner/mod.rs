//! The planner: the paths of one or several observers from which their sensors tell the
//! most of one or several targets.
//!
//! A [`Problem`] says what is known, who can go where, and what is to be made best. A
//! [`Search`] looks for the best path in small pieces of work, so that its caller can
//! stop it at any time; it ends in a first-order optimum whose projected gradient it
//! reports. An [`upper_bound`] says what no path can exceed.
//!
//! ```
//! use gramian::maneuver::planner::{Options, Problem, Search};
//! // 30 bearings of 0.01 rad of a target 1000 m north, 20 m apart, not closer than 700 m.
//! let problem = Problem::bearings([0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 30, 0.01, 700.0)?;
//! let mut search = Search::new(&problem, Options::default())?;
//! search.run(&mut |_| true);
//! let plan = search.best().ok_or("no path determines the target")?;
//! assert!(plan.clearance >= 0.0);
//! assert!(plan.projected_gradient < 1e-2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Source
//! The information is that of Xu et al. 2009, eqs. (9) and (10), with the rows of
//! [`tracks::sensors`](crate::tracks::sensors); the criteria are Kiefer's (1974). The
//! search is ours.

mod bearings;
mod descend;
mod limits;
mod objective;
mod paths;
mod search;
mod tuples;
mod upper;

use alloc::vec;
use alloc::vec::Vec;

pub use self::objective::MOST_STATES;
pub use self::paths::Track;
pub use self::search::{Found, Options, Progress, Search, Tried};
pub use self::upper::{Effort, upper_bound};
use crate::scalar::{NumberError, check_finite, check_length, check_positive};
use crate::tracks::scene::Kind;

/// What is to be made best.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    /// The determinant of the information: large.
    Determinant,
    /// The trace of the bound on the scaled states: small.
    Trace,
    /// The smallest eigenvalue of the information on the scaled states: large.
    Eigenvalue,
    /// The variance of a combination of the states: small.
    Combination,
}

/// What is made of several possible states of the targets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Over {
    /// The expectation of the criterion.
    Expectation,
    /// The worst of them.
    Worst,
    /// What the criterion is at least as good as with this probability, in (0, 1).
    Chance(f64),
}

/// Criterion, and what is made of a belief.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// What is to be made best.
    pub criterion: Criterion,
    /// Over the belief.
    pub over: Over,
}

/// What an observer measures of every target at every sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Bearing, range, range rate, frequency, cone angle or signal strength.
    pub kind: Kind,
    /// Standard deviation.
    pub sigma: f64,
    /// Probability of a reading, in (0, 1].
    pub detection: f64,
    /// Tonal; or power and exponent.
    pub parameters: [f64; 2],
    /// Which of them is unknown: states of the sensors, from 0 on.
    pub parameter_states: [Option<usize>; 2],
    /// The state of the sensors that is added to every reading.
    pub bias: Option<usize>,
    /// Arcs (from, to), clockwise from the heading, in which nothing is seen, rad.
    pub blind: Vec<(f64, f64)>,
    /// Range beyond which nothing is seen, m.
    pub reach: f64,
}

impl Sensor {
    /// A sensor that sees everything, without anything unknown.
    pub fn new(kind: Kind, sigma: f64) -> Self {
        Self {
            kind,
            sigma,
            detection: 1.0,
            parameters: [0.0, 2.0],
            parameter_states: [None; 2],
            bias: None,
            blind: Vec::new(),
            reach: f64::INFINITY,
        }
    }
}

/// Who moves and measures.
#[derive(Clone, Debug, PartialEq)]
pub struct Observer {
    /// Where it starts.
    pub start: [f64; 2],
    /// Its least and largest speed through the water, m/s.
    pub speed: [f64; 2],
    /// Its heading before the start, where the first turn counts.
    pub heading: Option<f64>,
    /// The largest change of heading from one step to the next, rad.
    pub max_turn: f64,
    /// Where it must be at the end, and how near to that.
    pub home: Option<([f64; 2], f64)>,
    /// The longest path through the water, m.
    pub distance: f64,
    /// What it measures.
    pub sensors: Vec<Sensor>,
}

/// One possible state of all targets.
#[derive(Clone, Debug, PartialEq)]
pub struct Belief {
    /// (x0, y0, vx, vy) of each target at the start.
    pub targets: Vec<[f64; 4]>,
    /// Its probability.
    pub weight: f64,
    /// Rows of what is known beforehand, row-major.
    pub prior: Vec<f64>,
    /// The combination of the states whose variance counts.
    pub combination: Vec<f64>,
}

/// What a plan is made for.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Time of one step, s.
    pub dt: f64,
    /// Number of steps: one less than samples.
    pub moves: usize,
    /// The observers.
    pub observers: Vec<Observer>,
    /// The possible states of the targets.
    pub beliefs: Vec<Belief>,
    /// States of one target: 2 (position) or 4 (and velocity).
    pub dimension: usize,
    /// States of the sensors: biases and parameters.
    pub nuisances: usize,
    /// What counts as one unit of each state.
    pub scale: Vec<f64>,
    /// What is to be made best.
    pub aim: Aim,
    /// No sample is taken closer than this to any possible target, m.
    pub standoff: f64,
    /// Discs (east, north, radius) that no path enters.
    pub discs: Vec<[f64; 3]>,
    /// Polygons that no path enters.
    pub polygons: Vec<Vec<[f64; 2]>>,
    /// The observers keep this distance from each other where they measure, m.
    pub separation: f64,
    /// Velocity of the water, m/s.
    pub current: [f64; 2],
    /// Number of straight legs; `None` for a heading at every step.
    pub legs: Option<usize>,
}

/// What paths keep to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restriction {
    /// The stand-off range.
    Standoff,
    /// A disc, by its place in [`Problem::discs`].
    Disc(usize),
    /// A polygon, by its place in [`Problem::polygons`].
    Polygon(usize),
    /// The largest turn.
    Turn,
    /// The range of speeds.
    Speed,
    /// The distance between observers.
    Separation,
    /// The place to be at in the end.
    Home,
    /// The longest path.
    Distance,
}

/// A limit that a path breaks, where it breaks it most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// What is broken.
    pub restriction: Restriction,
    /// By whom; of two that are too close the first.
    pub observer: usize,
    /// At the step that ends at this sample; a turn: at this sample.
    pub sample: usize,
    /// By how much: m, m/s for a speed, rad for a turn.
    pub by: f64,
}

/// What can be wrong with a [`Problem`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// More states than a plan can have, or none.
    #[error("{given} states: must be from 2 to {MOST_STATES}")]
    States {
        /// How many.
        given: usize,
    },
    /// A number that has no meaning here.
    #[error("{name} = {given}: must be {allowed}")]
    Count {
        /// Of what.
        name: &'static str,
        /// The number given.
        given: usize,
        /// What may be given.
        allowed: &'static str,
    },
    /// A sensor that a plan cannot use.
    #[error(
        "a sensor of {kind}: must be bearing, range, range_rate, frequency, cone_angle or signal_strength"
    )]
    Sensor {
        /// The kind given.
        kind: &'static str,
    },
    /// A number that is not finite, or an array that does not fit.
    #[error(transparent)]
    Number(#[from] NumberError),
}

impl Problem {
    /// Bearings of one fixed target by one observer at one speed: the simplest problem.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn bearings(
        target: [f64; 2],
        start: [f64; 2],
        speed: f64,
        dt: f64,
        samples: usize,
        sigma: f64,
        standoff: f64,
    ) -> Result<Self, Error> {
        let problem = Self {
            dt,
            moves: samples.saturating_sub(1),
            observers: vec![Observer {
                start,
                speed: [speed; 2],
                heading: None,
                max_turn: f64::INFINITY,
                home: None,
                distance: f64::INFINITY,
                sensors: vec![Sensor::new(Kind::Bearing, sigma)],
            }],
            beliefs: vec![Belief {
                targets: vec![[target[0], target[1], 0.0, 0.0]],
                weight: 1.0,
                prior: Vec::new(),
                combination: vec![0.0; 2],
            }],
            dimension: 2,
            nuisances: 0,
            scale: vec![1.0; 2],
            aim: Aim {
                criterion: Criterion::Determinant,
                over: Over::Expectation,
            },
            standoff,
            discs: Vec::new(),
            polygons: Vec::new(),
            separation: 0.0,
            current: [0.0; 2],
            legs: None,
        };
        problem.check()?;
        Ok(problem)
    }

    /// Number of targets.
    pub fn targets(&self) -> usize {
        self.beliefs
            .first()
            .map_or(0, |belief| belief.targets.len())
    }

    /// Number of states of all targets and sensors.
    pub fn states(&self) -> usize {
        self.targets() * self.dimension + self.nuisances
    }

    /// Whether everything fits together.
    ///
    /// # Errors
    /// What does not.
    pub fn check(&self) -> Result<(), Error> {
        let count = |name, given, allowed| {
            Err(Error::Count {
                name,
                given,
                allowed,
            })
        };
        if self.moves == 0 {
            return count("moves", 0, ">= 1");
        }
        if self.observers.is_empty() {
            return count("observers", 0, ">= 1");
        }
        if self.beliefs.is_empty() {
            return count("beliefs", 0, ">= 1");
        }
        if self.dimension != 2 && self.dimension != 4 {
            return count("dimension", self.dimension, "2 or 4");
        }
        if let Some(legs) = self.legs
            && !(1..=self.moves).contains(&legs)
        {
            return count("legs", legs, "from 1 to the number of moves");
        }
        let states = self.states();
        if !(2..=MOST_STATES).contains(&states) || self.targets() == 0 {
            return Err(Error::States { given: states });
        }
        check_positive("dt", self.dt)?;
        if let Over::Chance(level) = self.aim.over {
            check_positive("chance", level)?;
            check_positive("1 - chance", 1.0 - level)?;
        }
        check_length("scale", self.scale.len(), states)?;
        for &scale in &self.scale {
            check_positive("scale", scale)?;
        }
        check_finite("current", &self.current)?;
        check_finite("discs", self.discs.as_flattened())?;
        check_finite("standoff", &[self.standoff, self.separation])?;
        for polygon in &self.polygons {
            check_finite("polygon", polygon.as_flattened())?;
            if polygon.len() < 3 {
                return count("corners of a polygon", polygon.len(), ">= 3");
            }
        }
        for belief in &self.beliefs {
            check_length("targets", belief.targets.len(), self.targets())?;
            check_finite("targets", belief.targets.as_flattened())?;
            check_finite("weight", &[belief.weight])?;
            check_finite("prior", &belief.prior)?;
            check_length("prior", belief.prior.len() % states, 0)?;
            check_length("combination", belief.combination.len(), states)?;
            check_finite("combination", &belief.combination)?;
        }
        for observer in &self.observers {
            check_finite("start", &observer.start)?;
            check_positive("speed", observer.speed[0])?;
            check_positive("speed", observer.speed[1])?;
            check_finite("heading", observer.heading.as_slice())?;
            for sensor in &observer.sensors {
                self.check_sensor(sensor)?;
            }
        }
        Ok(())
    }

    fn check_sensor(&self, sensor: &Sensor) -> Result<(), Error> {
        if !matches!(
            sensor.kind,
            Kind::Bearing
                | Kind::Range
                | Kind::RangeRate
                | Kind::Frequency(_)
                | Kind::ConeAngle
                | Kind::SignalStrength
        ) {
            return Err(Error::Sensor {
                kind: sensor.kind.name(),
            });
        }
        check_positive("sigma", sensor.sigma)?;
        check_positive("detection", sensor.detection)?;
        check_finite("parameters", &sensor.parameters)?;
        for &(from, to) in &sensor.blind {
            check_finite("blind", &[from, to])?;
        }
        for state in sensor
            .parameter_states
            .iter()
            .chain([&sensor.bias])
            .flatten()
        {
            if *state >= self.nuisances {
                return Err(Error::Count {
                    name: "state of a sensor",
                    given: *state,
                    allowed: "below nuisances",
                });
            }
        }
        Ok(())
    }

    /// The expected state of the first target.
    fn aim_at(&self) -> [f64; 4] {
        let mut sum = [0.0; 4];
        let mut total = 0.0;
        for belief in &self.beliefs {
            for target in &belief.targets {
                total += belief.weight;
                for (sum, x) in sum.iter_mut().zip(target) {
                    *sum += belief.weight * x;
                }
            }
        }
        sum.map(|x| x / total.max(1e-300))
    }
}
