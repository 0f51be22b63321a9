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

// One arm for each kind.
#[allow(clippy::too_many_lines)]
fn named(py: Python<'_>, finding: Finding) -> PyResult<(&'static str, Bound<'_, PyDict>)> {
    let out = PyDict::new(py);
    let kind = match finding {
        Finding::Constant { channel, value } => {
            out.set_item("channel", channel)?;
            out.set_item("value", value)?;
            "constant"
        }
        Finding::Stuck {
            channel,
            from,
            samples,
            value,
        } => {
            out.set_item("channel", channel)?;
            out.set_item("first", from)?;
            out.set_item("samples", samples)?;
            out.set_item("value", value)?;
            "stuck"
        }
        Finding::Saturated {
            channel,
            value,
            samples,
        } => {
            out.set_item("channel", channel)?;
            out.set_item("value", value)?;
            out.set_item("samples", samples)?;
            "saturated"
        }
        Finding::Copy {
            channel,
            of,
            factor,
            offset,
            late,
            from,
            samples,
        } => {
            out.set_item("channel", channel)?;
            out.set_item("of", of)?;
            out.set_item("factor", factor)?;
            out.set_item("offset", offset)?;
            out.set_item("late", late)?;
            out.set_item("first", from)?;
            out.set_item("samples", samples)?;
            "copy"
        }
        Finding::Coarse {
            channel,
            step,
            usual,
        } => {
            out.set_item("channel", channel)?;
            out.set_item("step", step)?;
            out.set_item("usual", usual)?;
            "coarse"
        }
        Finding::Noisy {
            channel,
            sigma,
            usual,
        } => {
            out.set_item("channel", channel)?;
            out.set_item("sigma", sigma)?;
            out.set_item("usual", usual)?;
            "noisy"
        }
        Finding::Step {
            channel,
            sample,
            change,
        } => {
            out.set_item("channel", channel)?;
            out.set_item("sample", sample)?;
            out.set_item("change", change)?;
            "step"
        }
        Finding::Axes {
            channel,
            follows,
            inverted,
            correlation,
        } => {
            out.set_item("channel", channel)?;
            out.set_item("follows", follows)?;
            out.set_item("inverted", inverted)?;
            out.set_item("correlation", correlation)?;
            "axes"
        }
        Finding::Spikes { channel, samples } => {
            out.set_item("channel", channel)?;
            out.set_item("samples", samples)?;
            "spikes"
        }
        Finding::Hum {
            channel,
            frequency,
            amplitude,
        } => {
            out.set_item("channel", channel)?;
            out.set_item("frequency", frequency)?;
            out.set_item("amplitude", amplitude)?;
            "hum"
        }
        Finding::Drift { channel, change } => {
            out.set_item("channel", channel)?;
            out.set_item("change", change)?;
            "drift"
        }
        Finding::Clock {
            sample,
            step,
            usual,
            count,
        } => {
            out.set_item("sample", sample)?;
            out.set_item("count", count)?;
            out.set_item("step", step)?;
            out.set_item("usual", usual)?;
            "clock"
        }
        Finding::Missing { channel, samples } => {
            out.set_item("channel", channel)?;
            out.set_item("samples", samples)?;
            "missing"
        }
    };
    Ok((kind, out))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(dipole_check, module)?)
}
