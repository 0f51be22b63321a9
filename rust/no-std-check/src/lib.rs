//! Fails to build if the crate pulls in std (its panic handler would clash with
//! the one below) or alloc (there is no allocator here).
#![no_std]

use core::cell::Cell;

use gramian::bearings::{self, Form, Monitor};
use gramian::bound;
use gramian::chi_square;
use gramian::dipole::{self, Accumulator, Pass, Sensors};
use gramian::information::Information;
use gramian::linear;
use gramian::maneuver::plan::{self, Criterion, Legs, Target};
use gramian::maneuver::steer::{self, Limits};
use gramian::maneuver::{self, AtStandoff, Law, Side, Steering};
use gramian::posterior::{self, ConstrainedPosterior, Posterior};
use gramian::registration::degree::Running;
use gramian::registration::pair::Plane;
use gramian::registration::{Layout, look};
use gramian::rows::RowSink;
use gramian::scalar::{Real, wrap_angle};
use gramian::spectrum::Spectrum;
use gramian::square_root::SquareRootInformation;
use gramian::tracks::motion::{self, CoordinatedTurn, Polynomial, SteadyLegs, Turns};
use gramian::tracks::sensors::{Bearing, ConeAngle, Frequency, Range, RangeRate, SignalStrength};
use gramian::tracks::stream::{Sample, Tracker};

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

/// Uses every module in single precision, so that nothing is left out of the link.
#[unsafe(no_mangle)]
pub extern "C" fn no_std_check_single(x: f32) -> f32 {
    sum_of_all(x)
}

/// The same in double precision.
#[unsafe(no_mangle)]
pub extern "C" fn no_std_check_double(x: f64) -> f64 {
    sum_of_all(x)
}

/// A sum of results, so that none can be left out.
struct Sum<T>(Cell<T>);

impl<T: Real> Sum<T> {
    fn add(&self, values: &[T]) {
        for &value in values {
            self.0.set(self.0.get() + value);
        }
    }

    fn one<E>(&self, value: Result<T, E>) {
        self.all(value.map(|value| [value]));
    }

    fn all<E, const N: usize>(&self, values: Result<[T; N], E>) {
        match values {
            Ok(values) => self.add(&values),
            Err(_) => self.add(&[T::one()]),
        }
    }

    fn done<E>(&self, result: Result<(), E>) {
        self.one(result.map(|()| T::zero()));
    }
}

fn sum_of_all<T: Real>(x: T) -> T {
    let sum = Sum(Cell::new(T::zero()));
    spine(x, &sum);
    bearings(x, &sum);
    dipole(x, &sum);
    maneuver(x, &sum);
    registration(x, &sum);
    tracks(x, &sum);
    let found = linear::levels(&[[x, T::one()], [T::zero(), x]], &[[x, x]]);
    sum.one(found.map(|found| T::of(found.ranks[1] as f64)));
    sum.0.get()
}

fn tracks<T: Real>(x: T, sum: &Sum<T>) {
    let sample = Sample {
        time: x,
        reading: x,
        sigma: T::one(),
        place: [x, T::one()],
        velocity: [x, x],
        axis: [T::one(), T::zero()],
    };
    let none = [x, T::one()];
    let Ok(mut tracker) = Tracker::new(&[x; 4], &[T::one(); 4]) else {
        return;
    };
    let line = Polynomial::CONSTANT_VELOCITY;
    sum.done(tracker.push(&line, &Bearing, &none, &sample).map(|_| ()));
    sum.done(tracker.push(&line, &Range { factor: 1.0 }, &none, &sample).map(|_| ()));
    sum.done(tracker.push(&line, &RangeRate, &none, &sample).map(|_| ()));
    sum.done(tracker.push(&line, &Frequency { speed: 1500.0 }, &none, &sample).map(|_| ()));
    sum.add(&tracker.answer().std);
    let Ok(mut tracker) = Tracker::new(&[x; 5], &[T::one(); 5]) else {
        return;
    };
    sum.done(tracker.push(&CoordinatedTurn, &ConeAngle, &none, &sample).map(|_| ()));
    sum.add(&tracker.answer().state);
    let Ok(mut tracker) = Tracker::new(&[x; 7], &[T::one(); 7]) else {
        return;
    };
    let legs = motion::Legs { turns: Turns::Unknown(1) };
    sum.done(tracker.push(&legs, &SignalStrength, &none, &sample).map(|_| ()));
    sum.add(&tracker.answer().state);
    let Ok(mut tracker) = Tracker::new(&[x; 5], &[T::one(); 5]) else {
        return;
    };
    let steady = SteadyLegs { turns: Turns::Known(&[1.0]) };
    sum.done(tracker.push(&steady, &Bearing, &none, &sample).map(|_| ()));
    sum.add(&tracker.answer().state);
}

