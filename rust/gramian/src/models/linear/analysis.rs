//! Levels of one system whose size is known at run time, with everything that
//! can be read from its staircase form.
//!
//! ```
//! use gramian::linear::analysis::Analysis;
//! // A position, its rate, and a state that nothing couples; the position is measured.
//! let a = [0.0_f64, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
//! let found = Analysis::new(&a, &[1.0, 0.0, 0.0], 3, None).unwrap();
//! assert_eq!(found.rank(), 2);
//! assert_eq!(found.state_levels().unwrap(), [Some(0), Some(1), None]);
//! ```

use alloc::vec;
use alloc::vec::Vec;

use super::Error;
use super::scaling::{self, Systems, Work};
use super::staircase::{self, Found, Staircase};
use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length};
use crate::spectrum::check_rtol;

/// Ranks, levels, kernel and determined combinations of a system.
///
/// # Source
/// As [`levels`](super::levels): the staircase form of Rosenbrock and Van Dooren.
#[derive(Clone, Debug)]
pub struct Analysis<T> {
    n: usize,
    /// What a balanced state is multiplied by to give the physical one.
    scale: Vec<T>,
    /// Orthonormal directions in balanced states, those of level 0 first.
    basis: Vec<T>,
    ranks: Vec<usize>,
    rank: usize,
    reliable: bool,
    undecided: bool,
    found: Found<T>,
    rtol: T,
}

impl<T: Real> Analysis<T> {
    /// Analyses A (n x n) and C (p x n), row-major. Couplings below `rtol` of the
    /// balanced norms count as zero; by default
    /// [`default_rtol`](super::default_rtol).
    ///
    /// # Errors
    /// [`NumberError::Length`] where A is not n x n with n >= 1 or C not p x n,
    /// [`Error::Number`] for what is not finite, a tolerance that is not in [0, 1), or
    /// a balanced system whose squares overflow.
    pub fn new(a: &[T], c: &[T], n: usize, rtol: Option<T>) -> Result<Self, Error> {
        let p = c.len().checked_div(n).unwrap_or(0);
        let mut forms = Self::of_segments(a, c, n, p, 1, rtol)?;
        forms.pop().ok_or(Error::Number(NumberError::Length {
            array: "A",
            given: a.len(),
            wanted: n * n,
        }))
    }

    /// The same for several systems A (segments, n, n), C (segments, p, n), all
    /// in the same balanced states.
    pub(super) fn of_segments(
        a: &[T],
        c: &[T],
        n: usize,
        p: usize,
        segments: usize,
        rtol: Option<T>,
    ) -> Result<Vec<Self>, Error> {
        check_length("states", n, n.max(1))?;
        check_length("A", a.len(), segments.saturating_mul(n.saturating_mul(n)))?;
        check_length("outputs", p, p.max(1))?;
        check_length("C", c.len(), segments.saturating_mul(p.saturating_mul(n)))?;
        check_finite("A", a)?;
        check_finite("C", c)?;
        if let Some(rtol) = rtol {
            check_rtol(rtol)?;
        }
        let (mut a, mut c) = (a.to_vec(), c.to_vec());
        let balanced = balance(&mut a, &mut c, n);
        let scale = balanced.states;
        scaling::check(&a, &c, n)?;
        let given = rtol;
        let rtol = rtol.unwrap_or_else(|| staircase::default_rtol(n));
        let mut rows = vec![T::zero(); n.max(p) * n];
        let (mut v, mut w) = (vec![T::zero(); n], vec![T::zero(); n]);
        a.chunks_exact(n * n)
            .zip(c.chunks_exact(p * n))
            .zip(&balanced.centers)
            .map(|((a, c), &center)| {
                let mut basis = vec![T::zero(); n * n];
                let mut ranks = vec![0; n];
                let form = Staircase {
                    n,
                    stride: n,
                    a,
                    c,
                    basis: &mut basis,
                    rows: &mut rows,
                };
                let mut found = form.reduce(rtol, &mut v, &mut w, &mut ranks);
                if !found.reliable(n) {
                    found.growth = growth(a, &basis, &ranks, &found);
                }
                let rank = ranks.last().copied().unwrap_or(0);
                let mut form = Self {
                    n,
                    scale: scale.clone(),
                    basis,
                    ranks,
                    rank,
                    reliable: found.reliable(n),
                    undecided: false,
                    found,
                    rtol,
                };
                let center = center * balanced.time;
                form.reliable &= found.above_rounding_of(center, n);
                if !form.reliable {
                    form.decide_on_the_pencil(a, c, given, center)?;
                }
                Ok(form)
            })
            .collect()
    }

