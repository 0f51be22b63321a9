//! Sensors, and what each of them measures of the field.

use super::{Error, Pass, field};
use crate::numbers::algebra::dot;
use crate::numbers::lane::Lane;
use crate::scalar::{NumberError, all_finite, check_finite, check_length};

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
pub struct Sensors<'a> {
    /// Where they are, m.
    pub places: &'a [[f64; 3]],
    /// Of gradiometers, from each to its second head, m: what is measured is that of the second
    /// less that of the first. Empty where each sensor has one head.
    pub baselines: &'a [[f64; 3]],
    /// Of sensors of the total field, |ambient + field|: the field without the dipole, T.
    pub ambient: Option<[f64; 3]>,
}

/// One end of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    /// Where it is, m.
    pub place: [f64; 3],
    /// By what it counts: 1, or -1 for the first head of a gradiometer.
    pub sign: f64,
}

impl<'a> Sensors<'a> {
    /// Sensors of three components.
    pub fn vector(places: &'a [[f64; 3]]) -> Self {
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
    pub fn heads(&self, sensor: usize) -> impl Iterator<Item = Head> + use<> {
        let place = self.places[sensor];
        let (first, second) = match self.baselines.get(sensor) {
            None => (Head { place, sign: 1.0 }, None),
            Some(baseline) => (
                Head {
                    place: core::array::from_fn(|i| place[i] + baseline[i]),
                    sign: 1.0,
                },
                Some(Head { place, sign: -1.0 }),
            ),
        };
        core::iter::once(first).chain(second)
    }

    /// What a reading has without a dipole: the ambient field's size at a sensor of one head, or 0.
    pub fn quiet(&self) -> f64 {
        match &self.ambient {
            Some(ambient) if self.baselines.is_empty() => length(ambient),
            _ => 0.0,
        }
    }

    /// Direction of the ambient field, for sensors of the total field.
    pub fn along(&self) -> Option<[f64; 3]> {
        self.ambient.map(|ambient| {
            // Of no field there is no direction: nothing is seen then.
            let size = length(&ambient).max(f64::MIN_POSITIVE);
            ambient.map(|a| a / size)
        })
    }

    /// Writes what they measure of a pass beside [`quiet`](Self::quiet): sample after sample, in
    /// each sensor after sensor. Time is counted from `times[0]`.
    ///
    /// # Errors
    /// As [`measure`](super::measure()).
    pub fn measure(&self, times: &[f64], pass: &Pass<f64>, out: &mut [f64]) -> Result<(), Error> {
        let wanted = times.len().saturating_mul(self.channels());
        check_length("out", out.len(), wanted)?;
        if !self.baselines.is_empty() {
            check_length("baselines", self.baselines.len(), self.places.len())?;
        }
        check_finite("times", times)?;
        check_finite("state", &pass.state())?;
        check_finite("sensors", self.places.as_flattened())?;
        check_finite("baselines", self.baselines.as_flattened())?;
        check_finite("ambient", &self.ambient.unwrap_or_default())?;
        out.fill(0.0);
        let mut places = out.chunks_exact_mut(self.components());
        for (k, &time) in times.iter().enumerate() {
            for sensor in 0..self.places.len() {
                let Some(out) = places.next() else { break };
                for head in self.heads(sensor) {
                    let place = pass.offset(&head.place, time - times[0]);
                    let h = field(&place, &pass.moment).map_err(|error| error.at(k))?;
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
}

fn length(vector: &[f64; 3]) -> f64 {
    Lane::sqrt(dot(vector, vector))
}

/// |ambient + h| - |ambient| and the direction of the sum, without the digits that the
/// difference would lose.
pub(super) fn excess(ambient: &[f64; 3], h: &[f64; 3]) -> Result<(f64, [f64; 3]), NumberError> {
    let (size, along) = super::total(ambient, h)?;
    let sum = size + length(ambient);
    let product: f64 = (0..3).map(|i| (2.0 * ambient[i] + h[i]) * h[i]).sum();
    Ok((if sum > 0.0 { product / sum } else { 0.0 }, along))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::dipole::{Sensing, measure};

    #[test]
    fn the_total_field_is_the_ambient_one_and_what_is_beside_it() {
        let pass = Pass::of(&[-3.0, 2.0, 1.0, 1.0, 0.2, 0.0, 10.0, 20.0, 10.0]);
        let times = [0.0, 1.0, 2.5];
        let places = [[0.0; 3], [0.3, -0.2, 0.5]];
        let ambient = [2e-5, -1e-6, 4.5e-5];
        let sensors = Sensors {
            places: &places,
            baselines: &[],
            ambient: Some(ambient),
        };
        let (mut beside, mut whole) = ([0.0; 6], [0.0; 6]);
        sensors.measure(&times, &pass, &mut beside).unwrap();
        measure(
            &times,
            &pass,
            &places,
            &Sensing::TotalField(ambient),
            &mut whole,
        )
        .unwrap();
        for (a, b) in beside.iter().zip(&whole) {
            assert!((a + sensors.quiet() - b).abs() < 1e-19);
        }
        // Its slope along the ambient field is one.
        let tiny = sensors.along().unwrap().map(|u| 1e-17 * u);
        assert!((excess(&ambient, &tiny).unwrap().0 - 1e-17).abs() < 1e-28);
    }
}
