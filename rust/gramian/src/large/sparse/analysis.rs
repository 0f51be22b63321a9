//! The whole answer for sparse rows.

use alloc::vec;
use alloc::vec::Vec;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, Par};

use super::factor::Factor;
use super::null_space::{self, Component, Scaled};
use super::structure::{NONE, Structure};
use super::symbolic::Symbolic;
use super::{Index, Rows, SparseError, Stop, selected_inverse};

/// How far below the norm of the unit-column rows the added identity is.
const MU: f64 = 1e-13;

/// Rank, null space and bounds of sparse rows.
///
/// ```
/// use gramian::large::sparse::{Rows, Sparse};
/// // Two differences of three heights: the level of all is not determined.
/// let rows = Rows::new(3, &[0usize, 2, 4], &[0, 1, 1, 2], &[-1.0, 1.0, -1.0, 1.0])?;
/// let answer = Sparse::new(&rows, None, usize::MAX, &mut || false)?;
/// assert_eq!(answer.nullity(), 1);
/// let std = answer.crlb_std(&mut || false)?;
/// assert!(std.iter().all(|s| s.is_infinite()));
/// // The difference of the outer two is.
/// let variance = answer.variance(&[(0, -1.0), (2, 1.0)])?;
/// assert!((variance - 2.0).abs() < 1e-14);
/// # Ok::<(), gramian::large::sparse::SparseError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Sparse {
    structure: Structure,
    /// What makes each column of unit length.
    scale: Vec<f64>,
    norm: f64,
    rtol: f64,
    components: Vec<Component>,
    /// With one row more for each null vector, at the states in `pins`: of full rank.
    factor: Factor,
    pins: Vec<usize>,
    log_det: f64,
}

impl Sparse {
    /// Analyses rows. `rtol` is the relative rank tolerance on the singular values of the
    /// rows with unit columns, by default that of dense problems; `available` the memory
    /// that may be taken, in bytes.
    ///
    /// # Errors
    /// [`SparseError`].
    pub fn new<I: Index>(
        rows: &Rows<'_, I>,
        rtol: Option<f64>,
        available: usize,
        stop: &mut Stop<'_>,
    ) -> Result<Self, SparseError> {
        let scale = rows
            .norms()?
            .into_iter()
            .map(|norm| if norm > 0.0 { 1.0 / norm } else { 1.0 })
            .collect();
        Self::of_scaled(rows, scale, rtol, available, stop)
    }

    /// The same with all columns divided by one number, which should be the largest norm
    /// of a column: singular values are then those of the rows as they are, over `unit`.
    ///
    /// # Errors
    /// [`SparseError`].
    pub fn with_unit<I: Index>(
        rows: &Rows<'_, I>,
        unit: f64,
        rtol: Option<f64>,
        available: usize,
        stop: &mut Stop<'_>,
    ) -> Result<Self, SparseError> {
        rows.norms()?;
        let scale = vec![1.0 / unit; rows.columns()];
        Self::of_scaled(rows, scale, rtol, available, stop)
    }

    fn of_scaled<I: Index>(
        rows: &Rows<'_, I>,
        scale: Vec<f64>,
        rtol: Option<f64>,
        available: usize,
        stop: &mut Stop<'_>,
    ) -> Result<Self, SparseError> {
        let n = rows.columns();
        let structure = Structure::new(rows);
        let symbolic = Symbolic::new(rows, available, stop)?;
        let place = symbolic.place.clone();
        let matrix = Scaled::new(rows, &scale, &place);
        let norm = matrix.norm().max(1.0);
        let rtol = rtol.unwrap_or_else(|| crate::spectrum::default_rtol(rows.len(), n));
        let mut ranges: Vec<(usize, usize)> = Vec::new();
        for (p, &j) in symbolic.order.iter().enumerate() {
            let same =
                p > 0 && structure.component[symbolic.order[p - 1]] == structure.component[j];
            match ranges.last_mut() {
                Some(last) if same => last.1 = p + 1,
                _ => ranges.push((p, p + 1)),
            }
        }
        let mut factor = Factor::new(rows, &scale, MU * norm, symbolic, available, stop)?;
        let components = null_space::smallest(&matrix, &factor, &ranges, rtol * norm, stop)?;
        let nullity: usize = components.iter().map(|c| c.nullity).sum();
        let log_det = if nullity > 0 {
            f64::NEG_INFINITY
        } else {
            2.0 * (factor.diagonal().map(|r| r.abs().ln()).sum::<f64>()
                - scale.iter().map(|s| s.ln()).sum::<f64>())
        };
        let mut pins = Vec::new();
        for component in components.iter().filter(|c| c.nullity > 0) {
            for p in pivots(component) {
                factor.add_row(&[(component.begin + p, 1.0)]);
                pins.push(component.begin + p);
            }
        }
        Ok(Self {
            structure,
            scale,
            norm,
            rtol,
            components,
            factor,
            pins,
            log_det,
        })
    }