    /// Rank and kernel where the staircase cannot be relied on.
    fn decide_on_the_pencil(
        &mut self,
        a: &[T],
        c: &[T],
        rtol: Option<T>,
        center: T,
    ) -> Result<(), Error> {
        let double = |x: &[T]| x.iter().map(|x| x.double()).collect::<Vec<f64>>();
        // In single precision the tolerance is that of its rounding.
        let rtol = if T::EPSILON.double() > 1e-10 {
            Some(self.rtol.double())
        } else {
            rtol.map(T::double)
        };
        let (a, c, center) = (double(a), double(c), center.double());
        let decided = super::unobservable::decided(&a, &c, self.n, rtol, center)?;
        self.undecided = decided.undecided;
        self.rank = self.n - decided.dimension();
        self.basis = decided
            .row_space
            .iter()
            .chain(&decided.kernel)
            .map(|&x| T::of(x))
            .collect();
        self.found.rejected = T::of(decided.rejected);
        self.found.weakest = T::of(decided.weakest.min(1.0));
        Ok(())
    }

    /// Rank of `O_k` for k = 0..n; `None` where rounding grows so much over the steps
    /// that they cannot be told. [`rank`](Self::rank) and the kernel are right all the same.
    pub fn ranks(&self) -> Option<&[usize]> {
        self.reliable.then_some(&self.ranks)
    }

    /// Whether the rank may be larger: a singular value of the pencil is so near to rounding
    /// that it may be zero, and was counted as zero.
    pub fn undecided(&self) -> bool {
        self.undecided
    }

    /// The rank of the whole observability matrix.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// How clear the rank decisions were.
    pub fn found(&self) -> Found<T> {
        self.found
    }

    /// The tolerance they were made with.
    pub fn rtol(&self) -> T {
        self.rtol
    }

    /// What a balanced state is multiplied by to give the physical one.
    pub fn scale(&self) -> &[T] {
        &self.scale
    }

    /// The directions that span the row space of the observability matrix, in
    /// balanced states.
    pub fn row_space(&self) -> &[T] {
        &self.basis[..self.rank() * self.n]
    }

    /// The directions that no derivative of the output sees, in balanced states.
    pub fn kernel(&self) -> &[T] {
        &self.basis[self.rank() * self.n..]
    }

    /// The level of each state; `None` for all where levels cannot be told.
    pub fn state_levels(&self) -> Option<Vec<Option<usize>>> {
        if !self.reliable {
            return None;
        }
        let mut levels = vec![None; self.n];
        let touch = self.found.touch(self.rtol);
        staircase::state_levels(
            &self.basis,
            self.n,
            self.n,
            &self.ranks,
            touch,
            |i, level| {
                levels[i] = level;
            },
        );
        Some(levels)
    }

    fn check_reliable(&self) -> Result<(), Error> {
        if self.reliable {
            return Ok(());
        }
        Err(Error::Levels {
            growth: self.found.growth.double(),
        })
    }

