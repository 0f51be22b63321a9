//! What paths keep to, as numbers that are at least zero where it is kept.

use alloc::vec::Vec;

use super::paths::{Layout, Pull, Track};
use super::{Problem, Restriction, Violation};
use crate::scalar::{hypot, wrapped};

/// One limit of one path; each is scaled to change by about 1 over its own size.
#[derive(Clone, Copy, Debug)]
enum Limit {
    /// Outside a disc: (distance / radius)^2 - 1, of the end of a step or of all of it.
    Disc {
        observer: usize,
        step: usize,
        center: [f64; 2],
        radius: f64,
        whole: bool,
        /// Which disc it is, where all of a step is outside of it.
        disc: usize,
    },
    /// Outside a polygon: signed distance over its size.
    Polygon {
        observer: usize,
        step: usize,
        polygon: usize,
    },
    /// A turn onto a leg: 1 - (turn / most)^2.
    Turn {
        observer: usize,
        leg: usize,
        most: f64,
    },
    /// Of a step length, as a share of the longest.
    Slow {
        observer: usize,
        leg: usize,
        least: f64,
    },
    Fast {
        observer: usize,
        leg: usize,
    },
    /// Two observers at a sample.
    Apart {
        one: usize,
        two: usize,
        sample: usize,
        distance: f64,
    },
    Home {
        observer: usize,
        place: [f64; 2],
        within: f64,
        size: f64,
    },
    Distance {
        observer: usize,
        most: f64,
    },
}

/// The limits of all paths of one layout.
#[derive(Clone, Debug)]
pub(super) struct Limits {
    limits: Vec<Limit>,
    /// Size of each polygon.
    sizes: Vec<f64>,
}

impl Limits {
    pub fn new(problem: &Problem, layout: &Layout) -> Self {
        let mut limits = Vec::new();
        let legs = layout.legs();
        let sizes: Vec<f64> = problem.polygons.iter().map(|p| size(p)).collect();
        for (observer, who) in problem.observers.iter().enumerate() {
            let drift = hypot(problem.current[0], problem.current[1]);
            let pace = (who.speed[1] + drift) * problem.dt;
            // Only what a path can reach at all is a limit.
            let near = |center: [f64; 2], radius: f64, step: usize| {
                let away = hypot(center[0] - who.start[0], center[1] - who.start[1]);
                away < radius + pace * (step + 1) as f64
            };
            for step in 0..problem.moves {
                let time = problem.dt * (step + 1) as f64;
                if problem.standoff > 0.0 {
                    for [x, y, u, v] in problem.beliefs.iter().flat_map(|b| &b.targets) {
                        let center = [x + time * u, y + time * v];
                        let radius = problem.standoff;
                        if near(center, radius, step) {
                            limits.push(Limit::Disc {
                                observer,
                                step,
                                center,
                                radius,
                                whole: false,
                                disc: 0,
                            });
                        }
                    }
                }
                for (disc, &[x, y, radius]) in problem.discs.iter().enumerate() {
                    if near([x, y], radius, step) {
                        limits.push(Limit::Disc {
                            observer,
                            step,
                            center: [x, y],
                            radius,
                            whole: true,
                            disc,
                        });
                    }
                }
                for (polygon, corners) in problem.polygons.iter().enumerate() {
                    if near(corners[0], sizes[polygon], step) {
                        limits.push(Limit::Polygon {
                            observer,
                            step,
                            polygon,
                        });
                    }
                }
            }
            for leg in 0..legs {
                if who.max_turn.is_finite() && (leg > 0 || who.heading.is_some()) {
                    limits.push(Limit::Turn {
                        observer,
                        leg,
                        most: who.max_turn,
                    });
                }
                if layout.free[observer] {
                    let least = who.speed[0] / who.speed[1];
                    limits.push(Limit::Slow {
                        observer,
                        leg,
                        least,
                    });
                    limits.push(Limit::Fast { observer, leg });
                }
            }
            if let Some((place, within)) = who.home {
                limits.push(Limit::Home {
                    observer,
                    place,
                    within,
                    size: pace * problem.moves as f64,
                });
            }
            if who.distance.is_finite() {
                limits.push(Limit::Distance {
                    observer,
                    most: who.distance,
                });
            }
            if problem.separation > 0.0 {
                for two in observer + 1..problem.observers.len() {
                    for sample in 1..=problem.moves {
                        limits.push(Limit::Apart {
                            one: observer,
                            two,
                            sample,
                            distance: problem.separation,
                        });
                    }
                }
            }
        }
        Self { limits, sizes }
    }

