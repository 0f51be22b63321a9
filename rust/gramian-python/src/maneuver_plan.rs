//! The planner's problem and search, paths of laws, and the closed loop.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use gramian::maneuver::Side;
use gramian::maneuver::batch::closed_loop::{
    self, Guidance, Happens, LostBearing, PER_SAMPLE, Setting,
};
use gramian::maneuver::batch::plan::{self, Course};
use gramian::maneuver::planner::{
    Aim, Belief, Criterion, Effort, Found, Observer, Options, Over, Problem, Restriction, Search,
    Sensor, upper_bound,
};
use gramian::maneuver::steer::Limits;
use gramian::tracks::scene::Kind;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::Input;
use crate::errors::{self, InputError};
use crate::output::Batch;

/// A sensor of an observer.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct SensorGiven {
    kind: String,
    sigma: f64,
    detection: f64,
    wave: f64,
    parameters: [f64; 2],
    parameter_states: [Option<usize>; 2],
    bias: Option<usize>,
    blind: Vec<(f64, f64)>,
    reach: f64,
}

/// An observer.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct ObserverGiven {
    start: [f64; 2],
    speed: [f64; 2],
    heading: Option<f64>,
    max_turn: f64,
    home: Option<([f64; 2], f64)>,
    distance: f64,
    sensors: Vec<SensorGiven>,
}

/// A possible state of all targets.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct BeliefGiven {
    targets: Vec<[f64; 4]>,
    weight: f64,
    prior: Vec<f64>,
    combination: Vec<f64>,
}

/// Everything that a plan is made for.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct ProblemGiven {
    dt: f64,
    moves: usize,
    observers: Vec<ObserverGiven>,
    beliefs: Vec<BeliefGiven>,
    dimension: usize,
    nuisances: usize,
    scale: Vec<f64>,
    criterion: String,
    over: String,
    chance: f64,
    standoff: f64,
    discs: Vec<[f64; 3]>,
    polygons: Vec<Vec<[f64; 2]>>,
    separation: f64,
    current: [f64; 2],
    legs: Option<usize>,
}

fn kind(name: &str, wave: f64) -> PyResult<Kind> {
    Ok(match name {
        "bearing" => Kind::Bearing,
        "range" => Kind::Range,
        "range_rate" => Kind::RangeRate,
        "frequency" => Kind::Frequency(wave),
        "cone_angle" => Kind::ConeAngle,
        "signal_strength" => Kind::SignalStrength,
        other => {
            return Err(InputError::new_err(format!(
                "kind = {other:?}: must be one of bearing, range, range_rate, frequency, \
                 cone_angle, signal_strength"
            )));
        }
    })
}

impl ProblemGiven {
    fn problem(self) -> PyResult<Problem> {
        let mut observers = Vec::with_capacity(self.observers.len());
        for given in self.observers {
            let mut sensors = Vec::with_capacity(given.sensors.len());
            for sensor in given.sensors {
                sensors.push(Sensor {
                    kind: kind(&sensor.kind, sensor.wave)?,
                    sigma: sensor.sigma,
                    detection: sensor.detection,
                    parameters: sensor.parameters,
                    parameter_states: sensor.parameter_states,
                    bias: sensor.bias,
                    blind: sensor.blind,
                    reach: sensor.reach,
                });
            }
            observers.push(Observer {
                start: given.start,
                speed: given.speed,
                heading: given.heading,
                max_turn: given.max_turn,
                home: given.home,
                distance: given.distance,
                sensors,
            });
        }
        let criterion = match self.criterion.as_str() {
            "D" => Criterion::Determinant,
            "A" => Criterion::Trace,
            "E" => Criterion::Eigenvalue,
            _ => Criterion::Combination,
        };
        let over = match self.over.as_str() {
            "worst" => Over::Worst,
            "chance" => Over::Chance(self.chance),
            _ => Over::Expectation,
        };
        Ok(Problem {
            dt: self.dt,
            moves: self.moves,
            observers,
            beliefs: self
                .beliefs
                .into_iter()
                .map(|given| Belief {
                    targets: given.targets,
                    weight: given.weight,
                    prior: given.prior,
                    combination: given.combination,
                })
                .collect(),
            dimension: self.dimension,
            nuisances: self.nuisances,
            scale: self.scale,
            aim: Aim { criterion, over },
            standoff: self.standoff,
            discs: self.discs,
            polygons: self.polygons,
            separation: self.separation,
            current: self.current,
            legs: self.legs,
        })
    }
}

