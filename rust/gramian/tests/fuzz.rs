//! Random bit patterns for every public function of the surface without `std`, in
//! `f32` and `f64`: none may panic or run without end, accept a number that is not
//! finite in silence, or return one without an error. Infinity is an answer only
//! where the documentation says so, NaN nowhere; a refused call changes nothing.
//!
//! `GRAMIAN_FUZZ` is the number of patterns for each function (`make fuzz` takes a
//! million). A pattern that fails is named in the message by its number.
//!
//! # A new function
//! Write a case, `fn name<T: Number>(draw: &mut Draw<T>)`, that draws the inputs from
//! `draw`, hands the result to [`Draw::taken`] and what is in it to [`Draw::finite`],
//! [`Draw::bounds`] or [`Draw::ordered`], and list it in [`CASES`].
//! `every_public_function_has_a_case` fails until the function's name is called here.
//! What only hands out a field, or changes no number, stands in [`NOTHING_TO_TEST`].
#![allow(clippy::unwrap_used, clippy::print_stderr)]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use gramian::bearings::{self, Form, Monitor};
use gramian::bound;
use gramian::chi_square;
use gramian::dipole::{self, Accumulator, Pass, Sensors, quadrupole};
use gramian::inertial::{
    self, Group, Leg, Motion, Output, Recorded, Sample, Segments, Start, Sway,
};
use gramian::information::Information;
use gramian::linear;
use gramian::maneuver::plan::{self, Criterion, Legs, Target};
use gramian::maneuver::steer::{self, Limits};
use gramian::maneuver::{self, AtStandoff, Law, Side, Steering};
use gramian::posterior::{self, ConstrainedPosterior, Posterior};
use gramian::registration::degree::Running;
use gramian::registration::pair::Plane;
use gramian::registration::{Dimension, Layout, look};
use gramian::rows::RowSink;
use gramian::scalar::{Real, wrap_angle};
use gramian::spectrum::Spectrum;
use gramian::square_root::SquareRootInformation;

/// A number type with its bits.
trait Number: Real {
    /// Decimal exponents of the smallest and the largest number.
    const RANGE: (f64, f64);
    fn of_bits(bits: u64) -> Self;
    fn special(index: u64) -> Self;
}

macro_rules! number {
    ($type:ident, $bits:ty, $range:expr) => {
        impl Number for $type {
            const RANGE: (f64, f64) = $range;
            #[allow(clippy::cast_possible_truncation)]
            fn of_bits(bits: u64) -> Self {
                Self::from_bits(bits as $bits)
            }
            fn special(index: u64) -> Self {
                let values = [
                    0.0,
                    -0.0,
                    1.0,
                    -1.0,
                    Self::INFINITY,
                    Self::NEG_INFINITY,
                    Self::NAN,
                    Self::MIN_POSITIVE,
                    -Self::MIN_POSITIVE,
                    Self::from_bits(1),
                    Self::MAX,
                    Self::MIN,
                    Self::EPSILON,
                    core::$type::consts::PI,
                ];
                values[usize::try_from(index).unwrap() % values.len()]
            }
        }
    };
}
number!(f32, u32, (-45.0, 38.5));
#[allow(clippy::unnecessary_cast)]
mod double {
    use super::Number;
    number!(f64, u64, (-323.0, 308.2));
}

/// What the entries of a pattern look like.
#[derive(Clone, Copy)]
enum Kind {
    Bits,
    Anything,
    Ordinary,
    OrdinaryButOne,
    /// Decimal exponents up to this part of the type's range.
    Wide(f64),
    /// One size for all, up to rounding of their own.
    Scaled(f64),
}

fn all_finite<T: Number>(values: &[T]) -> bool {
    values.iter().all(|&x| x.is_finite())
}

struct Draw<T> {
    name: &'static str,
    state: u64,
    pattern: u64,
    kind: Kind,
    sound: bool,
    mark: core::marker::PhantomData<T>,
}

impl<T: Number> Draw<T> {
    fn new(name: &'static str) -> Self {
        Self {
            name,
            state: 0,
            pattern: 0,
            kind: Kind::Bits,
            sound: true,
            mark: core::marker::PhantomData,
        }
    }

    /// `SplitMix64`.
    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: u64) -> u64 {
        self.bits() % count
    }

    fn index(&mut self, count: usize) -> usize {
        usize::try_from(self.below(count as u64)).unwrap()
    }

    /// In [0, 1).
    fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn start(&mut self, pattern: u64) {
        self.pattern = pattern;
        self.state = pattern.wrapping_mul(0xd134_2543_de82_ef95) ^ 0x5851_f42d;
        self.again();
        let size = (self.uniform() * 2.0 - 1.0) * T::RANGE.1;
        self.kind = match self.below(12) {
            0 => Kind::Bits,
            1 => Kind::Anything,
            2..=4 => Kind::Ordinary,
            5 | 6 => Kind::OrdinaryButOne,
            7 => Kind::Wide(1.0),
            8 => Kind::Wide(0.5),
            9 => Kind::Wide(0.1),
            _ => Kind::Scaled(size),
        };
    }

    /// Inputs count for the next call from here on.
    fn again(&mut self) {
        self.sound = true;
    }

    fn ordinary(&mut self) -> T {
        let scale = [1.0, 10.0, 1e4][self.index(3)];
        // Whole numbers meet each other and zero.
        let value = (self.uniform() * 2.0 - 1.0) * scale;
        T::of(if self.below(4) == 0 {
            value.round()
        } else {
            value
        })
    }

    fn free(&mut self) -> T {
        match self.kind {
            Kind::Bits => T::of_bits(self.bits()),
            Kind::Anything => match self.below(4) {
                0 => T::of_bits(self.bits()),
                1 => {
                    let index = self.below(64);
                    T::special(index)
                }
                2 => self.wide(1.0),
                _ => self.ordinary(),
            },
            Kind::Ordinary => self.ordinary(),
            Kind::OrdinaryButOne => {
                if self.below(8) == 0 {
                    let index = self.below(64);
                    T::special(index)
                } else {
                    self.ordinary()
                }
            }
            Kind::Wide(part) => self.wide(part),
            Kind::Scaled(exponent) => {
                let value = self.ordinary().double();
                // In two steps: the power alone may not be a number.
                T::of(value * 10_f64.powf(exponent / 2.0)) * T::of(10_f64.powf(exponent / 2.0))
            }
        }
    }

    fn wide(&mut self, part: f64) -> T {
        let (least, most) = T::RANGE;
        let exponent = part * (least + self.uniform() * (most - least));
        let value = T::of(10_f64.powf(exponent));
        if self.below(2) == 0 { value } else { -value }
    }

    /// A number that must be finite.
    fn x(&mut self) -> T {
        let value = self.free();
        self.sound &= value.is_finite();
        value
    }

    /// A magnitude that may be infinite.
    fn or_infinite(&mut self) -> T {
        let value = self.free().abs();
        self.sound &= value.is_finite() || value == T::INFINITY;
        value
    }

    /// Above zero more often than not.
    fn positive(&mut self) -> T {
        let value = self.x();
        if self.below(8) == 0 {
            value
        } else {
            value.abs()
        }
    }

    fn array<const N: usize>(&mut self) -> [T; N] {
        core::array::from_fn(|_| self.x())
    }

    fn arrays<const N: usize, const M: usize>(&mut self) -> [[T; N]; M] {
        core::array::from_fn(|_| self.array())
    }

    fn positives<const N: usize>(&mut self) -> [T; N] {
        core::array::from_fn(|_| self.positive())
    }

    fn numbers(&mut self, count: usize) -> Vec<T> {
        (0..count).map(|_| self.x()).collect()
    }

    /// Instants, increasing more often than not.
    fn times(&mut self, count: usize) -> Vec<T> {
        let mut times = self.numbers(count);
        if self.below(8) > 0 {
            for i in 1..count {
                times[i] = times[i - 1] + times[i].abs();
                self.sound &= times[i].is_finite();
            }
        }
        times
    }

    fn place(&self) -> String {
        format!("{}, pattern {}", self.name, self.pattern)
    }

    /// A result, `None` for an error. Nothing may be taken that is not finite.
    fn taken<V, E>(&self, result: Result<V, E>) -> Option<V> {
        if result.is_ok() {
            assert!(self.sound, "{}: taken though not finite", self.place());
        }
        result.ok()
    }

    fn finite(&self, values: &[T]) {
        for x in values {
            assert!(x.is_finite(), "{}: gave {x}", self.place());
        }
    }

    /// Not negative, perhaps infinite.
    fn bounds(&self, values: &[T]) {
        for x in values {
            assert!(*x >= T::zero(), "{}: gave {x}", self.place());
        }
    }

    /// Anything but NaN.
    fn ordered(&self, values: &[T]) {
        for x in values {
            assert!(
                x.partial_cmp(&T::zero()).is_some(),
                "{}: gave {x}",
                self.place()
            );
        }
    }

    fn unchanged<V: PartialEq + core::fmt::Debug, E>(
        &self,
        result: &Result<(), E>,
        now: &V,
        before: &V,
    ) {
        if result.is_err() {
            assert_eq!(now, before, "{}: an error changed it", self.place());
        }
    }
}