    /// The part of combination^T x, relative to the whole in balanced states,
    /// that `O_k` leaves open, for k = 0..n.
    ///
    /// # Errors
    /// [`NumberError::Length`]; [`Error::Number`] for what is not finite, a combination
    /// that is zero, or so large or small in balanced states that it is no number;
    /// [`Error::Levels`] where levels cannot be told.
    pub fn residuals(&self, combination: &[T]) -> Result<Vec<T>, Error> {
        self.check_reliable()?;
        let n = self.n;
        check_length("combination", combination.len(), n)?;
        check_finite("combination", combination)?;
        let mut scaled: Vec<T> = combination
            .iter()
            .zip(&self.scale)
            .map(|(&c, &d)| c * d)
            .collect();
        let largest = scaled.iter().fold(T::zero(), |top, x| top.max(x.abs()));
        let unit = T::one() / largest;
        if !(unit > T::zero() && unit.is_finite()) {
            return Err(NumberError::OutOfRange {
                name: "combination",
                given: largest.double(),
                allowed: "neither zero nor infinite in balanced states",
            }
            .into());
        }
        for x in &mut scaled {
            *x *= unit;
        }
        let whole = dot(&scaled, &scaled);
        let mut left = T::zero();
        // From the last direction on, so that small parts are not lost.
        let mut tails = vec![T::zero(); n + 1];
        for k in (0..n).rev() {
            let part = dot(&self.basis[k * n..(k + 1) * n], &scaled);
            left += part * part;
            tails[k] = left;
        }
        Ok(self
            .ranks
            .iter()
            .map(|&rank| (tails[rank] / whole).sqrt())
            .collect())
    }

    /// The level of a combination: the first k that leaves no more than
    /// `tolerance` of it open; by default what rounding explains.
    ///
    /// # Errors
    /// As [`residuals`](Self::residuals); [`Error::Number`] for a tolerance that is
    /// not finite.
    pub fn level_of(
        &self,
        combination: &[T],
        tolerance: Option<T>,
    ) -> Result<Option<usize>, Error> {
        check_finite("tolerance", tolerance.as_slice())?;
        let tolerance = tolerance.unwrap_or_else(|| self.found.touch(self.rtol));
        let residuals = self.residuals(combination)?;
        Ok(residuals.iter().position(|&left| left <= tolerance))
    }

    /// Basis of the combinations that no derivative determines, in physical
    /// units: each has a state with coefficient 1 that the others do not have.
    ///
    /// # Errors
    /// [`Error::Number`] where the units of two states differ so much that their
    /// ratio overflows.
    pub fn null_space(&self) -> Result<Vec<Vec<T>>, Error> {
        let touch = self.found.touch(self.rtol);
        let basis = reduced_null_space(self.kernel(), &self.scale, touch).0;
        check_vectors(&basis)?;
        Ok(basis)
    }

    /// What `O_k` determines beyond `O_{k-1}`, for each k up to the last that adds
    /// something: combinations of the physical states, each with a state of
    /// coefficient 1 that none of the others, here or before, contains.
    ///
    /// # Errors
    /// As [`null_space`](Self::null_space), and [`Error::Levels`].
    pub fn combinations(&self) -> Result<Vec<Vec<Vec<T>>>, Error> {
        self.check_reliable()?;
        let n = self.n;
        let touch = self.found.touch(self.rtol);
        // The states that parametrise the kernel do not serve as leaders.
        let (_, free) = reduced_null_space(self.kernel(), &self.scale, touch);
        let mut leaders: Vec<usize> = Vec::new();
        let mut reduced: Vec<Vec<T>> = Vec::new();
        let mut levels: Vec<Vec<Vec<T>>> = Vec::new();
        let mut first = 0;
        for &rank in &self.ranks {
            if rank == first {
                break;
            }
            let block: Vec<Vec<T>> = (first..rank)
                .map(|k| {
                    let mut row = self.basis[k * n..(k + 1) * n].to_vec();
                    for (leader, known) in leaders.iter().zip(&reduced) {
                        let factor = row[*leader];
                        scaling::add(&mut row, -factor, known);
                    }
                    row
                })
                .collect();
            let allowed = |i: usize| !free.contains(&i) && !leaders.contains(&i);
            let (block, found) = reduce(block, allowed);
            leaders.extend(&found);
            reduced.extend(block.iter().cloned());
            levels.push(
                block
                    .into_iter()
                    .zip(&found)
                    .map(|(row, &leader)| {
                        let lead = self.scale[leader];
                        row.iter()
                            .zip(&self.scale)
                            .map(|(&x, &scale)| {
                                if x.abs() <= touch {
                                    T::zero()
                                } else {
                                    x / scale * lead
                                }
                            })
                            .collect()
                    })
                    .collect(),
            );
            first = rank;
        }
        for level in &levels {
            check_vectors(level)?;
        }
        Ok(levels)
    }
}

