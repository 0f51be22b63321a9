//! Random bit patterns for every function of the C interface: a status for what is
//! not finite, and nothing that is not finite without one. `GRAMIAN_FUZZ` is the
//! number of patterns.
#![allow(unsafe_code, clippy::unwrap_used)]

use std::mem::MaybeUninit;
use std::ptr::null_mut as null;

use gramian_capi::{
    GramianAnswer, GramianLaw, GramianSide, GramianStatus, gramian_dipole_field,
    gramian_dipole_jacobian, gramian_dipole_sums_init, gramian_dipole_sums_matrix,
    gramian_dipole_sums_push, gramian_heading, gramian_monitor_answer, gramian_monitor_init,
    gramian_monitor_push,
};

/// `SplitMix64`.
struct Draw(u64);

impl Draw {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Any bits, or a number of a usual size.
    fn x(&mut self, wild: bool) -> f32 {
        let bits = self.bits();
        if wild && bits.is_multiple_of(4) {
            f32::from_bits(u32::try_from(bits >> 32).unwrap())
        } else {
            (bits >> 40) as f32 / 1e4
        }
    }

    fn vector(&mut self, wild: bool) -> [f32; 3] {
        core::array::from_fn(|_| self.x(wild))
    }
}

fn finite(values: &[f32]) -> bool {
    values.iter().all(|x| x.is_finite())
}

const LAWS: [GramianLaw; 5] = [
    GramianLaw::MaxDet,
    GramianLaw::HammelLiu,
    GramianLaw::BearingRate,
    GramianLaw::Perpendicular,
    GramianLaw::Circle,
];

#[test]
fn no_pattern_gives_what_is_not_finite_without_a_status() {
    let count = std::env::var("GRAMIAN_FUZZ").map_or(20_000, |count| count.parse().unwrap());
    for pattern in 0..count {
        let mut draw = Draw(pattern);
        let wild = draw.bits().is_multiple_of(2);
        watch(&mut draw, wild);
        steer(&mut draw, wild);
        feel(&mut draw, wild);
    }
}

fn watch(draw: &mut Draw, wild: bool) {
    let mut monitor = MaybeUninit::uninit();
    // SAFETY: memory for a monitor, made before any other use.
    let mut monitor = unsafe {
        assert_eq!(
            gramian_monitor_init(monitor.as_mut_ptr()),
            GramianStatus::Ok
        );
        monitor.assume_init()
    };
    let mut time = 0.0_f32;
    let ranged = draw.bits().is_multiple_of(2);
    for _ in 0..6 {
        time += draw.x(wild).abs();
        let (bearing, sigma) = (draw.x(wild), draw.x(wild));
        let range = if ranged { draw.x(wild) } else { 0.0 };
        // SAFETY: a monitor that was made.
        let status = unsafe { gramian_monitor_push(&raw mut monitor, time, bearing, sigma, range) };
        if status == GramianStatus::Ok {
            assert!(finite(&[time, bearing, sigma, range]));
        } else if !time.is_finite() {
            time = 0.0;
        }
        let mut answer = MaybeUninit::<GramianAnswer>::uninit();
        // SAFETY: a monitor that was made, and memory for an answer.
        let answer = unsafe {
            let status = gramian_monitor_answer(&raw const monitor, answer.as_mut_ptr());
            assert_eq!(status, GramianStatus::Ok);
            answer.assume_init()
        };
        assert!(finite(&[
            answer.singular_value,
            answer.statistic,
            answer.dof,
            answer.p_value
        ]));
        assert!(answer.crlb_std.iter().all(|std| *std >= 0.0));
        assert!(!answer.log_determinant.is_nan() && answer.rank <= 4);
    }
}

fn steer(draw: &mut Draw, wild: bool) {
    let (bearing, range, step) = (draw.x(wild), draw.x(wild), draw.x(wild));
    let law = LAWS[usize::try_from(draw.bits() % 4).unwrap()];
    let side = [GramianSide::Right, GramianSide::Left][usize::try_from(draw.bits() % 2).unwrap()];
    let mut heading = f32::NAN;
    // SAFETY: a pointer to a float.
    let status = unsafe { gramian_heading(bearing, range, step, law, side, &raw mut heading) };
    if status == GramianStatus::Ok {
        assert!(finite(&[bearing, range, step, heading]));
    }
}

fn feel(draw: &mut Draw, wild: bool) {
    let (position, moment) = (draw.vector(wild), draw.vector(wild));
    let mut field = [f32::NAN; 3];
    let (mut by_position, mut by_moment) = ([f32::NAN; 9], [f32::NAN; 9]);
    // SAFETY: pointers to three floats, and to nine for the derivatives.
    let (first, second) = unsafe {
        (
            gramian_dipole_field(position.as_ptr(), moment.as_ptr(), field.as_mut_ptr()),
            gramian_dipole_jacobian(
                position.as_ptr(),
                moment.as_ptr(),
                by_position.as_mut_ptr(),
                by_moment.as_mut_ptr(),
            ),
        )
    };
    if first == GramianStatus::Ok {
        assert!(finite(&position) && finite(&moment) && finite(&field));
    }
    if second == GramianStatus::Ok {
        assert!(finite(&by_position) && finite(&by_moment));
    }
    let mut sums = MaybeUninit::uninit();
    // SAFETY: memory for sums, made before any other use.
    let mut sums = unsafe {
        assert_eq!(
            gramian_dipole_sums_init(sums.as_mut_ptr()),
            GramianStatus::Ok
        );
        sums.assume_init()
    };
    for _ in 0..3 {
        let (time, sigma) = (draw.x(wild), draw.x(wild) * 1e-6);
        let (position, moment) = (draw.vector(wild), draw.vector(wild));
        // SAFETY: sums that were made, and pointers to three floats.
        let status = unsafe {
            gramian_dipole_sums_push(
                &raw mut sums,
                time,
                position.as_ptr(),
                moment.as_ptr(),
                sigma,
            )
        };
        if status == GramianStatus::Ok {
            assert!(finite(&[time, sigma]) && finite(&position) && finite(&moment));
        }
    }
    let mut matrix = [f32::NAN; 81];
    // SAFETY: sums that were made, and a pointer to 81 floats.
    let status = unsafe { gramian_dipole_sums_matrix(&raw const sums, matrix.as_mut_ptr()) };
    assert!(status == GramianStatus::Ok && finite(&matrix));
}

#[test]
fn a_null_pointer_is_a_status() {
    // SAFETY: null is allowed everywhere.
    unsafe {
        assert_eq!(gramian_monitor_init(null()), GramianStatus::Null);
        assert_eq!(
            gramian_monitor_push(null(), 0.0, 0.0, 1.0, 0.0),
            GramianStatus::Null
        );
        assert_eq!(gramian_monitor_answer(null(), null()), GramianStatus::Null);
        let status = gramian_heading(0.0, 9.0, 1.0, GramianLaw::MaxDet, GramianSide::Left, null());
        assert_eq!(status, GramianStatus::Null);
        assert_eq!(
            gramian_dipole_field(null(), null(), null()),
            GramianStatus::Null
        );
        let status = gramian_dipole_jacobian(null(), null(), null(), null());
        assert_eq!(status, GramianStatus::Null);
        assert_eq!(gramian_dipole_sums_init(null()), GramianStatus::Null);
        let status = gramian_dipole_sums_push(null(), 0.0, null(), null(), 1.0);
        assert_eq!(status, GramianStatus::Null);
        assert_eq!(
            gramian_dipole_sums_matrix(null(), null()),
            GramianStatus::Null
        );
    }
}