/// The search of the planner: see `gramian::maneuver::planner::Search`.
#[pyclass(frozen, module = "gramian._core")]
pub struct PlanSearch(Mutex<Search>);

type Tried = (&'static str, usize, f64, f64, f64, bool, Vec<Vec<[f64; 2]>>);
type Gradient<'py> = (f64, Bound<'py, PyArray3<f64>>);

// Lists are taken by value: what is extracted from Python is owned.
#[allow(clippy::needless_pass_by_value)]
#[pymethods]
impl PlanSearch {
    #[new]
    fn new(
        problem: ProblemGiven,
        starts: usize,
        restarts: usize,
        iterations: usize,
        seed: u64,
    ) -> PyResult<Self> {
        let options = Options {
            starts,
            restarts,
            iterations,
            seed,
        };
        let search = Search::new(&problem.problem()?, options)
            .map_err(|error| errors::input_at("", error))?;
        Ok(Self(Mutex::new(search)))
    }

    /// Searches until the end ("done"), for `seconds` ("time"), or until Ctrl-C
    /// ("interrupted"). `progress` is called with pieces done, of how many, and the best
    /// value so far.
    fn run(
        &self,
        py: Python<'_>,
        seconds: f64,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<&'static str> {
        let began = Instant::now();
        let mut raised = None;
        let mut late = false;
        let done = py.detach(|| {
            let mut last = began;
            let mut told = usize::MAX;
            self.search().run(&mut |now| {
                let pause = last.elapsed();
                if began.elapsed().as_secs_f64() > seconds {
                    late = true;
                    return false;
                }
                let news = progress.is_some() && now.done != told;
                if pause < Duration::from_millis(100) && !news {
                    return true;
                }
                last = Instant::now();
                raised = Python::attach(|py| {
                    if let Some(progress) = progress.as_ref().filter(|_| news) {
                        told = now.done;
                        progress.call1(py, (now.done, now.total, now.value))?;
                    }
                    crate::run::look(py)
                })
                .err();
                raised.is_none()
            })
        });
        match raised {
            Some(error) if error.is_instance_of::<PyKeyboardInterrupt>(py) => {
                if self.search().best().is_none() {
                    return Err(error);
                }
                Ok("interrupted")
            }
            Some(error) => Err(error),
            None if done || !late => Ok("done"),
            None => Ok("time"),
        }
    }

    /// The best path so far, or None.
    fn best<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let search = self.search();
        search
            .best()
            .map(|found| as_dict(py, &search, &found))
            .transpose()
    }

    /// What was refined: family, legs, guess, value, projected gradient, kept, paths.
    fn tried(&self) -> Vec<Tried> {
        self.search()
            .tried()
            .iter()
            .map(|tried| {
                (
                    tried.family,
                    tried.legs,
                    tried.guess,
                    tried.value,
                    tried.projected_gradient,
                    tried.kept,
                    tried.paths.clone(),
                )
            })
            .collect()
    }

    /// What no path can exceed, or None where no bound is known; with `passes` on coarse
    /// cells and `cells` on fine ones.
    fn bound(
        &self,
        py: Python<'_>,
        passes: usize,
        cells: f64,
        seconds: f64,
    ) -> PyResult<Option<f64>> {
        let search = self.search();
        let Some(best) = search.best() else {
            return Ok(None);
        };
        let began = Instant::now();
        let mut raised = None;
        let answer = py.detach(|| {
            let mut last = began;
            upper_bound(
                search.problem(),
                &best.tracks,
                best.value,
                Effort { passes, cells },
                &mut || {
                    if began.elapsed().as_secs_f64() > seconds {
                        return false;
                    }
                    if last.elapsed() < Duration::from_millis(100) {
                        return true;
                    }
                    last = Instant::now();
                    raised = Python::attach(crate::run::look).err();
                    raised.is_none()
                },
            )
        });
        match raised {
            Some(error) if !error.is_instance_of::<PyKeyboardInterrupt>(py) => Err(error),
            _ => answer.map_err(|error| errors::input_at("", error)),
        }
    }

    /// How many guesses were compared.
    fn guessed(&self) -> usize {
        self.search().guessed()
    }

    /// A path of `counts` steps on headings at speeds (observers, legs), as `best`.
    fn judge<'py>(
        &self,
        py: Python<'py>,
        counts: Vec<usize>,
        headings: Vec<Vec<f64>>,
        speeds: Vec<Vec<f64>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let search = self.search();
        let found = search
            .judge(&counts, &headings, &speeds)
            .map_err(|error| errors::input_at("", error))?;
        as_dict(py, &search, &found)
    }

    /// The cost of a path and its derivatives (2, observers, legs) by headings and speeds.
    fn gradient<'py>(
        &self,
        py: Python<'py>,
        counts: &Bound<'py, PyArray1<i64>>,
        headings: &Bound<'py, PyArray2<f64>>,
        speeds: &Bound<'py, PyArray2<f64>>,
        sharpness: f64,
    ) -> PyResult<Gradient<'py>> {
        let shape = [2, headings.shape()[0], headings.shape()[1]];
        let counts: Vec<usize> = counts
            .to_vec()?
            .into_iter()
            .map(|count| usize::try_from(count).unwrap_or(usize::MAX))
            .collect();
        let (headings, speeds) = (headings.to_vec()?, speeds.to_vec()?);
        let mut by = vec![0.0; 2 * headings.len()];
        let (by_heading, by_speed) = by.split_at_mut(headings.len());
        let cost = self
            .search()
            .gradient(&counts, &headings, &speeds, sharpness, by_heading, by_speed)
            .map_err(|error| errors::input_at("", error))?;
        Ok((cost, PyArray1::from_vec(py, by).reshape(shape)?))
    }
}

