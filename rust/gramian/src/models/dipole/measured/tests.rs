//! Rows against differences, images, seeds.

#![allow(clippy::unwrap_used, clippy::panic)]

use super::*;
use crate::dipole::description::Motion;

const NEAR: [f64; 9] = [-10.0, -9.0, 5.0, 1.0, 0.8, 0.1, 10.0, 20.0, -10.0];

fn record(known: &[(usize, f64)], prior: &[usize], offsets: bool) -> Measured {
    let mut knowledge = Knowledge::default();
    for &(index, value) in known {
        knowledge.exact[index] = Some(value);
    }
    for &index in prior {
        knowledge.prior[index] = Some((3.0, 0.2));
    }
    let times: Vec<f64> = (0..9).map(|k| 2.0 * f64::from(k)).collect();
    let places = [[0.0; 3], [0.0, 0.5, 0.2]];
    let field = vec![1e-9; 54];
    Measured::new(
        &times,
        &Sensors::vector(&places),
        &field,
        Whitening::first_order(&times, 6, vec![1e9; 54], 0.5, 2.0),
        offsets,
        knowledge,
        &NEAR,
    )
}

#[test]
fn rows_are_derivatives_whatever_is_known() {
    let speed = 1.65_f64.sqrt();
    for (known, states) in [
        (&[][..], 9),
        (&[(SPEED, speed)][..], 8),
        (&[(SPEED, speed), (4, 0.8)][..], 7),
        (&[(SPEED, speed), (3, 1.0), (4, 0.8)][..], 6),
        (&[(MOMENT, 600.0_f64.sqrt()), (2, 5.0)][..], 7),
    ] {
        for offsets in [false, true] {
            let record = record(known, &[0, SPEED, MOMENT, 7], offsets);
            let n = record.states();
            assert_eq!(n, states + if offsets { 6 } else { 0 });
            assert_eq!(record.names().len(), n);
            assert_eq!(record.units().len(), n);
            let m = record.measurements();
            let x = record.coordinates(&NEAR);
            let (state, _) = record.expand(&x);
            for (found, wanted) in state.iter().zip(&NEAR) {
                assert!((found - wanted).abs() < 1e-12);
            }
            let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
            record
                .linearize(&x, &mut residuals, Some(&mut rows))
                .unwrap();
            let largest = rows.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            for j in 0..n {
                let step = if j >= states { 1e-12 } else { 1e-6 };
                let at = |by: f64| {
                    let mut moved = x.clone();
                    moved[j] += by;
                    let mut r = vec![0.0; m];
                    record.linearize(&moved, &mut r, None).unwrap();
                    r
                };
                for (i, (plus, minus)) in at(step).iter().zip(&at(-step)).enumerate() {
                    let wanted = (minus - plus) / (2.0 * step);
                    let size = if j >= states { 1e9 } else { largest.min(1e4) };
                    assert!((rows[i * n + j] - wanted).abs() < 1e-6 * size);
                }
            }
        }
    }
}

#[test]
fn rows_are_derivatives_whatever_is_described() {
    let ambient = Some([16.0, 5.0, -36.0]);
    for (motion, sources, quadrupole, drift, errors, induced, states) in [
        (Motion::Along, 2, None, true, None, None, 9 + 1 + 6 + 12),
        (
            Motion::Straight,
            1,
            Some([true; 3]),
            false,
            None,
            None,
            9 + 2 + 6,
        ),
        (
            Motion::Turning,
            2,
            Some([true, false, true]),
            false,
            Some(0.02),
            ambient,
            9 + 1 + 6 + 3 + 1 + 8 + 6,
        ),
        (
            Motion::Accelerated,
            1,
            Some([false; 3]),
            false,
            None,
            None,
            9 + 3 + 5 + 6,
        ),
        (
            Motion::Turning,
            3,
            None,
            false,
            Some(0.02),
            ambient,
            9 + 1 + 12 + 1 + 8 + 6,
        ),
        (
            Motion::Accelerated,
            1,
            None,
            false,
            Some(0.02),
            None,
            9 + 3 + 8 + 6,
        ),
    ] {
        let record = record(&[], &[0, SPEED], true).with(Description {
            motion,
            sources,
            quadrupole,
            drift,
            attitude: errors,
            scale: errors,
            induced,
        });
        let (n, m) = (record.states(), record.measurements());
        assert_eq!((n, record.names().len()), (states, states));
        let mut x = record.coordinates(&NEAR);
        let at = record.layout();
        for (k, value) in x.iter_mut().enumerate().skip(9).take(at.constants - 9) {
            *value = 0.01 + 0.003 * (k % 5) as f64;
        }
        for index in 1..sources {
            let first = at.sources + 6 * (index - 1);
            x[first..first + 6].copy_from_slice(&[1.0, -0.5, 0.7, 3.0, -8.0, 4.0]);
        }
        for (k, value) in x[at.quadrupole..at.induced].iter_mut().enumerate() {
            *value = [30.0, -50.0, 20.0, 70.0, -10.0][k];
        }
        let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
        record
            .linearize(&x, &mut residuals, Some(&mut rows))
            .unwrap();
        for j in 0..n {
            let step = if j >= at.constants { 1e-12 } else { 1e-6 };
            let at = |by: f64| {
                let mut moved = x.clone();
                moved[j] += by;
                let mut r = vec![0.0; m];
                record.linearize(&moved, &mut r, None).unwrap();
                r
            };
            let size = (0..m).fold(0.0_f64, |a, i| a.max(rows[i * n + j].abs()));
            for (i, (plus, minus)) in at(step).iter().zip(&at(-step)).enumerate() {
                let wanted = (minus - plus) / (2.0 * step);
                assert!((rows[i * n + j] - wanted).abs() < 1e-6 * size, "{j} {i}");
            }
        }
    }
}

