//! One look of any number of sensors, in the plane or in space.

#[cfg(any(feature = "alloc", test))]
use super::pair;
use super::{Dimension, Error, Layout, MOST};
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length, hypot, wrapped};
use crate::square_root::reflect;

/// What one sensor measures of a target, and how that depends on the target's
/// position and on the sensor's biases.
///
/// # Source
/// Zhu, Tang & He 2013, the measurement model (among their eq. 1 to 12), with the further
/// biases of [`Layout`]; ours.
#[derive(Clone, Copy, Debug)]
pub struct Linear<T> {
    /// Range, azimuth, elevation as they come out with these biases.
    pub measured: [T; 3],
    /// d measured / d position, each row over its deviation.
    pub position: [[T; 3]; 3],
    /// d measured / d biases, each row over its deviation.
    pub bias: [[T; MOST]; 3],
}

/// Linearises one sensor at `sensor` (d numbers) about a target at `target` and
/// biases `bias` (see the order in [`super`]).
///
/// # Errors
/// [`Error::OnSensor`] and [`Error::Overhead`], with look and sensor 0;
/// [`NumberError::Length`], [`Error::Sigma`]; [`Error::Number`] for what is not finite, or
/// derivatives that overflow.
pub fn linearise<T: Real>(
    layout: &Layout,
    sensor: &[T],
    sigma: &[T],
    bias: &[T],
    target: &[T],
) -> Result<Linear<T>, Error> {
    let d = layout.size();
    check_length("sensor", sensor.len(), d)?;
    check_length("sigma", sigma.len(), d)?;
    check_length("bias", bias.len(), layout.per_sensor())?;
    check_length("target", target.len(), d)?;
    check_finite("sensor", sensor)?;
    check_finite("bias", bias)?;
    check_finite("target", target)?;
    if let Some(quantity) = sigma
        .iter()
        .position(|&s| !(s > T::zero() && s.is_finite()))
    {
        return Err(Error::Sigma {
            sensor: 0,
            quantity,
            given: sigma[quantity].double(),
        });
    }
    let out = unchecked_linearise(layout, sensor, sigma, bias, target)?;
    if all_finite(&out.measured)
        && all_finite(out.position.as_flattened())
        && all_finite(out.bias.as_flattened())
    {
        return Ok(out);
    }
    Err(NumberError::Overflow {
        result: "derivatives",
    }
    .into())
}

