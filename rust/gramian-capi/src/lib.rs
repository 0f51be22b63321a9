//! The C interface: a bearings monitor, a tracker, the heading laws, and the dipole, in
//! `float`.
//!
//! The header is `include/gramian.h`. A static library without an operating system:
//!
//! ```text
//! cargo rustc -p gramian-capi --release --no-default-features --features libm \
//!     --crate-type staticlib --target thumbv7em-none-eabihf -- -C panic=abort
//! ```
//!
//! No function allocates, keeps a pointer or panics; a null pointer is an error
//! value as any other.
#![cfg_attr(not(feature = "std"), no_std)]
// Names without mangling and C's pointers are what this crate is for.
#![allow(unsafe_code)]

use core::mem::{align_of, size_of};

use gramian::bearings::{self, Monitor};
use gramian::dipole::{self, Accumulator};
use gramian::maneuver::{self, Law, Side};
use gramian::scalar::NumberError;
use gramian::tracks;
use gramian::tracks::motion::Polynomial;
use gramian::tracks::sensors::{Bearing, Range, RangeRate};
use gramian::tracks::stream::{Sample, Tracker};

#[cfg(not(feature = "std"))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

/// What a call came to.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GramianStatus {
    /// Done.
    Ok = 0,
    /// A pointer is null.
    Null,
    /// A number is NaN or infinite.
    NotFinite,
    /// A time is not later than the one before.
    Time,
    /// A standard deviation or weight is not positive.
    Sigma,
    /// A range is not positive, or the dipole is on the sensor.
    Range,
    /// A step is not positive, or longer than the law allows at this range.
    Step,
    /// Only some of the bearings come with a range.
    Mixed,
    /// All numbers are finite, but what follows from them is too large for a float.
    Overflow,
}

/// Which way to steer; see `gramian_heading`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GramianLaw {
    /// The largest determinant of the two next bearings: step <= range.
    MaxDet = 0,
    /// The law of Hammel and Liu: step <= range.
    HammelLiu,
    /// The largest change of bearing, the tangent: step <= range.
    BearingRate,
    /// Perpendicular to the line of sight now.
    Perpendicular,
    /// The circle about the target, a chord of it: step <= 2 range.
    Circle,
}

/// To which side of the line of sight.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GramianSide {
    /// Clockwise.
    Right = 0,
    /// Anticlockwise.
    Left,
}

/// A bearings monitor. Its content is private: make it with
/// `gramian_monitor_init` before any other use. It may be copied.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct GramianMonitor {
    content: [u64; 32],
}

/// The running Fisher information of a dipole's pass. Its content is private:
/// make it with `gramian_dipole_sums_init` before any other use.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct GramianDipoleSums {
    content: [u64; 24],
}

/// What a tracker is told.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GramianSensor {
    /// A bearing clockwise from north, rad.
    Bearing = 0,
    /// A range, m.
    Range,
    /// The rate of the range, m/s.
    RangeRate,
}

/// The estimate of a target at constant velocity while measurements arrive. Its content
/// is private: make it with `gramian_tracker_init` before any other use. It may be copied.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct GramianTracker {
    content: [u64; 16],
}

/// What the measurements of a tracker so far say.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GramianTrack {
    /// x0, y0, vx, vy at time 0: m, m/s.
    pub state: [f32; 4],
    /// Their standard deviations.
    pub std: [f32; 4],
    /// Sum of the squared innovations, chi-square with `count` degrees of freedom.
    pub chi2: f32,
    /// Probability of one as large where the target keeps its velocity.
    pub p_value: f32,
    /// How many measurements there are.
    pub count: u32,
    /// 1 where the innovations have drifted: the target has turned.
    pub alarm: u32,
}

const fn fits<T, C>() -> bool {
    size_of::<T>() <= size_of::<C>() && align_of::<T>() <= align_of::<C>()
}

const _: () = assert!(fits::<Monitor<f32>, GramianMonitor>());
const _: () = assert!(fits::<Accumulator<f32>, GramianDipoleSums>());
const _: () = assert!(fits::<Tracker<f32, 4>, GramianTracker>());