/// Some rows, taken or not.
fn information_of<T: Number, const N: usize>(draw: &mut Draw<T>) -> SquareRootInformation<T, N> {
    let mut root = SquareRootInformation::new();
    for _ in 0..draw.index(N + 3) {
        draw.again();
        let (row, before) = (draw.array(), root);
        let result = root.push(&row);
        draw.unchanged(&result, &root, &before);
        draw.taken(result);
        draw.finite(root.factor().as_flattened());
    }
    draw.again();
    root
}

fn square_root_of<T: Number, const N: usize>(draw: &mut Draw<T>) {
    let mut root = information_of::<T, N>(draw);
    let other = information_of::<T, N>(draw);
    let before = root;
    let result = root.merge(&other);
    draw.unchanged(&result, &root, &before);
    let (keep, before) = (draw.positive(), root);
    let result = root.forget(keep);
    draw.unchanged(&result, &root, &before);
    draw.taken(result);
    draw.finite(root.factor().as_flattened());
    answers_of(draw, &root);
    draw.bounds(&[root.determinant(), root.root_determinant()]);
    draw.ordered(&[root.log_determinant()]);
    draw.bounds(&root.crlb_std());
    assert!(
        root.crlb()
            .is_none_or(|crlb| all_finite(crlb.as_flattened()))
    );
    let nullity = (0..N).filter_map(|i| root.null_direction(i)).count();
    assert_eq!(root.rank() + nullity, N, "{}", draw.place());
}

fn answers_of<T: Number, const N: usize>(draw: &mut Draw<T>, root: &SquareRootInformation<T, N>) {
    let spectrum = root.spectrum();
    spectrum_of(draw, &spectrum);
    draw.again();
    let rtol = draw.positive();
    if let Some(spectrum) = draw.taken(Spectrum::with_rtol(root, rtol)) {
        spectrum_of(draw, &spectrum);
    }
}

fn spectrum_of<T: Number, const N: usize>(draw: &Draw<T>, spectrum: &Spectrum<T, N>) {
    draw.bounds(spectrum.singular_values());
    draw.finite(spectrum.singular_values());
    draw.finite(spectrum.scale());
    draw.finite(spectrum.vectors().as_flattened());
    draw.bounds(&bound::crlb_std(spectrum));
    if let Some(crlb) = bound::crlb(spectrum) {
        draw.finite(crlb.as_flattened());
    }
    for i in 0..N {
        if let Some(null) = spectrum.null_vector(i) {
            draw.finite(&null);
        }
    }
}

fn square_root<T: Number>(draw: &mut Draw<T>) {
    match draw.below(4) {
        0 => square_root_of::<T, 1>(draw),
        1 => square_root_of::<T, 2>(draw),
        2 => square_root_of::<T, 3>(draw),
        _ => square_root_of::<T, 4>(draw),
    }
}

fn spectrum<T: Number>(draw: &mut Draw<T>) {
    let root = information_of::<T, 3>(draw);
    spectrum_of(draw, &Spectrum::new(&root));
    let rtol: T = gramian::spectrum::default_rtol(draw.index(1 << 40), draw.index(1 << 20));
    draw.finite(&[rtol]);
}

fn row_sinks<T: Number>(draw: &mut Draw<T>) {
    let row = draw.array::<3>();
    let mut information = Information::new();
    draw.taken(RowSink::push(&mut information, &row));
    let mut root = SquareRootInformation::new();
    draw.taken(RowSink::push(&mut root, &row));
    #[cfg(feature = "alloc")]
    draw.taken(RowSink::push(&mut Vec::new(), &row));
}

fn information<T: Number>(draw: &mut Draw<T>) {
    let mut sum = Information::<T, 4>::new();
    for _ in 0..draw.index(8) {
        draw.again();
        let (row, before) = (draw.array(), sum);
        let result = sum.push(&row);
        draw.unchanged(&result, &sum, &before);
        draw.taken(result);
    }
    draw.again();
    let (index, sigma, before) = (draw.index(6), draw.positive(), sum);
    let result = sum.prior(index, sigma);
    draw.unchanged(&result, &sum, &before);
    draw.taken(result);
    let before = sum;
    let result = sum.add(&before);
    draw.unchanged(&result, &sum, &before);
    draw.finite(sum.matrix().as_slice());
    let keep = [draw.index(5), draw.index(5)];
    let parts = [sum.fix_others(&keep), sum.marginalize_others(&keep)];
    for part in parts.into_iter().flatten() {
        draw.finite(part.matrix().as_slice());
    }
}

fn posterior<T: Number>(draw: &mut Draw<T>) {
    let mut bound = Posterior::<T, 3>::unknown();
    for _ in 0..draw.index(5) {
        draw.again();
        let (row, before) = (draw.array(), bound);
        let result = bound.update(&row);
        draw.unchanged(&result, &bound, &before);
        draw.taken(result);
        draw.again();
        let (inverse, noise) = (draw.arrays::<3, 3>(), draw.arrays::<3, 2>());
        let (before, count) = (bound, draw.index(3));
        draw.sound |= count < 2;
        let result = bound.predict(&inverse, &noise[..count]);
        draw.unchanged(&result, &bound, &before);
        if count == 2 {
            draw.taken(result);
        }
        draw.finite(bound.root().factor().as_flattened());
        draw.bounds(&bound.standard_deviations());
    }
}

fn constrained_posterior<T: Number>(draw: &mut Draw<T>) {
    let mut bound = ConstrainedPosterior::<T, 3>::unknown();
    for _ in 0..draw.index(6) {
        draw.again();
        let (row, before) = (draw.array(), bound);
        let result = match draw.below(2) {
            0 => bound.update(&row),
            _ => bound.know(&row),
        };
        draw.unchanged(&result, &bound, &before);
        draw.taken(result);
        draw.again();
        let (inverse, noise) = (draw.arrays::<3, 3>(), draw.arrays::<3, 2>());
        let (before, count) = (bound, draw.index(3));
        draw.sound |= count < 2;
        let result = bound.predict(&inverse, &noise[..count]);
        draw.unchanged(&result, &bound, &before);
        if count == 2 {
            draw.taken(result);
        }
        let known = bound.information();
        if let Some(crlb) = known.crlb() {
            draw.finite(crlb.as_flattened());
        }
        draw.bounds(&bound.standard_deviations());
        assert!(known.exact() <= known.rank());
    }
}

fn semidefinite_root<T: Number>(draw: &mut Draw<T>) {
    let n = draw.index(4);
    let mut covariance = draw.numbers(n * n);
    if draw.below(2) == 0 {
        for i in 0..n {
            for j in 0..i {
                covariance[i * n + j] = covariance[j * n + i];
            }
            covariance[i * n + i] = covariance[i * n + i].abs() * T::of(3.0);
        }
    }
    let mut out = vec![T::zero(); n * n + draw.index(2)];
    draw.sound = all_finite(&covariance);
    if draw
        .taken(posterior::semidefinite_root(&covariance, n, &mut out))
        .is_some()
    {
        draw.finite(&out);
    }
}

