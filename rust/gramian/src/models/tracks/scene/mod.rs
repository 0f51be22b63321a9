//! A scene: one target, sensors on carriers, and what is unknown about the sensors.

pub mod departures;
pub mod estimate;
mod images;
mod kernels;
mod noise;
mod one_pass;
mod rounding;

use alloc::borrow::Cow;
use alloc::vec;
use alloc::vec::Vec;

use self::kernels::MOST;
pub use self::noise::Noise;
use self::noise::Whitener;
use super::Error;
use super::carrier::Carried;
use super::motion::{CoordinatedTurn, Legs, Motion, Polynomial, SteadyLegs, Turns};
use crate::batch::Stream;
use crate::batch::lanes::{Block, LANES};
use crate::batch::simd::Path;
use crate::scalar::{check_finite, wrapped};
use crate::solve::Model;

/// When a motion in legs turns, s after the reference time.
#[derive(Clone, Debug, PartialEq)]
pub enum TurnTimes {
    /// Known.
    Known(Vec<f64>),
    /// So many, each a state.
    Unknown(usize),
}

impl TurnTimes {
    fn turns(&self) -> Turns<'_> {
        match self {
            Self::Known(times) => Turns::Known(times),
            Self::Unknown(count) => Turns::Unknown(*count),
        }
    }
}

/// The motion of the target; see [`motion`](super::motion) for the states of each.
#[derive(Clone, Debug, PartialEq)]
pub enum Moving {
    /// [`Polynomial`].
    Polynomial {
        /// 0 at rest, 1 at constant velocity ..
        order: usize,
    },
    /// [`Legs`].
    Legs(TurnTimes),
    /// [`SteadyLegs`].
    SteadyLegs(TurnTimes),
    /// [`CoordinatedTurn`].
    CoordinatedTurn,
}

/// Calls the generic `$call` with the static motion of `$moving`.
macro_rules! with_motion {
    ($moving:expr, $motion:ident => $call:expr) => {
        match $moving {
            Moving::Polynomial { order } => {
                let $motion = &Polynomial { order: *order };
                $call
            }
            Moving::Legs(times) => {
                let $motion = &Legs {
                    turns: times.turns(),
                };
                $call
            }
            Moving::SteadyLegs(times) => {
                let $motion = &SteadyLegs {
                    turns: times.turns(),
                };
                $call
            }
            Moving::CoordinatedTurn => {
                let $motion = &CoordinatedTurn;
                $call
            }
        }
    };
}

mod glance;
mod predict;
mod starts;
mod trials;

impl Moving {
    /// How many states it has in `dimension` dimensions.
    pub fn states(&self, dimension: usize) -> usize {
        with_motion!(self, motion => if dimension == 2 {
            Motion::<2>::states(motion)
        } else {
            Motion::<3>::states(motion)
        })
    }

    /// How many of the first states change one component of place and velocity after the other
    /// alone.
    fn by_axes(&self, dimension: usize) -> usize {
        fn count<M: Motion<D>, const D: usize>(motion: &M) -> usize {
            let along = |&k: &usize| motion.component(k) == Some(k % D);
            (0..motion.states()).take_while(along).count() / D * D
        }
        with_motion!(self, motion => if dimension == 2 {
            count::<_, 2>(motion)
        } else {
            count::<_, 3>(motion)
        })
    }

    /// Places and velocities at `times` after the reference time, `2 dimension` numbers
    /// each.
    pub fn track(&self, dimension: usize, x: &[f64], times: &[f64]) -> Vec<f64> {
        fn run<M: Motion<D>, const D: usize>(motion: &M, x: &[f64], times: &[f64]) -> Vec<f64> {
            let mut changes = vec![super::motion::Change::<f64, D>::zero(0.0); x.len()];
            let mut out = Vec::with_capacity(2 * D * times.len());
            for &u in times {
                let now = motion.at(x, u, &mut changes);
                out.extend_from_slice(&now.place);
                out.extend_from_slice(&now.velocity);
            }
            out
        }
        with_motion!(self, motion => if dimension == 2 {
            run::<_, 2>(motion, x, times)
        } else {
            run::<_, 3>(motion, x, times)
        })
    }
}

