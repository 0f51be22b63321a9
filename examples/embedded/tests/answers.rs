//! The examples against recorded answers.
#![allow(clippy::unwrap_used)]

use std::fs::File;
use std::path::Path;
use std::process::Command;

fn output(program: &str, data: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let done = Command::new(program)
        .stdin(File::open(folder.join(data)).unwrap())
        .output()
        .unwrap();
    assert!(done.status.success());
    String::from_utf8(done.stdout).unwrap()
}

#[test]
fn the_monitor_says_when_the_turn_makes_the_track_observable() {
    let found = output(env!("CARGO_BIN_EXE_bearings_monitor"), "bearings.txt");
    assert_eq!(found, include_str!("../data/bearings.answer.txt"));
}

#[test]
fn the_node_says_when_the_closest_approach_is_captured() {
    let found = output(env!("CARGO_BIN_EXE_magnetometer_node"), "field.txt");
    assert_eq!(found, include_str!("../data/field.answer.txt"));
}
