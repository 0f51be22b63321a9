//! A target at constant velocity, seen by one moving observer.

use std::borrow::Cow;

use gramian::batch::{Items, Threads};
use gramian::chi_square::{self, Goodness};
use gramian::observability::Observability;
use gramian::solve::region::{Fineness, contours, interval};
use gramian::solve::{Combination, Model, Options, Solution, WithPrior};
use gramian::tracks::carrier::Carrier;
use gramian::tracks::scene::estimate::{self as kernel, Layout, Task};
use gramian::tracks::scene::{Channel, InSensor, Kind, Measured, Moving, Parameter, Scene};

use crate::misfit::Bearings;
use crate::{Answer, Limits, Question};

/// What is asked about: a scene, a state of its target, and what is known beforehand.
struct Asked {
    scene: Scene,
    state: Vec<f64>,
    /// Standard deviations, infinite where nothing is known.
    prior: Vec<f64>,
    times: Vec<f64>,
    kinds: Kinds,
    path_times: Vec<f64>,
    path: Vec<f64>,
}

/// The sensors: deviations of bearing (rad), range (m) and frequency (Hz), 0 for none,
/// and the speed of the wave (m/s).
#[derive(Clone, Copy)]
struct Kinds {
    sigma: [f64; 3],
    wave: f64,
}

impl Kinds {
    fn scene(self, carrier: &Carrier, times: &[f64], reference: f64) -> Result<Scene, String> {
        let kinds = [Kind::Bearing, Kind::Range, Kind::Frequency(self.wave)];
        let mut channels = Vec::new();
        let mut nuisances = 0;
        for (kind, sigma) in kinds.into_iter().zip(self.sigma) {
            if sigma == 0.0 {
                continue;
            }
            let carried = carrier.at(times).map_err(|error| error.to_string())?;
            let mut channel = Channel::new(kind, times.to_vec(), Some(carried), sigma);
            if matches!(kind, Kind::Frequency(_)) {
                channel.parameters[0] = Parameter::State(0);
                nuisances = 1;
            }
            channels.push(channel);
        }
        let moving = Moving::Polynomial { order: 1 };
        Scene::new(2, moving, reference, nuisances, channels).map_err(|error| error.to_string())
    }
}

impl Asked {
    /// Times and places of the path, times of the samples, sensors, state, prior.
    fn new(question: &mut Question<'_>) -> Result<Self, String> {
        let path_times = question.list()?.to_vec();
        let path = question.list()?.to_vec();
        let times = question.list()?.to_vec();
        let [bearing, range, frequency, wave] = question.array()?;
        let state = question.list()?.to_vec();
        let prior = question.list()?.to_vec();
        let carrier =
            Carrier::along(2, &path_times, &path, None, None).map_err(|error| error.to_string())?;
        let kinds = Kinds {
            sigma: [bearing, range, frequency],
            wave,
        };
        let reference = times.first().copied().unwrap_or(0.0);
        let scene = kinds.scene(&carrier, &times, reference)?;
        if scene.measurements() == 0 {
            return Err(String::from("no sensor sees the target"));
        }
        if state.len() != scene.states() || prior.len() != scene.states() {
            return Err(format!(
                "{} states and {} priors: {} are needed",
                state.len(),
                prior.len(),
                scene.states()
            ));
        }
        Ok(Self {
            scene,
            state,
            prior,
            times,
            kinds,
            path_times,
            path,
        })
    }

    fn rows(&self) -> Result<Vec<f64>, String> {
        self.scene.rows(&self.state).map_err(|e| e.to_string())
    }

    /// The prior as further rows.
    fn prior_rows(&self) -> Vec<f64> {
        let n = self.prior.len();
        let mut rows = Vec::new();
        for (k, &sigma) in self.prior.iter().enumerate() {
            if sigma.is_finite() {
                let at = rows.len();
                rows.resize(at + n, 0.0);
                rows[at + k] = 1.0 / sigma;
            }
        }
        rows
    }

    /// The deviation of each state that would be useless, as `gm.tracks.problem` has it:
    /// the range at first, and that over the time of the measurements.
    fn scale(&self) -> Vec<f64> {
        let (first, last) = (self.times[0], self.times[self.times.len() - 1]);
        let place = self
            .scene
            .channels()
            .find_map(|(channel, _)| channel.carrier.as_ref());
        let range = place.map_or(f64::NAN, |carried| {
            (self.state[0] - carried.place[0]).hypot(self.state[1] - carried.place[1])
        });
        let by_time = if last > first {
            range / (last - first)
        } else {
            f64::NAN
        };
        let mut scale = vec![f64::NAN; self.state.len()];
        if range > 0.0 {
            scale[..2].fill(range);
            scale[2..4].fill(by_time);
        }
        scale
    }