impl Moving {
    /// Derivatives of the places at `times` after the reference time by each state: for
    /// each time `dimension` rows of as many numbers as the motion has states.
    pub fn slopes(&self, dimension: usize, x: &[f64], times: &[f64]) -> Vec<f64> {
        fn run<M: Motion<D>, const D: usize>(motion: &M, x: &[f64], times: &[f64]) -> Vec<f64> {
            let mut changes = vec![super::motion::Change::<f64, D>::zero(0.0); x.len()];
            let mut out = Vec::with_capacity(D * x.len() * times.len());
            for &u in times {
                motion.at(x, u, &mut changes);
                for axis in 0..D {
                    out.extend(changes.iter().map(|change| change.place[axis]));
                }
            }
            out
        }
        with_motion!(self, motion => if dimension == 2 {
            run::<_, 2>(motion, x, times)
        } else {
            run::<_, 3>(motion, x, times)
        })
    }
}

/// A kind of sensor; see [`sensors`](super::sensors).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Horizontal angle clockwise from north.
    Bearing,
    /// Angle above the horizontal.
    Elevation,
    /// Distance.
    Range,
    /// Its rate.
    RangeRate,
    /// Received frequency of a tonal, at this speed of the wave.
    Frequency(f64),
    /// Arrival at one carrier less arrival at another, at this speed of the wave.
    TimeDifference(f64),
    /// Frequency at one carrier less that at another.
    FrequencyDifference(f64),
    /// Angle from the axis of an array.
    ConeAngle,
    /// Power by distance.
    SignalStrength,
    /// All components of the target's place.
    Position,
    /// The target's speed.
    Speed,
    /// The target's course.
    Course,
}

impl Kind {
    /// The name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bearing => "bearing",
            Self::Elevation => "elevation",
            Self::Range => "range",
            Self::RangeRate => "range_rate",
            Self::Frequency(_) => "frequency",
            Self::TimeDifference(_) => "time_difference",
            Self::FrequencyDifference(_) => "frequency_difference",
            Self::ConeAngle => "cone_angle",
            Self::SignalStrength => "signal_strength",
            Self::Position => "position",
            Self::Speed => "speed",
            Self::Course => "course",
        }
    }

    /// Numbers a sample.
    pub fn width(self, dimension: usize) -> usize {
        if self == Self::Position { dimension } else { 1 }
    }

    /// Whether the noise is that of an angle.
    pub fn is_angle(self) -> bool {
        matches!(
            self,
            Self::Bearing | Self::Elevation | Self::ConeAngle | Self::Course
        )
    }

    /// Whether whole turns do not matter.
    fn wraps(self) -> bool {
        matches!(self, Self::Bearing | Self::Course)
    }

    /// Whether two carriers compare what they receive.
    fn is_difference(self) -> bool {
        matches!(self, Self::TimeDifference(_) | Self::FrequencyDifference(_))
    }

    /// Whether it needs no carrier.
    fn is_own(self) -> bool {
        matches!(self, Self::Position | Self::Speed | Self::Course)
    }

    fn reason(self) -> &'static str {
        match self {
            Self::Bearing => "the target is at, above or below the carrier: no bearing exists",
            Self::Elevation => "the target is at, above or below the carrier: no derivative exists",
            Self::ConeAngle => {
                "a cone angle of 0 or pi has no derivative: the target is on the axis"
            }
            Self::Speed | Self::Course => "the target is at rest: no derivative exists",
            _ => "the target is at the carrier: no derivative exists",
        }
    }
}

/// A number that is known, or a state behind those of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameter {
    /// This number.
    Fixed(f64),
    /// The nuisance state of this number, from 0 on.
    State(usize),
}

/// A sensor with the times of its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// What it measures.
    pub kind: Kind,
    /// Times of the samples, s.
    pub times: Vec<f64>,
    /// Its carrier at these times.
    pub carrier: Option<Carried>,
    /// The other carrier of a difference.
    pub second: Option<Carried>,
    /// Tonal, or power and exponent.
    pub parameters: [Parameter; 2],
    /// What is added to the reading, each with a factor: the clocks of a time difference
    /// have 1 and -1.
    pub bias: Vec<(f64, Parameter)>,
    /// The reading is multiplied by 1 + scale.
    pub scale: Parameter,
    /// Stamp less true time, s.
    pub clock: Parameter,
    /// Whether the carrier's path has the true time, not the same stamps.
    pub true_path: bool,
    /// Speed of the wave, where the target is seen where it was.
    pub delay: Option<f64>,
    /// Noise.
    pub noise: Noise,
    /// Probability of each sample, or of all: for expected information.
    pub detection: Vec<f64>,
}

