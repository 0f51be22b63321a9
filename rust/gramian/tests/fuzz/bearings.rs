//! Bearings of a moving target.

use crate::draw::{Draw, Number, all_finite};
use gramian::bearings::{self, Form, Monitor};
use gramian::square_root::SquareRootInformation;

pub fn discriminants<T: Number>(draw: &mut Draw<T>) {
    let (times, angles) = (draw.array(), draw.array());
    for form in [Form::Sines, Form::Products, Form::Cotangents] {
        if let Some(value) = draw.taken(bearings::discriminant(&times, &angles, form)) {
            draw.finite(&[value]);
        }
    }
}

pub fn sums<T: Number>(draw: &mut Draw<T>) {
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

pub fn observability_test<T: Number>(draw: &mut Draw<T>) {
    let count = draw.index(9);
    let (times, angles) = (draw.times(count), draw.numbers(count));
    let many = if draw.below(2) == 0 { 1 } else { count };
    let sigma: Vec<T> = (0..many).map(|_| draw.positive()).collect();
    if let Some(test) = draw.taken(bearings::observability_test(&times, &angles, &sigma)) {
        draw.finite(&[test.statistic, test.p_value]);
        draw.finite(&test.relative_motion);
    }
}

pub fn monitor<T: Number>(draw: &mut Draw<T>) {
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

pub fn motions<T: Number>(draw: &mut Draw<T>) {
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

pub fn bearing_rows<T: Number>(draw: &mut Draw<T>) {
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
