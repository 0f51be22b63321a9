//! The quadrupole of a body: what its field has beside that of a dipole, one power of the
//! distance further down.
//!
//! With d from the body to the sensor, the potential of a dipole m and a quadrupole Q is
//! (mu0 / 4 pi) (m . d / d^3 + d . Q d / (2 d^5)), and the field is minus its gradient.
//! Q is symmetric and has no trace, in A m^3: of magnetic charges q at places x it is the sum of
//! q (3 x x^T - x^2 1). Five numbers make it, [`ENTRIES`].
//!
//! A dipole that is off by d has, to first order in d, the field of one that is not and of the
//! quadrupole of [`moved`], 3 (d m^T + m d^T) - 2 (d . m) 1. These are the derivatives of the
//! field by the place: where all five numbers and the place are free, three combinations of them
//! are not determined at Q = 0, and hardly where Q is small. Since moved(d) : Q = 6 d . Q m, what
//! is left of Q when they are taken out is what has Q m = 0, two numbers: the place is then the
//! centre of the field.
//!
//! At one sensor the field of (u r, u^3 m, u^4 Q) is the same for u > 0, and that of the
//! mirror image (-r, m, -Q).
//!
//! # Source
//! Jackson, Classical Electrodynamics, section 4.1, for charges; the centre: Bartels 1936, The
//! eccentric dipole approximating the Earth's magnetic field.

use super::{Error, MU0_OVER_4PI, direction};
use crate::numbers::algebra::{dot, multiply};
use crate::numbers::lane::Lane;
use crate::scalar::{NumberError, Real, all_finite, check_finite};

/// Which entries of the tensor the five numbers are; the last of its diagonal is minus the sum
/// of the two others.
pub const ENTRIES: [(usize, usize); 5] = [(0, 0), (1, 1), (0, 1), (0, 2), (1, 2)];

/// Their names.
pub const NAMES: [&str; 5] = ["Qxx", "Qyy", "Qxy", "Qxz", "Qyz"];

/// The tensor of five numbers.
#[inline(always)]
pub fn tensor<L: Lane>(entries: &[L; 5]) -> [[L; 3]; 3] {
    let [xx, yy, xy, xz, yz] = *entries;
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, -(xx + yy)]]
}

/// The five numbers of a tensor.
#[inline(always)]
pub fn entries<L: Lane>(tensor: &[[L; 3]; 3]) -> [L; 5] {
    ENTRIES.map(|(i, j)| tensor[i][j])
}

/// The quadrupole that a dipole has about a place from which it is off by `offset`, m; A m^3.
#[inline(always)]
pub fn moved<L: Lane>(moment: &[L; 3], offset: &[L; 3]) -> [L; 5] {
    let trace = dot(moment, offset).times(2.0);
    ENTRIES.map(|(i, j)| {
        let product = offset[i]
            .mul_add(moment[j], moment[i] * offset[j])
            .times(3.0);
        if i == j { product - trace } else { product }
    })
}

/// The field times r^4, with `n` the unit vector to the body: Q n - 5/2 (n . Q n) n.
#[inline(always)]
pub(crate) fn field_tensor<L: Lane>(n: &[L; 3], q: &[[L; 3]; 3]) -> [L; 3] {
    let qn = multiply(q, n);
    let along = dot(n, &qn).times(2.5);
    [0, 1, 2].map(|i| along.negate_mul_add(n[i], qn[i]))
}

/// The field's derivative by the position times r^5:
/// Q - 5 (Qn n^T + n Qn^T) + (n . Q n) (35/2 n n^T - 5/2).
#[inline(always)]
pub(crate) fn position_tensor<L: Lane>(n: &[L; 3], q: &[[L; 3]; 3]) -> [[L; 3]; 3] {
    let qn = multiply(q, n);
    let along = dot(n, &qn);
    [0, 1, 2].map(|i| {
        [0, 1, 2].map(|j| {
            let mixed = qn[i].mul_add(n[j], n[i] * qn[j]);
            let rest = mixed.times(5.0).negate_mul_add(mixed.splat(1.0), q[i][j]);
            let outer = (n[i].times(17.5) * n[j]).mul_add(along, rest);
            if i == j {
                outer - along.times(2.5)
            } else {
                outer
            }
        })
    })
}

