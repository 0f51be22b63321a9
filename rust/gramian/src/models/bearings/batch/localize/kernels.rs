//! The sums over the bearings of one trial, on vectors of samples.

use alloc::vec;
use alloc::vec::Vec;

use crate::batch::lanes::{Block, LANES, Lanes, total};
use crate::numbers::lane::Lane;

/// Columns of a working array at most: states, and the right-hand side.
pub const MAX: usize = 9;

/// The bearings of one trial, in units that keep every number near one: times
/// over the span, observer displacement over its largest.
#[derive(Debug)]
pub struct Samples {
    /// Blocks that each field has.
    pub blocks: usize,
    data: Vec<Block>,
}

/// The fields of [`Samples`].
#[derive(Clone, Copy, Debug)]
pub enum Field {
    /// Sine of the bearing.
    Sine,
    /// Cosine of the bearing.
    Cosine,
    /// 1 / sigma; 0 behind the last sample.
    Weight,
    /// Time since the first sample.
    Time,
    /// East displacement of the observer since the first sample.
    East,
    /// North displacement.
    North,
}

impl Samples {
    const FIELDS: usize = 6;

    /// Room for `count` samples.
    pub fn new(count: usize) -> Self {
        let blocks = count.div_ceil(LANES).max(1);
        Self {
            blocks,
            data: vec![[0.0; LANES]; Self::FIELDS * blocks],
        }
    }

    /// One field.
    #[inline(always)]
    pub fn field(&self, field: Field) -> &[Block] {
        &self.data[field as usize * self.blocks..][..self.blocks]
    }

    /// All fields, in their order, of one part of a block.
    #[inline(always)]
    fn load<S: pulp::Simd>(&self, simd: S, block: usize, part: usize) -> [Lanes<S>; 6] {
        let mut out = [Lanes::splat(simd, 0.0); Self::FIELDS];
        for (field, out) in out.iter_mut().enumerate() {
            *out = Lanes::load(simd, &self.data[field * self.blocks + block], part);
        }
        out
    }

    /// One field, sample by sample, the padding included.
    pub fn field_mut(&mut self, field: Field) -> &mut [f64] {
        self.data[field as usize * self.blocks..][..self.blocks].as_flattened_mut()
    }
}

/// Sine and cosine of the angles that [`Field::Sine`] holds, put in place.
pub struct Directions<'a>(pub &'a mut Samples);

impl pulp::WithSimd for Directions<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let blocks = self.0.blocks;
        let (sines, rest) = self.0.data.split_at_mut(blocks);
        for (sine, cosine) in sines.iter_mut().zip(rest) {
            for part in 0..Lanes::<S>::PARTS {
                let (s, c) = Lanes::load(simd, sine, part).sin_cos();
                s.store(sine, part);
                c.store(cosine, part);
            }
        }
    }
}

/// The exact directions of the target of a model, into [`Field::Sine`] and
/// [`Field::Cosine`]; NaN where it is on the observer.
pub struct Exact<'a, const N: usize>(pub &'a mut Samples, pub &'a [f64; MAX]);

impl<const N: usize> pulp::WithSimd for Exact<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let blocks = self.0.blocks;
        let h = splat(simd, self.1);
        let (sines, rest) = self.0.data.split_at_mut(blocks);
        let (cosines, rest) = rest.split_at_mut(blocks);
        for i in 0..blocks {
            for part in 0..Lanes::<S>::PARTS {
                // Behind sine and cosine: weight, time, east, north.
                let time = Lanes::load(simd, &rest[blocks + i], part);
                let de = Lanes::load(simd, &rest[2 * blocks + i], part);
                let dn = Lanes::load(simd, &rest[3 * blocks + i], part);
                let (east, north) = place::<S, N>(&h, time, de, dn);
                let square = east.mul_add(east, north * north);
                // Closer than rounding is on it.
                let square = square.select_greater(
                    Lanes::splat(simd, 1e-28),
                    square,
                    Lanes::splat(simd, f64::NAN),
                );
                let range = square.sqrt();
                (east / range).store(&mut sines[i], part);
                (north / range).store(&mut cosines[i], part);
            }
        }
    }
}

#[inline(always)]
fn splat<S: pulp::Simd>(simd: S, model: &[f64; MAX]) -> [Lanes<S>; MAX] {
    let mut out = [Lanes::splat(simd, 0.0); MAX];
    for (out, &x) in out.iter_mut().zip(model) {
        *out = Lanes::splat(simd, x);
    }
    out
}

