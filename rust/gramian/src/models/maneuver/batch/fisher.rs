//! Fisher information of bearings along a path, trial by trial.

use alloc::vec::Vec;

use pulp::Simd;

use crate::batch::element::Element;
use crate::batch::lanes::Vector;
use crate::batch::simd::{Path, last_pairs, pairs, prefetch};
use crate::batch::{Items, Threads};
use crate::bearings;
use crate::bearings::batch::block_determinant;
use crate::maneuver::{Error, unchecked_row};
use crate::numbers::algebra::add_square;
use crate::numbers::lane::Lane;
use crate::scalar::{NumberError, all_finite, check_finite};
use crate::square_root::SquareRootInformation;

/// Samples that are taken apart into vectors at once.
const CHUNK: usize = 64;

/// A batch of paths from which bearings of one target each are taken.
#[derive(Clone, Copy, Debug)]
pub struct Sightings<'a, T = f64> {
    /// Positions of the observer (m, 2).
    pub positions: Items<'a, T>,
    /// East and north of a fixed target, or the state (x0, y0, vx, vy) of one at
    /// constant velocity, at the first time.
    pub target: Items<'a, T>,
    /// Times (m); empty for a fixed target.
    pub times: Items<'a, T>,
    /// Standard deviations: one, or one for each bearing.
    pub sigma: Items<'a, T>,
}

impl<T: Element> Sightings<'_, T> {
    /// Number of states: 2 for a fixed target, 4 for one at constant velocity.
    pub fn states(&self) -> usize {
        self.target.size()
    }

    /// The same input counted from trial `first` on.
    #[must_use]
    pub fn skip(self, first: usize) -> Self {
        Self {
            positions: self.positions.skip(first),
            target: self.target.skip(first),
            times: self.times.skip(first),
            sigma: self.sigma.skip(first),
        }
    }

    #[inline(always)]
    fn at(&self, trial: usize) -> Sighting<'_, T> {
        let (positions, _) = self.positions.get(trial).as_chunks::<2>();
        Sighting {
            positions,
            target: self.target.get(trial),
            times: self.times.get(trial),
            sigma: self.sigma.get(trial),
        }
    }
}

/// One trial of the batch.
#[derive(Clone, Copy)]
struct Sighting<'a, T> {
    positions: &'a [[T; 2]],
    target: &'a [T],
    times: &'a [T],
    sigma: &'a [T],
}

impl<T: Element> Sighting<'_, T> {
    /// Time since the first, offset of the target, and sigma of sample `i`.
    #[inline]
    fn sample(&self, i: usize) -> (T, T, T, T) {
        let [x, y] = self.positions[i];
        let sigma = self.sigma[if self.sigma.len() == 1 { 0 } else { i }];
        if let Some(state) = self.target.first_chunk::<4>() {
            let time = self.times[i] - self.times[0];
            let [east, north] = bearings::moved(state, time);
            (time, east - x, north - y, sigma)
        } else {
            (T::zero(), self.target[0] - x, self.target[1] - y, sigma)
        }
    }

    /// The sum row by row, for what exceeds the numbers of the vectors on its way, or
    /// what is wrong: the first sample that is on the target, or not finite.
    fn row_by_row(&self, out: &mut [T]) -> Result<(), Error> {
        let n = self.target.len();
        out.fill(T::zero());
        for i in 0..self.positions.len() {
            check_finite("positions", &self.positions[i])
                .map_err(|error| Error::from(error).at(i))?;
            let (time, east, north, sigma) = self.sample(i);
            let [a, b] = unchecked_row(east, north, sigma).map_err(|error| error.at(i))?;
            add_square(
                &[a, b, time * a, time * b][..n],
                T::one(),
                &mut out[..n * n],
            );
        }
        finish(n, out);
        if all_finite(out) {
            return Ok(());
        }
        let result = if all_finite(&out[..n * n]) {
            "determinant"
        } else {
            "information"
        };
        Err(NumberError::Overflow { result }.into())
    }
}

/// Samples of one call of a kernel, roughly: choosing a path takes as long as some of them.
const GROUP: usize = 4096;

