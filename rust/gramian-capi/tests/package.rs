//! What `cargo publish` would send: sources, readme and licences, nothing else.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::Command;

fn files(package: &str) -> Vec<String> {
    let done = Command::new(env!("CARGO"))
        .args(["package", "--list", "--allow-dirty", "--offline", "-p"])
        .arg(package)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{said}");
    let list = String::from_utf8(done.stdout).unwrap();
    list.lines().map(str::to_owned).collect()
}

#[test]
fn the_packages_hold_no_stray_files() {
    for (package, folders) in [
        ("gramian", &["src", "examples", "benches", "tests"][..]),
        ("gramian-capi", &["src", "include"][..]),
    ] {
        let files = files(package);
        for wanted in ["README.md", "LICENSE-MIT", "LICENSE-APACHE", "src/lib.rs"] {
            assert!(files.iter().any(|f| f == wanted), "{package}: no {wanted}");
        }
        for file in &files {
            let path = Path::new(file);
            let kind = path.extension().and_then(|kind| kind.to_str());
            let source = folders.iter().any(|folder| path.starts_with(folder))
                && matches!(kind, Some("rs" | "h"));
            let other = [
                "Cargo.toml",
                "Cargo.toml.orig",
                "Cargo.lock",
                ".cargo_vcs_info.json",
                "README.md",
                "LICENSE-MIT",
                "LICENSE-APACHE",
                "cbindgen.toml",
            ];
            assert!(
                source || other.contains(&file.as_str()),
                "{package}: {file}"
            );
        }
    }
}