    pub fn len(&self) -> usize {
        self.limits.len()
    }

    /// The values, each in its own scale.
    pub fn values(
        &self,
        problem: &Problem,
        layout: &Layout,
        x: &[f64],
        tracks: &[Track],
        out: &mut Vec<f64>,
    ) {
        out.clear();
        out.extend(
            self.limits
                .iter()
                .map(|limit| self.value(limit, problem, layout, x, tracks)),
        );
    }

    fn value(
        &self,
        limit: &Limit,
        problem: &Problem,
        layout: &Layout,
        x: &[f64],
        tracks: &[Track],
    ) -> f64 {
        match *limit {
            Limit::Disc {
                observer,
                step,
                center,
                radius,
                whole,
                ..
            } => {
                let (_, [a, b]) = nearest(&tracks[observer], step, center, whole);
                (a * a + b * b) / (radius * radius) - 1.0
            }
            Limit::Polygon {
                observer,
                step,
                polygon,
            } => {
                let track = &tracks[observer];
                let (depth, _, _) = clear_of(
                    &problem.polygons[polygon],
                    track.at[step],
                    track.at[step + 1],
                );
                depth / self.sizes[polygon]
            }
            Limit::Turn {
                observer,
                leg,
                most,
            } => {
                let turn = turn(problem, layout, x, observer, leg) / most;
                1.0 - turn * turn
            }
            Limit::Slow {
                observer,
                leg,
                least,
            } => share(layout, x, observer, leg) - least,
            Limit::Fast { observer, leg } => 1.0 - share(layout, x, observer, leg),
            Limit::Apart {
                one,
                two,
                sample,
                distance,
            } => {
                let [p, q] = between(tracks[one].at[sample], tracks[two].at[sample]);
                (p * p + q * q) / (distance * distance) - 1.0
            }
            Limit::Home {
                observer,
                place,
                within,
                size,
            } => {
                let [p, q] = between(tracks[observer].at[problem.moves], place);
                (within - hypot(p, q)) / size
            }
            Limit::Distance { observer, most } => 1.0 - length(problem, layout, x, observer) / most,
        }
    }

