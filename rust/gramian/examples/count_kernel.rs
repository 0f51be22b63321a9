//! Runs one kernel a number of times, for counting its instructions:
//! `count_kernel NAME REPEATS`; without arguments it tells the vector path that the
//! processor gets, then the names.
#![allow(missing_docs, clippy::print_stdout)]

#[path = "../benches/work/mod.rs"]
mod work;

fn main() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, name, repeats] = arguments.as_slice() else {
        let path = gramian::batch::simd::Path::available().next();
        println!("{}", format!("{path:?}").replace("Some", ""));
        for (name, _) in work::ALL {
            println!("{name}");
        }
        return Ok(());
    };
    let repeats: u32 = repeats.parse().map_err(|_| "REPEATS must be a number")?;
    let mut work = work::named(name).ok_or(format!("no kernel is named {name}"))?;
    for _ in 0..repeats {
        work();
    }
    Ok(())
}
