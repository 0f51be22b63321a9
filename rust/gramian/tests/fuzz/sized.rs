//! What takes its sizes at run time, and so needs `alloc`.

use crate::draw::{Draw, Number, all_finite};
use crate::registration::layout;
use gramian::chi_square::Goodness;
use gramian::inertial::{Unknown, Visual};
use gramian::linear::analysis::Analysis;
use gramian::linear::piecewise::Piecewise;
use gramian::linear::window::{self, Window};
use gramian::numbers::words;
use gramian::observability::{self, Observability};
use gramian::registration::estimate::{Estimator, Method, Question};
use gramian::registration::report;
use gramian::spine::verdict::{Findings, Status, judge, of_estimate, references};

fn rtol<T: Number>(draw: &mut Draw<T>) -> Option<T> {
    (draw.below(2) == 0).then(|| draw.positive())
}

pub fn observability<T: Number>(draw: &mut Draw<T>) {
    let (n, count) = (draw.index(5), draw.index(7));
    let stray = usize::from(draw.below(16) == 0);
    let rows = draw.numbers(n * count + stray);
    let rtol = rtol(draw);
    let sound = draw.sound;
    if let Some((values, vectors)) = {
        draw.sound = all_finite(&rows);
        draw.taken(observability::singular_values(&rows, n))
    } {
        draw.finite(&values);
        draw.finite(&vectors);
    }
    draw.sound = sound;
    let eliminated = draw.index(n + 2);
    let marginal = observability::marginal_rows(&rows, n, eliminated, rtol);
    for row in draw.taken(marginal).into_iter().flatten() {
        draw.finite(&row);
    }
    let Some(found) = draw.taken(Observability::new(&rows, n, rtol)) else {
        return;
    };
    assert!(found.rank() <= found.states());
    draw.finite(found.singular_values());
    draw.finite(found.scale());
    draw.bounds(&found.crlb_std());
    draw.finite(&found.crlb().unwrap_or_default());
    draw.finite(&found.crlb_root().unwrap_or_default());
    draw.ordered(&[found.log_det(), found.rtol(), found.condition()]);
    for vector in found.null_space().into_iter().flatten() {
        draw.finite(&vector);
    }
    draw.finite(&found.weakest_direction().unwrap_or_default());
    draw.again();
    let (combination, sigma) = (draw.numbers(n), draw.positive());
    if let Some((rank, std)) = draw.taken(found.knowing(&combination, sigma)) {
        assert!(rank <= n);
        draw.bounds(&std);
    }
    if let Ok((rank, std)) = found.knowing(&combination, T::zero()) {
        assert!(rank <= n);
        draw.bounds(&std);
    }
    draw.sound = all_finite(&combination);
    if let Some(std) = draw.taken(found.combination_std(&combination)) {
        draw.bounds(&[std]);
    }
    assert!(found.undecided().is_empty());
    let errors: Vec<T> = rows.iter().map(|x| x.abs() * T::of(1e-6)).collect();
    if let Ok(found) = Observability::inexact(&rows, &errors, &[], n, rtol) {
        assert!(found.undecided().iter().all(|&i| i < n));
        draw.bounds(&found.crlb_std());
    }
}

