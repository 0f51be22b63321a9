//! Functions that are compiled already (numba, C), called by their address, without the
//! interpreter: measurement functions, and functions of one trial's measurements.
#![allow(unsafe_code)] // A foreign function is called: see `Function::call`.

use std::convert::Infallible;
use std::ffi::{c_int, c_void};
use std::time::Instant;

use gramian::solve::measured::{Measurement, Records, Setting};
use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::Input;
use crate::output::{self, Batch};

/// A function by its address, and how it is declared.
#[derive(Clone, Copy)]
struct Function {
    address: usize,
    /// Its last argument, where it takes data of its own.
    data: Option<usize>,
    /// Whether it returns an `int`, and not nothing.
    returns: bool,
}

impl Function {
    /// Calls the function, which reads `from` and writes `to` and `more`; what it returns, 0
    /// where that is nothing. Its callers see to it that the arrays are as long as declared.
    fn call(self, from: *const f64, to: &mut [f64], more: Option<&mut [f64]>) -> c_int {
        let (address, to) = (self.address as *const (), to.as_mut_ptr());
        macro_rules! call {
            ($($kind:ty = $value:expr),*) => {
                if self.returns {
                    type Entry = unsafe extern "C" fn($($kind),*) -> c_int;
                    core::mem::transmute::<*const (), Entry>(address)($($value),*)
                } else {
                    type Entry = unsafe extern "C" fn($($kind),*);
                    core::mem::transmute::<*const (), Entry>(address)($($value),*);
                    0
                }
            };
        }
        // SAFETY: the address is that of a function of this signature, which Python has checked
        // as far as it is declared (`gramian._compiled`), and of a live object: who holds a
        // `Function` keeps it. That it reads and writes as many numbers as were declared is its
        // author's word.
        unsafe {
            match (more.map(<[f64]>::as_mut_ptr), self.data) {
                (None, None) => call!(*const f64 = from, *mut f64 = to),
                (Some(more), None) => call!(*const f64 = from, *mut f64 = to, *mut f64 = more),
                (None, Some(data)) => {
                    call!(*const f64 = from, *mut f64 = to, *mut c_void = data as *mut c_void)
                }
                (Some(more), Some(data)) => call!(
                    *const f64 = from,
                    *mut f64 = to,
                    *mut f64 = more,
                    *mut c_void = data as *mut c_void
                ),
            }
        }
    }
}

/// A compiled measurement function, and its derivatives if they are compiled too.
#[pyclass(frozen, name = "Compiled", module = "gramian._core")]
pub struct Compiled {
    function: Function,
    jacobian: Option<Function>,
    states: usize,
    measurements: usize,
    /// What the addresses belong to.
    #[allow(dead_code)]
    kept: Py<PyAny>,
}

impl Measurement for Compiled {
    fn states(&self) -> usize {
        self.states
    }

    fn measurements(&self) -> usize {
        self.measurements
    }

    fn value(&self, x: &[f64], out: &mut [f64]) {
        if x.len() == self.states && out.len() == self.measurements {
            self.function.call(x.as_ptr(), out, None);
        } else {
            out.fill(f64::NAN);
        }
    }

    fn derivatives(&self, x: &[f64], out: &mut [f64]) -> bool {
        match self.jacobian {
            Some(jacobian)
                if x.len() == self.states && out.len() == self.measurements * self.states =>
            {
                jacobian.call(x.as_ptr(), out, None);
                true
            }
            _ => false,
        }
    }
}

#[pymethods]
impl Compiled {
    #[new]
    #[pyo3(signature = (address, data, jacobian, states, measurements, kept))]
    fn new(
        address: usize,
        data: Option<usize>,
        jacobian: Option<(usize, Option<usize>)>,
        states: usize,
        measurements: usize,
        kept: Py<PyAny>,
    ) -> Self {
        let plain = |address, data| Function {
            address,
            data,
            returns: false,
        };
        Self {
            function: plain(address, data),
            jacobian: jacobian.map(|(address, data)| plain(address, data)),
            states,
            measurements,
            kept,
        }
    }

    /// h at points (..., n): (..., m).
    fn values<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let points = Input::unchecked(points, "x", 1)?;
        self.each(py, &points, &[self.measurements], |x, out| {
            self.value(x, out);
        })
    }

    /// The derivatives at points (..., n): (..., m, n).
    fn jacobians<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let points = Input::unchecked(points, "x", 1)?;
        self.each(py, &points, &[self.measurements, self.states], |x, out| {
            if !self.derivatives(x, out) {
                out.fill(f64::NAN);
            }
        })
    }

    /// Of each trial status, NEES and errors: see `gramian::solve::measured::Records`.
    #[allow(clippy::too_many_arguments)]
    fn maximum_likelihood<'py>(
        &self,
        py: Python<'py>,
        truth: &Bound<'py, PyAny>,
        z: &Bound<'py, PyAny>,
        weight: &Bound<'py, PyAny>,
        period: &Bound<'py, PyAny>,
        step: &Bound<'py, PyAny>,
        noise: &Bound<'py, PyAny>,
        known: &Bound<'py, PyAny>,
        mean: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (m, n) = (self.measurements, self.states);
        let truth = Input::new(truth, "truth", 1)?;
        truth.expect(&[Some(n)], "one for each state")?;
        let mut z = Input::unchecked(z, "measurements", 1)?;
        z.expect(&[Some(m)], "one for each measurement")?;
        let weight = Input::new(weight, "sigma", 1)?;
        let period = Input::new(period, "periods", 1)?;
        let noise = Input::unchecked(noise, "noise", 1)?;
        for input in [&weight, &period, &noise] {
            input.expect(&[Some(m)], "one for each measurement")?;
        }
        let step = Input::unchecked(step, "step", 1)?;
        step.expect(&[Some(n)], "one for each state")?;
        let known = Input::new(known, "prior", 2)?;
        let k = known.core_shape()[0];
        known.expect(&[None, Some(n)], "one number for each state")?;
        let mut mean = Input::new(mean, "prior", 1)?;
        let sigma = Input::unchecked(sigma, "prior", 1)?;
        for input in [&mean, &sigma] {
            input.expect(&[Some(k)], "one for each prior")?;
        }
        let batch = Batch::of(&mut [&mut z, &mut mean])?;
        let setting = Setting {
            weight: weight.slice()?,
            period: period.slice()?,
            step: step.slice()?,
            noise: noise.slice()?,
        };
        let (z, mean) = (z.items()?, mean.items()?);
        let all = Records {
            h: self,
            setting,
            truth: truth.slice()?,
            z,
            known: known.slice()?,
            mean,
            sigma: sigma.slice()?,
        };
        let cost = self.cost(truth.slice()?);
        batch.fill(py, &[all.size()], cost, |trials, threads, out| {
            let first = trials.start;
            let records = Records {
                z: all.z.skip(first),
                mean: all.mean.skip(first),
                ..all
            };
            records.run(threads, cost, out);
        })
    }
}