    /// What the pattern alone decides.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        self.scale.len()
    }

    /// How many independent combinations the rows do not determine.
    pub fn nullity(&self) -> usize {
        self.components.iter().map(|c| c.nullity).sum()
    }

    /// The rank.
    pub fn rank(&self) -> usize {
        self.states() - self.nullity()
    }

    /// The largest singular value of the rows with unit columns, from below, within a
    /// per cent or so.
    pub fn norm(&self) -> f64 {
        self.norm
    }

    /// The relative tolerance that decided the rank.
    pub fn rtol(&self) -> f64 {
        self.rtol
    }

    /// Log determinant of the information, `-inf` where the rank is short.
    pub fn log_det(&self) -> f64 {
        self.log_det
    }

    /// The ends of the spectra of the components, each by places of the elimination
    /// order, whose columns [`order`](Self::order) gives.
    pub fn components(&self) -> &[Component] {
        &self.components
    }

    /// The column at each place of the elimination order.
    pub fn order(&self) -> &[usize] {
        &self.factor.symbolic.order
    }

    /// What makes each column of unit length: x in units of the caller is scale times x
    /// in scaled units.
    pub fn scale(&self) -> &[f64] {
        &self.scale
    }

    /// Entries of the factor.
    pub fn factor_entries(&self) -> usize {
        self.factor.symbolic.entries()
    }

    /// Bytes at the peak of the factorisation.
    pub fn peak_bytes(&self) -> usize {
        self.factor.symbolic.peak()
    }

    /// The smallest singular value that counts, on unit columns; infinite where there is
    /// none.
    pub fn smallest_counting(&self) -> f64 {
        let limit = self.rtol * self.norm;
        self.components
            .iter()
            .flat_map(|c| c.values.iter().copied().filter(|&v| v > limit))
            .fold(f64::INFINITY, f64::min)
    }

    /// The largest singular value that does not count; 0 where there is none.
    pub fn largest_dropped(&self) -> f64 {
        self.components
            .iter()
            .flat_map(|c| c.values[..c.nullity].iter().copied())
            .fold(0.0, f64::max)
    }

    /// Bound on the standard deviation of every state; infinite for those that a null
    /// vector moves.
    ///
    /// # Errors
    /// [`SparseError::Interrupted`].
    pub fn crlb_std(&self, stop: &mut Stop<'_>) -> Result<Vec<f64>, SparseError> {
        let variance = selected_inverse::diagonal(&self.factor, stop)?;
        let touched = self.touched();
        let mut std = vec![f64::INFINITY; self.states()];
        for (p, &j) in self.order().iter().enumerate() {
            if !touched[p] {
                std[j] = variance[p].sqrt() * self.scale[j];
            }
        }
        Ok(std)
    }

    /// By place: whether a null vector moves the state there.
    fn touched(&self) -> Vec<bool> {
        let mut touched = vec![false; self.states()];
        for c in self.components.iter().filter(|c| c.nullity > 0) {
            let threshold = self.threshold(c);
            for (p, line) in c.vectors.chunks_exact(c.values.len()).enumerate() {
                let square: f64 = line[..c.nullity].iter().map(|x| x * x).sum();
                touched[c.begin + p] = square.sqrt() > threshold;
            }
        }
        touched
    }

    /// Below this a part of a null vector is rounding: its error is that of the rows over
    /// the gap.
    fn threshold(&self, component: &Component) -> f64 {
        let first = component
            .values
            .get(component.nullity)
            .copied()
            .unwrap_or(self.norm)
            .min(self.norm);
        (10.0 * self.rtol * self.norm / first).min(1e-3)
    }

    fn scaled(&self, combination: &[(usize, f64)]) -> Result<Vec<(usize, f64)>, SparseError> {
        combination
            .iter()
            .map(|&(j, value)| {
                if j >= self.states() {
                    return Err(SparseError::Column {
                        row: 0,
                        column: j as i128,
                        columns: self.states(),
                    });
                }
                if !value.is_finite() {
                    return Err(SparseError::NotFinite {
                        row: 0,
                        column: j,
                        given: value,
                    });
                }
                Ok((self.factor.symbolic.place[j], value * self.scale[j]))
            })
            .collect()
    }

    /// How far a combination (columns and coefficients) moves along each null vector,
    /// over its own length: zero but for rounding iff it is determined.
    fn gains(&self, scaled: &[(usize, f64)]) -> f64 {
        let length = scaled.iter().map(|(_, c)| c * c).sum::<f64>().sqrt();
        if length == 0.0 {
            return 0.0;
        }
        let mut worst: f64 = 0.0;
        for c in self.components.iter().filter(|c| c.nullity > 0) {
            let width = c.values.len();
            let mut product = vec![0.0; c.nullity];
            let mut part = 0.0;
            for &(p, value) in scaled.iter().filter(|(p, _)| (c.begin..c.end).contains(p)) {
                part += value * value;
                let line = &c.vectors[(p - c.begin) * width..][..c.nullity];
                for (sum, x) in product.iter_mut().zip(line) {
                    *sum += value * x;
                }
            }
            if part > 0.0 {
                let moved = product.iter().map(|x| x * x).sum::<f64>().sqrt() / length;
                worst = worst.max(moved / self.threshold(c));
            }
        }
        worst
    }

    /// Variance at the bound of a combination (columns and coefficients, units of the
    /// caller); infinite where it is not determined.
    ///
    /// # Errors
    /// [`SparseError::Column`], [`SparseError::NotFinite`].
    pub fn variance(&self, combination: &[(usize, f64)]) -> Result<f64, SparseError> {
        let mut work = vec![0.0; self.states()];
        self.variance_with(combination, &mut work)
    }

    /// The same for many: `work` holds a zero for each state, before and after.
    ///
    /// # Errors
    /// As [`variance`](Self::variance).
    pub fn variance_with(
        &self,
        combination: &[(usize, f64)],
        work: &mut [f64],
    ) -> Result<f64, SparseError> {
        let scaled = self.scaled(combination)?;
        if self.gains(&scaled) > 1.0 {
            return Ok(f64::INFINITY);
        }
        let mut sum = 0.0;
        self.factor
            .reach(&scaled, work, |_, value| sum += value * value);
        Ok(sum)
    }

    /// Covariance at the bound of several combinations, row-major, on the quotient by
    /// what is not determined: only entries between determined combinations mean
    /// something.
    ///
    /// # Errors
    /// As [`variance`](Self::variance).
    pub fn covariance(&self, combinations: &[Vec<(usize, f64)>]) -> Result<Vec<f64>, SparseError> {
        let mut work = vec![0.0; self.states()];
        let count = combinations.len();
        let mut columns: Vec<Vec<(usize, f64)>> = Vec::with_capacity(count);
        let mut free = vec![false; count];
        for (k, combination) in combinations.iter().enumerate() {
            let scaled = self.scaled(combination)?;
            free[k] = self.gains(&scaled) > 1.0;
            let mut column = Vec::new();
            self.factor.reach(&scaled, &mut work, |p, value| {
                if value != 0.0 {
                    column.push((p, value));
                }
            });
            columns.push(column);
        }
        let mut answer = vec![f64::INFINITY; count * count];
        for a in 0..count {
            for &(p, value) in &columns[a] {
                work[p] = value;
            }
            for b in 0..count {
                let product: f64 = columns[b].iter().map(|&(p, value)| value * work[p]).sum();
                if free[a] || free[b] {
                    answer[a * count + b] = if a == b { f64::INFINITY } else { f64::NAN };
                } else {
                    answer[a * count + b] = product;
                }
            }
            for &(p, _) in &columns[a] {
                work[p] = 0.0;
            }
        }
        Ok(answer)
    }

    /// What rows see of each other: F S F^T (row-major) with the covariance S at the bound,
    /// and F S W S F^T with weights of states (columns and weights) where they are given.
    /// Both are on the quotient by what is not determined.
    ///
    /// # Errors
    /// As [`variance`](Self::variance); [`SparseError::Size`], [`SparseError::Interrupted`].
    pub fn gram(
        &self,
        rows: &[Vec<(usize, f64)>],
        weights: Option<&[(usize, f64)]>,
        available: usize,
        stop: &mut Stop<'_>,
    ) -> Result<(Vec<f64>, Option<Vec<f64>>), SparseError> {
        const BLOCK: usize = 24;
        let (n, count) = (self.states(), rows.len());
        let kept = weights.map_or(0, <[_]>::len);
        let needed = (n.saturating_mul(BLOCK))
            .saturating_add(count.saturating_mul(kept))
            .saturating_add(count.saturating_mul(3).saturating_mul(count))
            .saturating_mul(8);
        if needed > available {
            return Err(SparseError::Size {
                what: "the covariance of all rows",
                needed,
                available,
            });
        }
        let scaled = rows
            .iter()
            .map(|row| self.scaled(row))
            .collect::<Result<Vec<_>, _>>()?;
        let weighted = weights.map(|w| self.scaled(w)).transpose()?;
        let mut c = vec![0.0; count * count];
        let mut moved = Mat::<f64>::zeros(kept, count);
        for first in (0..count).step_by(BLOCK) {
            let width = BLOCK.min(count - first);
            let mut x = vec![0.0; n * width];
            for (k, row) in scaled[first..first + width].iter().enumerate() {
                for &(p, value) in row {
                    x[p * width + k] += value;
                }
            }
            self.factor.solve_transposed(&mut x, width, stop)?;
            self.factor.solve(&mut x, width, stop)?;
            for (i, row) in scaled.iter().enumerate() {
                for &(p, value) in row {
                    for k in 0..width {
                        c[i * count + first + k] += value * x[p * width + k];
                    }
                }
            }
            // In units of the caller, each times the root of its weight.
            for (w, (&(j, weight), &(p, _))) in weights
                .iter()
                .flat_map(|w| w.iter())
                .zip(weighted.iter().flatten())
                .enumerate()
            {
                let factor = weight.sqrt() * self.scale[j];
                for k in 0..width {
                    moved[(w, first + k)] = factor * x[p * width + k];
                }
            }
        }
        for i in 0..count {
            for k in 0..i {
                let mean = f64::midpoint(c[i * count + k], c[k * count + i]);
                (c[i * count + k], c[k * count + i]) = (mean, mean);
            }
        }
        let g = weights.map(|_| {
            let mut g = vec![0.0; count * count];
            matmul(
                MatMut::from_row_major_slice_mut(&mut g, count, count),
                Accum::Replace,
                moved.transpose(),
                moved.as_ref(),
                1.0,
                Par::Seq,
            );
            g
        });
        Ok((c, g))
    }

    /// How much rank each group of rows would add, each row by columns and values; and
    /// what it would add to half the log determinant of what is determined already
    /// (nats; the rows' part along null vectors apart).
    ///
    /// # Errors
    /// As [`variance`](Self::variance).
    pub fn rank_gain(&self, rows: &[Vec<(usize, f64)>]) -> Result<usize, SparseError> {
        let mut lines: Vec<Vec<f64>> = Vec::new();
        for row in rows {
            let scaled = self.scaled(row)?;
            let length = scaled.iter().map(|(_, c)| c * c).sum::<f64>().sqrt();
            if length == 0.0 {
                continue;
            }
            let mut line = Vec::new();
            for c in self.components.iter().filter(|c| c.nullity > 0) {
                let width = c.values.len();
                let threshold = self.threshold(c);
                let mut product = vec![0.0; c.nullity];
                for &(p, value) in scaled.iter().filter(|(p, _)| (c.begin..c.end).contains(p)) {
                    let from = &c.vectors[(p - c.begin) * width..][..c.nullity];
                    for (sum, x) in product.iter_mut().zip(from) {
                        *sum += value / length * x / threshold;
                    }
                }
                line.extend(product);
            }
            lines.push(line);
        }
        Ok(count_independent(lines))
    }

    /// The weakest directions above the gap: singular value and vector (units of the
    /// caller, unit length in scaled ones), ascending over all components.
    pub fn weakest(&self, count: usize) -> Vec<(f64, usize, usize)> {
        let mut list: Vec<(f64, usize, usize)> = Vec::new();
        for (c, component) in self.components.iter().enumerate() {
            for k in component.nullity..component.values.len() {
                list.push((component.values[k], c, k));
            }
        }
        list.sort_by(|a, b| a.0.total_cmp(&b.0));
        list.truncate(count);
        list
    }

    /// Places that the gauge was fixed at to compute bounds.
    pub fn pins(&self) -> &[usize] {
        &self.pins
    }
}