fn spine<T: Real>(x: T, sum: &Sum<T>) {
    let row = [x, T::one(), x * x];
    let mut root = SquareRootInformation::<T, 3>::new();
    sum.done(root.push(&row));
    let other = root;
    sum.done(root.merge(&other));
    sum.done(root.forget(x));
    sum.add(&[root.determinant(), root.log_determinant()]);
    sum.add(&root.crlb_std());
    sum.add(root.crlb().unwrap_or([row; 3]).as_flattened());
    sum.add(&root.null_direction(root.rank()).unwrap_or(row));
    if let Ok(spectrum) = Spectrum::with_rtol(&root, x) {
        sum.add(&bound::crlb_std(&spectrum));
    }
    let mut information = Information::<T, 3>::new();
    sum.done(RowSink::push(&mut information, &row));
    sum.done(information.prior(1, x));
    let left = information.marginalize_others(&[0, 2]);
    sum.one(left.map(|left| left.matrix()[(0, 1)]));
    let mut known = Posterior::<T, 3>::unknown();
    sum.done(known.update(&row));
    sum.done(known.predict(&[row; 3], &[row]));
    sum.add(&known.standard_deviations());
    let mut constrained = ConstrainedPosterior::<T, 3>::unknown();
    sum.done(constrained.know(&row));
    sum.done(constrained.update(&row));
    sum.done(constrained.predict(&[row; 3], &[row]));
    sum.add(&constrained.standard_deviations());
    let known = constrained.information();
    sum.add(known.crlb().unwrap_or([row; 3]).as_flattened());
    sum.add(&known.null_direction(known.rank()).unwrap_or(row));
    let mut factor = [T::zero(); 4];
    sum.done(posterior::semidefinite_root(&[x, x, x, x], 2, &mut factor));
    sum.add(&factor);
    sum.one(chi_square::survival(x, x));
    sum.one(wrap_angle(x));
}

fn bearings<T: Real>(x: T, sum: &Sum<T>) {
    let times = [0.0, 1.0, 2.0, 3.0, 4.0].map(T::of);
    let angles = times.map(|t| x * t);
    let mut root = SquareRootInformation::<T, 4>::new();
    let (here, there) = (times.map(|t| [t, x]), times.map(|t| [x, t]));
    sum.done(bearings::push_rows(&times, &here, &there, &[x], &mut root));
    let four = [x, T::one(), x, T::one()];
    sum.one(bearings::discriminant(&four, &four, Form::Sines));
    sum.one(bearings::discriminant_sum(&times, &angles, None));
    sum.one(bearings::discriminant_sum_qr(&times, &angles, None));
    sum.one(bearings::fixed_target_sum(&times, &angles, None));
    sum.one(bearings::fixed_target_sum_qr(&times, &angles, None));
    let test = bearings::observability_test(&times, &angles, &[x]);
    sum.all(test.map(|test| test.relative_motion));
    let mut monitor = Monitor::new();
    for t in times {
        sum.done(monitor.push(t, x * t, x, Some(x)));
    }
    sum.add(&monitor.answer().crlb_std);
    sum.one(bearings::bearing([x, x], [T::one(), x]));
    sum.all(bearings::position(&four, x));
    sum.all(bearings::motion::<T, 2>(&times, x));
    let (mut azimuth, mut elevation) = ([x; 6], [x; 6]);
    sum.done(bearings::motion_row(x, [x, x], x, &mut azimuth));
    sum.done(bearings::azimuth_elevation_rows(
        x,
        [x; 3],
        [x; 2],
        &mut azimuth,
        &mut elevation,
    ));
    sum.add(&azimuth);
}