impl Channel {
    /// A sensor of independent noise without anything unknown.
    pub fn new(kind: Kind, times: Vec<f64>, carrier: Option<Carried>, sigma: f64) -> Self {
        Self {
            kind,
            times,
            carrier,
            second: None,
            parameters: [Parameter::Fixed(0.0), Parameter::Fixed(2.0)],
            bias: Vec::new(),
            scale: Parameter::Fixed(0.0),
            clock: Parameter::Fixed(0.0),
            true_path: false,
            delay: None,
            noise: Noise::Sigma(vec![sigma]),
            detection: vec![1.0],
        }
    }
}

/// An error of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("sensors[{sensor}]: {error}")]
pub struct InSensor {
    /// Which sensor.
    pub sensor: usize,
    /// What is wrong.
    pub error: Error,
}

/// One sensor, ready for the kernels.
#[derive(Clone, Debug)]
struct Group {
    channel: Channel,
    first: usize,
    count: usize,
    width: usize,
    /// Times of the samples after the reference time.
    instants: Vec<f64>,
    times: Vec<Block>,
    carrier: Vec<Block>,
    second: Option<Vec<Block>>,
    whitener: Whitener,
    /// What whitens the rows of each sample, where that is one number, and all are detected.
    weights: Vec<Block>,
    /// Whether the times are those of the sensor before.
    times_alike: bool,
    glance: glance::Glance,
}

/// One target, sensors on carriers, and what is unknown about the sensors.
///
/// The states are those of the motion, then the nuisance states. Measurements are in the
/// order of the sensors, sample by sample.
///
/// ```
/// use gramian::tracks::carrier::Carrier;
/// use gramian::tracks::scene::{Channel, Kind, Moving, Scene};
/// // Bearings and one range of a ship at constant velocity, from a fixed place.
/// let coast = Carrier::fixed(&[0.0, 0.0], None)?;
/// let times = [0.0, 60.0, 120.0, 180.0];
/// let bearings = Channel::new(Kind::Bearing, times.to_vec(), Some(coast.at(&times)?), 0.01);
/// let range = Channel::new(Kind::Range, vec![60.0], Some(coast.at(&[60.0])?), 10.0);
/// let scene = Scene::new(2, Moving::Polynomial { order: 1 }, 0.0, 0, vec![bearings, range]).unwrap();
/// let rows = scene.rows(&[2000.0, 5000.0, 3.0, -1.0]).unwrap();
/// assert_eq!(rows.len(), 5 * 4);
/// # Ok::<(), gramian::tracks::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Scene {
    dimension: usize,
    motion: Moving,
    motion_states: usize,
    /// So many of the first change one component of the place after the other alone.
    by_axes: usize,
    nuisances: usize,
    reference: f64,
    groups: Vec<Group>,
    measurements: usize,
    path: Path,
}

impl Scene {
    /// A scene in 2 or 3 `dimensions`, with times counted from `reference` (s) and so
    /// many nuisance states.
    ///
    /// # Errors
    /// [`InSensor`] with what does not fit.
    pub fn new(
        dimension: usize,
        motion: Moving,
        reference: f64,
        nuisances: usize,
        channels: Vec<Channel>,
    ) -> Result<Self, InSensor> {
        let none = |error: Error| InSensor {
            sensor: usize::MAX,
            error,
        };
        let motion_states = motion.states(dimension);
        if motion_states + 1 > MOST {
            return Err(none(Error::TooManyStates {
                given: motion_states,
                most: MOST - 1,
            }));
        }
        check_finite("reference time", &[reference]).map_err(|error| none(error.into()))?;
        let mut groups = Vec::with_capacity(channels.len());
        let mut first = 0;
        for (sensor, channel) in channels.into_iter().enumerate() {
            let mut group = Group::new(channel, dimension, reference, first)
                .map_err(|error| InSensor { sensor, error })?;
            group.times_alike = groups
                .last()
                .is_some_and(|before: &Group| group.instants == before.instants);
            first += group.count * group.width;
            groups.push(group);
        }
        Ok(Self {
            dimension,
            by_axes: motion.by_axes(dimension),
            motion,
            motion_states,
            nuisances,
            reference,
            groups,
            measurements: first,
            path: Path::Best,
        })
    }