    /// Those that are given, or where there are none those of the state without noise.
    fn measurements<'a>(&self, given: &'a [f64]) -> Result<Cow<'a, [f64]>, String> {
        if given.is_empty() {
            let exact = self.scene.values(&self.state);
            return Ok(Cow::Owned(exact.map_err(|error| error.to_string())?));
        }
        Ok(Cow::Borrowed(given))
    }

    /// The scene with measurements and the prior, whose means are the state.
    fn model<'a>(&'a self, given: &'a [f64]) -> Result<WithPrior<Measured<'a>>, String> {
        let n = self.state.len();
        let measured = Measured::new(&self.scene, given, &[]).map_err(|error| error.to_string())?;
        let mut each = vec![0.0; n * n];
        each.iter_mut()
            .step_by(n + 1)
            .for_each(|entry| *entry = 1.0);
        Ok(WithPrior::new(measured, &each, &self.state, &self.prior))
    }

    /// Deviations of the target's place so long after the reference time.
    fn place_std(&self, found: &Observability<f64>, after: f64) -> Result<[f64; 2], String> {
        let mut out = [0.0; 2];
        for (axis, std) in out.iter_mut().enumerate() {
            *std = found
                .combination_std(&place(self.state.len(), axis, after))
                .map_err(|error| error.to_string())?;
        }
        Ok(out)
    }
}

fn chi2<M: Model<Error = InSensor>>(model: &M, state: &[f64]) -> Result<f64, String> {
    let mut residuals = vec![0.0; model.measurements()];
    model
        .linearize(state, &mut residuals, None)
        .map_err(|error| error.to_string())?;
    Ok(residuals.iter().map(|r| r * r).sum())
}

/// The combination of the states that is a coordinate of the target's place.
fn place(states: usize, axis: usize, after: f64) -> Vec<f64> {
    let mut combination = vec![0.0; states];
    combination[axis] = 1.0;
    combination[axis + 2] = after;
    combination
}

fn observed(rows: &[f64], n: usize) -> Result<Observability<f64>, String> {
    Observability::new(rows, n, None).map_err(|error| error.to_string())
}

/// The verdict and all that is shown beside it.
///
/// Behind the scene the names of the states and their units, as lines.
///
/// The answer: the verdict, see [`Answer::verdict`]; (rank, states, tolerance, logarithm of
/// the determinant); singular values on unit columns; the null space, vector by vector; bounds; bounds without the prior;
/// scales; the covariance (empty where it does not exist); the weakest direction; for each
/// sample the deviations east and north of the target at its time from all samples so
/// far; what the sensors read without noise.
///
/// # Errors
/// What is wrong with the scene, in words.
pub fn analyze(mut question: Question<'_>) -> Result<Answer, String> {
    let asked = Asked::new(&mut question)?;
    let n = asked.state.len();
    let rows = asked.rows()?;
    let prior = asked.prior_rows();
    let all = [rows.as_slice(), prior.as_slice()].concat();
    let found = observed(&all, n)?;
    let data = observed(&rows, n)?;
    let null_space = found.null_space().map_err(|error| error.to_string())?;
    let weakest = found
        .weakest_direction()
        .map_err(|error| error.to_string())?;

    // Reduced anew at each sample: a factor that grows row by row gathers rounding, which
    // before a turn is all there is of the fourth direction.
    let count = asked.times.len();
    let mut along = Vec::with_capacity(2 * count);
    let mut so_far = prior;
    for sample in 0..count {
        for sensor in 0..rows.len() / n / count {
            so_far.extend_from_slice(&rows[(sensor * count + sample) * n..][..n]);
        }
        let now = observed(&so_far, n)?;
        along.extend(asked.place_std(&now, asked.times[sample] - asked.times[0])?);
    }

    let mut answer = Answer::default();
    let (data_std, scale) = (data.crlb_std(), asked.scale());
    let limits = Limits {
        data_std: &data_std,
        scale: &scale,
        prior: &asked.prior,
        fit: None,
    };
    answer.verdict(&mut question, &found, limits)?;
    answer.list(&[found.rank() as f64, n as f64, found.rtol(), found.log_det()]);
    answer.list(found.singular_values());
    answer.list(&null_space.concat());
    answer.list(&found.crlb_std());
    answer.list(&data_std);
    answer.list(&scale);
    answer.list(&found.crlb().unwrap_or_default());
    answer.list(&weakest);
    answer.list(&along);
    answer.list(
        &asked
            .scene
            .values(&asked.state)
            .map_err(|e| e.to_string())?,
    );
    Ok(answer)
}

