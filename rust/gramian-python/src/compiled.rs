//! A measurement function that is compiled already (numba, C): called by its address, without
//! the interpreter.
#![allow(unsafe_code)] // A foreign function is called: see `Function::call`.

use std::ffi::c_void;
use std::time::Instant;

use gramian::solve::measured::{Measurement, Records, Setting};
use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::Input;
use crate::output::{self, Batch};

/// What a function is called with: the state, and where the result goes.
type Plain = unsafe extern "C" fn(*const f64, *mut f64);
/// The same, and data of its own.
type WithData = unsafe extern "C" fn(*const f64, *mut f64, *mut c_void);

/// A function by its address, and the data it was made with where it takes some.
#[derive(Clone, Copy)]
struct Function {
    address: usize,
    data: Option<usize>,
}

impl Function {
    /// Calls the function. Arrays of other lengths than it was declared with are refused
    /// before, by [`Compiled::value`] and [`Compiled::derivatives`].
    fn call(self, x: &[f64], out: &mut [f64]) {
        let address = self.address as *const ();
        // SAFETY: the address is that of a function of this signature, which Python has checked
        // as far as it is declared (`gramian._compiled`), and of a live object: `Compiled` keeps
        // it. That it reads and writes as many numbers as were declared is its author's word.
        unsafe {
            if let Some(data) = self.data {
                let entry = core::mem::transmute::<*const (), WithData>(address);
                entry(x.as_ptr(), out.as_mut_ptr(), data as *mut c_void);
            } else {
                let entry = core::mem::transmute::<*const (), Plain>(address);
                entry(x.as_ptr(), out.as_mut_ptr());
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
            self.function.call(x, out);
        } else {
            out.fill(f64::NAN);
        }
    }

    fn derivatives(&self, x: &[f64], out: &mut [f64]) -> bool {
        match self.jacobian {
            Some(jacobian)
                if x.len() == self.states && out.len() == self.measurements * self.states =>
            {
                jacobian.call(x, out);
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
        Self {
            function: Function { address, data },
            jacobian: jacobian.map(|(address, data)| Function { address, data }),
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

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Compiled>()
}