    /// Adds factor times the derivatives of a limit: by the path to `pulls`, by the
    /// unknowns themselves to `gradient`.
    #[allow(clippy::too_many_arguments)]
    pub fn pull(
        &self,
        index: usize,
        factor: f64,
        problem: &Problem,
        layout: &Layout,
        x: &[f64],
        tracks: &[Track],
        pulls: &mut [Pull],
        gradient: &mut [f64],
    ) {
        match self.limits[index] {
            Limit::Disc {
                observer,
                step,
                center,
                radius,
                whole,
                ..
            } => {
                let (part, away) = nearest(&tracks[observer], step, center, whole);
                let factor = factor * 2.0 / (radius * radius);
                let at = &mut pulls[observer].at;
                for k in 0..2 {
                    at[step][k] += factor * (1.0 - part) * away[k];
                    at[step + 1][k] += factor * part * away[k];
                }
            }
            Limit::Polygon {
                observer,
                step,
                polygon,
            } => {
                let track = &tracks[observer];
                let (_, part, normal) = clear_of(
                    &problem.polygons[polygon],
                    track.at[step],
                    track.at[step + 1],
                );
                let factor = factor / self.sizes[polygon];
                let at = &mut pulls[observer].at;
                for k in 0..2 {
                    at[step][k] += factor * (1.0 - part) * normal[k];
                    at[step + 1][k] += factor * part * normal[k];
                }
            }
            Limit::Turn {
                observer,
                leg,
                most,
            } => {
                let slope = -2.0 * turn(problem, layout, x, observer, leg) / (most * most);
                let first = layout.first(observer);
                gradient[first + leg] += factor * slope;
                if leg > 0 {
                    gradient[first + leg - 1] -= factor * slope;
                }
            }
            Limit::Slow { observer, leg, .. } => {
                gradient[layout.first(observer) + layout.legs() + leg] += factor;
            }
            Limit::Fast { observer, leg } => {
                gradient[layout.first(observer) + layout.legs() + leg] -= factor;
            }
            Limit::Apart {
                one,
                two,
                sample,
                distance,
            } => {
                let (a, b) = (tracks[one].at[sample], tracks[two].at[sample]);
                for k in 0..2 {
                    let change = factor * 2.0 * (a[k] - b[k]) / (distance * distance);
                    pulls[one].at[sample][k] += change;
                    pulls[two].at[sample][k] -= change;
                }
            }
            Limit::Home {
                observer,
                place,
                size,
                ..
            } => {
                let end = tracks[observer].at[problem.moves];
                let away = [end[0] - place[0], end[1] - place[1]];
                let distance = hypot(away[0], away[1]).max(1e-300);
                for k in 0..2 {
                    pulls[observer].at[problem.moves][k] -= factor * away[k] / (distance * size);
                }
            }
            Limit::Distance { observer, most } => {
                if layout.free[observer] {
                    let first = layout.first(observer) + layout.legs();
                    let pace = problem.observers[observer].speed[1] * problem.dt;
                    for (leg, &count) in layout.counts.iter().enumerate() {
                        gradient[first + leg] -= factor * pace * count as f64 / most;
                    }
                }
            }
        }
    }

    /// The least distance from what bounds the places of a path, m; below zero where one
    /// is broken, infinite without any.
    pub fn clearance(&self, problem: &Problem, tracks: &[Track]) -> f64 {
        let mut least = f64::INFINITY;
        for limit in &self.limits {
            let distance = match *limit {
                Limit::Disc {
                    observer,
                    step,
                    center,
                    radius,
                    whole,
                    ..
                } => {
                    let (_, [a, b]) = nearest(&tracks[observer], step, center, whole);
                    hypot(a, b) - radius
                }
                Limit::Polygon {
                    observer,
                    step,
                    polygon,
                } => {
                    let track = &tracks[observer];
                    clear_of(
                        &problem.polygons[polygon],
                        track.at[step],
                        track.at[step + 1],
                    )
                    .0
                }
                Limit::Apart {
                    one,
                    two,
                    sample,
                    distance,
                } => {
                    let (a, b) = (tracks[one].at[sample], tracks[two].at[sample]);
                    hypot(a[0] - b[0], a[1] - b[1]) - distance
                }
                Limit::Home {
                    observer,
                    place,
                    within,
                    ..
                } => {
                    let end = tracks[observer].at[problem.moves];
                    within - hypot(end[0] - place[0], end[1] - place[1])
                }
                _ => continue,
            };
            least = least.min(distance);
        }
        least
    }

    /// The limits that are broken, each kind once: where it is broken most.
    pub fn violations(
        &self,
        problem: &Problem,
        layout: &Layout,
        x: &[f64],
        tracks: &[Track],
    ) -> Vec<Violation> {
        let mut broken: Vec<(f64, Violation)> = Vec::new();
        for limit in &self.limits {
            let value = self.value(limit, problem, layout, x, tracks);
            if value > -1e-9 {
                continue;
            }
            let new = violation(limit, problem, layout, x, tracks);
            match broken
                .iter_mut()
                .find(|(_, old)| old.restriction == new.restriction)
            {
                Some(old) if value < old.0 => *old = (value, new),
                Some(_) => {}
                None => broken.push((value, new)),
            }
        }
        broken.sort_by(|a, b| a.0.total_cmp(&b.0));
        broken.into_iter().map(|(_, violation)| violation).collect()
    }
}