fn dipole<T: Real>(x: T, sum: &Sum<T>) {
    let vector = [x, T::one(), x * x];
    sum.all(dipole::field(&vector, &vector));
    let jacobian = dipole::jacobian(&vector, &vector);
    sum.all(jacobian.map(|jacobian| jacobian.position[0]));
    sum.all(dipole::moment(&vector, &[vector; 3], x, &vector));
    let mut sums = Accumulator::new();
    sum.done(sums.push(x, &vector, &vector, x));
    let other = sums;
    sum.done(sums.merge(&other));
    sum.add(sums.matrix().as_flattened());
    let pass = Pass::of(&[x; 9]);
    sum.all(pass.seen_from(&vector, x));
    sum.all(pass.scaled(x).map(|pass| pass.mirrored().state()));
    let mut out = [x; 2];
    let times = [x, x];
    let sensors = Sensors {
        places: &[vector],
        baselines: &[vector],
        ambient: Some(vector),
    };
    sum.done(sensors.measure(&times, &pass, &mut out));
    sum.add(&out);
    let mut root = SquareRootInformation::new();
    sum.done(sensors.push_rows(&times, &pass, &[x], &mut root));
    sum.add(&root.factor()[0]);
}

fn maneuver<T: Real>(x: T, sum: &Sum<T>) {
    let (law, side) = (Law::HammelLiu, Side::Left);
    sum.one(maneuver::heading(x, x, x, law, side));
    let steering = Steering {
        law,
        side,
        step: x,
        standoff: x,
        at_standoff: AtStandoff::Circle,
    };
    let leg = steering.leg([x, x], [x, T::one()]);
    sum.all(leg.map(|leg| leg.map_or([x, x], |leg| leg.end)));
    let mut root = SquareRootInformation::<T, 2>::new();
    if let Ok(row) = maneuver::row(x, T::one(), x) {
        sum.done(root.push(&row));
    }
    let best = maneuver::best_heading(&root, [x, x], [T::one(), x], x, x, x, &[x, -x]);
    sum.one(best.map(|best| best.map_or(x, |best| best.determinant)));
    let limits = Limits {
        standoff: x,
        targets: &[[x; 4]],
        keep_out: &[[x; 3]],
        max_turn: x,
    };
    sum.one(steer::escape([x, x], x, &limits).map(|found| found.unwrap_or(x)));
    let found = steer::steer([x, x], x, x, x, Some(x), &limits);
    sum.one(found.map(|found| found.unwrap_or(x)));
    let legs = Legs {
        start: [x, x],
        dt: x,
        headings: &[x, -x],
        lengths: &[x, x],
        counts: &[1, 2],
    };
    let target = Target {
        state: [x, T::one(), x, x],
        sigma: x,
        prior: &root,
        scale: [x, x],
    };
    let criterion = Criterion::LogDet;
    sum.one(plan::value(&legs, &target, &criterion));
    let mut values = [x; 4];
    sum.done(plan::along(&legs, &target, &criterion, &mut values));
    let (mut by_heading, mut by_length) = ([x; 2], [x; 2]);
    sum.one(plan::gradient(
        &legs,
        &target,
        &criterion,
        x,
        &mut by_heading,
        &mut by_length,
    ));
    sum.add(&by_heading);
}

fn registration<T: Real>(x: T, sum: &Sum<T>) {
    let (a, b) = ([x, T::one()], [-x, T::one()]);
    if let (Ok(one), Ok(two)) = (Plane::new(a, b, &a, &a), Plane::new(b, a, &a, &a)) {
        sum.add(one.projector().as_flattened());
        sum.add(&[one.pair_degree(&two)]);
        sum.one(one.determinant(&two));
    }
    if let Ok(mut running) = Running::new(a, b, a, a) {
        sum.done(running.push([x, x]));
        sum.add(&[running.eta()]);
    }
    let sensors = [x, T::one(), -x, T::one()];
    let (mut work, mut rows) = ([x; 35], [x; 8]);
    sum.done(look::rows(
        &Layout::PAIR,
        &sensors,
        &sensors,
        &sensors,
        &a,
        &mut work,
        &mut rows,
    ));
    sum.add(&rows);
    let mut place = [x; 2];
    sum.done(look::place(&Layout::PAIR, &a, &a, &b, &mut place));
    let linear = look::linearise(&Layout::PAIR, &a, &a, &a, &b);
    sum.all(linear.map(|linear| linear.measured));
}
