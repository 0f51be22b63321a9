//! The verdict on what rows determine: its status, what decided it, and why.
//!
//! The rules are here and nowhere else; what only the faces know, names and units, comes
//! in where the reason is put into words.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use crate::numbers::chi_square::Goodness;
use crate::numbers::words::brief;
use crate::spine::parts::column_norms;

/// The status, worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// A combination of the states is not determined.
    Unobservable,
    /// A bound is above what would be useless.
    Weak,
    /// Neither.
    Observable,
}

impl Status {
    /// The status as it is written.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unobservable => "unobservable",
            Self::Weak => "weak",
            Self::Observable => "observable",
        }
    }
}

/// What a bound is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The deviation of the state that would be useless.
    Scale,
    /// What is known of it beforehand.
    Prior,
}

/// What decided a status.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// The rank, of so many states.
    Rank {
        /// Combinations that are determined.
        rank: usize,
        /// All of them.
        states: usize,
    },
    /// The bound of a state is above its limit.
    Bound {
        /// The state.
        state: usize,
        /// Its deviation at the bound.
        std: f64,
        /// What that is compared with.
        limit: f64,
        /// Which that is.
        kind: Limit,
    },
    /// The condition number on unit columns, where no state has a limit.
    Condition {
        /// The number.
        condition: f64,
        /// What it is compared with.
        most: f64,
    },
}

/// A status, the states that decided it, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The status.
    pub status: Status,
    /// The states that decided it: those of the open combinations, those above their
    /// limits with the worst first, the hardest one.
    pub decided_by: Vec<usize>,
    /// Why.
    pub reason: Reason,
}

/// What is judged.
#[derive(Clone, Copy, Debug)]
pub struct Findings<'a> {
    /// Combinations that are determined, prior knowledge included.
    pub rank: usize,
    /// For each state whether an open combination moves it.
    pub open: &'a [bool],
    /// For each state its deviation at the bound from the measurements alone.
    pub data_std: &'a [f64],
    /// For each state the deviation that would be useless, NaN for none.
    pub scale: &'a [f64],
    /// For each state its deviation beforehand, infinite for none.
    pub prior: &'a [f64],
    /// The condition number on unit columns.
    pub condition: f64,
    /// For each state how hard it is, for the one to be named where the condition decides.
    pub hardness: &'a [f64],
    /// "Weak" where a bound exceeds this many times its limit.
    pub weak_ratio: f64,
    /// "Weak" where no state has a limit and the condition number exceeds this.
    pub weak_condition: f64,
}

/// For each state what its bound is compared with: its scale, or where that is NaN what the
/// `rows` would know it to if it were alone; 1 where they do not touch it.
///
/// ```
/// let rows = [3.0, 1.0, 0.0, 4.0, 1.0, 0.0];
/// let found = gramian::spine::verdict::references(&rows, &[f64::NAN, 7.0, f64::NAN]);
/// assert_eq!(found, [1.0 / 5.0, 7.0, 1.0]);
/// ```
pub fn references(rows: &[f64], scale: &[f64]) -> Vec<f64> {
    let norms = column_norms(rows, scale.len());
    scale
        .iter()
        .zip(norms)
        .map(|(&scale, norm)| match (scale.is_nan(), norm > 0.0) {
            (false, _) => scale,
            (true, true) => 1.0 / norm,
            (true, false) => 1.0,
        })
        .collect()
}

/// "Weak" above this many times the limit of a state, by default.
pub const WEAK_RATIO: f64 = 1.0;
/// "Weak" above this condition number where no state has a limit, by default.
pub const WEAK_CONDITION: f64 = 1e8;

