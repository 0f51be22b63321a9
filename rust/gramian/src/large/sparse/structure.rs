//! What the pattern of the rows alone decides, before any number is looked at.

use alloc::vec;
use alloc::vec::Vec;

use super::{Index, Rows};

/// Marks what has no partner, component or parent.
pub const NONE: usize = usize::MAX;

/// States that only few rows touch: whatever the numbers, so few rows cannot determine
/// so many states.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shortage {
    /// The states, increasing.
    pub columns: Vec<usize>,
    /// All rows that touch them, increasing: fewer than the states.
    pub rows: Vec<usize>,
}

/// The structure of sparse rows.
#[derive(Clone, Debug)]
pub struct Structure {
    /// The component of each column; columns that no chain of rows joins are in
    /// different ones. Numbered by their first columns.
    pub component: Vec<usize>,
    /// How many components there are.
    pub components: usize,
    /// Columns that no row touches.
    pub untouched: Vec<usize>,
    /// Rows without an entry.
    pub empty_rows: usize,
    /// The largest rank that numbers in these places can have.
    pub rank: usize,
    /// The underdetermined part (Dulmage-Mendelsohn), by its connected pieces, without
    /// the untouched columns.
    pub shortages: Vec<Shortage>,
}

impl Structure {
    /// Finds the structure of rows.
    ///
    /// # Source
    /// Dulmage & Mendelsohn (1958), coarse decomposition; matching by augmenting paths in
    /// layers (Hopcroft & Karp 1973).
    pub fn new<I: Index>(rows: &Rows<'_, I>) -> Self {
        let n = rows.columns();
        let (component, components) = components(rows);
        let by_column = Transposed::new(rows);
        let untouched: Vec<usize> = (0..n).filter(|&j| by_column.of(j).is_empty()).collect();
        let empty_rows = (0..rows.len())
            .filter(|&i| rows.row(i).next().is_none())
            .count();
        let matching = Matching::new(rows, &by_column);
        let rank = matching.row_of.iter().filter(|&&row| row != NONE).count();
        let shortages = matching.shortages(rows, &by_column);
        Self {
            component,
            components,
            untouched,
            empty_rows,
            rank,
            shortages,
        }
    }
}

/// The rows that touch each column.
pub(super) struct Transposed {
    start: Vec<usize>,
    row: Vec<usize>,
}

impl Transposed {
    pub(super) fn new<I: Index>(rows: &Rows<'_, I>) -> Self {
        let n = rows.columns();
        let mut start = vec![0; n + 1];
        for i in 0..rows.len() {
            for (j, _) in rows.row(i) {
                start[j + 1] += 1;
            }
        }
        for j in 0..n {
            start[j + 1] += start[j];
        }
        let mut next = start.clone();
        let mut row = vec![0; start[n]];
        for i in 0..rows.len() {
            for (j, _) in rows.row(i) {
                row[next[j]] = i;
                next[j] += 1;
            }
        }
        Self { start, row }
    }

    pub(super) fn of(&self, column: usize) -> &[usize] {
        &self.row[self.start[column]..self.start[column + 1]]
    }
}

/// Joins sets: the root of `x`, the path to it shortened.
pub(super) fn root(parent: &mut [usize], mut x: usize) -> usize {
    while parent[x] != x {
        parent[x] = parent[parent[x]];
        x = parent[x];
    }
    x
}

fn components<I: Index>(rows: &Rows<'_, I>) -> (Vec<usize>, usize) {
    let n = rows.columns();
    let mut parent: Vec<usize> = (0..n).collect();
    for i in 0..rows.len() {
        let mut columns = rows.row(i).map(|(j, _)| j);
        if let Some(first) = columns.next() {
            for j in columns {
                let (a, b) = (root(&mut parent, first), root(&mut parent, j));
                // The smaller is the root, so that components are numbered by it.
                parent[a.max(b)] = a.min(b);
            }
        }
    }
    let mut component = vec![0; n];
    let mut count = 0;
    for j in 0..n {
        let top = root(&mut parent, j);
        component[j] = if top == j {
            count += 1;
            count - 1
        } else {
            component[top]
        };
    }
    (component, count)
}

struct Matching {
    /// The row that each column is matched with.
    row_of: Vec<usize>,
    /// The column that each row is matched with.
    column_of: Vec<usize>,
}

impl Matching {
    fn new<I: Index>(rows: &Rows<'_, I>, by_column: &Transposed) -> Self {
        let (m, n) = (rows.len(), rows.columns());
        let mut found = Self {
            row_of: vec![NONE; n],
            column_of: vec![NONE; m],
        };
        for j in 0..n {
            if let Some(&i) = by_column
                .of(j)
                .iter()
                .find(|&&i| found.column_of[i] == NONE)
            {
                found.pair(j, i);
            }
        }
        let mut layer = vec![NONE; n];
        let mut next = vec![0; n];
        while found.layers(by_column, &mut layer) {
            next.fill(0);
            for j in 0..n {
                if found.row_of[j] == NONE {
                    found.augment(j, by_column, &mut layer, &mut next);
                }
            }
        }
        found
    }

    fn pair(&mut self, column: usize, row: usize) {
        self.row_of[column] = row;
        self.column_of[row] = column;
    }

