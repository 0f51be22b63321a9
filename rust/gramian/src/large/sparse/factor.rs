//! The triangular factor of sparse rows, by orthogonal transformations.

use alloc::vec;
use alloc::vec::Vec;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::householder::{
    apply_block_householder_sequence_transpose_on_the_left_in_place_scratch as apply_scratch,
    apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj as apply_transpose,
};
use faer::linalg::matmul::matmul;
use faer::linalg::qr::no_pivoting::factor::{qr_in_place, qr_in_place_scratch};
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Accum, Conj, MatMut, MatRef, Par, Spec};

use super::structure::NONE;
use super::symbolic::Symbolic;
use super::{Index, Rows, SparseError, Stop};

/// Columns of a front that are reduced together.
const PANEL: usize = 16;

/// Entries that one panel's reflections are applied to between two looks for an interrupt.
const STRIP: usize = 1 << 23;

/// What a front hands to its parent: rows over the front's later places.
struct Left {
    /// Column-major, as many columns as there are later places.
    entries: Vec<f64>,
    rows: usize,
    /// Where among the later places each row begins.
    lead: Vec<usize>,
}

/// The upper triangular factor R of [A D; mu I]: D makes columns of unit length, mu keeps
/// R of full rank whatever A is.
#[derive(Clone, Debug)]
pub struct Factor {
    pub(super) symbolic: Symbolic,
    /// Each front's rows of R, column-major.
    value: Vec<f64>,
}

impl Factor {
    /// Reduces `rows` with column j multiplied by `scale[j]`, over `mu` times the identity.
    ///
    /// # Errors
    /// [`SparseError::Memory`] where more than `available` bytes would be needed or the
    /// system has less; [`SparseError::Interrupted`].
    pub fn new<I: Index>(
        rows: &Rows<'_, I>,
        scale: &[f64],
        mu: f64,
        symbolic: Symbolic,
        available: usize,
        stop: &mut Stop<'_>,
    ) -> Result<Self, SparseError> {
        let memory = SparseError::Memory {
            columns: symbolic.columns(),
            entries: symbolic.entries(),
            needed: symbolic.peak(),
            available,
        };
        if symbolic.peak() > available {
            return Err(memory);
        }
        let mut value = Vec::new();
        if value.try_reserve_exact(symbolic.entries()).is_err() {
            return Err(memory);
        }
        value.resize(symbolic.entries(), 0.0);
        let (start, list) = symbolic.leading(rows);
        let mut left: Vec<Vec<(usize, Left)>> = Vec::new();
        left.resize_with(symbolic.fronts(), Vec::new);
        let mut local = vec![NONE; symbolic.columns()];
        let mut front = Front::default();
        for s in 0..symbolic.fronts() {
            let (own, wide) = symbolic.size(s);
            let begin = symbolic.begin[s];
            for k in 0..own {
                local[begin + k] = k;
            }
            for (k, &p) in symbolic.later(s).iter().enumerate() {
                local[p] = own + k;
            }
            let children = core::mem::take(&mut left[s]);
            front
                .gather(
                    own,
                    wide,
                    &list[start[s]..start[s + 1]],
                    rows,
                    &symbolic,
                    &local,
                    &children,
                    scale,
                    mu,
                )
                .ok_or_else(|| memory.clone())?;
            drop(children);
            front.reduce(stop)?;
            front.own_rows(own, &mut value[symbolic.values(s)]);
            if symbolic.parent[s] != NONE {
                left[symbolic.parent[s]].push((s, front.left(own)));
            }
        }
        Ok(Self { symbolic, value })
    }

