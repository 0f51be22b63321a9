//! How much of the columns of rows is rounding of what the rows were computed from.
//!
//! Ranks are decided on columns of unit length. A target dead ahead along an axis has
//! columns that are all rounding, or nearly so: made as long as the others they would
//! count as information.

use alloc::vec;
use alloc::vec::Vec;

use super::spectrum::default_rtol;

/// How much of the length of each column is rounding: rows (K, n), and for each row the
/// `accuracy` of its entries relative to the length of the vector that they are part of.
/// `width` columns after one another hold one vector; an entry of exactly 0 is taken
/// for one that is no part of it.
///
/// ```
/// // Two vectors of two coordinates; of the second, only one counts.
/// let noise = gramian::rounding::of_columns(&[3.0, 4.0, 0.0, 2.0], 4, &[1e-9], 2);
/// assert_eq!(noise, [5e-9, 5e-9, 0.0, 2e-9]);
/// ```
pub fn of_columns(rows: &[f64], n: usize, accuracy: &[f64], width: usize) -> Vec<f64> {
    let top = largest(rows);
    let mut noise = vec![0.0; n];
    if n == 0 || width == 0 {
        return noise;
    }
    for (row, accuracy) in rows.chunks_exact(n).zip(accuracy) {
        for (vector, noise) in row.chunks(width).zip(noise.chunks_mut(width)) {
            // Divided by the largest, or squares of small numbers would be lost.
            let squares: f64 = vector.iter().map(|x| (x / top) * (x / top)).sum();
            let rounding = accuracy * accuracy * squares;
            for (x, noise) in vector.iter().zip(noise) {
                if *x != 0.0 {
                    *noise += rounding;
                }
            }
        }
    }
    for noise in &mut noise {
        *noise = top * noise.sqrt();
    }
    noise
}

/// Sets columns of rows (K, n) to 0 that are rounding alone, and gives the relative
/// accuracy of the others; `None` where it is that of plain rows. `noise` is how much
/// of each column is rounding.
pub fn remove(rows: &mut [f64], n: usize, noise: &[f64]) -> Option<f64> {
    if n == 0 {
        return None;
    }
    let top = largest(rows);
    let mut sizes = vec![0.0; n];
    for row in rows.chunks_exact(n) {
        for (size, x) in sizes.iter_mut().zip(row) {
            *size += (x / top) * (x / top);
        }
    }
    let mut squares = 0.0;
    for (j, (size, noise)) in sizes.iter().zip(noise).enumerate() {
        let size = top * size.sqrt();
        // With less than two digits left, a column says nothing.
        if size > 100.0 * noise {
            squares += (noise / size) * (noise / size);
        } else {
            for x in rows.iter_mut().skip(j).step_by(n) {
                *x = 0.0;
            }
        }
    }
    let rtol = squares.sqrt();
    (rtol > default_rtol(rows.len() / n, n)).then_some(rtol)
}

fn largest(rows: &[f64]) -> f64 {
    let top = rows.iter().fold(0.0_f64, |top, x| top.max(x.abs()));
    if top > 0.0 { top } else { 1.0 }
}