/// How far below the norm the added identity is where columns are eliminated: it decides
/// between what a nuisance state takes and what is left, and so must be well above
/// rounding.
const MU_ELIMINATION: f64 = 1e-11;

/// Rows in a form of their own.
#[derive(Clone, Debug, Default)]
pub struct OwnedRows {
    /// Where each row starts, and the end.
    pub start: Vec<i64>,
    /// Columns.
    pub column: Vec<i64>,
    /// Values.
    pub value: Vec<f64>,
}

/// The rows that are left for the other columns where those in `eliminated` are not known
/// at all: the information in them is the Schur complement. Columns keep their numbers.
/// What is left below about 1e-9 of a column is rounding.
///
/// # Errors
/// [`SparseError`].
pub fn marginal_rows<I: Index>(
    rows: &Rows<'_, I>,
    eliminated: &[bool],
    available: usize,
    stop: &mut Stop<'_>,
) -> Result<OwnedRows, SparseError> {
    if eliminated.len() != rows.columns() {
        return Err(SparseError::Length {
            array: "eliminated",
            given: eliminated.len(),
            wanted: rows.columns(),
        });
    }
    let scale: Vec<f64> = rows
        .norms()?
        .into_iter()
        .map(|norm| if norm > 0.0 { 1.0 / norm } else { 1.0 })
        .collect();
    let symbolic = Symbolic::eliminating(rows, eliminated, available, stop)?;
    let place = symbolic.place.clone();
    let norm = Scaled::new(rows, &scale, &place).norm().max(1.0);
    let mu = MU_ELIMINATION * norm;
    let factor = Factor::new(rows, &scale, mu, symbolic, available, stop)?;
    let symbolic = &factor.symbolic;
    let mut square = vec![0.0; rows.columns()];
    let mut lines: Vec<Vec<(usize, f64)>> = Vec::new();
    for s in 0..symbolic.fronts() {
        let (own, wide) = symbolic.size(s);
        let values = factor.rows(s);
        let at = |q: usize| {
            let p = if q < own {
                symbolic.begin[s] + q
            } else {
                symbolic.later(s)[q - own]
            };
            symbolic.order[p]
        };
        for k in (0..own).filter(|&k| !eliminated[at(k)]) {
            let mut line: Vec<(usize, f64)> = (k..wide)
                .map(|q| (at(q), values[(k, q)]))
                .filter(|(_, value)| value.abs() > 1e-3 * mu)
                .collect();
            line.sort_unstable_by_key(|(j, _)| *j);
            for &(j, value) in &line {
                square[j] += value * value;
            }
            lines.push(line);
        }
    }
    let mut left = OwnedRows::default();
    left.start.push(0);
    for line in lines {
        // A column of which only the added identity is left has no information.
        for (j, value) in line
            .into_iter()
            .filter(|(j, _)| square[*j].sqrt() > 100.0 * mu)
        {
            left.column.push(i64::try_from(j).unwrap_or(i64::MAX));
            left.value.push(value / scale[j]);
        }
        left.start
            .push(i64::try_from(left.value.len()).unwrap_or(i64::MAX));
    }
    Ok(left)
}