/// Gradiometers and sensors of the total field, near enough for the field of the dipole to
/// turn the ambient one.
#[test]
fn rows_are_derivatives_whatever_the_sensors_measure() {
    let times: Vec<f64> = (0..9).map(|k| 2.0 * f64::from(k)).collect();
    let places = [[0.0; 3], [0.0, 0.5, 0.2]];
    let baselines = [[0.0, 0.0, 1.5], [0.4, 0.0, -0.9]];
    let strong = [2e-9, -1e-9, 4e-9];
    for (baselines, ambient) in [
        (&baselines[..], None),
        (&[][..], Some(strong)),
        (&baselines[..], Some(strong)),
    ] {
        let sensors = Sensors {
            places: &places,
            baselines,
            ambient,
        };
        let channels = sensors.channels();
        let count = times.len() * channels;
        let factors = vec![1e9; count];
        let record = Measured::new(
            &times,
            &sensors,
            &vec![1e-9; count],
            Whitening::first_order(&times, channels, factors, 0.5, 2.0),
            true,
            Knowledge::default(),
            &NEAR,
        )
        .with(Description {
            motion: Motion::Turning,
            sources: 2,
            drift: true,
            induced: Some([16.0, 5.0, -36.0]),
            ..Description::default()
        });
        let (n, m) = (record.states(), record.measurements());
        assert_eq!((n, m), (9 + 1 + 6 + 1 + 2 * channels, count));
        assert_eq!(record.names().len(), n);
        let mut x = record.coordinates(&NEAR);
        let at = record.layout();
        x[at.motion] = 0.02;
        x[at.sources..at.induced].copy_from_slice(&[1.0, -0.5, 0.7, 3.0, -8.0, 4.0]);
        x[at.induced] = 0.1;
        let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
        record
            .linearize(&x, &mut residuals, Some(&mut rows))
            .unwrap();
        for j in 0..n {
            let slope = |step: f64| -> Vec<f64> {
                let at = |by: f64| {
                    let mut moved = x.clone();
                    moved[j] += by;
                    let mut r = vec![0.0; m];
                    record.linearize(&moved, &mut r, None).unwrap();
                    r
                };
                let (plus, minus) = (at(step), at(-step));
                let pairs = plus.iter().zip(&minus);
                pairs.map(|(p, q)| (q - p) / (2.0 * step)).collect()
            };
            let step = if j >= at.constants { 1e-10 } else { 1e-3 };
            let size = (0..m).fold(0.0_f64, |a, i| a.max(rows[i * n + j].abs()));
            // Sixth order, from three steps.
            let steps = [slope(step), slope(2.0 * step), slope(4.0 * step)];
            for i in 0..m {
                let (a, b, c) = (steps[0][i], steps[1][i], steps[2][i]);
                let (first, second) = ((4.0 * a - b) / 3.0, (4.0 * b - c) / 3.0);
                let wanted = (16.0 * first - second) / 15.0;
                let off = (rows[i * n + j] - wanted).abs();
                assert!(off < 1e-8 * size, "{j} {i} {off} {size}");
            }
        }
        // What is told of one pass is what the sensors measure of it.
        let plain = record.with(Description::default());
        let mut x = plain.coordinates(&NEAR);
        let mut left = vec![0.0; m];
        x.truncate(9);
        x.extend(vec![0.0; channels]);
        plain.linearize(&x, &mut left, None).unwrap();
        let mut exact = vec![0.0; count];
        sensors
            .measure(&times, &Pass::of(&NEAR), &mut exact)
            .unwrap();
        let quiet = sensors.quiet();
        let mut wanted: Vec<f64> = exact.iter().map(|h| 1e-9 - (h - quiet)).collect();
        plain.noise.apply(&mut wanted);
        for (a, b) in left.iter().zip(&wanted) {
            assert!((a - b).abs() < 1e-9);
        }
    }
}