/// What the bearings so far say. Infinity in a bound: there is none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GramianAnswer {
    /// How many bearings there are.
    pub count: u32,
    /// Rank of 4: below it the track is not observable.
    pub rank: u32,
    /// Logarithm of the determinant of the information.
    pub log_determinant: f32,
    /// Smallest singular value of the rows with unit columns.
    pub singular_value: f32,
    /// Bounds on x0, y0, vx, vy at the first time.
    pub crlb_std: [f32; 4],
    /// Statistic of the test of noisy bearings, and its degrees of freedom.
    pub statistic: f32,
    /// Degrees of freedom of the statistic.
    pub dof: f32,
    /// Probability of a statistic as large where the track is not observable.
    pub p_value: f32,
}

/// Makes a monitor that has seen nothing.
///
/// # Safety
/// `monitor` is null or points to memory for a monitor.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_monitor_init(monitor: *mut GramianMonitor) -> GramianStatus {
    // SAFETY: as the caller promises; the size and alignment were asserted.
    unsafe { store(monitor.cast(), Monitor::<f32>::new()) }
}

/// Takes in a bearing (s, rad, rad). `range` (m) is the target's distance as far
/// as it is known, for all bearings or none: 0 where it is not.
///
/// # Safety
/// `monitor` is null or was made by `gramian_monitor_init`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_monitor_push(
    monitor: *mut GramianMonitor,
    time: f32,
    bearing: f32,
    sigma: f32,
    range: f32,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    let Some(monitor) = (unsafe { monitor.cast::<Monitor<f32>>().as_mut() }) else {
        return GramianStatus::Null;
    };
    let range = (range != 0.0).then_some(range);
    match monitor.push(time, bearing, sigma, range) {
        Ok(()) => GramianStatus::Ok,
        Err(error) => of_bearings(error),
    }
}

/// Says what the bearings so far determine.
///
/// # Safety
/// `monitor` is null or was made by `gramian_monitor_init`; `answer` is null or
/// points to memory for an answer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_monitor_answer(
    monitor: *const GramianMonitor,
    answer: *mut GramianAnswer,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    let Some(monitor) = (unsafe { monitor.cast::<Monitor<f32>>().as_ref() }) else {
        return GramianStatus::Null;
    };
    let found = monitor.answer();
    let value = GramianAnswer {
        count: found.count,
        rank: u32::try_from(found.rank).unwrap_or(0),
        log_determinant: found.log_determinant,
        singular_value: found.singular_value,
        crlb_std: found.crlb_std,
        statistic: found.statistic,
        dof: found.dof,
        p_value: found.p_value,
    };
    // SAFETY: as the caller promises.
    unsafe { store(answer, value) }
}

/// Gives the heading of the next leg, in (-pi, pi], clockwise from north
/// (rad, m).
///
/// # Safety
/// `heading` is null or points to a float.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_heading(
    bearing: f32,
    range: f32,
    step: f32,
    law: GramianLaw,
    side: GramianSide,
    heading: *mut f32,
) -> GramianStatus {
    let law = match law {
        GramianLaw::MaxDet => Law::MaxDet,
        GramianLaw::HammelLiu => Law::HammelLiu,
        GramianLaw::BearingRate => Law::BearingRate,
        GramianLaw::Perpendicular => Law::Perpendicular,
        GramianLaw::Circle => Law::Circle,
    };
    let side = match side {
        GramianSide::Right => Side::Right,
        GramianSide::Left => Side::Left,
    };
    match maneuver::heading(bearing, range, step, law, side) {
        // SAFETY: as the caller promises.
        Ok(value) => unsafe { store(heading, value) },
        Err(maneuver::Error::Range { .. }) => GramianStatus::Range,
        Err(maneuver::Error::Number(error)) => of_number(error),
        Err(_) => GramianStatus::Step,
    }
}

/// Gives the field (T) at the sensor of a dipole of `moment` (A m^2) at `position`
/// (m) from it.
///
/// # Safety
/// Each pointer is null or points to three floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_dipole_field(
    position: *const f32,
    moment: *const f32,
    field: *mut f32,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    let (Some(position), Some(moment)) = (unsafe { (vector(position), vector(moment)) }) else {
        return GramianStatus::Null;
    };
    match dipole::field(position, moment) {
        // SAFETY: as the caller promises.
        Ok(value) => unsafe { store(field.cast(), value) },
        Err(error) => of_dipole(error),
    }
}