fn check_vectors<T: Real>(vectors: &[Vec<T>]) -> Result<(), NumberError> {
    if vectors.iter().all(|vector| all_finite(vector)) {
        return Ok(());
    }
    Err(NumberError::Overflow {
        result: "combination in physical units",
    })
}

/// How much the steps of a staircase magnify an error: what step k leaves open by what
/// the steps before do, with the sizes of the blocks of A between them.
fn growth<T: Real>(a: &[T], basis: &[T], ranks: &[usize], found: &Found<T>) -> T {
    let n = ranks.len();
    let size = a
        .chunks_exact(n)
        .fold(T::zero(), |size, row| size.max(dot(row, row)))
        .sqrt();
    if !(size > T::zero()) {
        return T::one() / found.weakest;
    }
    // Rows i: the i-th direction through A, in the basis.
    let mut through = vec![T::zero(); n * n];
    let mut image = vec![T::zero(); n];
    for i in 0..n {
        image.fill(T::zero());
        for (&x, line) in basis[i * n..(i + 1) * n].iter().zip(a.chunks_exact(n)) {
            scaling::add(&mut image, x / size, line);
        }
        for j in 0..n {
            through[i * n + j] = dot(&image, &basis[j * n..(j + 1) * n]);
        }
    }
    let mut bounds = vec![0];
    for &rank in ranks {
        if bounds.last() != Some(&rank) {
            bounds.push(rank);
        }
    }
    let mut open: Vec<T> = Vec::new();
    let mut largest = T::zero();
    for k in 0..bounds.len() - 1 {
        let (first, last) = (bounds[k], bounds[k + 1]);
        // The outputs were made of length one: their own smallest part is `weakest` at worst.
        let (mut sum, coupling) = if k == 0 {
            (T::one(), found.first)
        } else {
            let before = bounds[k - 1]..first;
            let mut sum = T::one() + open[k - 1];
            for (j, &part) in open.iter().enumerate() {
                let mut squared = T::zero();
                for i in before.clone() {
                    let row = &through[i * n + bounds[j]..i * n + bounds[j + 1]];
                    squared += dot(row, row);
                }
                sum += squared.sqrt() * part;
            }
            // The smallest direction of the block that leads to the new one: by rows,
            // each without its part along those before it.
            let mut rows: Vec<Vec<T>> = before
                .map(|i| through[i * n + first..i * n + last].to_vec())
                .collect();
            (sum, smallest_pivot(&mut rows, last - first))
        };
        sum /= coupling;
        open.push(sum);
        largest = largest.max(sum);
    }
    largest
}

/// The smallest of `count` pivots of an orthogonalisation with the largest row first.
fn smallest_pivot<T: Real>(rows: &mut [Vec<T>], count: usize) -> T {
    let mut smallest = T::INFINITY;
    for _ in 0..count {
        let Some(best) = rows
            .iter()
            .map(|row| dot(row, row))
            .enumerate()
            .max_by(|x, y| x.1.double().total_cmp(&y.1.double()))
        else {
            return T::zero();
        };
        let norm = best.1.sqrt();
        smallest = smallest.min(norm);
        if !(norm > T::zero()) {
            return T::zero();
        }
        let pivot: Vec<T> = rows[best.0].iter().map(|&x| x / norm).collect();
        for row in rows.iter_mut() {
            let along = dot(row, &pivot);
            scaling::add(row, -along, &pivot);
        }
    }
    smallest
}

/// What [`balance`] did.
pub(super) struct Balanced<T> {
    /// What a balanced state is multiplied by to give the physical one.
    pub states: Vec<T>,
    /// What the unit of time was multiplied by.
    pub time: T,
    /// What was taken from the diagonal of each A before.
    pub centers: Vec<T>,
}