/// So many of the vectors, in units of their threshold, are independent: by pivoted
/// Gram-Schmidt.
fn count_independent(mut lines: Vec<Vec<f64>>) -> usize {
    let mut count = 0;
    loop {
        let lengths: Vec<f64> = lines
            .iter()
            .map(|l| l.iter().map(|x| x * x).sum::<f64>().sqrt())
            .collect();
        let best = (0..lines.len()).max_by(|&a, &b| lengths[a].total_cmp(&lengths[b]));
        let Some(best) = best.filter(|&b| lengths[b] > 1.0) else {
            return count;
        };
        count += 1;
        let pivot: Vec<f64> = lines.swap_remove(best);
        let length = lengths[best];
        for line in &mut lines {
            let product: f64 =
                line.iter().zip(&pivot).map(|(a, b)| a * b).sum::<f64>() / (length * length);
            for (x, p) in line.iter_mut().zip(&pivot) {
                *x -= product * p;
            }
        }
    }
}

/// Places of a component, as many as its nullity, at which the null vectors differ most:
/// knowing the states there determines everything. By row-pivoted elimination.
pub(super) fn pivots(component: &Component) -> Vec<usize> {
    let width = component.values.len();
    let k = component.nullity;
    let mut lines: Vec<f64> = component
        .vectors
        .chunks_exact(width.max(1))
        .flat_map(|line| line[..k].iter().copied())
        .collect();
    let mut chosen = Vec::with_capacity(k);
    for _ in 0..k {
        let best = (0..component.len())
            .map(|p| {
                let line = &lines[p * k..(p + 1) * k];
                (p, line.iter().map(|x| x * x).sum::<f64>())
            })
            .fold((NONE, 0.0), |a, b| if b.1 > a.1 { b } else { a });
        let (p, square) = best;
        if p == NONE {
            break;
        }
        chosen.push(p);
        let pivot = lines[p * k..(p + 1) * k].to_vec();
        for line in lines.chunks_exact_mut(k) {
            let product: f64 = line.iter().zip(&pivot).map(|(a, b)| a * b).sum::<f64>() / square;
            for (x, p) in line.iter_mut().zip(&pivot) {
                *x -= product * p;
            }
        }
    }
    chosen
}