    /// The same on another vector path.
    #[must_use]
    pub fn on(mut self, path: Path) -> Self {
        self.path = path;
        self
    }

    /// Number of dimensions.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// The motion.
    pub fn motion(&self) -> &Moving {
        &self.motion
    }

    /// Time from which the motion counts, s.
    pub fn reference(&self) -> f64 {
        self.reference
    }

    /// States of the motion.
    pub fn motion_states(&self) -> usize {
        self.motion_states
    }

    /// All states.
    pub fn states(&self) -> usize {
        self.motion_states + self.nuisances
    }

    /// All numbers that are measured.
    pub fn measurements(&self) -> usize {
        self.measurements
    }

    /// The sensors, with the place of the first of their numbers.
    pub fn channels(&self) -> impl Iterator<Item = (&Channel, usize)> {
        self.groups
            .iter()
            .map(|group| (&group.channel, group.first))
    }

    fn value(&self, x: &[f64], parameter: Parameter) -> f64 {
        match parameter {
            Parameter::Fixed(value) => value,
            Parameter::State(index) => x[self.motion_states + index],
        }
    }

    /// Differences of measurements, whitened in place: angles wrapped, absent ones zero.
    fn whiten(&self, values: &mut [f64], mut rows: Option<&mut [f64]>, present: Option<&[bool]>) {
        let n = self.states();
        for group in &self.groups {
            let range = group.first..group.first + group.count * group.width;
            let values = &mut values[range.clone()];
            if group.channel.kind.wraps() {
                for value in values.iter_mut() {
                    if value.abs() > core::f64::consts::PI {
                        *value = wrapped(*value);
                    }
                }
            }
            let rows = match &mut rows {
                Some(rows) => &mut rows[range.start * n..range.end * n],
                None => &mut [],
            };
            group
                .whitener
                .apply(group.width, values, rows, n, present.map(|p| &p[range]));
        }
    }

    /// The whitened rows (measurements, states) at a state, each by the square root of
    /// its detection probability.
    ///
    /// # Errors
    /// [`InSensor`] where a sensor reads nothing.
    pub fn rows(&self, x: &[f64]) -> Result<Vec<f64>, InSensor> {
        let mut rows = vec![0.0; self.measurements * self.states()];
        self.rows_into(x, &mut rows)?;
        Ok(rows)
    }

    /// [`rows`](Scene::rows) into memory of the caller.
    ///
    /// # Errors
    /// As there.
    pub fn rows_into(&self, x: &[f64], rows: &mut [f64]) -> Result<(), InSensor> {
        self.check_state(x)?;
        self.predict_white(x, rows)?;
        let n = self.states();
        for group in self.groups.iter().filter(|group| group.weights.is_empty()) {
            let own = &mut rows[group.first * n..][..group.count * group.width * n];
            let mut values = vec![0.0; group.count * group.width];
            group.whitener.apply(group.width, &mut values, own, n, None);
            let detection = &group.channel.detection;
            if detection.iter().all(|&p| p == 1.0) {
                continue;
            }
            for i in 0..group.count * group.width {
                let p = detection[if detection.len() == 1 {
                    0
                } else {
                    i / group.width
                }];
                for entry in &mut rows[(group.first + i) * n..][..n] {
                    *entry *= p.sqrt();
                }
            }
        }
        Ok(())
    }

    /// What the sensors read at a state without noise.
    ///
    /// # Errors
    /// As [`rows`](Scene::rows).
    pub fn values(&self, x: &[f64]) -> Result<Vec<f64>, InSensor> {
        self.check_state(x)?;
        let mut values = vec![0.0; self.measurements];
        self.predict(x, &mut values, None)?;
        Ok(values)
    }

