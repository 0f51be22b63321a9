//! The factors M = V^T D V of a covariance or an information matrix, V unit upper
//! triangular and D diagonal: what a triangular root knows, without square roots.
//!
//! Two primitives carry the posterior bound, both without a subtraction that cancels:
//! [`absorb`] adds rows to M, [`update_inverse`] replaces M by (M^-1 + h h^T)^-1. The root is
//! D^(1/2) V ([`Factor::root_row`]).
//!
//! # Source
//! Bierman 1977, Factorization Methods for Discrete Sequential Estimation, chapter V
//! (measurement) and VI (modified weighted Gram-Schmidt, after Thornton 1976), with
//! M = V^T D V instead of U D U^T.

use crate::numbers::lane::Lane;

/// V (n x n, row-major; what is on and below its diagonal is never read) and D.
pub struct Factor<'a, L> {
    pub unit: &'a mut [L],
    pub weight: &'a mut [L],
}

/// Rows that a factor is made from, with a weight for each of the first n.
pub struct Weighted<'a, L> {
    /// 2 n rows of n, row-major.
    pub rows: &'a mut [L],
    /// n weights.
    pub weight: &'a mut [L],
    /// Scratch space of n numbers.
    pub work: &'a mut [L],
}

/// Which of the weighted rows may be other than zero.
#[derive(Clone, Copy)]
pub enum Shape<'a> {
    /// In column k the first `reach[k]` of the first n rows, which never grow less;
    /// below them an upper triangle.
    Triangle(&'a [usize]),
    /// In column k the first `reach[k]` of the first n rows; none below.
    Alone(&'a [usize]),
    /// An upper triangle, and as many rows below it, n at most.
    Below(usize),
}

impl<L: Lane> Factor<'_, L> {
    /// Number of states.
    #[inline(always)]
    pub fn n(&self) -> usize {
        self.weight.len()
    }

    /// Row i of the root D^(1/2) V.
    #[inline(always)]
    pub fn root_row(&self, i: usize, out: &mut [L]) {
        let n = self.n();
        let root = self.weight[i].sqrt();
        // Over all columns, so that the loop can be unrolled.
        for j in 0..n {
            out[j] = if j > i {
                root * self.unit[i * n + j]
            } else {
                root.splat(0.0)
            };
        }
        out[i] = root;
    }

    /// The diagonal of M.
    #[inline(always)]
    pub fn diagonal(&self, out: &mut [L]) {
        let n = self.n();
        for j in 0..n {
            let mut sum = self.weight[j];
            for i in 0..j {
                let x = self.unit[i * n + j];
                sum = (x * x).mul_add(self.weight[i], sum);
            }
            out[j] = sum;
        }
    }

    /// The diagonal of M^-1, without what has no weight. `work` holds n numbers.
    #[inline(always)]
    pub fn inverse_diagonal(&self, out: &mut [L], work: &mut [L]) {
        let n = self.n();
        let zero = self.weight[0].splat(0.0);
        for k in 0..n {
            // Column k of V^-1, from its last entry up.
            let inverse = self.weight[k].recip_or_zero();
            work[k] = zero.splat(1.0);
            out[k] = inverse;
            for i in (0..k).rev() {
                let mut sum = zero - self.unit[i * n + k];
                for j in i + 1..k {
                    sum = self.unit[i * n + j].negate_mul_add(work[j], sum);
                }
                work[i] = sum;
                out[i] = (sum * sum).mul_add(inverse, out[i]);
            }
        }
    }
}

