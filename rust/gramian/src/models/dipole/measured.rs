//! The record of a pass as a [`Model`]: what every question about an estimate is put to.
//!
//! The states are those of (r0, v, m) that are not known, those of a [`Description`] that says
//! more, and a constant field of each channel where it is fitted. A vector of known size is told by angles: the one from
//! the axis along which it is smallest, where they are regular, and the one about it.

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec;
use alloc::vec::Vec;

use super::description::{Description, MOST, Motion, Step};
use super::localize::{Knowledge, MOMENT, SPEED, huber, robust_sigma};
use super::quadrupole::{Entries, Whole};
use super::sensors::{Head, Sensors, excess};
use super::{Error, Jacobian, Pass, jacobian, quadrupole};
use crate::numbers::algebra::{dot, multiply};
use crate::numbers::angle::wrapped;
use crate::solve::Model;
use crate::solve::fit::Fit;
use crate::solve::noise::{Left, Whitening};

/// Names of the states.
const NAMES: [&str; 9] = ["x0", "y0", "z0", "vx", "vy", "vz", "mx", "my", "mz"];
const AXES: [&str; 3] = ["x", "y", "z"];
const UNITS: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// How the components of one vector follow from the states of the model.
#[derive(Clone, Copy, Debug)]
enum Part {
    /// Each that is not known is a state.
    Components,
    /// Two free components of a known size: one angle, in the plane of the two.
    Circle { first: usize, second: usize },
    /// Three: the angle from an axis, and the one about it.
    Sphere { axis: usize },
    /// One, of a known sign: nothing is left.
    Side { index: usize, sign: f64 },
}

/// A recording of a pass, and what is known of it.
///
/// ```
/// use gramian::dipole::Sensors;
/// use gramian::dipole::localize::Knowledge;
/// use gramian::dipole::measured::Measured;
/// use gramian::solve::{Model, noise::Whitening};
/// let near = [-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0];
/// let mut knowledge = Knowledge::default();
/// knowledge.exact[2] = Some(5.0);
/// let noise = Whitening::white(vec![1e9; 6], 3);
/// let sensors = Sensors::vector(&[[0.0; 3]]);
/// let record = Measured::new(&[0.0, 1.0], &sensors, &[0.0; 6], noise, false, knowledge, &near);
/// assert_eq!(record.names(), ["x0", "y0", "vx", "vy", "vz", "mx", "my", "mz"]);
/// let x = record.coordinates(&near);
/// assert_eq!(record.expand(&x).0, near);
/// ```
#[derive(Clone, Debug)]
pub struct Measured {
    /// Since the instant of the state, s.
    times: Vec<f64>,
    places: Vec<[f64; 3]>,
    baselines: Vec<[f64; 3]>,
    ambient: Option<[f64; 3]>,
    /// (K, S, components), T.
    field: Vec<f64>,
    noise: Whitening,
    /// The channels whose constant is a state.
    constants: Vec<usize>,
    knowledge: Knowledge,
    /// Of position, velocity and moment.
    parts: [Part; 3],
    /// A pass near the one looked for.
    near: [f64; 9],
    description: Description,
    /// Of a quadrupole.
    entries: Entries,
}

/// Where the states of each kind begin.
#[derive(Clone, Copy, Debug)]
struct Layout {
    motion: usize,
    sources: usize,
    quadrupole: usize,
    induced: usize,
    attitude: usize,
    scale: usize,
    constants: usize,
    drifts: usize,
    end: usize,
}

/// What one head of a sensor sees of the body at one time.
struct Sight {
    step: Step,
    /// Where the body is, from the head, m.
    place: [f64; 3],
    /// Whether it is the first head of its sensor, or the last, and by what it counts.
    first: bool,
    last: bool,
    sign: f64,
    /// Of a sensor of the total field: direction of the field, and its size beside the ambient.
    total: Option<([f64; 3], f64)>,
    /// T.
    field: [f64; 3],
    /// Of each dipole.
    jacobians: [Jacobian<f64>; MOST],
    /// By the place of the body, of all dipoles.
    by_place: [[f64; 3]; 3],
    /// By the five numbers of the quadrupole in the body's axes, and by the rate of its turn.
    by_quadrupole: [[f64; 3]; 5],
    by_turn: [f64; 3],
}

impl Sight {
    /// What a change of the field at the head changes of the numbers of the sensor.
    #[inline(always)]
    fn read(&self, v: &[f64; 3], mut put: impl FnMut(usize, f64)) {
        match &self.total {
            None => (0..3).for_each(|i| put(i, self.sign * v[i])),
            Some((along, _)) => put(0, self.sign * dot(along, v)),
        }
    }