impl Compiled {
    /// Calls `each` at every point, the interpreter lock released.
    fn each<'py>(
        &self,
        py: Python<'py>,
        points: &Input<'py>,
        core: &[usize],
        each: impl Fn(&[f64], &mut [f64]) + Sync,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        points.expect(&[Some(self.states)], "one number for each state")?;
        let shape = [points.batch_shape(), core].concat();
        let size: usize = core.iter().product();
        let out = output::array(py, &shape)?;
        {
            let mut write = out.readwrite();
            let (all, from) = (write.as_slice_mut()?, points.slice()?);
            py.detach(|| {
                let points = from.chunks_exact(self.states.max(1));
                for (x, out) in points.zip(all.chunks_exact_mut(size.max(1))) {
                    each(x, out);
                }
            });
        }
        Ok(out)
    }

    /// Roughly what the answer of a record takes, nanoseconds: measured on one value. It sets
    /// the pieces that work is cut into, and no number depends on it.
    fn cost(&self, x: &[f64]) -> f64 {
        let mut out = vec![0.0; self.measurements];
        let start = Instant::now();
        self.value(x, &mut out);
        let value = start.elapsed().as_secs_f64() * 1e9;
        let (m, n) = (self.measurements as f64, self.states as f64);
        5.0 * (n * (4.0 * value + 500.0) + 5.0 * m * n * n)
    }
}

/// A compiled function of one trial's measurements: an estimator, or a quantity.
#[pyclass(frozen, name = "TrialFunction", module = "gramian._core")]
pub struct TrialFunction {
    function: Function,
    /// Numbers that it writes.
    size: usize,
    /// Whether it also writes a covariance (size, size).
    covariance: bool,
    /// What the address belongs to.
    #[allow(dead_code)]
    kept: Py<PyAny>,
}

#[pymethods]
impl TrialFunction {
    #[new]
    #[pyo3(signature = (address, data, returns, size, covariance, kept))]
    fn new(
        address: usize,
        data: Option<usize>,
        returns: bool,
        size: usize,
        covariance: bool,
        kept: Py<PyAny>,
    ) -> Self {
        Self {
            function: Function {
                address,
                data,
                returns,
            },
            size,
            covariance,
            kept,
        }
    }

    /// Of each record z (..., m): what the function returned, and the numbers that it wrote,
    /// NaN where it wrote none.
    fn records<'py>(
        &self,
        py: Python<'py>,
        z: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let mut z = Input::unchecked(z, "measurements", 1)?;
        let m = z.core_shape()[0];
        let batch = Batch::of(&mut [&mut z])?;
        let all = z.items()?;
        let more = if self.covariance {
            self.size * self.size
        } else {
            0
        };
        let size = 1 + self.size + more;
        // Measured on one trial: it sets the pieces that work is cut into, and no number
        // depends on it.
        let mut cost = 0.0;
        if batch.len() > 0 {
            let (mut own, mut out) = (vec![0.0; m], vec![0.0; size]);
            let start = Instant::now();
            self.call(all.get(0), &mut own, &mut out);
            cost = start.elapsed().as_secs_f64() * 1e9;
        }
        batch.fill(py, &[size], cost, |trials, threads, out| {
            let records = all.skip(trials.start);
            let scratch = || vec![0.0; m];
            let each = |own: &mut Vec<f64>, trial: usize, out: &mut [f64]| {
                self.call(records.get(trial), own, out);
                Ok::<(), Infallible>(())
            };
            let Ok(()) = threads.over_with(out, size, cost, scratch, each);
        })
    }
}

impl TrialFunction {
    /// The answer about the record `z`, of which the function has a copy of its own to work in.
    fn call(&self, z: &[f64], own: &mut [f64], out: &mut [f64]) {
        own.copy_from_slice(z);
        out.fill(f64::NAN);
        let (returned, out) = out.split_at_mut(1);
        let (to, more) = out.split_at_mut(self.size);
        let more = self.covariance.then_some(more);
        returned[0] = f64::from(self.function.call(own.as_mut_ptr(), to, more));
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Compiled>()?;
    module.add_class::<TrialFunction>()
}
