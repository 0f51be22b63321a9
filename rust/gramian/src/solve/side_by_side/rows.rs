//! Rows of many problems side by side, reduced to a triangular factor of each.

use super::PIECE;
use crate::batch::lanes::{Block, Blocks, LANES, Lanes};
use crate::batch::simd::Path;
use crate::numbers::lane::Lane;
use crate::solve::gauss_newton::Loss;

/// Takes rows and residuals, and reduces them.
#[derive(Debug)]
pub struct Rows {
    pub(super) path: Path,
    pub(super) loss: Loss,
    pub(super) states: usize,
    /// Column after column of [`PIECE`] rows each, the residuals last.
    pub(super) piece: Blocks,
    pub(super) used: usize,
    /// The triangular factor, n rows of n + 1.
    pub(super) factor: Blocks,
    /// For each column.
    pub(super) sums: Blocks,
    /// Sum of the losses, and of the squares of what is no prior.
    pub(super) cost: Block,
    pub(super) data: Block,
    /// Whether the factor is wanted.
    pub(super) reduced: bool,
}

impl Rows {
    /// For `states`.
    pub fn new(states: usize, loss: Loss, path: Path) -> Self {
        Self {
            path,
            loss,
            states,
            piece: Blocks::zeros((states + 1) * PIECE),
            used: 0,
            factor: Blocks::zeros(states * (states + 1)),
            sums: Blocks::zeros(states + 1),
            cost: [0.0; LANES],
            data: [0.0; LANES],
            reduced: true,
        }
    }

    pub(super) fn clear(&mut self, reduced: bool) {
        self.used = 0;
        self.factor.fill([0.0; LANES]);
        (self.cost, self.data) = ([0.0; LANES], [0.0; LANES]);
        self.reduced = reduced;
    }

    /// Adds `count` rows, at most [`PIECE`], which `fill` writes: it is given memory whose
    /// entry `column * PIECE + row` belongs to a row of its and one of n + 1 columns, the
    /// residual the last, with anything in it. The loss touches what is `measured`, not
    /// what is known beforehand.
    pub fn add(&mut self, count: usize, measured: bool, fill: impl FnOnce(&mut [Block])) {
        if self.used + count > PIECE {
            self.reduce();
        }
        fill(&mut self.piece[self.used..]);
        let loss = if measured { self.loss } else { Loss::Squares };
        self.path.run(Weigh {
            loss,
            states: self.states,
            piece: &mut self.piece[self.used..],
            count,
            cost: &mut self.cost,
            data: measured.then_some(&mut self.data),
        });
        self.used += count;
    }

    pub(super) fn reduce(&mut self) {
        if self.reduced && self.used > 0 {
            // Whole fours of rows.
            let padded = self.used.next_multiple_of(4);
            for column in self.piece.chunks_exact_mut(PIECE) {
                column[self.used..padded].fill([0.0; LANES]);
            }
            self.path.run(Reflect {
                states: self.states,
                rows: padded,
                stride: PIECE,
                diagonal: false,
                piece: &mut self.piece,
                factor: &mut self.factor,
                sums: &mut self.sums,
            });
        }
        self.used = 0;
    }
}

/// Weighs rows by a loss, and adds up.
struct Weigh<'a> {
    loss: Loss,
    states: usize,
    piece: &'a mut [Block],
    count: usize,
    cost: &'a mut Block,
    data: Option<&'a mut Block>,
}

impl pulp::WithSimd for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let last = self.states * PIECE;
        let mut none = [0.0; LANES];
        let data = self.data.unwrap_or(&mut none);
        for part in 0..Lanes::<S>::PARTS {
            let mut cost = Lanes::load(simd, self.cost, part);
            let mut sum = Lanes::load(simd, data, part);
            for row in 0..self.count {
                let r = Lanes::load(simd, &self.piece[last + row], part);
                sum = Lane::mul_add(r, r, sum);
                if self.loss == Loss::Squares {
                    cost = Lane::mul_add(r, r, cost);
                    continue;
                }
                let (twice, weight) = self.loss.at(r);
                cost = cost + twice;
                let weight = Lane::sqrt(weight);
                for column in 0..=self.states {
                    let entry = &mut self.piece[column * PIECE + row];
                    (Lanes::load(simd, entry, part) * weight).store(entry, part);
                }
            }
            cost.store(self.cost, part);
            sum.store(data, part);
        }
    }
}

/// Reflects rows into a triangular factor.
///
/// A pass over the rows takes from the columns their parts along one, and at once adds up the
/// products with the next: all that its reflection needs.
pub(super) struct Reflect<'a> {
    pub(super) states: usize,
    /// A multiple of four.
    pub(super) rows: usize,
    /// From one column to the next.
    pub(super) stride: usize,
    /// Whether no row has anything before its own column.
    pub(super) diagonal: bool,
    pub(super) piece: &'a mut [Block],
    pub(super) factor: &'a mut [Block],
    /// A block a column.
    pub(super) sums: &'a mut [Block],
}

/// Rows in twos, each with a sum of its own.
type Two = [Block; 2];

