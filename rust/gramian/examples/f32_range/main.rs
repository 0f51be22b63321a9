//! How far single precision is from double: prints the tables of
//! `docs/howto/embedded.md`.
//!
//! ```text
//! cargo run --release -p gramian --example f32_range
//! ```
#![allow(missing_docs, clippy::print_stdout)]

mod cases;

/// A difference, or the rank where that is another.
fn shown(value: Result<f64, usize>) -> String {
    match value {
        Ok(value) if value.is_finite() => format!("{value:.0e}"),
        Ok(_) => "useless".to_owned(),
        Err(rank) => format!("rank {rank}"),
    }
}

fn monitor(tracks: &[cases::Track]) {
    println!("| track | turn | bearings | rank f32, f64 | bound | statistic | p-value |");
    println!("|---|---|---|---|---|---|---|");
    for track in tracks {
        let found = track.compare();
        let [single, double] = found.rank;
        let bound = if single == double {
            shown(Ok(found.bound))
        } else {
            "inf".to_owned()
        };
        println!(
            "| {} | {} deg | {} | {single}, {double} | {bound} | {:.0e} | {:.0e} |",
            track.name, track.turn, track.count, found.statistic, found.p_value
        );
    }
    println!();
}

fn main() {
    println!("Bearings monitor, reference geometries:\n");
    monitor(&cases::REFERENCE);
    println!("Bearings monitor, harder ones:\n");
    monitor(&cases::HARDER);
    println!("Rows by hand, bound:\n");
    println!(
        "| track | turn | factor of the rows | the same, positions 4 000 km off | information matrix |"
    );
    println!("|---|---|---|---|---|");
    for track in cases::REFERENCE {
        let track = cases::Track {
            uneven: true,
            ..track
        };
        let [root, matrix] = track.compare_rows(0.0);
        let [far, _] = track.compare_rows(4e6);
        println!(
            "| {} | {} deg | {} | {} | {} |",
            track.name,
            track.turn,
            shown(root),
            shown(far),
            shown(matrix)
        );
    }
    println!("\nDipole, one sensor of 1 nT:\n");
    println!("| pass | rank of 9, f32, f64 | bound, height known | running sums |");
    println!("|---|---|---|---|");
    for pass in &cases::DIPOLES {
        let ([single, double], bound, sums) = pass.compare();
        println!(
            "| {} | {single}, {double} | {} | {sums:.0e} |",
            pass.name,
            shown(Ok(bound))
        );
    }
    println!("\nRegistration of two radars:\n");
    println!("| target | rank f32, f64 | bound | degree f32, f64 |");
    println!("|---|---|---|---|");
    for radars in &cases::RADARS {
        let ([single, double], bound, [s, d]) = radars.compare();
        println!(
            "| {} | {single}, {double} | {} | {s:.4}, {d:.4} |",
            radars.name,
            shown(Ok(bound))
        );
    }
}