/// Fisher information (n, n) of each trial, and its determinant after it where `out`
/// has room for n n + 1 numbers a trial (`determinant`). Positions that are not finite
/// are refused.
///
/// The determinant is that of the sums, and keeps half the digits of
/// [`fisher_det`]: where the information is nearly singular it is rounding noise.
///
/// # Errors
/// [`Error::OnTarget`] with the trial and the sample; [`Error::Number`] for a position
/// that is not finite and for information that overflows.
///
/// # Source
/// Xu et al. 2009, eqs. (9) and (10).
pub fn fisher<T: Element>(
    sightings: Sightings<'_, T>,
    determinant: bool,
    threads: Threads,
    path: Path,
    out: &mut [T],
) -> Result<(), (usize, Error)> {
    let n = sightings.states();
    let m = sightings.positions.size() / 2;
    let even = sightings.sigma.size() == 1;
    let moves = n == 4 && even && sightings.times.is_shared();
    let clock = if moves {
        let times = sightings.times.get(0);
        times.iter().flat_map(|&t| [t - times[0]; 2]).collect()
    } else {
        Vec::new()
    };
    let size = n * n + usize::from(determinant);
    let group = (GROUP / m.max(1)).clamp(1, 32);
    threads.over_groups(out, size, group, m as f64, |first, out| {
        let sightings = sightings.skip(first);
        if n == 2 && even {
            path.run(Fixed {
                sightings,
                size,
                out,
            });
        } else if moves {
            path.run(Moving {
                sightings,
                clock: &clock,
                size,
                out,
            });
        } else {
            path.run(Sums {
                sightings,
                size,
                out,
            });
        }
        for (trial, out) in out.chunks_exact_mut(size).enumerate() {
            // Zero ranges divide to infinity or NaN, and what is not finite stays so.
            if !all_finite(out) {
                sightings
                    .at(trial)
                    .row_by_row(out)
                    .map_err(|error| (first + trial, error))?;
            }
        }
        Ok(())
    })
}

/// Sums of a a, a b, b b over the rows (a, b) of fixed targets, one deviation for all
/// bearings of a trial: positions go straight from memory into vectors.
struct Fixed<'a, T> {
    sightings: Sightings<'a, T>,
    size: usize,
    out: &'a mut [T],
}

impl<T: Element> pulp::WithSimd for Fixed<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (trial, out) in self.out.chunks_exact_mut(self.size).enumerate() {
            let Sighting { target, sigma, .. } = self.sightings.at(trial);
            let target = splat(simd, target);
            let [sigma] = splat(simd, sigma);
            let places = self.sightings.positions.get(trial);
            let (whole, rest) = pairs::<S, T>(places);
            let mut sums = [Vector::splat(simd, T::zero()); 3];
            for (&place, numbers) in whole.iter().zip(places.chunks_exact(2 * T::lanes::<S>())) {
                prefetch(numbers);
                let place = pair::<S, T>(simd, T::lanes_of_pairs(simd, place));
                add(row(target, place, sigma), &mut sums);
            }
            if !rest.is_empty() {
                let (last, new) = last_pairs::<S, T>(simd, places, rest.len());
                let new = Vector::new(simd, new);
                let last = row(target, pair::<S, T>(simd, last), sigma);
                add([last[0] * new, last[1] * new], &mut sums);
            }
            let [xx, xy, yy] = total(&sums);
            out[..4].copy_from_slice(&[xx, xy, xy, yy]);
            finish(2, out);
        }
    }
}

/// The same for targets at constant velocity that are seen at the same times in all
/// trials: those sums, and the same times time and its square.
struct Moving<'a, T> {
    sightings: Sightings<'a, T>,
    /// Each time since the first, twice: in pairs, as the positions are, and so in the
    /// same order once they are taken apart.
    clock: &'a [T],
    size: usize,
    out: &'a mut [T],
}

