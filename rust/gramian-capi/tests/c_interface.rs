//! The header is the one of the source, and a C program that uses it runs.
#![allow(clippy::unwrap_used)]

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

fn here() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Set `GRAMIAN_WRITE_HEADER` to write the header anew.
#[test]
fn header_is_of_this_source() {
    let mut found = Vec::new();
    cbindgen::generate(here()).unwrap().write(&mut found);
    let header = here().join("include/gramian.h");
    if std::env::var_os("GRAMIAN_WRITE_HEADER").is_some() {
        fs::write(&header, &found).unwrap();
    }
    let kept = fs::read_to_string(&header).unwrap();
    assert_eq!(String::from_utf8(found).unwrap(), kept);
}

#[test]
fn a_c_program_watches_bearings() {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR"));
    // Cargo has built the static library for this test: it stands beside it.
    let test = std::env::current_exe().unwrap();
    let library = fs::read_dir(test.parent().unwrap())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            let name = path.file_stem().unwrap().to_string_lossy();
            name.starts_with("libgramian_capi") && path.extension().is_some_and(|e| e == "a")
        })
        .max_by_key(|path| fs::metadata(path).unwrap().modified().unwrap())
        .unwrap();
    let program = target.join("monitor");
    let examples = here().join("../../examples/embedded");
    let compiled = Command::new("cc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(here().join("include"))
        .arg(examples.join("monitor.c"))
        .arg(library)
        .args(["-lm", "-lpthread", "-ldl", "-o"])
        .arg(&program)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&compiled.stderr);
    assert!(compiled.status.success(), "{said}");
    let done = Command::new(&program)
        .stdin(File::open(examples.join("data/bearings.txt")).unwrap())
        .output()
        .unwrap();
    let answer = fs::read_to_string(examples.join("data/monitor_c.answer.txt")).unwrap();
    assert_eq!(String::from_utf8(done.stdout).unwrap(), answer);
}