impl PlanSearch {
    fn search(&self) -> MutexGuard<'_, Search> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn as_dict<'py>(py: Python<'py>, search: &Search, found: &Found) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("counts", &found.counts)?;
    for (name, values) in [("headings", &found.headings), ("speeds", &found.speeds)] {
        out.set_item(name, PyArray2::from_vec2(py, values)?)?;
    }
    let paths: Vec<Vec<[f64; 2]>> = found.tracks.iter().map(|track| track.at.clone()).collect();
    out.set_item("paths", paths)?;
    out.set_item("value", found.value)?;
    out.set_item(
        "values",
        PyArray1::from_vec(py, search.along(&found.tracks)),
    )?;
    out.set_item("roots", search.roots(&found.tracks))?;
    let covariances: Vec<f64> = search
        .covariances(&found.tracks)
        .iter()
        .flat_map(|&[xx, xy, yy]| [xx, xy, xy, yy])
        .collect();
    let samples = covariances.len() / 4;
    out.set_item(
        "covariances",
        PyArray1::from_vec(py, covariances).reshape([samples, 2, 2])?,
    )?;
    out.set_item("projected_gradient", found.projected_gradient)?;
    out.set_item("clearance", found.clearance)?;
    out.set_item("broken", found.broken)?;
    let violations: Vec<_> = found
        .violations
        .iter()
        .map(|one| {
            let (name, index) = match one.restriction {
                Restriction::Standoff => ("standoff", None),
                Restriction::Disc(index) => ("keep_out", Some(index)),
                Restriction::Polygon(index) => ("polygons", Some(index)),
                Restriction::Turn => ("max_turn_rate", None),
                Restriction::Speed => ("speed", None),
                Restriction::Separation => ("separation", None),
                Restriction::Home => ("return_to", None),
                Restriction::Distance => ("max_distance", None),
            };
            (name, index, one.observer, one.sample, one.by)
        })
        .collect();
    out.set_item("violations", violations)?;
    out.set_item("family", found.family)?;
    Ok(out)
}

/// Headings (steps + 1) of a law that keep the limits: the last entry counts the steps
/// that could not.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn plan_steered<'py>(
    py: Python<'py>,
    start: &Bound<'py, PyAny>,
    dt: f64,
    lengths: &Bound<'py, PyAny>,
    first: Option<f64>,
    standoff: f64,
    targets: &Bound<'py, PyAny>,
    keep_out: &Bound<'py, PyAny>,
    max_turn: f64,
    law: &str,
    side: f64,
    aim: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let start = pair(start, "start")?;
    let lengths = Input::new(lengths, "lengths", 1)?;
    let steps = lengths.core_shape()[0];
    let targets = Input::new(targets, "targets", 2)?;
    targets.expect(&[None, Some(4)], "x0, y0, vx, vy of each possible target")?;
    let keep_out = Input::new(keep_out, "keep_out", 2)?;
    keep_out.expect(&[None, Some(3)], "east, north and radius of each circle")?;
    let aim = Input::new(aim, "aim", 1)?;
    aim.expect(&[Some(4)], "x0, y0, vx, vy")?;
    let law = crate::maneuver::law(law)?;
    let mut point = [0.0; 4];
    point.copy_from_slice(aim.slice()?);
    let course = Course {
        start,
        dt,
        lengths: lengths.slice()?,
        first,
        limits: Limits {
            standoff,
            targets: targets.slice()?.as_chunks().0,
            keep_out: keep_out.slice()?.as_chunks().0,
            max_turn,
        },
    };
    let mut out = vec![0.0; steps + 1];
    plan::steered(&course, law, side_of(side), point, &mut out);
    Ok(PyArray1::from_vec(py, out))
}