    fn check_state(&self, x: &[f64]) -> Result<(), InSensor> {
        let none = |error: crate::scalar::NumberError| InSensor {
            sensor: usize::MAX,
            error: error.into(),
        };
        crate::scalar::check_length("state", x.len(), self.states()).map_err(none)?;
        check_finite("state", x).map_err(none)
    }

    /// Measurements with noise of the trial's own stream; NaN where a sample is not
    /// detected. `exact` is what [`values`](Scene::values) gives.
    pub fn simulate(&self, exact: &[f64], seed: u64, trial: u64, out: &mut [f64]) {
        let mut stream = Stream::new(seed, trial);
        for group in &self.groups {
            let range = group.first..group.first + group.count * group.width;
            let noise = &mut out[range.clone()];
            noise.fill_with(|| stream.normal());
            group.whitener.color(group.width, noise);
            for (value, exact) in noise.iter_mut().zip(&exact[range]) {
                *value += exact;
                if group.channel.kind.wraps() {
                    *value = wrapped(*value);
                }
            }
            let detection = &group.channel.detection;
            if detection.iter().any(|&p| p < 1.0) {
                for (i, sample) in noise.chunks_exact_mut(group.width).enumerate() {
                    let p = detection[if detection.len() == 1 { 0 } else { i }];
                    if stream.uniform() >= p {
                        sample.fill(f64::NAN);
                    }
                }
            }
        }
    }
}

/// Values (samples, width) as blocks of samples: the last sample again behind the last.
fn blocks(values: &[f64], width: usize, count: usize) -> impl Iterator<Item = Block> {
    (0..count.div_ceil(LANES)).flat_map(move |block| {
        (0..width).map(move |k| {
            core::array::from_fn(|lane| {
                let i = (block * LANES + lane).min(count - 1);
                values[i * width + k]
            })
        })
    })
}

fn packed(carried: &Carried, dimension: usize, count: usize) -> Vec<Block> {
    let d = dimension;
    let all: Vec<f64> = (0..count)
        .flat_map(|i| {
            [&carried.place, &carried.velocity, &carried.axis]
                .into_iter()
                .flat_map(move |values| values[i * d..(i + 1) * d].iter().copied())
        })
        .collect();
    blocks(&all, 3 * d, count).collect()
}

impl Group {
    /// Whether the target is at the same places at the samples of the sensor before: where
    /// neither a carrier nor a delay counts.
    fn moves_as(&self, before: &Self) -> bool {
        let plain = |group: &Self| group.channel.delay.is_none() && !group.channel.true_path;
        self.times_alike
            && plain(self)
            && plain(before)
            && self.channel.clock == before.channel.clock
    }

