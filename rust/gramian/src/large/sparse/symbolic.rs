//! Where the factor of sparse rows fills in: the order of elimination, the elimination tree
//! and the fronts.

use alloc::vec;
use alloc::vec::Vec;

use super::ordering::{self, Graph};
use super::structure::NONE;
use super::{Index, Rows, SparseError, Stop};

/// From so many columns on, nested dissection is tried beside minimum degree.
const LARGE: usize = 20_000;

/// Where the entries of the factor stand: the elimination order, and the groups of
/// columns (fronts) that have one pattern.
#[derive(Clone, Debug)]
pub struct Symbolic {
    /// Column at each place of the order.
    pub(super) order: Vec<usize>,
    /// Place of each column.
    pub(super) place: Vec<usize>,
    /// First place of each front, and the number of columns at the end.
    pub(super) begin: Vec<usize>,
    /// Where each front's later places start in `later`.
    later_start: Vec<usize>,
    /// Places beyond a front that its rows touch, increasing.
    later: Vec<usize>,
    /// The front that takes what is left of a front; [`NONE`] for the last.
    pub(super) parent: Vec<usize>,
    /// Where each front's entries start.
    value_start: Vec<usize>,
    /// The front of each place.
    pub(super) front: Vec<usize>,
    /// Bytes at the peak of the factorisation, the factor included.
    peak: usize,
}

impl Symbolic {
    /// Orders the columns and finds where the factor fills in.
    ///
    /// # Errors
    /// [`SparseError::Memory`] where the factorisation would need more than `available`
    /// bytes, or ordering more than there are; [`SparseError::Interrupted`].
    pub fn new<I: Index>(
        rows: &Rows<'_, I>,
        available: usize,
        stop: &mut Stop<'_>,
    ) -> Result<Self, SparseError> {
        let n = rows.columns();
        let graph = Graph::of_columns(rows);
        let memory = || SparseError::Memory {
            columns: n,
            entries: graph.neighbour.len(),
            needed: 48 * graph.neighbour.len(),
            available,
        };
        let mut best = Fronts::of(
            rows,
            ordering::minimum_degree(&graph).ok_or_else(memory)?,
            stop,
        )?;
        if n >= LARGE {
            let order = ordering::nested_dissection(&graph).ok_or_else(memory)?;
            let other = Fronts::of(rows, order, stop)?;
            if other.work() < best.work() {
                best = other;
            }
        }
        best.filled(rows, available, stop)
    }

    /// The order with some columns before all others, for their elimination.
    pub(super) fn eliminating<I: Index>(
        rows: &Rows<'_, I>,
        first: &[bool],
        available: usize,
        stop: &mut Stop<'_>,
    ) -> Result<Self, SparseError> {
        let found = Self::new(rows, available, stop)?;
        let (mut order, rest): (Vec<usize>, Vec<usize>) =
            found.order.iter().partition(|&&j| first[j]);
        order.extend(rest);
        Fronts::of(rows, order, stop)?.filled(rows, available, stop)
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.order.len()
    }

    /// Number of fronts.
    pub fn fronts(&self) -> usize {
        self.begin.len() - 1
    }

    /// Entries of the factor, zeros inside fronts included.
    pub fn entries(&self) -> usize {
        self.value_start[self.fronts()]
    }

    /// Bytes that the factorisation takes at its peak.
    pub fn peak(&self) -> usize {
        self.peak
    }

    /// The later places of a front.
    pub(super) fn later(&self, front: usize) -> &[usize] {
        &self.later[self.later_start[front]..self.later_start[front + 1]]
    }

    /// How many columns a front eliminates, and how many it touches.
    pub(super) fn size(&self, front: usize) -> (usize, usize) {
        let own = self.begin[front + 1] - self.begin[front];
        (
            own,
            own + self.later_start[front + 1] - self.later_start[front],
        )
    }

    pub(super) fn values(&self, front: usize) -> core::ops::Range<usize> {
        self.value_start[front]..self.value_start[front + 1]
    }