    /// What the head adds to the numbers of the sensor, by the field as it gives it.
    #[inline(always)]
    fn add(&self, v: &[f64; 3], mut put: impl FnMut(usize, f64)) {
        match &self.total {
            None => (0..3).for_each(|i| put(i, self.sign * v[i])),
            Some((_, beside)) => put(0, self.sign * beside),
        }
    }
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

fn three(x: &[f64]) -> [f64; 3] {
    core::array::from_fn(|i| x[i])
}

impl Measured {
    /// `times` count from the instant of the state. `field` is (K, S, components), as the
    /// numbers of `noise`, and of the total field what is beside [`Sensors::quiet`]; with `offsets` a constant of each channel that counts is a state. `near` is a
    /// pass near the one looked for: it chooses between angles, and between the signs that a
    /// known size leaves open.
    pub fn new(
        times: &[f64],
        sensors: &Sensors<'_>,
        field: &[f64],
        noise: Whitening,
        offsets: bool,
        knowledge: Knowledge,
        near: &[f64; 9],
    ) -> Self {
        let part = |first: usize, size: Option<f64>| {
            let free: Vec<usize> = (first..first + 3)
                .filter(|&i| knowledge.exact[i].is_none())
                .collect();
            match (size, free.as_slice()) {
                (Some(_), &[first, second]) => Part::Circle { first, second },
                (Some(_), &[a, b, c]) => {
                    let axis = [a, b, c]
                        .into_iter()
                        .min_by(|&i, &j| near[i].abs().total_cmp(&near[j].abs()))
                        .unwrap_or(a);
                    Part::Sphere { axis }
                }
                (Some(_), &[index]) => Part::Side {
                    index,
                    sign: if near[index] < 0.0 { -1.0 } else { 1.0 },
                },
                _ => Part::Components,
            }
        };
        let channels = sensors.channels();
        let counts = |c: &usize| {
            noise
                .factors()
                .iter()
                .skip(*c)
                .step_by(channels)
                .any(|w| *w > 0.0)
        };
        let constants = (0..if offsets { channels } else { 0 })
            .filter(counts)
            .collect();
        Self {
            times: times.to_vec(),
            places: sensors.places.to_vec(),
            baselines: sensors.baselines.to_vec(),
            ambient: sensors.ambient,
            field: field.to_vec(),
            constants,
            noise,
            knowledge,
            parts: [
                part(0, None),
                part(3, knowledge.exact[SPEED]),
                part(6, knowledge.exact[MOMENT]),
            ],
            near: *near,
            description: Description::default(),
            entries: Entries::default(),
        }
    }

    fn sensors(&self) -> Sensors<'_> {
        Sensors {
            places: &self.places,
            baselines: &self.baselines,
            ambient: self.ambient,
        }
    }

    /// The channels whose constant is a state, in the order of these states, the last but for
    /// drifts.
    pub fn constants(&self) -> &[usize] {
        &self.constants
    }

    /// The same record, explained by more than one dipole on a straight pass.
    #[must_use]
    pub fn with(mut self, description: Description) -> Self {
        self.description = description;
        self.description.sources = description.sources.clamp(1, MOST);
        if let Some(centre) = description.quadrupole {
            self.entries = Entries::new(centre, &three(&self.near[6..]));
        }
        self
    }

    fn layout(&self) -> Layout {
        let own = self.parts.iter().enumerate().map(|(k, part)| match part {
            Part::Components => (3 * k..3 * k + 3)
                .filter(|&i| self.knowledge.exact[i].is_none())
                .count(),
            Part::Circle { .. } => 1,
            Part::Sphere { .. } => 2,
            Part::Side { .. } => 0,
        });
        let (about, sensors) = (&self.description, self.places.len());
        let motion = own.sum();
        let sources = motion + about.motion.states();
        let quadrupole = sources + 6 * (about.sources - 1);
        let induced = quadrupole + about.quadrupole.map_or(0, |_| self.entries.free().len());
        let attitude = induced + usize::from(about.induced.is_some());
        let scale = attitude
            + if about.attitude.is_some() {
                3 * sensors
            } else {
                0
            };
        let constants = scale + if about.scale.is_some() { sensors } else { 0 };
        let drifts = constants + self.constants.len();
        let end = drifts + if about.drift { self.constants.len() } else { 0 };
        Layout {
            motion,
            sources,
            quadrupole,
            induced,
            attitude,
            scale,
            constants,
            drifts,
            end,
        }
    }

    /// Offset and moment of a dipole, in the body.
    fn source(&self, state: &[f64; 9], x: &[f64], index: usize) -> ([f64; 3], [f64; 3]) {
        if index == 0 {
            return ([0.0; 3], three(&state[6..]));
        }
        let first = self.layout().sources + 6 * (index - 1);
        (three(&x[first..]), three(&x[first + 3..]))
    }

    /// The five numbers of the quadrupole, in the body's axes, and their derivatives by each
    /// state; zeros without one.
    pub fn quadrupole(&self, x: &[f64]) -> ([f64; 5], Vec<[f64; 5]>) {
        let (state, columns) = self.expand(x);
        let mut by = vec![[0.0; 5]; x.len()];
        let Some(whole) = self.whole(&state, x) else {
            return ([0.0; 5], by);
        };
        let at = self.layout();
        for (by, column) in by.iter_mut().zip(&columns[..at.motion]) {
            *by = whole.along(&three(&column[6..]));
        }
        by[at.quadrupole..at.induced].copy_from_slice(&whole.by_free[..at.induced - at.quadrupole]);
        (whole.entries, by)
    }

    fn whole(&self, state: &[f64; 9], x: &[f64]) -> Option<Whole> {
        self.description.quadrupole?;
        let at = self.layout();
        let moment = three(&state[6..]);
        Some(self.entries.whole(&moment, &x[at.quadrupole..at.induced]))
    }