/// By how much a limit is broken, in its own unit.
fn violation(
    limit: &Limit,
    problem: &Problem,
    layout: &Layout,
    x: &[f64],
    tracks: &[Track],
) -> Violation {
    let last = problem.moves;
    let leg_begins = |leg: usize| layout.counts[..leg].iter().sum::<usize>();
    let (restriction, observer, sample, by) = match *limit {
        Limit::Disc {
            observer,
            step,
            center,
            radius,
            whole,
            disc,
        } => {
            let (_, [a, b]) = nearest(&tracks[observer], step, center, whole);
            let kind = if whole {
                Restriction::Disc(disc)
            } else {
                Restriction::Standoff
            };
            (kind, observer, step + 1, radius - hypot(a, b))
        }
        Limit::Polygon {
            observer,
            step,
            polygon,
        } => {
            let at = &tracks[observer].at;
            let (depth, ..) = clear_of(&problem.polygons[polygon], at[step], at[step + 1]);
            (Restriction::Polygon(polygon), observer, step + 1, -depth)
        }
        Limit::Turn {
            observer,
            leg,
            most,
        } => {
            let by = turn(problem, layout, x, observer, leg).abs() - most;
            (Restriction::Turn, observer, leg_begins(leg), by)
        }
        Limit::Slow { observer, leg, .. } | Limit::Fast { observer, leg } => {
            let [slow, fast] = problem.observers[observer].speed;
            let speed = fast * share(layout, x, observer, leg);
            let by = (slow - speed).max(speed - fast);
            (Restriction::Speed, observer, leg_begins(leg) + 1, by)
        }
        Limit::Apart {
            one,
            two,
            sample,
            distance,
        } => {
            let [p, q] = between(tracks[one].at[sample], tracks[two].at[sample]);
            (Restriction::Separation, one, sample, distance - hypot(p, q))
        }
        Limit::Home {
            observer,
            place,
            within,
            ..
        } => {
            let [p, q] = between(tracks[observer].at[last], place);
            (Restriction::Home, observer, last, hypot(p, q) - within)
        }
        Limit::Distance { observer, most } => {
            let by = length(problem, layout, x, observer) - most;
            (Restriction::Distance, observer, last, by)
        }
    };
    Violation {
        restriction,
        observer,
        sample,
        by,
    }
}

/// From `to` to `from`.
fn between(from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    [from[0] - to[0], from[1] - to[1]]
}

fn turn(problem: &Problem, layout: &Layout, x: &[f64], observer: usize, leg: usize) -> f64 {
    let headings = layout.headings(x, observer);
    let before = if leg > 0 {
        headings[leg - 1]
    } else {
        problem.observers[observer].heading.unwrap_or(headings[0])
    };
    wrapped(headings[leg] - before)
}

fn share(layout: &Layout, x: &[f64], observer: usize, leg: usize) -> f64 {
    layout.shares(x, observer).map_or(1.0, |shares| shares[leg])
}

/// The length of a path through the water.
fn length(problem: &Problem, layout: &Layout, x: &[f64], observer: usize) -> f64 {
    let pace = problem.observers[observer].speed[1] * problem.dt;
    layout
        .counts
        .iter()
        .enumerate()
        .map(|(leg, &count)| pace * count as f64 * share(layout, x, observer, leg))
        .sum()
}

/// Which share of a step leads to the point of it that is nearest to a centre, and the
/// way from the centre to that point.
fn nearest(track: &Track, step: usize, center: [f64; 2], whole: bool) -> (f64, [f64; 2]) {
    let (begin, end) = (track.at[step], track.at[step + 1]);
    if !whole {
        return (1.0, [end[0] - center[0], end[1] - center[1]]);
    }
    let along = [end[0] - begin[0], end[1] - begin[1]];
    let from = [begin[0] - center[0], begin[1] - center[1]];
    let square = (along[0] * along[0] + along[1] * along[1]).max(1e-300);
    let part = (-(from[0] * along[0] + from[1] * along[1]) / square).clamp(0.0, 1.0);
    (part, [from[0] + part * along[0], from[1] + part * along[1]])
}