/// The field at the sensor of a quadrupole at `position` from it, in tesla.
///
/// # Units
/// m, A m^3, T.
///
/// # Errors
/// As [`dipole::field`](super::field).
///
/// ```
/// use gramian::dipole::{field, quadrupole};
/// // Two opposite dipoles, 2 mm apart.
/// let (m, d) = ([3.0, -1.0, 2.0], [5e-4, 4e-4, -2e-4]);
/// let at = |side: f64| [0, 1, 2].map(|i| [1.0, -2.0, 0.5][i] + side * d[i]);
/// let (a, b) = (field(&at(1.0), &m).unwrap(), field(&at(-1.0), &m).unwrap());
/// let q = quadrupole::moved(&m, &d.map(|x: f64| 2.0 * x));
/// let h = quadrupole::field(&[1.0, -2.0, 0.5], &q).unwrap();
/// assert!((0..3).all(|i| (a[i] - b[i] - h[i]).abs() < 1e-15));
/// ```
#[inline]
pub fn field<T: Real>(position: &[T; 3], quadrupole: &[T; 5]) -> Result<[T; 3], Error> {
    let (n, inverse) = direction(position)?;
    let quartic = T::of(MU0_OVER_4PI) * inverse * inverse * inverse * inverse;
    let field = field_tensor(&n, &tensor(quadrupole)).map(|h| quartic * h);
    if all_finite(&field) {
        return Ok(field);
    }
    check_finite("quadrupole", quadrupole)?;
    Err(NumberError::Overflow { result: "field" }.into())
}

/// The derivatives of the field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jacobian<T> {
    /// By the position of the body, in T/m; symmetric.
    pub position: [[T; 3]; 3],
    /// By the five numbers, in T/(A m^3): one field for each.
    pub quadrupole: [[T; 3]; 5],
}

/// The derivatives of [`field`] by position and quadrupole.
///
/// # Errors
/// As [`field`].
#[inline]
pub fn jacobian<T: Real>(position: &[T; 3], quadrupole: &[T; 5]) -> Result<Jacobian<T>, Error> {
    let (n, inverse) = direction(position)?;
    let quartic = T::of(MU0_OVER_4PI) * inverse * inverse * inverse * inverse;
    let quintic = quartic * inverse;
    let by_position = position_tensor(&n, &tensor(quadrupole));
    let out = Jacobian {
        position: by_position.map(|row| row.map(|x| quintic * x)),
        quadrupole: core::array::from_fn(|k| {
            let mut unit = [T::zero(); 5];
            unit[k] = T::one();
            field_tensor(&n, &tensor(&unit)).map(|h| quartic * h)
        }),
    };
    if all_finite(out.position.as_flattened()) {
        return Ok(out);
    }
    check_finite("quadrupole", quadrupole)?;
    Err(NumberError::Overflow { result: "jacobian" }.into())
}

/// Which of the five numbers are states, where the place is the centre's in some components:
/// (Q m)_i = 0 for each of these, from which as many of the numbers follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entries {
    centre: [bool; 3],
    /// The ones that are states, then those that follow.
    order: [usize; 5],
    free: usize,
}

impl Default for Entries {
    fn default() -> Self {
        Self {
            centre: [false; 3],
            order: [0, 1, 2, 3, 4],
            free: 5,
        }
    }
}

/// The five numbers, and how they follow from the states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Whole {
    /// A m^3.
    pub entries: [f64; 5],
    /// By each of the states, of which there are up to five.
    pub by_free: [[f64; 5]; 5],
    /// By the moment.
    pub by_moment: [[f64; 5]; 3],
}

impl Whole {
    /// What a change of the moment changes of them.
    pub fn along(&self, change: &[f64; 3]) -> [f64; 5] {
        core::array::from_fn(|k| (0..3).map(|j| change[j] * self.by_moment[j][k]).sum())
    }
}