/// Centers and balances the systems in place.
pub(super) fn balance<T: Real>(a: &mut [T], c: &mut [T], n: usize) -> Balanced<T> {
    let outputs = c.len().checked_div(n).unwrap_or(0);
    let mut states = vec![T::zero(); n];
    let centers = a
        .chunks_exact_mut(n * n)
        .map(|block| staircase::center(block, n, n, &mut states))
        .collect();
    let mut output_scales = vec![T::zero(); outputs];
    let (mut pattern, mut see) = (vec![T::zero(); n * n], vec![T::zero(); outputs * n]);
    let (mut state, mut output) = (vec![T::zero(); 5 * n], vec![T::zero(); 4 * outputs]);
    let systems = Systems { a, c, n, stride: n };
    let work = Work {
        pattern: &mut pattern,
        outputs_see: &mut see,
        state: &mut state,
        output: &mut output,
    };
    let balance = scaling::balance(systems, work, &mut states, &mut output_scales);
    balance.apply(&states, &output_scales, a, c);
    Balanced {
        states,
        time: balance.time,
        centers,
    }
}

/// The kernel directions `null` (rows, balanced) in physical units, reduced;
/// and the states that lead them.
pub(super) fn reduced_null_space<T: Real>(
    null: &[T],
    scale: &[T],
    touch: T,
) -> (Vec<Vec<T>>, Vec<usize>) {
    let rows = null.chunks_exact(scale.len()).map(<[T]>::to_vec).collect();
    let (rows, leaders) = reduce(rows, |_| true);
    let physical = rows
        .into_iter()
        .zip(&leaders)
        .map(|(row, &leader)| {
            row.iter()
                .zip(scale)
                .map(|(&x, &d)| {
                    if x.abs() <= touch {
                        T::zero()
                    } else {
                        x * d / scale[leader]
                    }
                })
                .collect()
        })
        .collect();
    (physical, leaders)
}

/// Gauss-Jordan elimination of independent rows: each gets a leading column,
/// 1 there and 0 in the other rows; rows in the order of their leaders. A leader
/// is the first allowed column that is within a factor of a thousand of the best:
/// three digits of sixteen for leaders that neither rounding nor a unit changes.
fn reduce<T: Real>(
    mut rows: Vec<Vec<T>>,
    allowed: impl Fn(usize) -> bool,
) -> (Vec<Vec<T>>, Vec<usize>) {
    let mut leaders: Vec<usize> = Vec::new();
    for k in 0..rows.len() {
        let columns = rows[k].len();
        let largest = |i: usize| {
            rows[k..]
                .iter()
                .map(|row| row[i].abs())
                .fold(T::zero(), |x, y| if y > x { y } else { x })
        };
        let best_of = |pick: &dyn Fn(usize) -> bool| {
            (0..columns)
                .filter(|i| pick(*i) && !leaders.contains(i))
                .map(&largest)
                .fold(T::zero(), |x, y| if y > x { y } else { x })
        };
        let any = best_of(&|_| true);
        let wanted = best_of(&allowed);
        // Without a good allowed column any other will do.
        let (restrict, best) = if wanted > T::of(1e-3) * any {
            (true, wanted)
        } else {
            (false, any)
        };
        let column = (0..columns).find(|&i| {
            !leaders.contains(&i) && (!restrict || allowed(i)) && largest(i) >= T::of(1e-3) * best
        });
        let Some(column) = column.filter(|_| best > T::zero()) else {
            continue;
        };
        let mut pivot = k;
        for r in k + 1..rows.len() {
            if rows[r][column].abs() > rows[pivot][column].abs() {
                pivot = r;
            }
        }
        rows.swap(k, pivot);
        leaders.push(column);
        let lead = rows[k][column];
        for x in &mut rows[k] {
            *x /= lead;
        }
        let leading = rows[k].clone();
        for (r, row) in rows.iter_mut().enumerate() {
            if r != k {
                let factor = row[column];
                scaling::add(row, -factor, &leading);
                row[column] = T::zero();
            }
        }
    }
    let mut order: Vec<usize> = (0..leaders.len()).collect();
    order.sort_by_key(|&k| leaders[k]);
    let sorted = order
        .iter()
        .map(|&k| core::mem::take(&mut rows[k]))
        .collect();
    (sorted, order.iter().map(|&k| leaders[k]).collect())
}