impl<T: Element> pulp::WithSimd for Moving<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (times, _) = pairs::<S, T>(self.clock);
        for (trial, out) in self.out.chunks_exact_mut(self.size).enumerate() {
            let Sighting { target, sigma, .. } = self.sightings.at(trial);
            let state = splat(simd, target);
            let [sigma] = splat(simd, sigma);
            let places = self.sightings.positions.get(trial);
            let (whole, rest) = pairs::<S, T>(places);
            let mut sums = [Vector::splat(simd, T::zero()); 9];
            let numbers = places.chunks_exact(2 * T::lanes::<S>());
            for ((&place, &time), numbers) in whole.iter().zip(times).zip(numbers) {
                prefetch(numbers);
                let [time, _] = pair::<S, T>(simd, T::lanes_of_pairs(simd, time));
                let place = pair::<S, T>(simd, T::lanes_of_pairs(simd, place));
                let row = row(bearings::moved(&state, time), place, sigma);
                add_moved(row, time, &mut sums);
            }
            if !rest.is_empty() {
                let (last, new) = last_pairs::<S, T>(simd, places, rest.len());
                let (times, _) = last_pairs::<S, T>(simd, self.clock, rest.len());
                let ([time, _], new) = (pair::<S, T>(simd, times), Vector::new(simd, new));
                let last = row(
                    bearings::moved(&state, time),
                    pair::<S, T>(simd, last),
                    sigma,
                );
                add_moved([last[0] * new, last[1] * new], time, &mut sums);
            }
            spread(&total(&sums), 4, out);
            finish(4, out);
        }
    }
}

/// Sums of a a, a b, b b over the rows (a, b), times 1, time and its square.
struct Sums<'a, T> {
    sightings: Sightings<'a, T>,
    size: usize,
    out: &'a mut [T],
}

impl<T: Element> pulp::WithSimd for Sums<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let n = self.sightings.states();
        for (trial, out) in self.out.chunks_exact_mut(self.size).enumerate() {
            spread(&self.sightings.at(trial).sums(simd), n, out);
            finish(n, out);
        }
    }
}

impl<T: Element> Sighting<'_, T> {
    #[inline(always)]
    fn sums<S: Simd>(self, simd: S) -> [T; 9] {
        let sighting = self;
        let mut sums = [Vector::splat(simd, T::zero()); 9];
        // Samples beyond the last: far away, so that they add nothing.
        let far = [T::INFINITY; CHUNK];
        let mut start = 0;
        while start < sighting.positions.len() {
            let count = CHUNK.min(sighting.positions.len() - start);
            let (mut time, mut east, mut north) =
                ([T::zero(); CHUNK], [T::zero(); CHUNK], [T::zero(); CHUNK]);
            let mut noise = if count < CHUNK {
                far
            } else {
                [T::zero(); CHUNK]
            };
            for i in 0..count {
                let t;
                (t, east[i], north[i], noise[i]) = sighting.sample(start + i);
                time[i] = t;
            }
            for i in count..CHUNK {
                north[i] = T::one();
            }
            let (times, _) = T::registers::<S>(&time);
            let (easts, _) = T::registers::<S>(&east);
            let (norths, _) = T::registers::<S>(&north);
            let (noises, _) = T::registers::<S>(&noise);
            for v in 0..count.div_ceil(T::lanes::<S>()) {
                let offset = pair::<S, T>(simd, [easts[v], norths[v]]);
                let [time, sigma] = pair::<S, T>(simd, [times[v], noises[v]]);
                // Times are zero for a fixed target.
                add_moved(bearings::gradient(offset, sigma), time, &mut sums);
            }
            start += count;
        }
        total(&sums)
    }
}

/// Two vectors as numbers.
#[inline(always)]
fn pair<S: Simd, T: Element>(simd: S, [a, b]: [T::Register<S>; 2]) -> [Vector<S, T>; 2] {
    [Vector::new(simd, a), Vector::new(simd, b)]
}

/// The same numbers in all lanes.
#[inline(always)]
fn splat<S: Simd, T: Element, const N: usize>(simd: S, numbers: &[T]) -> [Vector<S, T>; N] {
    let mut all = [Vector::splat(simd, T::zero()); N];
    for i in 0..N {
        all[i] = Vector::splat(simd, numbers[i]);
    }
    all
}

