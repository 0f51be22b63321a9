//! Two radars in the plane whose range and azimuth are off by constants.

use gramian::batch::{Items, Threads};
use gramian::observability::Observability;
use gramian::registration::Layout;
use gramian::registration::batch::{self, Scene};
use gramian::rounding;

use crate::{Answer, Limits, Question};

const NONE: [f64; 4] = [0.0; 4];

fn scene<'a>(sensors: &'a [f64; 4], sigma: &'a [f64; 4], positions: Items<'a>) -> Scene<'a> {
    Scene {
        layout: Layout::PAIR,
        sensors: Items::shared(sensors),
        sigma: Items::shared(sigma),
        biases: Items::shared(&NONE),
        positions,
    }
}

fn rows(sensors: &[f64; 4], sigma: &[f64; 4], positions: &[f64]) -> Result<Vec<f64>, String> {
    let mut rows = vec![0.0; positions.len() / 2 * 8];
    batch::rows(
        scene(sensors, sigma, Items::shared(positions)),
        Threads::One,
        &mut rows,
    )
    .map_err(|(_, error)| error.to_string())?;
    Ok(rows)
}

/// What looks at a track tell of the biases: of the sensors' places, their deviations of
/// range (m) and azimuth (rad), and the places of the target.
///
/// Behind these the names of the biases and their units, as lines.
///
/// The answer: the verdict, see [`Answer::verdict`]; (rank, states, tolerance, logarithm of the determinant); singular values;
/// null space; bounds of the biases; the degree after each look.
///
/// # Errors
/// What is wrong, in words.
pub fn analyze(mut question: Question<'_>) -> Result<Answer, String> {
    let (sensors, sigma) = (question.array()?, question.array()?);
    let positions = question.list()?;
    let mut found = rows(&sensors, &sigma, positions)?;
    let mut noise = [0.0; 4];
    batch::rounding(
        scene(&sensors, &sigma, Items::shared(positions)),
        Threads::One,
        &mut noise,
    )
    .map_err(|(_, error)| error.to_string())?;
    let rtol = rounding::remove(&mut found, 4, &noise);
    let analysis = Observability::new(&found, 4, rtol).map_err(|error| error.to_string())?;
    let mut degrees = vec![0.0; positions.len() / 2];
    batch::running_eta(
        scene(&sensors, &sigma, Items::shared(positions)),
        None,
        Threads::One,
        &mut degrees,
    )
    .map_err(|(_, error)| error.to_string())?;
    let null_space = analysis.null_space().map_err(|error| error.to_string())?;
    let mut answer = Answer::default();
    let data_std = analysis.crlb_std();
    let limits = Limits {
        data_std: &data_std,
        scale: &[],
        prior: &[],
        fit: None,
    };
    answer.verdict(&mut question, &analysis, limits)?;
    answer.list(&[
        analysis.rank() as f64,
        4.0,
        analysis.rtol(),
        analysis.log_det(),
    ]);
    answer.list(analysis.singular_values());
    answer.list(&null_space.concat());
    answer.list(&data_std);
    answer.list(&degrees);
    Ok(answer)
}

/// The degree of eight looks on a circle around each place: of sensors, deviations, the
/// places' east and north, and the radius (m).
///
/// The answer: the degrees, row by row from the first north on.
///
/// # Errors
/// What is wrong, in words.
pub fn map(mut question: Question<'_>) -> Result<Answer, String> {
    let (sensors, sigma) = (question.array()?, question.array()?);
    let (east, north) = (question.list()?, question.list()?);
    let [radius] = question.array()?;
    let mut places = Vec::with_capacity(16 * east.len() * north.len());
    for &y in north {
        for &x in east {
            for k in 0..8_u8 {
                let (sin, cos) = (f64::from(k) * core::f64::consts::FRAC_PI_4).sin_cos();
                let mut place = [x + radius * sin, y + radius * cos];
                for sensor in sensors.as_chunks::<2>().0 {
                    let away = (place[0] - sensor[0]).hypot(place[1] - sensor[1]);
                    // A look on a sensor has no azimuth: beside it, it has.
                    if away < 1e-6 * radius {
                        place = place.map(|x| x + 1e-3 * radius);
                    }
                }
                places.extend(place);
            }
        }
    }
    let mut degrees = vec![0.0; east.len() * north.len()];
    batch::eta(
        scene(&sensors, &sigma, Items::each(&places, 16)),
        Threads::One,
        &mut degrees,
    )
    .map_err(|(_, error)| error.to_string())?;
    let mut answer = Answer::default();
    answer.list(&degrees);
    Ok(answer)
}
