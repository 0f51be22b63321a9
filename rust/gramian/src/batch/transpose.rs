//! From one trial after the other to one trial in each lane of a register, and back.
//!
//! Number i of the trials in the lanes is at `[i * S::F64_LANES..]`. Which lane a
//! trial is in does not matter, as long as all its numbers are in the same.

use alloc::vec::Vec;
use core::mem::align_of;

use pulp::Simd;

use super::lanes::{Block, LANES, Lanes};

/// Numbers that are turned at once.
const STEP: usize = 4;
type Square = Aligned<[[f64; STEP]; LANES]>;

/// Registers that lie across two lines of the cache cost twice as much to load and
/// to store; whether they do would depend on chance.
#[repr(align(64))]
#[derive(Clone, Copy, Debug)]
pub struct Aligned<T>(pub T);

/// Buffers of so many numbers each, cut from one that is aligned. Where the sizes are
/// multiples of the lanes all of them are. What is in them is left as it was.
pub fn buffers<const B: usize>(space: &mut Vec<f64>, sizes: [usize; B]) -> [&mut [f64]; B] {
    let total = sizes.iter().sum::<usize>() + LANES;
    if space.len() < total {
        space.resize(total, 0.0);
    }
    // Where the place cannot be told, any will do.
    let skip = space
        .as_ptr()
        .align_offset(align_of::<Aligned<f64>>())
        .min(LANES);
    let mut rest = &mut space[skip..];
    sizes.map(|size| {
        let (buffer, others) = core::mem::take(&mut rest).split_at_mut(size);
        rest = others;
        buffer
    })
}

/// Puts the numbers `from[trial]`, equally many for each, into lanes.
#[inline(always)]
pub fn into_lanes<S: Simd>(simd: S, from: &[&[f64]; LANES], packed: &mut [f64]) {
    let lanes = S::F64_LANES;
    let count = from[0].len();
    let (whole, rest) = (count / STEP, count % STEP);
    let mut square = Aligned([[0.0; STEP]; LANES]);
    let mut chunks = [from[0].as_chunks::<STEP>().0; LANES];
    for lane in 0..lanes {
        chunks[lane] = &from[lane].as_chunks::<STEP>().0[..whole];
    }
    let (to, to_rest) = packed.split_at_mut(whole * STEP * lanes);
    for (i, to) in to.chunks_exact_mut(STEP * lanes).enumerate() {
        for lane in 0..lanes {
            square.0[lane] = chunks[lane][i];
        }
        let columns = columns(simd, &square);
        let (to, _) = S::as_mut_simd_f64s(to);
        to.copy_from_slice(&columns);
    }
    if rest > 0 {
        for lane in 0..lanes {
            for i in 0..rest {
                square.0[lane][i] = from[lane][whole * STEP + i];
            }
        }
        let columns = columns(simd, &square);
        let (to, _) = S::as_mut_simd_f64s(to_rest);
        to[..rest].copy_from_slice(&columns[..rest]);
    }
}

#[inline(always)]
fn columns<S: Simd>(simd: S, square: &Square) -> [S::f64s; STEP] {
    let (rows, _) = S::as_simd_f64s(square.0.as_flattened());
    simd.deinterleave_shfl_f64s([rows[0], rows[1], rows[2], rows[3]])
}

/// Takes `count` numbers of each trial out of the lanes: those of trial k to
/// `out[k * stride..]`, for as many trials as there are.
#[inline(always)]
pub fn out_of_lanes<S: Simd>(
    simd: S,
    packed: &[f64],
    count: usize,
    stride: usize,
    out: &mut [f64],
) {
    let lanes = S::F64_LANES;
    let trials = lanes.min(out.len().div_ceil(stride));
    let (whole, rest) = (count / STEP, count % STEP);
    let mut square = Aligned([[0.0; STEP]; LANES]);
    let (from, from_rest) = packed.split_at(whole * STEP * lanes);
    for (i, from) in from.chunks_exact(STEP * lanes).enumerate() {
        let (from, _) = S::as_simd_f64s(from);
        rows(simd, [from[0], from[1], from[2], from[3]], &mut square);
        for lane in 0..trials {
            let to = &mut out[lane * stride + i * STEP..][..STEP];
            to.copy_from_slice(&square.0[lane]);
        }
    }
    if rest > 0 {
        let (from, _) = S::as_simd_f64s(from_rest);
        let mut columns = [from[0]; STEP];
        columns[..rest].copy_from_slice(&from[..rest]);
        rows(simd, columns, &mut square);
        for lane in 0..trials {
            for i in 0..rest {
                out[lane * stride + whole * STEP + i] = square.0[lane][i];
            }
        }
    }
}