    fn new(
        channel: Channel,
        dimension: usize,
        reference: f64,
        first: usize,
    ) -> Result<Self, Error> {
        let kind = channel.kind;
        let count = channel.times.len();
        let width = kind.width(dimension);
        check_finite("times", &channel.times)?;
        if kind == Kind::Elevation && dimension != 3 {
            return Err(Error::Dimension {
                kind: kind.name(),
                given: dimension,
            });
        }
        if let Kind::Frequency(speed)
        | Kind::TimeDifference(speed)
        | Kind::FrequencyDifference(speed) = kind
            && !(speed > 0.0 && speed.is_finite())
        {
            return Err(Error::WaveSpeed { given: speed });
        }
        if let Some(speed) = channel.delay
            && !(speed > 0.0 && speed.is_finite())
        {
            return Err(Error::WaveSpeed { given: speed });
        }
        if channel.carrier.is_none() && !kind.is_own() {
            return Err(Error::NoCarrier {
                kind: kind.name(),
                wanted: "a carrier",
            });
        }
        if channel.second.is_some() != kind.is_difference() {
            return Err(Error::NoCarrier {
                kind: kind.name(),
                wanted: if kind.is_difference() {
                    "two carriers"
                } else {
                    "one carrier"
                },
            });
        }
        for carried in [&channel.carrier, &channel.second].into_iter().flatten() {
            if carried.place.len() != count * dimension {
                return Err(Error::CarrierDimension {
                    given: carried.place.len().checked_div(count).unwrap_or(0),
                    wanted: dimension,
                });
            }
            let axes = &carried.axis;
            if kind == Kind::ConeAngle
                && let Some(index) = axes
                    .chunks_exact(dimension)
                    .position(|a| a.iter().all(|&x| x == 0.0))
            {
                return Err(Error::NoHeading { index });
            }
        }
        if channel.detection.len() != 1 {
            crate::scalar::check_length("detection", channel.detection.len(), count)?;
        }
        for (index, &given) in channel.detection.iter().enumerate() {
            if !(given > 0.0 && given <= 1.0) {
                return Err(Error::Detection { index, given });
            }
        }
        let whitener = channel
            .noise
            .whitener(&channel.times, width, kind.is_angle())?;
        let times: Vec<f64> = channel.times.iter().map(|t| t - reference).collect();
        let nothing = vec![[0.0; LANES]; 3 * dimension * count.div_ceil(LANES)];
        let weights = match &whitener {
            Whitener::Weights(weights)
                if width == 1 && channel.detection.iter().all(|&p| p == 1.0) =>
            {
                blocks(weights, 1, count).collect()
            }
            _ => Vec::new(),
        };
        Ok(Self {
            first,
            count,
            width,
            times: blocks(&times, 1, count).collect(),
            carrier: match &channel.carrier {
                Some(carried) => packed(carried, dimension, count),
                None => nothing,
            },
            second: channel
                .second
                .as_ref()
                .map(|carried| packed(carried, dimension, count)),
            whitener,
            weights,
            times_alike: false,
            glance: glance::Glance::new(&channel.times, &times),
            channel,
            instants: times,
        })
    }
}

/// A scene with what was measured: a model for [`solve`](crate::solve).
///
/// A measurement that is NaN is missing.
#[derive(Clone, Debug)]
pub struct Measured<'a> {
    scene: Cow<'a, Scene>,
    measurements: Cow<'a, [f64]>,
    present: Option<Vec<bool>>,
    count: usize,
    /// For each state its value where it is known.
    known: Vec<Option<f64>>,
}

impl<'a> Measured<'a> {
    /// `known` holds for each state its value where it is known exactly; it may be empty.
    ///
    /// # Errors
    /// [`InSensor`] for arrays that do not fit.
    pub fn new(
        scene: &'a Scene,
        measurements: &'a [f64],
        known: &[Option<f64>],
    ) -> Result<Self, InSensor> {
        let none = |error: crate::scalar::NumberError| InSensor {
            sensor: usize::MAX,
            error: error.into(),
        };
        crate::scalar::check_length("measurements", measurements.len(), scene.measurements)
            .map_err(none)?;
        let mut known = known.to_vec();
        if known.is_empty() {
            known.resize(scene.states(), None);
        }
        crate::scalar::check_length("known", known.len(), scene.states()).map_err(none)?;
        let mut count = measurements.len();
        let mut present = None;
        if measurements.iter().any(|z| z.is_nan()) {
            let mut is: Vec<bool> = measurements.iter().map(|z| !z.is_nan()).collect();
            for group in &scene.groups {
                if let Whitener::Factor { size, .. } = &group.whitener {
                    // A block of correlated numbers counts whole or not at all.
                    for block in is[group.first..][..group.count * group.width].chunks_mut(*size) {
                        if !block.iter().all(|&p| p) {
                            block.fill(false);
                        }
                    }
                }
            }
            count = is.iter().filter(|&&p| p).count();
            present = Some(is);
        }
        Ok(Self {
            scene: Cow::Borrowed(scene),
            measurements: Cow::Borrowed(measurements),
            present,
            count,
            known,
        })
    }