    /// Where the body is at a time since the instant of the state, and the derivatives of that
    /// by each state.
    pub fn place(&self, x: &[f64], t: f64) -> ([f64; 3], Vec<[f64; 3]>) {
        let (state, columns) = self.expand(x);
        let at = self.layout();
        let step = self
            .description
            .motion
            .at(&state, &x[at.motion..at.sources], t);
        let mut by: Vec<[f64; 3]> = columns.iter().map(|c| moved(&step, c)).collect();
        for (out, more) in by[at.motion..at.sources].iter_mut().zip(&step.by_more) {
            *out = *more;
        }
        (step.place, by)
    }

    fn sight(
        &self,
        state: &[f64; 9],
        x: &[f64],
        whole: Option<&Whole>,
        t: f64,
        head: &Head<f64>,
    ) -> Result<Sight, Error> {
        let at = self.layout();
        let step = self
            .description
            .motion
            .at(state, &x[at.motion..at.sources], t);
        let none = Jacobian {
            position: [[0.0; 3]; 3],
            moment: [[0.0; 3]; 3],
        };
        let mut sight = Sight {
            step,
            place: core::array::from_fn(|i| step.place[i] - head.place[i]),
            first: true,
            last: true,
            sign: head.sign,
            total: None,
            field: [0.0; 3],
            jacobians: [none; MOST],
            by_place: [[0.0; 3]; 3],
            by_quadrupole: [[0.0; 3]; 5],
            by_turn: [0.0; 3],
        };
        for index in 0..self.description.sources {
            let (offset, moment) = self.source(state, x, index);
            let (offset, mut moment) = (step.turn(&offset), step.turn(&moment));
            if let Some(ambient) = self.description.induced.filter(|_| index == 0) {
                for (m, a) in moment.iter_mut().zip(ambient) {
                    *m += x[at.induced] * a;
                }
            }
            let place: [f64; 3] =
                core::array::from_fn(|i| step.place[i] + offset[i] - head.place[i]);
            let own = jacobian(&place, &moment)?;
            for i in 0..3 {
                sight.field[i] += dot(&own.moment[i], &moment);
                for k in 0..3 {
                    sight.by_place[i][k] += own.position[i][k];
                }
            }
            sight.jacobians[index] = own;
        }
        if let Some(whole) = whole {
            let [lies, turns] = step.turn_tensor(&quadrupole::tensor(&whole.entries));
            let (lies, turns) = (quadrupole::entries(&lies), quadrupole::entries(&turns));
            let own = quadrupole::jacobian(&sight.place, &lies)?;
            let of = |entries: &[f64; 5]| weighed(&own.quadrupole, entries);
            for (i, h) in of(&lies).into_iter().enumerate() {
                sight.field[i] += h;
                for k in 0..3 {
                    sight.by_place[i][k] += own.position[i][k];
                }
            }
            sight.by_turn = of(&turns);
            for (k, by) in sight.by_quadrupole.iter_mut().enumerate() {
                let mut unit = [0.0; 5];
                unit[k] = 1.0;
                let [lies, _] = step.turn_tensor(&quadrupole::tensor(&unit));
                *by = of(&quadrupole::entries(&lies));
            }
        }
        if let Some(ambient) = &self.ambient {
            let (beside, along) = excess(ambient, &sight.field)?;
            sight.total = Some((along, beside));
        }
        Ok(sight)
    }

    /// How a channel is called.
    fn channel(&self, index: usize) -> String {
        let components = self.sensors().components();
        // The total field has this letter.
        let axis = if components == 1 {
            "F"
        } else {
            AXES[index % 3]
        };
        if self.places.len() == 1 {
            axis.to_string()
        } else {
            format!("{axis} of sensor {}", index / components + 1)
        }
    }

