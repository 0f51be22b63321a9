//! What sparse rows do not determine: the smallest singular values and their vectors.

use alloc::vec;
use alloc::vec::Vec;

use faer::Mat;

use super::factor::Factor;
use super::{Index, Rows, SparseError, Stop};

/// Vectors beyond the expected nullity: they make the values above the gap converge.
const MORE: usize = 6;

/// Iterations after which a block that has not converged is made larger or given up.
const MOST: usize = 40;

/// A value above the gap counts as found when it changes by less than this, relatively.
const CHANGE: f64 = 1e-7;

/// The end of the spectrum of one component.
#[derive(Clone, Debug)]
pub struct Component {
    /// Its first place in the elimination order; its columns follow.
    pub begin: usize,
    /// The place after its last.
    pub end: usize,
    /// How many of `values` do not count.
    pub nullity: usize,
    /// The smallest singular values of [A D], ascending.
    pub values: Vec<f64>,
    /// Their vectors, scaled units, places x values, row-major.
    pub vectors: Vec<f64>,
    /// Whether the smallest value that counts changed by less than 1e-7 in the last
    /// iteration (it is an upper limit in any case).
    pub converged: bool,
}

impl Component {
    /// A vector, by places from `begin`.
    pub fn vector(&self, index: usize) -> impl Iterator<Item = f64> + '_ {
        let width = self.values.len();
        self.vectors
            .iter()
            .skip(index)
            .step_by(width.max(1))
            .copied()
    }

    /// Number of columns.
    pub fn len(&self) -> usize {
        self.end - self.begin
    }

    /// Whether it has no column, which none is.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A column-scaled matrix with its columns in elimination order.
pub(super) struct Scaled {
    start: Vec<usize>,
    /// Places and scaled values.
    entries: Vec<(u32, f64)>,
    columns: usize,
}

impl Scaled {
    /// Scales and orders rows; there must be fewer than 2^32 columns.
    pub fn new<I: Index>(rows: &Rows<'_, I>, scale: &[f64], place: &[usize]) -> Self {
        let mut start = Vec::with_capacity(rows.len() + 1);
        start.push(0);
        let mut entries = Vec::with_capacity(rows.entries());
        for row in 0..rows.len() {
            entries.extend(rows.row(row).map(|(j, value)| {
                (
                    u32::try_from(place[j]).unwrap_or(u32::MAX),
                    value * scale[j],
                )
            }));
            start.push(entries.len());
        }
        Self {
            start,
            entries,
            columns: place.len(),
        }
    }

    fn len(&self) -> usize {
        self.start.len() - 1
    }

    fn row(&self, row: usize) -> &[(u32, f64)] {
        &self.entries[self.start[row]..self.start[row + 1]]
    }

    /// [A D] x for one row and `width` vectors by places, row-major.
    fn line(&self, row: usize, x: &[f64], width: usize, out: &mut [f64]) {
        out.fill(0.0);
        for &(p, value) in self.row(row) {
            let p = p as usize * width;
            for (o, x) in out.iter_mut().zip(&x[p..p + width]) {
                *o += value * x;
            }
        }
    }

    /// The largest singular value, by Golub-Kahan-Lanczos bidiagonalisation: an estimate
    /// from below, within a per cent or so.
    pub fn norm(&self) -> f64 {
        const STEPS: usize = 12;
        let n = self.columns;
        let mut random = Random(0x9E37_79B9_7F4A_7C15);
        let mut v: Vec<f64> = (0..n).map(|_| random.next()).collect();
        normalise(&mut v);
        let mut u = vec![0.0; self.len()];
        let mut beta = 0.0;
        // Of the bidiagonal matrix: the diagonal, and what stands right of it.
        let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
        for _ in 0..STEPS {
            let mut next: Vec<f64> = vec![0.0; n];
            let mut square = 0.0;
            for (row, u) in u.iter_mut().enumerate() {
                let image: f64 = self.row(row).iter().map(|&(p, a)| a * v[p as usize]).sum();
                *u = image - beta * *u;
                square += *u * *u;
            }
            let alpha = f64::sqrt(square);
            diagonal.push(alpha);
            if alpha == 0.0 {
                break;
            }
            for (row, u) in u.iter_mut().enumerate() {
                *u /= alpha;
                for &(p, a) in self.row(row) {
                    next[p as usize] += a * *u;
                }
            }
            for (x, v) in next.iter_mut().zip(&v) {
                *x -= alpha * v;
            }
            beta = normalise(&mut next);
            beside.push(beta);
            if beta <= f64::EPSILON * alpha {
                break;
            }
            v = next;
        }
        let k = diagonal.len();
        let bidiagonal = Mat::from_fn(k, k, |i, j| match j.wrapping_sub(i) {
            0 => diagonal[i],
            1 => beside[i],
            _ => 0.0,
        });
        bidiagonal
            .singular_values()
            .ok()
            .and_then(|values| values.first().copied())
            .unwrap_or(0.0)
    }
}

