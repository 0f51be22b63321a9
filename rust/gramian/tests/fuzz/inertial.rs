//! The inertial error model.

use crate::draw::{Draw, Number};
use gramian::inertial::{
    self, Group, Leg, Motion, Output, Recorded, Sample, Segments, Start, Sway,
};

pub fn inertial_models<T: Number>(draw: &mut Draw<T>) {
    // Each call is given all that was drawn since the last `again`, and no more.
    let latitude = draw.x();
    if let Some((meridian, normal)) = draw.taken(inertial::radii(latitude)) {
        draw.finite(&[meridian, normal]);
    }
    let height = draw.x();
    if let Some(g) = draw.taken(inertial::gravity(latitude, height)) {
        draw.finite(&[g]);
    }
    draw.taken(inertial::check_place(latitude, height));
    let rate = draw.x();
    if let Some(rows) = draw.taken(inertial::combinations_at_rest(latitude, height, rate)) {
        draw.finite(rows.as_flattened());
    }
    let mut motion = Motion::at_rest(latitude, height, rate);
    motion.velocity = draw.array();
    motion.angular_rate = draw.array();
    motion.lever_arm = draw.array();
    motion.odometer_arm = draw.array();
    if draw.below(2) == 0 {
        motion.specific_force = Some(draw.array());
    }
    let motion_is_sound = draw.sound;
    draw.again();
    let [heading, pitch, roll] = draw.array();
    if let Some(attitude) = draw.taken(inertial::rotation(heading, pitch, roll)) {
        draw.finite(attitude.as_flattened());
        motion.attitude = attitude;
    }
    // An attitude that was refused is not in the motion.
    draw.sound = motion_is_sound;
    if let Some(model) = draw.taken(inertial::error_model(&motion)) {
        draw.finite(model.a.as_flattened());
        draw.finite(&model.per_metre);
        for output in [
            Output::Velocity,
            Output::Position,
            Output::Odometer,
            Output::SideSlip,
            Output::ZeroVelocity,
            Output::ZeroAngularRate,
            Output::Heading,
        ] {
            if let Some(lines) = draw.taken(model.output(output)) {
                draw.finite(lines.as_flattened());
            }
        }
    }
    assert_eq!(Group::Core.columns().len(), 15);
    sways_and_flights(draw);
}

pub fn sways_and_flights<T: Number>(draw: &mut Draw<T>) {
    draw.again();
    let sway = Sway {
        amplitude: draw.array(),
        period: draw.positives(),
        phase: draw.array(),
    };
    let time = draw.x();
    if let Some(angles) = draw.taken(sway.at(time)) {
        draw.finite(&angles);
    }
    draw.again();
    let samples: [Sample<T>; 3] = core::array::from_fn(|leg| Sample {
        time: draw.x(),
        velocity: draw.array(),
        angles: draw.array(),
        leg,
    });
    let (place, [step, largest_turn], rate) = (draw.array(), draw.positives(), draw.x());
    if let Ok(recorded) = Recorded::new(&samples, place, step, largest_turn, rate) {
        for segment in recorded {
            if let Some(segment) = draw.taken(segment) {
                draw.finite(&[segment.duration, segment.heading, segment.speed]);
                draw.finite(&segment.motion.velocity);
                draw.finite(&segment.motion.angular_rate);
            }
        }
    }
    draw.again();
    let start = Start {
        latitude: draw.x(),
        longitude: draw.x(),
        height: draw.x(),
        speed: draw.x(),
        heading: draw.x(),
    };
    let [step, largest_turn, rate] = draw.positives();
    let start_is_sound = draw.sound;
    let legs: [Leg<T>; 2] = core::array::from_fn(|_| Leg {
        duration: draw.positive(),
        turn: draw.x(),
        speed_change: draw.x(),
        bank: draw.x(),
    });
    let Ok(segments) = Segments::new(&legs, start, step, largest_turn, rate) else {
        return;
    };
    assert!(start_is_sound, "{}: taken though not finite", draw.place());
    for segment in segments.take(20).map_while(Result::ok) {
        let motion = segment.motion;
        draw.finite(&[segment.duration, segment.time, segment.heading]);
        draw.finite(&[segment.speed, segment.longitude, motion.latitude]);
        draw.finite(&motion.velocity);
        draw.finite(&motion.specific_force.unwrap());
    }
}
