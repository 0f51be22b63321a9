//! The balance: powers of two for states, outputs and time with which the
//! nonzero entries of A and C come as near to one as they can.
//!
//! sum over nonzeros of (log|`a_ij`| + `d_j` - `d_i` + t)^2 + (log|`c_ij`| + `s_i` + `d_j`)^2
//! is least. Whatever units the system came in, the balanced system is the same
//! (up to the rounding of the exponents to whole numbers). An entry that ought
//! to be zero must be zero: its size would count like any other's.
//!
//! # Source
//! Curtis & Reid 1972, On the automatic scaling of matrices for Gaussian
//! elimination, J. Inst. Maths Applics 10: least squares on the logarithms, by
//! conjugate gradients.

use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::{NumberError, Real};

/// One or several systems that share their scales.
#[derive(Clone, Copy, Debug)]
pub struct Systems<'a, T> {
    /// n rows for each system.
    pub a: &'a [T],
    /// A row for each output of each system.
    pub c: &'a [T],
    /// Number of states.
    pub n: usize,
    /// Length of a row, of which the first n entries count; the rest is zero.
    pub stride: usize,
}

/// What the unit of time is multiplied by, and the shape of the systems; the
/// factors of states and outputs are in the slices given to [`balance`].
#[derive(Clone, Copy, Debug)]
pub struct Balance<T> {
    n: usize,
    stride: usize,
    /// The factor of the unit of time.
    pub time: T,
}

/// log2|x| to 0.09, exact for powers of two.
#[inline(always)]
fn log2<T: Real>(x: T) -> T {
    const MANTISSA: u64 = (1 << 52) - 1;
    let bits = x.double().abs().to_bits();
    // Whole numbers below 2^52 are the last bits of 2^52 plus themselves; so a
    // vector of them is converted with two operations.
    let two_52 = (1_u64 << 52) as f64;
    let exponent = f64::from_bits(two_52.to_bits() | (bits >> 52)) - two_52;
    let mantissa = f64::from_bits(1.0_f64.to_bits() | (bits & MANTISSA)) - 1.0;
    T::of(exponent - 1023.0 + mantissa)
}

/// 2^(nearest whole number), so small or large that squares are numbers still.
#[inline(always)]
fn power_of_two<T: Real>(exponent: T) -> T {
    let limit = if T::EPSILON.double() > 1e-10 {
        60.0
    } else {
        500.0
    };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let biased = (1023.0 + exponent.round().double().clamp(-limit, limit)) as u64;
    T::of(f64::from_bits(biased << 52))
}

/// Scratch of [`balance`]: rows of the systems' stride, m outputs in all.
#[derive(Debug)]
pub struct Work<'a, T> {
    /// n rows: which pairs of states A couples, and how often.
    pub pattern: &'a mut [T],
    /// m rows: which states an output sees.
    pub outputs_see: &'a mut [T],
    /// 5 rows.
    pub state: &'a mut [T],
    /// 4 m entries.
    pub output: &'a mut [T],
}

