//! The candidates seen by each other: all that a choice needs once everything is
//! observable.
//!
//! With the covariance P of what is known, C = F P F^T for the rows F of all candidates
//! says what each would tell beside the others; for a weighted sum of variances (weights
//! W) also G = F P W P F^T. Adding a row with weight t is an update of rank one (Sherman
//! & Morrison): no factorisation is needed, and where C is given the number of states does
//! not enter at all.

use alloc::vec::Vec;
use core::ops::Range;

/// Where C and G are.
#[derive(Clone, Debug)]
enum Entries {
    /// Both as they are, row-major; `None` for G where the determinant is asked for.
    Held(Vec<f64>, Option<Vec<f64>>),
    /// Their factors: F, F P and W (with n states), which is less where there are more rows
    /// than states.
    Factors {
        n: usize,
        rows: Vec<f64>,
        image: Vec<f64>,
        weights: Option<Vec<f64>>,
    },
}

/// What a set of candidates would tell about each other, and what the choice is worth now.
#[derive(Clone, Debug)]
pub struct Gram {
    /// Rows of each candidate.
    groups: Vec<Range<usize>>,
    /// Number of rows.
    size: usize,
    entries: Entries,
    /// Half the log determinant, or minus the sum of variances.
    worth: f64,
}

impl Gram {
    /// Takes C, and G for a sum of variances (row-major), and the worth of what is known
    /// already. `ends` has the end of each candidate's rows. `None` where lengths do not
    /// fit.
    pub fn new(ends: &[usize], c: Vec<f64>, g: Option<Vec<f64>>, worth: f64) -> Option<Self> {
        let size = ends.last().copied().unwrap_or(0);
        let fits = |m: &Vec<f64>| size.checked_mul(size) == Some(m.len());
        if !fits(&c) || !g.as_ref().is_none_or(fits) || ends.windows(2).any(|w| w[0] > w[1]) {
            return None;
        }
        Some(Self::of(ends, Entries::Held(c, g), worth))
    }

    fn of(ends: &[usize], entries: Entries, worth: f64) -> Self {
        Self {
            groups: core::iter::once(&0)
                .chain(ends)
                .zip(ends)
                .map(|(a, b)| *a..*b)
                .collect(),
            size: ends.last().copied().unwrap_or(0),
            entries,
            worth,
        }
    }

    /// The same from the rows of all candidates and a covariance (n x n).
    pub(super) fn factored(
        ends: &[usize],
        rows: Vec<f64>,
        covariance: &[f64],
        weights: Option<Vec<f64>>,
        worth: f64,
    ) -> Self {
        let n = covariance.len().isqrt();
        let mut image = Vec::with_capacity(rows.len());
        for row in rows.chunks_exact(n) {
            let from = image.len();
            image.resize(from + n, 0.0);
            for (x, line) in row.iter().zip(covariance.chunks_exact(n)) {
                add(&mut image[from..], *x, line);
            }
        }
        let entries = Entries::Factors {
            n,
            rows,
            image,
            weights,
        };
        Self::of(ends, entries, worth)
    }

    /// Half the log determinant of the information, or minus the weighted sum of variances.
    pub fn worth(&self) -> f64 {
        self.worth
    }

    /// Number of candidates.
    pub fn len(&self) -> usize {
        self.groups.len()
    }

    /// Whether there is no candidate.
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    /// Whether the determinant is asked for.
    pub(super) fn of_determinant(&self) -> bool {
        matches!(
            self.entries,
            Entries::Held(_, None) | Entries::Factors { weights: None, .. }
        )
    }

    fn c(&self, i: usize, j: usize) -> f64 {
        match &self.entries {
            Entries::Held(c, _) => c[i * self.size + j],
            Entries::Factors { n, rows, image, .. } => {
                let (a, b) = (&image[i * n..(i + 1) * n], &rows[j * n..(j + 1) * n]);
                a.iter().zip(b).map(|(x, y)| x * y).sum()
            }
        }
    }

