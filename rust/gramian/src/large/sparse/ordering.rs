//! In which order to eliminate the columns, so that little fills in.

use alloc::vec;
use alloc::vec::Vec;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

use super::structure::{NONE, Transposed};
use super::{Index, Rows};

/// Columns and their neighbours: those that share a row with them.
#[derive(Clone, Debug)]
pub(super) struct Graph {
    pub start: Vec<usize>,
    pub neighbour: Vec<usize>,
}

impl Graph {
    /// The graph of A^T A. Rows so long that they would join nearly everything are left
    /// out: they fill the end of the factor in any order (Davis, COLAMD, section 2).
    pub fn of_columns<I: Index>(rows: &Rows<'_, I>) -> Self {
        let n = rows.columns();
        let longest = 64 + 10 * n.isqrt();
        let by_column = Transposed::new(rows);
        let length: Vec<usize> = (0..rows.len()).map(|i| rows.row(i).count()).collect();
        let mut start = Vec::with_capacity(n + 1);
        start.push(0);
        let mut neighbour = Vec::new();
        let mut seen = vec![NONE; n];
        for j in 0..n {
            seen[j] = j;
            for &i in by_column.of(j) {
                if length[i] > longest {
                    continue;
                }
                for (k, _) in rows.row(i) {
                    if seen[k] != j {
                        seen[k] = j;
                        neighbour.push(k);
                    }
                }
            }
            start.push(neighbour.len());
        }
        Self { start, neighbour }
    }

    pub fn len(&self) -> usize {
        self.start.len() - 1
    }

    pub fn of(&self, vertex: usize) -> &[usize] {
        &self.neighbour[self.start[vertex]..self.start[vertex + 1]]
    }
}

/// Approximate minimum degree (Amestoy, Davis & Duff 1996), as faer has it. `None` where
/// memory does not suffice.
pub(super) fn minimum_degree(graph: &Graph) -> Option<Vec<usize>> {
    let n = graph.len();
    let mut order = vec![0; n];
    let mut inverse = vec![0; n];
    let pattern =
        SymbolicSparseColMatRef::new_unsorted_checked(n, n, &graph.start, None, &graph.neighbour);
    let scratch = amd::order_maybe_unsorted_scratch::<usize>(n, graph.neighbour.len());
    let mut memory = MemBuffer::try_new(scratch).ok()?;
    amd::order_maybe_unsorted(
        &mut order,
        &mut inverse,
        pattern,
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .ok()?;
    Some(order)
}

/// Subgraphs of at most so many columns are ordered by minimum degree.
const LEAF: usize = 1500;

/// Nested dissection (George 1973): halves first, what separates them last. A half is cut
/// where the distances to two far ends are equal, which is straight on a grid.
pub(super) fn nested_dissection(graph: &Graph) -> Option<Vec<usize>> {
    let n = graph.len();
    // Filled from the end: separators before what they separate.
    let mut order = vec![0; n];
    let mut end = n;
    // The part that each column is in; parts are numbered as they appear.
    let mut part = vec![0; n];
    let mut parts = 1;
    let mut stack: Vec<Vec<usize>> = vec![(0..n).collect()];
    let mut near = vec![NONE; n];
    let mut far = vec![NONE; n];
    let mut local = vec![0; n];
    while let Some(own) = stack.pop() {
        let label = own.first().map_or(0, |&v| part[v]);
        if own.len() <= LEAF {
            let leaf = leaf_order(graph, &own, label, &part, &mut local)?;
            end -= leaf.len();
            order[end..end + leaf.len()].copy_from_slice(&leaf);
            continue;
        }
        let reached = distances(graph, own[0], label, &part, &mut near, &own);
        if reached.len() < own.len() {
            // Another component: apart, with no separator.
            for &v in &reached {
                part[v] = parts;
            }
            parts += 1;
            let rest = own.iter().copied().filter(|&v| part[v] == label).collect();
            stack.push(rest);
            stack.push(reached);
            continue;
        }
        let one = reached[reached.len() - 1];
        let reached = distances(graph, one, label, &part, &mut near, &own);
        let other = reached[reached.len() - 1];
        distances(graph, other, label, &part, &mut far, &own);
        let mut sorted = own;
        sorted.sort_by_key(|&v| (near[v].cast_signed() - far[v].cast_signed(), near[v], v));
        let (left, right) = (parts, parts + 1);
        parts += 2;
        let middle = sorted.len() / 2;
        for (k, &v) in sorted.iter().enumerate() {
            part[v] = if k < middle { left } else { right };
        }
        // The side of the cut with fewer columns at it becomes the separator.
        let border = |from: usize, to: usize| -> Vec<usize> {
            sorted
                .iter()
                .copied()
                .filter(|&v| part[v] == from && graph.of(v).iter().any(|&w| part[w] == to))
                .collect()
        };
        let (a, b) = (border(left, right), border(right, left));
        let separator = if a.len() <= b.len() { a } else { b };
        for &v in &separator {
            part[v] = NONE;
        }
        end -= separator.len();
        order[end..end + separator.len()].copy_from_slice(&separator);
        for side in [left, right] {
            let half: Vec<usize> = sorted
                .iter()
                .copied()
                .filter(|&v| part[v] == side)
                .collect();
            if !half.is_empty() {
                stack.push(half);
            }
        }
    }
    Some(order)
}

/// Distances inside a part; the columns that were reached, the farthest last.
fn distances(
    graph: &Graph,
    from: usize,
    label: usize,
    part: &[usize],
    distance: &mut [usize],
    own: &[usize],
) -> Vec<usize> {
    for &v in own {
        distance[v] = NONE;
    }
    distance[from] = 0;
    let mut queue = vec![from];
    let mut next = 0;
    while next < queue.len() {
        let v = queue[next];
        next += 1;
        for &w in graph.of(v) {
            if part[w] == label && distance[w] == NONE {
                distance[w] = distance[v] + 1;
                queue.push(w);
            }
        }
    }
    queue
}

fn leaf_order(
    graph: &Graph,
    own: &[usize],
    label: usize,
    part: &[usize],
    local: &mut [usize],
) -> Option<Vec<usize>> {
    for (k, &v) in own.iter().enumerate() {
        local[v] = k;
    }
    let mut inside = Graph {
        start: vec![0],
        neighbour: Vec::new(),
    };
    for &v in own {
        let near = graph.of(v).iter().filter(|&&w| part[w] == label);
        inside.neighbour.extend(near.map(|&w| local[w]));
        inside.start.push(inside.neighbour.len());
    }
    let order = minimum_degree(&inside)?;
    Some(order.into_iter().map(|k| own[k]).collect())
}