/// Gives the derivatives of the field by position and by moment, row by row.
///
/// # Safety
/// Each pointer is null or points to three floats, or nine for the results.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_dipole_jacobian(
    position: *const f32,
    moment: *const f32,
    by_position: *mut f32,
    by_moment: *mut f32,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    let (Some(position), Some(moment)) = (unsafe { (vector(position), vector(moment)) }) else {
        return GramianStatus::Null;
    };
    match dipole::jacobian(position, moment) {
        Ok(found) => {
            // SAFETY: as the caller promises.
            let first = unsafe { store(by_position.cast(), found.position) };
            if first != GramianStatus::Ok {
                return first;
            }
            // SAFETY: as the caller promises.
            unsafe { store(by_moment.cast(), found.moment) }
        }
        Err(error) => of_dipole(error),
    }
}

/// Makes sums that hold no information.
///
/// # Safety
/// `sums` is null or points to memory for sums.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_dipole_sums_init(sums: *mut GramianDipoleSums) -> GramianStatus {
    // SAFETY: as the caller promises; the size and alignment were asserted.
    unsafe { store(sums.cast(), Accumulator::<f32>::new()) }
}

/// Adds one sample of a three-axis sensor with standard deviation `sigma` (T): the
/// dipole is at `position`, `time` (s) after the instant of the state (r0, v, m).
///
/// # Safety
/// `sums` is null or was made by `gramian_dipole_sums_init`; the others are null or
/// point to three floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_dipole_sums_push(
    sums: *mut GramianDipoleSums,
    time: f32,
    position: *const f32,
    moment: *const f32,
    sigma: f32,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    let sums = unsafe { sums.cast::<Accumulator<f32>>().as_mut() };
    // SAFETY: as the caller promises.
    let (position, moment) = unsafe { (vector(position), vector(moment)) };
    let (Some(sums), Some(position), Some(moment)) = (sums, position, moment) else {
        return GramianStatus::Null;
    };
    let weight = 1.0 / (sigma * sigma);
    if !(sigma > 0.0 && weight > 0.0 && weight.is_finite()) {
        return GramianStatus::Sigma;
    }
    match sums.push(time, position, moment, weight) {
        Ok(()) => GramianStatus::Ok,
        Err(error) => of_dipole(error),
    }
}

/// Gives the information on (r0, v, m), 9 x 9, row by row.
///
/// # Safety
/// `sums` is null or was made by `gramian_dipole_sums_init`; `matrix` is null or
/// points to 81 floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_dipole_sums_matrix(
    sums: *const GramianDipoleSums,
    matrix: *mut f32,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    match unsafe { sums.cast::<Accumulator<f32>>().as_ref() } {
        // SAFETY: as the caller promises.
        Some(sums) => unsafe { store(matrix.cast(), sums.matrix()) },
        None => GramianStatus::Null,
    }
}

/// Makes a tracker of a target that is known to these deviations at time 0: x0, y0, vx,
/// vy (m, m/s).
///
/// # Safety
/// `tracker` is null or points to memory for a tracker; the others are null or point to
/// four floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_tracker_init(
    tracker: *mut GramianTracker,
    state: *const f32,
    sigma: *const f32,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    let (state, sigma) = unsafe {
        (
            state.cast::<[f32; 4]>().as_ref(),
            sigma.cast::<[f32; 4]>().as_ref(),
        )
    };
    let (Some(state), Some(sigma)) = (state, sigma) else {
        return GramianStatus::Null;
    };
    match Tracker::new(state, sigma) {
        // SAFETY: as the caller promises; the size and alignment were asserted.
        Ok(value) => unsafe { store(tracker.cast(), value) },
        Err(error) => of_tracks(error),
    }
}