    /// The rows by the front of their first place: starts and rows.
    pub(super) fn leading<I: Index>(&self, rows: &Rows<'_, I>) -> (Vec<usize>, Vec<usize>) {
        let front_of: Vec<usize> = (0..rows.len())
            .map(|i| {
                rows.row(i)
                    .map(|(j, _)| self.place[j])
                    .min()
                    .map_or(NONE, |p| self.front[p])
            })
            .collect();
        let mut start = vec![0; self.fronts() + 1];
        for &s in front_of.iter().filter(|&&s| s != NONE) {
            start[s + 1] += 1;
        }
        for s in 0..self.fronts() {
            start[s + 1] += start[s];
        }
        let mut next = start.clone();
        let mut list = vec![0; start[self.fronts()]];
        for (i, &s) in front_of.iter().enumerate() {
            if s != NONE {
                list[next[s]] = i;
                next[s] += 1;
            }
        }
        (start, list)
    }
}

/// The fronts of an order, by their sizes alone: what the factor will take is known before
/// anything of that size is allocated.
struct Fronts {
    order: Vec<usize>,
    place: Vec<usize>,
    /// The upper pattern by columns: starts and places.
    start: Vec<usize>,
    index: Vec<usize>,
    /// First place of each front, and the number of columns at the end.
    begin: Vec<usize>,
    /// How many places beyond a front its rows touch.
    beyond: Vec<usize>,
    parent: Vec<usize>,
    front: Vec<usize>,
}

impl Fronts {
    fn of<I: Index>(
        rows: &Rows<'_, I>,
        mut order: Vec<usize>,
        stop: &mut Stop<'_>,
    ) -> Result<Self, SparseError> {
        let n = rows.columns();
        let mut place = inverse(&order);
        let (start, index) = stars(rows, &place);
        let post = postorder(&elimination_tree(n, &start, &index));
        order = post.iter().map(|&p| order[p]).collect();
        place = inverse(&order);
        let (start, index) = stars(rows, &place);
        let above = elimination_tree(n, &start, &index);
        if stop() {
            return Err(SparseError::Interrupted);
        }
        let count = column_counts(&above, &start, &index);
        let begin = supernodes(&above, &count);
        let mut front = vec![0; n];
        let mut beyond = Vec::with_capacity(begin.len() - 1);
        for (s, w) in begin.windows(2).enumerate() {
            front[w[0]..w[1]].fill(s);
            beyond.push(count[w[1] - 1] - 1);
        }
        let parent = begin[1..]
            .iter()
            .map(|&end| match above[end - 1] {
                NONE => NONE,
                p => front[p],
            })
            .collect();
        Ok(Self {
            order,
            place,
            start,
            index,
            begin,
            beyond,
            parent,
            front,
        })
    }

    /// How many columns a front eliminates, and how many it touches.
    fn size(&self, front: usize) -> (usize, usize) {
        let own = self.begin[front + 1] - self.begin[front];
        (own, own + self.beyond[front])
    }

    /// Multiplications of the factorisation, up to a factor.
    fn work(&self) -> f64 {
        (0..self.beyond.len())
            .map(|s| {
                let (own, wide) = self.size(s);
                own as f64 * (wide as f64) * wide as f64
            })
            .sum()
    }

    /// Entries of the factor, zeros inside fronts included.
    fn entries(&self) -> usize {
        (0..self.beyond.len())
            .map(|s| {
                let (own, wide) = self.size(s);
                own * wide
            })
            .sum()
    }

    /// Bytes at the peak: walks through the factorisation and counts what is held at a time.
    fn peak<I: Index>(&self, rows: &Rows<'_, I>) -> usize {
        let count = self.beyond.len();
        // Rows that begin in each front.
        let mut lines = vec![0; count];
        for i in 0..rows.len() {
            if let Some(p) = rows.row(i).map(|(j, _)| self.place[j]).min() {
                lines[self.front[p]] += 1;
            }
        }
        let mut held = 0;
        let mut most = 0;
        let mut waiting = vec![0; count];
        let mut arriving = vec![0; count];
        for s in 0..count {
            let (own, wide) = self.size(s);
            let high = lines[s] + own + arriving[s];
            most = most.max(held + high * wide);
            held -= waiting[s];
            let left = high.saturating_sub(own).min(wide - own);
            if self.parent[s] != NONE {
                let size = left * (wide - own);
                held += size;
                waiting[self.parent[s]] += size;
                arriving[self.parent[s]] += left;
            }
        }
        8 * (most + self.entries())
    }