    /// Names of the states.
    pub fn names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for (k, part) in self.parts.iter().enumerate() {
            let letter = ["r", "v", "m"][k];
            match part {
                Part::Components => names.extend(
                    (3 * k..3 * k + 3)
                        .filter(|&i| self.knowledge.exact[i].is_none())
                        .map(|i| NAMES[i].to_string()),
                ),
                Part::Circle { first, second } => {
                    let axis = AXES[(3 - first % 3 - second % 3) % 3];
                    names.push(format!("{letter} about {axis}"));
                }
                Part::Sphere { axis } => {
                    let axis = AXES[axis % 3];
                    names.push(format!("{letter} from {axis}"));
                    names.push(format!("{letter} about {axis}"));
                }
                Part::Side { .. } => {}
            }
        }
        self.names_of_more(&mut names);
        names
    }

    fn names_of_more(&self, names: &mut Vec<String>) {
        let about = &self.description;
        names.extend(about.motion.names().0.iter().map(ToString::to_string));
        for index in 1..about.sources {
            names.extend(Description::source(index).map(|(name, _)| name));
        }
        if about.quadrupole.is_some() {
            let free = self.entries.free().iter();
            names.extend(free.map(|&k| quadrupole::NAMES[k].to_string()));
        }
        if about.induced.is_some() {
            names.push("induced volume".to_string());
        }
        let of = |s: usize| {
            if self.places.len() == 1 {
                String::new()
            } else {
                format!(" of sensor {}", s + 1)
            }
        };
        for s in 0..self.places.len() {
            if about.attitude.is_some() {
                names.extend(AXES.map(|axis| format!("attitude {axis}{}", of(s))));
            }
        }
        for s in 0..self.places.len() {
            if about.scale.is_some() {
                names.push(format!("scale{}", of(s)));
            }
        }
        let each = |what: &str| -> Vec<String> {
            let constants = self.constants.iter();
            constants
                .map(|&c| format!("{what} {}", self.channel(c)))
                .collect()
        };
        names.extend(each("background"));
        if about.drift {
            names.extend(each("drift"));
        }
    }

    /// Units of the states.
    pub fn units(&self) -> Vec<&'static str> {
        let unit = |name: &String| match name.as_str() {
            name if name.starts_with("background") => "T",
            name if name.starts_with("drift") => "T/s",
            name if name.starts_with("scale") => "",
            "induced volume" => "m^3",
            name if name.contains(" of dipole ") && name.starts_with('d') => "m",
            name if name.contains(" of dipole ") => "A m^2",
            name if self.description.motion.names().0.contains(&name) => {
                self.description.motion.names().1
            }
            name if name.starts_with('Q') => "A m^3",
            name if name.contains(' ') => "rad",
            name if name.ends_with('0') => "m",
            name if name.starts_with('v') => "m/s",
            _ => "A m^2",
        };
        self.names().iter().map(unit).collect()
    }

    /// What a known size leaves for the components of a vector that are free.
    fn size(&self, part: usize) -> f64 {
        let whole = self.knowledge.exact[SPEED + part - 1].unwrap_or(0.0);
        let fixed: f64 = self.knowledge.exact[3 * part..3 * part + 3]
            .iter()
            .flatten()
            .map(|x| x * x)
            .sum();
        (whole * whole - fixed).max(0.0).sqrt()
    }

    /// The states of a pass; all that is beside it 0.
    pub fn coordinates(&self, state: &[f64; 9]) -> Vec<f64> {
        let mut x = Vec::new();
        for (k, part) in self.parts.iter().enumerate() {
            match *part {
                Part::Components => x.extend(
                    (3 * k..3 * k + 3)
                        .filter(|&i| self.knowledge.exact[i].is_none())
                        .map(|i| state[i]),
                ),
                Part::Circle { first, second } => x.push(state[second].atan2(state[first])),
                Part::Sphere { axis } => {
                    let (a, b) = beside(axis);
                    x.push(state[a].hypot(state[b]).atan2(state[axis]));
                    x.push(state[b].atan2(state[a]));
                }
                Part::Side { .. } => {}
            }
        }
        x.resize(self.layout().end, 0.0);
        x
    }

    /// The pass (r0, v, m) of these states, and its derivatives by each: 9 for each state.
    pub fn expand(&self, x: &[f64]) -> ([f64; 9], Vec<[f64; 9]>) {
        let mut state = [0.0; 9];
        let mut columns = vec![[0.0; 9]; x.len()];
        for (value, known) in state.iter_mut().zip(&self.knowledge.exact) {
            *value = known.unwrap_or(0.0);
        }
        let mut next = 0;
        for (k, part) in self.parts.iter().enumerate() {
            match *part {
                Part::Components => {
                    for i in 3 * k..3 * k + 3 {
                        if self.knowledge.exact[i].is_none() {
                            state[i] = x[next];
                            columns[next][i] = 1.0;
                            next += 1;
                        }
                    }
                }
                Part::Circle { first, second } => {
                    let (sin, cos) = x[next].sin_cos();
                    let size = self.size(k);
                    state[first] = size * cos;
                    state[second] = size * sin;
                    columns[next][first] = -size * sin;
                    columns[next][second] = size * cos;
                    next += 1;
                }
                Part::Sphere { axis } => {
                    let (a, b) = beside(axis);
                    let ((sin, cos), (s, c)) = (x[next].sin_cos(), x[next + 1].sin_cos());
                    let size = self.size(k);
                    state[axis] = size * cos;
                    state[a] = size * sin * c;
                    state[b] = size * sin * s;
                    columns[next][axis] = -size * sin;
                    columns[next][a] = size * cos * c;
                    columns[next][b] = size * cos * s;
                    columns[next + 1][a] = -size * sin * s;
                    columns[next + 1][b] = size * sin * c;
                    next += 2;
                }
                Part::Side { index, sign } => state[index] = sign * self.size(k),
            }
        }
        (state, columns)
    }

    /// What each head of each sensor sees at each sample, with the first number, the time and
    /// the sensor.
    fn sights(
        &self,
        x: &[f64],
        mut each: impl FnMut(usize, f64, usize, &Sight),
    ) -> Result<(), Error> {
        let (state, _) = self.expand(x);
        let whole = self.whole(&state, x);
        let sensors = self.sensors();
        let heads = if self.baselines.is_empty() { 1 } else { 2 };
        let mut first = 0;
        for (k, &t) in self.times.iter().enumerate() {
            for s in 0..self.places.len() {
                for (index, head) in sensors.heads(s).enumerate() {
                    let sight = self.sight(&state, x, whole.as_ref(), t, &head);
                    let mut sight = sight.map_err(|e| e.at(k))?;
                    sight.first = index == 0;
                    sight.last = index + 1 == heads;
                    each(first, t, s, &sight);
                }
                first += sensors.components();
            }
        }
        Ok(())
    }

    /// The residuals of the fields, and the rows, not whitened.
    fn raw(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        mut rows: Option<&mut [f64]>,
    ) -> Result<(), Error> {
        let n = x.len();
        let (state, columns) = self.expand(x);
        let (at, about) = (self.layout(), self.description);
        let whole = self.whole(&state, x);
        let mut constant = vec![None; self.channels()];
        for (k, &channel) in self.constants.iter().enumerate() {
            constant[channel] = Some(k);
        }
        let middle = self.middle();
        let components = self.sensors().components();
        let level = |channel: usize, t: f64| {
            constant[channel].map_or(0.0, |k: usize| {
                let drift = if about.drift { x[at.drifts + k] } else { 0.0 };
                x[at.constants + k] + drift * (t - middle)
            })
        };
        self.sights(x, |first, t, s, sight| {
            let tilt = about.attitude.map(|_| three(&x[at.attitude + 3 * s..]));
            let tilt = tilt.unwrap_or_default();
            let gain = about.scale.map_or(1.0, |_| 1.0 + x[at.scale + s]);
            // As the sensor gives it: turned a little, and scaled.
            let seen = |v: &[f64; 3]| -> [f64; 3] {
                let across = cross(&tilt, v);
                core::array::from_fn(|i| gain * (v[i] - across[i]))
            };
            let h = seen(&sight.field);
            sight.add(&h, |i, value| {
                let out = &mut residuals[first + i];
                // The heads together first: each may be so large that it swallows the field, which
                // a difference of 0 would then seem to explain.
                *out = if sight.first { value } else { *out + value };
                if sight.last {
                    *out = self.field[first + i] - *out - level(components * s + i, t);
                }
            });
            let Some(rows) = rows.as_deref_mut() else {
                return;
            };
            let mut put = |column: usize, v: &[f64; 3]| {
                sight.read(v, |i, value| {
                    let out = &mut rows[(first + i) * n + column];
                    *out = if sight.first { value } else { *out + value };
                });
            };
            let (step, own) = (&sight.step, &sight.jacobians);
            for (k, column) in columns[..at.motion].iter().enumerate() {
                let by_place = multiply(&sight.by_place, &moved(step, column));
                let turned = multiply(&own[0].moment, &step.turn(&three(&column[6..])));
                let mut by = sum(by_place, turned);
                if let Some(whole) = &whole {
                    let more = whole.along(&three(&column[6..]));
                    by = sum(by, weighed(&sight.by_quadrupole, &more));
                }
                put(k, &seen(&by));
            }
            for k in at.motion..at.sources {
                let mut by = multiply(&sight.by_place, &step.by_more[k - at.motion]);
                for index in 0..about.sources {
                    let (offset, moment) = self.source(&state, x, index);
                    let place = multiply(&own[index].position, &step.turn_by_rate(&offset));
                    let turned = multiply(&own[index].moment, &step.turn_by_rate(&moment));
                    by = sum(by, sum(place, turned));
                }
                put(k, &seen(&sum(by, sight.by_turn)));
            }
            if let Some(whole) = &whole {
                for (k, by) in (at.quadrupole..at.induced).zip(&whole.by_free) {
                    put(k, &seen(&weighed(&sight.by_quadrupole, by)));
                }
            }
            for index in 1..about.sources {
                let column = at.sources + 6 * (index - 1);
                for (axis, unit) in UNITS.iter().enumerate() {
                    let unit = step.turn(unit);
                    put(column + axis, &seen(&multiply(&own[index].position, &unit)));
                    put(
                        column + 3 + axis,
                        &seen(&multiply(&own[index].moment, &unit)),
                    );
                }
            }
            if let Some(ambient) = about.induced {
                put(at.induced, &seen(&multiply(&own[0].moment, &ambient)));
            }
            for k in at.attitude..at.constants {
                put(k, &[0.0; 3]);
            }
            if about.attitude.is_some() {
                for (axis, unit) in UNITS.iter().enumerate() {
                    let across = cross(unit, &sight.field);
                    put(at.attitude + 3 * s + axis, &across.map(|c| -gain * c));
                }
            }
            if about.scale.is_some() {
                put(at.scale + s, &h.map(|h| h / gain));
            }
            for i in 0..components {
                let row = &mut rows[(first + i) * n..][..n];
                self.put_level(&at, constant[components * s + i], t - middle, row);
            }
        })
    }

    /// The columns of a constant and a drift of a channel, if they are states.
    fn put_level(&self, at: &Layout, constant: Option<usize>, since: f64, row: &mut [f64]) {
        row[at.constants..].fill(0.0);
        if let Some(k) = constant {
            row[at.constants + k] = 1.0;
            if self.description.drift {
                row[at.drifts + k] = since;
            }
        }
    }

    /// From where drifts count.
    fn middle(&self) -> f64 {
        self.times.iter().sum::<f64>() / self.times.len().max(1) as f64
    }

    /// Where a further dipole may be: for the most promising places about the body, best
    /// first, the states with it, of the description with one more dipole.
    ///
    /// # Errors
    /// Where a dipole meets a sensor.
    pub fn seeds(&self, x: &[f64], most: usize) -> Result<Vec<Vec<f64>>, Error> {
        let m = self.field.len();
        let fit = Fit::new(self, x)?;
        let at = self.layout();
        let range = self.nearest(x);
        let mut found: Vec<(f64, Vec<f64>)> = Vec::new();
        for cell in (0..27).filter(|&cell| cell != 13) {
            let direction = [cell % 3, cell / 3 % 3, cell / 9].map(|i| f64::from(i) - 1.0);
            let length = dot(&direction, &direction).sqrt();
            for share in [0.1, 0.25, 0.6] {
                let offset = direction.map(|d| d / length * share * range);
                // Rows of priors see nothing of it.
                let mut columns = vec![0.0; 3 * (m + self.priors())];
                let mut sound = true;
                self.sights(x, |first, _, _, sight| {
                    let turned = sight.step.turn(&offset);
                    let place: [f64; 3] = core::array::from_fn(|i| sight.place[i] + turned[i]);
                    match jacobian(&place, &[0.0; 3]) {
                        Ok(own) => {
                            for (axis, unit) in UNITS.iter().enumerate() {
                                let unit = sight.step.turn(unit);
                                let seen = [0, 1, 2].map(|i| dot(&own.moment[i], &unit));
                                sight.read(&seen, |i, value| {
                                    columns[3 * (first + i) + axis] += value;
                                });
                            }
                        }
                        Err(_) => sound = false,
                    }
                })?;
                if !sound {
                    continue;
                }
                self.noise.apply_rows(&mut columns[..3 * m], 3);
                let score = fit.score(&columns, 3, 1e-3, 0.8);
                let mut start = x[..at.quadrupole].to_vec();
                start.extend(offset);
                start.extend(score.size);
                start.extend(&x[at.quadrupole..]);
                found.push((score.statistic, start));
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(most);
        Ok(found.into_iter().map(|(_, start)| start).collect())
    }

    /// The least distance of the body from a sensor, at the samples.
    fn nearest(&self, x: &[f64]) -> f64 {
        let mut least = f64::INFINITY;
        for &t in &self.times {
            let (place, _) = self.place(x, t);
            for sensor in &self.places {
                let apart: [f64; 3] = core::array::from_fn(|i| place[i] - sensor[i]);
                least = least.min(dot(&apart, &apart).sqrt());
            }
        }
        least
    }

    /// How much each number counts under Huber's loss at a state, what these weights are to be
    /// multiplied by, and the standard deviation of the noise where none is given. The numbers
    /// of the record count by 1 or 0.
    ///
    /// # Errors
    /// Where the dipole meets a sensor.
    pub fn robust(&self, x: &[f64], sigma: Option<f64>) -> Result<(Vec<f64>, f64, f64), Error> {
        let m = self.field.len();
        let mut left = vec![0.0; m];
        self.raw(x, &mut left, None)?;
        let mut strength = vec![0.0; m];
        self.sights(x, |first, _, _, sight| {
            sight.add(&sight.field, |i, value| strength[first + i] += value);
        })?;
        for value in &mut strength {
            *value = value.abs();
        }
        self.noise.apply(&mut left);
        let counts: Vec<f64> = self
            .noise
            .factors()
            .iter()
            .map(|f| f64::from(u8::from(*f > 0.0)))
            .collect();
        let fitted = x.len() as f64;
        let sigma = sigma.unwrap_or_else(|| robust_sigma(&left, &strength, &counts, fitted));
        let mut weights = counts.clone();
        let efficiency = huber(&left, &counts, sigma, fitted, &mut weights);
        Ok((weights, efficiency, sigma))
    }

    /// Correlation of neighbouring samples and standard deviation of the noise at a state,
    /// by restricted maximum likelihood; a `sigma` that is known is kept. `times` of the record
    /// are `spacing` apart where nothing is missing, and numbers count by their weights.
    ///
    /// # Errors
    /// Where the dipole meets a sensor.
    pub fn noise(&self, x: &[f64], spacing: f64, sigma: Option<f64>) -> Result<(f64, f64), Error> {
        let m = self.field.len();
        let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * x.len()]);
        self.raw(x, &mut residuals, Some(&mut rows))?;
        let counts: Vec<f64> = self.noise.factors().iter().map(|w| w * w).collect();
        let left = Left {
            times: &self.times,
            channels: self.channels(),
            counts: &counts,
            residuals: &residuals,
            rows: &rows,
            spacing,
        };
        Ok(left.estimate(sigma))
    }

    /// A quadrupole as an alternative, not whitened: the part of it that is no move of the place
    /// where this is free.
    fn quadrupole_beside(
        &self,
        x: &[f64],
        moment: &[f64; 3],
    ) -> Result<Option<(String, Vec<f64>, usize)>, Error> {
        if self.description.quadrupole.is_some() {
            return Ok(None);
        }
        let known = &self.knowledge;
        let centre = [0, 1, 2].map(|i| known.exact[i].is_none() && known.prior[i].is_none());
        let entries = Entries::new(centre, moment);
        let count = entries.free().len();
        let whole = entries.whole(moment, &[0.0; 5][..count]);
        let mut columns = vec![0.0; count * self.field.len()];
        let mut sound = true;
        self.sights(x, |first, _, _, sight| {
            for (k, by) in whole.by_free[..count].iter().enumerate() {
                let [lies, _] = sight.step.turn_tensor(&quadrupole::tensor(by));
                match quadrupole::field(&sight.place, &quadrupole::entries(&lies)) {
                    Ok(h) => sight.read(&h, |i, value| columns[count * (first + i) + k] += value),
                    Err(_) => sound = false,
                }
            }
        })?;
        sound &= columns.iter().all(|c| c.is_finite());
        Ok(sound.then(|| ("a quadrupole of the body".to_string(), columns, count)))
    }

    /// Clocks of the sensors as alternatives, not whitened: stamps that are late by a second. That
    /// of the first of two is the other's, and one that all share is the start of the track.
    fn late_clocks(&self, x: &[f64]) -> Result<Vec<(String, Vec<f64>, usize)>, Error> {
        let sensors = self.places.len();
        // Where the body turns the field changes with its attitude too.
        if sensors < 2 || self.description.motion == Motion::Turning {
            return Ok(Vec::new());
        }
        let mut all = vec![vec![0.0; self.field.len()]; sensors];
        self.sights(x, |first, _, s, sight| {
            let slope = [0, 1, 2].map(|i| -dot(&sight.by_place[i], &sight.step.velocity));
            sight.read(&slope, |i, value| all[s][first + i] += value);
        })?;
        let named = all.into_iter().enumerate().skip(usize::from(sensors == 2));
        Ok(named
            .map(|(s, column)| (format!("clock of sensor {}", s + 1), column, 1))
            .collect())
    }

    /// What else may be true and is no state, each with its whitened columns, row-major, and their
    /// number: accelerations, a quadrupole, a second dipole on the same track, clocks of the
    /// sensors, constants, drifts and gains of the channels.
    ///
    /// # Errors
    /// Where the dipole meets a sensor.
    pub fn alternatives(&self, x: &[f64]) -> Result<Vec<(String, Vec<f64>, usize)>, Error> {
        let (state, _) = self.expand(x);
        let pass = Pass::of(&state);
        let (m, channels) = (self.field.len(), self.channels());
        let speed = dot(&pass.velocity, &pass.velocity).sqrt();
        let mut found = Vec::new();
        if speed > 0.0 {
            // Along the track, away from the first sensor at the closest point, across.
            let along = pass.velocity.map(|v| v / speed);
            let from = pass.offset(&self.places[0], 0.0);
            let shift = dot(&from, &along);
            let closest: [f64; 3] = core::array::from_fn(|i| from[i] - shift * along[i]);
            let distance = dot(&closest, &closest).sqrt();
            let away = if distance > 0.0 {
                closest.map(|c| c / distance)
            } else {
                closest
            };
            let across = cross(&along, &away);
            for (name, direction) in [
                ("acceleration along the track", along),
                ("acceleration away from the sensor", away),
                ("acceleration across both", across),
            ] {
                if match self.description.motion {
                    Motion::Accelerated => true,
                    Motion::Along => direction == along,
                    _ => false,
                } {
                    continue;
                }
                let mut column = vec![0.0; m];
                self.sights(x, |first, t, _, sight| {
                    let slope = [0, 1, 2].map(|i| dot(&sight.by_place[i], &direction));
                    sight.read(&slope, |i, value| column[first + i] += 0.5 * t * t * value);
                })?;
                found.push((name.to_string(), column, 1));
            }
            if self.description.motion != Motion::Accelerated {
                // In any direction.
                let mut columns = vec![0.0; 3 * m];
                self.sights(x, |first, t, _, sight| {
                    for k in 0..3 {
                        let slope = [0, 1, 2].map(|i| sight.by_place[i][k]);
                        sight.read(&slope, |i, value| {
                            columns[3 * (first + i) + k] += 0.5 * t * t * value;
                        });
                    }
                })?;
                found.push(("acceleration".to_string(), columns, 3));
            }
            found.extend(self.quadrupole_beside(x, &pass.moment)?);
            found.extend(self.late_clocks(x)?);
            for (name, direction, side) in [
                ("a second dipole behind", along, -1.0),
                ("a second dipole ahead", along, 1.0),
                ("a second dipole farther from the sensor", away, 0.5),
                ("a second dipole on one side", across, 1.0),
                ("a second dipole on the other side", across, -1.0),
            ] {
                let mut columns = vec![0.0; 3 * m];
                self.sights(x, |first, _, _, sight| {
                    let other: [f64; 3] =
                        core::array::from_fn(|i| sight.place[i] + side * distance * direction[i]);
                    if let Ok(j) = jacobian(&other, &pass.moment) {
                        for k in 0..3 {
                            sight.read(&j.moment[k], |i, value| {
                                columns[3 * (first + i) + k] += value;
                            });
                        }
                    }
                })?;
                found.push((name.to_string(), columns, 3));
            }
        }
        let mut exact = vec![0.0; m];
        self.sights(x, |first, _, _, sight| {
            sight.add(&sight.field, |i, value| exact[first + i] += value);
        })?;
        let middle = self.middle();
        for c in 0..channels {
            let column = |value: &dyn Fn(usize) -> f64| {
                let mut column = vec![0.0; m];
                for i in (c..m).step_by(channels) {
                    column[i] = value(i);
                }
                column
            };
            let name = self.channel(c);
            if !self.constants.contains(&c) {
                found.push((format!("background {name}"), column(&|_| 1.0), 1));
            }
            if !(self.description.drift && self.constants.contains(&c)) {
                let time = |i: usize| self.times[i / channels] - middle;
                found.push((format!("drift of {name}"), column(&time), 1));
            }
            found.push((format!("gain of {name}"), column(&|i| exact[i]), 1));
        }
        for (_, columns, count) in &mut found {
            self.noise.apply_rows(columns, *count);
        }
        Ok(found)
    }
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| a[i] + b[i])
}

