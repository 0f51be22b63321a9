//! The parts together, on ranges to beacons, whose second solution is known.
#![allow(clippy::unwrap_used)]

use alloc::format;
use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec;
use alloc::vec::Vec;
use core::ops::Range;

use super::other_solutions::{Search, chance, other_solutions};
use super::starts::Spread;
use super::{
    Combination, Distance, Function, Held, Model, Options, WithPrior, fit, minimize, region, trials,
};

/// Ranges to beacons in the plane.
#[derive(Clone)]
struct Beacons {
    places: Vec<[f64; 2]>,
    ranges: Vec<f64>,
    sigma: f64,
}

impl Beacons {
    fn exact(places: &[[f64; 2]], at: [f64; 2], sigma: f64) -> Self {
        Self {
            places: places.to_vec(),
            ranges: places
                .iter()
                .map(|b| (at[0] - b[0]).hypot(at[1] - b[1]))
                .collect(),
            sigma,
        }
    }
}

impl Model for Beacons {
    type Error = ();

    fn states(&self) -> usize {
        2
    }

    fn measurements(&self) -> usize {
        self.places.len()
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        mut rows: Option<&mut [f64]>,
    ) -> Result<(), ()> {
        for (i, place) in self.places.iter().enumerate() {
            let offset = [x[0] - place[0], x[1] - place[1]];
            let range = offset[0].hypot(offset[1]);
            if range == 0.0 {
                return Err(());
            }
            residuals[i] = (self.ranges[i] - range) / self.sigma;
            if let Some(rows) = rows.as_deref_mut() {
                rows[2 * i] = offset[0] / range / self.sigma;
                rows[2 * i + 1] = offset[1] / range / self.sigma;
            }
        }
        Ok(())
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), ()> {
        for (out, place) in out.iter_mut().zip(&self.places) {
            let range = |x: &[f64]| (x[0] - place[0]).hypot(x[1] - place[1]);
            *out = (range(b) - range(a)) / self.sigma;
        }
        Ok(())
    }
}

const NEARLY_IN_LINE: [[f64; 2]; 3] = [[0.0, 0.0], [50.0, 1.0], [100.0, 0.0]];

#[test]
fn the_second_solution_of_three_beacons() {
    let model = Beacons::exact(&NEARLY_IN_LINE, [40.0, 30.0], 0.5);
    let best = minimize(&model, &[45.0, 25.0], &[], Options::default());
    assert!(best.converged && best.determined);
    for spread in [
        None,
        Some(Spread::Box {
            low: vec![-200.0, -200.0],
            high: vec![200.0, 200.0],
        }),
    ] {
        let search = Search {
            from: Vec::new(),
            weakest: true,
            spread,
            starts: 64,
            seed: 1,
            options: Options::default(),
        };
        let found = other_solutions(&model, &best, &search);
        assert_eq!(found.others.len(), 1);
        let other = &found.others[0];
        assert!((other.solution.x[0] - 40.212_630_780_135_51).abs() < 1e-6);
        assert!((other.solution.x[1] + 28.778_536_031_738_817).abs() < 1e-6);
        assert!((other.solution.chi2 - 5.132_871_756_605_476).abs() < 1e-6);
        assert!((chance(other.distance) - other.chance).abs() < 1e-15);
        assert!((other.chance - 0.128_650_785_139_881_43).abs() < 1e-6);
    }
}

/// c / x, as what is seen along a range: the plain step from x goes past 0 beyond 2 c.
struct Inverse;

impl Model for Inverse {
    type Error = ();

    fn states(&self) -> usize {
        1
    }

    fn measurements(&self) -> usize {
        2
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), ()> {
        for (r, c) in residuals.iter_mut().zip([100.0, 50.0]) {
            *r = c - c / x[0];
        }
        if let Some(rows) = rows {
            rows.copy_from_slice(&[-100.0 / (x[0] * x[0]), -50.0 / (x[0] * x[0])]);
        }
        Ok(())
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), ()> {
        for (out, c) in out.iter_mut().zip([100.0, 50.0]) {
            *out = c / b[0] - c / a[0];
        }
        Ok(())
    }
}