    /// With the places that the rows of each front touch: those of its rows of A^T A and of
    /// its children's.
    fn filled<I: Index>(
        self,
        rows: &Rows<'_, I>,
        available: usize,
        stop: &mut Stop<'_>,
    ) -> Result<Symbolic, SparseError> {
        let n = self.order.len();
        let peak = self.peak(rows);
        if peak > available {
            return Err(SparseError::Memory {
                columns: n,
                entries: self.entries(),
                needed: peak,
                available,
            });
        }
        let count = self.beyond.len();
        let (row_start, row_index) = transpose(n, &self.start, &self.index);
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); count];
        for (s, &p) in self.parent.iter().enumerate() {
            if p != NONE {
                children[p].push(s);
            }
        }
        let mut later_start = Vec::with_capacity(count + 1);
        later_start.push(0);
        let mut later: Vec<usize> = Vec::with_capacity(self.beyond.iter().sum());
        let mut value_start = Vec::with_capacity(count + 1);
        value_start.push(0);
        let mut seen = vec![NONE; n];
        for s in 0..count {
            if s % 256 == 0 && stop() {
                return Err(SparseError::Interrupted);
            }
            let (from, end) = (later.len(), self.begin[s + 1]);
            let mut touch = |p: usize, later: &mut Vec<usize>| {
                if p >= end && seen[p] != s {
                    seen[p] = s;
                    later.push(p);
                }
            };
            for &p in &row_index[row_start[self.begin[s]]..row_start[end]] {
                touch(p, &mut later);
            }
            for &child in &children[s] {
                for k in later_start[child]..later_start[child + 1] {
                    touch(later[k], &mut later);
                }
            }
            later[from..].sort_unstable();
            debug_assert_eq!(later.len() - from, self.beyond[s]);
            later_start.push(later.len());
            let own = end - self.begin[s];
            value_start.push(value_start[s] + own * (own + later.len() - from));
        }
        Ok(Symbolic {
            order: self.order,
            place: self.place,
            begin: self.begin,
            later_start,
            later,
            parent: self.parent,
            value_start,
            front: self.front,
            peak,
        })
    }
}

/// A pattern by columns, by rows.
fn transpose(n: usize, start: &[usize], index: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let mut by_row = vec![0; n + 1];
    for &i in index {
        by_row[i + 1] += 1;
    }
    for i in 0..n {
        by_row[i + 1] += by_row[i];
    }
    let mut next = by_row.clone();
    let mut column = vec![0; index.len()];
    for j in 0..n {
        for &i in &index[start[j]..start[j + 1]] {
            column[next[i]] = j;
            next[i] += 1;
        }
    }
    (by_row, column)
}