    fn g(&self, i: usize, j: usize) -> Option<f64> {
        match &self.entries {
            Entries::Held(_, g) => g.as_ref().map(|g| g[i * self.size + j]),
            Entries::Factors {
                n, image, weights, ..
            } => weights.as_ref().map(|weights| {
                let (a, b) = (&image[i * n..(i + 1) * n], &image[j * n..(j + 1) * n]);
                let product = a.iter().zip(b).map(|(x, y)| x * y);
                product.zip(weights).map(|(x, w)| x * w).sum()
            }),
        }
    }

    /// What each candidate would add at once, in units of its weight.
    pub(super) fn slopes(&self) -> Vec<f64> {
        self.groups
            .iter()
            .map(|rows| {
                rows.clone()
                    .map(|r| self.g(r, r).unwrap_or_else(|| 0.5 * self.c(r, r)))
                    .sum()
            })
            .collect()
    }

    /// What these candidates see of each other: for repeated questions.
    pub(super) fn part(&self, candidates: &[usize]) -> Self {
        let lines: Vec<usize> = candidates
            .iter()
            .flat_map(|&i| self.groups[i].clone())
            .collect();
        let pairs = || {
            lines
                .iter()
                .flat_map(|&i| lines.iter().map(move |&j| (i, j)))
        };
        let c = pairs().map(|(i, j)| self.c(i, j)).collect();
        let g = pairs().map(|(i, j)| self.g(i, j)).collect();
        let mut end = 0;
        let ends: Vec<usize> = candidates
            .iter()
            .map(|&i| {
                end += self.groups[i].len();
                end
            })
            .collect();
        Self::of(&ends, Entries::Held(c, g), self.worth)
    }

    /// The worth with these candidates added, each times its weight (negative to take it
    /// away); `None` where not everything would be observable. Those that are added come
    /// first.
    pub(super) fn with(&self, moves: &[(usize, f64)]) -> Option<f64> {
        let candidates: Vec<usize> = moves.iter().map(|&(i, _)| i).collect();
        let weights: Vec<f64> = moves.iter().map(|&(_, weight)| weight).collect();
        self.part(&candidates).with_all(&weights)
    }

    /// The same for all candidates, as they stand in a [`part`](Self::part).
    pub(super) fn with_all(&self, weights: &[f64]) -> Option<f64> {
        let mut own = self.clone();
        for (rows, &weight) in self.groups.iter().zip(weights) {
            for r in rows.clone() {
                own.update(r, weight)?;
            }
        }
        Some(own.worth)
    }

    /// Adds candidates as [`with`](Self::with); `false` where not everything would be
    /// observable.
    pub(super) fn add(&mut self, moves: &[(usize, f64)]) -> bool {
        moves.iter().all(|&(i, weight)| {
            self.groups[i]
                .clone()
                .all(|r| self.update(r, weight).is_some())
        })
    }

    /// Adds a row times `weight` to what is known.
    fn update(&mut self, r: usize, weight: f64) -> Option<()> {
        let divisor = 1.0 + weight * self.c(r, r);
        // Below this the difference is rounding.
        if !(divisor > 64.0 * f64::EPSILON) {
            return None;
        }
        let factor = weight / divisor;
        self.worth += match self.g(r, r) {
            Some(own) => factor * own,
            None => 0.5 * divisor.ln(),
        };
        let size = self.size;
        let column: Vec<f64> = (0..size).map(|i| factor * self.c(r, i)).collect();
        match &mut self.entries {
            Entries::Held(c, g) => {
                let line = c[r * size..(r + 1) * size].to_vec();
                if let Some(g) = g {
                    let image = g[r * size..(r + 1) * size].to_vec();
                    let own = image[r];
                    for (out, a) in g.chunks_exact_mut(size).zip(&column) {
                        let at = out[r];
                        add(out, -a, &image);
                        add(out, factor * (own * a - at), &line);
                    }
                }
                for (out, a) in c.chunks_exact_mut(size).zip(&column) {
                    add(out, -a, &line);
                }
            }
            Entries::Factors { n, image, .. } => {
                let line = image[r * *n..(r + 1) * *n].to_vec();
                for (out, a) in image.chunks_exact_mut(*n).zip(&column) {
                    add(out, -a, &line);
                }
            }
        }
        Some(())
    }
}

fn add(out: &mut [f64], factor: f64, line: &[f64]) {
    if factor != 0.0 {
        for (x, l) in out.iter_mut().zip(line) {
            *x += factor * l;
        }
    }
}
