//! Running a kernel: without the interpreter lock, on the chosen number of
//! threads, in pieces short enough that Ctrl-C is heard.

use std::cell::RefCell;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

use gramian::batch::{Threads, in_pool};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyInt};
use rayon::ThreadPool;

use crate::convert;
use crate::errors::InputError;

/// How long the interpreter may go without a look at its signals, nanoseconds.
pub const PIECE: f64 = 1e8;

/// Work so short that releasing the interpreter lock costs more, nanoseconds.
const BRIEF: f64 = 5e3;

struct Setting {
    /// 0: as many as there are cores.
    threads: usize,
    /// The pool, and the process it was made in: a forked child has none of its
    /// parent's threads and must make its own.
    pool: Option<(u32, Arc<ThreadPool>)>,
}

static SETTING: Mutex<Setting> = Mutex::new(Setting {
    threads: 0,
    pool: None,
});

/// What a thread was told that has a share of some larger work.
struct Worker {
    /// Whether its kernels stay on it.
    alone: bool,
    /// Called now and then, as only the main thread hears Ctrl-C; may raise.
    check: Py<PyAny>,
}

thread_local! {
    static WORKER: RefCell<Option<Worker>> = const { RefCell::new(None) };
}

/// Makes the calling thread a worker: with `alone` its kernels stay on it, and
/// during long ones `check` is called, which may raise.
#[pyfunction]
pub fn be_worker(alone: bool, check: Py<PyAny>) {
    WORKER.set(Some(Worker { alone, check }));
}

/// More threads than this are refused: each takes memory, and none helps.
const MOST_THREADS: usize = 1024;

/// Sets how many threads kernels may use; 0 for as many as there are cores.
/// Returns the setting before.
#[pyfunction]
pub fn set_threads(threads: &Bound<'_, PyAny>) -> PyResult<usize> {
    let whole = threads.is_instance_of::<PyInt>() && !threads.is_instance_of::<PyBool>();
    let threads = match threads.extract::<usize>() {
        Ok(threads) if whole && threads <= MOST_THREADS => threads,
        _ => {
            return Err(InputError::new_err(format!(
                "threads = {}: must be a whole number from 0 to {MOST_THREADS}",
                convert::value_text(threads)
            )));
        }
    };
    let mut setting = SETTING.lock().unwrap_or_else(PoisonError::into_inner);
    let before = setting.threads;
    if before != threads {
        setting.threads = threads;
        discard(setting.pool.take());
    }
    Ok(before)
}

/// How many threads kernels may use now.
#[pyfunction]
pub fn threads() -> usize {
    match SETTING
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .threads
    {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    }
}

/// The pool to run in; `None` for the calling thread alone.
fn pool() -> PyResult<Option<Arc<ThreadPool>>> {
    if WORKER.with_borrow(|worker| worker.as_ref().is_some_and(|worker| worker.alone)) {
        return Ok(None);
    }
    let mut setting = SETTING.lock().unwrap_or_else(PoisonError::into_inner);
    if setting.threads == 1 {
        return Ok(None);
    }
    let process = std::process::id();
    if let Some((owner, pool)) = &setting.pool
        && *owner == process
    {
        return Ok(Some(Arc::clone(pool)));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(setting.threads)
        .build()
        .map_err(|error| InputError::new_err(format!("cannot start threads: {error}")))?;
    let pool = Arc::new(pool);
    discard(setting.pool.replace((process, Arc::clone(&pool))));
    Ok(Some(pool))
}

/// Drops a pool, unless it is the parent's and this is a forked child: that
/// would wait for threads that are not there.
fn discard(pool: Option<(u32, Arc<ThreadPool>)>) {
    if let Some((owner, pool)) = pool
        && owner != std::process::id()
    {
        core::mem::forget(pool);
    }
}

/// Calls `kernel` with the threads it may use, the interpreter lock released.
pub fn detached<R: Send>(py: Python<'_>, kernel: impl FnOnce(Threads) -> R + Send) -> PyResult<R> {
    let pool = pool()?;
    Ok(py.detach(|| match pool {
        None => kernel(Threads::One),
        Some(pool) => in_pool(pool, || kernel(Threads::Auto)),
    }))
}

/// Calls `kernel` on one range of trials after the other. `cost` is roughly
/// what a trial takes, in nanoseconds; between ranges Ctrl-C is heard, and a
/// worker's check called.
pub fn in_pieces(
    py: Python<'_>,
    trials: usize,
    cost: f64,
    mut kernel: impl FnMut(Range<usize>, Threads) -> PyResult<()> + Send,
) -> PyResult<()> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let most = ((PIECE / cost.max(1.0)) as usize).max(1);
    let work = cost * trials as f64;
    if work <= BRIEF {
        return kernel(0..trials, Threads::One);
    }
    // Entering the pool would take longer than it saves, or than the work.
    let small = work <= Threads::LEAST_WORK;
    // What a trial costs is a guess, and a function of the user's own may take any time: a
    // short piece first, and from then on as long as the one before says.
    let mut piece = most.div_ceil(16);
    let mut first = 0;
    while first < trials {
        let range = first..trials.min(first + piece);
        let (count, begun) = (range.len(), Instant::now());
        first = range.end;
        if small {
            py.detach(|| kernel(range, Threads::One))?;
        } else {
            detached(py, |threads| kernel(range, threads))??;
        }
        let took = begun.elapsed().as_nanos() as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let next = (count as f64 * PIECE / took.max(1.0)) as usize;
        piece = next.clamp(1, most);
        look(py)?;
    }
    Ok(())
}

