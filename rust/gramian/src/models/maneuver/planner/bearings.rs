//! The bearings of one target along one track, many samples in lanes: their rows, column by
//! column, and the derivatives of a criterion by the places.

use pulp::Simd;

use crate::batch::lanes::{LANES, Lanes};
use crate::batch::simd::Path;
use crate::numbers::lane::Lane;

/// Numbers of the first samples, twice each, as places are.
const NUMBERS: [[f64; 2]; LANES] = {
    let mut numbers = [[0.0; 2]; LANES];
    let mut i = 0;
    while i < LANES {
        numbers[i] = [i as f64; 2];
        i += 1;
    }
    numbers
};

/// A target (x0, y0, vx, vy) seen from places that follow each other by `dt`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line<'a> {
    pub at: &'a [[f64; 2]],
    pub target: [f64; 4],
    pub dt: f64,
}

/// The rows of a line of places.
pub(super) struct Rows<'a> {
    pub line: Line<'a>,
    /// Of each bearing: the root of what it counts.
    pub weight: f64,
    /// What counts as one unit of x and y, and where it is unknown of the velocity.
    pub units: &'a [f64],
    /// A column for each of these, zero beyond the last sample.
    pub columns: [&'a mut [f64]; 4],
    /// The column of a bias, if there is one, and what counts as one unit of it.
    pub bias: (&'a mut [f64], f64),
    /// 1 / range^2, for the [`Pulls`].
    pub inverses: &'a mut [f64],
}

/// The derivatives by the places, added to `out`.
pub(super) struct Pulls<'a> {
    pub line: Line<'a>,
    /// As [`Rows`] left them.
    pub inverses: &'a [f64],
    /// Twice what each bearing counts.
    pub weight: f64,
    pub by: ByRow,
    pub out: &'a mut [[f64; 2]],
}

/// The derivative of a criterion by the information of one bearing, as a function of its
/// time t: K = K0 + K1 t + K2 t^2, each (xx, xy, yy), on x and y, and c = c0 + c1 t on them
/// and the bias of the bearing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ByRow {
    pub place: [[f64; 3]; 3],
    pub bias: [[f64; 2]; 2],
}

impl Line<'_> {
    /// Registers of samples.
    fn registers<S: Simd>(&self) -> usize {
        self.at.len().div_ceil(S::F64_LANES)
    }

    /// Offset of the target, time and number of the samples of one register.
    #[inline(always)]
    fn samples<S: Simd>(&self, simd: S, register: usize) -> ([Lanes<S>; 2], Lanes<S>, Lanes<S>) {
        let first = register * S::F64_LANES;
        let at = pairs(simd, &self.at[first..]);
        let number = pairs(simd, &NUMBERS)[0] + Lanes::splat(simd, first as f64);
        let time = number.times(self.dt);
        let mut offset = at;
        for k in 0..2 {
            let place = Lanes::splat(simd, self.target[k]);
            let velocity = Lanes::splat(simd, self.target[2 + k]);
            offset[k] = velocity.mul_add(time, place) - at[k];
        }
        (offset, time, number)
    }
}

/// One register of first numbers and one of second ones, in an order that [`add`] undoes;
/// the last pair again for those that there are not.
#[inline(always)]
fn pairs<S: Simd>(simd: S, flat: &[[f64; 2]]) -> [Lanes<S>; 2] {
    let width = S::F64_LANES;
    let mut filled = [[0.0; 2]; LANES];
    let whole = if let Some(whole) = flat.get(..width) {
        whole
    } else {
        for (i, place) in filled[..width].iter_mut().enumerate() {
            *place = flat[i.min(flat.len() - 1)];
        }
        &filled[..width]
    };
    let registers = S::as_simd_f64s(whole.as_flattened()).0;
    let [a, b] = simd.deinterleave_shfl_f64s([registers[0], registers[1]]);
    [Lanes::new(simd, a), Lanes::new(simd, b)]
}

