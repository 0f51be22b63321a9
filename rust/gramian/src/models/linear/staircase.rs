//! The staircase form: kernels of `O_0`, `O_1`, .. one after the other.
//!
//! ker `O_k` is found as the part of ker `O_{k-1}` that A does not lead out of it,
//! by reflections of the states alone: after each step the first rank(`O_k`)
//! columns of the basis span the row space of `O_k`, the others its kernel. Powers
//! of A, whose entries leave the range of the numbers and whose rank drowns in
//! rounding, are never formed.
//!
//! # Source
//! Paige 1981, Properties of numerical algorithms related to computing
//! controllability, IEEE Trans. Automatic Control 26; Van Dooren 1981, The
//! generalized eigenstructure problem in linear system theory, ibid.

use super::scaling::add;
use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::Real;

/// A balanced system and the space for its staircase form.
#[derive(Debug)]
pub struct Staircase<'a, T> {
    /// Number of states.
    pub n: usize,
    /// Length of a row of every matrix here; entries from n on are zero.
    pub stride: usize,
    /// A, n rows.
    pub a: &'a [T],
    /// C, a row for each output.
    pub c: &'a [T],
    /// Receives the basis: n rows, each a direction in the balanced states, those
    /// of level 0 first.
    pub basis: &'a mut [T],
    /// Scratch, as many rows as there are states or outputs, whichever are more.
    pub rows: &'a mut [T],
}

/// How clear the decisions were: sizes relative to those of A and C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found<T> {
    /// The smallest coupling that counted.
    pub weakest: T,
    /// The largest that did not.
    pub rejected: T,
    /// The smallest that counted among the outputs themselves.
    pub first: T,
    /// A bound on how much the steps together magnify a relative error of A and C.
    pub growth: T,
    /// The length of the longest row of A.
    pub size: T,
}

impl<T: Real> Found<T> {
    /// A component of a basis vector below this is rounding.
    pub(crate) fn touch(&self, rtol: T) -> T {
        (T::of(4.0) * rtol / self.weakest).clamp(T::of(4.0) * T::EPSILON, T::of(1e-2))
    }

    /// Whether all couplings that counted exceed what rounding leaves in a balanced A of which
    /// `center` was taken: its entries are rounded as large as they came.
    #[cfg(feature = "alloc")]
    pub(crate) fn above_rounding_of(&self, center: T, n: usize) -> bool {
        let rounding = T::of(16.0 * n as f64) * T::EPSILON * center.abs();
        // Where nothing is left A was that multiple of the identity.
        self.weakest * self.size > rounding || self.size == T::zero() || rounding == T::zero()
    }

    /// Whether rounding, magnified, leaves the kernels of n states to three digits.
    pub(crate) fn reliable(&self, n: usize) -> bool {
        self.growth * T::of(4.0 * n as f64) * T::EPSILON <= T::of(1e-3)
    }
}

/// Couplings below this part of the norms of A and C count as zero: rounding,
/// in the entries and in n reflections, with room to spare.
pub fn default_rtol<T: Real>(n: usize) -> T {
    let room = if T::EPSILON.double() > 1e-10 {
        64.0
    } else {
        1024.0
    };
    T::EPSILON * T::of(room) * T::of(n.max(1) as f64).sqrt()
}

/// Takes the middle diagonal entry from the whole diagonal: the row spaces of
/// all `O_k` stay as they are, and a discrete system near the identity keeps its
/// digits. Differences that are rounding become zero, and so do couplings between two states
/// without such a difference, there and back, of which the product is rounding squared: a
/// multiple of the identity in other coordinates has no other. Returns what was taken.
#[inline(always)]
pub fn center<T: Real>(a: &mut [T], n: usize, stride: usize, sorted: &mut [T]) -> T {
    for i in 0..n {
        // Insertion: n is small.
        let (x, mut k) = (a[i * stride + i], i);
        while k > 0 && sorted[k - 1] > x {
            sorted[k] = sorted[k - 1];
            k -= 1;
        }
        sorted[k] = x;
    }
    let middle = sorted[n / 2];
    for i in 0..n {
        let x = &mut a[i * stride + i];
        let rounding = T::of(4.0) * T::EPSILON * x.abs().max(middle.abs());
        let centered = *x - middle;
        *x = if centered.abs() <= rounding {
            T::zero()
        } else {
            centered
        };
    }
    let rounding = T::of(2.0 * n as f64) * T::EPSILON * middle;
    let rounding = rounding * rounding;
    for i in 0..n {
        if a[i * stride + i] != T::zero() {
            continue;
        }
        for j in 0..i {
            let product = a[i * stride + j] * a[j * stride + i];
            if product.abs() <= rounding && product != T::zero() && a[j * stride + j] == T::zero() {
                a[i * stride + j] = T::zero();
                a[j * stride + i] = T::zero();
            }
        }
    }
    middle
}

