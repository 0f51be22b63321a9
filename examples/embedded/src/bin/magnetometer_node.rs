//! A magnetometer beside a road, "time bx by bz" a line (s, T): follows what its
//! samples tell of a vehicle that passes, and says when the closest approach has
//! been captured: `magnetometer_node < data/field.txt`.
//!
//! The node knows its road: height difference and lane, and the usual speed. The
//! vehicle is somewhere along it, with some moment. At each sample the moment is
//! fitted to the field so far (it enters linearly), and the information on the
//! crossing instant is summed. Once its growth has fallen to a small part of its
//! peak, the closest approach is behind, and the samples to come add nothing.
#![allow(clippy::print_stdout)]

use std::io::{self, BufRead};

use gramian::dipole;
use gramian::square_root::SquareRootInformation;

/// The sensor's noise, T.
const SIGMA: f32 = 5e-8;
/// The lane: distance to the side and below, m, and the usual speed, m/s.
const SIDE: f32 = 2.5;
const BELOW: f32 = -0.3;
const SPEED: f32 = 10.0;
/// A vehicle's moment, A m^2, for the time before there is any field to fit.
const MOMENT: [f32; 3] = [50.0, 20.0, -150.0];
/// A field above this many standard deviations is a vehicle.
const ALARM: f32 = 20.0;

/// Position of a vehicle that crosses at `crossing`, seen from the sensor.
fn position(time: f32, crossing: f32) -> [f32; 3] {
    [SPEED * (time - crossing), SIDE, BELOW]
}

fn main() -> io::Result<()> {
    // Information on (crossing instant, moment in units of 100 A m^2).
    let mut information = SquareRootInformation::<f32, 4>::new();
    let (mut peak_field, mut crossing) = (0.0_f32, 0.0_f32);
    let (mut best_growth, mut last_bound) = (0.0_f32, f32::INFINITY);
    let (mut seen, mut captured) = (false, false);
    for line in io::stdin().lock().lines() {
        let line = line?;
        let numbers: Vec<f32> = line
            .split_whitespace()
            .filter_map(|word| word.parse().ok())
            .collect();
        let [time, field @ ..] = numbers.as_slice() else {
            continue;
        };
        let [bx, by, bz] = *field else {
            println!("not a sample: {line:?}");
            continue;
        };
        let size = (bx * bx + by * by + bz * bz).sqrt();
        if !seen && size > ALARM * SIGMA {
            seen = true;
            println!("{time} s: a vehicle, {:.2} uT", size * 1e6);
        }
        if !seen {
            continue;
        }
        // The strongest field so far is the best guess of the crossing.
        if size > peak_field {
            peak_field = size;
            crossing = *time;
        }
        let at = position(*time, crossing);
        let Ok(jacobian) = dipole::jacobian(&at, &MOMENT) else {
            println!("{time} s: the vehicle would be on the sensor");
            continue;
        };
        for axis in 0..3 {
            let by_crossing = -SPEED * jacobian.position[axis][0];
            let moment = jacobian.moment[axis];
            let row = [
                by_crossing / SIGMA,
                100.0 * moment[0] / SIGMA,
                100.0 * moment[1] / SIGMA,
                100.0 * moment[2] / SIGMA,
            ];
            if let Err(error) = information.push(&row) {
                println!("{time} s: {error}");
            }
        }
        let bound = information.crlb_std()[0];
        let growth = if last_bound.is_finite() {
            1.0 / (bound * bound) - 1.0 / (last_bound * last_bound)
        } else {
            0.0
        };
        last_bound = bound;
        best_growth = best_growth.max(growth);
        if !captured && *time > crossing && growth < 0.02 * best_growth {
            captured = true;
            println!(
                "{time} s: closest approach captured at {crossing} s, known to {:.2} ms",
                bound * 1e3
            );
        }
    }
    if seen && !captured {
        println!("the closest approach was not captured");
    }
    Ok(())
}