fn chi_square<T: Number>(draw: &mut Draw<T>) {
    let (value, dof) = (draw.positive(), draw.positive());
    if let Some(p) = draw.taken(chi_square::survival(value, dof)) {
        assert!(p >= T::zero() && p <= T::one(), "{}: {p}", draw.place());
    }
}

fn scalar<T: Number>(draw: &mut Draw<T>) {
    let angle = draw.x();
    if let Some(wrapped) = draw.taken(wrap_angle(angle)) {
        assert!(
            wrapped > -T::pi() && wrapped <= T::pi(),
            "{}: {wrapped}",
            draw.place()
        );
    }
}

fn inertial_models<T: Number>(draw: &mut Draw<T>) {
    // Each call is given all that was drawn since the last `again`, and no more.
    let latitude = draw.x();
    if let Some((meridian, normal)) = draw.taken(inertial::radii(latitude)) {
        draw.finite(&[meridian, normal]);
    }
    let height = draw.x();
    if let Some(g) = draw.taken(inertial::gravity(latitude, height)) {
        draw.finite(&[g]);
    }
    draw.taken(inertial::check_place(latitude, height));
    let rate = draw.x();
    if let Some(rows) = draw.taken(inertial::combinations_at_rest(latitude, height, rate)) {
        draw.finite(rows.as_flattened());
    }
    let mut motion = Motion::at_rest(latitude, height, rate);
    motion.velocity = draw.array();
    motion.angular_rate = draw.array();
    motion.lever_arm = draw.array();
    motion.odometer_arm = draw.array();
    if draw.below(2) == 0 {
        motion.specific_force = Some(draw.array());
    }
    let motion_is_sound = draw.sound;
    draw.again();
    let [heading, pitch, roll] = draw.array();
    if let Some(attitude) = draw.taken(inertial::rotation(heading, pitch, roll)) {
        draw.finite(attitude.as_flattened());
        motion.attitude = attitude;
    }
    // An attitude that was refused is not in the motion.
    draw.sound = motion_is_sound;
    if let Some(model) = draw.taken(inertial::error_model(&motion)) {
        draw.finite(model.a.as_flattened());
        draw.finite(&model.per_metre);
        for output in [
            Output::Velocity,
            Output::Position,
            Output::Odometer,
            Output::SideSlip,
            Output::ZeroVelocity,
            Output::ZeroAngularRate,
            Output::Heading,
        ] {
            if let Some(lines) = draw.taken(model.output(output)) {
                draw.finite(lines.as_flattened());
            }
        }
    }
    assert_eq!(Group::Core.columns().len(), 15);
    sways_and_flights(draw);
}

fn sways_and_flights<T: Number>(draw: &mut Draw<T>) {
    draw.again();
    let sway = Sway {
        amplitude: draw.array(),
        period: draw.positives(),
        phase: draw.array(),
    };
    let time = draw.x();
    if let Some(angles) = draw.taken(sway.at(time)) {
        draw.finite(&angles);
    }
    draw.again();
    let samples: [Sample<T>; 3] = core::array::from_fn(|leg| Sample {
        time: draw.x(),
        velocity: draw.array(),
        angles: draw.array(),
        leg,
    });
    let (place, [step, largest_turn], rate) = (draw.array(), draw.positives(), draw.x());
    if let Ok(recorded) = Recorded::new(&samples, place, step, largest_turn, rate) {
        for segment in recorded {
            if let Some(segment) = draw.taken(segment) {
                draw.finite(&[segment.duration, segment.heading, segment.speed]);
                draw.finite(&segment.motion.velocity);
                draw.finite(&segment.motion.angular_rate);
            }
        }
    }
    draw.again();
    let start = Start {
        latitude: draw.x(),
        longitude: draw.x(),
        height: draw.x(),
        speed: draw.x(),
        heading: draw.x(),
    };
    let [step, largest_turn, rate] = draw.positives();
    let start_is_sound = draw.sound;
    let legs: [Leg<T>; 2] = core::array::from_fn(|_| Leg {
        duration: draw.positive(),
        turn: draw.x(),
        speed_change: draw.x(),
        bank: draw.x(),
    });
    let Ok(segments) = Segments::new(&legs, start, step, largest_turn, rate) else {
        return;
    };
    assert!(start_is_sound, "{}: taken though not finite", draw.place());
    for segment in segments.take(20).map_while(Result::ok) {
        let motion = segment.motion;
        draw.finite(&[segment.duration, segment.time, segment.heading]);
        draw.finite(&[segment.speed, segment.longitude, motion.latitude]);
        draw.finite(&motion.velocity);
        draw.finite(&motion.specific_force.unwrap());
    }
}

fn discriminants<T: Number>(draw: &mut Draw<T>) {
    let (times, angles) = (draw.array(), draw.array());
    for form in [Form::Sines, Form::Products, Form::Cotangents] {
        if let Some(value) = draw.taken(bearings::discriminant(&times, &angles, form)) {
            draw.finite(&[value]);
        }
    }
}

fn sums<T: Number>(draw: &mut Draw<T>) {
    let count = draw.index(8);
    let (times, angles) = (draw.times(count), draw.numbers(count));
    let weights: Vec<T> = (0..count).map(|_| draw.positive()).collect();
    for weights in [Some(weights.as_slice()), None] {
        if weights.is_none() {
            draw.sound = all_finite(&times) && all_finite(&angles);
        }
        draw.taken(bearings::check_track(&times, &angles, weights, 2));
        for sum in [
            bearings::discriminant_sum(&times, &angles, weights),
            bearings::discriminant_sum_qr(&times, &angles, weights),
            bearings::fixed_target_sum(&times, &angles, weights),
            bearings::fixed_target_sum_qr(&times, &angles, weights),
        ] {
            if let Some(sum) = draw.taken(sum) {
                draw.finite(&[sum]);
            }
        }
    }
}

fn observability_test<T: Number>(draw: &mut Draw<T>) {
    let count = draw.index(9);
    let (times, angles) = (draw.times(count), draw.numbers(count));
    let many = if draw.below(2) == 0 { 1 } else { count };
    let sigma: Vec<T> = (0..many).map(|_| draw.positive()).collect();
    if let Some(test) = draw.taken(bearings::observability_test(&times, &angles, &sigma)) {
        draw.finite(&[test.statistic, test.p_value]);
        draw.finite(&test.relative_motion);
    }
}

fn monitor<T: Number>(draw: &mut Draw<T>) {
    let mut monitor = Monitor::<T>::new();
    let ranged = draw.below(2) == 0;
    let mut time = draw.x();
    for _ in 0..draw.index(10) {
        draw.again();
        if draw.below(8) > 0 {
            let step = draw.x().abs();
            time += step;
        } else {
            time = draw.free();
        }
        draw.sound = time.is_finite();
        let (bearing, sigma) = (draw.x(), draw.positive());
        let distance = ranged.then(|| draw.positive());
        let before = monitor;
        let result = monitor.push(time, bearing, sigma, distance);
        draw.unchanged(&result, &monitor, &before);
        if draw.taken(result).is_none() && !time.is_finite() {
            time = T::zero();
        }
        let answer = monitor.answer();
        assert!(answer.count == monitor.count() && answer.rank <= 4);
        draw.bounds(&answer.crlb_std);
        draw.bounds(&[answer.determinant]);
        draw.ordered(&[answer.log_determinant]);
        draw.finite(&[
            answer.singular_value,
            answer.statistic,
            answer.dof,
            answer.p_value,
        ]);
        draw.finite(&answer.relative_motion);
    }
}

