//! The entries of (R^T R)^-1 on the pattern of R, without forming the rest.

use alloc::vec;
use alloc::vec::Vec;

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::{Accum, Mat, Par};

use super::factor::Factor;
use super::structure::NONE;
use super::{SparseError, Stop};

/// The diagonal of the inverse, by places.
///
/// From the last front to the first: with `T = R_11^-1 R_12`, the inverse on a front's own
/// columns is R_11^-1 R_11^-T + T Z T^T, a sum of two positive parts, and T Z (with the
/// other sign) between them and the later ones, whose Z the parent has.
///
/// # Errors
/// [`SparseError::Interrupted`].
pub(super) fn diagonal(factor: &Factor, stop: &mut Stop<'_>) -> Result<Vec<f64>, SparseError> {
    let symbolic = &factor.symbolic;
    let count = symbolic.fronts();
    let mut children = vec![0usize; count];
    for s in 0..count {
        if symbolic.parent[s] != NONE {
            children[symbolic.parent[s]] += 1;
        }
    }
    let mut held: Vec<Option<Mat<f64>>> = Vec::new();
    held.resize_with(count, || None);
    let mut local = vec![0; symbolic.columns()];
    let mut answer = vec![0.0; symbolic.columns()];
    for s in (0..count).rev() {
        if stop() {
            return Err(SparseError::Interrupted);
        }
        let (own, wide) = symbolic.size(s);
        let later = symbolic.later(s);
        let parent = symbolic.parent[s];
        let mut z = Mat::<f64>::zeros(wide, wide);
        if parent != NONE {
            let begin = symbolic.begin[parent];
            let (ours, _) = symbolic.size(parent);
            for k in 0..ours {
                local[begin + k] = k;
            }
            for (k, &p) in symbolic.later(parent).iter().enumerate() {
                local[p] = ours + k;
            }
            if let Some(from) = &held[parent] {
                for (b, &q) in later.iter().enumerate() {
                    let column = from.col_as_slice(local[q]);
                    let out = z.col_as_slice_mut(own + b);
                    for (a, &p) in later.iter().enumerate() {
                        out[own + a] = column[local[p]];
                    }
                }
            }
            children[parent] -= 1;
            if children[parent] == 0 {
                held[parent] = None;
            }
        }
        let r = factor.rows(s);
        let mut t = r.subcols(own, wide - own).to_owned();
        let triangle = r.subcols(0, own);
        solve_upper_triangular_in_place(triangle, t.as_mut(), Par::Seq);
        let mut inverse = Mat::<f64>::identity(own, own);
        solve_upper_triangular_in_place(triangle, inverse.as_mut(), Par::Seq);
        // T Z, which is the block between own and later columns but for its sign.
        let mut between = Mat::<f64>::zeros(own, wide - own);
        matmul(
            between.as_mut(),
            Accum::Replace,
            t.as_ref(),
            z.as_ref().submatrix(own, own, wide - own, wide - own),
            1.0,
            Par::Seq,
        );
        let mut corner = z.as_mut().submatrix_mut(0, 0, own, own);
        matmul(
            corner.as_mut(),
            Accum::Replace,
            inverse.as_ref(),
            inverse.transpose(),
            1.0,
            Par::Seq,
        );
        matmul(
            corner.as_mut(),
            Accum::Add,
            between.as_ref(),
            t.transpose(),
            1.0,
            Par::Seq,
        );
        for k in 0..own {
            answer[symbolic.begin[s] + k] = z[(k, k)];
        }
        if children[s] > 0 {
            for b in 0..wide - own {
                for a in 0..own {
                    let value = -between[(a, b)];
                    z[(a, own + b)] = value;
                    z[(own + b, a)] = value;
                }
            }
            held[s] = Some(z);
        }
    }
    Ok(answer)
}