#[cfg(test)]
#[allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap
)]
mod tests {
    use super::*;
    use crate::observability::Observability;

    /// Random rows of `columns` states in a chain, each touching a few neighbours; the
    /// seed decides everything.
    struct Chain {
        start: Vec<usize>,
        column: Vec<usize>,
        value: Vec<f64>,
        columns: usize,
    }

    impl Chain {
        fn new(columns: usize, reach: usize, sum_zero: bool, seed: u64) -> Self {
            let mut state = seed;
            let mut next = || {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                (state >> 33) as usize
            };
            let (mut start, mut column, mut value) = (vec![0], Vec::new(), Vec::new());
            for j in 0..columns - 1 {
                for _ in 0..2 {
                    let mut touched = vec![j, (j + 1 + next() % reach).min(columns - 1)];
                    touched.push((touched[1] + next() % reach).min(columns - 1));
                    touched.dedup();
                    let mut line: Vec<f64> = touched
                        .iter()
                        .map(|_| (next() % 1000) as f64 / 300.0 + 0.1)
                        .collect();
                    if sum_zero {
                        let rest: f64 = line[1..].iter().sum();
                        line[0] = -rest;
                    }
                    column.extend(touched);
                    value.extend(line);
                    start.push(column.len());
                }
            }
            Self {
                start,
                column,
                value,
                columns,
            }
        }

