//! The explorer's page calls this crate: plain arrays in, plain arrays out.
//!
//! A question is an array of numbers, read by [`Question`]; an answer is a list of
//! arrays, each behind its length, made by [`Answer`]. No mathematics is here: it is all
//! in `gramian`. `explorer/explorer.js` is the other side.

pub mod dipole;
pub mod exports;
pub mod radars;
pub mod track;

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

    /// The numbers as the page reads them.
    pub fn numbers(&self) -> &[f64] {
        &self.0
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
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
        out
    }

    #[test]
    fn a_straight_path_leaves_one_combination() {
        for (corner, rank) in [(0.0, 3.0), (300.0, 4.0)] {
            let answer = track::analyze(Question::new(&question(corner))).unwrap();
            assert_eq!(answer.numbers()[..3], [4.0, rank, 4.0]);
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