    /// A front's rows of R.
    pub(super) fn rows(&self, front: usize) -> MatRef<'_, f64> {
        let (own, wide) = self.symbolic.size(front);
        MatRef::from_column_major_slice(&self.value[self.symbolic.values(front)], own, wide)
    }

    /// The diagonal of R, by places.
    pub(super) fn diagonal(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.symbolic.fronts()).flat_map(move |s| {
            let (own, _) = self.symbolic.size(s);
            let from = self.symbolic.values(s).start;
            (0..own).map(move |k| self.value[from + k * (own + 1)])
        })
    }

    /// R^-T x for `width` right-hand sides, by places, row-major.
    pub(super) fn solve_transposed(
        &self,
        x: &mut [f64],
        width: usize,
        stop: &mut Stop<'_>,
    ) -> Result<(), SparseError> {
        let mut update = Vec::new();
        for s in 0..self.symbolic.fronts() {
            if s % 256 == 0 && stop() {
                return Err(SparseError::Interrupted);
            }
            self.forward(s, x, width, &mut update);
        }
        Ok(())
    }

    fn forward(&self, s: usize, x: &mut [f64], width: usize, update: &mut Vec<f64>) {
        let (own, wide) = self.symbolic.size(s);
        let r = self.rows(s);
        let begin = self.symbolic.begin[s];
        let here = &mut x[begin * width..(begin + own) * width];
        solve_lower_triangular_in_place(
            r.subcols(0, own).transpose(),
            MatMut::from_row_major_slice_mut(here, own, width),
            Par::Seq,
        );
        let later = self.symbolic.later(s);
        update.clear();
        update.resize(later.len() * width, 0.0);
        matmul(
            MatMut::from_row_major_slice_mut(update, later.len(), width),
            Accum::Replace,
            r.subcols(own, wide - own).transpose(),
            MatRef::from_row_major_slice(here, own, width),
            1.0,
            Par::Seq,
        );
        for (&p, line) in later.iter().zip(update.chunks_exact(width)) {
            for (x, u) in x[p * width..].iter_mut().zip(line) {
                *x -= u;
            }
        }
    }

    /// R^-1 x for `width` right-hand sides, by places, row-major.
    pub(super) fn solve(
        &self,
        x: &mut [f64],
        width: usize,
        stop: &mut Stop<'_>,
    ) -> Result<(), SparseError> {
        let mut known = Vec::new();
        for s in (0..self.symbolic.fronts()).rev() {
            if s % 256 == 0 && stop() {
                return Err(SparseError::Interrupted);
            }
            let (own, wide) = self.symbolic.size(s);
            let r = self.rows(s);
            let begin = self.symbolic.begin[s];
            let later = self.symbolic.later(s);
            known.clear();
            for &p in later {
                known.extend_from_slice(&x[p * width..(p + 1) * width]);
            }
            let here = &mut x[begin * width..(begin + own) * width];
            matmul(
                MatMut::from_row_major_slice_mut(here, own, width),
                Accum::Add,
                r.subcols(own, wide - own),
                MatRef::from_row_major_slice(&known, later.len(), width),
                -1.0,
                Par::Seq,
            );
            solve_upper_triangular_in_place(
                r.subcols(0, own),
                MatMut::from_row_major_slice_mut(here, own, width),
                Par::Seq,
            );
        }
        Ok(())
    }

    /// R^-T c for one sparse vector (places and values): only the fronts on its way to
    /// the end are visited. `work` holds zeros, one for each column, and holds them again
    /// afterwards; `each` is given every place that was reached with its value.
    pub(super) fn reach(
        &self,
        vector: &[(usize, f64)],
        work: &mut [f64],
        mut each: impl FnMut(usize, f64),
    ) {
        let mut fronts: Vec<usize> = Vec::new();
        for &(p, value) in vector {
            work[p] += value;
            let mut s = self.symbolic.front[p];
            // Ways meet and go on together.
            let mut way = Vec::new();
            while s != NONE {
                way.push(s);
                s = self.symbolic.parent[s];
            }
            fronts.extend(way);
        }
        fronts.sort_unstable();
        fronts.dedup();
        let mut update = Vec::new();
        for &s in &fronts {
            self.forward(s, work, 1, &mut update);
        }
        for &s in &fronts {
            for p in self.symbolic.begin[s]..self.symbolic.begin[s + 1] {
                each(p, work[p]);
                work[p] = 0.0;
            }
        }
    }

    /// The factor with one more row (places and values): plane rotations along the way
    /// of the row to the end (Björck, Numerical Methods for Least Squares, section 6.6).
    pub(super) fn add_row(&mut self, vector: &[(usize, f64)]) {
        let mut row: alloc::collections::BTreeMap<usize, f64> = vector.iter().copied().collect();
        let Some(mut s) = vector
            .iter()
            .map(|&(p, _)| p)
            .min()
            .map(|p| self.symbolic.front[p])
        else {
            return;
        };
        let mut line: Vec<f64> = Vec::new();
        while s != NONE {
            let (own, wide) = self.symbolic.size(s);
            let begin = self.symbolic.begin[s];
            line.clear();
            line.extend((begin..begin + own).map(|p| row.remove(&p).unwrap_or(0.0)));
            line.extend(
                self.symbolic
                    .later(s)
                    .iter()
                    .map(|p| row.remove(p).unwrap_or(0.0)),
            );
            let values = &mut self.value[self.symbolic.values(s)];
            for k in 0..own {
                if line[k] == 0.0 {
                    continue;
                }
                let (a, b) = (values[k + k * own], line[k]);
                let length = a.hypot(b);
                let (c, d) = (a / length, b / length);
                for q in k..wide {
                    let (x, y) = (values[k + q * own], line[q]);
                    values[k + q * own] = c * x + d * y;
                    line[q] = c * y - d * x;
                }
            }
            for (k, &p) in self.symbolic.later(s).iter().enumerate() {
                if line[own + k] != 0.0 {
                    row.insert(p, line[own + k]);
                }
            }
            s = self.symbolic.parent[s];
        }
    }
}

