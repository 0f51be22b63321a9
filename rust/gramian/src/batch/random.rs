//! Random numbers that depend on the seed and the trial alone: never on the
//! number of threads, processes or machines, nor on where a run was cut.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::Threads;

/// The stream of random numbers of one trial.
///
/// ```
/// use gramian::batch::Stream;
/// let mut a = Stream::new(7, 1000);
/// let mut b = Stream::new(7, 1000);
/// assert_eq!(a.normal(), b.normal());
/// ```
#[derive(Clone, Debug)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream of `trial` under `seed`.
    pub fn new(seed: u64, trial: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(trial);
        Self(generator)
    }

    /// A standard normal number.
    #[inline]
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// A number uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        rand_distr::StandardUniform.sample(&mut self.0)
    }
}

/// Standard normal numbers, `count` for each trial from `first` on.
pub fn normals(seed: u64, first: u64, count: usize, threads: Threads, out: &mut [f64]) {
    let each = |trial: usize, out: &mut [f64]| -> Result<(), core::convert::Infallible> {
        let mut stream = Stream::new(seed, first + trial as u64);
        out.fill_with(|| stream.normal());
        Ok(())
    };
    let Ok(()) = threads.over(out, count, 10.0 * count as f64, each);
}