#[test]
fn a_step_from_afar_follows_the_curvature() {
    // 4 and 8 are beyond 2, from where a plain step changes the sign.
    for start in [0.2, 0.8, 1.5, 4.0, 8.0] {
        let reached = |damping: f64| {
            let options = Options {
                damping,
                curved: damping > 0.0,
                ..Options::default()
            };
            minimize(&Inverse, &[start], &[], options)
        };
        let (found, plain) = (reached(1e-5), reached(0.0));
        assert!(found.converged, "{start}: {found:?}");
        assert!((found.x[0] - 1.0).abs() < 1e-9, "{start}: {found:?}");
        assert!(
            found.iterations < plain.iterations,
            "{start}: {found:?}, {plain:?}"
        );
    }
}

#[test]
fn a_held_function_stays_and_its_slope_is_that_of_the_profile() {
    let model = Beacons::exact(&NEARLY_IN_LINE, [40.0, 30.0], 0.5);
    let range = Distance {
        states: vec![0, 1],
        from: vec![10.0, -5.0],
    };
    let at = |value: f64| {
        minimize(
            &model,
            &[40.0, 30.0],
            &[(&range, value)],
            Options::default(),
        )
    };
    let (low, middle, high) = (at(46.99), at(47.0), at(47.01));
    assert!(low.converged && middle.converged && high.converged);
    assert!((range.value(&middle.x, &mut [0.0; 2]) - 47.0).abs() < 1e-9);
    let slope = (high.chi2 - low.chi2) / 0.02;
    assert!((slope / middle.slopes[0] - 1.0).abs() < 1e-4);
}

#[test]
fn the_interval_ends_where_chi2_has_risen() {
    let mut model = Beacons::exact(&NEARLY_IN_LINE, [40.0, 30.0], 0.5);
    model.ranges[0] += 0.3;
    model.ranges[1] -= 0.4;
    let best = minimize(&model, &[40.0, 30.0], &[], Options::default());
    let north = Combination(vec![0.0, 1.0]);
    let found = region::interval(
        &model,
        &best,
        &[],
        &north,
        3.841_458_820_694_124,
        Options::default(),
    );
    assert_eq!(found.pieces.len(), 1);
    for end in [found.pieces[0].low.unwrap(), found.pieces[0].high.unwrap()] {
        // By brute force over the other state.
        let least = (0..20_001)
            .map(|i| {
                let mut residuals = [0.0; 3];
                let x = [38.0 + 2e-4 * f64::from(i), end];
                model.linearize(&x, &mut residuals, None).unwrap();
                residuals.iter().map(|r| r * r).sum::<f64>()
            })
            .fold(f64::INFINITY, f64::min);
        assert!(
            (least - best.chi2 - 3.841_458_820_694_124).abs() < 1e-5,
            "{least}"
        );
    }
}

#[test]
fn a_contour_closes_and_lies_on_the_limit() {
    let model = Beacons::exact(&[[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]], [40.0, 30.0], 0.5);
    let best = minimize(&model, &[45.0, 25.0], &[], Options::default());
    let (east, north) = (Combination(vec![1.0, 0.0]), Combination(vec![0.0, 1.0]));
    let found = region::contours(
        &model,
        &best,
        &[],
        [&east, &north],
        5.991,
        region::Fineness::default(),
        Options::default(),
    );
    assert_eq!(found.len(), 1);
    assert!(found[0].closed);
    for point in &found[0].points {
        let mut residuals = [0.0; 3];
        model.linearize(point, &mut residuals, None).unwrap();
        let chi2: f64 = residuals.iter().map(|r| r * r).sum();
        assert!((chi2 - 5.991).abs() < 1e-5);
    }
}

#[test]
fn a_rough_contour_is_that_of_the_numbers_with_fewer_points() {
    let model = Beacons::exact(&[[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]], [40.0, 30.0], 9.0);
    let best = minimize(&model, &[45.0, 25.0], &[], Options::default());
    let (east, north) = (Combination(vec![1.0, 0.0]), Combination(vec![0.0, 1.0]));
    let follow = |fineness| {
        let pair: [&dyn Function; 2] = [&east, &north];
        let options = Options::default();
        region::contours(&model, &best, &[], pair, 5.991, fineness, options).remove(0)
    };
    let (fine, rough) = (
        follow(region::Fineness::default()),
        follow(region::Fineness::ROUGH),
    );
    assert!(fine.closed && rough.closed);
    assert!(3 * rough.points.len() < 2 * fine.points.len() + 6);
    for point in &rough.points {
        let mut residuals = [0.0; 3];
        model.linearize(point, &mut residuals, None).unwrap();
        let chi2: f64 = residuals.iter().map(|r| r * r).sum();
        // A thousandth of the width.
        assert!((chi2 - 5.991).abs() < 2e-3 * 5.991, "{chi2}");
    }
}