/// Where the place is free, the quadrupole that a moved dipole has is not told from a move.
#[test]
fn a_place_and_a_whole_quadrupole_are_told_apart_by_what_is_left_at_the_centre() {
    let moment = three(&NEAR[6..]);
    for motion in [Motion::Straight, Motion::Accelerated, Motion::Turning] {
        let about = |centre| Description {
            motion,
            quadrupole: Some(centre),
            ..Description::default()
        };
        let record = record(&[], &[], false).with(about([false; 3]));
        let (m, n) = (record.measurements(), record.states());
        let mut x = record.coordinates(&NEAR);
        let at = record.layout();
        x[at.motion..at.sources].fill(0.02);
        let rows = |record: &Measured, x: &[f64]| {
            let (mut left, mut rows) = (vec![0.0; m], vec![0.0; m * x.len()]);
            record.linearize(x, &mut left, Some(&mut rows)).unwrap();
            rows
        };
        let here = rows(&record, &x);
        for (k, unit) in UNITS.iter().enumerate() {
            let mut null = vec![0.0; n];
            null[k] = 1.0;
            if motion == Motion::Turning {
                // The place of the body that was moved is elsewhere on the same circle, or beside.
                let rate = x[at.motion];
                match k {
                    0 => null[4] = -rate,
                    1 => null[3] = rate,
                    _ => {}
                }
            }
            for (out, q) in null[at.quadrupole..]
                .iter_mut()
                .zip(quadrupole::moved(&moment, unit))
            {
                *out = -q;
            }
            for row in here.chunks(n) {
                let terms = row.iter().zip(&null).map(|(a, b)| a * b);
                let size: f64 = terms.clone().map(f64::abs).sum();
                assert!(terms.sum::<f64>().abs() <= 1e-12 * size, "{motion:?} {k}");
            }
        }
        // And none of them is left where the place is the centre.
        let record = record.with(about([true; 3]));
        let x: Vec<f64> = [&x[..at.quadrupole], &[0.0; 2]].concat();
        assert_eq!(
            Fit::new(&record, &x).unwrap().dof(),
            m - x.len(),
            "{motion:?}"
        );
    }
}

#[test]
fn the_mirror_image_of_a_quadrupole_has_the_opposite_one() {
    for (baselines, sign) in [(&[][..], -1.0), (&[[0.0, 0.0, 2.0]][..], 1.0)] {
        let sensors = Sensors {
            places: &[[0.0; 3]],
            baselines,
            ambient: None,
        };
        let record = Measured::new(
            &[0.0, 4.0, 8.0, 12.0],
            &sensors,
            &[0.0; 12],
            Whitening::white(vec![1e9; 12], 3),
            false,
            Knowledge::default(),
            &NEAR,
        )
        .with(Description {
            motion: Motion::Turning,
            quadrupole: Some([true; 3]),
            ..Description::default()
        });
        let mut x = record.coordinates(&NEAR);
        x[9..].copy_from_slice(&[0.05, 30.0, -40.0]);
        let mut count = 0;
        record.symmetries(&x, &mut |image| {
            let mut difference = vec![0.0; 12];
            record.difference(&x, image, &mut difference).unwrap();
            assert!(difference.iter().all(|d| d.abs() < 1e-9), "{difference:?}");
            assert_eq!(image[10], sign * x[10]);
            count += 1;
        });
        assert_eq!(count, 1);
    }
}