/// The square of a column, less what it has along one before.
#[inline(always)]
fn square<S: pulp::Simd>(
    simd: S,
    part: usize,
    taken: Option<&[Two]>,
    column: &mut [Two],
    sum: &mut Block,
) {
    let along = Lanes::load(simd, sum, part);
    let mut totals = [Lanes::splat(simd, 0.0); 4];
    let fours = column.as_flattened_mut().as_chunks_mut::<4>().0;
    let taken = taken.map(|taken| taken.as_flattened().as_chunks::<4>().0);
    for i in 0..fours.len() {
        for k in 0..4 {
            let entry = &mut fours[i][k];
            let mut x = Lanes::load(simd, entry, part);
            if let Some(before) = taken {
                x = Lane::negate_mul_add(Lanes::load(simd, &before[i][k], part), along, x);
                x.store(entry, part);
            }
            totals[k] = Lane::mul_add(x, x, totals[k]);
        }
    }
    ((totals[0] + totals[1]) + (totals[2] + totals[3])).store(sum, part);
}

/// Products of a column with `K` others, less what these have along one before.
#[inline(always)]
#[allow(clippy::needless_pass_by_value)] // The columns are lent one by one.
fn products<S: pulp::Simd, const K: usize>(
    simd: S,
    part: usize,
    taken: Option<&[Two]>,
    column: &[Two],
    others: [&mut [Two]; K],
    sums: &mut [Block],
) {
    let zero = Lanes::splat(simd, 0.0);
    let (mut parts, mut totals) = ([zero; K], [[zero; K]; 2]);
    for k in 0..K {
        parts[k] = Lanes::load(simd, &sums[k], part);
    }
    if let Some(taken) = taken {
        for i in 0..column.len() {
            for h in 0..2 {
                let x = Lanes::load(simd, &column[i][h], part);
                let before = Lanes::load(simd, &taken[i][h], part);
                for k in 0..K {
                    let entry = &mut others[k][i][h];
                    let y = Lanes::load(simd, entry, part);
                    let y = Lane::negate_mul_add(before, parts[k], y);
                    y.store(entry, part);
                    totals[h][k] = Lane::mul_add(x, y, totals[h][k]);
                }
            }
        }
    } else {
        for i in 0..column.len() {
            for h in 0..2 {
                let x = Lanes::load(simd, &column[i][h], part);
                for k in 0..K {
                    let y = Lanes::load(simd, &others[k][i][h], part);
                    totals[h][k] = Lane::mul_add(x, y, totals[h][k]);
                }
            }
        }
    }
    for k in 0..K {
        (totals[0][k] + totals[1][k]).store(&mut sums[k], part);
    }
}

/// The next `K` columns, `pairs` of rows of each, and what is behind them.
#[inline(always)]
fn columns<const K: usize>(
    mut rest: &mut [Block],
    stride: usize,
    pairs: usize,
) -> ([&mut [Two]; K], &mut [Block]) {
    let columns = core::array::from_fn(|_| {
        let (column, behind) = core::mem::take(&mut rest).split_at_mut(stride);
        rest = behind;
        &mut column.as_chunks_mut().0[..pairs]
    });
    (columns, rest)
}

impl Reflect<'_> {
    /// The square of a column, and its products with those behind, less what they have along
    /// the one before.
    #[inline(always)]
    fn pass<S: pulp::Simd>(&mut self, simd: S, part: usize, j: usize, rows: usize) {
        let (stride, pairs) = (self.stride, rows / 2);
        let (head, tail) = self.piece.split_at_mut(j * stride);
        let before = j.checked_sub(1).map(|j| &head[j * stride..][..stride]);
        let before = before.map(|before| &before.as_chunks().0[..pairs]);
        let ([column], mut rest) = columns(tail, stride, pairs);
        square(simd, part, before, column, &mut self.sums[j]);
        for sums in self.sums[j + 1..=self.states].chunks_mut(4) {
            rest = match sums.len() {
                1 => {
                    let (others, behind) = columns::<1>(rest, stride, pairs);
                    products(simd, part, before, column, others, sums);
                    behind
                }
                2 => {
                    let (others, behind) = columns::<2>(rest, stride, pairs);
                    products(simd, part, before, column, others, sums);
                    behind
                }
                3 => {
                    let (others, behind) = columns::<3>(rest, stride, pairs);
                    products(simd, part, before, column, others, sums);
                    behind
                }
                _ => {
                    let (others, behind) = columns::<4>(rest, stride, pairs);
                    products(simd, part, before, column, others, sums);
                    behind
                }
            };
        }
    }
}

impl pulp::WithSimd for Reflect<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, simd: S) {
        let n = self.states;
        let wide = n + 1;
        let zero = Lanes::splat(simd, 0.0);
        for part in 0..Lanes::<S>::PARTS {
            for j in 0..n {
                let rows = if self.diagonal {
                    (j + 1).next_multiple_of(4)
                } else {
                    self.rows
                };
                self.pass(simd, part, j, rows);
                let line = &mut self.factor[j * wide..][..wide];
                let pivot = Lanes::load(simd, &line[j], part);
                let below = Lanes::load(simd, &self.sums[j], part);
                let norm = Lane::sqrt(Lane::mul_add(pivot, pivot, below));
                let alpha = pivot.select_greater(zero, -norm, norm);
                let first = pivot - alpha;
                // Of a column that is zero, or whose square is, nothing is taken.
                let share = Lane::recip_or_zero(norm * first.abs());
                alpha.store(&mut line[j], part);
                for (entry, sum) in line[j + 1..].iter_mut().zip(&mut self.sums[j + 1..]) {
                    let above = Lanes::load(simd, entry, part);
                    let below = Lanes::load(simd, sum, part);
                    let along = Lane::mul_add(first, above, below) * share;
                    Lane::negate_mul_add(along, first, above).store(entry, part);
                    along.store(sum, part);
                }
            }
        }
    }
}