#[inline]
pub(crate) fn unchecked_linearise<T: Real>(
    layout: &Layout,
    sensor: &[T],
    sigma: &[T],
    bias: &[T],
    target: &[T],
) -> Result<Linear<T>, Error> {
    let (d, o) = (layout.size(), T::zero());
    let space = layout.dimension == Dimension::Space;
    let mut next = d;
    let mut take = |count: usize| {
        next += count;
        next - count
    };
    let gain = layout.gain.then(|| take(1));
    let place = layout.position.then(|| take(d));
    let attitude = layout.attitude.then(|| take(2 * d - 3));

    let mut offset = [o; 3];
    for i in 0..d {
        offset[i] = target[i] - sensor[i];
        if let Some(place) = place {
            offset[i] -= bias[place + i];
        }
    }
    // The sensor's axes, tilted about east and then about north.
    let (mut once, mut seen) = (offset, offset);
    let (mut east, mut north) = ([o, T::one()], [o, T::one()]);
    if let (Some(i), true) = (attitude, space) {
        east = [bias[i].sin(), bias[i].cos()];
        north = [bias[i + 1].sin(), bias[i + 1].cos()];
        once = about_east(offset, east);
        seen = about_north(once, north);
    }
    let [x, y, z] = seen;
    let flat = hypot(x, y);
    let range = hypot(flat, z);
    if !(range > o) {
        return Err(Error::OnSensor { look: 0, sensor: 0 });
    }
    if !(flat > range * T::EPSILON) {
        return Err(Error::Overhead { look: 0, sensor: 0 });
    }
    let factor = T::one() + gain.map_or(o, |i| bias[i]);
    let heading = attitude.map_or(o, |i| bias[i + 2 * d - 4]);
    let mut measured = [factor * range + bias[0], x.atan2(y) + bias[1] + heading, o];
    let w = [T::one() / sigma[0], T::one() / sigma[1]];
    // Derivatives by the offset in the sensor's own axes.
    let (ex, ey) = (x / flat, y / flat);
    let mut own = [[o; 3]; 3];
    own[0] = [x / range, y / range, z / range].map(|u| factor * u * w[0]);
    own[1] = [ey / flat * w[1], -(ex / flat) * w[1], o];
    if space {
        let w = T::one() / sigma[2];
        let (sin, cos) = (z / range, flat / range);
        measured[2] = z.atan2(flat) + bias[2];
        own[2] = [-(ex * sin) / range, -(ey * sin) / range, cos / range].map(|u| u * w);
    }
    let mut out = Linear {
        measured,
        position: own,
        bias: [[o; MOST]; 3],
    };
    for i in 0..d {
        out.bias[i][i] = T::one() / sigma[i];
    }
    if let Some(i) = gain {
        out.bias[0][i] = range * w[0];
    }
    if let Some(i) = attitude {
        out.bias[1][i + 2 * d - 4] = w[1];
        if space {
            let by_east = about_north([o, -once[2], once[1]], north);
            let by_north = [seen[2], o, -seen[0]];
            for q in 0..3 {
                let row = &own[q];
                let along = |v: [T; 3]| row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
                out.bias[q][i] = along(by_east);
                out.bias[q][i + 1] = along(by_north);
                // Back to the axes of the map: the transposed rotations.
                let [a, b, c] = *row;
                let (sn, cn) = (north[0], north[1]);
                let turned = [cn * a - sn * c, b, sn * a + cn * c];
                let (se, ce) = (east[0], east[1]);
                out.position[q] = [
                    turned[0],
                    ce * turned[1] + se * turned[2],
                    ce * turned[2] - se * turned[1],
                ];
            }
        }
    }
    if let Some(i) = place {
        for q in 0..d {
            for c in 0..d {
                out.bias[q][i + c] = -out.position[q][c];
            }
        }
    }
    Ok(out)
}

fn about_east<T: Real>(v: [T; 3], [sin, cos]: [T; 2]) -> [T; 3] {
    [v[0], cos * v[1] - sin * v[2], sin * v[1] + cos * v[2]]
}

fn about_north<T: Real>(v: [T; 3], [sin, cos]: [T; 2]) -> [T; 3] {
    [cos * v[0] + sin * v[2], v[1], cos * v[2] - sin * v[0]]
}

/// Where a report of one sensor puts the target, given that sensor's biases: d
/// numbers each for `sensor`, `report` and `out`.
///
/// # Errors
/// [`NumberError::Length`]; [`Error::Number`] for what is not finite, or a place that
/// overflows (a gain of -1).
pub fn place<T: Real>(
    layout: &Layout,
    sensor: &[T],
    bias: &[T],
    report: &[T],
    out: &mut [T],
) -> Result<(), Error> {
    let d = layout.size();
    check_length("sensor", sensor.len(), d)?;
    check_length("bias", bias.len(), layout.per_sensor())?;
    check_length("report", report.len(), d)?;
    check_length("out", out.len(), d)?;
    check_finite("sensor", sensor)?;
    check_finite("bias", bias)?;
    check_finite("report", report)?;
    unchecked_place(layout, sensor, bias, report, out);
    if all_finite(out) {
        return Ok(());
    }
    Err(NumberError::Overflow { result: "place" }.into())
}

pub(crate) fn unchecked_place<T: Real>(
    layout: &Layout,
    sensor: &[T],
    bias: &[T],
    report: &[T],
    out: &mut [T],
) {
    let (d, o) = (layout.size(), T::zero());
    let space = layout.dimension == Dimension::Space;
    let mut next = d;
    let mut factor = T::one();
    if layout.gain {
        factor += bias[next];
        next += 1;
    }
    let position = next;
    if layout.position {
        next += d;
    }
    let heading = if layout.attitude {
        bias[next + 2 * d - 4]
    } else {
        o
    };
    let range = (report[0] - bias[0]) / factor;
    let azimuth = report[1] - bias[1] - heading;
    let elevation = if space { report[2] - bias[2] } else { o };
    let flat = range * elevation.cos();
    let mut v = [
        flat * azimuth.sin(),
        flat * azimuth.cos(),
        range * elevation.sin(),
    ];
    if layout.attitude && space {
        let back = |angle: T| [-angle.sin(), angle.cos()];
        v = about_east(about_north(v, back(bias[next + 1])), back(bias[next]));
    }
    for i in 0..d {
        out[i] = sensor[i] + v[i];
        if layout.position {
            out[i] += bias[position + i];
        }
    }
}