#[test]
fn a_score_is_the_gain_of_the_fit_with_the_alternative() {
    // Linear: a straight line through noise, and a parabola as alternative.
    struct Line(Vec<f64>);
    impl Model for Line {
        type Error = ();
        fn states(&self) -> usize {
            2
        }
        fn measurements(&self) -> usize {
            self.0.len()
        }
        fn linearize(&self, x: &[f64], r: &mut [f64], rows: Option<&mut [f64]>) -> Result<(), ()> {
            for (i, (r, z)) in r.iter_mut().zip(&self.0).enumerate() {
                *r = z - x[0] - x[1] * i as f64;
            }
            if let Some(rows) = rows {
                for (i, row) in rows.chunks_exact_mut(2).enumerate() {
                    row.copy_from_slice(&[1.0, i as f64]);
                }
            }
            Ok(())
        }
        fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), ()> {
            for (i, out) in out.iter_mut().enumerate() {
                *out = b[0] - a[0] + (b[1] - a[1]) * i as f64;
            }
            Ok(())
        }
    }
    /// The first number was not measured: its weight is zero.
    struct WithoutFirst<'a>(&'a Line);
    impl Model for WithoutFirst<'_> {
        type Error = ();

        crate::forward_model!(this => this.0; states, measurements, difference);

        fn linearize(
            &self,
            x: &[f64],
            residuals: &mut [f64],
            mut rows: Option<&mut [f64]>,
        ) -> Result<(), ()> {
            self.0.linearize(x, residuals, rows.as_deref_mut())?;
            residuals[0] = 0.0;
            if let Some(rows) = rows {
                rows[..2].fill(0.0);
            }
            Ok(())
        }
    }
    let line = Line(
        (0..20)
            .map(|i| (1.7 * f64::from(i)).sin() + 0.02 * f64::from(i * i))
            .collect(),
    );
    let found = minimize(&line, &[0.0, 0.0], &[], Options::default());
    let fit = fit::Fit::new(&line, &found.x).unwrap();
    assert_eq!(fit.dof(), 18);
    let some = fit::Fit::new(&WithoutFirst(&line), &found.x).unwrap();
    assert_eq!(some.dof(), 17);
    let parabola: Vec<f64> = (0..20).map(|i| f64::from(i * i)).collect();
    let trace = fit::noncentrality(0.001, 0.8);
    assert!((trace - 17.07).abs() < 0.01);
    let score = fit.score(&parabola, 1, 0.001, 0.8);
    // Of several parameters: the noncentral chi-square distribution of scipy 1.
    assert!((fit::noncentrality_of(0.001, 0.8, 2) - 19.6624).abs() < 0.02);
    assert!((fit::noncentrality_of(0.001, 0.8, 3) - 21.5450).abs() < 0.02);
    // The worst of a pair that holds the parabola twice as large is no less.
    let pair: Vec<f64> = (0..20)
        .flat_map(|i| [f64::from(i * i), f64::from(i * i * i)])
        .collect();
    let both = fit.score(&pair, 2, 0.001, 0.8);
    assert!(both.effect[1] >= score.effect[1].abs());
    // Half of both is as good a pair; turned, it spans the same traces of unit parameters.
    let (cos, sin) = (0.6, 0.8);
    let same = |factor: f64, turn: bool| {
        let columns: Vec<f64> = pair
            .chunks_exact(2)
            .flat_map(|row| {
                let [a, b] = [factor * row[0], factor * row[1]];
                if turn {
                    [cos * a - sin * b, sin * a + cos * b]
                } else {
                    [a, b]
                }
            })
            .collect();
        fit.score(&columns, 2, 0.001, 0.8).p_value
    };
    assert!((same(0.5, false) / both.p_value - 1.0).abs() < 1e-7);
    assert!((same(1.0, true) / both.p_value - 1.0).abs() < 1e-7);
    // With the parabola's share taken out of the data the rest fits better by the score.
    let size = score.size[0];
    let without = Line((0..20).map(|i| line.0[i] - size * parabola[i]).collect());
    let again = minimize(&without, &[0.0, 0.0], &[], Options::default());
    assert!((found.chi2 - again.chi2 - score.statistic).abs() < 1e-9);
    // What a parabola of the detectable size does to a fit.
    let spoiled = Line(
        (0..20)
            .map(|i| line.0[i] + score.detectable * parabola[i])
            .collect(),
    );
    let moved = minimize(&spoiled, &[0.0, 0.0], &[], Options::default());
    for k in 0..2 {
        assert!((moved.x[k] - found.x[k] - score.effect[k]).abs() < 1e-8);
    }
    // The columns of the model leave no trace.
    let slope: Vec<f64> = (0..20).map(f64::from).collect();
    assert_eq!(fit.score(&slope, 1, 0.001, 0.8).detectable, f64::INFINITY);
}

