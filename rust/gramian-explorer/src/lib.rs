//! The explorer's page calls this crate: plain arrays in, plain arrays out.
//!
//! A question is an array of numbers, read by [`Question`]; an answer is a list of
//! arrays, each behind its length, made by [`Answer`]. No mathematics is here: it is all
//! in `gramian`. `explorer/library.js` is the other side.

use gramian::chi_square::Goodness;
use gramian::numbers::words::moves;
use gramian::observability::Observability;
use gramian::spine::verdict::{Findings, WEAK_CONDITION, WEAK_RATIO, judge, of_estimate};

pub mod dipole;
pub mod exports;
pub mod misfit;
pub mod radars;
pub mod track;

/// What bounds are judged by.
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a> {
    /// Deviations at the bound from the measurements alone.
    pub data_std: &'a [f64],
    /// Deviations that would be useless, NaN for none.
    pub scale: &'a [f64],
    /// Deviations beforehand, infinite for none.
    pub prior: &'a [f64],
    /// How well the states fit where they were estimated.
    pub fit: Option<Goodness>,
}

/// A question: numbers, and arrays behind their lengths.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a>(&'a [f64]);

impl<'a> Question<'a> {
    /// All the numbers of a question.
    pub fn new(numbers: &'a [f64]) -> Self {
        Self(numbers)
    }

    /// The next array.
    ///
    /// # Errors
    /// Where it is not there.
    pub fn list(&mut self) -> Result<&'a [f64], String> {
        let count = self.number()?;
        // A length is a small whole number; what is none is too long.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let count = if count >= 0.0 {
            count as usize
        } else {
            usize::MAX
        };
        if count > self.0.len() {
            return Err(String::from("the question ends early"));
        }
        let (list, rest) = self.0.split_at(count);
        self.0 = rest;
        Ok(list)
    }

    /// The next number.
    ///
    /// # Errors
    /// Where there is none.
    pub fn number(&mut self) -> Result<f64, String> {
        let (first, rest) = self
            .0
            .split_first()
            .ok_or_else(|| String::from("the question ends early"))?;
        self.0 = rest;
        Ok(*first)
    }

    /// The next array as lines of text: its numbers are the bytes of UTF-8.
    ///
    /// # Errors
    /// Where it is not there.
    pub fn lines(&mut self) -> Result<Vec<String>, String> {
        // What is no byte becomes one: the text is only shown.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let bytes: Vec<u8> = self.list()?.iter().map(|&x| x as u8).collect();
        Ok(String::from_utf8_lossy(&bytes)
            .split('\n')
            .map(String::from)
            .collect())
    }

    /// The next array, of so many numbers.
    ///
    /// # Errors
    /// Where it is not there or of another length.
    pub fn array<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let list = self.list()?;
        list.try_into()
            .map_err(|_| format!("{} numbers: {N} are needed", list.len()))
    }
}

/// An answer: arrays behind their lengths.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer(Vec<f64>);

impl Answer {
    /// Adds an array.
    pub fn list(&mut self, values: &[f64]) {
        self.0.push(values.len() as f64);
        self.0.extend_from_slice(values);
    }

    /// Adds a text, as the bytes of UTF-8.
    pub fn text(&mut self, text: &str) {
        let bytes: Vec<f64> = text.bytes().map(f64::from).collect();
        self.list(&bytes);
    }

    /// Adds what `gm.analyze` says of rows: the status, the reason, and each combination that
    /// is not determined, as lines of text. `question` goes on with the names of the states
    /// and their units, as lines.
    ///
    /// # Errors
    /// Where these are missing, or the null space overflows.
    pub fn verdict(
        &mut self,
        question: &mut Question<'_>,
        found: &Observability<f64>,
        limits: Limits<'_>,
    ) -> Result<(), String> {
        let n = found.states();
        let (names, units) = (question.lines()?, question.lines()?);
        if names.len() != n || units.len() != n {
            return Err(format!(
                "{} names and {} units: {n} are needed",
                names.len(),
                units.len()
            ));
        }
        let null_space = found.null_space().map_err(|error| error.to_string())?;
        let open: Vec<bool> = (0..n)
            .map(|i| null_space.iter().any(|vector| vector[i] != 0.0))
            .collect();
        let verdict = judge(&Findings {
            rank: found.rank(),
            open: &open,
            data_std: limits.data_std,
            scale: limits.scale,
            prior: limits.prior,
            condition: found.condition(),
            hardness: limits.data_std,
            weak_ratio: WEAK_RATIO,
            weak_condition: WEAK_CONDITION,
        });
        let mut reason = verdict.reason.words(|i| &names[i], |i| &units[i]);
        let mut status = verdict.status.name();
        if let Some(fit) = limits.fit {
            (status, reason) = of_estimate(verdict.status, reason, fit, Goodness::ALPHA);
        }
        let mut lines = vec![String::from(status), reason];
        lines.extend(null_space.iter().map(|vector| moves(vector, &names)));
        self.text(&lines.join("\n"));
        Ok(())
    }

    /// The numbers as the page reads them.
    pub fn numbers(&self) -> &[f64] {
        &self.0
    }
}

#[cfg(test)]
#[allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss
)]
mod tests {
    use super::{Question, track};

    /// A question about a straight path, or one with a corner, and fixed bearings.
    fn question(corner: f64) -> Vec<f64> {
        let times: Vec<f64> = (0..20).map(|k| 30.0 * f64::from(k)).collect();
        let lists: [&[f64]; 6] = [
            &[0.0, 285.0, 570.0],
            &[0.0, 0.0, 800.0 + corner, 400.0, 1600.0, 800.0],
            &times,
            &[0.01, 0.0, 0.0, 1500.0],
            &[3000.0, 4000.0, -3.0, 1.0],
            &[f64::INFINITY; 4],
        ];
        let mut out = Vec::new();
        for list in lists {
            out.push(list.len() as f64);
            out.extend_from_slice(list);
        }
        for text in ["x0\ny0\nvx\nvy", "m\nm\nm/s\nm/s"] {
            out.push(text.len() as f64);
            out.extend(text.bytes().map(f64::from));
        }
        out
    }

    #[test]
    fn a_straight_path_leaves_one_combination() {
        for (corner, rank) in [(0.0, 3.0), (300.0, 4.0)] {
            let answer = track::analyze(Question::new(&question(corner))).unwrap();
            let (text, rest) = answer.numbers()[1..].split_at(answer.numbers()[0] as usize);
            let text: String = text.iter().map(|&x| char::from(x as u8)).collect();
            let said = if rank < 4.0 {
                "unobservable"
            } else {
                "observable"
            };
            assert_eq!(text.lines().next(), Some(said));
            assert_eq!(rest[..3], [4.0, rank, 4.0]);
        }
    }

    #[test]
    fn a_question_that_ends_early_is_refused() {
        let whole = question(300.0);
        for count in 0..whole.len() {
            assert!(track::analyze(Question::new(&whole[..count])).is_err());
        }
        assert!(Question::new(&[-1.0]).list().is_err());
        assert!(Question::new(&[f64::NAN]).list().is_err());
    }
}
