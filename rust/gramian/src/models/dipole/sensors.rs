//! Sensors, and what each of them measures of the field.

use super::{Error, Pass, field, jacobian, quadrupole};
use crate::numbers::algebra::dot;
use crate::numbers::lane::Lane;
use crate::rows::RowSink;
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length, finite};

/// Sensors of one kind: of three components or of the total field, of the field itself or of
/// its difference between two places.
///
/// ```
/// use gramian::dipole::{Pass, Sensors};
/// let pass = Pass::of(&[-3.0, 2.0, 1.0, 1.0, 0.0, 0.0, 10.0, 20.0, 10.0]);
/// let here = Sensors::vector(&[[0.0; 3], [0.0, 0.5, 0.0]]);
/// let difference = Sensors { places: &[[0.0; 3]], baselines: &[[0.0, 0.5, 0.0]], ambient: None };
/// let (mut both, mut gradient) = ([0.0; 6], [0.0; 3]);
/// here.measure(&[0.0], &pass, &mut both).unwrap();
/// difference.measure(&[0.0], &pass, &mut gradient).unwrap();
/// assert_eq!(gradient[0], both[3] - both[0]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensors<'a, T = f64> {
    /// Where they are, m.
    pub places: &'a [[T; 3]],
    /// Of gradiometers, from each to its second head, m: what is measured is that of the second
    /// less that of the first. Empty where each sensor has one head.
    pub baselines: &'a [[T; 3]],
    /// Of sensors of the total field, |ambient + field|: the field without the dipole, T.
    pub ambient: Option<[T; 3]>,
}

/// One end of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head<T> {
    /// Where it is, m.
    pub place: [T; 3],
    /// By what it counts: 1, or -1 for the first head of a gradiometer.
    pub sign: T,
}

impl<'a, T: Real> Sensors<'a, T> {
    /// Sensors of three components.
    pub fn vector(places: &'a [[T; 3]]) -> Self {
        Self {
            places,
            baselines: &[],
            ambient: None,
        }
    }

    /// Whether each has one head of three components.
    pub fn plain(&self) -> bool {
        self.baselines.is_empty() && self.ambient.is_none()
    }

    /// How many numbers one sample of one sensor has.
    pub fn components(&self) -> usize {
        if self.ambient.is_some() { 1 } else { 3 }
    }

    /// How many numbers one sample of all has.
    pub fn channels(&self) -> usize {
        self.components() * self.places.len()
    }

    /// The heads of a sensor: one, or the second and the first of a gradiometer.
    pub fn heads(&self, sensor: usize) -> impl Iterator<Item = Head<T>> + use<T> {
        let place = self.places[sensor];
        let (first, second) = match self.baselines.get(sensor) {
            None => {
                let sign = T::one();
                (Head { place, sign }, None)
            }
            Some(baseline) => (
                Head {
                    place: core::array::from_fn(|i| place[i] + baseline[i]),
                    sign: T::one(),
                },
                Some(Head {
                    place,
                    sign: -T::one(),
                }),
            ),
        };
        core::iter::once(first).chain(second)
    }

    /// What a reading has without a dipole: the ambient field's size at a sensor of one head, or 0.
    pub fn quiet(&self) -> T {
        match &self.ambient {
            Some(ambient) if self.baselines.is_empty() => length(ambient),
            _ => T::zero(),
        }
    }

    /// Direction of the ambient field, for sensors of the total field.
    pub fn along(&self) -> Option<[T; 3]> {
        self.ambient.map(|ambient| {
            let size = length(&ambient);
            // Of no field there is no direction: nothing is seen then.
            ambient.map(|a| if size > T::zero() { a / size } else { a })
        })
    }

    /// Writes what they read of a pass: sample after sample, in each sensor after sensor. Time
    /// is counted from `times[0]`.
    ///
    /// # Errors
    /// [`Error::OnSensor`] with the sample; [`NumberError::Length`] where `out` does not
    /// have a place for each number, or baselines are not as many as places;
    /// [`Error::Number`] for what is not finite, or a distance or field that overflows.
    ///
    /// # Source
    /// Dai et al. 2020, eq. (2), along a straight pass.
    pub fn measure(&self, times: &[T], pass: &Pass<T>, out: &mut [T]) -> Result<(), Error> {
        self.measure_body(times, pass, None, out)
    }