/// The factors of the sum of w row^T row over the rows of `from`, which are used up.
/// The rows after the first n have weight 1.
///
/// Modified Gram-Schmidt rather than reflections: rows may differ in size by many
/// orders (a speed hardly known beside a position well known), and reflections
/// keep the digits of the small ones only if the rows are sorted first.
/// `N` is the number of states where that is to be known to the compiler, else 0.
#[inline(always)]
pub fn absorb<L: Lane, const N: usize>(
    from: &mut Weighted<'_, L>,
    shape: Shape<'_>,
    to: &mut Factor<'_, L>,
) {
    if N == 4 {
        // Written out, so that the compiler keeps the numbers in registers.
        column(from, shape, 0, to);
        column(from, shape, 1, to);
        column(from, shape, 2, to);
        column(from, shape, 3, to);
        return;
    }
    for k in 0..to.n() {
        column(from, shape, k, to);
    }
}

/// V and D of the upper triangular `root`, n x n.
pub fn from_root(root: &[f64], unit: &mut [f64], weight: &mut [f64]) {
    let n = weight.len();
    let mut rows = alloc::vec![0.0; 2 * n * n];
    rows[..n * n].copy_from_slice(root);
    let mut from = Weighted {
        rows: &mut rows,
        weight: &mut alloc::vec![1.0; n],
        work: &mut alloc::vec![0.0; n],
    };
    absorb::<_, 0>(&mut from, Shape::Below(0), &mut Factor { unit, weight });
}

#[inline(always)]
fn column<L: Lane>(from: &mut Weighted<'_, L>, shape: Shape<'_>, k: usize, to: &mut Factor<'_, L>) {
    let n = to.n();
    // The most there can be is known to the compiler where n is; loops that end there
    // are unrolled.
    let (most, head, most_below, tail) = match shape {
        Shape::Triangle(reach) => (n, reach[k], n + k + 1, n + k + 1),
        Shape::Alone(reach) => (n, reach[k], n, n),
        Shape::Below(count) => (k + 1, k + 1, 2 * n, n + count),
    };
    let Weighted {
        rows: a,
        weight,
        work,
    } = from;
    let zero = weight[0].splat(0.0);
    let mut sum = zero;
    for i in 0..most {
        if i < head {
            work[i] = a[i * n + k] * weight[i];
            sum = work[i].mul_add(a[i * n + k], sum);
        }
    }
    // Sums of their own, so that one does not wait for the other.
    let mut below = zero;
    for i in n..most_below {
        if i < tail {
            below = a[i * n + k].mul_add(a[i * n + k], below);
        }
    }
    let sum = sum + below;
    let inverse = sum.recip_or_zero();
    to.weight[k] = sum;
    for j in k + 1..n {
        let mut dot = zero;
        for i in 0..most {
            if i < head {
                dot = work[i].mul_add(a[i * n + j], dot);
            }
        }
        let mut below = zero;
        for i in n..most_below {
            if i < tail {
                below = a[i * n + k].mul_add(a[i * n + j], below);
            }
        }
        let along = (dot + below) * inverse;
        to.unit[k * n + j] = along;
        for i in 0..most {
            if i < head {
                a[i * n + j] = a[i * n + k].negate_mul_add(along, a[i * n + j]);
            }
        }
        for i in n..most_below {
            if i < tail {
                a[i * n + j] = a[i * n + k].negate_mul_add(along, a[i * n + j]);
            }
        }
    }
}

/// Replaces M by (M^-1 + h h^T)^-1. `work` holds n numbers.
#[inline(always)]
pub fn update_inverse<L: Lane>(factor: &mut Factor<'_, L>, h: &[L], work: &mut [L]) {
    let n = factor.n();
    // 1 + h^T M h over the rows so far, at least 1, and its inverse.
    let mut sum = factor.weight[0].splat(1.0);
    let mut inverse = sum;
    for i in (0..n).rev() {
        let mut along = h[i];
        for j in i + 1..n {
            along = factor.unit[i * n + j].mul_add(h[j], along);
        }
        let gain = factor.weight[i] * along;
        let (before, back) = (sum, along * inverse);
        sum = along.mul_add(gain, sum);
        inverse = sum.recip();
        factor.weight[i] = factor.weight[i] * (before * inverse);
        for j in i + 1..n {
            let x = factor.unit[i * n + j];
            factor.unit[i * n + j] = back.negate_mul_add(work[j], x);
            work[j] = gain.mul_add(x, work[j]);
        }
        work[i] = gain;
    }
}