/// The row (a, b) of a target seen from a place.
#[inline(always)]
fn row<L: Lane>(target: [L; 2], place: [L; 2], sigma: L) -> [L; 2] {
    bearings::gradient([target[0] - place[0], target[1] - place[1]], sigma)
}

/// What is added up of rows: the products a a, a b, b b.
#[inline(always)]
fn add<L: Lane>([a, b]: [L; 2], sums: &mut [L; 3]) {
    sums[0] = a.mul_add(a, sums[0]);
    sums[1] = a.mul_add(b, sums[1]);
    sums[2] = b.mul_add(b, sums[2]);
}

/// Those products, and the same times time and its square.
#[inline(always)]
fn add_moved<L: Lane>([a, b]: [L; 2], time: L, sums: &mut [L; 9]) {
    let (c, d) = (a * time, b * time);
    for (i, (x, y)) in [
        (a, a),
        (a, b),
        (b, b),
        (c, a),
        (c, b),
        (d, b),
        (c, c),
        (c, d),
        (d, d),
    ]
    .into_iter()
    .enumerate()
    {
        sums[i] = x.mul_add(y, sums[i]);
    }
}

/// The sum over the lanes of each.
#[inline(always)]
fn total<S: Simd, T: Element, const N: usize>(sums: &[Vector<S, T>; N]) -> [T; N] {
    let mut out = [T::zero(); N];
    for n in 0..N {
        out[n] = sums[n].sum();
    }
    out
}

/// The n x n matrix of blocks (xx, xy, yy) times the powers 0, 1, 2 of time.
#[inline(always)]
fn spread<T: Element>(sums: &[T; 9], n: usize, out: &mut [T]) {
    for i in 0..n {
        for j in 0..n {
            out[i * n + j] = sums[i % 2 + j % 2 + 3 * (i / 2 + j / 2)];
        }
    }
}

/// The determinant of the n x n matrix in `out`, after it where there is room.
#[inline(always)]
fn finish<T: Element>(n: usize, out: &mut [T]) {
    let Some((matrix, [det])) = out.split_at_mut_checked(n * n) else {
        return;
    };
    *det = if n == 2 {
        matrix[0] * matrix[3] - matrix[1] * matrix[2]
    } else {
        // Sums of a a, a b, b b, each times 1, time and its square.
        let sums = |at: [usize; 3]| at.map(|i| matrix[i]);
        block_determinant(&sums([0, 2, 10]), &sums([1, 3, 11]), &sums([5, 7, 15]))
    };
}

/// How a determinant of the information is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Determinant {
    /// From the triangular factor of the rows: O(m).
    Root,
    /// The sum over pairs of bearings of sin^2 of their difference, over both
    /// ranges and deviations squared: O(m^2), fixed targets alone.
    Pairs,
}

/// The determinant of the information of each trial.
///
/// # Errors
/// As [`row`](crate::maneuver::row), with the trial and the sample.
///
/// # Source
/// Xu et al. 2009, eq. (14), for [`Determinant::Pairs`].
pub fn fisher_det(
    sightings: Sightings<'_>,
    method: Determinant,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let m = sightings.positions.size() / 2;
    let cost = match method {
        Determinant::Root => 40.0 * m as f64,
        Determinant::Pairs => (m * m) as f64,
    };
    threads.over(out, 1, cost, |trial, out| {
        let sighting = sightings.at(trial);
        out[0] = if sightings.states() == 4 {
            root_det_moving(sighting)
        } else if method == Determinant::Pairs {
            pairs_det(sighting)
        } else {
            root_det(sighting)
        }
        .map_err(|error| (trial, error))?;
        Ok(())
    })
}

fn root_det(sighting: Sighting<'_, f64>) -> Result<f64, Error> {
    let mut root = SquareRootInformation::<f64, 2>::new();
    for i in 0..sighting.positions.len() {
        let (_, east, north, sigma) = sighting.sample(i);
        root.absorb(&unchecked_row(east, north, sigma).map_err(|error| error.at(i))?);
    }
    Ok(root.determinant())
}