/// One front while it is reduced: rows sorted by where they begin.
#[derive(Default)]
struct Front {
    /// Column-major.
    entries: Vec<f64>,
    high: usize,
    wide: usize,
    lead: Vec<usize>,
    /// After `reduce`: how many rows of each column are not zero.
    filled: Vec<usize>,
    /// After `reduce`: where each row that is left begins.
    pivot: Vec<usize>,
    work: Vec<f64>,
}

enum Source {
    Given(usize),
    Identity(usize),
    Child(usize, usize),
}

impl Front {
    #[allow(clippy::too_many_arguments)]
    fn gather<I: Index>(
        &mut self,
        own: usize,
        wide: usize,
        given: &[usize],
        rows: &Rows<'_, I>,
        symbolic: &Symbolic,
        local: &[usize],
        children: &[(usize, Left)],
        scale: &[f64],
        mu: f64,
    ) -> Option<()> {
        let mut lines: Vec<(usize, Source)> = Vec::new();
        for &i in given {
            let lead = rows
                .row(i)
                .map(|(j, _)| local[symbolic.place[j]])
                .min()
                .unwrap_or(0);
            lines.push((lead, Source::Given(i)));
        }
        lines.extend((0..own).map(|k| (k, Source::Identity(k))));
        for (c, (child, left)) in children.iter().enumerate() {
            let later = symbolic.later(*child);
            for (r, &lead) in left.lead.iter().enumerate() {
                lines.push((local[later[lead]], Source::Child(c, r)));
            }
        }
        lines.sort_by_key(|(lead, _)| *lead);
        self.high = lines.len();
        self.wide = wide;
        self.lead.clear();
        self.lead.extend(lines.iter().map(|(lead, _)| *lead));
        self.entries.clear();
        self.entries
            .try_reserve_exact(self.high * wide)
            .ok()
            .filter(|()| self.high.checked_mul(wide).is_some())?;
        self.entries.resize(self.high * wide, 0.0);
        let mut row_of_child: Vec<Vec<usize>> = children
            .iter()
            .map(|(_, left)| vec![0; left.rows])
            .collect();
        for (row, (_, source)) in lines.iter().enumerate() {
            match *source {
                Source::Given(i) => {
                    for (j, value) in rows.row(i) {
                        let column = local[symbolic.place[j]];
                        self.entries[row + column * self.high] = value * scale[j];
                    }
                }
                Source::Identity(k) => self.entries[row + k * self.high] = mu,
                Source::Child(c, r) => row_of_child[c][r] = row,
            }
        }
        for ((child, left), row_of) in children.iter().zip(&row_of_child) {
            if left.rows == 0 {
                continue;
            }
            for (&p, from) in symbolic
                .later(*child)
                .iter()
                .zip(left.entries.chunks_exact(left.rows))
            {
                let column = local[p] * self.high;
                for (&row, &value) in row_of.iter().zip(from) {
                    self.entries[column + row] = value;
                }
            }
        }
        Some(())
    }