fn motions<T: Number>(draw: &mut Draw<T>) {
    let count = draw.index(9);
    let (state, time) = (draw.numbers(count), draw.x());
    if let Some(place) = draw.taken(bearings::motion::<T, 2>(&state, time)) {
        draw.finite(&place);
    }
    if let Some(place) = draw.taken(bearings::motion::<T, 3>(&state, time)) {
        draw.finite(&place);
    }
    draw.again();
    let (time, offset, sigma) = (draw.x(), draw.array(), draw.positive());
    let mut out = vec![T::zero(); draw.index(9)];
    let result = bearings::motion_row(time, offset, sigma, &mut out);
    if draw.taken(result).is_some() {
        draw.finite(&out);
    }
    draw.again();
    let (time, offset, sigma) = (draw.x(), draw.array(), draw.positives());
    let (n, more) = (draw.index(13), draw.index(2));
    let (mut azimuth, mut elevation) = (vec![T::zero(); n], vec![T::zero(); n + more]);
    let result =
        bearings::azimuth_elevation_rows(time, offset, sigma, &mut azimuth, &mut elevation);
    if draw.taken(result).is_some() {
        draw.finite(&azimuth);
        draw.finite(&elevation);
    }
}

fn bearing_rows<T: Number>(draw: &mut Draw<T>) {
    let (time, east, north, sigma) = (draw.x(), draw.x(), draw.x(), draw.positive());
    if let Some(row) = draw.taken(bearings::row(time, east, north, sigma)) {
        draw.finite(&row);
    }
    draw.again();
    let (state, time) = (draw.array(), draw.x());
    if let Some(place) = draw.taken(bearings::position(&state, time)) {
        draw.finite(&place);
    }
    draw.again();
    let (observer, target) = (draw.array(), draw.array());
    if let Some(bearing) = draw.taken(bearings::bearing(observer, target)) {
        draw.finite(&[bearing]);
    }
    draw.again();
    let times = draw.array::<3>();
    let (observer, target) = (draw.arrays::<2, 3>(), draw.arrays::<2, 3>());
    let sigma = draw.positives::<3>();
    let mut root = SquareRootInformation::new();
    draw.taken(bearings::push_rows(
        &times, &observer, &target, &sigma, &mut root,
    ));
    draw.finite(root.factor().as_flattened());
}

fn fields<T: Number>(draw: &mut Draw<T>) {
    let (position, moment) = (draw.array(), draw.array());
    if let Some(field) = draw.taken(dipole::field(&position, &moment)) {
        draw.finite(&field);
    }
    if let Some(jacobian) = draw.taken(dipole::jacobian(&position, &moment)) {
        draw.finite(jacobian.position.as_flattened());
        draw.finite(jacobian.moment.as_flattened());
    }
    draw.again();
    let (permanent, attitude) = (draw.array(), draw.arrays::<3, 3>());
    let (volume, earth) = (draw.x(), draw.array());
    if let Some(moment) = draw.taken(dipole::moment(&permanent, &attitude, volume, &earth)) {
        draw.finite(&moment);
    }
}

/// Motions and names of bodies of several dipoles, in double precision alone.
#[cfg(feature = "std")]
fn bodies<T: Number>(draw: &mut Draw<T>) {
    use dipole::description::{Description, Motion};
    let state: [T; 9] = draw.array();
    let ([t], more): ([T; 1], [T; 3]) = (draw.array(), draw.array());
    let (state, more) = (state.map(Real::double), more.map(Real::double));
    for motion in [
        Motion::Straight,
        Motion::Along,
        Motion::Accelerated,
        Motion::Turning,
    ] {
        assert_eq!(motion.names().0.len(), motion.states());
        // No input is refused: what overflows is told by the rows made of it.
        let step = motion.at(&state, &more[..motion.states()], t.double());
        let _ = (
            step.turn(&[1.0, 2.0, 3.0]),
            step.turn_by_rate(&[1.0, 2.0, 3.0]),
        );
    }
    assert_eq!(Description::source(1)[3].0, "mx of dipole 2");
    let q: [T; 5] = draw.array();
    let [moment, change]: [[T; 3]; 2] = draw.arrays();
    let (q, moment) = (q.map(Real::double), moment.map(Real::double));
    let step = Motion::Turning.at(&state, &more[..Motion::Turning.states()], t.double());
    let _ = step.turn_tensor(&quadrupole::tensor(&q));
    let centre = [0, 1, 2].map(|_| draw.below(2) == 0);
    let entries = quadrupole::Entries::new(centre, &moment);
    let count = entries.free().len();
    assert_eq!(count, 5 - centre.iter().filter(|c| **c).count());
    // What does not follow is not finite, and is told by the rows made of it.
    let whole = entries.whole(&moment, &q[..count]);
    let _ = whole.along(&change.map(Real::double));
}

/// The field of a quadrupole, and its five numbers.
fn quadrupoles<T: Number>(draw: &mut Draw<T>) {
    let (position, q): ([T; 3], [T; 5]) = (draw.array(), draw.array());
    if let Some(field) = draw.taken(quadrupole::field(&position, &q)) {
        draw.finite(&field);
    }
    if let Some(jacobian) = draw.taken(quadrupole::jacobian(&position, &q)) {
        draw.finite(jacobian.position.as_flattened());
        draw.finite(jacobian.quadrupole.as_flattened());
    }
    if all_finite(&q) {
        assert_eq!(quadrupole::entries(&quadrupole::tensor(&q)), q);
    }
    let [moment, offset]: [[T; 3]; 2] = draw.arrays();
    let _ = quadrupole::moved(&moment, &offset);
}

/// What sensors of every kind read of a pass, and the rows of it.
fn sensors<T: Number>(draw: &mut Draw<T>) {
    let (pass, times): (_, [T; 4]) = (Pass::of(&draw.array()), draw.array());
    let places = draw.arrays::<3, 2>();
    let apart: Vec<[T; 3]> = (0..2 * draw.index(2)).map(|_| draw.array()).collect();
    let ambient = (draw.below(2) == 0).then(|| draw.array());
    let kind = Sensors {
        places: &places,
        baselines: &apart,
        ambient,
    };
    let mut out = vec![T::zero(); 4 * kind.channels()];
    let result = kind.measure(&times, &pass, &mut out);
    if draw.taken(result).is_some() {
        draw.finite(&out);
        assert!(kind.quiet() >= T::zero());
    }
    let sound = draw.sound;
    let sigma = draw.positives::<4>();
    // Infinite: not measured.
    draw.sound = sound && sigma.iter().all(|&s| s > T::zero());
    let mut root = SquareRootInformation::new();
    draw.taken(kind.push_rows(&times, &pass, &sigma, &mut root));
    draw.finite(root.factor().as_flattened());
    draw.sound = sound;
    let body: [T; 5] = draw.array();
    let result = kind.measure_body(&times, &pass, Some(&body), &mut out);
    if draw.taken(result).is_some() {
        draw.finite(&out);
    }
    draw.sound &= sigma.iter().all(|&s| s > T::zero());
    let mut root = SquareRootInformation::new();
    let result = kind.push_rows_with_quadrupole(&times, &pass, &body, &sigma, &mut root);
    draw.taken(result);
    draw.finite(root.factor().as_flattened());
    let heads = kind.heads(0).count();
    assert_eq!(heads, 1 + kind.baselines.len() / 2);
    assert_eq!(kind.channels(), kind.components() * places.len());
    assert_eq!(kind.along().is_some(), ambient.is_some());
    assert_eq!(kind.plain(), heads == 1 && ambient.is_none());
    assert!(Sensors::vector(&places).plain());
}

fn passes<T: Number>(draw: &mut Draw<T>) {
    let pass = Pass::of(&draw.array());
    let sound = draw.sound;
    let moving = [pass.position, pass.velocity];
    draw.sound = all_finite(moving.as_flattened());
    let (sensor, time) = (draw.array(), draw.x());
    if let Some(place) = draw.taken(pass.seen_from(&sensor, time)) {
        draw.finite(&place);
    }
    draw.sound = sound;
    let u = draw.x();
    if let Some(scaled) = draw.taken(pass.scaled(u)) {
        draw.finite(&scaled.state());
    }
    draw.sound = sound;
}