/// A sum of vectors.
fn weighed(vectors: &[[f64; 3]; 5], weights: &[f64; 5]) -> [f64; 3] {
    core::array::from_fn(|i| (0..5).map(|k| weights[k] * vectors[k][i]).sum())
}

/// How far the body moves with a state, of which these are the derivatives of (r0, v, m).
fn moved(step: &Step, column: &[f64; 9]) -> [f64; 3] {
    core::array::from_fn(|i| (0..6).map(|k| column[k] * step.by_state[k][i]).sum())
}

/// The two axes beside one, in the order that keeps the hand.
fn beside(axis: usize) -> (usize, usize) {
    let first = axis - axis % 3;
    (first + (axis + 1) % 3, first + (axis + 2) % 3)
}

impl Model for Measured {
    type Error = Error;

    fn states(&self) -> usize {
        self.layout().end
    }

    fn measurements(&self) -> usize {
        self.field.len() + self.priors()
    }

    fn priors(&self) -> usize {
        let at = self.layout();
        self.knowledge.prior.iter().flatten().count() + at.constants - at.attitude
    }

    fn channels(&self) -> usize {
        self.sensors().channels()
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        mut rows: Option<&mut [f64]>,
    ) -> Result<(), Error> {
        let (m, n) = (self.field.len(), x.len());
        self.raw(x, residuals, rows.as_deref_mut())?;
        let (state, columns) = self.expand(x);
        let layout = self.layout();
        let levels = layout.motion;
        self.noise.apply(&mut residuals[..m]);
        if let Some(rows) = rows.as_deref_mut() {
            self.noise.apply_rows(&mut rows[..m * n], n);
        }
        let mut at = m;
        for (index, prior) in self.knowledge.prior.iter().enumerate() {
            let Some((mean, sigma)) = *prior else {
                continue;
            };
            let (value, gradient) = quantity(&state, index);
            residuals[at] = (mean - value) / sigma;
            if let Some(rows) = rows.as_deref_mut() {
                let row = &mut rows[at * n..][..n];
                row[levels..].fill(0.0);
                for (out, column) in row[..levels].iter_mut().zip(&columns) {
                    let along: f64 = gradient.iter().zip(column).map(|(g, c)| g * c).sum();
                    *out = along / sigma;
                }
            }
            at += 1;
        }
        // Attitude and scale of the sensors are known to a deviation.
        for k in layout.attitude..layout.constants {
            let sigma = if k < layout.scale {
                self.description.attitude
            } else {
                self.description.scale
            };
            let sigma = sigma.unwrap_or(1.0);
            residuals[at] = -x[k] / sigma;
            if let Some(rows) = rows.as_deref_mut() {
                let row = &mut rows[at * n..][..n];
                row.fill(0.0);
                row[k] = 1.0 / sigma;
            }
            at += 1;
        }
        Ok(())
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), Error> {
        let mut other = vec![0.0; out.len()];
        self.linearize(a, out, None)?;
        self.linearize(b, &mut other, None)?;
        for (out, other) in out.iter_mut().zip(&other) {
            *out -= other;
        }
        Ok(())
    }