/// Entries of each column of the factor, its diagonal included, in nearly linear time: from
/// the leaves of the row subtrees (Gilbert, Ng & Peyton 1994; Davis 2006, section 4.5). The
/// columns are in postorder.
fn column_counts(parent: &[usize], start: &[usize], index: &[usize]) -> Vec<usize> {
    let n = parent.len();
    let (row_start, row_index) = transpose(n, start, index);
    let mut first = vec![NONE; n];
    let mut count = vec![0_isize; n];
    for j in 0..n {
        count[j] = isize::from(first[j] == NONE);
        let mut p = j;
        while p != NONE && first[p] == NONE {
            first[p] = j;
            p = parent[p];
        }
    }
    // Of each row, by its columns so far: one more than the latest first descendant of a
    // leaf (none at first), the latest leaf, and the sets of the union-find structure.
    let mut beyond = vec![0; n];
    let mut latest = vec![NONE; n];
    let mut ancestor: Vec<usize> = (0..n).collect();
    for j in 0..n {
        if parent[j] != NONE {
            count[parent[j]] -= 1;
        }
        for &i in &row_index[row_start[j]..row_start[j + 1]] {
            if i <= j || first[j] < beyond[i] {
                continue;
            }
            beyond[i] = first[j] + 1;
            let previous = core::mem::replace(&mut latest[i], j);
            count[j] += 1;
            if previous == NONE {
                continue;
            }
            let mut common = previous;
            while common != ancestor[common] {
                common = ancestor[common];
            }
            let mut p = previous;
            while p != common {
                p = core::mem::replace(&mut ancestor[p], common);
            }
            count[common] -= 1;
        }
        if parent[j] != NONE {
            ancestor[j] = parent[j];
        }
    }
    for j in 0..n {
        if parent[j] != NONE {
            count[parent[j]] += count[j];
        }
    }
    count.into_iter().map(isize::unsigned_abs).collect()
}

/// Fronts of at most so many columns are joined where the share of zeros stays below a limit
/// (Ashcraft & Grimes 1989; limits of Chen, Davis, Hager & Rajamanickam 2008): work on a few
/// zeros costs less than another front.
const JOINED: [(usize, f64); 4] = [(4, 1.0), (16, 0.8), (48, 0.1), (usize::MAX, 0.05)];

/// The first place of each front, and the number of columns: columns of one pattern, and
/// fronts with their last child where that adds few zeros.
fn supernodes(parent: &[usize], count: &[usize]) -> Vec<usize> {
    let n = parent.len();
    // First place of each front, and its zeros.
    let mut fronts: Vec<(usize, usize)> = Vec::new();
    let mut end = 0;
    while end < n {
        let begin = end;
        end += 1;
        while end < n && parent[end - 1] == end && count[end - 1] == count[end] + 1 {
            end += 1;
        }
        let mut joined = (begin, 0);
        while let Some(&(first, zeros)) = fronts.last() {
            let above = parent[joined.0 - 1];
            if above == NONE || above >= end {
                break;
            }
            // The child's columns, once as they are and once as high as the parent's.
            let width = joined.0 - first;
            let lower = count[joined.0 - 1] - 1;
            let higher = end - joined.0 + count[end - 1] - 1;
            let zeros = zeros + joined.1 + width * (higher - lower);
            let wide = end - first;
            let entries = wide * (wide + 1) / 2 + wide * (count[end - 1] - 1);
            let share = zeros as f64 / entries as f64;
            if !JOINED
                .iter()
                .any(|&(most, limit)| wide <= most && share < limit)
            {
                break;
            }
            joined = (first, zeros);
            fronts.pop();
        }
        fronts.push(joined);
    }
    let mut begin: Vec<usize> = fronts.into_iter().map(|f| f.0).collect();
    begin.push(n);
    begin
}

fn inverse(order: &[usize]) -> Vec<usize> {
    let mut place = vec![0; order.len()];
    for (p, &j) in order.iter().enumerate() {
        place[j] = p;
    }
    place
}

/// The upper pattern whose fill is that of A^T A: of each row only what joins its first
/// place with the others, as eliminating the first joins the rest.
fn stars<I: Index>(rows: &Rows<'_, I>, place: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let n = place.len();
    let mut start = vec![0; n + 1];
    let firsts: Vec<usize> = (0..rows.len())
        .map(|i| rows.row(i).map(|(j, _)| place[j]).min().unwrap_or(NONE))
        .collect();
    for (i, &first) in firsts.iter().enumerate() {
        for (j, _) in rows.row(i) {
            start[place[j] + 1] += usize::from(place[j] != first);
        }
    }
    for p in 0..n {
        start[p + 1] += start[p] + 1;
    }
    let mut next = start.clone();
    let mut index = vec![0; start[n]];
    for p in 0..n {
        index[next[p]] = p;
        next[p] += 1;
    }
    for (i, &first) in firsts.iter().enumerate() {
        for (j, _) in rows.row(i) {
            let p = place[j];
            if p != first {
                index[next[p]] = first;
                next[p] += 1;
            }
        }
    }
    (start, index)
}