fn accumulator<T: Number>(draw: &mut Draw<T>) {
    let (mut sums, mut both) = (Accumulator::new(), Accumulator::new());
    for _ in 0..draw.index(5) {
        draw.again();
        let (time, weight, before) = (draw.x(), draw.positive(), sums);
        let (position, moment) = (draw.array(), draw.array());
        let result = sums.push(time, &position, &moment, weight);
        draw.unchanged(&result, &sums, &before);
        draw.taken(result);
        let before = both;
        let result = both.merge(&sums);
        draw.unchanged(&result, &both, &before);
    }
    draw.finite(sums.matrix().as_flattened());
    draw.finite(both.matrix().as_flattened());
}

fn tracker<T: Number>(draw: &mut Draw<T>) {
    use dipole::tracker::{Bound, Sample, Tracker, Wander};
    let (time, state, sigma) = (draw.x(), draw.array(), draw.positives());
    let Some(mut tracker) = draw.taken(Tracker::new(time, &state, &sigma)) else {
        return;
    };
    let Some(mut bound) = draw.taken(Bound::new(time, &sigma)) else {
        return;
    };
    for _ in 0..draw.index(4) {
        draw.again();
        let wander = Wander {
            acceleration: draw.positive(),
            moment: draw.positive(),
        };
        let sample = Sample {
            time: draw.positive(),
            sensor: draw.array(),
            field: draw.array(),
            sigma: draw.positive(),
        };
        let before = tracker;
        let result = tracker.push(&sample, &wander).map(drop);
        draw.unchanged(&result, &tracker, &before);
        draw.taken(result);
        let before = tracker;
        let result = tracker.predict(sample.time, &wander);
        draw.unchanged(&result, &tracker, &before);
        let (truth, before) = (draw.array(), bound);
        let result = bound.push(&sample, &truth, &wander);
        draw.unchanged(&result, &bound, &before);
        // What a sample reads does not matter to the bound.
        if all_finite(&sample.field) {
            draw.taken(result);
        }
        let answer = tracker.answer();
        draw.finite(tracker.state());
        draw.finite(&answer.state);
        draw.finite(&[answer.chi2, answer.p_value]);
        draw.bounds(&answer.std);
        draw.bounds(&bound.std());
        draw.finite(tracker.known().root().factor().as_flattened());
        draw.finite(bound.known().root().factor().as_flattened());
    }
    let known = *tracker.known();
    assert!(Tracker::resumed(time, tracker.state(), known).is_ok());
    assert_eq!(Bound::resumed(time, known).known(), &known);
}

fn law<T: Number>(draw: &mut Draw<T>) -> (Law, Side) {
    let laws = [
        Law::MaxDet,
        Law::HammelLiu,
        Law::BearingRate,
        Law::Circle,
        Law::Perpendicular,
    ];
    let sides = [Side::Right, Side::Left];
    (laws[draw.index(5)], sides[draw.index(2)])
}

fn laws<T: Number>(draw: &mut Draw<T>) {
    let (law, side) = law(draw);
    let (range, step) = (draw.positive(), draw.positive());
    if let Some((cos, sin)) = draw.taken(law.turn(range, step)) {
        draw.finite(&[cos, sin, side.sign()]);
    }
    let bearing = draw.x();
    if let Some(heading) = draw.taken(maneuver::heading(bearing, range, step, law, side)) {
        assert!(
            heading > -T::pi() && heading <= T::pi(),
            "{}: {heading}",
            draw.place()
        );
    }
    draw.again();
    let steering = Steering {
        law,
        side,
        step: draw.positive(),
        standoff: draw.positive(),
        at_standoff: [AtStandoff::Stop, AtStandoff::Circle][draw.index(2)],
    };
    let (position, target) = (draw.array(), draw.array());
    if let Some(Some(leg)) = draw.taken(steering.leg(position, target)) {
        draw.finite(&leg.direction);
        draw.finite(&leg.end);
    }
    draw.again();
    let (east, north, sigma) = (draw.x(), draw.x(), draw.positive());
    if let Some(row) = draw.taken(maneuver::row(east, north, sigma)) {
        draw.finite(&row);
    }
}

fn best_heading<T: Number>(draw: &mut Draw<T>) {
    let information = information_of::<T, 2>(draw);
    let (position, target) = (draw.array(), draw.array());
    let (step, sigma, standoff) = (draw.positive(), draw.positive(), draw.positive());
    let headings = draw.array::<4>();
    let choice = maneuver::best_heading(
        &information,
        position,
        target,
        step,
        sigma,
        standoff,
        &headings,
    );
    // Where every leg ends inside the stand-off range no sigma is looked at.
    if let Ok(Some(choice)) = choice {
        draw.taken::<_, ()>(Ok(()));
        draw.finite(&[choice.heading]);
        draw.bounds(&[choice.determinant]);
    }
}

fn steering<T: Number>(draw: &mut Draw<T>) {
    let (targets, keep_out) = (draw.arrays::<4, 2>(), draw.arrays::<3, 2>());
    let limits = Limits {
        standoff: draw.positive(),
        targets: &targets,
        keep_out: &keep_out,
        max_turn: draw.or_infinite(),
    };
    let (at, time) = (draw.array(), draw.x());
    if let Some(Some(heading)) = draw.taken(steer::escape(at, time, &limits)) {
        draw.finite(&[heading]);
    }
    let (length, wanted) = (draw.positive(), draw.x());
    let before = if draw.below(2) == 0 {
        Some(draw.x())
    } else {
        None
    };
    let found = steer::steer(at, time, length, wanted, before, &limits);
    if let Some(Some(heading)) = draw.taken(found) {
        draw.finite(&[heading]);
    }
}

fn plan_of<T: Number, const N: usize>(draw: &mut Draw<T>) {
    let prior = information_of::<T, N>(draw);
    let (headings, lengths) = (draw.array::<3>(), draw.array::<3>());
    let counts = [draw.index(3), draw.index(3), draw.index(3)];
    let legs = Legs {
        start: draw.array(),
        dt: draw.x(),
        headings: &headings,
        lengths: &lengths,
        counts: &counts,
    };
    let target = Target {
        state: draw.array(),
        sigma: draw.positive(),
        prior: &prior,
        scale: draw.positives(),
    };
    let criterion = match draw.below(4) {
        0 => Criterion::LogDet,
        1 => Criterion::Trace,
        2 => Criterion::SmallestEigenvalue {
            sharpness: draw.or_infinite(),
        },
        _ => Criterion::Combination(draw.array()),
    };
    if let Some(value) = draw.taken(plan::value(&legs, &target, &criterion)) {
        draw.ordered(&[value]);
    }
    let mut out = vec![T::zero(); legs.steps() + 1];
    if draw
        .taken(plan::along(&legs, &target, &criterion, &mut out))
        .is_some()
    {
        draw.ordered(&out);
    }
    let (mut by_heading, mut by_length) = ([T::zero(); 3], [T::zero(); 3]);
    let weight = draw.x();
    let found = plan::gradient(
        &legs,
        &target,
        &criterion,
        weight,
        &mut by_heading,
        &mut by_length,
    );
    if let Some(value) = draw.taken(found) {
        draw.ordered(&[value]);
        draw.finite(&by_heading);
        draw.finite(&by_length);
    }
}

fn plans<T: Number>(draw: &mut Draw<T>) {
    if draw.below(2) == 0 {
        plan_of::<T, 2>(draw);
    } else {
        plan_of::<T, 4>(draw);
    }
}

fn planes<T: Number>(draw: &mut Draw<T>) {
    let plane = |draw: &mut Draw<T>| {
        draw.again();
        let (a, b) = (draw.array(), draw.array());
        let (sigma_a, sigma_b) = (draw.positives(), draw.positives());
        draw.taken(Plane::new(a, b, &sigma_a, &sigma_b))
    };
    let (Some(one), Some(two)) = (plane(draw), plane(draw)) else {
        return;
    };
    draw.finite(one.projector().as_flattened());
    draw.finite(one.basis().as_flattened());
    draw.finite(&[one.pair_degree(&two)]);
    if let Ok(determinant) = one.determinant(&two) {
        draw.finite(&[determinant]);
    }
}