/// Width of a line of [`fill`]: position, biases, residual.
pub(crate) const fn width(layout: &Layout) -> usize {
    layout.size() + layout.states() + 1
}

/// Writes the whitened lines of one look, a line of [`width`] numbers for each
/// measurement: derivatives by the target's position, by all biases, and the
/// residual of `report` (0 without one; angles wrapped).
///
/// # Errors
/// [`Error::OnSensor`] and [`Error::Overhead`], with look 0.
pub(crate) fn fill<T: Real>(
    layout: &Layout,
    sensors: &[T],
    sigma: &[T],
    biases: &[T],
    target: &[T],
    report: Option<&[T]>,
    out: &mut [T],
) -> Result<(), Error> {
    let (d, per, c) = (layout.size(), layout.per_sensor(), width(layout));
    for s in 0..layout.sensors {
        let own = s * d..(s + 1) * d;
        let linear = unchecked_linearise(
            layout,
            &sensors[own.clone()],
            &sigma[own.clone()],
            &biases[s * per..(s + 1) * per],
            target,
        )
        .map_err(|error| error.on(s))?;
        for q in 0..d {
            let line = &mut out[(s * d + q) * c..(s * d + q + 1) * c];
            let given = report.map(|report| report[s * d + q]);
            write_line(layout, s, q, &linear, given, sigma[s * d + q], line);
        }
    }
    Ok(())
}

/// Writes the line of quantity `q` of sensor `s`: see [`fill`]. Columns between the biases
/// and the residual are left 0.
pub(crate) fn write_line<T: Real>(
    layout: &Layout,
    s: usize,
    q: usize,
    linear: &Linear<T>,
    given: Option<T>,
    sigma: T,
    line: &mut [T],
) {
    let (d, per) = (layout.size(), layout.per_sensor());
    line.fill(T::zero());
    line[..d].copy_from_slice(&linear.position[q][..d]);
    line[d + s * per..d + (s + 1) * per].copy_from_slice(&linear.bias[q][..per]);
    if let (Some(given), Some(last)) = (given, line.last_mut()) {
        let difference = given - linear.measured[q];
        let difference = if q == 0 {
            difference
        } else {
            wrapped(difference)
        };
        *last = difference / sigma;
    }
}

/// Eliminates the target's position from the lines of a look: the first d lines
/// then give the position from the biases, the others are free of it. `work`
/// has room for one line.
pub(crate) fn eliminate<T: Real>(layout: &Layout, lines: &mut [T], work: &mut [T]) {
    let c = width(layout);
    // Each sensor alone gives a position, so these columns have full rank.
    for k in 0..layout.size() {
        reflect(lines, c, k, k, work);
    }
}

/// [`fill`] and [`eliminate`] in one, in closed form for two sensors in the
/// plane. Returns the sum of the squared residuals over their deviations.
///
/// # Errors
/// [`Error::OnSensor`] and [`Error::Overhead`], with look 0.
#[allow(clippy::too_many_arguments)]
#[cfg(any(feature = "alloc", test))]
pub(crate) fn reduce<T: Real>(
    layout: &Layout,
    sensors: &[T],
    sigma: &[T],
    biases: &[T],
    target: &[T],
    report: Option<&[T]>,
    lines: &mut [T],
    work: &mut [T],
) -> Result<T, Error> {
    if *layout == Layout::PAIR {
        let (lines, _) = lines.as_chunks_mut::<7>();
        return pair::reduce(sensors, sigma, biases, target, report, lines);
    }
    fill(layout, sensors, sigma, biases, target, report, lines)?;
    let cost = lines
        .chunks_exact(width(layout))
        .fold(T::zero(), |sum, line| {
            let residual = line[line.len() - 1];
            sum + residual * residual
        });
    eliminate(layout, lines, work);
    Ok(cost)
}