/// Takes in a measurement at `time` (s) of a sensor at `place`, which moves at
/// `velocity` (m, m/s: east, north).
///
/// # Safety
/// `tracker` is null or was made by `gramian_tracker_init`; `place` and `velocity` are
/// null or point to two floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_tracker_push(
    tracker: *mut GramianTracker,
    sensor: GramianSensor,
    time: f32,
    reading: f32,
    sigma: f32,
    place: *const f32,
    velocity: *const f32,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    let tracker = unsafe { tracker.cast::<Tracker<f32, 4>>().as_mut() };
    // SAFETY: as the caller promises.
    let (place, velocity) = unsafe {
        (
            place.cast::<[f32; 2]>().as_ref(),
            velocity.cast::<[f32; 2]>().as_ref(),
        )
    };
    let (Some(tracker), Some(place), Some(velocity)) = (tracker, place, velocity) else {
        return GramianStatus::Null;
    };
    let sample = Sample {
        time,
        reading,
        sigma,
        place: *place,
        velocity: *velocity,
        axis: [0.0; 2],
    };
    let (motion, none) = (Polynomial::CONSTANT_VELOCITY, [0.0; 2]);
    let done = match sensor {
        GramianSensor::Bearing => tracker.push(&motion, &Bearing, &none, &sample),
        GramianSensor::Range => tracker.push(&motion, &Range { factor: 1.0 }, &none, &sample),
        GramianSensor::RangeRate => tracker.push(&motion, &RangeRate, &none, &sample),
    };
    match done {
        Ok(_) => GramianStatus::Ok,
        Err(error) => of_tracks(error),
    }
}

/// Multiplies what is known by `keep`, in (0, 1], and takes the alarm back.
///
/// # Safety
/// `tracker` is null or was made by `gramian_tracker_init`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_tracker_forget(
    tracker: *mut GramianTracker,
    keep: f32,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    match unsafe { tracker.cast::<Tracker<f32, 4>>().as_mut() } {
        Some(tracker) => match tracker.forget(keep) {
            Ok(()) => GramianStatus::Ok,
            Err(error) => of_tracks(error),
        },
        None => GramianStatus::Null,
    }
}

/// Says what the measurements so far determine.
///
/// # Safety
/// `tracker` is null or was made by `gramian_tracker_init`; `track` is null or points to
/// memory for one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gramian_tracker_answer(
    tracker: *const GramianTracker,
    track: *mut GramianTrack,
) -> GramianStatus {
    // SAFETY: as the caller promises.
    let Some(tracker) = (unsafe { tracker.cast::<Tracker<f32, 4>>().as_ref() }) else {
        return GramianStatus::Null;
    };
    let found = tracker.answer();
    let value = GramianTrack {
        state: found.state,
        std: found.std,
        chi2: found.chi2,
        p_value: found.p_value,
        count: found.count,
        alarm: u32::from(found.alarm),
    };
    // SAFETY: as the caller promises.
    unsafe { store(track, value) }
}

/// Three floats, or nothing where the pointer is null.
unsafe fn vector<'a>(place: *const f32) -> Option<&'a [f32; 3]> {
    // SAFETY: as the caller promises.
    unsafe { place.cast::<[f32; 3]>().as_ref() }
}

/// Writes a value where a pointer that is not null points.
unsafe fn store<T>(place: *mut T, value: T) -> GramianStatus {
    if place.is_null() {
        return GramianStatus::Null;
    }
    // SAFETY: not null, and as the caller promises.
    unsafe { place.write(value) };
    GramianStatus::Ok
}

fn of_bearings(error: bearings::Error) -> GramianStatus {
    match error {
        bearings::Error::Times { .. } => GramianStatus::Time,
        bearings::Error::Sigma { .. } => GramianStatus::Sigma,
        bearings::Error::Distance { .. } => GramianStatus::Range,
        bearings::Error::Mixed { .. } => GramianStatus::Mixed,
        bearings::Error::Number(error) => of_number(error),
        _ => GramianStatus::NotFinite,
    }
}

fn of_dipole(error: dipole::Error) -> GramianStatus {
    match error {
        dipole::Error::OnSensor { .. } => GramianStatus::Range,
        dipole::Error::Sigma { .. } => GramianStatus::Sigma,
        dipole::Error::Number(error) => of_number(error),
    }
}

fn of_tracks(error: tracks::Error) -> GramianStatus {
    match error {
        tracks::Error::NoReading { .. } => GramianStatus::Range,
        tracks::Error::Number(NumberError::OutOfRange { .. }) => GramianStatus::Sigma,
        tracks::Error::Number(error) => of_number(error),
        _ => GramianStatus::NotFinite,
    }
}

fn of_number(error: NumberError) -> GramianStatus {
    match error {
        NumberError::Overflow { .. } => GramianStatus::Overflow,
        // The arrays of this interface have one length: the last never comes.
        NumberError::NotFinite { .. }
        | NumberError::OutOfRange { .. }
        | NumberError::Length { .. } => GramianStatus::NotFinite,
    }
}