    /// [`measure`](Self::measure) of a body that may have a [`quadrupole`] too, at the same place.
    ///
    /// # Errors
    /// As [`measure`](Self::measure).
    pub fn measure_body(
        &self,
        times: &[T],
        pass: &Pass<T>,
        quadrupole: Option<&[T; 5]>,
        out: &mut [T],
    ) -> Result<(), Error> {
        let wanted = times.len().saturating_mul(self.channels());
        check_length("out", out.len(), wanted)?;
        self.check(times, pass)?;
        if self.plain() {
            // Nothing is summed up over heads, and the field is finite or an error.
            let mut numbers = out.as_chunks_mut::<3>().0.iter_mut();
            for (k, &time) in times.iter().enumerate() {
                for (sensor, to) in self.places.iter().zip(&mut numbers) {
                    let place = pass.offset(sensor, time - times[0]);
                    *to = seen(&place, pass, quadrupole).map_err(|error| error.at(k))?;
                }
            }
            return Ok(());
        }
        out.fill(self.quiet());
        let mut places = out.chunks_exact_mut(self.components());
        for (k, &time) in times.iter().enumerate() {
            for sensor in 0..self.places.len() {
                let Some(out) = places.next() else { break };
                for head in self.heads(sensor) {
                    let place = pass.offset(&head.place, time - times[0]);
                    let h = seen(&place, pass, quadrupole).map_err(|error| error.at(k))?;
                    match &self.ambient {
                        None => (0..3).for_each(|i| out[i] += head.sign * h[i]),
                        Some(ambient) => out[0] += head.sign * excess(ambient, &h)?.0,
                    }
                }
            }
        }
        if all_finite(out) {
            Ok(())
        } else {
            Err(NumberError::Overflow { result: "field" }.into())
        }
    }

    /// Pushes the whitened rows of a pass, in the order of [`measure`](Self::measure).
    ///
    /// `sigma` is one standard deviation in tesla for all numbers, one for each sample, or one
    /// for each number; infinite for what was not measured, whose rows are zero.
    ///
    /// # Errors
    /// [`Error::OnSensor`] with the sample, [`Error::Sigma`], [`NumberError::Length`];
    /// [`Error::Number`] for what is not finite, or rows that overflow.
    ///
    /// # Source
    /// Dai et al. 2020, eqs. (18)-(19).
    ///
    /// ```
    /// use gramian::dipole::{Pass, Sensors};
    /// use gramian::{spectrum::Spectrum, square_root::SquareRootInformation};
    /// let times = [0.0_f64, 4.0, 8.0, 12.0, 16.0, 20.0];
    /// let pass = Pass::of(&[-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0]);
    /// let mut root = SquareRootInformation::new();
    /// Sensors::vector(&[[0.0; 3]]).push_rows(&times, &pass, &[1e-9], &mut root).unwrap();
    /// assert_eq!(Spectrum::new(&root).rank(), 8);
    /// ```
    pub fn push_rows(
        &self,
        times: &[T],
        pass: &Pass<T>,
        sigma: &[T],
        sink: &mut impl RowSink<T, 9>,
    ) -> Result<(), Error> {
        self.rows_of(times, pass, None, sigma, sink)
    }

    /// [`push_rows`](Self::push_rows) of a body that has a [`quadrupole`] too, at the same place: by
    /// the pass and by its five numbers.
    ///
    /// # Errors
    /// As [`push_rows`](Self::push_rows).
    pub fn push_rows_with_quadrupole(
        &self,
        times: &[T],
        pass: &Pass<T>,
        quadrupole: &[T; 5],
        sigma: &[T],
        sink: &mut impl RowSink<T, 14>,
    ) -> Result<(), Error> {
        self.rows_of(times, pass, Some(quadrupole), sigma, sink)
    }