/// Where the target is, relative to the observer, in units of the first range.
#[inline(always)]
fn place<S: pulp::Simd, const N: usize>(
    h: &[Lanes<S>; MAX],
    time: Lanes<S>,
    de: Lanes<S>,
    dn: Lanes<S>,
) -> (Lanes<S>, Lanes<S>) {
    let mut east = h[N].negate_mul_add(de, h[0]);
    let mut north = h[N].negate_mul_add(dn, h[1]);
    let powers = powers(time);
    for order in 1..N / 2 {
        east = h[2 * order].mul_add(powers[order - 1], east);
        north = h[2 * order + 1].mul_add(powers[order - 1], north);
    }
    (east, north)
}

/// The exact directions of [`Field::Sine`] and [`Field::Cosine`] turned by the
/// angles in `noise`.
pub struct Turn<'a>(pub &'a mut Samples, pub &'a [Block]);

impl pulp::WithSimd for Turn<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let blocks = self.0.blocks;
        let (sines, rest) = self.0.data.split_at_mut(blocks);
        for ((sine, cosine), noise) in sines.iter_mut().zip(rest).zip(self.1) {
            for part in 0..Lanes::<S>::PARTS {
                let (s, c) = Lanes::load(simd, noise, part).sin_cos();
                let (s0, c0) = (
                    Lanes::load(simd, sine, part),
                    Lanes::load(simd, cosine, part),
                );
                s0.mul_add(c, c0 * s).store(sine, part);
                s0.negate_mul_add(s, c0 * c).store(cosine, part);
            }
        }
    }
}

/// Whitened rows at a model and whitened residuals, into `columns`; gives the
/// sum of squared residuals, and the bending below (its upper triangle).
///
/// The model is (u, w1, .., s), see the parent module: the target's place p is
/// linear in it. With z = `p_north` + i `p_east` the bearing is Im log z, and
/// dz/z = a + i b for a parameter gives its derivative b and the second ones,
/// -(a b' + b a'). With residual e the Hessian of half the squares is therefore
///
/// ```text
/// sum b b^T + sum e (a b^T + b a^T),
/// ```
///
/// the information and the bending. Where the range is hardly known the second
/// is as large as the first along it, and steps without it crawl.
pub struct Linearize<'a, const N: usize> {
    pub samples: &'a Samples,
    pub model: &'a [f64; MAX],
    pub columns: &'a mut [Block],
}

impl<const N: usize> pulp::WithSimd for Linearize<'_, N> {
    type Output = (f64, [[f64; N]; N]);

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Self::Output {
        let Self {
            samples,
            model,
            columns,
        } = self;
        let blocks = samples.blocks;
        let h = splat(simd, model);
        let mut sum = [0.0; LANES];
        let mut sums = [[[0.0; LANES]; N]; N];
        for part in 0..Lanes::<S>::PARTS {
            let mut cost = Lanes::splat(simd, 0.0);
            let mut bending = [[Lanes::splat(simd, 0.0); N]; N];
            for i in 0..blocks {
                let [sine, cosine, weight, time, de, dn] = samples.load(simd, i, part);
                let (east, north) = place::<S, N>(&h, time, de, dn);
                let square = east.mul_add(east, north * north);
                let cross = cosine.negate_mul_add(east, sine * north);
                let along = cosine.mul_add(north, sine * east);
                let residual = cross.atan2(along) * weight;
                let gain = weight / square;
                let (ge, gn) = (north * gain, -(east * gain));
                let frame = Frame {
                    u: [h[0], h[1]],
                    powers: powers(time),
                    d: [de, dn],
                };
                let rows = frame.components::<N>(ge, gn);
                for j in 0..N {
                    rows[j].store(&mut columns[j * blocks + i], part);
                }
                residual.store(&mut columns[N * blocks + i], part);
                residual.store(&mut columns[(N + 1) * blocks + i], part);
                cost = residual.mul_add(residual, cost);
                // e (a b^T + b a^T) = dp^T [P Q; Q -P] dp.
                let bend = residual * gain / square;
                let p = bend * (east + east) * north;
                let q = bend * (north - east) * (north + east);
                let first = frame.components::<N>(p, q);
                let second = frame.components::<N>(q, -p);
                for k in 0..N {
                    let products = frame.components::<N>(first[k], second[k]);
                    for j in 0..=k {
                        bending[j][k] = bending[j][k] + products[j];
                    }
                }
            }
            cost.store(&mut sum, part);
            for j in 0..N {
                for k in j..N {
                    bending[j][k].store(&mut sums[j][k], part);
                }
            }
        }
        let mut bending = [[0.0; N]; N];
        for j in 0..N {
            for k in j..N {
                bending[j][k] = total(&sums[j][k]);
            }
        }
        (total(&sum), bending)
    }
}

/// What a change of each parameter does to the target's place at one instant.
struct Frame<S: pulp::Simd> {
    u: [Lanes<S>; 2],
    powers: [Lanes<S>; 3],
    d: [Lanes<S>; 2],
}