/// The derivatives of Q m by the five numbers, of the components that are the centre's; zeros
/// after these.
fn told(centre: [bool; 3], m: &[f64; 3]) -> [[f64; 5]; 3] {
    let [x, y, z] = *m;
    let all = [
        [x, 0.0, y, z, 0.0],
        [0.0, y, x, 0.0, z],
        [-z, -z, 0.0, x, y],
    ];
    let mut rows = [[0.0; 5]; 3];
    let own = all.iter().zip(centre).filter(|(_, told)| *told);
    for (row, (given, _)) in rows.iter_mut().zip(own) {
        *row = *given;
    }
    rows
}

impl Entries {
    /// Those that tell the others best for a moment near this one.
    pub fn new(centre: [bool; 3], moment: &[f64; 3]) -> Self {
        let follow = centre.iter().filter(|c| **c).count();
        // As many follow of a moment that is not finite, whose sizes are no numbers.
        let (mut best, mut most) = (Self::default(), f64::NAN);
        // Every choice of as many of five.
        for choice in (0_u32..32).filter(|c| c.count_ones() as usize == follow) {
            let chosen = |k: &usize| choice >> k & 1 == 1;
            let mut own = Self {
                centre,
                free: 5 - follow,
                ..Self::default()
            };
            let split = (0..5).filter(|k| !chosen(k)).chain((0..5).filter(chosen));
            own.order.iter_mut().zip(split).for_each(|(at, k)| *at = k);
            let (_, size) = own.inverse(&told(centre, moment));
            if size > most || most.is_nan() {
                (best, most) = (own, size);
            }
        }
        best
    }

    /// Which of [`ENTRIES`] are states.
    pub fn free(&self) -> &[usize] {
        &self.order[..self.free]
    }

    /// The inverse of what stands before those that follow, and the size of the determinant.
    fn inverse(&self, rows: &[[f64; 5]; 3]) -> ([[f64; 3]; 3], f64) {
        let mut matrix = UNITS;
        let follow = &self.order[self.free..];
        for line in 0..follow.len() {
            for (x, &k) in matrix[line].iter_mut().zip(follow) {
                *x = rows[line][k];
            }
        }
        inverse(matrix)
    }

    /// The five numbers of these states. What follows is not finite where the moment lies so
    /// that it does not follow.
    pub fn whole(&self, moment: &[f64; 3], free: &[f64]) -> Whole {
        let mut out = Whole {
            entries: [0.0; 5],
            by_free: [[0.0; 5]; 5],
            by_moment: [[0.0; 5]; 3],
        };
        let rows = told(self.centre, moment);
        let (inverse, _) = self.inverse(&rows);
        // What makes up for a change of Q m.
        let follow = |change: [f64; 3], out: &mut [f64; 5]| {
            for (line, &k) in inverse.iter().zip(&self.order[self.free..]) {
                out[k] = -dot(line, &change);
            }
        };
        for ((by, &k), x) in out.by_free.iter_mut().zip(self.free()).zip(free) {
            by[k] = 1.0;
            follow(rows.map(|row| row[k]), by);
            for (entry, by) in out.entries.iter_mut().zip(by) {
                *entry += x * *by;
            }
        }
        for (by, unit) in out.by_moment.iter_mut().zip(&UNITS) {
            let change = told(self.centre, unit).map(|row| dot(&row, &out.entries));
            follow(change, by);
        }
        out
    }
}

const UNITS: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The inverse of a matrix, and the size of its determinant.
fn inverse(mut matrix: [[f64; 3]; 3]) -> ([[f64; 3]; 3], f64) {
    let (mut inverse, mut size) = (UNITS, 1.0);
    for k in 0..3 {
        let largest = (k..3).max_by(|&a, &b| matrix[a][k].abs().total_cmp(&matrix[b][k].abs()));
        let pivot = largest.unwrap_or(k);
        matrix.swap(k, pivot);
        inverse.swap(k, pivot);
        let scale = 1.0 / matrix[k][k];
        size *= matrix[k][k].abs();
        let (top, side) = (matrix[k].map(|x| scale * x), inverse[k].map(|x| scale * x));
        for i in 0..3 {
            let factor = matrix[i][k];
            for j in 0..3 {
                if i != k {
                    matrix[i][j] -= factor * top[j];
                    inverse[i][j] -= factor * side[j];
                }
            }
        }
        (matrix[k], inverse[k]) = (top, side);
    }
    (inverse, size)
}