        fn rows(&self) -> Rows<'_, usize> {
            Rows::new(self.columns, &self.start, &self.column, &self.value).unwrap()
        }

        fn dense(&self) -> Vec<f64> {
            let rows = self.rows();
            let mut dense = vec![0.0; rows.len() * self.columns];
            for i in 0..rows.len() {
                for (j, value) in rows.row(i) {
                    dense[i * self.columns + j] = value;
                }
            }
            dense
        }
    }

    fn close(a: f64, b: f64, tolerance: f64) {
        assert!(a == b || (a / b - 1.0).abs() < tolerance, "{a} and {b}");
    }

    #[test]
    fn small_problems_agree_with_the_dense_answer() {
        for (n, seed) in [(2, 1), (7, 2), (40, 3), (90, 4), (150, 5)] {
            for sum_zero in [false, true] {
                let chain = Chain::new(n, 6, sum_zero, seed);
                let sparse = Sparse::new(&chain.rows(), None, usize::MAX, &mut || false).unwrap();
                let dense = Observability::new(&chain.dense(), n, None).unwrap();
                assert_eq!(sparse.rank(), dense.rank());
                close(
                    sparse.smallest_counting(),
                    dense.singular_values()[dense.rank() - 1],
                    1e-6,
                );
                let std = sparse.crlb_std(&mut || false).unwrap();
                for (a, b) in std.iter().zip(dense.crlb_std()) {
                    close(*a, b, 1e-9);
                }
                let mut difference = vec![0.0; n];
                (difference[0], difference[n - 1]) = (1.0, -1.0);
                close(
                    sparse.variance(&[(0, 1.0), (n - 1, -1.0)]).unwrap().sqrt(),
                    dense.combination_std(&difference).unwrap(),
                    1e-9,
                );
                if !sum_zero {
                    close(sparse.log_det(), dense.log_det(), 1e-10);
                }
                let gain = sparse
                    .rank_gain(&[vec![(0, 1.0)], vec![(n - 1, 1.0)]])
                    .unwrap();
                assert_eq!(gain, n - dense.rank());
            }
        }
    }

    #[test]
    fn elimination_keeps_the_bounds_of_the_rest() {
        let chain = Chain::new(60, 5, false, 11);
        let whole = Sparse::new(&chain.rows(), None, usize::MAX, &mut || false).unwrap();
        let std = whole.crlb_std(&mut || false).unwrap();
        let gone: Vec<bool> = (0..60).map(|j| j % 3 == 0).collect();
        let left = marginal_rows(&chain.rows(), &gone, usize::MAX, &mut || false).unwrap();
        // The columns that stay, numbered anew.
        let number: Vec<usize> = (0..60).filter(|j| j % 3 != 0).collect();
        let column: Vec<i64> = left
            .column
            .iter()
            .map(|&j| number.binary_search(&usize::try_from(j).unwrap()).unwrap() as i64)
            .collect();
        let rows = Rows::new(number.len(), &left.start, &column, &left.value).unwrap();
        let rest = Sparse::new(&rows, Some(1e-9), usize::MAX, &mut || false).unwrap();
        assert_eq!(rest.nullity(), 0);
        let bounds = rest.crlb_std(&mut || false).unwrap();
        for (k, &j) in number.iter().enumerate() {
            close(bounds[k], std[j], 1e-9);
        }
    }

    #[test]
    fn what_does_not_fit_is_told_before_it_is_tried() {
        let chain = Chain::new(200, 6, false, 3);
        let error = Sparse::new(&chain.rows(), None, 1000, &mut || false).unwrap_err();
        assert!(
            matches!(error, SparseError::Memory { needed, available: 1000, .. } if needed > 1000)
        );
        let error = Sparse::new(&chain.rows(), None, usize::MAX, &mut || true).unwrap_err();
        assert_eq!(error, SparseError::Interrupted);
    }

    #[test]
    fn dissection_orders_every_column_once() {
        use super::super::ordering::{Graph, nested_dissection};
        let chain = Chain::new(5000, 40, false, 9);
        let mut order = nested_dissection(&Graph::of_columns(&chain.rows())).unwrap();
        order.sort_unstable();
        assert!(order.iter().copied().eq(0..5000));
    }
}
