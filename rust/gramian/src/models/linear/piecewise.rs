//! Systems that are constant by segments: what each segment adds.
//!
//! # Source
//! Goshen-Meskin & Bar-Itzhack 1992, Observability analysis of piece-wise
//! constant systems, IEEE Trans. Aerospace and Electronic Systems 28.
//!
//! ```
//! use gramian::linear::piecewise::Piecewise;
//! // A constant seen through another coefficient in each of two segments of 10 s.
//! let (a, c) = ([0.0_f64; 8], [1.0, 0.0, 1.0, 1.0]);
//! let found = Piecewise::new(&a, &c, &[10.0, 10.0], 2, None).unwrap();
//! assert_eq!((found.alone, found.total), (vec![1, 1], vec![1, 2]));
//! assert_eq!(found.determined, vec![vec![true, false], vec![true, true]]);
//! ```

use alloc::vec;
use alloc::vec::Vec;

use super::Error;
use super::analysis::{Analysis, reduced_null_space};
use super::window::{Overflow, exponential};
use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length};
use crate::spectrum;
use crate::square_root::rotate_in;

/// Ranks of a piecewise constant system, segment by segment.
#[derive(Clone, Debug)]
pub struct Piecewise<T> {
    /// The rank of each segment alone.
    pub alone: Vec<usize>,
    /// The rank of the stripped observability matrix [`Q_1`; ..; `Q_j`].
    pub stripped: Vec<usize>,
    /// The rank of the total observability matrix [`Q_1`; `Q_2` `Phi_1`; ..].
    pub total: Vec<usize>,
    /// Whether the kernel of each segment lies in the kernel of its A: where all
    /// do, the stripped matrix has the kernel of the total one (their theorem 1).
    pub kernel_rests: Vec<bool>,
    /// Which states, as they are at the beginning, the total matrix determines, after each
    /// segment.
    pub determined: Vec<Vec<bool>>,
    /// The kernel of the total matrix in physical units, for the state at the
    /// beginning.
    pub null_space: Vec<Vec<T>>,
}

impl<T: Real> Piecewise<T> {
    /// Analyses A (segments, n, n), C (segments, p, n) with a duration each.
    ///
    /// # Errors
    /// As [`Analysis::new`]; [`Error::Window`] where a transition leaves the range of
    /// the numbers, [`Error::Number`] where the null space does.
    pub fn new(
        a: &[T],
        c: &[T],
        durations: &[T],
        n: usize,
        rtol: Option<T>,
    ) -> Result<Self, Error> {
        let segments = durations.len();
        check_length("durations", segments, segments.max(1))?;
        check_finite("durations", durations)?;
        let p = c.len().checked_div(n.saturating_mul(segments)).unwrap_or(0);
        let forms = Analysis::of_segments(a, c, n, p, segments, rtol)?;
        let scale = forms[0].scale();
        // Directions of different segments are compared with the accuracy that
        // the worst determined of them has.
        let touch = forms.iter().fold(T::zero(), |touch, form| {
            touch.max(form.found().touch(form.rtol()))
        });
        let mut found = Self {
            alone: Vec::new(),
            stripped: Vec::new(),
            total: Vec::new(),
            kernel_rests: Vec::new(),
            determined: Vec::new(),
            null_space: Vec::new(),
        };
        let (mut stripped, mut total) = (Joined::new(n), Joined::new(n));
        // From the beginning to the beginning of the segment, balanced.
        let mut before: Option<Vec<T>> = None;
        for (j, form) in forms.iter().enumerate() {
            let a = &a[j * n * n..(j + 1) * n * n];
            let balanced: Vec<T> = (0..n * n)
                .map(|k| a[k] * scale[k % n] / scale[k / n])
                .collect();
            for row in form.row_space().chunks_exact(n) {
                stripped.push(row);
                match &before {
                    None => total.push(row),
                    Some(phi) => total.push(&through(row, phi)),
                }
            }
            found.alone.push(form.rank());
            found.stripped.push(stripped.rank(touch));
            let null = total.kernel(touch);
            found.total.push(n - null.len() / n);
            found.null_space = reduced_null_space(&null, scale, touch).0;
            found.determined.push(
                (0..n)
                    .map(|i| found.null_space.iter().all(|v| v[i] == T::zero()))
                    .collect(),
            );
            found.kernel_rests.push(form.kernel_rests(&balanced, touch));
            let step: Vec<T> = exponential(a, n, durations[j])?
                .iter()
                .enumerate()
                .map(|(k, &x)| x * scale[k % n] / scale[k / n])
                .collect();
            before = Some(match before {
                None => step,
                Some(phi) => step
                    .chunks_exact(n)
                    .flat_map(|row| through(row, &phi))
                    .collect(),
            });
            if !before.as_ref().is_some_and(|phi| all_finite(phi)) {
                return Err(Overflow.into());
            }
        }
        if found.null_space.iter().all(|vector| all_finite(vector)) {
            return Ok(found);
        }
        Err(NumberError::Overflow {
            result: "null space",
        }
        .into())
    }
}

impl<T: Real> Analysis<T> {
    fn kernel_rests(&self, a: &[T], touch: T) -> bool {
        let n = self.scale().len();
        let size = a
            .chunks_exact(n)
            .fold(T::zero(), |size, row| size.max(dot(row, row)));
        self.kernel().chunks_exact(n).all(|v| {
            a.chunks_exact(n)
                .all(|row| dot(row, v).abs() <= touch * size.sqrt())
        })
    }
}

/// row Phi
fn through<T: Real>(row: &[T], phi: &[T]) -> Vec<T> {
    let n = row.len();
    let mut out = vec![T::zero(); n];
    for (&factor, line) in row.iter().zip(phi.chunks_exact(n)) {
        super::scaling::add(&mut out, factor, line);
    }
    out
}

/// The triangular factor of directions joined so far.
struct Joined<T> {
    n: usize,
    factor: Vec<T>,
}

impl<T: Real> Joined<T> {
    fn new(n: usize) -> Self {
        Self {
            n,
            factor: vec![T::zero(); n * n],
        }
    }

    fn push(&mut self, row: &[T]) {
        let largest = row.iter().fold(T::zero(), |top, x| top.max(x.abs()));
        if !(T::one() / largest).is_finite() {
            // What a transition makes vanish says nothing.
            return;
        }
        let row: Vec<T> = row.iter().map(|&x| x / largest).collect();
        let norm = dot(&row, &row).sqrt();
        let mut row: Vec<T> = row.iter().map(|&x| x / norm).collect();
        rotate_in(&mut self.factor, &mut row);
    }

    fn decomposed(&self) -> (Vec<T>, Vec<T>) {
        let n = self.n;
        let (ones, mut values) = (vec![T::one(); n], vec![T::zero(); n]);
        let (mut vectors, mut work) = (vec![T::zero(); n * n], vec![T::zero(); n * n]);
        spectrum::decompose(&self.factor, n, &ones, &mut values, &mut vectors, &mut work);
        (values, vectors)
    }

    fn rank(&self, touch: T) -> usize {
        spectrum::rank(&self.decomposed().0, touch)
    }

    fn kernel(&self, touch: T) -> Vec<T> {
        let (values, mut vectors) = self.decomposed();
        vectors.split_off(spectrum::rank(&values, touch) * self.n)
    }
}
