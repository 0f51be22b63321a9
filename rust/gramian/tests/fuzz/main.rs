//! Random bit patterns for every public function of the surface without `std`, in
//! `f32` and `f64`: none may panic or run without end, accept a number that is not
//! finite in silence, or return one without an error. Infinity is an answer only
//! where the documentation says so, NaN nowhere; a refused call changes nothing.
//!
//! `GRAMIAN_FUZZ` is the number of patterns for each function (`make fuzz` takes a
//! million). A pattern that fails is named in the message by its number.
//!
//! # A new function
//! Write a case, `fn name<T: Number>(draw: &mut Draw<T>)`, in the file of its model: it
//! draws the inputs from `draw`, hands the result to [`Draw::taken`] and what is in it to
//! [`Draw::finite`], [`Draw::bounds`] or [`Draw::ordered`]. List it in [`CASES`].
//! `every_public_function_has_a_case` fails until one of the files calls the function.
//! What only hands out a field, or changes no number, stands in [`NOTHING_TO_TEST`].
#![allow(clippy::unwrap_used, clippy::print_stderr)]

mod bearings;
mod dipole;
mod draw;
mod inertial;
mod linear;
mod maneuver;
mod registration;
#[cfg(feature = "alloc")]
mod sized;
mod spine;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use draw::{Draw, Number};

type Case<T> = fn(&mut Draw<T>);

macro_rules! cases {
    ($($(#[$attribute:meta])* $($name:ident)::+),+ $(,)?) => {
        /// All cases, for each number type.
        const CASES: &[(&str, Case<f32>, Case<f64>)] =
            &[$($(#[$attribute])* (stringify!($($name)::+), $($name)::+::<f32>, $($name)::+::<f64>)),+];
    };
}

cases![
    spine::square_root,
    spine::spectrum,
    spine::row_sinks,
    spine::information,
    spine::posterior,
    spine::constrained_posterior,
    spine::semidefinite_root,
    spine::chi_square,
    spine::scalar,
    inertial::inertial_models,
    bearings::discriminants,
    bearings::sums,
    bearings::observability_test,
    bearings::monitor,
    bearings::motions,
    bearings::bearing_rows,
    dipole::fields,
    dipole::quadrupoles,
    dipole::passes,
    #[cfg(feature = "std")]
    dipole::bodies,
    dipole::sensors,
    dipole::accumulator,
    dipole::tracker,
    maneuver::laws,
    maneuver::best_heading,
    maneuver::steering,
    maneuver::plans,
    registration::planes,
    registration::running,
    registration::looks,
    linear::levels,
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
    let manifest = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let here: String = std::fs::read_dir(manifest.join("tests/fuzz"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| !path.ends_with("main.rs"))
        .map(|path| std::fs::read_to_string(path).unwrap())
        .collect::<Vec<_>>()
        .join("\n")
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .collect::<Vec<_>>()
        .join("\n");
    let source = manifest.join("src");
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