    /// Householder reflections, a panel of columns at a time, on those rows alone that
    /// begin in the panel or before it.
    fn reduce(&mut self, stop: &mut Stop<'_>) -> Result<(), SparseError> {
        let (high, wide) = (self.high, self.wide);
        self.filled.clear();
        self.filled.resize(wide, 0);
        self.pivot.clear();
        let (mut row, mut end, mut column) = (0, 0, 0);
        while column < wide && row < high {
            if stop() {
                return Err(SparseError::Interrupted);
            }
            let next = wide.min(column + PANEL);
            while end < high && self.lead[end] < next {
                end += 1;
            }
            let (tall, across) = (end - row, next - column);
            let reflections = tall.min(across);
            for k in 0..across {
                self.filled[column + k] = row + reflections.min(k + 1);
            }
            if reflections > 0 {
                self.panel(row, end, column, next, stop)?;
                self.pivot.extend(column..column + reflections);
                row += reflections;
            }
            column = next;
        }
        for k in column..wide {
            self.filled[k] = row;
        }
        Ok(())
    }

    fn panel(
        &mut self,
        row: usize,
        end: usize,
        column: usize,
        next: usize,
        stop: &mut Stop<'_>,
    ) -> Result<(), SparseError> {
        let (tall, across) = (end - row, next - column);
        let reflections = tall.min(across);
        let matrix = MatMut::from_column_major_slice_mut(&mut self.entries, self.high, self.wide)
            .get_mut(row..end, column..);
        // Of a tall front so many columns at a time that an interrupt need not wait.
        let strip = (STRIP / tall.max(1)).max(PANEL);
        let (mut panel, mut rest) = matrix.split_at_col_mut(across);
        self.work.clear();
        self.work.resize(reflections * reflections, 0.0);
        let mut factor =
            MatMut::from_column_major_slice_mut(&mut self.work, reflections, reflections);
        let request =
            qr_in_place_scratch::<f64>(tall, across, reflections, Par::Seq, Spec::default()).or(
                apply_scratch::<f64>(tall, reflections, rest.ncols().min(strip)),
            );
        let mut memory = MemBuffer::new(request);
        qr_in_place(
            panel.as_mut(),
            factor.as_mut(),
            Par::Seq,
            MemStack::new(&mut memory),
            Spec::default(),
        );
        while rest.ncols() > 0 {
            let across = strip.min(rest.ncols());
            let (now, later) = rest.split_at_col_mut(across);
            apply_transpose(
                panel.as_ref().subcols(0, reflections),
                factor.as_ref(),
                Conj::No,
                now,
                Par::Seq,
                MemStack::new(&mut memory),
            );
            rest = later;
            if rest.ncols() > 0 && stop() {
                return Err(SparseError::Interrupted);
            }
        }
        Ok(())
    }

    /// The rows of R of the columns that end here.
    fn own_rows(&self, own: usize, out: &mut [f64]) {
        for k in 0..self.wide {
            let filled = self.filled[k].min(own);
            out[k * own..k * own + filled]
                .copy_from_slice(&self.entries[k * self.high..k * self.high + filled]);
        }
    }

    /// The rows for the parent.
    fn left(&self, own: usize) -> Left {
        let rows = self.pivot.len().saturating_sub(own);
        let later = self.wide - own;
        let mut entries = vec![0.0; rows * later];
        for k in 0..later {
            let filled = self.filled[own + k].saturating_sub(own);
            let from = (own + k) * self.high + own;
            entries[k * rows..k * rows + filled]
                .copy_from_slice(&self.entries[from..from + filled]);
        }
        Left {
            entries,
            rows,
            lead: self.pivot[own.min(self.pivot.len())..]
                .iter()
                .map(|p| p - own)
                .collect(),
        }
    }
}