    fn change(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        // Angles as the pass itself would give them.
        let (from, to) = (
            self.coordinates(&self.expand(a).0),
            self.coordinates(&self.expand(b).0),
        );
        let levels = self.layout().motion;
        let mut next = 0;
        let angles = |from: usize, count: usize, out: &mut [f64]| {
            for o in &mut out[from..from + count] {
                *o = wrapped(*o);
            }
        };
        for k in 0..a.len() {
            out[k] = if k < levels {
                to[k] - from[k]
            } else {
                b[k] - a[k]
            };
        }
        for (k, part) in self.parts.iter().enumerate() {
            match part {
                Part::Components => {
                    next += (3 * k..3 * k + 3)
                        .filter(|&i| self.knowledge.exact[i].is_none())
                        .count();
                }
                Part::Circle { .. } => {
                    angles(next, 1, out);
                    next += 1;
                }
                Part::Sphere { .. } => {
                    angles(next, 2, out);
                    next += 2;
                }
                Part::Side { .. } => {}
            }
        }
    }

    fn symmetries(&self, x: &[f64], found: &mut dyn FnMut(&[f64])) {
        let images = [self.mirrored(x), self.reflected(x)];
        images.iter().flatten().for_each(|image| found(image));
    }
}

/// A state, the speed or the size of the moment, and its derivatives.
fn quantity(state: &[f64; 9], index: usize) -> (f64, [f64; 9]) {
    let mut gradient = [0.0; 9];
    let first = match index {
        SPEED => 3,
        MOMENT => 6,
        _ => {
            gradient[index] = 1.0;
            return (state[index], gradient);
        }
    };
    let size = state[first..first + 3]
        .iter()
        .fold(0.0_f64, |a, b| a.hypot(*b));
    for i in first..first + 3 {
        gradient[i] = state[i] / size.max(f64::MIN_POSITIVE);
    }
    (size, gradient)
}

mod images;
#[cfg(test)]
mod tests;
