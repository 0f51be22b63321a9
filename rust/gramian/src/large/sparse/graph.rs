//! Bridges and cut vertices: where one more measurement helps most.

use alloc::vec;
use alloc::vec::Vec;

use super::structure::NONE;

/// What holds a graph together at one place only.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Weak {
    /// Edges (by their numbers) without which the graph falls apart.
    pub bridges: Vec<usize>,
    /// For each bridge, how many vertices are on its smaller side.
    pub hanging: Vec<usize>,
    /// Vertices without which it falls apart, increasing.
    pub cut_vertices: Vec<usize>,
}

/// Finds the bridges and cut vertices of a graph of `vertices` by its `edges`; two edges
/// between the same vertices make no bridge.
///
/// # Source
/// Tarjan (1974); without recursion, as chains are long.
pub fn weak_places(vertices: usize, edges: &[(usize, usize)]) -> Weak {
    let mut start = vec![0; vertices + 1];
    for &(a, b) in edges {
        start[a + 1] += 1;
        start[b + 1] += 1;
    }
    for v in 0..vertices {
        start[v + 1] += start[v];
    }
    let mut next = start.clone();
    let mut to = vec![(0, 0); start[vertices]];
    for (e, &(a, b)) in edges.iter().enumerate() {
        to[next[a]] = (b, e);
        next[a] += 1;
        to[next[b]] = (a, e);
        next[b] += 1;
    }
    let mut entered = vec![NONE; vertices];
    let mut low = vec![NONE; vertices];
    let mut below = vec![1usize; vertices];
    let mut cut = vec![false; vertices];
    let mut cursor = start.clone();
    let mut time = 0;
    let mut weak = Weak::default();
    for top in 0..vertices {
        if entered[top] != NONE {
            continue;
        }
        let first_bridge = weak.bridges.len();
        let mut roots = 0;
        let mut stack = vec![(top, NONE)];
        entered[top] = time;
        low[top] = time;
        time += 1;
        while let Some(&(v, edge)) = stack.last() {
            if cursor[v] < start[v + 1] {
                let (w, e) = to[cursor[v]];
                cursor[v] += 1;
                if e == edge {
                    continue;
                }
                if entered[w] == NONE {
                    entered[w] = time;
                    low[w] = time;
                    time += 1;
                    stack.push((w, e));
                } else {
                    low[v] = low[v].min(entered[w]);
                }
                continue;
            }
            stack.pop();
            if let Some(&(parent, _)) = stack.last() {
                low[parent] = low[parent].min(low[v]);
                below[parent] += below[v];
                if low[v] > entered[parent] {
                    weak.bridges.push(edge);
                    weak.hanging.push(below[v]);
                }
                if parent == top {
                    roots += 1;
                } else if low[v] >= entered[parent] {
                    cut[parent] = true;
                }
            }
        }
        cut[top] = roots > 1;
        for hanging in &mut weak.hanging[first_bridge..] {
            *hanging = (*hanging).min(below[top] - *hanging);
        }
    }
    weak.cut_vertices = (0..vertices).filter(|&v| cut[v]).collect();
    weak
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rings_joined_by_one_edge() {
        let edges = [
            (0, 1),
            (1, 2),
            (2, 0),
            (2, 3),
            (3, 4),
            (4, 5),
            (5, 3),
            (5, 6),
            (5, 6),
        ];
        let weak = weak_places(8, &edges);
        assert_eq!(weak.bridges, [3]);
        assert_eq!(weak.hanging, [3]);
        assert_eq!(weak.cut_vertices, [2, 3, 5]);
    }
}