/// How many numbers of scratch space [`rows`] needs: N d + 1 lines of position,
/// biases and residual.
///
/// ```
/// use gramian::registration::{Layout, look};
/// assert_eq!(look::scratch(&Layout::PAIR), 35);
/// ```
pub const fn scratch(layout: &Layout) -> usize {
    let lines = layout.sensors.saturating_mul(layout.size());
    lines.saturating_add(1).saturating_mul(width(layout))
}

/// The rows of one look on the biases alone, without allocation: [`Layout::rows`]
/// lines of [`Layout::states`] numbers. `work` has [`scratch`] numbers.
///
/// # Errors
/// As [`Layout::check`]; [`Error::OnSensor`] and [`Error::Overhead`], with look 0;
/// [`NumberError::Length`]; [`Error::Number`] for what is not finite, or rows that
/// overflow.
///
/// ```
/// use gramian::registration::{Layout, look};
/// let (sensors, sigma) = ([0.0, 0.0, 60e3, 0.0], [50.0, 2e-3, 50.0, 2e-3]);
/// let (mut work, mut rows) = ([0.0; 35], [0.0; 8]);
/// let target = [20e3, 30e3_f64];
/// look::rows(&Layout::PAIR, &sensors, &sigma, &[0.0; 4], &target, &mut work, &mut rows)?;
/// # Ok::<(), gramian::registration::Error>(())
/// ```
pub fn rows<T: Real>(
    layout: &Layout,
    sensors: &[T],
    sigma: &[T],
    biases: &[T],
    target: &[T],
    work: &mut [T],
    out: &mut [T],
) -> Result<(), Error> {
    layout.check(sensors, sigma)?;
    let wanted = layout.rows().saturating_mul(layout.states());
    check_length("biases", biases.len(), layout.states())?;
    check_length("target", target.len(), layout.size())?;
    check_length("work", work.len(), scratch(layout))?;
    check_length("out", out.len(), wanted)?;
    check_finite("biases", biases)?;
    check_finite("target", target)?;
    unchecked_rows(layout, sensors, sigma, biases, target, work, out)?;
    if all_finite(out) {
        return Ok(());
    }
    Err(NumberError::Overflow { result: "rows" }.into())
}

/// [`rows`] where only the target's place can be wrong.
pub(crate) fn unchecked_rows<T: Real>(
    layout: &Layout,
    sensors: &[T],
    sigma: &[T],
    biases: &[T],
    target: &[T],
    work: &mut [T],
    out: &mut [T],
) -> Result<(), Error> {
    let (d, n, c) = (layout.size(), layout.states(), width(layout));
    let (lines, work) = work.split_at_mut(layout.sensors * d * c);
    fill(layout, sensors, sigma, biases, target, None, lines)?;
    eliminate(layout, lines, work);
    for (row, line) in out.chunks_exact_mut(n).zip(lines[d * c..].chunks_exact(c)) {
        row.copy_from_slice(&line[d..d + n]);
    }
    Ok(())
}

