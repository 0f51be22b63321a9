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

/// Work that is taken at a time, nanoseconds: enough that taking it does not show, and so
/// little that no thread waits long for the last to end.
#[cfg(feature = "parallel")]
const PIECE: f64 = 2.5e4;

impl Threads {
    /// Work, in nanoseconds, that is done on the calling thread in any case.
    ///
    /// A thread that sleeps wakes within some ten microseconds; until then the calling
    /// thread works alone.
    pub const LEAST_WORK: f64 = 2e5;

    /// Calls `each(trial, out)` for every trial with its own `size` entries of
    /// `out`. `cost` is what one trial takes, in nanoseconds, roughly.
    ///
    /// # Errors
    /// The error of the first trial (by index) that fails.
    pub fn over<T: Send, E: Send>(
        self,
        out: &mut [T],
        size: usize,
        cost: f64,
        each: impl Fn(usize, &mut [T]) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        self.over_with(out, size, cost, || (), |(), trial, out| each(trial, out))
    }

    /// Calls `each(first, out)` for groups of `group` trials that follow each other,
    /// the last group with what is left: for kernels that take several trials at
    /// once. `cost` is of one trial.
    ///
    /// # Errors
    /// The error of the first group that fails.
    pub fn over_groups<T: Send, E: Send>(
        self,
        out: &mut [T],
        size: usize,
        group: usize,
        cost: f64,
        each: impl Fn(usize, &mut [T]) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        self.over_groups_with(
            out,
            size,
            group,
            cost,
            || (),
            |(), first, out| each(first, out),
        )
    }

    /// [`over_groups`](Self::over_groups) with scratch space that `scratch` makes once a thread.
    ///
    /// # Errors
    /// The error of the first group that fails.
    pub fn over_groups_with<S, T: Send, E: Send>(
        self,
        out: &mut [T],
        size: usize,
        group: usize,
        cost: f64,
        scratch: impl Fn() -> S + Sync,
        each: impl Fn(&mut S, usize, &mut [T]) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        if size == 0 || group == 0 {
            return Ok(());
        }
        let groups = out.len() / (size * group);
        let (whole, rest) = out.split_at_mut(groups * size * group);
        self.over_with(
            whole,
            size * group,
            cost * group as f64,
            &scratch,
            |space, index, out| each(space, index * group, out),
        )?;
        if rest.is_empty() {
            return Ok(());
        }
        each(&mut scratch(), groups * group, rest)
    }

    /// [`over`](Self::over) with scratch space that `scratch` makes once a thread.
    ///
    /// # Errors
    /// The error of the first trial (by index) that fails.
    pub fn over_with<S, T: Send, E: Send>(
        self,
        out: &mut [T],
        size: usize,
        cost: f64,
        scratch: impl Fn() -> S + Sync,
        each: impl Fn(&mut S, usize, &mut [T]) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        if size == 0 {
            return Ok(());
        }
        #[cfg(feature = "parallel")]
        {
            let trials = out.len() / size;
            if self == Self::Auto && cost * trials as f64 > Self::LEAST_WORK {
                return shared_out(out, size, cost, &scratch, &each);
            }
        }
        let _ = (self, cost);
        run(out, size, 0, &mut scratch(), &each).map_err(|(_, error)| error)
    }
}

#[cfg(feature = "parallel")]
std::thread_local! {
    static POOL: core::cell::RefCell<Option<alloc::sync::Arc<rayon::ThreadPool>>> =
        const { core::cell::RefCell::new(None) };
}

/// Calls `work`, whose batches with [`Threads::Auto`] use the threads of `pool`: all but one of
/// them beside the calling thread, which works too. Elsewhere they use rayon's global pool.
#[cfg(feature = "parallel")]
pub fn in_pool<R>(pool: alloc::sync::Arc<rayon::ThreadPool>, work: impl FnOnce() -> R) -> R {
    /// Puts back what was there, however the work ends.
    struct Back(Option<alloc::sync::Arc<rayon::ThreadPool>>);
    impl Drop for Back {
        fn drop(&mut self) {
            POOL.set(self.0.take());
        }
    }
    let _back = Back(POOL.replace(Some(pool)));
    work()
}

/// The work of [`Threads::over_with`] on all threads of the pool. The calling thread does not
/// wait for the others to wake: it takes piece after piece, and so does each that has come.
#[cfg(feature = "parallel")]
fn shared_out<S, T: Send, E: Send>(
    out: &mut [T],
    size: usize,
    cost: f64,
    scratch: &(impl Fn() -> S + Sync),
    each: &(impl Fn(&mut S, usize, &mut [T]) -> Result<(), E> + Sync),
) -> Result<(), E> {
    use std::sync::{Mutex, PoisonError};

    let trials = out.len() / size;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let piece = ((PIECE / cost).ceil() as usize).clamp(1, trials);
    let pieces = Mutex::new(out.chunks_mut(piece * size).enumerate());
    let first_error: Mutex<Option<(usize, E)>> = Mutex::new(None);
    let work = || {
        let mut space = None;
        loop {
            let next = pieces.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some((index, chunk)) = next else {
                return;
            };
            let space = space.get_or_insert_with(scratch);
            if let Err((trial, error)) = run(chunk, size, index * piece, space, each) {
                let mut first = first_error.lock().unwrap_or_else(PoisonError::into_inner);
                if first.as_ref().is_none_or(|(known, _)| trial < *known) {
                    *first = Some((trial, error));
                }
            }
        }
    };
    let pool = POOL.with_borrow(Clone::clone);
    let others = pool
        .as_ref()
        .map_or_else(rayon::current_num_threads, |p| p.current_num_threads())
        .min(trials.div_ceil(piece))
        .saturating_sub(1);
    match &pool {
        Some(pool) => pool.in_place_scope(|scope| beside(scope, others, &work)),
        None => rayon::in_place_scope(|scope| beside(scope, others, &work)),
    }
    let first = first_error
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner);
    first.map_or(Ok(()), |(_, error)| Err(error))
}

/// Does the same work on `others` threads of the scope and here.
#[cfg(feature = "parallel")]
fn beside<'scope>(scope: &rayon::Scope<'scope>, others: usize, work: &'scope (impl Fn() + Sync)) {
    for _ in 0..others {
        scope.spawn(|_| work());
    }
    work();
}

fn run<S, T, E>(
    out: &mut [T],
    size: usize,
    first: usize,
    space: &mut S,
    each: &impl Fn(&mut S, usize, &mut [T]) -> Result<(), E>,
) -> Result<(), (usize, E)> {
    for (i, item) in out.chunks_exact_mut(size).enumerate() {
        each(space, first + i, item).map_err(|error| (first + i, error))?;
    }
    Ok(())
}