fn normalise(x: &mut [f64]) -> f64 {
    let length = x.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 {
        for x in x {
            *x /= length;
        }
    }
    length
}

/// Numbers in (-1, 1) that are the same on every machine: only a start is needed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        // SplitMix64 (Steele, Lea & Flood 2014).
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Finds the smallest singular values of every component: those at or below `limit`, which
/// do not count, and at least the first above.
///
/// # Errors
/// [`SparseError::Interrupted`], [`SparseError::NoConvergence`].
pub(super) fn smallest(
    matrix: &Scaled,
    factor: &Factor,
    ranges: &[(usize, usize)],
    limit: f64,
    stop: &mut Stop<'_>,
) -> Result<Vec<Component>, SparseError> {
    let n = matrix.columns;
    let widest = ranges.iter().map(|(a, b)| b - a).max().unwrap_or(0);
    let mut width = widest.min(MORE + 6);
    let mut component_of = vec![0; n];
    for (c, &(begin, end)) in ranges.iter().enumerate() {
        component_of[begin..end].fill(c);
    }
    let by_component = rows_by_component(matrix, &component_of, ranges.len());
    let mut x: Vec<f64> = Vec::new();
    let mut before = 0;
    loop {
        x = widened(&x, n, before, width);
        let mut last = vec![f64::NAN; ranges.len()];
        let mut found: Vec<(Vec<f64>, usize)> = Vec::new();
        let mut converged = vec![false; ranges.len()];
        for iteration in 0..MOST {
            if iteration > 0 || before == 0 {
                factor.solve_transposed(&mut x, width, stop)?;
                factor.solve(&mut x, width, stop)?;
            }
            found = rayleigh_ritz(matrix, &mut x, width, ranges, &by_component, stop)?;
            for (c, (values, _)) in found.iter().enumerate() {
                let first = values.iter().copied().find(|&v| v > limit);
                converged[c] = match first {
                    None => values.len() == ranges[c].1 - ranges[c].0 || iteration > 1,
                    Some(value) => {
                        let steady = (value - last[c]).abs() <= CHANGE * value;
                        last[c] = value;
                        steady || values.len() == ranges[c].1 - ranges[c].0
                    }
                };
            }
            if converged.iter().all(|c| *c) {
                break;
            }
        }
        // Where all vectors of a block are null vectors, there are more of them.
        let needed = found
            .iter()
            .enumerate()
            .filter(|(c, (values, _))| {
                values.len() < ranges[*c].1 - ranges[*c].0 && values.iter().all(|&v| v <= limit)
            })
            .count();
        if needed == 0 || width == widest {
            return Ok(collect(&x, width, ranges, found, &converged, limit));
        }
        before = width;
        width = widest.min(2 * width);
    }
}

fn collect(
    x: &[f64],
    width: usize,
    ranges: &[(usize, usize)],
    found: Vec<(Vec<f64>, usize)>,
    converged: &[bool],
    limit: f64,
) -> Vec<Component> {
    found
        .into_iter()
        .enumerate()
        .map(|(c, (values, kept))| {
            let (begin, end) = ranges[c];
            Component {
                begin,
                end,
                nullity: values.iter().filter(|&&v| v <= limit).count(),
                vectors: (begin..end)
                    .flat_map(|p| x[p * width..p * width + kept].iter().copied())
                    .collect(),
                values,
                converged: converged[c],
            }
        })
        .collect()
}

