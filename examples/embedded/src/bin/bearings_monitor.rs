//! Reads bearings one by one, "time bearing sigma" a line (s, rad, rad), and says
//! when the track becomes observable: `bearings_monitor < data/bearings.txt`.
//!
//! On a vehicle the loop's body runs at each bearing. The monitor holds no
//! bearing and allocates nothing.
#![allow(clippy::print_stdout)]

use std::io::{self, BufRead};

use gramian::bearings::Monitor;

/// How unlikely the bearings must be for an unobservable track.
const LEVEL: f32 = 0.001;

fn main() -> io::Result<()> {
    let mut monitor = Monitor::<f32>::new();
    let mut observable = false;
    for line in io::stdin().lock().lines() {
        let line = line?;
        let numbers: Vec<f32> = line
            .split_whitespace()
            .filter_map(|word| word.parse().ok())
            .collect();
        let [time, bearing, sigma] = numbers.as_slice() else {
            println!("not a sample: {line:?}");
            continue;
        };
        if let Err(error) = monitor.push(*time, *bearing, *sigma, None) {
            println!("{time} s: refused: {error}");
            continue;
        }
        let answer = monitor.answer();
        if observable != (answer.p_value < LEVEL) {
            observable = !observable;
            let state = if observable {
                "observable"
            } else {
                "not observable"
            };
            println!("{time} s: {state} after {} bearings", answer.count);
        }
    }
    let answer = monitor.answer();
    println!("{} bearings, rank {}", answer.count, answer.rank);
    Ok(())
}
