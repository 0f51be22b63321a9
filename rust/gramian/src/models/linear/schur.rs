//! The complex Schur form A = Q T Q^H of a real or complex matrix, and the exchange of
//! its eigenvalues.
//!
//! Real and imaginary parts are kept apart and the Schur vectors in rows, so that nearly
//! all work is done on contiguous numbers.
//!
//! # Source
//! Golub & Van Loan, Matrix Computations, 4th ed., 7.4 (reduction to Hessenberg form),
//! 7.5 (the single-shift QR iteration), 7.6.2 (exchange of eigenvalues).

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::Complex;

pub(crate) type C64 = Complex<f64>;

/// |z|, of numbers whose squares are numbers.
#[inline]
pub(crate) fn abs(z: C64) -> f64 {
    root(z.norm_sqr())
}

/// The square root, from std or libm.
#[inline]
pub(crate) fn root(x: f64) -> f64 {
    nalgebra::ComplexField::sqrt(x)
}

/// A rotation [c, s; -conj(s), c] with real c.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rotation {
    pub c: f64,
    pub s: C64,
}

impl Rotation {
    /// The one that takes (a, b) to (r, 0).
    pub fn onto_first(a: C64, b: C64) -> Self {
        let size = abs(a);
        if size == 0.0 {
            let c = if abs(b) == 0.0 { 1.0 } else { 0.0 };
            return Self {
                c,
                s: C64::new(1.0 - c, 0.0),
            };
        }
        let r = root(a.norm_sqr() + b.norm_sqr());
        Self {
            c: size / r,
            s: a * b.conj() / (size * r),
        }
    }

    pub fn conj(self) -> Self {
        Self {
            c: self.c,
            s: self.s.conj(),
        }
    }
}

/// A complex matrix, row-major, real and imaginary parts apart.
#[derive(Clone, Debug, Default)]
pub(crate) struct Matrix {
    pub columns: usize,
    pub re: Vec<f64>,
    pub im: Vec<f64>,
}

impl Matrix {
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self {
            columns,
            re: vec![0.0; rows * columns],
            im: vec![0.0; rows * columns],
        }
    }

    pub fn identity(n: usize) -> Self {
        let mut out = Self::zeros(n, n);
        for i in 0..n {
            out.re[i * n + i] = 1.0;
        }
        out
    }

    pub fn real(re: &[f64], columns: usize) -> Self {
        Self {
            columns,
            re: re.to_vec(),
            im: vec![0.0; re.len()],
        }
    }

    pub fn rows(&self) -> usize {
        self.re.len().checked_div(self.columns).unwrap_or(0)
    }

    #[inline]
    pub fn get(&self, i: usize, j: usize) -> C64 {
        let k = i * self.columns + j;
        C64::new(self.re[k], self.im[k])
    }

    #[inline]
    pub fn set(&mut self, i: usize, j: usize, z: C64) {
        let k = i * self.columns + j;
        self.re[k] = z.re;
        self.im[k] = z.im;
    }

    /// Rows i and i + 1, from column `from` on, through a rotation.
    #[inline]
    pub fn rotate_rows(&mut self, i: usize, from: usize, g: Rotation) {
        let n = self.columns;
        let (x_re, y_re) = pair(&mut self.re, i, n, from);
        let (x_im, y_im) = pair(&mut self.im, i, n, from);
        rotate(x_re, x_im, y_re, y_im, g);
    }

    /// Columns j and j + 1 of the first `rows` rows times the adjoint of a rotation.
    #[inline]
    pub fn rotate_columns(&mut self, j: usize, rows: usize, g: Rotation) {
        let n = self.columns;
        for i in 0..rows {
            let k = i * n + j;
            let x = C64::new(self.re[k], self.im[k]);
            let y = C64::new(self.re[k + 1], self.im[k + 1]);
            let (u, w) = (x * g.c + g.s.conj() * y, y * g.c - g.s * x);
            (self.re[k], self.im[k]) = (u.re, u.im);
            (self.re[k + 1], self.im[k + 1]) = (w.re, w.im);
        }
    }

    /// The Frobenius norm.
    pub fn norm(&self) -> f64 {
        let sum = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
        root(sum(&self.re) + sum(&self.im))
    }

    /// Without the first row and column (`both`) or the first row alone.
    pub fn drop_first(&mut self, row: bool, column: bool) {
        let n = self.columns;
        for part in [&mut self.re, &mut self.im] {
            if row {
                part.drain(..n);
            }
            if column {
                let mut k = 0;
                part.retain(|_| {
                    k += 1;
                    (k - 1) % n != 0
                });
            }
        }
        if column {
            self.columns -= 1;
        }
    }
}

#[inline]
fn pair(data: &mut [f64], i: usize, n: usize, from: usize) -> (&mut [f64], &mut [f64]) {
    let (x, y) = data[i * n..(i + 2) * n].split_at_mut(n);
    (&mut x[from..], &mut y[from..])
}

