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
        let (mut stripped, mut hidden) = (Joined::new(n), Hidden::all(n));
        for (j, form) in forms.iter().enumerate() {
            let a = &a[j * n * n..(j + 1) * n * n];
            let balanced: Vec<T> = (0..n * n)
                .map(|k| a[k] * scale[k % n] / scale[k / n])
                .collect();
            for row in form.row_space().chunks_exact(n) {
                stripped.push(row);
            }
            found.alone.push(form.rank());
            found.stripped.push(stripped.rank(touch));
            hidden.keep_what_is_not_in(form.row_space(), touch);
            found.total.push(n - hidden.here.len() / n);
            found.null_space = reduced_null_space(&hidden.at_beginning(), scale, touch).0;
            found.determined.push(
                (0..n)
                    .map(|i| found.null_space.iter().all(|v| v[i] == T::zero()))
                    .collect(),
            );
            found.kernel_rests.push(form.kernel_rests(&balanced, touch));
            if j + 1 == segments || hidden.here.is_empty() {
                continue;
            }
            // So short that no step stretches one direction out of sight of another.
            let size = dot(&balanced, &balanced).sqrt();
            let parts = (size * durations[j] / T::of(4.0)).ceil();
            let parts = parts.max(T::one()).min(T::of(4096.0));
            let step: Vec<T> = exponential(a, n, durations[j] / parts)?
                .iter()
                .enumerate()
                .map(|(k, &x)| x * scale[k % n] / scale[k / n])
                .collect();
            if !all_finite(&step) {
                return Err(Overflow.into());
            }
            let mut done = T::zero();
            while done < parts {
                hidden.carry(&step);
                done += T::one();
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

/// What no segment so far has seen. It is carried from segment to segment as orthonormal
/// directions: what a segment sees is compared with them by angles, however much a transition
/// stretches. Rows of all segments, each stretched back to the beginning, would look alike, and
/// what tells them apart would count as rounding.
struct Hidden<T> {
    n: usize,
    /// Orthonormal rows: at the beginning of the segment.
    here: Vec<T>,
    /// The same combinations at the beginning of all.
    first: Vec<T>,
}

impl<T: Real> Hidden<T> {
    fn all(n: usize) -> Self {
        let mut here = vec![T::zero(); n * n];
        for i in 0..n {
            here[i * n + i] = T::one();
        }
        let first = here.clone();
        Self { n, here, first }
    }

    /// Leaves what orthonormal rows do not see, but for the sine of an angle of `touch`.
    fn keep_what_is_not_in(&mut self, rows: &[T], touch: T) {
        let n = self.n;
        let m = self.here.len() / n;
        if m == 0 {
            return;
        }
        let mut seen = Joined::new(m);
        for row in rows.chunks_exact(n) {
            let mut along: Vec<T> = self.here.chunks_exact(n).map(|v| dot(v, row)).collect();
            rotate_in(&mut seen.factor, &mut along);
        }
        let (sines, mut vectors) = seen.decomposed();
        let rank = sines.iter().take_while(|&&sine| sine > touch).count();
        let kept = vectors.split_off(rank * m);
        self.here = combined(&kept, &self.here, n);
        self.first = combined(&kept, &self.first, n);
    }

    /// To the beginning of the next segment.
    fn carry(&mut self, phi: &[T]) {
        let n = self.n;
        self.here = self
            .here
            .chunks_exact(n)
            .flat_map(|v| phi.chunks_exact(n).map(move |line| dot(line, v)))
            .collect();
        orthonormalize(&mut self.here, n, Some(&mut self.first));
        // Alone the directions count, not how much they were stretched.
        let largest = self.first.iter().fold(T::zero(), |top, x| top.max(x.abs()));
        let factor = T::one() / largest;
        if factor.is_finite() {
            scale_row(&mut self.first, factor);
        }
    }

    fn at_beginning(&self) -> Vec<T> {
        let mut rows = self.first.clone();
        orthonormalize(&mut rows, self.n, None);
        rows
    }
}

/// Rows of `factors` (k x m) times `rows` (m x n).
fn combined<T: Real>(factors: &[T], rows: &[T], n: usize) -> Vec<T> {
    let m = rows.len() / n;
    let mut out = vec![T::zero(); factors.len() / m.max(1) * n];
    for (out, line) in out.chunks_exact_mut(n).zip(factors.chunks_exact(m.max(1))) {
        for (&factor, row) in line.iter().zip(rows.chunks_exact(n)) {
            super::scaling::add(out, factor, row);
        }
    }
    out
}

/// Makes independent rows orthonormal; the same is done to the rows of `beside`. Each time the
/// longest of those that are left is next.
fn orthonormalize<T: Real>(rows: &mut [T], n: usize, mut beside: Option<&mut Vec<T>>) {
    let count = rows.len() / n.max(1);
    for i in 0..count {
        // With entries up to 1 no square overflows.
        let row = &mut rows[i * n..(i + 1) * n];
        let largest = row.iter().fold(T::zero(), |top, x| top.max(x.abs()));
        let factor = T::one() / largest;
        if factor.is_finite() {
            scale_row(row, factor);
            if let Some(beside) = beside.as_deref_mut() {
                scale_row(&mut beside[i * n..(i + 1) * n], factor);
            }
        }
    }
    for k in 0..count {
        let length = |row: &[T]| dot(row, row);
        let longest = (k..count).fold(k, |best, i| {
            let (a, b) = (&rows[i * n..(i + 1) * n], &rows[best * n..(best + 1) * n]);
            if length(a) > length(b) { i } else { best }
        });
        swap_rows(rows, n, k, longest);
        if let Some(beside) = beside.as_deref_mut() {
            swap_rows(beside, n, k, longest);
        }
        let norm = length(&rows[k * n..(k + 1) * n]).sqrt();
        let factor = T::one() / norm;
        if !factor.is_finite() {
            continue;
        }
        scale_row(&mut rows[k * n..(k + 1) * n], factor);
        if let Some(beside) = beside.as_deref_mut() {
            scale_row(&mut beside[k * n..(k + 1) * n], factor);
        }
        let (done, left) = rows.split_at_mut((k + 1) * n);
        let done = &done[k * n..];
        // Twice: once leaves what rounding left of the first.
        for _ in 0..2 {
            for (i, row) in left.chunks_exact_mut(n).enumerate() {
                let along = dot(row, done);
                super::scaling::add(row, -along, done);
                if let Some(beside) = beside.as_deref_mut() {
                    let (done, left) = beside.split_at_mut((k + 1) * n);
                    super::scaling::add(&mut left[i * n..(i + 1) * n], -along, &done[k * n..]);
                }
            }
        }
    }
}

fn scale_row<T: Real>(row: &mut [T], factor: T) {
    for x in row {
        *x *= factor;
    }
}

fn swap_rows<T: Real>(rows: &mut [T], n: usize, i: usize, j: usize) {
    if i != j {
        let (low, high) = (i.min(j), i.max(j));
        let (before, after) = rows.split_at_mut(high * n);
        before[low * n..(low + 1) * n].swap_with_slice(&mut after[..n]);
    }
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
}