fn running<T: Number>(draw: &mut Draw<T>) {
    let (a, b) = (draw.array(), draw.array());
    let (sigma_a, sigma_b) = (draw.positives(), draw.positives());
    let Some(mut running) = draw.taken(Running::new(a, b, sigma_a, sigma_b)) else {
        return;
    };
    for _ in 0..4 {
        draw.again();
        let (position, before) = (draw.array(), *running.root());
        let result = if draw.below(2) == 0 {
            running.push(position)
        } else {
            running.push_from([draw.array(), draw.array()], position)
        };
        draw.unchanged(&result, running.root(), &before);
        draw.taken(result);
        draw.finite(&[running.eta()]);
        draw.finite(running.root().factor().as_flattened());
        assert!(running.looks() <= 4);
    }
}

fn layout<T: Number>(draw: &mut Draw<T>) -> Layout {
    let dimension = [Dimension::Plane, Dimension::Space][draw.index(2)];
    let sensors = 1 + draw.index(3);
    if draw.below(3) == 0 {
        return Layout::simple(dimension, sensors);
    }
    Layout {
        dimension,
        sensors,
        gain: draw.below(2) == 0,
        position: draw.below(2) == 0,
        attitude: draw.below(2) == 0,
    }
}

fn looks<T: Number>(draw: &mut Draw<T>) {
    let layout = layout(draw);
    let (d, per) = (layout.size(), layout.per_sensor());
    let (sensor, sigma) = (draw.array::<3>(), draw.positives::<3>());
    let (bias, target) = (draw.array::<10>(), draw.array::<3>());
    // Of these only the first entries are handed in.
    let used = [&sensor[..d], &sigma[..d], &bias[..per], &target[..d]];
    draw.sound = used.iter().all(|part| all_finite(part));
    let found = look::linearise(
        &layout,
        &sensor[..d],
        &sigma[..d],
        &bias[..per],
        &target[..d],
    );
    if let Some(linear) = draw.taken(found) {
        draw.finite(&linear.measured);
        draw.finite(linear.position.as_flattened());
        draw.finite(linear.bias.as_flattened());
    }
    let mut out = vec![T::zero(); d];
    let used = [&sensor[..d], &bias[..per], &target[..d]];
    draw.sound = used.iter().all(|part| all_finite(part));
    let found = look::place(&layout, &sensor[..d], &bias[..per], &target[..d], &mut out);
    if draw.taken(found).is_some() {
        draw.finite(&out);
    }
    draw.again();
    let m = layout.sensors;
    let (sensors, biases) = (draw.numbers(m * d), draw.numbers(layout.states()));
    let sigma: Vec<T> = (0..m * d).map(|_| draw.positive()).collect();
    let sound = draw.sound;
    let used = [&sensors, &sigma];
    draw.sound = used.iter().all(|part| all_finite(part));
    draw.taken(layout.check(&sensors, &sigma));
    draw.sound = sound;
    let target = draw.numbers(d);
    let mut work = vec![T::zero(); look::scratch(&layout)];
    let mut out = vec![T::zero(); layout.rows() * layout.states()];
    let found = look::rows(
        &layout, &sensors, &sigma, &biases, &target, &mut work, &mut out,
    );
    if draw.taken(found).is_some() {
        draw.finite(&out);
    }
}

fn levels<T: Number>(draw: &mut Draw<T>) {
    let mut a = draw.arrays::<4, 4>();
    // Zeros are what makes a system: most couplings do not exist.
    for x in a.as_flattened_mut() {
        if draw.below(2) == 0 && x.is_finite() {
            *x = T::zero();
        }
    }
    let c = draw.arrays::<4, 2>();
    if let Some(found) = draw.taken(linear::levels(&a, &c)) {
        assert!(found.ranks.iter().all(|&rank| rank <= 4));
        assert!(found.states.iter().flatten().all(|&level| level < 4));
    }
    let rtol: T = linear::default_rtol(draw.index(1 << 40));
    draw.finite(&[rtol]);
}

#[cfg(feature = "alloc")]
mod sized {
    use super::{Draw, Number, all_finite, layout};
    use gramian::chi_square::Goodness;
    use gramian::inertial::{Unknown, Visual};
    use gramian::linear::analysis::Analysis;
    use gramian::linear::piecewise::Piecewise;
    use gramian::linear::window::{self, Window};
    use gramian::numbers::words;
    use gramian::observability::{self, Observability};
    use gramian::registration::estimate::{Estimator, Method, Question};
    use gramian::registration::report;
    use gramian::spine::verdict::{Findings, Status, judge, of_estimate, references};

    fn rtol<T: Number>(draw: &mut Draw<T>) -> Option<T> {
        (draw.below(2) == 0).then(|| draw.positive())
    }

    pub fn observability<T: Number>(draw: &mut Draw<T>) {
        let (n, count) = (draw.index(5), draw.index(7));
        let stray = usize::from(draw.below(16) == 0);
        let rows = draw.numbers(n * count + stray);
        let rtol = rtol(draw);
        let sound = draw.sound;
        if let Some((values, vectors)) = {
            draw.sound = all_finite(&rows);
            draw.taken(observability::singular_values(&rows, n))
        } {
            draw.finite(&values);
            draw.finite(&vectors);
        }
        draw.sound = sound;
        let eliminated = draw.index(n + 2);
        let marginal = observability::marginal_rows(&rows, n, eliminated, rtol);
        for row in draw.taken(marginal).into_iter().flatten() {
            draw.finite(&row);
        }
        let Some(found) = draw.taken(Observability::new(&rows, n, rtol)) else {
            return;
        };
        assert!(found.rank() <= found.states());
        draw.finite(found.singular_values());
        draw.finite(found.scale());
        draw.bounds(&found.crlb_std());
        draw.finite(&found.crlb().unwrap_or_default());
        draw.finite(&found.crlb_root().unwrap_or_default());
        draw.ordered(&[found.log_det(), found.rtol(), found.condition()]);
        for vector in found.null_space().into_iter().flatten() {
            draw.finite(&vector);
        }
        draw.finite(&found.weakest_direction().unwrap_or_default());
        draw.again();
        let (combination, sigma) = (draw.numbers(n), draw.positive());
        if let Some((rank, std)) = draw.taken(found.knowing(&combination, sigma)) {
            assert!(rank <= n);
            draw.bounds(&std);
        }
        if let Ok((rank, std)) = found.knowing(&combination, T::zero()) {
            assert!(rank <= n);
            draw.bounds(&std);
        }
        draw.sound = all_finite(&combination);
        if let Some(std) = draw.taken(found.combination_std(&combination)) {
            draw.bounds(&[std]);
        }
        assert!(found.undecided().is_empty());
        let errors: Vec<T> = rows.iter().map(|x| x.abs() * T::of(1e-6)).collect();
        if let Ok(found) = Observability::inexact(&rows, &errors, &[], n, rtol) {
            assert!(found.undecided().iter().all(|&i| i < n));
            draw.bounds(&found.crlb_std());
        }
    }