    /// The first `N` of the derivatives by pass and quadrupole.
    fn rows_of<const N: usize>(
        &self,
        times: &[T],
        pass: &Pass<T>,
        quadrupole: Option<&[T; 5]>,
        sigma: &[T],
        sink: &mut impl RowSink<T, N>,
    ) -> Result<(), Error> {
        let numbers = times.len().saturating_mul(self.channels());
        let by_sample = sigma.len() == times.len();
        if sigma.len() != 1 && !by_sample {
            check_length("sigma", sigma.len(), numbers)?;
        }
        self.check(times, pass)?;
        let bad = |s: &T| !(*s > T::zero());
        if let Some(index) = sigma.iter().position(bad) {
            let given = sigma[index].double();
            return Err(Error::Sigma { index, given });
        }
        let (plain, components) = (self.plain(), self.components());
        let weigh = |sigma: T| {
            let weight = T::one() / sigma;
            let result = "rows";
            let fits = weight <= T::MAX;
            fits.then_some(weight)
                .ok_or(NumberError::Overflow { result })
        };
        // One for all is divided by once.
        let common = match *sigma {
            [sigma] if !times.is_empty() => Some(weigh(sigma)?),
            _ => None,
        };
        let mut number = 0;
        let mut push = |by: &[T; BODY], k: usize, time: T| {
            let weight = match common {
                Some(weight) => weight,
                None => weigh(sigma[if by_sample { k } else { number }])?,
            };
            number += 1;
            sink.push(&row(by, time, weight))
        };
        for (k, &time) in times.iter().enumerate() {
            let time = time - times[0];
            for (sensor, place) in self.places.iter().enumerate() {
                if plain {
                    let changes = changes(&pass.offset(place, time), pass, quadrupole);
                    for by in &changes.map_err(|error| error.at(k))? {
                        push(by, k, time)?;
                    }
                } else {
                    let changes = self.changes(sensor, time, pass, quadrupole);
                    for by in &changes.map_err(|error| error.at(k))?[..components] {
                        push(by, k, time)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// The derivatives of what a sensor reads by place, moment and quadrupole: of each component,
    /// of a sensor of the total field the first.
    fn changes(
        &self,
        sensor: usize,
        time: T,
        pass: &Pass<T>,
        quadrupole: Option<&[T; 5]>,
    ) -> Result<[[T; BODY]; 3], Error> {
        let mut sum = [[T::zero(); BODY]; 3];
        for head in self.heads(sensor) {
            let place = pass.offset(&head.place, time);
            let mut own = changes(&place, pass, quadrupole)?;
            if let Some(ambient) = &self.ambient {
                let (_, u) = excess(ambient, &seen(&place, pass, quadrupole)?)?;
                own[0] = core::array::from_fn(|j| dot(&own.map(|by| by[j]), &u));
            }
            for (sum, own) in sum.as_flattened_mut().iter_mut().zip(own.as_flattened()) {
                *sum += head.sign * *own;
            }
        }
        Ok(sum)
    }

    /// Refuses what is not finite, and baselines that are not as many as places.
    fn check(&self, times: &[T], pass: &Pass<T>) -> Result<(), NumberError> {
        if !self.baselines.is_empty() {
            check_length("baselines", self.baselines.len(), self.places.len())?;
        }
        check_finite("times", times)?;
        check_finite("position", &pass.position)?;
        check_finite("velocity", &pass.velocity)?;
        check_finite("moment", &pass.moment)?;
        check_finite("sensors", self.places.as_flattened())?;
        check_finite("baselines", self.baselines.as_flattened())?;
        check_finite("ambient", self.ambient.as_slice().as_flattened())
    }
}

/// Of place, moment and quadrupole.
const BODY: usize = 11;

/// The field of a body at a place.
#[inline(always)]
fn seen<T: Real>(
    place: &[T; 3],
    pass: &Pass<T>,
    quadrupole: Option<&[T; 5]>,
) -> Result<[T; 3], Error> {
    let h = field(place, &pass.moment)?;
    Ok(match quadrupole {
        None => h,
        Some(quadrupole) => {
            let more = quadrupole::field(place, quadrupole)?;
            finite("field", [h[0] + more[0], h[1] + more[1], h[2] + more[2]])?
        }
    })
}

/// The derivatives of the components of that field by place, moment and quadrupole.
#[inline(always)]
fn changes<T: Real>(
    place: &[T; 3],
    pass: &Pass<T>,
    quadrupole: Option<&[T; 5]>,
) -> Result<[[T; BODY]; 3], Error> {
    let mut out = [[T::zero(); BODY]; 3];
    // Both matrices are symmetric.
    let j = jacobian(place, &pass.moment)?;
    for (i, out) in out.iter_mut().enumerate() {
        out[..3].copy_from_slice(&j.position[i]);
        out[3..6].copy_from_slice(&j.moment[i]);
    }
    if let Some(quadrupole) = quadrupole {
        let j = quadrupole::jacobian(place, quadrupole)?;
        for (i, out) in out.iter_mut().enumerate() {
            for (out, more) in out.iter_mut().zip(&j.position[i]) {
                *out += *more;
            }
            for (out, by) in out[6..].iter_mut().zip(&j.quadrupole) {
                *out = by[i];
            }
        }
    }
    Ok(out)
}

/// The first of the derivatives by position, velocity, moment and quadrupole, whitened.
#[inline(always)]
fn row<T: Real, const N: usize>(by: &[T; BODY], time: T, weight: T) -> [T; N] {
    let by = by.map(|x| x * weight);
    core::array::from_fn(|i| match i {
        0..3 => by[i],
        3..6 => time * by[i - 3],
        _ => by[i - 3],
    })
}

fn length<T: Real>(vector: &[T; 3]) -> T {
    Lane::sqrt(dot(vector, vector))
}

/// |ambient + h| - |ambient| and the direction of the sum, without the digits that the
/// difference would lose. Where the sum vanishes the direction is that of nothing: no derivative
/// exists there, and zero is its mean over all sides.
pub(super) fn excess<T: Real>(ambient: &[T; 3], h: &[T; 3]) -> Result<(T, [T; 3]), NumberError> {
    let total = [0, 1, 2].map(|i| ambient[i] + h[i]);
    let size = length(&total);
    let sum = size + length(ambient);
    if !(sum < T::INFINITY) {
        return Err(NumberError::Overflow { result: "field" });
    }
    let over = |value: T, by: T| {
        if by > T::zero() {
            value / by
        } else {
            T::zero()
        }
    };
    let twice = [0, 1, 2].map(|i| ambient[i] + total[i]);
    Ok((over(dot(&twice, h), sum), total.map(|x| over(x, size))))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use alloc::vec::Vec;

    const TIMES: [f64; 3] = [0.0, 1.0, 2.5];
    const PLACES: [[f64; 3]; 2] = [[0.0; 3], [0.3, -0.2, 0.5]];
    const BASELINES: [[f64; 3]; 2] = [[0.0, 0.0, 1.0], [0.5, 0.2, 0.0]];
    const AMBIENT: [f64; 3] = [2e-5, -1e-6, 4.5e-5];
    const STATE: [f64; 9] = [-3.0, 2.0, 1.0, 1.0, 0.2, 0.0, 10.0, 20.0, 10.0];

    fn kinds() -> impl Iterator<Item = Sensors<'static>> {
        [0, 2].into_iter().flat_map(|count| {
            [None, Some(AMBIENT)].map(|ambient| Sensors {
                places: &PLACES,
                baselines: &BASELINES[..count],
                ambient,
            })
        })
    }

    fn read(sensors: &Sensors<'_>, state: &[f64; 9]) -> Vec<f64> {
        let mut out = alloc::vec![0.0; TIMES.len() * sensors.channels()];
        sensors.measure(&TIMES, &Pass::of(state), &mut out).unwrap();
        out
    }

    #[test]
    fn a_deviation_whose_inverse_overflows_is_refused() {
        struct Ignored;
        impl RowSink<f64, 9> for Ignored {
            fn push(&mut self, _: &[f64; 9]) -> Result<(), NumberError> {
                Ok(())
            }
        }
        let (pass, result) = (Pass::of(&STATE), "rows");
        for sensors in kinds() {
            let rows = |sigma: f64| sensors.push_rows(&TIMES, &pass, &[sigma], &mut Ignored);
            assert_eq!(rows(1e-310), Err(NumberError::Overflow { result }.into()));
            assert_eq!(rows(1e-300), Ok(()));
            assert_eq!(rows(f64::INFINITY), Ok(()));
        }
    }

    #[test]
    fn the_total_field_is_the_size_of_the_sum() {
        let parts = read(&Sensors::vector(&PLACES), &STATE);
        let total = Sensors {
            ambient: Some(AMBIENT),
            ..Sensors::vector(&PLACES)
        };
        for (h, size) in parts.as_chunks::<3>().0.iter().zip(read(&total, &STATE)) {
            let sum: [f64; 3] = core::array::from_fn(|i| AMBIENT[i] + h[i]);
            assert!((length(&sum) - size).abs() < 1e-19);
        }
        // Its slope along the ambient field is one.
        let tiny = total.along().unwrap().map(|u| 1e-17 * u);
        assert!((excess(&AMBIENT, &tiny).unwrap().0 - 1e-17).abs() < 1e-28);
    }

    #[test]
    fn a_gradiometer_of_the_total_field_keeps_the_digits_of_a_weak_dipole() {
        // Of a moment so weak that the total field is its component along the ambient one.
        let mut state = STATE;
        for m in &mut state[6..] {
            *m *= 1e-9;
        }
        let gradient = Sensors {
            places: &PLACES,
            baselines: &BASELINES,
            ambient: Some(AMBIENT),
        };
        let parts = Sensors {
            ambient: None,
            ..gradient
        };
        let along = gradient.along().unwrap();
        let parts = read(&parts, &state);
        for (h, y) in parts.as_chunks::<3>().0.iter().zip(read(&gradient, &state)) {
            assert!((dot(h, &along) - y).abs() < 1e-10 * length(h));
        }
    }

    #[test]
    fn rows_are_the_derivatives_of_the_readings_of_every_kind() {
        for sensors in kinds() {
            let (pass, quadrupole) = (Pass::of(&STATE), [40.0, -70.0, 30.0, 90.0, -20.0]);
            let mut rows = Vec::<[f64; 14]>::new();
            sensors
                .push_rows_with_quadrupole(&TIMES, &pass, &quadrupole, &[1e-9], &mut rows)
                .unwrap();
            assert_eq!(rows.len(), TIMES.len() * sensors.channels());
            // Without a quadrupole they are those of the pass.
            let mut plain = (Vec::<[f64; 14]>::new(), Vec::<[f64; 9]>::new());
            sensors
                .push_rows_with_quadrupole(&TIMES, &pass, &[0.0; 5], &[1e-9], &mut plain.0)
                .unwrap();
            sensors
                .push_rows(&TIMES, &pass, &[1e-9], &mut plain.1)
                .unwrap();
            assert!(plain.0.iter().zip(&plain.1).all(|(a, b)| a[..9] == *b));
            let whole: Vec<f64> = STATE.iter().chain(&quadrupole).copied().collect();
            let read = |x: &[f64]| {
                let mut out = alloc::vec![0.0; TIMES.len() * sensors.channels()];
                let (state, quadrupole) = (x.first_chunk().unwrap(), x.last_chunk());
                sensors
                    .measure_body(&TIMES, &Pass::of(state), quadrupole, &mut out)
                    .unwrap();
                out
            };
            for k in 0..14 {
                let difference = |step: f64| -> Vec<f64> {
                    let (mut up, mut down) = (whole.clone(), whole.clone());
                    up[k] += step;
                    down[k] -= step;
                    let (a, b) = (read(&up), read(&down));
                    a.iter()
                        .zip(&b)
                        .map(|(a, b)| (a - b) / (2e-9 * step))
                        .collect()
                };
                let (wide, narrow) = (difference(2e-3), difference(1e-3));
                let size = rows.iter().fold(0.0_f64, |n, row| n.max(row[k].abs()));
                for (row, (wide, narrow)) in rows.iter().zip(wide.iter().zip(&narrow)) {
                    let wanted = (4.0 * narrow - wide) / 3.0;
                    assert!(
                        (row[k] - wanted).abs() < 1e-7 * size,
                        "{k} {wanted} {}",
                        row[k]
                    );
                }
            }
        }
    }

    #[test]
    fn each_number_has_its_deviation_and_what_was_not_measured_says_nothing() {
        let pass = Pass::of(&STATE);
        for sensors in kinds() {
            let numbers = TIMES.len() * sensors.channels();
            let rows = |sigma: &[f64]| {
                let mut rows = Vec::<[f64; 9]>::new();
                sensors
                    .push_rows(&TIMES, &pass, sigma, &mut rows)
                    .map(|()| rows)
            };
            let plain = rows(&[1.0]).unwrap();
            let mut each: Vec<f64> = (1..=numbers).map(|i| i as f64).collect();
            each[1] = f64::INFINITY;
            for (i, row) in rows(&each).unwrap().iter().enumerate() {
                for (x, plain) in row.iter().zip(plain[i]) {
                    let wanted = plain / each[i];
                    assert!((x - wanted).abs() <= 4.0 * f64::EPSILON * wanted.abs());
                }
            }
            let by_sample = rows(&[1.0, 2.0, 4.0]).unwrap();
            for (i, row) in by_sample.iter().enumerate() {
                let sigma = [1.0, 2.0, 4.0][i / sensors.channels()];
                assert_eq!(*row, plain[i].map(|x| x / sigma));
            }
            each[1] = f64::NAN;
            assert!(matches!(rows(&each), Err(Error::Sigma { index: 1, .. })));
            assert!(matches!(rows(&[0.0]), Err(Error::Sigma { index: 0, .. })));
            assert!(rows(&[1.0; 2]).is_err());
        }
    }
}