/// The status and the reason where the states were estimated and the fit was tested at the
/// level `alpha`: a misfit outranks all but what is unobservable, and is said in any case.
///
/// ```
/// use gramian::chi_square::Goodness;
/// use gramian::spine::verdict::{Status, of_estimate};
/// let fit = Goodness::new(91.0, 37.0);
/// let (status, reason) = of_estimate(Status::Weak, String::new(), fit, 0.001);
/// assert_eq!(status, "misfit");
/// assert!(reason.ends_with("(p = 1.9e-06): the model does not fit"));
/// let reason = String::from("rank 8 of 9");
/// let (status, reason) = of_estimate(Status::Unobservable, reason, fit, 0.001);
/// assert_eq!(status, "unobservable");
/// assert!(reason.starts_with("rank 8 of 9; chi2 = 91"));
/// ```
pub fn of_estimate(
    status: Status,
    reason: String,
    fit: Goodness,
    alpha: f64,
) -> (&'static str, String) {
    match (status, fit.misfit(alpha)) {
        (_, None) => (status.name(), reason),
        (Status::Unobservable, Some(misfit)) => (status.name(), format!("{reason}; {misfit}")),
        (_, Some(misfit)) => ("misfit", misfit),
    }
}

/// Judges: unobservable before weak before observable.
///
/// A prior makes any problem full rank. The bound *from the measurements alone* is
/// compared with it, so that what only the prior determines is weak.
///
/// ```
/// use gramian::spine::verdict::{Findings, Status, WEAK_CONDITION, judge};
/// let found = judge(&Findings {
///     rank: 2,
///     open: &[false; 2],
///     data_std: &[30.0, 0.1],
///     scale: &[20.0, f64::NAN],
///     prior: &[f64::INFINITY; 2],
///     condition: 3.0,
///     hardness: &[1.0, 1.0],
///     weak_ratio: 1.0,
///     weak_condition: WEAK_CONDITION,
/// });
/// assert_eq!(found.status, Status::Weak);
/// let words = found.reason.words(|_| "x0", |_| "m");
/// assert_eq!(words, "the bound of x0 is 30 m, its scale 20 m");
/// ```
pub fn judge(found: &Findings<'_>) -> Verdict {
    let states = found.data_std.len();
    let rank = Reason::Rank {
        rank: found.rank,
        states,
    };
    if found.rank < states {
        return Verdict {
            status: Status::Unobservable,
            decided_by: (0..found.open.len()).filter(|&i| found.open[i]).collect(),
            reason: rank,
        };
    }
    let mut limited = false;
    let mut over: Vec<(f64, usize, f64, Limit)> = Vec::new();
    for (i, &std) in found.data_std.iter().enumerate() {
        let scale = found.scale.get(i).copied().unwrap_or(f64::NAN);
        let prior = found.prior.get(i).copied().unwrap_or(f64::INFINITY);
        let (limit, kind) = if prior.is_finite() && (scale.is_nan() || prior <= scale) {
            (prior, Limit::Prior)
        } else if scale.is_nan() {
            continue;
        } else {
            (scale, Limit::Scale)
        };
        limited = true;
        let ratio = std / limit;
        if ratio > found.weak_ratio {
            over.push((ratio, i, limit, kind));
        }
    }
    over.sort_by(|a, b| b.0.total_cmp(&a.0));
    if let Some(&(_, state, limit, kind)) = over.first() {
        return Verdict {
            status: Status::Weak,
            decided_by: over.iter().map(|&(_, i, ..)| i).collect(),
            reason: Reason::Bound {
                state,
                std: found.data_std[state],
                limit,
                kind,
            },
        };
    }
    if !limited && found.condition > found.weak_condition {
        let hardest = (0..found.hardness.len()).max_by(|&a, &b| {
            // Of equals the first.
            let order = found.hardness[a].total_cmp(&found.hardness[b]);
            order.then(b.cmp(&a))
        });
        return Verdict {
            status: Status::Weak,
            decided_by: hardest.into_iter().collect(),
            reason: Reason::Condition {
                condition: found.condition,
                most: found.weak_condition,
            },
        };
    }
    Verdict {
        status: Status::Observable,
        decided_by: Vec::new(),
        reason: rank,
    }
}