/// The largest extent of a polygon.
fn size(corners: &[[f64; 2]]) -> f64 {
    let mut largest = 1e-300_f64;
    for a in corners {
        for b in corners {
            largest = largest.max(hypot(a[0] - b[0], a[1] - b[1]));
        }
    }
    largest
}

/// Signed distance of a point from a polygon, negative inside, and its gradient.
pub(super) fn signed(corners: &[[f64; 2]], at: [f64; 2]) -> (f64, [f64; 2]) {
    let mut inside = false;
    let mut least = (f64::INFINITY, [0.0; 2], [0.0; 2]);
    for (i, &a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        if (a[1] > at[1]) != (b[1] > at[1]) {
            let cross = a[0] + (at[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
            if at[0] < cross {
                inside = !inside;
            }
        }
        let edge = [b[0] - a[0], b[1] - a[1]];
        let from = [at[0] - a[0], at[1] - a[1]];
        let square = (edge[0] * edge[0] + edge[1] * edge[1]).max(1e-300);
        let part = ((from[0] * edge[0] + from[1] * edge[1]) / square).clamp(0.0, 1.0);
        let away = [from[0] - part * edge[0], from[1] - part * edge[1]];
        let distance = hypot(away[0], away[1]);
        if distance < least.0 {
            least = (distance, away, edge);
        }
    }
    let sign = if inside { -1.0 } else { 1.0 };
    let (distance, away, edge) = least;
    let normal = if distance > 0.0 {
        [sign * away[0] / distance, sign * away[1] / distance]
    } else {
        let length = hypot(edge[0], edge[1]).max(1e-300);
        [edge[1] / length, -edge[0] / length]
    };
    (sign * distance, normal)
}

/// The least signed distance of the points of a step from a polygon, which share of the
/// step leads there, and the gradient at that point.
fn clear_of(corners: &[[f64; 2]], begin: [f64; 2], end: [f64; 2]) -> (f64, f64, [f64; 2]) {
    let along = [end[0] - begin[0], end[1] - begin[1]];
    let square = (along[0] * along[0] + along[1] * along[1]).max(1e-300);
    let mut best = (f64::INFINITY, 0.0, [0.0; 2]);
    let mut offer = |part: f64| {
        let at = [begin[0] + part * along[0], begin[1] + part * along[1]];
        let (distance, normal) = signed(corners, at);
        if distance < best.0 {
            best = (distance, part, normal);
        }
        distance
    };
    // Outside, the nearest point is at an end of the step or opposite a corner.
    let at_begin = offer(0.0);
    offer(1.0);
    let length = square.sqrt();
    if at_begin > length {
        return best;
    }
    for corner in corners {
        let part = ((corner[0] - begin[0]) * along[0] + (corner[1] - begin[1]) * along[1]) / square;
        if part > 0.0 && part < 1.0 {
            offer(part);
        }
    }
    // Inside, somewhere between where it enters and where it leaves.
    for k in 1..8 {
        offer(f64::from(k) / 8.0);
    }
    let mut crossings = alloc::vec![0.0, 1.0];
    for (i, &a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let edge = [b[0] - a[0], b[1] - a[1]];
        let cross = along[0] * edge[1] - along[1] * edge[0];
        if cross != 0.0 {
            let part = ((a[0] - begin[0]) * edge[1] - (a[1] - begin[1]) * edge[0]) / cross;
            if part > 0.0 && part < 1.0 {
                crossings.push(part);
            }
        }
    }
    crossings.sort_by(f64::total_cmp);
    for pair in crossings.windows(2) {
        offer(0.5 * (pair[0] + pair[1]));
    }
    best
}
