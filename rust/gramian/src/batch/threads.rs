//! How many threads, and which trials each takes.

/// The threads that a batch may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Threads {
    /// As many as the work is worth, up to the number of cores.
    #[default]
    Auto,
    /// All work on the calling thread.
    One,
}

/// Below this much work on a thread, starting it costs more than it saves.
const NANOSECONDS_A_THREAD: f64 = 2e5;

impl Threads {
    /// Work, in nanoseconds, that is done on the calling thread in any case.
    pub const LEAST_WORK: f64 = 2.0 * NANOSECONDS_A_THREAD;

    /// Calls `each(trial, out)` for every trial with its own `size` entries of
    /// `out`. `cost` is what one trial takes, in nanoseconds, roughly.
    ///
    /// # Errors
    /// The error of the first trial (by index) that fails.
    pub fn over<E: Send>(
        self,
        out: &mut [f64],
        size: usize,
        cost: f64,
        each: impl Fn(usize, &mut [f64]) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        self.over_with(out, size, cost, || (), |(), trial, out| each(trial, out))
    }

    /// Calls `each(first, out)` for groups of `group` trials that follow each other,
    /// the last group with what is left: for kernels that take several trials at
    /// once. `cost` is of one trial.
    ///
    /// # Errors
    /// The error of the first group that fails.
    pub fn over_groups<E: Send>(
        self,
        out: &mut [f64],
        size: usize,
        group: usize,
        cost: f64,
        each: impl Fn(usize, &mut [f64]) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        if size == 0 || group == 0 {
            return Ok(());
        }
        let groups = out.len() / (size * group);
        let (whole, rest) = out.split_at_mut(groups * size * group);
        self.over(whole, size * group, cost * group as f64, |index, out| {
            each(index * group, out)
        })?;
        if rest.is_empty() {
            return Ok(());
        }
        each(groups * group, rest)
    }

    /// [`over`](Self::over) with scratch space that `scratch` makes once a thread and task.
    ///
    /// # Errors
    /// The error of the first trial (by index) that fails.
    pub fn over_with<S, E: Send>(
        self,
        out: &mut [f64],
        size: usize,
        cost: f64,
        scratch: impl Fn() -> S + Sync,
        each: impl Fn(&mut S, usize, &mut [f64]) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        if size == 0 {
            return Ok(());
        }
        #[cfg(feature = "parallel")]
        {
            use rayon::prelude::*;
            let trials = out.len() / size;
            let work = cost * trials as f64;
            if self == Self::Auto && work > Self::LEAST_WORK {
                // Tasks of equal trials; more tasks than threads, so that a slow
                // core does not hold up the rest.
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                let task = ((NANOSECONDS_A_THREAD / cost).ceil() as usize).clamp(1, trials);
                let first = out
                    .par_chunks_mut(task * size)
                    .enumerate()
                    // Each task can be taken by itself: else the threads get
                    // halves of the range, which may hold unequal work.
                    .with_max_len(1)
                    .filter_map(|(index, chunk)| {
                        run(chunk, size, index * task, &scratch, &each).err()
                    })
                    .min_by_key(|(trial, _)| *trial);
                return first.map_or(Ok(()), |(_, error)| Err(error));
            }
        }
        let _ = (self, cost);
        run(out, size, 0, &scratch, &each).map_err(|(_, error)| error)
    }
}

fn run<S, E>(
    out: &mut [f64],
    size: usize,
    first: usize,
    scratch: &impl Fn() -> S,
    each: &impl Fn(&mut S, usize, &mut [f64]) -> Result<(), E>,
) -> Result<(), (usize, E)> {
    let mut space = scratch();
    for (i, item) in out.chunks_exact_mut(size).enumerate() {
        each(&mut space, first + i, item).map_err(|error| (first + i, error))?;
    }
    Ok(())
}