/// (x, y) through a rotation.
#[inline]
pub(crate) fn rotate(
    x_re: &mut [f64],
    x_im: &mut [f64],
    y_re: &mut [f64],
    y_im: &mut [f64],
    g: Rotation,
) {
    let Rotation { c, s } = g;
    for (((a, b), d), e) in x_re
        .iter_mut()
        .zip(x_im.iter_mut())
        .zip(y_re.iter_mut())
        .zip(y_im.iter_mut())
    {
        let (u, v, w, z) = (*a, *b, *d, *e);
        *a = c * u + s.re * w - s.im * z;
        *b = c * v + s.re * z + s.im * w;
        *d = c * w - s.re * u - s.im * v;
        *e = c * z - s.re * v + s.im * u;
    }
}

/// A Schur form in the making or made.
#[derive(Clone, Debug)]
pub(crate) struct Schur {
    /// Upper triangular.
    pub t: Matrix,
    /// The Schur vectors, one a row.
    pub vectors: Matrix,
}

/// An iteration that did not end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NoConvergence;

/// Rows that are worked on side by side when columns are rotated.
const STRIP: usize = 8;

impl Schur {
    /// Of a real matrix, n x n.
    pub fn new(a: &[f64], n: usize) -> Result<Self, NoConvergence> {
        let (h, q) = hessenberg(a, n);
        let mut form = Self {
            t: Matrix::real(&h, n),
            vectors: Matrix::real(&q, n),
        };
        form.iterate()?;
        Ok(form)
    }

    /// Of a complex matrix; the vectors come from the identity.
    pub fn of_complex(mut t: Matrix) -> Result<Self, NoConvergence> {
        let n = t.columns;
        let mut vectors = Matrix::identity(n);
        // By rotations: such matrices are small.
        for column in 0..n.saturating_sub(2) {
            for row in (column + 1..n - 1).rev() {
                let g = Rotation::onto_first(t.get(row, column), t.get(row + 1, column));
                t.rotate_rows(row, column, g);
                t.rotate_columns(row, n, g);
                vectors.rotate_rows(row, 0, g.conj());
                t.set(row + 1, column, C64::default());
            }
        }
        let mut form = Self { t, vectors };
        form.iterate()?;
        Ok(form)
    }

    pub fn n(&self) -> usize {
        self.t.columns
    }

    pub fn eigenvalue(&self, i: usize) -> C64 {
        self.t.get(i, i)
    }

    /// The single-shift QR iteration on a Hessenberg matrix.
    fn iterate(&mut self) -> Result<(), NoConvergence> {
        let n = self.n();
        let floor = 0.1 * f64::EPSILON * self.t.norm() / root(n.max(1) as f64);
        let mut rotations: Vec<Rotation> = Vec::with_capacity(n);
        let (mut high, mut count) = (n.saturating_sub(1), 0);
        while high > 0 {
            let mut low = high;
            while low > 0 {
                let below = self.t.get(low, low - 1);
                let size = abs(below);
                let local = abs(self.t.get(low, low)) + abs(self.t.get(low - 1, low - 1));
                if size <= f64::EPSILON * local || size <= floor {
                    self.t.set(low, low - 1, C64::default());
                    break;
                }
                low -= 1;
            }
            if low == high {
                high -= 1;
                count = 0;
                continue;
            }
            count += 1;
            if count > 60 {
                return Err(NoConvergence);
            }
            let shift = if count % 12 == 0 {
                // A shift out of the way breaks a cycle.
                self.t.get(high, high) + abs(self.t.get(high, high - 1))
            } else {
                wilkinson(&self.t, high)
            };
            self.step(low, high, shift, &mut rotations);
        }
        Ok(())
    }

    /// T - shift = G^H R, T = R G^H + shift, in the window `low..=high`.
    fn step(&mut self, low: usize, high: usize, shift: C64, rotations: &mut Vec<Rotation>) {
        for i in low..=high {
            let z = self.t.get(i, i) - shift;
            self.t.set(i, i, z);
        }
        rotations.clear();
        for k in low..high {
            let g = Rotation::onto_first(self.t.get(k, k), self.t.get(k + 1, k));
            self.t.rotate_rows(k, k, g);
            self.t.set(k + 1, k, C64::default());
            self.vectors.rotate_rows(k, 0, g.conj());
            rotations.push(g);
        }
        self.columns_through(low, high, rotations);
        for i in low..=high {
            let z = self.t.get(i, i) + shift;
            self.t.set(i, i, z);
        }
    }