    /// Distances, in columns, from the unmatched; whether a free row was reached.
    fn layers(&self, by_column: &Transposed, layer: &mut [usize]) -> bool {
        let mut front: Vec<usize> = Vec::new();
        for (j, place) in layer.iter_mut().enumerate() {
            *place = NONE;
            if self.row_of[j] == NONE && !by_column.of(j).is_empty() {
                *place = 0;
                front.push(j);
            }
        }
        let mut reached = false;
        let mut depth = 0;
        while !front.is_empty() && !reached {
            depth += 1;
            let mut following = Vec::new();
            for &j in &front {
                for &i in by_column.of(j) {
                    let other = self.column_of[i];
                    if other == NONE {
                        reached = true;
                    } else if layer[other] == NONE {
                        layer[other] = depth;
                        following.push(other);
                    }
                }
            }
            front = following;
        }
        reached
    }

    /// Looks for a path of increasing layers from a column to a free row; without
    /// recursion, as paths can be long.
    fn augment(
        &mut self,
        from: usize,
        by_column: &Transposed,
        layer: &mut [usize],
        next: &mut [usize],
    ) {
        let mut path = vec![from];
        while let Some(&j) = path.last() {
            let candidates = by_column.of(j);
            if next[j] == candidates.len() {
                layer[j] = NONE;
                path.pop();
                continue;
            }
            let i = candidates[next[j]];
            next[j] += 1;
            let other = self.column_of[i];
            if other == NONE {
                // Each column of the path takes the row it tried last.
                for &k in &path {
                    let row = by_column.of(k)[next[k] - 1];
                    self.pair(k, row);
                }
                return;
            }
            if layer[j] != NONE && layer[other] == layer[j] + 1 {
                path.push(other);
            }
        }
    }

    fn shortages<I: Index>(&self, rows: &Rows<'_, I>, by_column: &Transposed) -> Vec<Shortage> {
        let n = rows.columns();
        let mut piece = vec![NONE; n];
        let mut row_piece = vec![NONE; rows.len()];
        let mut parent: Vec<usize> = Vec::new();
        for start in 0..n {
            if self.row_of[start] != NONE || by_column.of(start).is_empty() || piece[start] != NONE
            {
                continue;
            }
            let own = parent.len();
            parent.push(own);
            piece[start] = own;
            let mut todo = vec![start];
            while let Some(j) = todo.pop() {
                for &i in by_column.of(j) {
                    if row_piece[i] != NONE {
                        let (a, b) = (root(&mut parent, own), root(&mut parent, row_piece[i]));
                        parent[a.max(b)] = a.min(b);
                        continue;
                    }
                    row_piece[i] = own;
                    let other = self.column_of[i];
                    if other != NONE && piece[other] == NONE {
                        piece[other] = own;
                        todo.push(other);
                    }
                }
            }
        }
        let mut found = vec![
            Shortage {
                columns: Vec::new(),
                rows: Vec::new(),
            };
            parent.len()
        ];
        for (j, &own) in piece.iter().enumerate() {
            if own != NONE {
                found[root(&mut parent, own)].columns.push(j);
            }
        }
        for (i, &own) in row_piece.iter().enumerate() {
            if own != NONE {
                found[root(&mut parent, own)].rows.push(i);
            }
        }
        found.retain(|shortage| !shortage.columns.is_empty());
        found
    }
}

#[cfg(test)]
#[allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap
)]
mod tests {
    use super::*;

    fn structure(columns: usize, lines: &[&[usize]]) -> Structure {
        let mut start = vec![0];
        let mut column = Vec::new();
        for line in lines {
            column.extend_from_slice(line);
            start.push(column.len());
        }
        let value = vec![1.0; column.len()];
        Structure::new(&Rows::new(columns, &start, &column, &value).unwrap())
    }

    #[test]
    fn what_no_row_touches_and_what_falls_apart() {
        let found = structure(5, &[&[0, 1], &[], &[3, 4], &[3], &[4]]);
        assert_eq!(found.untouched, [2]);
        assert_eq!(found.component, [0, 0, 1, 2, 2]);
        assert_eq!((found.components, found.empty_rows, found.rank), (3, 1, 3));
        assert_eq!(found.shortages.len(), 1);
        assert_eq!(found.shortages[0].columns, [0, 1]);
        assert_eq!(found.shortages[0].rows, [0]);
    }

    #[test]
    fn an_augmenting_path_is_found() {
        // Greedy matches 0-0 and 1-1; column 2 reaches only row 0.
        let found = structure(3, &[&[0, 2], &[0, 1], &[1]]);
        assert_eq!(found.rank, 3);
        assert!(found.shortages.is_empty());
    }

    #[test]
    fn the_overdetermined_rest_is_no_part_of_a_shortage() {
        let found = structure(5, &[&[0, 1, 2], &[1, 2], &[3], &[3, 4], &[4], &[2, 3]]);
        // Rows 0, 1, 5 touch 0, 1, 2: enough.
        assert!(found.shortages.is_empty());
        let found = structure(5, &[&[0, 1, 2], &[1, 2, 3], &[3], &[3, 4], &[4]]);
        assert_eq!(found.shortages[0].columns, [0, 1, 2]);
        assert_eq!(found.shortages[0].rows, [0, 1]);
    }
}