/// Adds to pairs what [`pairs`] would read.
#[inline(always)]
fn add<S: Simd>(simd: S, by: [Lanes<S>; 2], flat: &mut [[f64; 2]]) {
    let width = S::F64_LANES;
    let [a, b] = simd.interleave_shfl_f64s([by[0].register(), by[1].register()]);
    if flat.len() >= width {
        let registers = S::as_mut_simd_f64s(flat[..width].as_flattened_mut()).0;
        registers[0] = simd.add_f64s(registers[0], a);
        registers[1] = simd.add_f64s(registers[1], b);
        return;
    }
    let mut filled = [[0.0; 2]; LANES];
    let registers = S::as_mut_simd_f64s(filled[..width].as_flattened_mut()).0;
    (registers[0], registers[1]) = (a, b);
    for (to, from) in flat.iter_mut().zip(filled) {
        *to = [to[0] + from[0], to[1] + from[1]];
    }
}

impl pulp::WithSimd for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = S::F64_LANES;
        let samples = Lanes::splat(simd, self.line.at.len() as f64);
        let zero = Lanes::splat(simd, 0.0);
        let [easts, norths, easts_moved, norths_moved] = self.columns;
        let (biases, bias) = self.bias;
        let bias = Lanes::splat(simd, self.weight * bias);
        let moves = self.units.len() == 4;
        let mut units = [zero; 4];
        for (unit, &value) in units.iter_mut().zip(self.units) {
            *unit = Lanes::splat(simd, self.weight * value);
        }
        for register in 0..self.line.registers::<S>() {
            let to = register * width..(register + 1) * width;
            let ([x, y], time, number) = self.line.samples(simd, register);
            let inverse = x.mul_add(x, y * y).recip();
            inverse.put(&mut self.inverses[to.clone()]);
            // The lanes beyond the last sample hold it again: they count nothing.
            let seen = samples.select_greater(number, inverse, zero);
            let (a, b) = (y * seen, -(x * seen));
            (a * units[0]).put(&mut easts[to.clone()]);
            (b * units[1]).put(&mut norths[to.clone()]);
            if moves {
                (a * time * units[2]).put(&mut easts_moved[to.clone()]);
                (b * time * units[3]).put(&mut norths_moved[to.clone()]);
            }
            if !biases.is_empty() {
                samples
                    .select_greater(number, bias, zero)
                    .put(&mut biases[to]);
            }
        }
    }
}

impl pulp::WithSimd for Pulls<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = S::F64_LANES;
        let zero = Lanes::splat(simd, 0.0);
        let (mut place, mut bias) = ([[zero; 3]; 3], [[zero; 2]; 2]);
        for k in 0..3 {
            for i in 0..3 {
                place[k][i] = Lanes::splat(simd, self.by.place[k][i]);
            }
        }
        for k in 0..2 {
            for i in 0..2 {
                bias[k][i] = Lanes::splat(simd, self.by.bias[k][i]);
            }
        }
        let weight = Lanes::splat(simd, self.weight);
        for register in 0..self.line.registers::<S>() {
            let first = register * width;
            let ([x, y], time, _) = self.line.samples(simd, register);
            let inverse = Lanes::of(simd, &self.inverses[first..]);
            let mut k = place[0];
            for i in 0..3 {
                k[i] = time.mul_add(time.mul_add(place[2][i], place[1][i]), k[i]);
            }
            // (a, b) = K h + c of the row h = (y, -x) / range^2.
            let (east, north) = (y * inverse, x * inverse);
            let c = [
                time.mul_add(bias[1][0], bias[0][0]),
                time.mul_add(bias[1][1], bias[0][1]),
            ];
            let a = k[1].negate_mul_add(north, k[0].mul_add(east, c[0]));
            let b = k[2].negate_mul_add(north, k[1].mul_add(east, c[1]));
            // Of (a y - b x) / range^2, by the place: against the offset.
            let both = x.negate_mul_add(b, a * y) * inverse.times(2.0);
            let factor = weight * inverse;
            let by = [factor * x.mul_add(both, b), factor * y.mul_add(both, -a)];
            add(simd, by, &mut self.out[first..]);
        }
    }
}

/// The rows on a path of vectors, as the columns of [`Rows`].
pub(super) fn rows(path: Path, rows: Rows<'_>) {
    path.run(rows);
}

