//! Fails to build if the crate pulls in std (its panic handler would clash with
//! the one below) or alloc (there is no allocator here).
#![no_std]

use gramian::{bearings, bound, spectrum::Spectrum, square_root::SquareRootInformation};

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

/// Uses the crate, so that nothing is left out of the link.
#[unsafe(no_mangle)]
pub extern "C" fn no_std_check(time: f32, east: f32) -> f32 {
    let mut root = SquareRootInformation::<f32, 4>::new();
    let pushed = bearings::push_rows(
        &[0.0, time],
        &[[0.0, 0.0], [0.0, east]],
        &[[1.0, 1.0], [2.0, 1.0]],
        &[0.01],
        &mut root,
    );
    match pushed {
        Ok(()) => bound::crlb_std(&Spectrum::new(&root))[0],
        Err(_) => -1.0,
    }
}