impl Error {
    /// The same error at another sensor.
    #[must_use]
    pub(super) fn on(mut self, index: usize) -> Self {
        if let Self::OnSensor { sensor, .. } | Self::Overhead { sensor, .. } = &mut self {
            *sensor = index;
        }
        self
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::registration::pair::Plane;

    #[test]
    fn elimination_is_the_closed_form_for_a_pair() {
        let layout = Layout::PAIR;
        let (sensors, sigma) = ([0.0, 0.0, 60e3, 0.0], [50.0, 2e-3, 30.0, 1e-3]);
        for target in [[20e3_f64, 30e3], [90e3, -4e3], [30e3, 1.0]] {
            let (mut work, mut out) = ([0.0; 35], [0.0; 8]);
            rows(
                &layout, &sensors, &sigma, &[0.0; 4], &target, &mut work, &mut out,
            )
            .unwrap();
            let offset = |s: usize| [target[0] - sensors[2 * s], target[1] - sensors[2 * s + 1]];
            let plane = Plane::new(offset(0), offset(1), &[50.0, 2e-3], &[30.0, 1e-3]).unwrap();
            let p = plane.projector();
            for i in 0..4 {
                for j in 0..4 {
                    let sum = (out[i] * out[j] + out[4 + i] * out[4 + j]) * sigma[i] * sigma[j];
                    assert!((sum - p[i][j]).abs() < 1e-13, "{target:?} {i} {j}");
                }
            }
        }
    }

    #[test]
    fn the_closed_form_of_a_look_is_the_elimination() {
        let layout = Layout::PAIR;
        let (sensors, sigma) = ([0.0, 0.0, 60e3, 0.0], [50.0, 2e-3, 30.0, 1e-3]);
        let (biases, target) = ([100.0, 0.01, -50.0, -0.02], [20e3, 30e3]);
        let report = [36_200.0, 0.6, 50_100.0, -0.95];
        let (mut work, mut lines, mut closed) = ([0.0; 7], [0.0; 28], [0.0; 28]);
        fill(
            &layout,
            &sensors,
            &sigma,
            &biases,
            &target,
            Some(&report),
            &mut lines,
        )
        .unwrap();
        let expected: f64 = lines.chunks_exact(7).map(|line| line[6] * line[6]).sum();
        eliminate(&layout, &mut lines, &mut work);
        let cost = reduce(
            &layout,
            &sensors,
            &sigma,
            &biases,
            &target,
            Some(&report),
            &mut closed,
            &mut work,
        );
        assert!((cost.unwrap() - expected).abs() < 1e-12 * expected);
        // Equal up to a rotation of the rows: compare their products.
        for part in [0..2, 2..4] {
            for i in 0..7 {
                for j in 0..7 {
                    let sum = |lines: &[f64]| -> f64 {
                        let rows = part.clone();
                        rows.map(|k| lines[7 * k + i] * lines[7 * k + j]).sum()
                    };
                    let (one, other) = (sum(&lines), sum(&closed));
                    assert!((one - other).abs() < 1e-10 * (1e-9 + one.abs()), "{i} {j}");
                }
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        for dimension in [Dimension::Plane, Dimension::Space] {
            let layout = Layout {
                gain: true,
                position: true,
                attitude: true,
                ..Layout::simple(dimension, 2)
            };
            let (d, per) = (layout.size(), layout.per_sensor());
            let (sensor, sigma) = ([100.0, -50.0, 20.0], [1.0; 3]);
            let target = [2100.0_f64, 1500.0, 900.0];
            let bias: [f64; MOST] = core::array::from_fn(|i| 0.01 * (i as f64 + 1.0));
            let at = |bias: &[f64], target: &[f64]| {
                linearise(
                    &layout,
                    &sensor[..d],
                    &sigma[..d],
                    &bias[..per],
                    &target[..d],
                )
                .unwrap()
            };
            let here = at(&bias, &target);
            for j in 0..d {
                let (mut up, mut down) = (target, target);
                up[j] += 0.5;
                down[j] -= 0.5;
                let (up, down) = (at(&bias, &up), at(&bias, &down));
                for q in 0..d {
                    let slope = up.measured[q] - down.measured[q];
                    assert!(
                        (slope - here.position[q][j]).abs() < 1e-6,
                        "{q} by position {j}"
                    );
                }
            }
            for j in 0..per {
                let (mut up, mut down) = (bias, bias);
                up[j] += 1e-4;
                down[j] -= 1e-4;
                let (up, down) = (at(&up, &target), at(&down, &target));
                for q in 0..d {
                    let slope = (up.measured[q] - down.measured[q]) / 2e-4;
                    assert!((slope - here.bias[q][j]).abs() < 1e-4, "{q} by bias {j}");
                }
            }
            let mut back = [0.0; 3];
            place(
                &layout,
                &sensor[..d],
                &bias[..per],
                &here.measured[..d],
                &mut back[..d],
            )
            .unwrap();
            for i in 0..d {
                assert!((back[i] - target[i]).abs() < 1e-9);
            }
        }
    }
}