/// What the likelihood allows, its least chi2 at the state: measurements, none of them where
/// those of the state itself are meant, and other states that fit.
struct Likelihood<'a> {
    model: WithPrior<Measured<'a>>,
    best: Solution,
    others: Vec<Solution>,
}

impl<'a> Likelihood<'a> {
    fn new(asked: &'a Asked, given: &'a [f64], others: &[f64]) -> Result<Self, String> {
        let model = asked.model(given)?;
        let at = |x: &[f64]| -> Result<Solution, String> {
            Ok(Solution {
                chi2: chi2(&model, x)?,
                x: x.to_vec(),
                iterations: 0,
                converged: true,
                held: true,
                determined: true,
                slopes: Vec::new(),
            })
        };
        let best = at(&asked.state)?;
        let others = others
            .chunks_exact(asked.state.len())
            .filter_map(|x| at(x).ok())
            .collect();
        Ok(Self {
            model,
            best,
            others,
        })
    }
}

/// The likelihood region of the target's place so long after the first sample, at a level
/// of confidence: behind the scene (after, level, 1 for a rough one), the measurements and other
/// states that fit, one behind the other. The prior's means are those of the state.
///
/// The answer: the contours, each as points and then (closed, complete).
///
/// # Errors
/// As [`analyze`].
pub fn region(mut question: Question<'_>) -> Result<Answer, String> {
    let asked = Asked::new(&mut question)?;
    let [after, level, rough] = question.array()?;
    let given = asked.measurements(question.list()?)?;
    let likely = Likelihood::new(&asked, &given, question.list()?)?;
    let n = asked.state.len();
    let rise = chi_square::critical(1.0 - level, 2.0).map_err(|error| error.to_string())?;
    let functions = [0, 1].map(|axis| Combination(place(n, axis, after)));
    let found = contours(
        &likely.model,
        &likely.best,
        &likely.others,
        [&functions[0], &functions[1]],
        rise,
        if rough > 0.0 {
            Fineness::ROUGH
        } else {
            Fineness::default()
        },
        Options::default(),
    );
    let mut answer = Answer::default();
    for contour in found {
        answer.list(&contour.points.concat());
        answer.list(&[
            f64::from(u8::from(contour.closed)),
            f64::from(u8::from(contour.complete)),
        ]);
    }
    Ok(answer)
}

/// The values of each state that the likelihood allows: behind the scene (level), the
/// measurements and other states, as in [`region`].
///
/// The answer: for each state the ends of its pieces, ascending, infinite where there is
/// none.
///
/// # Errors
/// As [`analyze`].
pub fn intervals(mut question: Question<'_>) -> Result<Answer, String> {
    let asked = Asked::new(&mut question)?;
    let [level] = question.array()?;
    let given = asked.measurements(question.list()?)?;
    let likely = Likelihood::new(&asked, &given, question.list()?)?;
    let n = asked.state.len();
    let rise = chi_square::critical(1.0 - level, 1.0).map_err(|error| error.to_string())?;
    let mut answer = Answer::default();
    for state in 0..n {
        let mut function = Combination(vec![0.0; n]);
        function.0[state] = 1.0;
        let ask = |best: &Solution, others: &[Solution]| {
            interval(
                &likely.model,
                best,
                others,
                &function,
                rise,
                Options::default(),
            )
        };
        let mut found = ask(&likely.best, &likely.others);
        if let Some(better) = found.better {
            // What is allowed counts from there.
            let mut others = likely.others.clone();
            others.push(likely.best.clone());
            found = ask(&better, &others);
        }
        let ends: Vec<f64> = found
            .pieces
            .iter()
            .flat_map(|piece| {
                [
                    piece.low.unwrap_or(f64::NEG_INFINITY),
                    piece.high.unwrap_or(f64::INFINITY),
                ]
            })
            .collect();
        answer.list(&ends);
    }
    Ok(answer)
}

/// How well other states fit: behind the scene the measurements, as in [`region`], and
/// the states, one behind the other.
///
/// The answer: chi-square of each state, the prior's included; infinite where a sensor
/// reads nothing.
///
/// # Errors
/// As [`analyze`].
pub fn fits(mut question: Question<'_>) -> Result<Answer, String> {
    let asked = Asked::new(&mut question)?;
    let given = asked.measurements(question.list()?)?;
    let model = asked.model(&given)?;
    let found: Vec<f64> = question
        .list()?
        .chunks_exact(asked.state.len())
        .map(|state| chi2(&model, state).unwrap_or(f64::INFINITY))
        .collect();
    let mut answer = Answer::default();
    answer.list(&found);
    Ok(answer)
}