impl<T: Real> Staircase<'_, T> {
    /// Reduces the system. `ranks[k]` becomes the rank of `O_k`; `v` and `w` are
    /// scratch of a row each.
    #[inline(always)]
    pub fn reduce(self, rtol: T, v: &mut [T], w: &mut [T], ranks: &mut [usize]) -> Found<T> {
        let Self {
            n,
            stride,
            a,
            c,
            basis,
            rows,
        } = self;
        let zero = T::zero();
        basis.fill(zero);
        for i in 0..n {
            basis[i * stride + i] = T::one();
        }
        let largest_row = a
            .chunks_exact(stride)
            .fold(zero, |size, row| size.max(dot(row, row)));
        let size = largest_row.sqrt();
        let per_size = if size > zero { T::one() / size } else { zero };
        let mut found = Found {
            weakest: T::one(),
            rejected: zero,
            first: T::one(),
            growth: T::one(),
            size,
        };
        let (mut first, mut rank) = (0, 0);
        // What is left open in the kernel after each step by an error of one: a bound.
        let mut open = zero;
        for step in 0..ranks.len() {
            // What this step can add, in coordinates of the basis: the outputs;
            // then what A makes of the directions that the step before added.
            let start = rank;
            let count = if step == 0 {
                for (row, c) in rows.chunks_exact_mut(stride).zip(c.chunks_exact(stride)) {
                    let norm = dot(c, c).sqrt();
                    let factor = if norm > zero { T::one() / norm } else { zero };
                    for (x, &c) in row.iter_mut().zip(c) {
                        *x = factor * c;
                    }
                }
                c.len() / stride
            } else {
                for (k, row) in rows
                    .chunks_exact_mut(stride)
                    .enumerate()
                    .take(start - first)
                {
                    let direction = &basis[(first + k) * stride..(first + k + 1) * stride];
                    combine(w, &direction.iter().map(|&x| x * per_size), a);
                    row.fill(zero);
                    for j in start..n {
                        row[j] = dot(w, &basis[j * stride..(j + 1) * stride]);
                    }
                }
                start - first
            };
            let left = &mut rows[..count * stride];
            let mut smallest = T::one();
            while rank < n {
                let (mut best, mut largest) = (0, zero);
                for (i, row) in left.chunks_exact(stride).enumerate() {
                    let squared = dot(row, row);
                    if squared > largest {
                        (best, largest) = (i, squared);
                    }
                }
                let largest = largest.sqrt();
                if !(largest > rtol) {
                    found.rejected = found.rejected.max(largest);
                    break;
                }
                smallest = smallest.min(largest);
                reflector(&left[best * stride..(best + 1) * stride], rank, v);
                for row in left.chunks_exact_mut(stride) {
                    let along = dot(row, v);
                    add(row, -along, v);
                    // The part along the new direction is determined now.
                    row[rank] = zero;
                }
                left[best * stride..(best + 1) * stride].fill(zero);
                reflect_rows(basis, stride, rank, v, w);
                rank += 1;
            }
            found.weakest = found.weakest.min(smallest);
            if step == 0 {
                found.first = smallest;
            }
            if rank > start {
                open += (T::one() + open + open) / smallest;
                found.growth = open;
            }
            ranks[step] = rank;
            if rank == start || rank == n {
                ranks[step..].fill(rank);
                break;
            }
            first = start;
        }
        found
    }
}

/// v with |v|^2 = 2 such that (I - v v^T) takes the row, which is zero before
/// entry `from`, to a multiple of that axis.
#[inline(always)]
fn reflector<T: Real>(row: &[T], from: usize, v: &mut [T]) {
    let norm = dot(row, row).sqrt();
    let lead = row[from];
    // |row +- norm axis|^2 = 2 norm (norm + |lead|)
    let factor = T::one() / (norm * (norm + lead.abs())).sqrt();
    for (v, &x) in v.iter_mut().zip(row) {
        *v = factor * x;
    }
    v[from] += factor * if lead < T::zero() { -norm } else { norm };
}

/// The sum of the rows of a matrix, each times its factor. A part of all rows at a time, so
/// that the sum stays in registers.
#[inline(always)]
fn combine<T: Real>(sum: &mut [T], factors: &(impl Iterator<Item = T> + Clone), rows: &[T]) {
    let stride = sum.len();
    let whole = stride / 8 * 8;
    for first in (0..whole).step_by(8) {
        let mut part = [T::zero(); 8];
        for (factor, row) in factors.clone().zip(rows.chunks_exact(stride)) {
            let Some(row) = row[first..].first_chunk::<8>() else {
                break;
            };
            for k in 0..8 {
                part[k] += factor * row[k];
            }
        }
        sum[first..first + 8].copy_from_slice(&part);
    }
    for k in whole..stride {
        let mut total = T::zero();
        for (factor, row) in factors.clone().zip(rows.chunks_exact(stride)) {
            total += factor * row[k];
        }
        sum[k] = total;
    }
}

/// (I - v v^T) X, with v zero before `from`.
#[inline(always)]
fn reflect_rows<T: Real>(x: &mut [T], stride: usize, from: usize, v: &[T], w: &mut [T]) {
    combine(w, &v[from..].iter().copied(), &x[from * stride..]);
    for (row, &factor) in x.chunks_exact_mut(stride).zip(v).skip(from) {
        add(row, -factor, w);
    }
}

/// Hands the level of each state to `found`: the first k from which on no
/// direction of the kernel of `O_k` contains it.
#[inline(always)]
pub fn state_levels<T: Real>(
    basis: &[T],
    n: usize,
    stride: usize,
    ranks: &[usize],
    touch: T,
    mut found: impl FnMut(usize, Option<usize>),
) {
    for i in 0..n {
        let mut left = T::zero();
        let mut needed = n;
        // Directions from the last on, until the state has a part in one.
        while needed > 0 {
            let x = basis[(needed - 1) * stride + i];
            left += x * x;
            if left > touch * touch {
                break;
            }
            needed -= 1;
        }
        found(i, ranks.iter().position(|&rank| rank >= needed));
    }
}