/// Rows and residuals as they are, of a linear model in a number of channels.
struct Fixed {
    rows: Vec<f64>,
    residuals: Vec<f64>,
    states: usize,
    channels: usize,
}

impl Model for Fixed {
    type Error = ();
    fn states(&self) -> usize {
        self.states
    }
    fn measurements(&self) -> usize {
        self.residuals.len()
    }
    fn channels(&self) -> usize {
        self.channels
    }
    fn linearize(&self, _: &[f64], r: &mut [f64], rows: Option<&mut [f64]>) -> Result<(), ()> {
        r.copy_from_slice(&self.residuals);
        if let Some(rows) = rows {
            rows.copy_from_slice(&self.rows);
        }
        Ok(())
    }
    fn difference(&self, _: &[f64], _: &[f64], _: &mut [f64]) -> Result<(), ()> {
        Ok(())
    }
}

/// What the residuals alone rule out, the test in full does not find, whatever the model.
#[test]
fn no_correlation_is_ruled_out_that_the_test_finds() {
    let mut stream = crate::batch::Stream::new(17, 0);
    let (mut found, mut spared) = (0, 0);
    for case in 0..3000 {
        let (m, states, channels) = (8 + case % 53, 1 + case % 6, 1 + case % 3);
        let rho = [0.0, 0.3, 0.6, 0.9][case % 4];
        // Slow columns, as those of motions are, or rough ones.
        let slow = case % 5 > 0;
        let mut residuals: Vec<f64> = (0..m).map(|_| stream.normal()).collect();
        for i in channels..m {
            residuals[i] += rho * residuals[i - channels];
        }
        let mut rows: Vec<f64> = (0..m * states).map(|_| stream.normal()).collect();
        if slow {
            for (i, row) in rows.chunks_exact_mut(states).enumerate() {
                for (k, x) in row.iter_mut().enumerate() {
                    *x = (i as f64 * k as f64 * 0.7 / m as f64).cos();
                }
            }
        }
        let model = Fixed {
            rows,
            residuals,
            states,
            channels,
        };
        let identity = vec![1.0; states * states];
        let prior = vec![0.5; states];
        let known = WithPrior::new(&model, &identity, &prior, &prior);
        let x = vec![0.0; states];
        for level in [1e-2, 1e-4, 1e-8] {
            let test = fit::Lag1Test::new(level);
            for (priors, p_value) in [
                (0, fit::Fit::new(&model, &x).unwrap().lag1().p_value),
                (
                    known.priors(),
                    fit::Fit::new(&known, &x).unwrap().lag1().p_value,
                ),
            ] {
                let open = test.leaves_open(&model.residuals, states, priors, channels);
                assert!(open || !(p_value < level), "{case} {level}: {p_value}");
                found += usize::from(p_value < level);
                spared += usize::from(!open);
            }
        }
    }
    // And most are ruled out.
    assert!(found > 500 && spared > 5000, "{found} {spared}");
    assert!(!fit::Lag1Test::new(0.0).is_made());
}

