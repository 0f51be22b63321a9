//! What says that measured bearings are not of the scene, in words, as `gm.tracks.estimate`
//! says it: dead sensors, chi-square, the tests of other scenes, residuals like their neighbours.

use gramian::chi_square::Goodness;
use gramian::numbers::words::brief;
use gramian::solve::Model;
use gramian::solve::fit::{Channel, Fit, Lag1, Score, channels};
use gramian::tracks::scene::Measured;
use gramian::tracks::scene::departures::Departure;

/// A p beyond this is of residuals that are too small.
const SMALL: f64 = 0.999;
/// Times of turns that are tested, as shares of the times, and how many times these need.
const TURNS: [f64; 3] = [0.25, 0.5, 0.75];
const LEAST_TIMES: usize = 8;
/// So many residuals are left out at most.
const OUTLIERS: usize = 3;
/// What a test is said to see, with which power.
const POWER: f64 = 0.8;

/// Bearings as measured, at times (s) in order, with their deviation (rad), and a state.
#[derive(Clone, Copy, Debug)]
pub struct Bearings<'a> {
    /// The scene with its bearings.
    pub model: &'a Measured<'a>,
    /// The bearings, rad.
    pub values: &'a [f64],
    /// When they were taken, s.
    pub times: &'a [f64],
    /// The time at which the states are, s.
    pub reference: f64,
    /// Their standard deviation, rad.
    pub sigma: f64,
    /// The estimate.
    pub state: &'a [f64],
}

impl Bearings<'_> {
    /// What says so; empty where nothing does.
    ///
    /// # Errors
    /// Where the sensor reads nothing at the state.
    pub fn misfit(&self, alpha: f64) -> Result<String, String> {
        let fit = Fit::new(self.model, self.state).map_err(|error| error.to_string())?;
        let dof = fit.dof();
        let p_value = fit.p_value();
        // Exact data repeat themselves.
        let too_small = dof > 0 && p_value > SMALL;
        if !too_small && let Some(fault) = self.fault() {
            return Ok(fault);
        }
        let tests = self.tests(&fit, alpha)?;
        let best = tests.first();
        if dof > 0 && p_value < alpha {
            let chi2 = Goodness::new(fit.chi2(), dof as f64).misfit(1.0);
            let mut said = vec![chi2.unwrap_or_default()];
            said.extend(
                best.filter(|(_, score)| score.restored > alpha)
                    .map(|(name, score)| {
                        format!("{name} would explain it (p = {})", brief(score.restored, 2))
                    }),
            );
            said.extend(outlying(&fit, alpha));
            return Ok(said.join("; "));
        }
        if let Some((name, score)) = best
            && tests.len() as f64 * score.p_value < alpha
        {
            let p = brief(score.p_value, 2);
            return Ok(format!("{name} shows in the residuals (p = {p})"));
        }
        let lag = fit.lag1();
        let colored = dof >= 10 && lag.p_value < 0.1 * alpha && !too_small;
        Ok(if colored {
            correlated(lag)
        } else {
            String::new()
        })
    }

    /// That the sensor is dead or stuck.
    fn fault(&self) -> Option<String> {
        let places: Vec<usize> = (0..self.values.len()).collect();
        let sigma = vec![self.sigma; self.values.len()];
        match channels(self.values, &sigma, &[&places]).first()? {
            Channel::Constant => Some(String::from(
                "bearing is constant over the record: dead or stuck",
            )),
            Channel::Stuck { first, last } => Some(format!(
                "bearing is stuck at one value from {} s to {} s, longer than its noise lets it",
                brief(self.times[*first], 6),
                brief(self.times[*last], 6)
            )),
            _ => None,
        }
    }

    /// The other scenes that leave a trace, the likeliest first.
    fn tests(&self, fit: &Fit, alpha: f64) -> Result<Vec<(String, Score)>, String> {
        let turns: Vec<f64> = if self.times.len() < LEAST_TIMES {
            Vec::new()
        } else {
            TURNS.map(|share| quantile(self.times, share)).to_vec()
        };
        let after: Vec<f64> = turns.iter().map(|turn| turn - self.reference).collect();
        let found = self
            .model
            .departures(self.state, &after)
            .map_err(|error| error.to_string())?;
        let (share, m) = (alpha / found.len().max(1) as f64, self.model.measurements());
        let mut turns = turns.into_iter();
        let mut tests: Vec<(String, Score)> = found
            .iter()
            .map(|(departure, columns)| {
                let name = match departure {
                    Departure::Order(_) => String::from("acceleration"),
                    Departure::Turn(_) => {
                        format!("turn at {} s", brief(turns.next().unwrap_or(f64::NAN), 6))
                    }
                    Departure::Bias(_) => String::from("bias of bearing"),
                    Departure::Scale(_) => String::from("scale of bearing"),
                    Departure::Clock(_) => String::from("clock of bearing"),
                };
                (name, fit.score(columns, columns.len() / m, share, POWER))
            })
            .filter(|(_, score)| score.dof > 0)
            .collect();
        tests.sort_by(|(_, a), (_, b)| a.p_value.total_cmp(&b.p_value));
        Ok(tests)
    }
}

/// The value below which a share of ascending ones lie, between two by their distance.
fn quantile(values: &[f64], share: f64) -> f64 {
    let place = share * (values.len() - 1) as f64;
    // Between the first and the last.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let k = (place.floor() as usize).min(values.len().saturating_sub(2));
    values[k] + (place - k as f64) * (values[k + 1] - values[k])
}

/// The few residuals without which the scene would fit.
fn outlying(fit: &Fit, alpha: f64) -> Option<String> {
    let size = fit.standardized();
    let count = size.len().max(1) as f64;
    // One honest record in a hundred has one beyond it.
    let limit = gramian::chi_square::critical(0.01 / count, 1.0)
        .ok()?
        .sqrt();
    let mut worst: Vec<usize> = (0..size.len()).filter(|&i| size[i].abs() > limit).collect();
    worst.sort_by(|&a, &b| size[b].abs().total_cmp(&size[a].abs()));
    let most = OUTLIERS.min(worst.len()).min(fit.dof().saturating_sub(1));
    (1..=most).find_map(|count| {
        let mut columns = vec![0.0; size.len() * count];
        for (column, &place) in worst[..count].iter().enumerate() {
            columns[place * count + column] = 1.0;
        }
        let without = fit.score(&columns, count, alpha, POWER);
        if without.dof != count || !(without.restored > alpha) {
            return None;
        }
        let mut places = worst[..count].to_vec();
        places.sort_unstable();
        let which: Vec<String> = places
            .iter()
            .map(|&i| {
                format!(
                    "{i} (off by {} standard deviations)",
                    brief(size[i].abs(), 2)
                )
            })
            .collect();
        Some(format!(
            "without residual{} {} it would fit (p = {})",
            if count == 1 { "" } else { "s" },
            which.join(", "),
            brief(without.restored, 2)
        ))
    })
}

/// That neighbouring residuals are correlated.
fn correlated(lag: Lag1) -> String {
    format!(
        "neighbouring residuals are correlated, {} where white noise leaves {} +- {} (p = {}): \
         the noise is not white, or the model is wrong",
        brief(lag.correlation, 2),
        brief(lag.mean, 2),
        brief(lag.sigma, 1),
        brief(lag.p_value, 2)
    )
}
