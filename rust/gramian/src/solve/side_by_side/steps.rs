//! Damped steps of many problems side by side, from their triangular factors.

use crate::batch::lanes::{Block, Lanes};
use crate::numbers::lane::Lane;

/// Rows that damp a step: a diagonal in units of the columns.
pub(super) struct Damp<'a> {
    pub(super) states: usize,
    pub(super) stride: usize,
    pub(super) factor: &'a [Block],
    pub(super) damping: &'a Block,
    pub(super) piece: &'a mut [Block],
}

impl pulp::WithSimd for Damp<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let (n, wide) = (self.states, self.states + 1);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        for part in 0..Lanes::<S>::PARTS {
            let damping = Lanes::load(simd, self.damping, part);
            for j in 0..n {
                let square = column_square(simd, part, self.factor, wide, j);
                let size = square.select_greater(zero, square, one);
                let entry = &mut self.piece[j * self.stride + j];
                Lane::sqrt(damping * size).store(entry, part);
            }
        }
    }
}

/// The square of a column of a triangular factor.
#[inline(always)]
fn column_square<S: pulp::Simd>(
    simd: S,
    part: usize,
    factor: &[Block],
    wide: usize,
    j: usize,
) -> Lanes<S> {
    let mut square = Lanes::splat(simd, 0.0);
    for i in 0..=j {
        let entry = Lanes::load(simd, &factor[i * wide + j], part);
        square = Lane::mul_add(entry, entry, square);
    }
    square
}

/// Steps by back substitution, and what the rows foretell of them.
pub(super) struct Descend<'a> {
    pub(super) states: usize,
    pub(super) factor: &'a [Block],
    /// The factor of the rows and those that damp, and above zero where it counts.
    pub(super) damped: &'a [Block],
    pub(super) damping: &'a Block,
    /// Above zero where there is a step.
    pub(super) moves: &'a Block,
    pub(super) x: &'a [Block],
    pub(super) step: &'a mut [Block],
    pub(super) next: &'a mut [Block],
    pub(super) foretold: &'a mut Block,
}

impl Descend<'_> {
    #[inline(always)]
    fn entry<S: pulp::Simd>(&self, simd: S, part: usize, damping: Lanes<S>, at: usize) -> Lanes<S> {
        let damped = Lanes::load(simd, &self.damped[at], part);
        let plain = Lanes::load(simd, &self.factor[at], part);
        damping.select_greater(Lanes::splat(simd, 0.0), damped, plain)
    }
}

impl pulp::WithSimd for Descend<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let (n, wide) = (self.states, self.states + 1);
        let zero = Lanes::splat(simd, 0.0);
        for part in 0..Lanes::<S>::PARTS {
            let damping = Lanes::load(simd, self.damping, part);
            let moves = Lanes::load(simd, self.moves, part);
            for i in (0..n).rev() {
                let from = i * wide;
                let mut sum = self.entry(simd, part, damping, from + n);
                for j in i + 1..n {
                    let step = Lanes::load(simd, &self.step[j], part);
                    let entry = self.entry(simd, part, damping, from + j);
                    sum = Lane::negate_mul_add(entry, step, sum);
                }
                // A state without a pivot stays.
                let pivot = self.entry(simd, part, damping, from + i);
                let step = pivot.abs().select_greater(zero, sum / pivot, zero);
                step.store(&mut self.step[i], part);
                let x = Lanes::load(simd, &self.x[i], part);
                moves
                    .select_greater(zero, x + step, x)
                    .store(&mut self.next[i], part);
            }
            let mut foretold = zero;
            for i in 0..n {
                let line = &self.factor[i * wide..][..wide];
                let mut along = zero;
                for j in i..n {
                    let step = Lanes::load(simd, &self.step[j], part);
                    along = Lane::mul_add(Lanes::load(simd, &line[j], part), step, along);
                }
                let left = Lanes::load(simd, &line[n], part);
                foretold = Lane::mul_add(along, (left + left) - along, foretold);
            }
            foretold.store(self.foretold, part);
        }
    }
}

/// What a triangular factor says.
#[derive(Default)]
pub(super) struct Seen {
    /// NaN where an entry is not finite.
    pub(super) sound: Block,
    /// Square of the undamped step, in deviations.
    pub(super) decrease: Block,
    /// Above zero where no column depends on those before it.
    pub(super) full: Block,
}

pub(super) struct Review<'a> {
    pub(super) states: usize,
    pub(super) factor: &'a [Block],
    pub(super) seen: &'a mut Seen,
}

impl pulp::WithSimd for Review<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let (n, wide) = (self.states, self.states + 1);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        for part in 0..Lanes::<S>::PARTS {
            let (mut sound, mut full) = (zero, one);
            for j in 0..n {
                let square = column_square(simd, part, self.factor, wide, j);
                let pivot = Lanes::load(simd, &self.factor[j * wide + j], part);
                let least = Lane::times(square, 1e-24);
                full = (pivot * pivot).select_greater(least, full, zero);
            }
            let mut decrease = zero;
            for i in 0..n {
                for j in i..wide {
                    let entry = Lanes::load(simd, &self.factor[i * wide + j], part);
                    sound = Lane::mul_add(entry, zero, sound);
                }
                let left = Lanes::load(simd, &self.factor[i * wide + n], part);
                decrease = Lane::mul_add(left, left, decrease);
            }
            sound.store(&mut self.seen.sound, part);
            full.store(&mut self.seen.full, part);
            decrease.store(&mut self.seen.decrease, part);
        }
    }
}

/// Copies the lanes that are above zero in `which`.
pub(super) struct Keep<'a> {
    pub(super) which: &'a Block,
    pub(super) from: &'a [Block],
    pub(super) to: &'a mut [Block],
}

impl pulp::WithSimd for Keep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let zero = Lanes::splat(simd, 0.0);
        for part in 0..Lanes::<S>::PARTS {
            let which = Lanes::load(simd, self.which, part);
            for (from, to) in self.from.iter().zip(self.to.iter_mut()) {
                let (new, old) = (Lanes::load(simd, from, part), Lanes::load(simd, to, part));
                which.select_greater(zero, new, old).store(to, part);
            }
        }
    }
}