/// The block with random vectors beside those it has.
fn widened(x: &[f64], n: usize, before: usize, width: usize) -> Vec<f64> {
    let mut random = Random(width as u64);
    let mut wide = Vec::with_capacity(n * width);
    for p in 0..n {
        wide.extend_from_slice(&x[p * before..(p + 1) * before]);
        wide.extend((before..width).map(|_| random.next()));
    }
    wide
}

fn rows_by_component(
    matrix: &Scaled,
    component_of: &[usize],
    components: usize,
) -> Vec<Vec<usize>> {
    let mut list = vec![Vec::new(); components];
    for row in 0..matrix.len() {
        if let Some(&(p, _)) = matrix.row(row).first() {
            list[component_of[p as usize]].push(row);
        }
    }
    list
}

/// Orthonormal columns, then rotated so that [A D] maps them to orthogonal ones; the
/// shortest first. A itself is used and not its square, so that no digit is lost.
#[allow(clippy::type_complexity)]
fn rayleigh_ritz(
    matrix: &Scaled,
    x: &mut [f64],
    width: usize,
    ranges: &[(usize, usize)],
    by_component: &[Vec<usize>],
    stop: &mut Stop<'_>,
) -> Result<Vec<(Vec<f64>, usize)>, SparseError> {
    let mut answer = Vec::with_capacity(ranges.len());
    for (c, &(begin, end)) in ranges.iter().enumerate() {
        if stop() {
            return Err(SparseError::Interrupted);
        }
        let size = end - begin;
        let kept = width.min(size);
        let block = &mut x[begin * width..end * width];
        orthonormal(block, width, kept);
        let rows = &by_component[c];
        let mut image = Mat::<f64>::zeros(rows.len().max(kept), kept);
        let mut line = vec![0.0; width];
        for (i, &row) in rows.iter().enumerate() {
            matrix.line(row, x, width, &mut line);
            for k in 0..kept {
                image[(i, k)] = line[k];
            }
        }
        let triangle = if rows.len() > 2 * kept {
            image.qr().thin_R().to_owned()
        } else {
            image
        };
        let svd = triangle
            .thin_svd()
            .map_err(|_| SparseError::NoConvergence)?;
        let values: Vec<f64> = (0..kept).rev().map(|k| svd.S()[k]).collect();
        let v = svd.V();
        let block = &mut x[begin * width..end * width];
        for line in block.chunks_exact_mut(width) {
            let old = line.to_vec();
            for k in 0..kept {
                line[k] = (0..kept).map(|i| old[i] * v[(i, kept - 1 - k)]).sum();
            }
        }
        answer.push((values, kept));
    }
    Ok(answer)
}

/// Gram-Schmidt on the first `kept` columns, twice, the columns in their order: the first
/// are the largest after an inverse iteration, and must not be spoilt by the others. The
/// other columns become zero.
fn orthonormal(block: &mut [f64], width: usize, kept: usize) {
    let size = block.len() / width;
    let mut columns: Vec<Vec<f64>> = (0..kept)
        .map(|k| (0..size).map(|p| block[p * width + k]).collect())
        .collect();
    let mut random = Random(kept as u64);
    for k in 0..kept {
        let (done, rest) = columns.split_at_mut(k);
        let column = &mut rest[0];
        // Scaled first: an inverse iteration can make squares overflow.
        let largest = column.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
        if largest > 0.0 && largest.is_finite() {
            for x in column.iter_mut() {
                *x /= largest;
            }
        }
        for _ in 0..4 {
            let before = normalise(column);
            if before == 0.0 || !before.is_finite() {
                for x in column.iter_mut() {
                    *x = random.next();
                }
                normalise(column);
            }
            for other in done.iter() {
                let product: f64 = other.iter().zip(column.iter()).map(|(a, b)| a * b).sum();
                for (x, o) in column.iter_mut().zip(other) {
                    *x -= product * o;
                }
            }
            let after = column.iter().map(|x| x * x).sum::<f64>().sqrt();
            if after > 0.7 {
                break;
            }
            if after < 1e-13 {
                for x in column.iter_mut() {
                    *x = random.next();
                }
            }
        }
        normalise(column);
    }
    for (p, line) in block.chunks_exact_mut(width).enumerate() {
        for (k, x) in line.iter_mut().enumerate() {
            *x = columns.get(k).map_or(0.0, |column| column[p]);
        }
    }
}
