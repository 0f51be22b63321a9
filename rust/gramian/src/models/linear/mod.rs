//! Linear systems x' = A x, y = C x (or `x[k+1] = A x[k]`): which combinations of
//! the states the output and its derivatives determine, and how well a window
//! of outputs does.
//!
//! The level of a combination of states is the smallest k for which it lies in
//! the row space of `O_k` = [C; CA; ..; CA^k]: it can be written by the output and
//! its first k derivatives. Levels do not depend on the units of states, outputs
//! or time, and neither do the decisions made here: the system is balanced first
//! (the module `scaling`), by powers of two found from its nonzero pattern, so that the
//! same system in other units is the same matrix. Powers of A are never formed.
//!
//! # Source
//! Yang & Yin 2012 (the order of a combination); Paige 1981 and Van Dooren 1981
//! (the staircase form); Curtis & Reid 1972 (the balance).
//!
//! Levels say when a combination is seen. *Whether* it is, the staircase tells where its
//! steps do not magnify rounding; where they do, `pencil` decides.

#[cfg(feature = "alloc")]
pub mod analysis;
#[cfg(feature = "std")]
pub mod batch;
#[cfg(feature = "alloc")]
pub mod infinite;
#[cfg(feature = "alloc")]
pub mod pencil;
#[cfg(feature = "alloc")]
pub mod piecewise;
pub(crate) mod scaling;
#[cfg(feature = "alloc")]
pub(crate) mod schur;
pub(crate) mod staircase;
#[cfg(feature = "alloc")]
pub mod unobservable;
#[cfg(feature = "alloc")]
pub mod window;
use crate::scalar::{NumberError, Real, check_finite};
use staircase::Staircase;
pub use staircase::{Found, default_rtol};

/// What can be wrong with the input of the parts for run-time sizes.
#[cfg(feature = "alloc")]
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A number that is not finite, or too large to go on with.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// A window too long for the numbers.
    #[error(transparent)]
    Window(#[from] window::Overflow),
    /// No eigenvalues.
    #[error(transparent)]
    Pencil(#[from] pencil::Error),
    /// A Gramian that does not exist.
    #[error(
        "A is not stable: its Gramian over an infinite window does not exist; take a finite \
         window, a discount, or the parts of A apart"
    )]
    Unstable,
    /// A question about levels where they cannot be told.
    #[error("levels cannot be told in this precision: rounding grows {growth:.1e} times")]
    Levels {
        /// A bound on how much the steps of the staircase magnify rounding.
        growth: f64,
    },
}

/// Ranks of `O_0`, `O_1`, .. of a system of fixed size, and the level of each state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallLevels<const N: usize> {
    /// Rank of `O_k` for k = 0..N.
    pub ranks: [usize; N],
    /// The level of each state, `None` where it is never determined.
    pub states: [Option<usize>; N],
    /// Whether the numbers of this type can tell the above. Where they cannot, `analysis`
    /// decides the rank on the `pencil`.
    pub reliable: bool,
}

/// Levels of a small system, without allocation.
///
/// # Errors
/// [`NumberError::NotFinite`] with the entry of A or C, row by row;
/// [`NumberError::Overflow`] for a system whose entries, though finite, differ by so
/// much that no units make their squares numbers.
///
/// # Source
/// Yang & Yin 2012; see the [module](self).
///
/// ```
/// use gramian::linear::levels;
/// // Position is measured, velocity follows from its derivative, the third
/// // state has no part in either.
/// let a = [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
/// let found = levels(&a, &[[1.0, 0.0, 0.0]])?;
/// assert_eq!(found.ranks, [1, 2, 2]);
/// assert_eq!(found.states, [Some(0), Some(1), None]);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
pub fn levels<T: Real, const N: usize, const P: usize>(
    a: &[[T; N]; N],
    c: &[[T; N]; P],
) -> Result<SmallLevels<N>, NumberError> {
    check_finite("A", a.as_flattened())?;
    check_finite("C", c.as_flattened())?;
    let (mut a, mut c) = (*a, *c);
    let zero = T::zero();
    let (mut basis, mut pattern) = ([[zero; N]; N], [[zero; N]; N]);
    let (mut see, mut state_work, mut output_work) =
        ([[zero; N]; P], [[zero; N]; 5], [[zero; P]; 4]);
    let (mut states, mut outputs) = ([zero; N], [zero; P]);
    let mut ranks = [0; N];
    if N == 0 {
        return Ok(SmallLevels {
            ranks,
            states: [None; N],
            reliable: true,
        });
    }
    staircase::center(a.as_flattened_mut(), N, N, &mut states);
    let systems = scaling::Systems {
        a: a.as_flattened(),
        c: c.as_flattened(),
        n: N,
        stride: N,
    };
    let work = scaling::Work {
        pattern: pattern.as_flattened_mut(),
        outputs_see: see.as_flattened_mut(),
        state: state_work.as_flattened_mut(),
        output: output_work.as_flattened_mut(),
    };
    let balance = scaling::balance(systems, work, &mut states, &mut outputs);
    balance.apply(
        &states,
        &outputs,
        a.as_flattened_mut(),
        c.as_flattened_mut(),
    );
    scaling::check(a.as_flattened(), c.as_flattened(), N)?;
    let [v, w, ..] = &mut state_work;
    let form = Staircase {
        n: N,
        stride: N,
        a: a.as_flattened(),
        c: c.as_flattened(),
        basis: basis.as_flattened_mut(),
        rows: if P > N {
            see.as_flattened_mut()
        } else {
            pattern.as_flattened_mut()
        },
    };
    let rtol = default_rtol(N);
    let found = form.reduce(rtol, v, w, &mut ranks);
    let touch = found.touch(rtol);
    let mut levels = [None; N];
    staircase::state_levels(basis.as_flattened(), N, N, &ranks, touch, |i, k| {
        levels[i] = k;
    });
    Ok(SmallLevels {
        ranks,
        states: levels,
        reliable: found.reliable(N),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn small_systems_in_single_precision_and_odd_units() {
        // Position, velocity, acceleration, and a bias that nothing sees; the
        // units are parts of each other's by up to 1e18.
        let a = [
            [0.0_f32, 1e9, 0.0, 0.0],
            [0.0, 0.0, 1e-9, 0.0],
            [0.0, 0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0],
        ];
        let found = levels(&a, &[[1e-6, 0.0, 0.0, 0.0], [1e6, 0.0, 0.0, 0.0]]).unwrap();
        assert_eq!(found.ranks, [1, 2, 3, 3]);
        assert_eq!(found.states, [Some(0), Some(1), Some(2), None]);
    }

    #[test]
    fn more_outputs_than_states() {
        let found = levels(&[[0.0]], &[[0.0], [3.0], [-1.0]]).unwrap();
        assert_eq!((found.ranks, found.states), ([1], [Some(0)]));
        assert!(levels(&[[f64::NAN]], &[[1.0]]).is_err());
        assert!(levels(&[[1.7e308, 0.0], [0.0, -1.7e308]], &[[1.0, 1.0]]).is_err());
        assert_eq!(levels(&[[1.0]], &[[0.0]]).unwrap().states, [None]);
    }
}