/// Liu's algorithm on an upper pattern by columns.
fn elimination_tree(n: usize, start: &[usize], index: &[usize]) -> Vec<usize> {
    let mut parent = vec![NONE; n];
    let mut ancestor = vec![NONE; n];
    for j in 0..n {
        for &first in &index[start[j]..start[j + 1]] {
            let mut i = first;
            while i != NONE && i < j {
                let next = ancestor[i];
                ancestor[i] = j;
                if next == NONE {
                    parent[i] = j;
                }
                i = next;
            }
        }
    }
    parent
}

/// Children before their parents, each subtree together.
fn postorder(parent: &[usize]) -> Vec<usize> {
    let n = parent.len();
    let mut first_child = vec![NONE; n];
    let mut sibling = vec![NONE; n];
    for j in (0..n).rev() {
        if parent[j] != NONE {
            sibling[j] = first_child[parent[j]];
            first_child[parent[j]] = j;
        }
    }
    let mut post = Vec::with_capacity(n);
    let mut stack = Vec::new();
    for top in (0..n).filter(|&j| parent[j] == NONE) {
        stack.push(top);
        while let Some(&j) = stack.last() {
            let child = first_child[j];
            if child == NONE {
                post.push(j);
                stack.pop();
            } else {
                first_child[j] = sibling[child];
                stack.push(child);
            }
        }
    }
    post
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Entries of each column of the factor of a pattern, by elimination as it is defined.
    fn eliminated(n: usize, start: &[usize], index: &[usize]) -> Vec<usize> {
        let mut below = vec![alloc::collections::BTreeSet::new(); n];
        for j in 0..n {
            for &i in &index[start[j]..start[j + 1]] {
                if i < j {
                    below[i].insert(j);
                }
            }
        }
        for j in 0..n {
            let own = below[j].clone();
            if let Some(&p) = own.first() {
                below[p].extend(own.iter().copied().filter(|&i| i != p));
            }
        }
        below.iter().map(|own| own.len() + 1).collect()
    }

    #[test]
    fn counts_are_those_of_an_elimination_and_fronts_hold_them() {
        let mut state = 7_u64;
        let mut draw = |n: usize| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as usize % n
        };
        for case in 0..300 {
            let n = 1 + draw(40);
            let mut indptr = vec![0_i64];
            let mut column = Vec::new();
            for _ in 0..draw(2 * n + 1) {
                // Every second pattern is nearly a chain.
                let line: alloc::collections::BTreeSet<i64> = (0..=draw(3))
                    .map(|_| {
                        if case % 2 == 0 {
                            draw(n)
                        } else {
                            (indptr.len() + draw(3)) % n
                        }
                    })
                    .map(|at| i64::try_from(at).unwrap())
                    .collect();
                column.extend(line);
                indptr.push(i64::try_from(column.len()).unwrap());
            }
            let value = vec![1.0; column.len()];
            let rows = Rows::new(n, &indptr, &column, &value).unwrap();
            let graph = Graph::of_columns(&rows);
            let order = ordering::minimum_degree(&graph).unwrap();
            let fronts = Fronts::of(&rows, order, &mut || false).unwrap();
            let above = elimination_tree(n, &fronts.start, &fronts.index);
            let count = column_counts(&above, &fronts.start, &fronts.index);
            assert_eq!(count, eliminated(n, &fronts.start, &fronts.index));
            let sizes: Vec<(usize, usize)> =
                (0..fronts.beyond.len()).map(|s| fronts.size(s)).collect();
            let entries = fronts.entries();
            let filled = fronts.filled(&rows, usize::MAX, &mut || false).unwrap();
            assert_eq!(filled.entries(), entries);
            for (s, &size) in sizes.iter().enumerate() {
                assert_eq!(filled.size(s), size);
            }
        }
    }
}
