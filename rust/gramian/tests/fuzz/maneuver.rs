//! The observer's maneuver.

use crate::draw::{Draw, Number};
use crate::spine::information_of;
use gramian::maneuver::plan::{self, Criterion, Legs, Target};
use gramian::maneuver::steer::{self, Limits};
use gramian::maneuver::{self, AtStandoff, Law, Side, Steering};

pub fn law<T: Number>(draw: &mut Draw<T>) -> (Law, Side) {
    let laws = [
        Law::MaxDet,
        Law::HammelLiu,
        Law::BearingRate,
        Law::Circle,
        Law::Perpendicular,
    ];
    let sides = [Side::Right, Side::Left];
    (laws[draw.index(5)], sides[draw.index(2)])
}

pub fn laws<T: Number>(draw: &mut Draw<T>) {
    let (law, side) = law(draw);
    let (range, step) = (draw.positive(), draw.positive());
    if let Some((cos, sin)) = draw.taken(law.turn(range, step)) {
        draw.finite(&[cos, sin, side.sign()]);
    }
    let bearing = draw.x();
    if let Some(heading) = draw.taken(maneuver::heading(bearing, range, step, law, side)) {
        assert!(
            heading > -T::pi() && heading <= T::pi(),
            "{}: {heading}",
            draw.place()
        );
    }
    draw.again();
    let steering = Steering {
        law,
        side,
        step: draw.positive(),
        standoff: draw.positive(),
        at_standoff: [AtStandoff::Stop, AtStandoff::Circle][draw.index(2)],
    };
    let (position, target) = (draw.array(), draw.array());
    if let Some(Some(leg)) = draw.taken(steering.leg(position, target)) {
        draw.finite(&leg.direction);
        draw.finite(&leg.end);
    }
    draw.again();
    let (east, north, sigma) = (draw.x(), draw.x(), draw.positive());
    if let Some(row) = draw.taken(maneuver::row(east, north, sigma)) {
        draw.finite(&row);
    }
}

pub fn best_heading<T: Number>(draw: &mut Draw<T>) {
    let information = information_of::<T, 2>(draw);
    let (position, target) = (draw.array(), draw.array());
    let (step, sigma, standoff) = (draw.positive(), draw.positive(), draw.positive());
    let headings = draw.array::<4>();
    let choice = maneuver::best_heading(
        &information,
        position,
        target,
        step,
        sigma,
        standoff,
        &headings,
    );
    // Where every leg ends inside the stand-off range no sigma is looked at.
    if let Ok(Some(choice)) = choice {
        draw.taken::<_, ()>(Ok(()));
        draw.finite(&[choice.heading]);
        draw.bounds(&[choice.determinant]);
    }
}

pub fn steering<T: Number>(draw: &mut Draw<T>) {
    let (targets, keep_out) = (draw.arrays::<4, 2>(), draw.arrays::<3, 2>());
    let limits = Limits {
        standoff: draw.positive(),
        targets: &targets,
        keep_out: &keep_out,
        max_turn: draw.or_infinite(),
    };
    let (at, time) = (draw.array(), draw.x());
    if let Some(Some(heading)) = draw.taken(steer::escape(at, time, &limits)) {
        draw.finite(&[heading]);
    }
    let (length, wanted) = (draw.positive(), draw.x());
    let before = if draw.below(2) == 0 {
        Some(draw.x())
    } else {
        None
    };
    let found = steer::steer(at, time, length, wanted, before, &limits);
    if let Some(Some(heading)) = draw.taken(found) {
        draw.finite(&[heading]);
    }
}

pub fn plan_of<T: Number, const N: usize>(draw: &mut Draw<T>) {
    let prior = information_of::<T, N>(draw);
    let (headings, lengths) = (draw.array::<3>(), draw.array::<3>());
    let counts = [draw.index(3), draw.index(3), draw.index(3)];
    let legs = Legs {
        start: draw.array(),
        dt: draw.x(),
        headings: &headings,
        lengths: &lengths,
        counts: &counts,
    };
    let target = Target {
        state: draw.array(),
        sigma: draw.positive(),
        prior: &prior,
        scale: draw.positives(),
    };
    let criterion = match draw.below(4) {
        0 => Criterion::LogDet,
        1 => Criterion::Trace,
        2 => Criterion::SmallestEigenvalue {
            sharpness: draw.or_infinite(),
        },
        _ => Criterion::Combination(draw.array()),
    };
    if let Some(value) = draw.taken(plan::value(&legs, &target, &criterion)) {
        draw.ordered(&[value]);
    }
    let mut out = vec![T::zero(); legs.steps() + 1];
    if draw
        .taken(plan::along(&legs, &target, &criterion, &mut out))
        .is_some()
    {
        draw.ordered(&out);
    }
    let (mut by_heading, mut by_length) = ([T::zero(); 3], [T::zero(); 3]);
    let weight = draw.x();
    let found = plan::gradient(
        &legs,
        &target,
        &criterion,
        weight,
        &mut by_heading,
        &mut by_length,
    );
    if let Some(value) = draw.taken(found) {
        draw.ordered(&[value]);
        draw.finite(&by_heading);
        draw.finite(&by_length);
    }
}

pub fn plans<T: Number>(draw: &mut Draw<T>) {
    if draw.below(2) == 0 {
        plan_of::<T, 2>(draw);
    } else {
        plan_of::<T, 4>(draw);
    }
}
