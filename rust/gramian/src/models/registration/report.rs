//! What sensors with biases report.

use super::look::unchecked_linearise;
use super::{Error, Layout, MOST};
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length};

/// Reports of targets at `positions` with these biases and no noise: N d numbers
/// for each. `sensors` has N d numbers, or on platforms that move as many for each target.
///
/// # Errors
/// [`Error::OnSensor`], [`Error::Overhead`], [`NumberError::Length`]; [`Error::Number`] for
/// what is not finite, or reports that overflow.
pub fn report<T: Real>(
    layout: &Layout,
    sensors: &[T],
    biases: &[T],
    positions: &[T],
    out: &mut [T],
) -> Result<(), Error> {
    let d = layout.size();
    let size = layout.sensors.saturating_mul(d);
    if sensors.len() != size {
        let looks = positions.len() / d;
        check_length("sensors", sensors.len(), size.saturating_mul(looks))?;
    }
    check_length("biases", biases.len(), layout.states())?;
    let wanted = positions.len().next_multiple_of(d);
    check_length("positions", positions.len(), wanted)?;
    let wanted = positions.len().saturating_mul(layout.sensors);
    check_length("out", out.len(), wanted)?;
    check_finite("sensors", sensors)?;
    check_finite("biases", biases)?;
    check_finite("positions", positions)?;
    unchecked_report(layout, sensors, biases, positions, out)?;
    if all_finite(out) {
        return Ok(());
    }
    Err(NumberError::Overflow { result: "reports" }.into())
}

pub(crate) fn unchecked_report<T: Real>(
    layout: &Layout,
    sensors: &[T],
    biases: &[T],
    positions: &[T],
    out: &mut [T],
) -> Result<(), Error> {
    let (d, per, m) = (layout.size(), layout.per_sensor(), layout.sensors);
    let unit = [T::one(); MOST];
    for (k, p) in positions.chunks_exact(d).enumerate() {
        for s in 0..m {
            let sensor = &layout.at_look(sensors, k)[s * d..(s + 1) * d];
            let bias = &biases[s * per..(s + 1) * per];
            let linear =
                unchecked_linearise(layout, sensor, &unit, bias, p).map_err(
                    |error| match error {
                        Error::OnSensor { .. } => Error::OnSensor { look: k, sensor: s },
                        Error::Overhead { .. } => Error::Overhead { look: k, sensor: s },
                        other => other,
                    },
                )?;
            out[(k * m + s) * d..(k * m + s + 1) * d].copy_from_slice(&linear.measured[..d]);
        }
    }
    Ok(())
}
