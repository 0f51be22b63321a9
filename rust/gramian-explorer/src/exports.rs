//! The functions that the page calls, and the memory it shares.
//!
//! The page asks for room for its question ([`explorer_input`]), writes it there, calls
//! one of the functions, and reads the answer, or the text of an error where the function
//! returned 0.
// Names without mangling are what a page finds its functions by; nothing else is unsafe.
#![allow(unsafe_code)]

use std::cell::RefCell;

use crate::{Answer, Question, dipole, radars, track};

#[derive(Default)]
struct Shared {
    question: Vec<f64>,
    answer: Answer,
    error: String,
}

thread_local! {
    static SHARED: RefCell<Shared> = RefCell::default();
}

fn ask(function: impl Fn(Question<'_>) -> Result<Answer, String>) -> u32 {
    SHARED.with_borrow_mut(|shared| match function(Question::new(&shared.question)) {
        Ok(answer) => {
            shared.answer = answer;
            1
        }
        Err(error) => {
            shared.error = error;
            0
        }
    })
}

/// Room for a question of so many numbers.
#[unsafe(no_mangle)]
pub extern "C" fn explorer_input(count: usize) -> *mut f64 {
    SHARED.with_borrow_mut(|shared| {
        shared.question.clear();
        shared.question.resize(count, 0.0);
        shared.question.as_mut_ptr()
    })
}

/// Where the answer is.
#[unsafe(no_mangle)]
pub extern "C" fn explorer_output() -> *const f64 {
    SHARED.with_borrow(|shared| shared.answer.numbers().as_ptr())
}

/// How many numbers it has.
#[unsafe(no_mangle)]
pub extern "C" fn explorer_output_count() -> usize {
    SHARED.with_borrow(|shared| shared.answer.numbers().len())
}

/// The text of the last error, in UTF-8.
#[unsafe(no_mangle)]
pub extern "C" fn explorer_error() -> *const u8 {
    SHARED.with_borrow(|shared| shared.error.as_ptr())
}

/// Its length.
#[unsafe(no_mangle)]
pub extern "C" fn explorer_error_count() -> usize {
    SHARED.with_borrow(|shared| shared.error.len())
}

/// [`track::analyze`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_track() -> u32 {
    ask(track::analyze)
}

/// [`track::region`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_track_region() -> u32 {
    ask(track::region)
}

/// [`track::intervals`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_track_intervals() -> u32 {
    ask(track::intervals)
}

/// [`track::fits`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_track_fits() -> u32 {
    ask(track::fits)
}

/// [`track::headings`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_track_headings() -> u32 {
    ask(track::headings)
}

/// [`track::estimate`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_track_estimate() -> u32 {
    ask(track::estimate)
}

/// [`radars::analyze`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_radars() -> u32 {
    ask(radars::analyze)
}

/// [`radars::map`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_radars_map() -> u32 {
    ask(radars::map)
}

/// [`dipole::analyze`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_dipole() -> u32 {
    ask(dipole::analyze)
}

/// [`dipole::fit`].
#[unsafe(no_mangle)]
pub extern "C" fn explorer_dipole_fit() -> u32 {
    ask(dipole::fit)
}