// The numbers that know their derivatives are std's.
#[cfg(all(test, feature = "std"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::dipole;
    use crate::numbers::dual::Dual;
    use proptest::prelude::*;

    fn vector<const N: usize>(size: f64) -> impl Strategy<Value = [f64; N]> {
        core::array::from_fn(|_| -size..size)
    }

    /// The field of numbers that know their derivatives, by place and quadrupole.
    fn dual(r: &[f64; 3], q: &[f64; 5]) -> [Dual<8>; 3] {
        let r: [Dual<8>; 3] = core::array::from_fn(|i| Dual::variable(r[i], i));
        let q: [Dual<8>; 5] = core::array::from_fn(|k| Dual::variable(q[k], 3 + k));
        let inverse = dot(&r, &r).sqrt().recip();
        let n = r.map(|x| x * inverse);
        let quartic = (inverse * inverse * inverse * inverse).times(MU0_OVER_4PI);
        field_tensor(&n, &tensor(&q)).map(|h| h * quartic)
    }

    fn size<const N: usize>(x: &[f64; N]) -> f64 {
        dot(x, x).sqrt()
    }

    proptest! {
        #[test]
        fn the_jacobian_is_the_derivative_and_the_field_has_no_sources(
            r in vector::<3>(20.0), q in vector::<5>(100.0)
        ) {
            prop_assume!(size(&r) > 0.5 && size(&q) > 1.0);
            let (h, j) = (field(&r, &q).unwrap(), jacobian(&r, &q).unwrap());
            let most = j.position.as_flattened().iter().fold(0.0_f64, |n, x| n.max(x.abs()));
            let strength = MU0_OVER_4PI / size(&r).powi(4);
            for (i, exact) in dual(&r, &q).iter().enumerate() {
                prop_assert!((exact.value - h[i]).abs() < 1e-14 * strength * size(&q));
                for k in 0..3 {
                    prop_assert!((exact.by[k] - j.position[i][k]).abs() < 1e-13 * most);
                    // A potential has no curl.
                    prop_assert!((j.position[i][k] - j.position[k][i]).abs() < 1e-14 * most);
                }
                for k in 0..5 {
                    prop_assert!((exact.by[3 + k] - j.quadrupole[k][i]).abs() < 1e-14 * strength);
                }
            }
            let divergence: f64 = (0..3).map(|i| j.position[i][i]).sum();
            prop_assert!(divergence.abs() < 1e-13 * most);
        }

        #[test]
        fn it_is_minus_the_gradient_of_its_potential(
            r in vector::<3>(20.0), q in vector::<5>(100.0)
        ) {
            prop_assume!(size(&r) > 0.5 && size(&q) > 1.0);
            // By the place of the sensor, which is at -r from the body.
            let d: [Dual<3>; 3] = core::array::from_fn(|i| Dual::variable(-r[i], i));
            let t = tensor(&q.map(Dual::constant));
            let square = dot(&d, &d);
            let potential = dot(&d, &multiply(&t, &d)).times(0.5 * MU0_OVER_4PI)
                / (square * square * square.sqrt());
            let h = field(&r, &q).unwrap();
            for i in 0..3 {
                prop_assert!((h[i] + potential.by[i]).abs() < 1e-13 * size(&h).max(1e-12 * size(&q)));
            }
        }

        #[test]
        fn a_dipole_that_is_moved_is_one_with_a_quadrupole(
            r in vector::<3>(20.0), m in vector::<3>(100.0), d in vector::<3>(1.0)
        ) {
            prop_assume!(size(&r) > 0.5 && size(&m) > 1.0);
            // What moving it changes of its field is the field of a quadrupole, exactly.
            let by = multiply(&dipole::jacobian(&r, &m).unwrap().position, &d);
            let q = moved(&m, &d);
            let h = field(&r, &q).unwrap();
            let most = MU0_OVER_4PI * 18.0 * size(&m) * size(&d) / size(&r).powi(4);
            for i in 0..3 {
                prop_assert!((by[i] - h[i]).abs() < 1e-14 * most);
            }
        }

        #[test]
        fn what_is_left_of_it_at_the_centre_has_nothing_along_the_moment(
            m in vector::<3>(100.0), d in vector::<3>(1.0), q in vector::<5>(100.0)
        ) {
            // moved(d) : Q = 6 d . Q m.
            let (a, b) = (tensor(&moved(&m, &d)), tensor(&q));
            let product: f64 = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| a * b).sum();
            let wanted = 6.0 * dot(&d, &multiply(&b, &m));
            let most = size(&m) * size(&d) * size(&q);
            prop_assert!((product - wanted).abs() < 1e-13 * most);
        }

        #[test]
        fn sizes_and_the_mirror_image_have_the_same_field(
            r in vector::<3>(20.0), q in vector::<5>(100.0), u in 0.2_f64..5.0
        ) {
            prop_assume!(size(&r) > 0.5);
            let h = field(&r, &q).unwrap();
            let larger = field(&r.map(|x| u * x), &q.map(|x| u.powi(4) * x)).unwrap();
            let image = field(&r.map(|x| -x), &q.map(|x| -x)).unwrap();
            for i in 0..3 {
                prop_assert!((h[i] - larger[i]).abs() < 1e-13 * size(&h));
                prop_assert_eq!(h[i], image[i]);
            }
        }
    }

    #[test]
    fn at_the_centre_the_numbers_that_are_no_states_follow_from_the_moment() {
        for (centre, moment) in [
            ([true; 3], [3.0, -40.0, 2.0]),
            ([true; 3], [0.0, 0.0, 7.0]),
            ([true, false, true], [3.0, -4.0, 5.0]),
            ([false, true, false], [1.0, 1e-3, 0.0]),
            ([false; 3], [1.0, 2.0, 3.0]),
        ] {
            let entries = Entries::new(centre, &moment);
            let held = centre.iter().filter(|c| **c).count();
            assert_eq!(entries.free().len(), 5 - held);
            let free = [2.0, -3.0, 5.0, 7.0, -11.0];
            let free = &free[..5 - held];
            let whole = entries.whole(&moment, free);
            let qm = multiply(&tensor(&whole.entries), &moment);
            for i in (0..3).filter(|i| centre[*i]) {
                assert!(qm[i].abs() < 1e-13 * size(&moment) * size(&whole.entries));
            }
            for (&k, x) in entries.free().iter().zip(free) {
                assert_eq!(whole.entries[k], *x);
            }
            let apart = |a: &Whole, b: &Whole, by: f64| -> [f64; 5] {
                core::array::from_fn(|k| (a.entries[k] - b.entries[k]) / by)
            };
            for (j, by) in whole.by_moment.iter().enumerate() {
                let at = |step: f64| {
                    let mut moved = moment;
                    moved[j] += step;
                    entries.whole(&moved, free)
                };
                let wanted = apart(&at(1e-6), &at(-1e-6), 2e-6);
                for k in 0..5 {
                    assert!((by[k] - wanted[k]).abs() < 1e-7 * (1.0 + size(by)));
                }
            }
            for f in 0..free.len() {
                let at = |step: f64| {
                    let mut moved = free.to_vec();
                    moved[f] += step;
                    entries.whole(&moment, &moved)
                };
                let wanted = apart(&at(1.0), &at(-1.0), 2.0);
                for k in 0..5 {
                    let by = &whole.by_free[f];
                    assert!((by[k] - wanted[k]).abs() < 1e-12 * size(by));
                }
            }
        }
    }

    #[test]
    fn what_is_not_a_field_is_an_error() {
        let q = [1.0; 5];
        assert!(matches!(field(&[0.0; 3], &q), Err(Error::OnSensor { .. })));
        assert!(field(&[1.0, 0.0, 0.0], &[f64::NAN; 5]).is_err());
        assert!(jacobian(&[1.0, 0.0, 0.0], &[f64::INFINITY; 5]).is_err());
        assert!(jacobian(&[1e-70, 0.0, 0.0], &q).is_err());
    }
}