/// Finds the balance of `systems`: `states` (of the systems' stride) and
/// `outputs` (m) receive their factors, powers of two.
#[inline(always)]
pub fn balance<T: Real>(
    systems: Systems<'_, T>,
    work: Work<'_, T>,
    states: &mut [T],
    outputs: &mut [T],
) -> Balance<T> {
    let Systems { a, c, n, stride } = systems;
    let m = outputs.len();
    let (zero, one) = (T::zero(), T::one());
    let Work {
        pattern,
        outputs_see,
        state,
        output,
    } = work;
    pattern.fill(zero);
    outputs_see.fill(zero);
    state.fill(zero);
    output.fill(zero);
    states.fill(zero);
    outputs.fill(zero);
    let (residual, rest) = state.split_at_mut(stride);
    let (direction, rest) = rest.split_at_mut(stride);
    let (image, rest) = rest.split_at_mut(stride);
    let (degree, excess) = rest.split_at_mut(stride);
    let (residual_o, rest) = output.split_at_mut(m);
    let (direction_o, rest) = rest.split_at_mut(m);
    let (image_o, degree_o) = rest.split_at_mut(m);

    // The normal equations: a Laplacian of the graph of nonzeros, with the unit
    // of time, which every entry of A has, as one more vertex.
    let (mut degree_t, mut residual_t) = (zero, zero);
    for row in a
        .chunks_exact(n * stride)
        .flat_map(|block| block.chunks_exact(stride).enumerate())
    {
        let (i, row) = row;
        // An entry on the diagonal enters twice with opposite signs: it knows
        // the unit of time alone.
        let (sum, count) = enter(&row[..n], image, residual, degree);
        residual[i] += sum;
        residual_t -= sum;
        degree[i] += count;
        excess[i] -= count;
        degree_t += count;
        add(excess, one, image);
        add(&mut pattern[i * stride..(i + 1) * stride], one, image);
        for j in 0..n {
            pattern[j * stride + i] += image[j];
        }
    }
    for (o, row) in c.chunks_exact(stride).enumerate() {
        let see = &mut outputs_see[o * stride..(o + 1) * stride];
        let (sum, count) = enter(&row[..n], see, residual, degree);
        residual_o[o] -= sum;
        degree_o[o] += count;
    }
    // Where nothing is known of a scale its equation is 0 = 0.
    for d in degree.iter_mut().chain(degree_o.iter_mut()) {
        *d = (*d).max(one);
    }
    let divisor_t = degree_t.max(one);
    let (mut time, mut direction_t, mut energy, mut ratio) = (zero, zero, zero, zero);
    // Exponents are wanted to a tenth. The energy bounds the squared error times
    // the smallest eigenvalue of the graph, which is about 1 / size^2.
    let enough = T::of(1e-2 / ((n + m) * (n + m)) as f64);
    for round in 0..3 * (n + m + 1) {
        let before = energy;
        energy = residual_t * residual_t / divisor_t
            + weighted(residual, degree)
            + weighted(residual_o, degree_o);
        if !(energy > enough) {
            break;
        }
        if round > 0 {
            ratio = energy / before;
        }
        direction_t = residual_t / divisor_t + ratio * direction_t;
        for i in 0..stride {
            direction[i] = residual[i] / degree[i] + ratio * direction[i];
            image[i] = degree[i] * direction[i] + excess[i] * direction_t;
        }
        let image_t = degree_t * direction_t + dot(excess, direction);
        let mut curvature = image_t * direction_t;
        for (i, row) in pattern.chunks_exact(stride).enumerate() {
            add(image, -direction[i], row);
        }
        for (o, row) in outputs_see.chunks_exact(stride).enumerate() {
            direction_o[o] = residual_o[o] / degree_o[o] + ratio * direction_o[o];
            image_o[o] = degree_o[o] * direction_o[o] + dot(row, direction);
            curvature += image_o[o] * direction_o[o];
            add(image, direction_o[o], row);
        }
        curvature += dot(image, direction);
        if !(curvature > zero) {
            break;
        }
        let step = energy / curvature;
        time += step * direction_t;
        residual_t -= step * image_t;
        add(&mut states[..stride], step, direction);
        add(residual, -step, image);
        add(outputs, step, direction_o);
        add(residual_o, -step, image_o);
    }
    for x in states.iter_mut().chain(outputs.iter_mut()) {
        *x = power_of_two(*x);
    }
    Balance {
        n,
        stride,
        time: power_of_two(time),
    }
}

/// Marks the nonzero entries of a row in `some`, takes their logarithms from the
/// residual of their columns; returns the sum of these and the count.
#[inline(always)]
fn enter<T: Real>(row: &[T], some: &mut [T], residual: &mut [T], degree: &mut [T]) -> (T, T) {
    let (mut sum, mut count) = (T::zero(), T::zero());
    for j in 0..row.len() {
        let here = if row[j] == T::zero() {
            T::zero()
        } else {
            T::one()
        };
        let log = here * log2(row[j]);
        some[j] = here;
        residual[j] -= log;
        degree[j] += here;
        sum += log;
        count += here;
    }
    (sum, count)
}

/// Sum of x^2 / weight.
#[inline(always)]
fn weighted<T: Real>(x: &[T], weight: &[T]) -> T {
    let mut sum = T::zero();
    for (&x, &weight) in x.iter().zip(weight) {
        sum += x * x / weight;
    }
    sum
}

impl<T: Real> Balance<T> {
    /// Scales A and C in place: `a_ij` `d_j` / `d_i` t, `c_ij` `s_i` `d_j`.
    #[inline(always)]
    pub fn apply(&self, states: &[T], outputs: &[T], a: &mut [T], c: &mut [T]) {
        let Self { n, stride, time } = *self;
        for block in a.chunks_exact_mut(n * stride) {
            for (i, row) in block.chunks_exact_mut(stride).enumerate() {
                let factor = time / states[i];
                for (x, &state) in row.iter_mut().zip(states) {
                    *x *= state * factor;
                }
            }
        }
        for (row, &output) in c.chunks_exact_mut(stride).zip(outputs) {
            for (x, &state) in row.iter_mut().zip(states) {
                *x *= state * output;
            }
        }
    }
}

/// Refuses balanced systems whose squares, or sums of n of them, are not numbers.
pub(crate) fn check<T: Real>(a: &[T], c: &[T], n: usize) -> Result<(), NumberError> {
    let limit = T::MAX.sqrt() / T::of(4.0 * n.max(1) as f64);
    if a.iter().chain(c).all(|x| x.abs() <= limit) {
        return Ok(());
    }
    Err(NumberError::Overflow {
        result: "balanced system",
    })
}

/// y += factor x.
#[inline(always)]
pub(crate) fn add<T: Real>(y: &mut [T], factor: T, x: &[T]) {
    let (y, y_rest) = y.as_chunks_mut::<8>();
    let (x, x_rest) = x.as_chunks::<8>();
    for (y, x) in y.iter_mut().zip(x) {
        for k in 0..8 {
            y[k] += factor * x[k];
        }
    }
    for (y, &x) in y_rest.iter_mut().zip(x_rest) {
        *y += factor * x;
    }
}