    /// The same, with a copy of what was borrowed.
    pub fn into_owned(self) -> Measured<'static> {
        Measured {
            scene: Cow::Owned(self.scene.into_owned()),
            measurements: Cow::Owned(self.measurements.into_owned()),
            present: self.present,
            count: self.count,
            known: self.known,
        }
    }

    /// All states, from those that are free.
    pub fn full(&self, free: &[f64]) -> Vec<f64> {
        let mut free = free.iter();
        self.known
            .iter()
            .map(|known| known.unwrap_or_else(|| free.next().copied().unwrap_or(0.0)))
            .collect()
    }

    fn free(&self) -> impl Iterator<Item = usize> {
        (0..self.known.len()).filter(|&k| self.known[k].is_none())
    }

    /// Those of all states that are free.
    fn pick(&self, all: impl Iterator<Item = f64>, out: &mut [f64]) {
        let free = all.zip(&self.known).filter(|(_, known)| known.is_none());
        for (out, (value, _)) in out.iter_mut().zip(free) {
            *out = value;
        }
    }

    fn compact(&self, values: &[f64], out: &mut [f64], width: impl Fn(usize) -> bool, n: usize) {
        let mut out = out.iter_mut();
        for (i, row) in values.chunks_exact(n).enumerate() {
            if self.present.as_ref().is_none_or(|p| p[i]) {
                for (k, value) in row.iter().enumerate() {
                    if width(k)
                        && let Some(out) = out.next()
                    {
                        *out = *value;
                    }
                }
            }
        }
    }
}

impl Model for Measured<'_> {
    type Error = InSensor;

    fn states(&self) -> usize {
        self.known.iter().filter(|known| known.is_none()).count()
    }

    fn measurements(&self) -> usize {
        self.count
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), InSensor> {
        let scene = &*self.scene;
        let n = scene.states();
        let whole = self.present.is_none();
        let free = self.known.iter().all(Option::is_none);
        let full;
        let x = if free {
            x
        } else {
            full = self.full(x);
            &full
        };
        if whole && free {
            // Straight into the memory of the caller.
            let mut rows = rows;
            scene.predict(x, residuals, rows.as_deref_mut())?;
            for (value, z) in residuals.iter_mut().zip(self.measurements.iter()) {
                *value = z - *value;
            }
            scene.whiten(residuals, rows, None);
            return Ok(());
        }
        let mut values = vec![0.0; scene.measurements];
        let mut wide = vec![
            0.0;
            if rows.is_some() {
                n * scene.measurements
            } else {
                0
            }
        ];
        let with_rows = rows.is_some();
        scene.predict(x, &mut values, with_rows.then_some(&mut wide[..]))?;
        for (value, z) in values.iter_mut().zip(self.measurements.iter()) {
            *value = if z.is_nan() { 0.0 } else { z - *value };
        }
        scene.whiten(
            &mut values,
            with_rows.then_some(&mut wide[..]),
            self.present.as_deref(),
        );
        self.compact(&values, residuals, |_| true, 1);
        if let Some(rows) = rows {
            self.compact(&wide, rows, |k| self.known[k].is_none(), n);
        }
        Ok(())
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), InSensor> {
        let scene = &*self.scene;
        let mut values = [vec![0.0; scene.measurements], vec![0.0; scene.measurements]];
        for (x, values) in [a, b].into_iter().zip(&mut values) {
            scene.predict(&self.full(x), values, None)?;
        }
        let [from, mut to] = values;
        for (to, from) in to.iter_mut().zip(&from) {
            *to -= from;
        }
        scene.whiten(&mut to, None, self.present.as_deref());
        self.compact(&to, out, |_| true, 1);
        Ok(())
    }

    fn rounding(&self, x: &[f64], noise: &mut [f64]) -> bool {
        noise.copy_from_slice(&self.rounding_at(x));
        true
    }

    fn change(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        let (from, mut to) = (self.full(a), self.full(b));
        self.rename(&mut to, &from);
        self.pick(to.iter().zip(&from).map(|(to, from)| to - from), out);
    }

    fn extent(&self, x: &[f64], k: usize) -> (f64, f64) {
        let which = self.free().nth(k).unwrap_or(k);
        self.written(&self.full(x), which)
    }

    fn retract(&self, x: &mut [f64]) {
        let mut full = self.full(x);
        if self.go_ahead(&mut full) {
            self.pick(full.iter().copied(), x);
        }
    }

    fn symmetries(&self, x: &[f64], found: &mut dyn FnMut(&[f64])) {
        let mut free = x.to_vec();
        for image in self.scene.images(&self.full(x)) {
            self.pick(image.iter().copied(), &mut free);
            found(&free);
        }
    }
}

#[cfg(test)]
mod tests;