    /// A camera beside a navigator, in doubles alone: nothing panics, and what moderate numbers
    /// give is finite.
    pub fn visual_inertial<T: Number>(draw: &mut Draw<T>) {
        let (count, marks) = (draw.index(4), draw.index(3));
        let times = draw.times(count).into_iter().map(T::double).collect();
        let vector = |draw: &mut Draw<T>| draw.array::<3>().map(T::double);
        let gyro = (0..count).map(|_| vector(draw)).collect();
        let accel = (0..count).map(|_| vector(draw)).collect();
        let all = [
            Unknown::CameraRotation,
            Unknown::CameraArm,
            Unknown::Gravity,
            Unknown::GravityStrength,
            Unknown::Scale,
            Unknown::Landmarks,
        ];
        let model = Visual {
            times,
            gyro,
            accel,
            camera: [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
            arm: vector(draw),
            gravity: vector(draw),
            landmarks: (0..marks).map(|_| vector(draw)).collect(),
            unknown: all.into_iter().filter(|_| draw.below(2) == 0).collect(),
        };
        if draw.taken(model.check()).is_none() {
            return;
        }
        let (place, velocity) = (vector(draw), vector(draw));
        let q = [1.0, 0.0, 0.0, 0.0];
        let Some(x) = draw.taken(model.start(place, q, velocity)) else {
            return;
        };
        let (n, p) = (model.states(), model.outputs());
        assert_eq!(x.len(), n);
        let moderate = |values: &[f64]| values.iter().all(|v| v.abs() < 1e50);
        let whole = moderate(&x)
            && moderate(model.gyro.as_flattened())
            && moderate(model.accel.as_flattened())
            && moderate(model.landmarks.as_flattened())
            && moderate(&model.arm)
            && moderate(&model.gravity);
        let sound = |values: &[f64]| !whole || values.iter().all(|v| v.is_finite());
        let (mut rate, mut by_state) = (vec![0.0; n], vec![0.0; n * n]);
        model.rate(model.times[0], &x, &mut rate);
        model.rate_jacobian(model.times[0], &x, &mut by_state);
        assert_eq!(rate[..3], velocity);
        assert!(sound(&rate) && sound(&by_state));
        let (mut image, mut lines) = (vec![0.0; p], vec![0.0; p * n]);
        if model.output(model.times[0], &x, &mut image).is_ok() {
            // In front of the camera: far off the axis perhaps, but somewhere.
            assert!(!whole || image.iter().all(|v| !v.is_nan()));
            model.output_jacobian(&x, &mut lines);
            let near = image.iter().all(|v| v.abs() < 1e3);
            assert!(!(whole && near) || lines.iter().any(|v| *v != 0.0));
        }
    }

    /// Verdicts of any findings, and their words: these are of doubles alone.
    pub fn verdicts<T: Number>(draw: &mut Draw<T>) {
        let n = 1 + draw.index(4);
        let mut of =
            |count: usize| -> Vec<f64> { draw.numbers(count).into_iter().map(T::double).collect() };
        let (data_std, scale, prior) = (of(n), of(n), of(n));
        let (hardness, other) = (of(n), of(3));
        let open: Vec<bool> = (0..n).map(|_| draw.below(2) == 0).collect();
        let found = judge(&Findings {
            rank: draw.index(n + 1),
            open: &open,
            data_std: &data_std,
            scale: &scale,
            prior: &prior,
            condition: other[0],
            hardness: &hardness,
            weak_ratio: other[1],
            weak_condition: other[2],
        });
        assert!(!found.status.name().is_empty());
        assert!(found.decided_by.iter().all(|&state| state < n));
        let words = found.reason.words(|_| "x", |_| "m");
        assert!(!words.is_empty());
        let fit = Goodness::new(data_std[0], scale[0]);
        let wrong = fit.misfit(other[0]);
        assert_eq!(wrong.is_some(), fit.is_misfit(other[0]));
        let (status, reason) = of_estimate(found.status, words.clone(), fit, other[0]);
        let ranked = found.status == Status::Unobservable || wrong.is_none();
        assert_eq!(
            status,
            if ranked {
                found.status.name()
            } else {
                "misfit"
            }
        );
        assert!(!reason.is_empty());
        let digits = 1 + draw.index(17);
        for &x in &data_std {
            let text = words::brief(x, digits);
            let read: f64 = text.parse().unwrap();
            let close = (read - x).abs() <= 0.51 * x.abs() || (read.is_nan() && x.is_nan());
            // The largest numbers round to what is no number any more.
            let beyond = x.is_finite() && x.abs() > 1e308 && read.abs() == f64::INFINITY;
            assert!(
                close || beyond || read == x,
                "{x:e} in {digits} digits: {text}"
            );
        }
        let compared = references(&hardness, &scale);
        assert_eq!(compared.len(), n);
        assert!(
            scale
                .iter()
                .zip(&compared)
                .all(|(s, c)| s.is_nan() || s == c)
        );
        let names = ["a", "b", "c", "d"];
        assert_eq!(
            words::moves(&data_std, &names).is_empty(),
            data_std.iter().all(|&x| x == 0.0)
        );
    }

    fn system<T: Number>(draw: &mut Draw<T>, n: usize, count: usize) -> Vec<T> {
        let mut a = draw.numbers(count * n * n);
        for x in &mut a {
            if draw.below(2) == 0 && x.is_finite() {
                *x = T::zero();
            }
        }
        a
    }

    pub fn analysis<T: Number>(draw: &mut Draw<T>) {
        let n = draw.index(5);
        let outputs = draw.index(3);
        let (a, c) = (system(draw, n, 1), draw.numbers(outputs * n));
        let rtol = rtol(draw);
        let Some(found) = draw.taken(Analysis::new(&a, &c, n, rtol)) else {
            return;
        };
        assert!(found.rank() <= n);
        // What may be zero was counted as zero.
        assert!(!found.undecided() || found.rank() < n);
        assert!(found.ranks().is_none_or(|ranks| ranks.len() == n));
        assert!(found.state_levels().is_none_or(|levels| levels.len() == n));
        draw.finite(found.scale());
        draw.finite(found.row_space());
        draw.finite(found.kernel());
        draw.finite(&[found.found().weakest, found.found().rejected, found.rtol()]);
        for vector in found.null_space().into_iter().flatten() {
            draw.finite(&vector);
        }
        for vector in found.combinations().into_iter().flatten().flatten() {
            draw.finite(&vector);
        }
        draw.again();
        let combination = draw.numbers(n);
        if let Some(residuals) = draw.taken(found.residuals(&combination)) {
            draw.finite(&residuals);
        }
        let tolerance = draw.x();
        draw.taken(found.level_of(&combination, Some(tolerance)));
    }

    pub fn piecewise<T: Number>(draw: &mut Draw<T>) {
        let (n, segments) = (draw.index(4), draw.index(4));
        let (a, c) = (system(draw, n, segments), draw.numbers(segments * n));
        let durations = draw.numbers(segments);
        let found = Piecewise::new(&a, &c, &durations, n, None);
        if let Some(found) = draw.taken(found) {
            assert!(found.total.iter().all(|&rank| rank <= n));
            for vector in found.null_space {
                draw.finite(&vector);
            }
        }
    }

    pub fn windows<T: Number>(draw: &mut Draw<T>) {
        let n = draw.index(4);
        let (a, c) = (system(draw, n, 1), draw.numbers(n * 2));
        let q = (draw.below(2) == 0).then(|| draw.numbers(n * n));
        let sound = draw.sound;
        let duration = draw.positive();
        let finite = |draw: &Draw<T>, window: &Window<T>| {
            draw.finite(window.transition());
            draw.finite(window.noise());
            draw.finite(window.gramian());
        };
        let window = Window::continuous(&a, &c, q.as_deref(), n, duration);
        if let Some(window) = draw.taken(window) {
            finite(draw, &window);
        }
        draw.sound = sound;
        if let Some(one) = draw.taken(Window::sample(&a, &c, q.as_deref(), n)) {
            finite(draw, &one);
            if let Ok(two) = one.then(&one) {
                finite(draw, &two);
            }
            if let Ok(Some(many)) = one.repeated(draw.index(1 << 40)) {
                finite(draw, &many);
            }
        }
        draw.sound = all_finite(&a);
        let duration = draw.x();
        if let Some(e) = draw.taken(window::transition(&a, n, duration)) {
            draw.finite(&e);
        }
    }

    /// This number, or now and then another.
    fn some<T: Number>(draw: &mut Draw<T>, usual: f64) -> T {
        if draw.below(4) == 0 {
            draw.positive()
        } else {
            T::of(usual)
        }
    }

    pub fn estimates<T: Number>(draw: &mut Draw<T>) {
        let (layout, looks) = (layout(draw), 1 + draw.index(3));
        let (d, m, n) = (layout.size(), layout.sensors, layout.states());
        // Of platforms that move there are places for each look.
        let places = [1, looks][draw.index(2)];
        let (sensors, positions) = (draw.numbers(places * m * d), draw.numbers(looks * d));
        let biases = draw.numbers(n);
        let mut reports = vec![T::zero(); looks * m * d];
        let made = report(&layout, &sensors, &biases, &positions, &mut reports);
        if draw.taken(made).is_some() {
            draw.finite(&reports);
        }
        draw.sound = all_finite(&sensors);
        if draw.below(2) == 0 {
            reports = draw.numbers(looks * m * d);
        } else if !all_finite(&reports) {
            return;
        }
        let sigma: Vec<T> = (0..m * d).map(|_| draw.positive()).collect();
        let prior: Option<Vec<T>> =
            (draw.below(2) == 0).then(|| (0..n).map(|_| draw.or_infinite()).collect());
        let methods = [
            Method::LeastSquares,
            Method::Generalised,
            Method::MaximumLikelihood,
        ];
        let question = Question {
            layout,
            sensors: &sensors,
            sigma: &sigma,
            prior: prior.as_deref(),
            method: methods[draw.index(3)],
            iterations: draw.index(6),
            tolerance: some(draw, 1e-3),
            noise_share: some(draw, 0.5),
            bend: some(draw, 0.05),
        };
        let Ok(mut estimator) = Estimator::new(layout, looks) else {
            return;
        };
        if let Some(answer) = draw.taken(estimator.run(&question, &reports)) {
            draw.finite(&[answer.chi_square, answer.noise_share, answer.bend]);
            draw.finite(estimator.biases());
            draw.finite(estimator.positions());
            draw.finite(estimator.covariance());
            draw.finite(estimator.directions());
        }
    }
}

type Case<T> = fn(&mut Draw<T>);

macro_rules! cases {
    ($($(#[$attribute:meta])* $($name:ident)::+),+ $(,)?) => {
        /// All cases, for each number type.
        const CASES: &[(&str, Case<f32>, Case<f64>)] =
            &[$($(#[$attribute])* (stringify!($($name)::+), $($name)::+::<f32>, $($name)::+::<f64>)),+];
    };
}

cases![
    square_root,
    spectrum,
    row_sinks,
    information,
    posterior,
    constrained_posterior,
    semidefinite_root,
    chi_square,
    scalar,
    inertial_models,
    discriminants,
    sums,
    observability_test,
    monitor,
    motions,
    bearing_rows,
    fields,
    quadrupoles,
    passes,
    #[cfg(feature = "std")]
    bodies,
    sensors,
    accumulator,
    tracker,
    laws,
    best_heading,
    steering,
    plans,
    planes,
    running,
    looks,
    levels,
    #[cfg(feature = "alloc")]
    sized::observability,
    #[cfg(feature = "alloc")]
    sized::visual_inertial,
    #[cfg(feature = "alloc")]
    sized::verdicts,
    #[cfg(feature = "alloc")]
    sized::analysis,
    #[cfg(feature = "alloc")]
    sized::piecewise,
    #[cfg(feature = "alloc")]
    sized::windows,
    #[cfg(feature = "alloc")]
    sized::estimates,
];

/// Patterns for each case; the iterative ones take a hundred times as long.
fn patterns() -> u64 {
    std::env::var("GRAMIAN_FUZZ").map_or(4_000, |count| count.parse().unwrap())
}

/// Runs a case; the message of the first pattern that fails.
fn run<T: Number>(name: &'static str, case: Case<T>) -> Option<String> {
    let (done, watch) = channel::<()>();
    let watchdog = std::thread::spawn(move || {
        if watch.recv_timeout(Duration::from_secs(1800)) == Err(RecvTimeoutError::Timeout) {
            eprintln!("{name} runs without end");
            std::process::abort();
        }
    });
    let mut draw = Draw::new(name);
    let failed = catch_unwind(AssertUnwindSafe(|| {
        for pattern in 0..patterns() {
            draw.start(pattern);
            case(&mut draw);
        }
    }));
    drop(done);
    watchdog.join().unwrap();
    failed.err().map(|cause| {
        let said = cause
            .downcast_ref::<String>()
            .map_or("panic", String::as_str);
        format!("{}: {said}", draw.place())
    })
}

#[test]
fn single_precision() {
    let failed: Vec<String> = CASES
        .iter()
        .filter_map(|(name, case, _)| run(name, *case))
        .collect();
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn double_precision() {
    let failed: Vec<String> = CASES
        .iter()
        .filter_map(|(name, _, case)| run(name, *case))
        .collect();
    assert!(failed.is_empty(), "{failed:#?}");
}

/// Functions that hand out what is held, count, or change no number.
const NOTHING_TO_TEST: &[&str] = &["at", "mirrored"];

/// Modules that need `std`.
const WITH_STD: &[&str] = &[
    "batch",
    "batch.rs",
    "batch_gram.rs",
    "large",
    "maneuver/planner",
    "numbers/dual.rs",
    "localize",
    "solve",
];

/// Newer than the cases, and still to get one each: only their own tests hold them.
const STILL_WITHOUT: &[&str] = &[
    "bounds/threshold.rs",
    "bearings/frame.rs",
    "models/dynamics",
    "models/tracks",
    "linear/unobservable.rs",
    "linear/infinite.rs",
    "linear/schur.rs",
    "linear/pencil.rs",
    "choose",
    "numbers/derivative",
    "spine/rounding.rs",
    "dipole/measured.rs",
    "dipole/measured",
    "registration/measured.rs",
];
/// The same, of single functions.
const FUNCTIONS_STILL_WITHOUT: &[&str] = &[
    "critical",
    "constrained",
    "longest_axes",
    "leverage",
    "without",
    "without_noise",
    "inexact",
    "best_sides",
    "two_leg_terms",
    "best_two_legs",
    "kept",
    "from_kept",
];

/// Whether `code` calls a function: a method by its dot, another one by its path or
/// alone; a longer name that ends the same does not count, nor does a definition.
fn calls(code: &str, name: &str, method: bool) -> bool {
    code.match_indices(name).any(|(start, _)| {
        let (before, after) = (&code[..start], &code[start + name.len()..]);
        let called = after.starts_with('(') || after.starts_with("::<");
        let inside = before.ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let by_dot = before.ends_with('.');
        called && !inside && !before.ends_with("fn ") && (by_dot || !method)
    })
}

#[test]
fn calls_are_told_from_names_that_end_the_same() {
    assert!(calls("let x = bearings::row(1);", "row", false));
    assert!(calls("root.push(&row)", "push", true));
    assert!(calls("motion::<f64, 2>(x)", "motion", false));
    assert!(!calls("unchecked_row(1)", "row", false));
    assert!(!calls("fn row(x: f64) {}", "row", false));
    assert!(!calls("push(1)", "push", true));
    assert!(!calls("let row = 1;", "row", false));
}

#[test]
fn every_public_function_has_a_case() {
    let here: String = include_str!("fuzz.rs")
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .take_while(|line| !line.starts_with("const NOTHING_TO_TEST"))
        .collect::<Vec<_>>()
        .join("\n");
    let source = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut folders = vec![source];
    let mut missing = Vec::new();
    let mut count = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let mut skipped = WITH_STD.iter().chain(STILL_WITHOUT);
            if skipped.any(|name| path.ends_with(name)) {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let private = ["scaling.rs", "staircase.rs", "lane.rs"];
            if private.iter().any(|name| path.ends_with(name)) {
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            for (start, _) in text.match_indices("pub ") {
                let line_start = text[..start].rfind('\n').map_or(0, |at| at + 1);
                let rest = text[start + 4..].trim_start_matches("const ");
                let (true, Some(rest)) = (
                    text[line_start..start].trim().is_empty(),
                    rest.strip_prefix("fn "),
                ) else {
                    continue;
                };
                let end = rest.find(['(', '<']).unwrap();
                let name = &rest[..end];
                count += 1;
                let arguments = rest[rest.find('(').unwrap() + 1..].trim_start();
                let method = ["self", "&self", "&mut self", "mut self"]
                    .iter()
                    .any(|receiver| arguments.starts_with(receiver));
                let known =
                    NOTHING_TO_TEST.contains(&name) || FUNCTIONS_STILL_WITHOUT.contains(&name);
                if !known && !calls(&here, name, method) {
                    missing.push(format!("{}: {name}", path.display()));
                }
            }
        }
    }
    assert!(count > 100);
    assert!(missing.is_empty(), "without a case: {missing:#?}");
}