/// The derivatives on a path of vectors, as [`Pulls`].
pub(super) fn pull(path: Path, pulls: Pulls<'_>) {
    path.run(pulls);
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;
    use alloc::vec::Vec;

    #[test]
    fn every_path_gives_rows_and_derivatives_of_single_samples() {
        let target = [60.0, 900.0, 3.0, -2.0];
        let units = [1.0, 2.0, 0.1, 0.05];
        let by = ByRow {
            place: [[0.3, -0.2, 1.1], [0.05, 0.01, -0.04], [0.001, 0.002, 0.003]],
            bias: [[0.7e-3, -0.4e-3], [0.2e-4, 0.1e-4]],
        };
        let row = |[x, y]: [f64; 2], time: f64, [east, north]: [f64; 2]| {
            let (x, y) = (x + time * target[2] - east, y + time * target[3] - north);
            let square = x * x + y * y;
            [y / square, -x / square]
        };
        // What a change of the row changes: h^T K h + 2 c^T h.
        let value = |place: [f64; 2], time: f64| {
            let [a, b] = row([target[0], target[1]], time, place);
            let mut sum = 0.0;
            for (k, power) in [1.0, time, time * time].into_iter().enumerate() {
                let [xx, xy, yy] = by.place[k];
                sum += power * (xx * a * a + 2.0 * xy * a * b + yy * b * b);
            }
            for (k, power) in [1.0, time].into_iter().enumerate() {
                sum += 2.0 * power * (by.bias[k][0] * a + by.bias[k][1] * b);
            }
            sum
        };
        for samples in [1, 3, 7, 8, 9, 40, 101] {
            let at: Vec<[f64; 2]> = (0..samples)
                .map(|i| [20.0 * f64::from(i).sin(), 7.0 * f64::from(i)])
                .collect();
            let length = at.len().next_multiple_of(LANES);
            for path in Path::available() {
                let line = Line {
                    at: &at,
                    target,
                    dt: 1.5,
                };
                let mut columns = vec![0.0; 5 * length];
                let mut inverses = vec![0.0; length];
                let mut parts = columns.chunks_exact_mut(length);
                let columns_mut = core::array::from_fn(|_| parts.next().unwrap_or_default());
                let weight = 0.5;
                rows(
                    path,
                    Rows {
                        line,
                        weight,
                        units: &units,
                        columns: columns_mut,
                        bias: (parts.next().unwrap_or_default(), 3.0),
                        inverses: &mut inverses,
                    },
                );
                let mut out = vec![[1.0, 2.0]; at.len()];
                pull(
                    path,
                    Pulls {
                        line,
                        inverses: &inverses,
                        weight,
                        by,
                        out: &mut out,
                    },
                );
                // The rows are those of the samples, in an order of their own.
                let mut found: Vec<[f64; 5]> = (0..length)
                    .map(|i| core::array::from_fn(|j| columns[j * length + i]))
                    .collect();
                let mut wanted = vec![[0.0; 5]; length];
                for (i, &place) in at.iter().enumerate() {
                    let time = 1.5 * i as f64;
                    let [a, b] = row([target[0], target[1]], time, place);
                    wanted[i] = [a, b, a * time, b * time, 3.0];
                    for j in 0..5 {
                        wanted[i][j] *= weight * units.get(j).unwrap_or(&1.0);
                    }
                    let size = 2e-3;
                    for k in 0..2 {
                        let at = |step: f64| {
                            let mut place = place;
                            place[k] += step * size;
                            value(place, time)
                        };
                        let near = (at(1.0) - at(-1.0)) / (2.0 * size);
                        let far = (at(2.0) - at(-2.0)) / (4.0 * size);
                        let slope = 0.5 * weight * (4.0 * near - far) / 3.0;
                        let by = out[i][k] - [1.0, 2.0][k];
                        assert!((slope - by).abs() < 1e-9, "{path:?} {i} {k}: {slope} {by}");
                    }
                }
                for set in [&mut found, &mut wanted] {
                    // Zero in the rows that fill up alone.
                    set.sort_by(|a, b| a[1].total_cmp(&b[1]));
                }
                for (found, wanted) in found.iter().zip(&wanted) {
                    for j in 0..5 {
                        let off = (found[j] - wanted[j]).abs();
                        let size = wanted[j].abs();
                        assert!(off <= 8.0 * f64::EPSILON * size, "{path:?} {samples} {off}");
                    }
                }
            }
        }
    }
}