/// Runs `work` with the interpreter released; it asks the closure it is given, and that
/// looks for Ctrl-C now and then. The answer is that of `work`, or what a signal raised.
pub fn interruptible<R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&mut dyn FnMut() -> bool) -> R + Send,
) -> PyResult<R> {
    let mut raised = None;
    let answer = py.detach(|| {
        let mut last = Instant::now();
        let mut stop = || {
            if last.elapsed() < Duration::from_millis(100) {
                return raised.is_some();
            }
            last = Instant::now();
            raised = Python::attach(look).err();
            raised.is_some()
        };
        work(&mut stop)
    });
    match raised {
        Some(error) => Err(error),
        None => Ok(answer),
    }
}

/// Gives a pool up to work that nobody waits for any more: the next call makes its own, and
/// does not stand behind that work.
fn abandon(pool: Option<&Arc<ThreadPool>>) {
    let mut setting = SETTING.lock().unwrap_or_else(PoisonError::into_inner);
    if let (Some(given), Some((_, now))) = (pool, &setting.pool)
        && Arc::ptr_eq(given, now)
    {
        discard(setting.pool.take());
    }
}

/// Calls `work`, which does not look for Ctrl-C, on a thread of its own where it takes
/// long: `cost`, in nanoseconds. What is interrupted ends by itself.
pub fn apart<R: Send + 'static>(
    py: Python<'_>,
    cost: f64,
    work: impl FnOnce(Threads) -> R + Send + 'static,
) -> PyResult<R> {
    let pool = pool()?;
    let used = pool.clone();
    let run = move || match pool {
        None => work(Threads::One),
        Some(pool) => in_pool(pool, || work(Threads::Auto)),
    };
    if cost <= PIECE {
        return Ok(py.detach(run));
    }
    let (sender, receiver) = mpsc::channel();
    std::thread::Builder::new()
        .spawn(move || drop(sender.send(run())))
        .map_err(|error| InputError::new_err(format!("cannot start a thread: {error}")))?;
    let receiver = Mutex::new(receiver);
    loop {
        let result = py.detach(|| {
            let receiver = receiver.lock().unwrap_or_else(PoisonError::into_inner);
            receiver.recv_timeout(Duration::from_millis(100))
        });
        match result {
            Ok(found) => return Ok(found),
            Err(mpsc::RecvTimeoutError::Timeout) => {
                look(py).inspect_err(|_| abandon(used.as_ref()))?;
            }
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                return Err(PyMemoryError::new_err("out of memory in a factorisation"));
            }
        }
    }
}

/// Raises where Ctrl-C was pressed; in a worker, where its check does.
pub fn look(py: Python<'_>) -> PyResult<()> {
    py.check_signals()?;
    let check = WORKER.with_borrow(|worker| worker.as_ref().map(|w| w.check.clone_ref(py)));
    if let Some(check) = check {
        check.call0(py)?;
    }
    Ok(())
}
