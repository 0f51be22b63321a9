//! A magnetic dipole that passes at constant velocity.

use gramian::chi_square::Goodness;
use gramian::dipole::localize::{Background, Knowledge, Options, localize};
use gramian::dipole::{Pass, Sensors};
use gramian::observability::Observability;

use crate::{Answer, Limits, Question};

/// What a pass tells of itself: of its state (position, velocity, moment), the times, the
/// noise (T), the places of the sensors, the combinations of the states that are known
/// exactly (rows of nine), others that might be (rows of nine), and the size u of a pass
/// of another size.
///
/// Behind these (chi2, degrees of freedom) of the fit where the pass was estimated, else
/// nothing; the names of the states and their units, as lines.
///
/// The answer: the verdict, see [`Answer::verdict`]; (rank, states, tolerance, logarithm of the determinant); singular values;
/// null space; bounds; for each combination that might be known, the rank with it; for
/// each state what would be useless; the fields of the pass, of its mirror image, and of the pass of another size; the states
/// of these two.
///
/// # Errors
/// What is wrong, in words.
pub fn analyze(mut question: Question<'_>) -> Result<Answer, String> {
    let pass = Pass::of(&question.array()?);
    let times = question.list()?;
    let [sigma] = question.array()?;
    let sensors = question.list()?.as_chunks::<3>().0;
    let (known, others) = (question.list()?, question.list()?);
    let [size] = question.array()?;
    let fit = match question.list()? {
        [chi2, dof] => Some(Goodness::new(*chi2, *dof)),
        _ => None,
    };
    if times.is_empty() {
        return Err(String::from("no sample sees the dipole"));
    }
    let mut rows: Vec<[f64; 9]> = Vec::new();
    let heads = Sensors::vector(sensors);
    heads
        .push_rows(times, &pass, &[sigma], &mut rows)
        .map_err(|error| error.to_string())?;
    let found = Observability::constrained(rows.as_flattened(), known, 9, None)
        .map_err(|error| error.to_string())?;
    let null_space = found.null_space().map_err(|error| error.to_string())?;
    let mut repaired = Vec::new();
    for other in others.as_chunks::<9>().0 {
        let (rank, _) = found
            .knowing(other, 0.0)
            .map_err(|error| error.to_string())?;
        repaired.push(rank as f64);
    }
    // About the first sensor.
    let Some(&centre) = sensors.first() else {
        return Err(String::from("there is no sensor"));
    };
    let moved = |pass: Pass<f64>, sign: f64| Pass {
        position: core::array::from_fn(|i| pass.position[i] + sign * centre[i]),
        ..pass
    };
    let seen = moved(pass, -1.0);
    let (mirrored, scaled) = (
        moved(seen.mirrored(), 1.0),
        moved(seen.scaled(size).map_err(|error| error.to_string())?, 1.0),
    );
    let mut answer = Answer::default();
    let (data_std, scale) = (found.crlb_std(), scale(&pass, times, sensors));
    let limits = Limits {
        data_std: &data_std,
        scale: &scale,
        prior: &[],
        fit,
    };
    answer.verdict(&mut question, &found, limits)?;
    answer.list(&[found.rank() as f64, 9.0, found.rtol(), found.log_det()]);
    answer.list(found.singular_values());
    answer.list(&null_space.concat());
    answer.list(&data_std);
    answer.list(&repaired);
    answer.list(&scale);
    for pass in [pass, mirrored, scaled] {
        let mut fields = vec![0.0; 3 * times.len() * sensors.len()];
        heads
            .measure(times, &pass, &mut fields)
            .map_err(|error| error.to_string())?;
        answer.list(&fields);
    }
    answer.list(&mirrored.state());
    answer.list(&scaled.state());
    Ok(answer)
}

/// What a field tells of the numbers that [`fit`] finds: the place, the velocity, the moment
/// and the constant field, three each, less the size of the pass.
const ESTIMATED: f64 = 11.0;

/// The pass that fits a recorded field best, with a constant field beside it: of the times,
/// the field (K, 3) in T, the noise (T), and the place of the sensor.
///
/// The answer: the state; the constant field; (chi2, degrees of freedom); the field less
/// what is constant; how well it fits, in words.
///
/// # Errors
/// What is wrong, in words.
pub fn fit(mut question: Question<'_>) -> Result<Answer, String> {
    let (times, field) = (question.list()?, question.list()?);
    let [sigma] = question.array()?;
    let sensor: [f64; 3] = question.array()?;
    let options = Options {
        background: Background::Fit,
        sigma: Some(sigma),
        ..Options::default()
    };
    let found = localize(
        times,
        field,
        &Sensors::vector(&[sensor]),
        &Knowledge::default(),
        &options,
    )
    .map_err(|error| error.to_string())?;
    let fit = Goodness::new(found.best.cost, field.len() as f64 - ESTIMATED);
    let alone: Vec<f64> = field
        .iter()
        .zip(found.background.iter().cycle())
        .map(|(value, constant)| value - constant)
        .collect();
    let mut answer = Answer::default();
    answer.list(&found.best.state);
    answer.list(&found.background);
    answer.list(&[fit.chi2, fit.dof]);
    answer.list(&alone);
    answer.text(&fit.words());
    Ok(answer)
}

/// The deviation of each state that would be useless, as `gm.dipole.problem` has it: the
/// least distance, the speed (or that distance over the time), the size of the moment.
fn scale(pass: &Pass<f64>, times: &[f64], sensors: &[[f64; 3]]) -> [f64; 9] {
    let size = |v: [f64; 3]| v[0].hypot(v[1]).hypot(v[2]);
    let reach = sensors
        .iter()
        .flat_map(|sensor| times.iter().map(move |time| (sensor, time - times[0])))
        .filter_map(|(sensor, time)| pass.seen_from(sensor, time).ok())
        .map(size)
        .fold(f64::INFINITY, f64::min);
    let span = times[times.len() - 1] - times[0];
    let rate = if span > 0.0 { reach / span } else { 0.0 };
    let mut scale = [reach; 9];
    scale[3..6].fill(size(pass.velocity).max(rate));
    scale[6..].fill(size(pass.moment));
    scale
}
