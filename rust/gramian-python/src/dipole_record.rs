//! What is wrong with a record of a magnetometer.

use gramian::dipole::record::{Finding, check};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::Input;
use crate::{errors, run};

/// Looks through a record: `times` (K,), `field` (K, channels), NaN for a missing
/// sample. Returns the findings, each a kind and its figures by name, and the noise of
/// each channel: standard deviation, correlation, step.
#[pyfunction]
#[allow(clippy::type_complexity)]
fn dipole_check<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    field: &Bound<'py, PyAny>,
) -> PyResult<(
    Vec<(&'static str, Bound<'py, PyDict>)>,
    Vec<(f64, f64, f64)>,
)> {
    let times = Input::new(times, "times", 1)?;
    let field = Input::unchecked(field, "field", 2)?;
    let channels = field.core_shape()[1];
    let (t, y) = (times.slice()?.to_vec(), field.slice()?.to_vec());
    // Medians, and a spectrum at some forty frequencies.
    let cost = 2000.0 * y.len() as f64;
    let found = run::apart(py, cost, move |_| check(&t, &y, channels))?
        .map_err(|error| errors::input_at("", error))?;
    let mut findings = Vec::with_capacity(found.findings.len());
    for finding in found.findings {
        findings.push(named(py, finding)?);
    }
    let noise = found
        .noise
        .into_iter()
        .map(|n| (n.sigma, n.correlation, n.step))
        .collect();
    Ok((findings, noise))
}

/// Matches a finding: its kind and its figures by their names.
macro_rules! kinds {
    ($py:ident, $finding:ident, $($variant:ident = $kind:literal ($($field:ident),+);)+) => {
        match $finding {
            $(Finding::$variant { $($field),+ } => {
                let figures = PyDict::new($py);
                $(figures.set_item(stringify!($field), $field)?;)+
                ($kind, figures)
            })+
        }
    };
}

fn named(py: Python<'_>, finding: Finding) -> PyResult<(&'static str, Bound<'_, PyDict>)> {
    Ok(kinds! { py, finding,
        Constant = "constant" (channel, value);
        Stuck = "stuck" (channel, first, samples, value);
        Saturated = "saturated" (channel, value, samples);
        Copy = "copy" (channel, of, factor, offset, late, first, samples);
        Coarse = "coarse" (channel, step, usual);
        Noisy = "noisy" (channel, sigma, usual);
        Axes = "axes" (channel, follows, inverted, correlation);
        Spikes = "spikes" (channel, samples);
        Hum = "hum" (channel, frequency, amplitude);
        Step = "step" (channel, sample, change);
        Drift = "drift" (channel, change);
        Clock = "clock" (sample, step, usual, count);
        Missing = "missing" (channel, samples);
    })
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(dipole_check, module)?)
}