/// The rows V transition with the weights D, into the first n of `out`. `used[j n + k]`
/// tells whether entry (j, k) of `transition` is ever other than zero.
#[inline(always)]
pub fn multiply<L: Lane>(
    factor: &Factor<'_, L>,
    transition: &[L],
    used: &[bool],
    out: &mut Weighted<'_, L>,
) {
    let n = factor.n();
    let a = &mut *out.rows;
    let zero = factor.weight[0].splat(0.0);
    for k in 0..n {
        for i in 0..n {
            a[i * n + k] = zero;
        }
        for j in 0..n {
            if used[j * n + k] {
                let m = transition[j * n + k];
                for i in 0..j {
                    a[i * n + k] = factor.unit[i * n + j].mul_add(m, a[i * n + k]);
                }
                a[j * n + k] = a[j * n + k] + m;
            }
        }
    }
    for i in 0..n {
        out.weight[i] = factor.weight[i];
    }
}

/// How many rows of V transition, from the first, each column needs in [`absorb`].
pub fn reach(used: &[bool], n: usize) -> alloc::vec::Vec<usize> {
    let mut most = 0;
    (0..n)
        .map(|k| {
            for j in 0..n {
                if used[j * n + k] {
                    most = most.max(j + 1);
                }
            }
            most
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use alloc::vec;
    use alloc::vec::Vec;

    use super::*;
    use crate::batch::Stream;
    use crate::posterior;
    use crate::square_root::rotate_in;

    struct Numbers {
        unit: Vec<f64>,
        weight: Vec<f64>,
        rows: Vec<f64>,
        weights: Vec<f64>,
        work: Vec<f64>,
    }

    impl Numbers {
        fn new(root: &[f64], n: usize) -> Self {
            let mut numbers = Self {
                unit: vec![0.0; n * n],
                weight: vec![0.0; n],
                rows: vec![0.0; 2 * n * n],
                weights: vec![0.0; n],
                work: vec![0.0; n],
            };
            from_root(root, &mut numbers.unit, &mut numbers.weight);
            numbers
        }

        fn parts(&mut self) -> (Factor<'_, f64>, Weighted<'_, f64>) {
            let factor = Factor {
                unit: &mut self.unit,
                weight: &mut self.weight,
            };
            let rows = Weighted {
                rows: &mut self.rows,
                weight: &mut self.weights,
                work: &mut self.work,
            };
            (factor, rows)
        }

        /// Row by row, as far as it is above the diagonal.
        fn root(&mut self) -> Vec<f64> {
            let (factor, _) = self.parts();
            let n = factor.n();
            let mut root = vec![0.0; n * n];
            for (i, row) in root.chunks_exact_mut(n).enumerate() {
                factor.root_row(i, row);
            }
            root
        }
    }

    fn triangle(stream: &mut Stream, n: usize) -> Vec<f64> {
        let mut root = vec![0.0; n * n];
        for i in 0..n {
            for j in i..n {
                root[i * n + j] = stream.normal();
            }
            root[i * n + i] = root[i * n + i].abs() + 0.1;
        }
        root
    }

    fn assert_same(found: &[f64], root: &[f64], n: usize) {
        for i in 0..n {
            // Rows of a root may have either sign.
            let sign = root[i * n + i].signum();
            for j in i..n {
                let (a, b) = (found[i * n + j], sign * root[i * n + j]);
                assert!((a - b).abs() < 1e-12 * b.abs().max(1.0), "{i} {j}: {a} {b}");
            }
        }
    }

    #[test]
    fn a_row_measured_is_carlsons_update_of_the_root() {
        for n in [1, 2, 4, 7] {
            let mut stream = Stream::new(3, n as u64);
            let mut root = triangle(&mut stream, n);
            let mut numbers = Numbers::new(&root, n);
            let mut work = vec![0.0; n];
            for _ in 0..3 {
                let h: Vec<f64> = (0..n).map(|_| stream.normal()).collect();
                posterior::update_inverse(&mut root, n, &h, &mut work);
                let (mut factor, rows) = numbers.parts();
                update_inverse(&mut factor, &h, rows.work);
                assert_same(&numbers.root(), &root, n);
            }
        }
    }

    #[test]
    fn a_step_is_the_rotation_of_all_rows_into_the_root() {
        for n in [1, 2, 4, 7] {
            let mut stream = Stream::new(4, n as u64);
            let (root, noise) = (triangle(&mut stream, n), triangle(&mut stream, n));
            // Some entries of the transition are never used.
            let used: Vec<bool> = (0..n * n)
                .map(|i| i % (n + 1) == 0 || stream.uniform() < 0.4)
                .collect();
            let transition: Vec<f64> = used
                .iter()
                .map(|&used| if used { stream.normal() } else { 0.0 })
                .collect();
            let mut plain = vec![0.0; n * n];
            for row in root.chunks_exact(n) {
                let mut moved: Vec<f64> = (0..n)
                    .map(|k| (0..n).map(|j| row[j] * transition[j * n + k]).sum())
                    .collect();
                rotate_in(&mut plain, &mut moved);
            }
            let reach = reach(&used, n);
            let mut numbers = Numbers::new(&root, n);
            let (mut factor, mut rows) = numbers.parts();
            multiply(&factor, &transition, &used, &mut rows);
            absorb::<_, 0>(&mut rows, Shape::Alone(&reach), &mut factor);
            assert_same(&numbers.root(), &plain, n);

            for row in noise.chunks_exact(n) {
                rotate_in(&mut plain, &mut row.to_vec());
            }
            let mut numbers = Numbers::new(&root, n);
            let (mut factor, mut rows) = numbers.parts();
            multiply(&factor, &transition, &used, &mut rows);
            rows.rows[n * n..].copy_from_slice(&noise);
            let shape = Shape::Triangle(&reach);
            if n == 4 {
                absorb::<_, 4>(&mut rows, shape, &mut factor);
            } else {
                absorb::<_, 0>(&mut rows, shape, &mut factor);
            }
            assert_same(&numbers.root(), &plain, n);

            // The diagonals of P and of P^-1.
            let (factor, rows) = numbers.parts();
            let (mut diagonal, mut inverse) = (vec![0.0; n], vec![0.0; n]);
            factor.diagonal(&mut diagonal);
            factor.inverse_diagonal(&mut inverse, rows.work);
            for j in 0..n {
                let square: f64 = (0..=j).map(|i| plain[i * n + j] * plain[i * n + j]).sum();
                assert!((diagonal[j] / square - 1.0).abs() < 1e-12);
            }
            for i in 0..n {
                // Row i of the inverse of the triangle: x R = e_i.
                let mut x = vec![0.0; n];
                for j in i..n {
                    let known: f64 = (i..j).map(|m| x[m] * plain[m * n + j]).sum();
                    x[j] = (if i == j { 1.0 } else { 0.0 } - known) / plain[j * n + j];
                }
                let square: f64 = x.iter().map(|x| x * x).sum();
                assert!((inverse[i] / square - 1.0).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn what_weighs_nothing_is_left_out() {
        let mut numbers = Numbers::new(&[0.0, 0.0, 0.0, 2.0], 2);
        assert_eq!(numbers.weight, [0.0, 4.0]);
        assert_eq!(numbers.unit[1], 0.0);
        // The square of the pivot is too small for its inverse to be held.
        numbers = Numbers::new(&[1e-155, 1e-155, 0.0, 1.0], 2);
        assert_eq!(numbers.unit[1], 0.0);
        assert!(numbers.weight[1] == 1.0);
    }
}