/// Trials (..., steps + 1, 8): position, estimate (x0, y0, vx, vy), believed deviation of
/// the present position, likelihood ratio of the truth. `guide` is "headings" or a law, for
/// which `wanted` is (1,): the side.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn maneuver_closed_loop<'py>(
    py: Python<'py>,
    target: &Bound<'py, PyAny>,
    start: &Bound<'py, PyAny>,
    dt: f64,
    length: f64,
    steps: usize,
    sigma: f64,
    first_range: (f64, f64),
    first_speed: Option<f64>,
    gate: f64,
    opening: usize,
    when_lost: &str,
    standoff: f64,
    keep_out: &Bound<'py, PyAny>,
    max_turn: f64,
    guide: &str,
    wanted: &Bound<'py, PyAny>,
    noise: &Bound<'py, PyAny>,
    lost: &Bound<'py, PyAny>,
    alarms: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let keep_out = Input::new(keep_out, "keep_out", 2)?;
    keep_out.expect(&[None, Some(3)], "east, north and radius of each circle")?;
    let mut target = Input::new(target, "target", 1)?;
    target.expect(&[Some(4)], "x0, y0, vx, vy")?;
    let setting = Setting {
        start: pair(start, "start")?,
        dt,
        length,
        steps,
        sigma,
        range: first_range,
        speed: first_speed,
        gate,
        opening,
        lost: match when_lost {
            "predict" => LostBearing::Predict,
            "hold" => LostBearing::Hold,
            other => {
                return Err(InputError::new_err(format!(
                    "when_lost = {other:?}: must be \"predict\" or \"hold\""
                )));
            }
        },
        standoff,
        keep_out: keep_out.slice()?.as_chunks().0,
        max_turn,
    };
    let mut noise = Input::new(noise, "noise", 1)?;
    noise.expect(&[Some(steps + 1)], "one number for each bearing")?;
    let mut lost = Input::new(lost, "lost", 1)?;
    lost.expect(&[Some(steps + 1)], "one number for each bearing")?;
    let mut alarms = Input::new(alarms, "alarms", 1)?;
    alarms.expect(&[Some(steps + 1)], "one number for each bearing")?;
    let mut wanted = Input::new(wanted, "wanted", 1)?;
    let law = if guide == "headings" {
        wanted.expect(&[Some(steps)], "one heading for each step")?;
        None
    } else {
        wanted.expect(&[Some(1)], "the side")?;
        Some(crate::maneuver::law(guide)?)
    };
    let side = side_of(wanted.slice()?.first().copied().unwrap_or(1.0));
    let batch = Batch::of(&mut [&mut target, &mut noise, &mut lost, &mut alarms, &mut wanted])?;
    let (targets, noise, lost, alarms, wanted) = (
        target.items()?,
        noise.items()?,
        lost.items()?,
        alarms.items()?,
        wanted.items()?,
    );
    let cost = 50.0 * ((steps + 1) * (steps + 1)) as f64;
    batch.fill(py, &[steps + 1, PER_SAMPLE], cost, |range, threads, out| {
        let guide = match law {
            Some(law) => Guidance::Law(law, side),
            None => Guidance::Headings(wanted.skip(range.start)),
        };
        closed_loop::closed_loop(
            &setting,
            guide,
            Happens {
                targets: targets.skip(range.start),
                noise: noise.skip(range.start),
                lost: lost.skip(range.start),
                alarms: alarms.skip(range.start),
            },
            threads,
            out,
        );
    })
}

fn side_of(sign: f64) -> Side {
    if sign < 0.0 { Side::Left } else { Side::Right }
}

fn pair(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<[f64; 2]> {
    let input = Input::new(value, name, 1)?;
    input.expect(&[Some(2)], "east and north")?;
    let slice = input.slice()?;
    Ok([slice[0], slice[1]])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(maneuver_closed_loop, module)?)?;
    module.add_function(wrap_pyfunction!(plan_steered, module)?)?;
    module.add("PLAN_STATES", gramian::maneuver::planner::MOST_STATES)?;
    module.add_class::<PlanSearch>()
}
