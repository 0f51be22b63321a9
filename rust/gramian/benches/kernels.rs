//! Timings of the kernels on one thread: `cargo bench -p gramian`.
#![allow(missing_docs, clippy::print_stdout, clippy::panic)]

mod work;

use divan::Bencher;

fn main() {
    divan::main();
}

#[divan::bench(args = work::ALL.iter().map(|(name, _)| *name))]
fn kernel(bencher: Bencher, name: &str) {
    let Some(mut work) = work::named(name) else {
        panic!("no kernel is named {name}");
    };
    bencher.bench_local(&mut work);
}