impl Reason {
    /// The reason in a sentence, by the name and unit of a state.
    pub fn words<N: AsRef<str>, U: AsRef<str>>(
        &self,
        name: impl Fn(usize) -> N,
        unit: impl Fn(usize) -> U,
    ) -> String {
        match *self {
            Self::Rank { rank, states } => match states - rank.min(states) {
                0 => format!("rank {rank} of {states}"),
                1 => format!("rank {rank} of {states}: 1 combination is not determined"),
                more => {
                    format!("rank {rank} of {states}: {more} combinations are not determined")
                }
            },
            Self::Bound {
                state,
                std,
                limit,
                kind,
            } => {
                let (source, kind) = match kind {
                    Limit::Prior => ("from the measurements alone ", "prior"),
                    Limit::Scale => ("", "scale"),
                };
                let (name, unit) = (name(state), unit(state));
                let (name, unit) = (name.as_ref(), unit.as_ref());
                if std.is_infinite() {
                    return format!(
                        "the measurements alone do not determine {name}: only the prior does"
                    );
                }
                let gap = if unit.is_empty() { "" } else { " " };
                let (std, limit) = (brief(std, 4), brief(limit, 4));
                format!(
                    "the bound of {name} {source}is {std}{gap}{unit}, its {kind} {limit}{gap}{unit}"
                )
            }
            Self::Condition { condition, most } => format!(
                "condition number {} on unit columns, above {}",
                brief(condition, 3),
                brief(most, 3)
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Findings, Reason, Status, Verdict, WEAK_CONDITION, WEAK_RATIO, judge};
    use alloc::string::String;
    use alloc::vec;

    const NONE: [f64; 3] = [f64::INFINITY; 3];

    fn findings() -> Findings<'static> {
        Findings {
            rank: 3,
            open: &[false; 3],
            data_std: &[1.0, 2.0, 3.0],
            scale: &[f64::NAN; 3],
            prior: &NONE,
            condition: 10.0,
            hardness: &[1.0, 5.0, 5.0],
            weak_ratio: WEAK_RATIO,
            weak_condition: WEAK_CONDITION,
        }
    }

    fn words(found: &Verdict) -> String {
        found
            .reason
            .words(|i| ["a", "b", "c"][i], |i| ["m", "", "s"][i])
    }

    #[test]
    fn unobservable_comes_first() {
        let found = judge(&Findings {
            rank: 1,
            open: &[true, false, true],
            scale: &[0.1; 3],
            ..findings()
        });
        assert_eq!(found.status, Status::Unobservable);
        assert_eq!(found.decided_by, [0, 2]);
        assert_eq!(
            words(&found),
            "rank 1 of 3: 2 combinations are not determined"
        );
    }

    #[test]
    fn the_worst_ratio_is_named_and_the_tighter_limit_counts() {
        let found = judge(&Findings {
            scale: &[0.9, 1.0, f64::NAN],
            prior: &[f64::INFINITY, 0.5, 30.0],
            ..findings()
        });
        assert_eq!(found.decided_by, [1, 0]);
        assert_eq!(
            words(&found),
            "the bound of b from the measurements alone is 2, its prior 0.5"
        );
        let loose = judge(&Findings {
            scale: &[0.9, 1.0, f64::NAN],
            weak_ratio: 2.0,
            ..findings()
        });
        assert_eq!(loose.status, Status::Observable);
    }

    #[test]
    fn the_condition_decides_only_without_limits() {
        let ill = Findings {
            condition: 1e9,
            ..findings()
        };
        let found = judge(&ill);
        assert_eq!(
            (found.status, found.decided_by.clone()),
            (Status::Weak, vec![1])
        );
        assert_eq!(
            words(&found),
            "condition number 1e+09 on unit columns, above 1e+08"
        );
        let limited = judge(&Findings {
            scale: &[10.0, f64::NAN, f64::NAN],
            ..ill
        });
        assert_eq!(limited.status, Status::Observable);
        assert_eq!(limited.reason, Reason::Rank { rank: 3, states: 3 });
    }
}