fn root_det_moving(sighting: Sighting<'_, f64>) -> Result<f64, Error> {
    let mut root = SquareRootInformation::<f64, 4>::new();
    for i in 0..sighting.positions.len() {
        let (time, east, north, sigma) = sighting.sample(i);
        let row = bearings::unchecked_row(time, east, north, sigma)
            .map_err(|_| Error::OnTarget { index: i })?;
        root.absorb(&row);
    }
    Ok(root.determinant())
}

fn pairs_det(sighting: Sighting<'_, f64>) -> Result<f64, Error> {
    let mut sum = 0.0;
    for i in 0..sighting.positions.len() {
        let (_, east, north, sigma) = sighting.sample(i);
        let [a, b] = unchecked_row(east, north, sigma).map_err(|error| error.at(i))?;
        for j in 0..i {
            let (_, east, north, sigma) = sighting.sample(j);
            let weight = 1.0 / ((east * east + north * north) * sigma);
            // sin of the difference over both ranges: the rows' cross product.
            let cross = weight * (a * east + b * north);
            sum += cross * cross;
        }
    }
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;
    use alloc::vec::Vec;

    #[test]
    fn one_deviation_for_all_bearings_gives_the_sum_of_the_rows() {
        let mut stream = crate::batch::Stream::new(6, 0);
        let trials = 11;
        for (m, n) in [1, 2, 3, 7, 8, 9, 16, 100, 149]
            .into_iter()
            .flat_map(|m| [(m, 2), (m, 4)])
        {
            let mut draw = |count: usize, size: f64, middle: f64| -> Vec<f64> {
                (0..count)
                    .map(|_| middle + size * stream.normal())
                    .collect()
            };
            let positions = draw(2 * m * trials, 100.0, 0.0);
            let mut target = draw(n * trials, 50.0, 900.0);
            for state in target.chunks_exact_mut(n).filter(|_| n == 4) {
                // Fast enough to be somewhere else at the end, never at the path.
                (state[2], state[3]) = (3.0, 0.02 * state[1]);
            }
            let times: Vec<f64> = (0..m).map(|i| 5.0 + 1.5 * i as f64).collect();
            let sigma = [0.03];
            let sightings = Sightings {
                positions: Items::each(&positions, 2 * m),
                target: Items::each(&target, n),
                times: Items::shared(if n == 4 { &times } else { &[] }),
                sigma: Items::shared(&sigma),
            };
            let size = n * n;
            let mut plain = vec![0.0; size * trials];
            for (trial, out) in plain.chunks_exact_mut(size).enumerate() {
                assert_eq!(sightings.at(trial).row_by_row(out), Ok(()));
            }
            for path in Path::available() {
                let mut out = vec![0.0; size * trials];
                assert_eq!(
                    fisher(sightings, false, Threads::One, path, &mut out),
                    Ok(())
                );
                for (found, wanted) in out.chunks(size).zip(plain.chunks(size)) {
                    for i in 0..n {
                        for j in 0..n {
                            let scale = (wanted[i * n + i] * wanted[j * n + j]).sqrt();
                            let (a, b) = (found[i * n + j], wanted[i * n + j]);
                            assert!((a - b).abs() <= 1e-14 * scale, "{path:?} {m}: {a} {b}");
                        }
                    }
                }
                let mut both = vec![0.0; (size + 1) * trials];
                assert_eq!(
                    fisher(sightings, true, Threads::One, path, &mut both),
                    Ok(())
                );
                let mut wanted = vec![0.0; trials];
                assert_eq!(
                    fisher_det(sightings, Determinant::Root, Threads::One, &mut wanted),
                    Ok(())
                );
                for (trial, both) in both.chunks(size + 1).enumerate() {
                    assert_eq!(both[..size], out[size * trial..size * (trial + 1)]);
                    // Of the sums: exact to the rounding of the product of the diagonal.
                    let scale: f64 = (0..n).map(|i| both[i * n + i]).product();
                    let error = (both[size] - wanted[trial]).abs();
                    assert!(error <= 1e-14 * scale, "{path:?} {m} {n}: {error} {scale}");
                }
                // Without anything left over from a trial's neighbours.
                let mut alone = vec![0.0; size];
                let last = sightings.skip(trials - 1);
                assert_eq!(fisher(last, false, Threads::One, path, &mut alone), Ok(()));
                assert_eq!(out[size * (trials - 1)..], alone);
            }
        }
    }

    #[test]
    fn what_the_vectors_cannot_hold_is_summed_row_by_row_or_refused() {
        let sigma = [1.0];
        for path in Path::available() {
            let one = |place: f64, target: f64| {
                let mut positions = [5.0; 22];
                (positions[12], positions[13]) = (place, 7.0);
                let target = [target, 7.0];
                let sightings = Sightings {
                    positions: Items::shared(&positions),
                    target: Items::shared(&target),
                    times: Items::shared(&[]),
                    sigma: Items::shared(&sigma),
                };
                let mut out = [0.0; 4];
                fisher(sightings, false, Threads::One, path, &mut out).map(|()| out)
            };
            assert_eq!(one(3.0, 3.0), Err((0, Error::OnTarget { index: 6 })));
            for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                assert!(
                    matches!(
                        one(wrong, 3.0),
                        Err((0, Error::Number(NumberError::NotFinite { index: 6, .. })))
                    ),
                    "{path:?} {wrong}"
                );
            }
            // At 1e-170 m the square vanishes, at 1e-150 m it does not.
            assert!(matches!(
                one(0.0, 1e-170),
                Err((0, Error::Number(NumberError::Overflow { .. })))
            ));
            let near = one(0.0, 1e-150).map(|out| out[3]);
            assert!(near.is_ok_and(|yy| (yy * 1e-300 - 1.0).abs() < 1e-14));
        }
    }

    #[test]
    fn every_path_gives_the_sum_of_the_rows() {
        let m = 149;
        let mut stream = crate::batch::Stream::new(5, 0);
        let positions: Vec<f64> = (0..2 * m).map(|_| 100.0 * stream.normal()).collect();
        let times: Vec<f64> = (0..m).map(f64::from).collect();
        let sigma: Vec<f64> = (0..m).map(|_| 0.01 + stream.uniform()).collect();
        for target in [vec![900.0, 300.0], vec![900.0, 300.0, 2.0, -1.0]] {
            let n = target.len();
            let sightings = Sightings {
                positions: Items::shared(&positions),
                target: Items::shared(&target),
                times: Items::shared(&times),
                sigma: Items::shared(&sigma),
            };
            let mut plain = vec![0.0; n * n];
            for i in 0..positions.len() / 2 {
                let (time, east, north, sigma) = sightings.at(0).sample(i);
                let [a, b] = unchecked_row(east, north, sigma).unwrap_or([f64::NAN; 2]);
                let row = [a, b, time * a, time * b];
                for j in 0..n {
                    for k in 0..n {
                        plain[j * n + k] += row[j] * row[k];
                    }
                }
            }
            #[allow(clippy::cast_possible_truncation)]
            let single = |all: &[f64]| -> Vec<f32> { all.iter().map(|&x| x as f32).collect() };
            let (places, goal) = (single(&positions), single(&target));
            let (clock, noise) = (single(&times), single(&sigma));
            let in_single = Sightings {
                positions: Items::shared(&places),
                target: Items::shared(&goal),
                times: Items::shared(&clock),
                sigma: Items::shared(&noise),
            };
            for path in Path::available() {
                let mut out = vec![0.0; n * n];
                assert_eq!(
                    fisher(sightings, false, Threads::One, path, &mut out),
                    Ok(())
                );
                for (a, b) in out.iter().zip(&plain) {
                    assert!((a - b).abs() <= 1e-12 * plain[0].max(b.abs()), "{a} {b}");
                }
                let mut out = vec![0.0_f32; n * n];
                assert_eq!(
                    fisher(in_single, false, Threads::One, path, &mut out),
                    Ok(())
                );
                for (a, b) in out.iter().zip(&plain) {
                    let off = (f64::from(*a) - b).abs();
                    assert!(off <= 3e-6 * plain[0].max(b.abs()), "{path:?} {a} {b}");
                }
            }
        }
    }
}
