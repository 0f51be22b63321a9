//! The small matrices of a step.

use super::kernels::MAX;
use crate::scalar::hypot;
use crate::spectrum;
use crate::square_root::rotate_in;

/// Newton's step in units of deviations, (I + R^-T B R^-1) y = rest; `None`
/// where that matrix is not safely positive.
pub fn newton<const N: usize>(
    root: &[[f64; N]; N],
    bending: &[[f64; N]; N],
    rest: &[f64; N],
) -> Option<[f64; N]> {
    let diagonal: [f64; N] = core::array::from_fn(|k| 1.0 / root[k][k]);
    if diagonal.iter().any(|x| !x.is_finite()) {
        return None;
    }
    // R^-T on the symmetric matrix from the left, then from the right.
    let mut b: [[f64; N]; N] =
        core::array::from_fn(|i| core::array::from_fn(|j| bending[i.min(j)][i.max(j)]));
    for _ in 0..2 {
        for i in 0..N {
            for j in 0..N {
                let sum = (0..i).fold(b[i][j], |sum, k| sum - root[k][i] * b[k][j]);
                b[i][j] = sum * diagonal[i];
            }
        }
        b = core::array::from_fn(|i| core::array::from_fn(|j| b[j][i]));
    }
    // Cholesky.
    let mut y = *rest;
    for i in 0..N {
        for j in 0..=i {
            let unit = if i == j { 1.0 } else { 0.0 };
            let sum = (0..j).fold(unit + b[i][j], |sum, k| sum - b[i][k] * b[j][k]);
            if i == j {
                if !(sum > 0.02) {
                    return None;
                }
                b[i][i] = sum.sqrt();
            } else {
                b[i][j] = sum / b[j][j];
            }
        }
        let sum = (0..i).fold(y[i], |sum, k| sum - b[i][k] * y[k]);
        y[i] = sum / b[i][i];
    }
    for i in (0..N).rev() {
        let sum = (i + 1..N).fold(y[i], |sum, k| sum - b[k][i] * y[k]);
        y[i] = sum / b[i][i];
    }
    Some(y)
}

/// h' = A^-1 C h, with A and C given by their triangular factors; unit length.
pub fn inverse_step<const N: usize>(
    a: &[[f64; MAX]; MAX],
    c: &[[f64; MAX]; MAX],
    h: &[f64; MAX],
) -> [f64; MAX] {
    let mut image = [0.0; MAX];
    for i in 0..=N {
        image[i] = (i..=N).fold(0.0, |sum, j| sum + c[i][j] * h[j]);
    }
    let mut y = [0.0; MAX];
    for j in 0..=N {
        y[j] = (0..=j).fold(0.0, |sum, i| sum + c[i][j] * image[i]);
    }
    for i in 0..=N {
        let sum = (0..i).fold(y[i], |sum, k| sum - a[k][i] * y[k]);
        y[i] = sum / a[i][i];
    }
    for i in (0..=N).rev() {
        let sum = (i + 1..=N).fold(y[i], |sum, k| sum - a[i][k] * y[k]);
        y[i] = sum / a[i][i];
    }
    let size = y.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
    y.map(|x| x / size)
}

/// The model after a step. It is homogeneous, so that |u| is made 1 again by
/// scaling all of it.
pub fn stepped<const N: usize>(h: &[f64; MAX], change: &[f64; N]) -> [f64; MAX] {
    let mut next = *h;
    next[0] += h[1] * change[0];
    next[1] -= h[0] * change[0];
    for i in 2..=N {
        next[i] += change[i - 1];
    }
    let length = hypot(next[0], next[1]);
    next.map(|x| x / length)
}

/// The step that solves root step = rest, damped by the information's diagonal.
pub fn step<const N: usize>(root: &[[f64; N]; N], rest: &[f64; N], damping: f64) -> [f64; N] {
    let (mut root, mut rest) = (*root, *rest);
    if damping > 0.0 {
        let mut factor = [[0.0; MAX]; MAX];
        for i in 0..N {
            factor[i][..N].copy_from_slice(&root[i]);
            factor[i][N] = rest[i];
        }
        let mut flat = flatten::<N>(&factor);
        for j in 0..N {
            let square = (0..=j).fold(0.0, |sum, i| sum + root[i][j] * root[i][j]);
            let mut row = [0.0; MAX];
            row[j] = (damping * if square > 0.0 { square } else { 1.0 }).sqrt();
            rotate_in(&mut flat[..(N + 1) * (N + 1)], &mut row[..=N]);
        }
        (root, rest) = split::<N>(&flat);
    }
    for i in (0..N).rev() {
        let sum = (i + 1..N).fold(rest[i], |sum, j| sum - root[i][j] * rest[j]);
        rest[i] = sum / root[i][i];
    }
    rest
}

/// The first N + 1 rows and columns, without gaps.
pub fn flatten<const N: usize>(factor: &[[f64; MAX]; MAX]) -> [f64; MAX * MAX] {
    let mut flat = [0.0; MAX * MAX];
    for (row, line) in factor.iter().zip(flat.chunks_exact_mut(N + 1)).take(N + 1) {
        line.copy_from_slice(&row[..=N]);
    }
    flat
}

/// The triangle and its right-hand side.
pub fn split<const N: usize>(flat: &[f64; MAX * MAX]) -> ([[f64; N]; N], [f64; N]) {
    let at = |i: usize, j: usize| flat[i * (N + 1) + j];
    (
        core::array::from_fn(|i| core::array::from_fn(|j| at(i, j))),
        core::array::from_fn(|i| at(i, N)),
    )
}

pub fn decompose<const N: usize>(r: &[[f64; N]; N], scale: &[f64; N]) -> ([f64; N], [[f64; N]; N]) {
    let (mut s, mut v, mut work) = ([0.0; N], [[0.0; N]; N], [[0.0; N]; N]);
    spectrum::decompose(
        r.as_flattened(),
        N,
        scale,
        &mut s,
        v.as_flattened_mut(),
        work.as_flattened_mut(),
    );
    (s, v)
}
