//! Biases of two radars.

use crate::draw::{Draw, Number, all_finite};
use gramian::registration::degree::Running;
use gramian::registration::pair::Plane;
use gramian::registration::{Dimension, Layout, look};

pub fn planes<T: Number>(draw: &mut Draw<T>) {
    let plane = |draw: &mut Draw<T>| {
        draw.again();
        let (a, b) = (draw.array(), draw.array());
        let (sigma_a, sigma_b) = (draw.positives(), draw.positives());
        draw.taken(Plane::new(a, b, &sigma_a, &sigma_b))
    };
    let (Some(one), Some(two)) = (plane(draw), plane(draw)) else {
        return;
    };
    draw.finite(one.projector().as_flattened());
    draw.finite(one.basis().as_flattened());
    draw.finite(&[one.pair_degree(&two)]);
    if let Ok(determinant) = one.determinant(&two) {
        draw.finite(&[determinant]);
    }
}

pub fn running<T: Number>(draw: &mut Draw<T>) {
    let (a, b) = (draw.array(), draw.array());
    let (sigma_a, sigma_b) = (draw.positives(), draw.positives());
    let Some(mut running) = draw.taken(Running::new(a, b, sigma_a, sigma_b)) else {
        return;
    };
    for _ in 0..4 {
        draw.again();
        let (position, before) = (draw.array(), *running.root());
        let result = if draw.below(2) == 0 {
            running.push(position)
        } else {
            running.push_from([draw.array(), draw.array()], position)
        };
        draw.unchanged(&result, running.root(), &before);
        draw.taken(result);
        draw.finite(&[running.eta()]);
        draw.finite(running.root().factor().as_flattened());
        assert!(running.looks() <= 4);
    }
}

pub fn layout<T: Number>(draw: &mut Draw<T>) -> Layout {
    let dimension = [Dimension::Plane, Dimension::Space][draw.index(2)];
    let sensors = 1 + draw.index(3);
    if draw.below(3) == 0 {
        return Layout::simple(dimension, sensors);
    }
    Layout {
        dimension,
        sensors,
        gain: draw.below(2) == 0,
        position: draw.below(2) == 0,
        attitude: draw.below(2) == 0,
    }
}

pub fn looks<T: Number>(draw: &mut Draw<T>) {
    let layout = layout(draw);
    let (d, per) = (layout.size(), layout.per_sensor());
    let (sensor, sigma) = (draw.array::<3>(), draw.positives::<3>());
    let (bias, target) = (draw.array::<10>(), draw.array::<3>());
    // Of these only the first entries are handed in.
    let used = [&sensor[..d], &sigma[..d], &bias[..per], &target[..d]];
    draw.sound = used.iter().all(|part| all_finite(part));
    let found = look::linearise(
        &layout,
        &sensor[..d],
        &sigma[..d],
        &bias[..per],
        &target[..d],
    );
    if let Some(linear) = draw.taken(found) {
        draw.finite(&linear.measured);
        draw.finite(linear.position.as_flattened());
        draw.finite(linear.bias.as_flattened());
    }
    let mut out = vec![T::zero(); d];
    let used = [&sensor[..d], &bias[..per], &target[..d]];
    draw.sound = used.iter().all(|part| all_finite(part));
    let found = look::place(&layout, &sensor[..d], &bias[..per], &target[..d], &mut out);
    if draw.taken(found).is_some() {
        draw.finite(&out);
    }
    draw.again();
    let m = layout.sensors;
    let (sensors, biases) = (draw.numbers(m * d), draw.numbers(layout.states()));
    let sigma: Vec<T> = (0..m * d).map(|_| draw.positive()).collect();
    let sound = draw.sound;
    let used = [&sensors, &sigma];
    draw.sound = used.iter().all(|part| all_finite(part));
    draw.taken(layout.check(&sensors, &sigma));
    draw.sound = sound;
    let target = draw.numbers(d);
    let mut work = vec![T::zero(); look::scratch(&layout)];
    let mut out = vec![T::zero(); layout.rows() * layout.states()];
    let found = look::rows(
        &layout, &sensors, &sigma, &biases, &target, &mut work, &mut out,
    );
    if draw.taken(found).is_some() {
        draw.finite(&out);
    }
}