#[inline(always)]
fn rows<S: Simd>(simd: S, columns: [S::f64s; STEP], square: &mut Square) {
    let rows = simd.interleave_shfl_f64s(columns);
    let (to, _) = S::as_mut_simd_f64s(square.0.as_flattened_mut());
    to[..STEP].copy_from_slice(&rows);
}

/// Four columns on their way to rows.
pub struct Turning(Square);

impl Turning {
    /// Without any.
    #[inline(always)]
    pub fn empty() -> Self {
        Self(Aligned([[0.0; STEP]; LANES]))
    }

    /// Takes the lanes of part `part` of four columns.
    #[inline(always)]
    pub fn fill<S: Simd>(&mut self, simd: S, columns: &[Block; STEP], part: usize) {
        let mut registers = [simd.splat_f64s(0.0); STEP];
        for k in 0..STEP {
            registers[k] = S::as_simd_f64s(&columns[k]).0[part];
        }
        rows(simd, registers, &mut self.0);
    }

    /// Takes four columns of one register each.
    #[inline(always)]
    pub fn take<S: Simd>(&mut self, simd: S, columns: &[Lanes<S>; STEP]) {
        let [a, b, c, d] = *columns;
        let registers = [a.register(), b.register(), c.register(), d.register()];
        rows(simd, registers, &mut self.0);
    }

    /// The rows, in the order of [`order`].
    #[inline(always)]
    pub fn rows(&self) -> &[[f64; STEP]; LANES] {
        &self.0.0
    }
}

/// Which lane each of the rows of [`Turning`] is of.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Small whole numbers.
pub fn order<S: Simd>(simd: S) -> [usize; LANES] {
    let mut turning = Turning::empty();
    let lanes: Block = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    turning.fill(simd, &[lanes; STEP], 0);
    let mut order = [0; LANES];
    for (order, row) in order.iter_mut().zip(turning.rows()) {
        *order = row[0] as usize;
    }
    order
}

/// The same numbers in all lanes.
#[inline(always)]
pub fn in_all_lanes<S: Simd>(simd: S, from: &[f64], packed: &mut [f64]) {
    let (to, _) = S::as_mut_simd_f64s(packed);
    for (to, &from) in to.iter_mut().zip(from) {
        *to = simd.splat_f64s(from);
    }
}

#[cfg(test)]
mod tests {
    use alloc::vec;
    use alloc::vec::Vec;

    use super::*;
    use crate::batch::simd::Path;

    struct Turn<'a> {
        count: usize,
        trials: &'a [f64],
        back: &'a mut [f64],
    }

    impl pulp::WithSimd for Turn<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let Self {
                count,
                trials,
                back,
            } = self;
            let all = trials.len() / count;
            let mut from = [trials; LANES];
            for lane in 0..LANES {
                from[lane] = &trials[lane.min(all - 1) * count..][..count];
            }
            let mut packed = vec![f64::NAN; S::F64_LANES * count];
            into_lanes(simd, &from, &mut packed);
            // A register holds one number of each trial.
            for (i, number) in packed.chunks_exact(S::F64_LANES).enumerate() {
                for value in number {
                    assert!((0..all).any(|trial| trials[trial * count + i] == *value));
                }
            }
            out_of_lanes(simd, &packed, count, count + 1, back);
        }
    }

    #[test]
    fn what_is_turned_back_is_as_it_was() {
        for path in Path::available() {
            for count in [1, 3, 4, 9, 16] {
                for all in [1, 3, 8] {
                    let trials: Vec<f64> = (0..all * count).map(|i| i as f64).collect();
                    let mut back = vec![-1.0; all * (count + 1)];
                    path.run(Turn {
                        count,
                        trials: &trials,
                        back: &mut back,
                    });
                    let lanes = match path {
                        Path::Plain => 1,
                        Path::Avx2 => 4,
                        _ => 8,
                    };
                    for trial in 0..all {
                        let (back, gap) = back[trial * (count + 1)..].split_at(count);
                        assert_eq!(gap[0], -1.0);
                        let wanted = &trials[trial * count..][..count];
                        if trial < lanes {
                            assert_eq!(back, wanted, "{path:?} {count} {all}");
                        }
                    }
                }
            }
        }
    }
}