impl<S: pulp::Simd> Frame<S> {
    /// The products of (x, y) with dp of each parameter.
    #[inline(always)]
    fn components<const N: usize>(&self, x: Lanes<S>, y: Lanes<S>) -> [Lanes<S>; N] {
        let mut out = [x; N];
        // The direction u turns clockwise: (u_north, -u_east).
        out[0] = x.mul_add(self.u[1], -(y * self.u[0]));
        for order in 1..N / 2 {
            out[2 * order - 1] = x * self.powers[order - 1];
            out[2 * order] = y * self.powers[order - 1];
        }
        out[N - 1] = -(x.mul_add(self.d[0], y * self.d[1]));
        out
    }
}

/// T, T^2 / 2, T^3 / 6.
#[inline(always)]
fn powers<S: pulp::Simd>(time: Lanes<S>) -> [Lanes<S>; 3] {
    let square = time * time.times(0.5);
    [time, square, square * time.times(1.0 / 3.0)]
}

/// The rows of the homogeneous pseudo-linear equations a h = 0 into `columns`
/// (Li & Sheng 2009, eq. 3, with the observer's displacement as one more column),
/// weighted; or, with `turned`, their derivative by the bearing, not weighted.
pub struct PseudoLinear<'a, const N: usize> {
    pub samples: &'a Samples,
    pub turned: bool,
    pub columns: &'a mut [Block],
}

impl<const N: usize> pulp::WithSimd for PseudoLinear<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self {
            samples,
            turned,
            columns,
        } = self;
        let blocks = samples.blocks;
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        for part in 0..Lanes::<S>::PARTS {
            for i in 0..blocks {
                let [sine, cosine, weight, time, de, dn] = samples.load(simd, i, part);
                let (mut x, mut y) = if turned {
                    // No part in it for the padding, whose weight is zero.
                    let part_of = weight.select_greater(zero, one, zero);
                    (-(sine * part_of), -(cosine * part_of))
                } else {
                    (cosine * weight, -(sine * weight))
                };
                (-(x.mul_add(de, y * dn))).store(&mut columns[N * blocks + i], part);
                for order in 0..N / 2 {
                    x.store(&mut columns[2 * order * blocks + i], part);
                    y.store(&mut columns[(2 * order + 1) * blocks + i], part);
                    let power = time.times(1.0 / (order + 1) as f64);
                    (x, y) = (x * power, y * power);
                }
            }
        }
    }
}

/// Reduces columns to the triangular factor of `count` x `count`, upper,
/// row-major in rows of `MAX`. A column that depends on those before it, to
/// `rtol` of its own length, gets a zero row.
///
/// # Source
/// Modified Gram-Schmidt: the factor, and the right-hand side as last column,
/// are as accurate as by reflections (Bjorck 1967), and each step is a plain
/// sum over samples.
pub struct Triangularize<'a> {
    pub blocks: usize,
    pub count: usize,
    pub rtol: f64,
    pub columns: &'a mut [Block],
    pub factor: &'a mut [[f64; MAX]; MAX],
}

impl pulp::WithSimd for Triangularize<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self {
            blocks,
            count,
            rtol,
            columns,
            factor,
        } = self;
        for k in 0..count {
            let (done, rest) = columns.split_at_mut((k + 1) * blocks);
            let pivot = &mut done[k * blocks..];
            let norm = dot(simd, pivot, pivot).sqrt();
            let before = (0..k).fold(0.0, |sum, i| sum + factor[i][k] * factor[i][k]);
            let row = &mut factor[k];
            row.fill(0.0);
            if !(norm > rtol * (before + norm * norm).sqrt()) {
                continue;
            }
            row[k] = norm;
            let inverse = Lanes::splat(simd, 1.0 / norm);
            for block in &mut *pivot {
                for part in 0..Lanes::<S>::PARTS {
                    (Lanes::load(simd, block, part) * inverse).store(block, part);
                }
            }
            for (j, column) in (k + 1..count).zip(rest.chunks_exact_mut(blocks)) {
                let along = dot(simd, pivot, column);
                row[j] = along;
                let along = Lanes::splat(simd, along);
                for (q, x) in pivot.iter().zip(column) {
                    for part in 0..Lanes::<S>::PARTS {
                        let (q, old) = (Lanes::load(simd, q, part), Lanes::load(simd, x, part));
                        q.negate_mul_add(along, old).store(x, part);
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn dot<S: pulp::Simd>(simd: S, a: &[Block], b: &[Block]) -> f64 {
    let mut sums = [0.0; LANES];
    for part in 0..Lanes::<S>::PARTS {
        let mut sum = Lanes::splat(simd, 0.0);
        for (a, b) in a.iter().zip(b) {
            sum = Lanes::load(simd, a, part).mul_add(Lanes::load(simd, b, part), sum);
        }
        sum.store(&mut sums, part);
    }
    total(&sums)
}