/// What a further straight leg at each heading would give: behind the scene (speed,
/// duration, samples, headings).
///
/// The answer: for each heading, from north clockwise in equal steps, the deviations east
/// and north of the target at the end of the leg.
///
/// # Errors
/// As [`analyze`].
pub fn headings(mut question: Question<'_>) -> Result<Answer, String> {
    let asked = Asked::new(&mut question)?;
    let [speed, duration, samples, headings] = question.array()?;
    let n = asked.state.len();
    let mut before = asked.prior_rows();
    before.extend(asked.rows()?);
    let (start, first) = (asked.path_times[asked.path_times.len() - 1], asked.times[0]);
    let end = &asked.path[asked.path.len() - 2..];
    let share = |k: u32, of: f64| f64::from(k) / of;
    // Both are small whole numbers.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let (samples, headings) = (
        samples.clamp(1.0, 1e3) as u32,
        headings.clamp(1.0, 360.0) as u32,
    );
    let times: Vec<f64> = (1..=samples)
        .map(|k| start + duration * share(k, f64::from(samples)))
        .collect();
    let last = times[times.len() - 1];
    let mut out = Vec::new();
    for k in 0..headings {
        let (east, north) = (core::f64::consts::TAU * share(k, f64::from(headings))).sin_cos();
        let there = [
            end[0],
            end[1],
            end[0] + speed * (last - start) * east,
            end[1] + speed * (last - start) * north,
        ];
        let carrier = Carrier::along(2, &[start, last], &there, None, None)
            .map_err(|error| error.to_string())?;
        let scene = asked.kinds.scene(&carrier, &times, first)?;
        // A heading that runs over the target has no answer.
        let Ok(rows) = scene.rows(&asked.state) else {
            out.extend([f64::INFINITY; 2]);
            continue;
        };
        let found = observed(&[before.as_slice(), rows.as_slice()].concat(), n)?;
        out.extend(asked.place_std(&found, last - first)?);
    }
    let mut answer = Answer::default();
    answer.list(&out);
    Ok(answer)
}

/// The most likely state of measurements, which stand behind the scene; NaN is a missing
/// one. The prior's means are those of the state.
///
/// Behind the measurements the names of the states, as lines.
///
/// The answer: the status and the reason, as lines of text, at the levels of
/// `gm.tracks.estimate`; the state; the next best solution, empty where there is none.
///
/// # Errors
/// As [`analyze`].
pub fn estimate(mut question: Question<'_>) -> Result<Answer, String> {
    let asked = Asked::new(&mut question)?;
    let measurements = question.list()?;
    let n = asked.scene.states();
    let task = Task {
        scene: &asked.scene,
        known: &vec![f64::NAN; n],
        mean: &asked.state,
        sigma: &asked.prior,
        options: kernel::Options::default(),
    };
    if measurements.len() != asked.scene.measurements() {
        return Err(format!(
            "{} measurements: {} are needed",
            measurements.len(),
            asked.scene.measurements()
        ));
    }
    let mut out = vec![0.0; Layout { states: n }.size()];
    kernel::estimate(
        task,
        Items::shared(measurements),
        None,
        Threads::One,
        &mut out,
    )
    .map_err(|error| error.to_string())?;
    let mut verdict = task.judge(&out, Goodness::ALPHA, Task::WEAK_RATIO);
    // State, covariance, null direction, the next best solution, costs.
    let (state, rest) = out.split_at(n);
    let (unseen, rest) = rest[n * n..].split_at(n);
    let (next, costs) = rest.split_at(n);
    let names = question.lines()?;
    let mut reason = None;
    let bearings = asked.kinds.sigma[0];
    // A file has bearings alone, and nothing is known beside them.
    if verdict.status != kernel::Status::Unobservable
        && asked.kinds.sigma == [bearings, 0.0, 0.0]
        && asked.prior.iter().all(|sigma| sigma.is_infinite())
    {
        let measured = Measured::new(&asked.scene, measurements, &[]);
        let said = Bearings {
            model: &measured.map_err(|error| error.to_string())?,
            values: measurements,
            times: &asked.times,
            reference: asked.times[0],
            sigma: bearings,
            state,
        }
        .misfit(Goodness::ALPHA)?;
        if !said.is_empty() {
            verdict.status = kernel::Status::Misfit;
            reason = Some(said);
        }
    }
    let reason = reason.unwrap_or_else(|| verdict.reason(costs[0], costs[1], unseen, &names));
    let mut answer = Answer::default();
    answer.text(&format!("{}\n{reason}", verdict.status.name()));
    answer.list(state);
    answer.list(if costs[1].is_finite() { next } else { &[] });
    Ok(answer)
}