    /// All rotations of a sweep on the columns of the rows up to `high`: rows in strips,
    /// so that the chain along a row does not wait for itself.
    fn columns_through(&mut self, low: usize, high: usize, rotations: &[Rotation]) {
        let n = self.n();
        let width = high + 1 - low;
        let mut strip = vec![[[0.0_f64; STRIP]; 2]; width];
        let mut first = 0;
        while first <= high {
            let count = STRIP.min(high + 1 - first);
            for r in 0..count {
                let from = (first + r) * n + low;
                for (k, cell) in strip.iter_mut().enumerate() {
                    cell[0][r] = self.t.re[from + k];
                    cell[1][r] = self.t.im[from + k];
                }
            }
            // Rows below the diagonal have nothing before it.
            let start = first.saturating_sub(low + 1);
            for (k, g) in rotations.iter().enumerate().skip(start) {
                let (before, after) = strip.split_at_mut(k + 1);
                let (x, y) = (&mut before[k], &mut after[0]);
                let (s_re, s_im) = (g.s.re, -g.s.im);
                for r in 0..STRIP {
                    let (u, v, w, z) = (x[0][r], x[1][r], y[0][r], y[1][r]);
                    x[0][r] = g.c * u + s_re * w - s_im * z;
                    x[1][r] = g.c * v + s_re * z + s_im * w;
                    y[0][r] = g.c * w - s_re * u - s_im * v;
                    y[1][r] = g.c * z - s_re * v + s_im * u;
                }
            }
            for r in 0..count {
                let from = (first + r) * n + low;
                for (k, cell) in strip.iter().enumerate() {
                    self.t.re[from + k] = cell[0][r];
                    self.t.im[from + k] = cell[1][r];
                }
            }
            first += count;
        }
    }

    /// Exchanges the eigenvalues at k and k + 1; `c`, in Schur coordinates, comes along.
    pub fn exchange(&mut self, k: usize, c: &mut Matrix) {
        let (first, second) = (self.t.get(k, k), self.t.get(k + 1, k + 1));
        // (t12, second - first) is the eigenvector of the second.
        let g = Rotation::onto_first(self.t.get(k, k + 1), second - first);
        self.t.rotate_rows(k, k, g);
        self.t.rotate_columns(k, k + 2, g);
        self.vectors.rotate_rows(k, 0, g.conj());
        c.rotate_columns(k, c.rows(), g);
        self.t.set(k + 1, k, C64::default());
        self.t.set(k, k, second);
        self.t.set(k + 1, k + 1, first);
    }
}

/// The eigenvalue of the last 2 x 2 block that is nearer to its last entry.
fn wilkinson(t: &Matrix, high: usize) -> C64 {
    let (a, b) = (t.get(high - 1, high - 1), t.get(high - 1, high));
    let (c, d) = (t.get(high, high - 1), t.get(high, high));
    let half = (a - d) * 0.5;
    let product = b * c;
    let root = square_root(half * half + product);
    let sum = half + root;
    let difference = half - root;
    let larger = if sum.norm_sqr() > difference.norm_sqr() {
        sum
    } else {
        difference
    };
    if larger.norm_sqr() == 0.0 {
        d
    } else {
        d - product / larger
    }
}

fn square_root(z: C64) -> C64 {
    let size = abs(z);
    let re = root(0.5 * (size + z.re.abs()));
    if re == 0.0 {
        return C64::default();
    }
    let im = 0.5 * z.im / re;
    if z.re >= 0.0 {
        C64::new(re, im)
    } else {
        C64::new(im.abs(), if z.im < 0.0 { -re } else { re })
    }
}

/// H = Q^T A Q with zeros below the first subdiagonal; the columns of Q in rows.
fn hessenberg(a: &[f64], n: usize) -> (Vec<f64>, Vec<f64>) {
    let mut h = a.to_vec();
    let mut q = vec![0.0; n * n];
    for i in 0..n {
        q[i * n + i] = 1.0;
    }
    let (mut v, mut w) = (vec![0.0; n], vec![0.0; n]);
    for k in 0..n.saturating_sub(2) {
        let top = (k + 1..n).fold(0.0_f64, |top, i| top.max(h[i * n + k].abs()));
        let rest = (k + 2..n).any(|i| h[i * n + k] != 0.0);
        if !rest {
            continue;
        }
        v.fill(0.0);
        let mut squared = 0.0;
        for i in k + 1..n {
            v[i] = h[i * n + k] / top;
            squared += v[i] * v[i];
        }
        let norm = root(squared);
        let lead = v[k + 1];
        v[k + 1] += if lead < 0.0 { -norm } else { norm };
        let scale = 1.0 / root(norm * (norm + lead.abs()));
        for x in &mut v[k + 1..] {
            *x *= scale;
        }
        // (I - v v^T) H (I - v v^T)
        w.fill(0.0);
        for i in k + 1..n {
            axpy(&mut w[k..], v[i], &h[i * n + k..(i + 1) * n]);
        }
        for i in k + 1..n {
            axpy(&mut h[i * n + k..(i + 1) * n], -v[i], &w[k..]);
        }
        for row in h.chunks_exact_mut(n) {
            let along = crate::numbers::algebra::dot_slices(&row[k + 1..], &v[k + 1..]);
            axpy(&mut row[k + 1..], -along, &v[k + 1..]);
        }
        for i in k + 2..n {
            h[i * n + k] = 0.0;
        }
        // Q (I - v v^T): its columns are rows here.
        w.fill(0.0);
        for i in k + 1..n {
            axpy(&mut w, v[i], &q[i * n..(i + 1) * n]);
        }
        for i in k + 1..n {
            axpy(&mut q[i * n..(i + 1) * n], -v[i], &w);
        }
    }
    (h, q)
}

#[inline]
fn axpy(y: &mut [f64], factor: f64, x: &[f64]) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y += factor * x;
    }
}