#[test]
fn a_second_dipole_is_found_from_a_seed() {
    const SENSORS: [[f64; 3]; 3] = [[0.0; 3], [0.0, 0.5, 0.0], [0.5, 0.0, 0.0]];
    use crate::solve::gauss_newton::{Options, minimize};
    let times: Vec<f64> = (0..41).map(|k| 0.5 * f64::from(k)).collect();
    let mut knowledge = Knowledge::default();
    knowledge.exact[2] = Some(5.0);
    knowledge.exact[5] = Some(0.0);
    let two = Description {
        sources: 2,
        ..Description::default()
    };
    let noise = Whitening::white(vec![1e9; 369], 9);
    let near = [-10.0, -9.0, 5.0, 1.0, 0.8, 0.0, 10.0, 20.0, -10.0];
    let blank = Measured::new(
        &times,
        &Sensors::vector(&SENSORS),
        &[0.0; 369],
        noise.clone(),
        false,
        knowledge,
        &near,
    );
    let truth = [
        -10.0, -9.0, 1.0, 0.8, 10.0, 20.0, -10.0, 1.5, 1.0, 0.5, -5.0, 8.0, 12.0,
    ];
    let mut field = vec![0.0; 369];
    blank
        .clone()
        .with(two)
        .linearize(&truth, &mut field, None)
        .unwrap();
    for f in &mut field {
        *f *= -1e-9;
    }
    let record = Measured::new(
        &times,
        &Sensors::vector(&SENSORS),
        &field,
        noise,
        false,
        knowledge,
        &near,
    );
    let start = record.coordinates(&near);
    let one = minimize(&record, &start, &[], Options::default());
    let seeds = record.seeds(&one.x, 8).unwrap();
    let record = record.with(two);
    let least = seeds
        .iter()
        .map(|seed| minimize(&record, seed, &[], Options::default()).chi2)
        .fold(f64::INFINITY, f64::min);
    assert!(one.chi2 > 100.0 && least < 1e-6, "{} {least}", one.chi2);
}

/// States (r0, v, m) of the images of `NEAR` that the record of one sensor has, each of which
/// must have its data.
fn images(sensors: &Sensors<'_>, knowledge: &Knowledge) -> Vec<[f64; 9]> {
    let record = Measured::new(
        &[0.0, 4.0, 8.0, 12.0],
        sensors,
        &[0.0; 12],
        Whitening::white(vec![1e9; 12], 3),
        false,
        *knowledge,
        &NEAR,
    );
    let x = record.coordinates(&NEAR);
    let mut found = Vec::new();
    record.symmetries(&x, &mut |image| {
        let mut difference = vec![0.0; 12];
        record.difference(&x, image, &mut difference).unwrap();
        assert!(difference.iter().all(|d| d.abs() < 1e-9));
        found.push(record.expand(image).0);
    });
    found
}

#[test]
fn the_mirror_image_has_the_same_data_unless_knowledge_excludes_it() {
    let sensors = Sensors::vector(&[[0.0; 3]]);
    let mut knowledge = Knowledge::default();
    knowledge.exact[SPEED] = Some(1.65_f64.sqrt());
    let found = images(&sensors, &knowledge);
    assert_eq!(found.len(), 1);
    assert!((found[0][0] - 10.0).abs() < 1e-12 && (found[0][3] + 1.0).abs() < 1e-12);
    knowledge.exact[2] = Some(5.0);
    assert!(images(&sensors, &knowledge).is_empty(), "z is 5");
}

#[test]
fn the_mirror_image_at_a_gradiometer_has_the_opposite_moment() {
    let sensors = Sensors {
        places: &[[0.3, 0.0, 0.0]],
        baselines: &[[0.0, 0.0, 2.0]],
        ambient: None,
    };
    let mut knowledge = Knowledge::default();
    let found = images(&sensors, &knowledge);
    assert_eq!(found.len(), 1);
    assert!((found[0][0] - 10.6).abs() < 1e-12 && (found[0][2] + 3.0).abs() < 1e-12);
    assert!((found[0][6] + NEAR[6]).abs() < 1e-12);
    knowledge.exact[6] = Some(10.0);
    assert!(images(&sensors, &knowledge).is_empty(), "mx is 10");
}

#[test]
fn heads_that_swallow_the_field_leave_it_unexplained() {
    let times = [0.0, 1.0, 2.0];
    let sensors = Sensors {
        places: &[[0.0; 3]],
        baselines: &[[0.0, 1.0, 0.0]],
        ambient: None,
    };
    let field: Vec<f64> = (1..10).map(|k| 1e-9 * f64::from(k)).collect();
    let noise = Whitening::first_order(&times, 3, vec![1e9; 9], 0.0, 1.0);
    let record = Measured::new(
        &times,
        &sensors,
        &field,
        noise,
        false,
        Knowledge::default(),
        &NEAR,
    );
    // So far away along the baseline that the heads differ by nothing.
    let x = [0.0, 1e20, 0.0, 1.0, 0.0, 0.0, 1e80, 0.0, 0.0];
    let mut residuals = [0.0; 9];
    record.linearize(&x, &mut residuals, None).unwrap();
    for (left, seen) in residuals.iter().zip(&field) {
        assert!((left - 1e9 * seen).abs() < 1e-12);
    }
}
