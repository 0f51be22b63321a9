//! Fields and passes of a dipole.

use crate::draw::{Draw, Number, all_finite};
use gramian::dipole::{self, Accumulator, Pass, Sensors, quadrupole};
use gramian::square_root::SquareRootInformation;

pub fn fields<T: Number>(draw: &mut Draw<T>) {
    let (position, moment) = (draw.array(), draw.array());
    if let Some(field) = draw.taken(dipole::field(&position, &moment)) {
        draw.finite(&field);
    }
    if let Some(jacobian) = draw.taken(dipole::jacobian(&position, &moment)) {
        draw.finite(jacobian.position.as_flattened());
        draw.finite(jacobian.moment.as_flattened());
    }
    draw.again();
    let (permanent, attitude) = (draw.array(), draw.arrays::<3, 3>());
    let (volume, earth) = (draw.x(), draw.array());
    if let Some(moment) = draw.taken(dipole::moment(&permanent, &attitude, volume, &earth)) {
        draw.finite(&moment);
    }
}

/// Motions and names of bodies of several dipoles, in double precision alone.
#[cfg(feature = "std")]
pub fn bodies<T: Number>(draw: &mut Draw<T>) {
    use dipole::description::{Description, Motion};
    let state: [T; 9] = draw.array();
    let ([t], more): ([T; 1], [T; 3]) = (draw.array(), draw.array());
    let (state, more) = (state.map(T::double), more.map(T::double));
    for motion in [
        Motion::Straight,
        Motion::Along,
        Motion::Accelerated,
        Motion::Turning,
    ] {
        assert_eq!(motion.names().0.len(), motion.states());
        // No input is refused: what overflows is told by the rows made of it.
        let step = motion.at(&state, &more[..motion.states()], t.double());
        let _ = (
            step.turn(&[1.0, 2.0, 3.0]),
            step.turn_by_rate(&[1.0, 2.0, 3.0]),
        );
    }
    assert_eq!(Description::source(1)[3].0, "mx of dipole 2");
    let q: [T; 5] = draw.array();
    let [moment, change]: [[T; 3]; 2] = draw.arrays();
    let (q, moment) = (q.map(T::double), moment.map(T::double));
    let step = Motion::Turning.at(&state, &more[..Motion::Turning.states()], t.double());
    let _ = step.turn_tensor(&quadrupole::tensor(&q));
    let centre = [0, 1, 2].map(|_| draw.below(2) == 0);
    let entries = quadrupole::Entries::new(centre, &moment);
    let count = entries.free().len();
    assert_eq!(count, 5 - centre.iter().filter(|c| **c).count());
    // What does not follow is not finite, and is told by the rows made of it.
    let whole = entries.whole(&moment, &q[..count]);
    let _ = whole.along(&change.map(T::double));
}

/// The field of a quadrupole, and its five numbers.
pub fn quadrupoles<T: Number>(draw: &mut Draw<T>) {
    let (position, q): ([T; 3], [T; 5]) = (draw.array(), draw.array());
    if let Some(field) = draw.taken(quadrupole::field(&position, &q)) {
        draw.finite(&field);
    }
    if let Some(jacobian) = draw.taken(quadrupole::jacobian(&position, &q)) {
        draw.finite(jacobian.position.as_flattened());
        draw.finite(jacobian.quadrupole.as_flattened());
    }
    if all_finite(&q) {
        assert_eq!(quadrupole::entries(&quadrupole::tensor(&q)), q);
    }
    let [moment, offset]: [[T; 3]; 2] = draw.arrays();
    let _ = quadrupole::moved(&moment, &offset);
}