#[test]
fn a_prior_is_one_more_measurement() {
    let model = Beacons::exact(&[[0.0, 0.0]], [40.0, 30.0], 1.0);
    let mean = [41.0, 0.0];
    let known = WithPrior::new(&model, &[1.0, 0.0, 0.0, 1.0], &mean, &[0.1, f64::INFINITY]);
    let found = minimize(&known, &[41.0, 20.0], &[], Options::default());
    assert!(found.converged);
    assert!((found.x[0] - 41.0).abs() < 1e-7);
    assert!((found.x[0].hypot(found.x[1]) - 50.0).abs() < 1e-7);
    // Without it one range does not tell a place.
    assert!(!minimize(&model, &[41.0, 20.0], &[], Options::default()).determined);
}

/// A model of which nothing is as the trait has it by default.
struct Particular;

impl Model for Particular {
    type Error = ();
    fn states(&self) -> usize {
        2
    }
    fn measurements(&self) -> usize {
        3
    }
    fn priors(&self) -> usize {
        1
    }
    fn exact(&self) -> Range<usize> {
        1..2
    }
    fn channels(&self) -> usize {
        2
    }
    fn linearize(&self, x: &[f64], r: &mut [f64], rows: Option<&mut [f64]>) -> Result<(), ()> {
        r.copy_from_slice(&[x[0], x[1], x[0] + x[1]]);
        if let Some(rows) = rows {
            rows.copy_from_slice(&[1.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        }
        Ok(())
    }
    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), ()> {
        out.fill(b[0] - a[1]);
        Ok(())
    }
    fn change(&self, _: &[f64], _: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[7.0, 8.0]);
    }
    fn retract(&self, x: &mut [f64]) {
        x.copy_from_slice(&[3.0, 4.0]);
    }
    fn rounding(&self, _: &[f64], noise: &mut [f64]) -> bool {
        noise.copy_from_slice(&[0.1, 0.2]);
        true
    }
    fn symmetries(&self, x: &[f64], found: &mut dyn FnMut(&[f64])) {
        found(&[x[1], x[0]]);
    }
}

/// All that a model says but its measurements.
fn said<M: Model>(model: &M) -> String {
    let (mut change, mut place, mut noise) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    model.change(&[0.0; 2], &[1.0; 2], &mut change);
    model.retract(&mut place);
    let rounded = model.rounding(&place, &mut noise);
    let mut images = Vec::new();
    model.symmetries(&[1.0, 2.0], &mut |image| images.push(image.to_vec()));
    let (states, measurements) = (model.states(), model.measurements());
    let (priors, exact, channels) = (model.priors(), model.exact(), model.channels());
    format!(
        "{states} {measurements} {priors} {exact:?} {channels} {change:?} {place:?} {rounded} \
         {noise:?} {images:?}"
    )
}

#[test]
fn a_wrapper_says_what_the_model_inside_says() {
    let wanted = said(&Particular);
    let noisy = trials::Noisy {
        model: &Particular,
        noise: vec![0.0; 3],
    };
    assert_eq!(said(&noisy), wanted);
    assert_eq!(said(&&Particular), wanted);
    assert_eq!(said(&Arc::new(Particular)), wanted);
    assert_eq!(said(&Held::new(Particular, &[None, None])), wanted);
    assert_eq!(said(&WithPrior::new(Particular, &[], &[], &[])), wanted);
}

/// sin x, which is at most one.
struct Sine;

impl Function for Sine {
    fn value(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        gradient[0] = x[0].cos();
        x[0].sin()
    }
}

#[test]
fn a_state_with_a_value_is_found_along_the_function_where_there_is_one() {
    let east = Combination(vec![1.0, 0.0]);
    assert_eq!(
        region::reached(&east, 0.0, &[5.0, 1.0]),
        Some(vec![0.0, 1.0])
    );
    let found = region::reached(&Sine, 0.5, &[0.1]).unwrap();
    assert!((found[0].sin() - 0.5).abs() < 1e-9);
    assert_eq!(region::reached(&Sine, 1.5, &[0.1]), None);
    // No direction leads anywhere.
    assert_eq!(region::reached(&Combination(vec![0.0]), 1.0, &[2.0]), None);
}