/// A camera beside a navigator, in doubles alone: nothing panics, and what moderate numbers
/// give is finite.
pub fn visual_inertial<T: Number>(draw: &mut Draw<T>) {
    let (count, marks) = (draw.index(4), draw.index(3));
    let times = draw.times(count).into_iter().map(T::double).collect();
    let vector = |draw: &mut Draw<T>| draw.array::<3>().map(T::double);
    let gyro = (0..count).map(|_| vector(draw)).collect();
    let accel = (0..count).map(|_| vector(draw)).collect();
    let all = [
        Unknown::CameraRotation,
        Unknown::CameraArm,
        Unknown::Gravity,
        Unknown::GravityStrength,
        Unknown::Scale,
        Unknown::Landmarks,
    ];
    let model = Visual {
        times,
        gyro,
        accel,
        camera: [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
        arm: vector(draw),
        gravity: vector(draw),
        landmarks: (0..marks).map(|_| vector(draw)).collect(),
        unknown: all.into_iter().filter(|_| draw.below(2) == 0).collect(),
    };
    if draw.taken(model.check()).is_none() {
        return;
    }
    let (place, velocity) = (vector(draw), vector(draw));
    let q = [1.0, 0.0, 0.0, 0.0];
    let Some(x) = draw.taken(model.start(place, q, velocity)) else {
        return;
    };
    let (n, p) = (model.states(), model.outputs());
    assert_eq!(x.len(), n);
    let moderate = |values: &[f64]| values.iter().all(|v| v.abs() < 1e50);
    let whole = moderate(&x)
        && moderate(model.gyro.as_flattened())
        && moderate(model.accel.as_flattened())
        && moderate(model.landmarks.as_flattened())
        && moderate(&model.arm)
        && moderate(&model.gravity);
    let sound = |values: &[f64]| !whole || values.iter().all(|v| v.is_finite());
    let (mut rate, mut by_state) = (vec![0.0; n], vec![0.0; n * n]);
    model.rate(model.times[0], &x, &mut rate);
    model.rate_jacobian(model.times[0], &x, &mut by_state);
    assert_eq!(rate[..3], velocity);
    assert!(sound(&rate) && sound(&by_state));
    let (mut image, mut lines) = (vec![0.0; p], vec![0.0; p * n]);
    if model.output(model.times[0], &x, &mut image).is_ok() {
        // In front of the camera: far off the axis perhaps, but somewhere.
        assert!(!whole || image.iter().all(|v| !v.is_nan()));
        model.output_jacobian(&x, &mut lines);
        let near = image.iter().all(|v| v.abs() < 1e3);
        assert!(!(whole && near) || lines.iter().any(|v| *v != 0.0));
    }
}

/// Verdicts of any findings, and their words: these are of doubles alone.
pub fn verdicts<T: Number>(draw: &mut Draw<T>) {
    let n = 1 + draw.index(4);
    let mut of =
        |count: usize| -> Vec<f64> { draw.numbers(count).into_iter().map(T::double).collect() };
    let (data_std, scale, prior) = (of(n), of(n), of(n));
    let (hardness, other) = (of(n), of(3));
    let open: Vec<bool> = (0..n).map(|_| draw.below(2) == 0).collect();
    let found = judge(&Findings {
        rank: draw.index(n + 1),
        open: &open,
        data_std: &data_std,
        scale: &scale,
        prior: &prior,
        condition: other[0],
        hardness: &hardness,
        weak_ratio: other[1],
        weak_condition: other[2],
    });
    assert!(!found.status.name().is_empty());
    assert!(found.decided_by.iter().all(|&state| state < n));
    let words = found.reason.words(|_| "x", |_| "m");
    assert!(!words.is_empty());
    let fit = Goodness::new(data_std[0], scale[0]);
    let wrong = fit.misfit(other[0]);
    assert_eq!(wrong.is_some(), fit.is_misfit(other[0]));
    let (status, reason) = of_estimate(found.status, words.clone(), fit, other[0]);
    let ranked = found.status == Status::Unobservable || wrong.is_none();
    assert_eq!(
        status,
        if ranked {
            found.status.name()
        } else {
            "misfit"
        }
    );
    assert!(!reason.is_empty());
    let digits = 1 + draw.index(17);
    for &x in &data_std {
        let text = words::brief(x, digits);
        let read: f64 = text.parse().unwrap();
        let close = (read - x).abs() <= 0.51 * x.abs() || (read.is_nan() && x.is_nan());
        // The largest numbers round to what is no number any more.
        let beyond = x.is_finite() && x.abs() > 1e308 && read.abs() == f64::INFINITY;
        assert!(
            close || beyond || read == x,
            "{x:e} in {digits} digits: {text}"
        );
    }
    let compared = references(&hardness, &scale);
    assert_eq!(compared.len(), n);
    assert!(
        scale
            .iter()
            .zip(&compared)
            .all(|(s, c)| s.is_nan() || s == c)
    );
    let names = ["a", "b", "c", "d"];
    assert_eq!(
        words::moves(&data_std, &names).is_empty(),
        data_std.iter().all(|&x| x == 0.0)
    );
}

fn system<T: Number>(draw: &mut Draw<T>, n: usize, count: usize) -> Vec<T> {
    let mut a = draw.numbers(count * n * n);
    for x in &mut a {
        if draw.below(2) == 0 && x.is_finite() {
            *x = T::zero();
        }
    }
    a
}

pub fn analysis<T: Number>(draw: &mut Draw<T>) {
    let n = draw.index(5);
    let outputs = draw.index(3);
    let (a, c) = (system(draw, n, 1), draw.numbers(outputs * n));
    let rtol = rtol(draw);
    let Some(found) = draw.taken(Analysis::new(&a, &c, n, rtol)) else {
        return;
    };
    assert!(found.rank() <= n);
    // What may be zero was counted as zero.
    assert!(!found.undecided() || found.rank() < n);
    assert!(found.ranks().is_none_or(|ranks| ranks.len() == n));
    assert!(found.state_levels().is_none_or(|levels| levels.len() == n));
    draw.finite(found.scale());
    draw.finite(found.row_space());
    draw.finite(found.kernel());
    draw.finite(&[found.found().weakest, found.found().rejected, found.rtol()]);
    for vector in found.null_space().into_iter().flatten() {
        draw.finite(&vector);
    }
    for vector in found.combinations().into_iter().flatten().flatten() {
        draw.finite(&vector);
    }
    draw.again();
    let combination = draw.numbers(n);
    if let Some(residuals) = draw.taken(found.residuals(&combination)) {
        draw.finite(&residuals);
    }
    let tolerance = draw.x();
    draw.taken(found.level_of(&combination, Some(tolerance)));
}

pub fn piecewise<T: Number>(draw: &mut Draw<T>) {
    let (n, segments) = (draw.index(4), draw.index(4));
    let (a, c) = (system(draw, n, segments), draw.numbers(segments * n));
    let durations = draw.numbers(segments);
    let found = Piecewise::new(&a, &c, &durations, n, None);
    if let Some(found) = draw.taken(found) {
        assert!(found.total.iter().all(|&rank| rank <= n));
        for vector in found.null_space {
            draw.finite(&vector);
        }
    }
}

pub fn windows<T: Number>(draw: &mut Draw<T>) {
    let n = draw.index(4);
    let (a, c) = (system(draw, n, 1), draw.numbers(n * 2));
    let q = (draw.below(2) == 0).then(|| draw.numbers(n * n));
    let sound = draw.sound;
    let duration = draw.positive();
    let finite = |draw: &Draw<T>, window: &Window<T>| {
        draw.finite(window.transition());
        draw.finite(window.noise());
        draw.finite(window.gramian());
    };
    let window = Window::continuous(&a, &c, q.as_deref(), n, duration);
    if let Some(window) = draw.taken(window) {
        finite(draw, &window);
    }
    draw.sound = sound;
    if let Some(one) = draw.taken(Window::sample(&a, &c, q.as_deref(), n)) {
        finite(draw, &one);
        if let Ok(two) = one.then(&one) {
            finite(draw, &two);
        }
        if let Ok(Some(many)) = one.repeated(draw.index(1 << 40)) {
            finite(draw, &many);
        }
    }
    draw.sound = all_finite(&a);
    let duration = draw.x();
    if let Some(e) = draw.taken(window::transition(&a, n, duration)) {
        draw.finite(&e);
    }
}

/// This number, or now and then another.
fn some<T: Number>(draw: &mut Draw<T>, usual: f64) -> T {
    if draw.below(4) == 0 {
        draw.positive()
    } else {
        T::of(usual)
    }
}

pub fn estimates<T: Number>(draw: &mut Draw<T>) {
    let (layout, looks) = (layout(draw), 1 + draw.index(3));
    let (d, m, n) = (layout.size(), layout.sensors, layout.states());
    // Of platforms that move there are places for each look.
    let places = [1, looks][draw.index(2)];
    let (sensors, positions) = (draw.numbers(places * m * d), draw.numbers(looks * d));
    let biases = draw.numbers(n);
    let mut reports = vec![T::zero(); looks * m * d];
    let made = report(&layout, &sensors, &biases, &positions, &mut reports);
    if draw.taken(made).is_some() {
        draw.finite(&reports);
    }
    draw.sound = all_finite(&sensors);
    if draw.below(2) == 0 {
        reports = draw.numbers(looks * m * d);
    } else if !all_finite(&reports) {
        return;
    }
    let sigma: Vec<T> = (0..m * d).map(|_| draw.positive()).collect();
    let prior: Option<Vec<T>> =
        (draw.below(2) == 0).then(|| (0..n).map(|_| draw.or_infinite()).collect());
    let methods = [
        Method::LeastSquares,
        Method::Generalised,
        Method::MaximumLikelihood,
    ];
    let question = Question {
        layout,
        sensors: &sensors,
        sigma: &sigma,
        prior: prior.as_deref(),
        method: methods[draw.index(3)],
        iterations: draw.index(6),
        tolerance: some(draw, 1e-3),
        noise_share: some(draw, 0.5),
        bend: some(draw, 0.05),
    };
    let Ok(mut estimator) = Estimator::new(layout, looks) else {
        return;
    };
    if let Some(answer) = draw.taken(estimator.run(&question, &reports)) {
        draw.finite(&[answer.chi_square, answer.noise_share, answer.bend]);
        draw.finite(estimator.biases());
        draw.finite(estimator.positions());
        draw.finite(estimator.covariance());
        draw.finite(estimator.directions());
    }
}