/// What sensors of every kind read of a pass, and the rows of it.
pub fn sensors<T: Number>(draw: &mut Draw<T>) {
    let (pass, times): (_, [T; 4]) = (Pass::of(&draw.array()), draw.array());
    let places = draw.arrays::<3, 2>();
    let apart: Vec<[T; 3]> = (0..2 * draw.index(2)).map(|_| draw.array()).collect();
    let ambient = (draw.below(2) == 0).then(|| draw.array());
    let kind = Sensors {
        places: &places,
        baselines: &apart,
        ambient,
    };
    let mut out = vec![T::zero(); 4 * kind.channels()];
    let result = kind.measure(&times, &pass, &mut out);
    if draw.taken(result).is_some() {
        draw.finite(&out);
        assert!(kind.quiet() >= T::zero());
    }
    let sound = draw.sound;
    let sigma = draw.positives::<4>();
    // Infinite: not measured.
    draw.sound = sound && sigma.iter().all(|&s| s > T::zero());
    let mut root = SquareRootInformation::new();
    draw.taken(kind.push_rows(&times, &pass, &sigma, &mut root));
    draw.finite(root.factor().as_flattened());
    draw.sound = sound;
    let body: [T; 5] = draw.array();
    let result = kind.measure_body(&times, &pass, Some(&body), &mut out);
    if draw.taken(result).is_some() {
        draw.finite(&out);
    }
    draw.sound &= sigma.iter().all(|&s| s > T::zero());
    let mut root = SquareRootInformation::new();
    let result = kind.push_rows_with_quadrupole(&times, &pass, &body, &sigma, &mut root);
    draw.taken(result);
    draw.finite(root.factor().as_flattened());
    let heads = kind.heads(0).count();
    assert_eq!(heads, 1 + kind.baselines.len() / 2);
    assert_eq!(kind.channels(), kind.components() * places.len());
    assert_eq!(kind.along().is_some(), ambient.is_some());
    assert_eq!(kind.plain(), heads == 1 && ambient.is_none());
    assert!(Sensors::vector(&places).plain());
}

pub fn passes<T: Number>(draw: &mut Draw<T>) {
    let pass = Pass::of(&draw.array());
    let sound = draw.sound;
    let moving = [pass.position, pass.velocity];
    draw.sound = all_finite(moving.as_flattened());
    let (sensor, time) = (draw.array(), draw.x());
    if let Some(place) = draw.taken(pass.seen_from(&sensor, time)) {
        draw.finite(&place);
    }
    draw.sound = sound;
    let u = draw.x();
    if let Some(scaled) = draw.taken(pass.scaled(u)) {
        draw.finite(&scaled.state());
    }
    draw.sound = sound;
}

pub fn accumulator<T: Number>(draw: &mut Draw<T>) {
    let (mut sums, mut both) = (Accumulator::new(), Accumulator::new());
    for _ in 0..draw.index(5) {
        draw.again();
        let (time, weight, before) = (draw.x(), draw.positive(), sums);
        let (position, moment) = (draw.array(), draw.array());
        let result = sums.push(time, &position, &moment, weight);
        draw.unchanged(&result, &sums, &before);
        draw.taken(result);
        let before = both;
        let result = both.merge(&sums);
        draw.unchanged(&result, &both, &before);
    }
    draw.finite(sums.matrix().as_flattened());
    draw.finite(both.matrix().as_flattened());
}

pub fn tracker<T: Number>(draw: &mut Draw<T>) {
    use dipole::tracker::{Bound, Sample, Tracker, Wander};
    let (time, state, sigma) = (draw.x(), draw.array(), draw.positives());
    let Some(mut tracker) = draw.taken(Tracker::new(time, &state, &sigma)) else {
        return;
    };
    let Some(mut bound) = draw.taken(Bound::new(time, &sigma)) else {
        return;
    };
    for _ in 0..draw.index(4) {
        draw.again();
        let wander = Wander {
            acceleration: draw.positive(),
            moment: draw.positive(),
        };
        let sample = Sample {
            time: draw.positive(),
            sensor: draw.array(),
            field: draw.array(),
            sigma: draw.positive(),
        };
        let before = tracker;
        let result = tracker.push(&sample, &wander).map(drop);
        draw.unchanged(&result, &tracker, &before);
        draw.taken(result);
        let before = tracker;
        let result = tracker.predict(sample.time, &wander);
        draw.unchanged(&result, &tracker, &before);
        let (truth, before) = (draw.array(), bound);
        let result = bound.push(&sample, &truth, &wander);
        draw.unchanged(&result, &bound, &before);
        // What a sample reads does not matter to the bound.
        if all_finite(&sample.field) {
            draw.taken(result);
        }
        let answer = tracker.answer();
        draw.finite(tracker.state());
        draw.finite(&answer.state);
        draw.finite(&[answer.chi2, answer.p_value]);
        draw.bounds(&answer.std);
        draw.bounds(&bound.std());
        draw.finite(tracker.known().root().factor().as_flattened());
        draw.finite(bound.known().root().factor().as_flattened());
    }
    let known = *tracker.known();
    assert!(Tracker::resumed(time, tracker.state(), known).is_ok());
    assert_eq!(Bound::resumed(time, known).known(), &known);
}
