//! The same geometries in f32 and in f64, and how far the answers are apart.
//! Shared by the program that prints them and by the test that bounds them.

#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use gramian::bearings::{Answer, Monitor, bearing, position, push_rows};
use gramian::bound::crlb_std;
use gramian::dipole::{Accumulator, Pass, Sensors};
use gramian::information::Information;
use gramian::registration::degree::Running;
use gramian::rows::RowSink;
use gramian::scalar::{NumberError, Real, wrap_angle};
use gramian::spectrum::Spectrum;
use gramian::square_root::SquareRootInformation;

/// A target and an observer that goes north and then turns.
#[derive(Clone, Copy, Debug)]
pub struct Track {
    pub name: &'static str,
    pub count: u32,
    /// s; the instants are even, or spread by a tenth of the step.
    pub step: f64,
    pub uneven: bool,
    /// s: what the clock shows at the first bearing.
    pub clock: f64,
    /// The observer turns by so many degrees half-way, on as many legs.
    pub turn: f64,
    /// m; the target starts at this range.
    pub range: f64,
    /// rad; all bearings are turned by this.
    pub axes: f64,
    /// rad
    pub sigma: f64,
}

/// The reference cases B1 and B2 have half a degree, 20 s and 10 km.
const B1: Track = Track {
    name: "B1",
    count: 20,
    step: 20.0,
    uneven: false,
    clock: 0.0,
    turn: 90.0,
    range: 10_000.0,
    axes: 0.0,
    sigma: PI / 360.0,
};

const B2: Track = Track {
    name: "B2",
    count: 40,
    ..B1
};

const fn turned(track: Track, turn: f64) -> Track {
    Track { turn, ..track }
}

/// The reference cases, and the turn made smaller down to none.
pub const REFERENCE: [Track; 10] = [
    B1,
    turned(B1, 10.0),
    turned(B1, 1.0),
    turned(B1, 0.1),
    turned(B1, 0.0),
    B2,
    turned(B2, 10.0),
    turned(B2, 1.0),
    turned(B2, 0.1),
    turned(B2, 0.0),
];

/// What a device in use may meet.
pub const HARDER: [Track; 13] = [
    Track {
        name: "10 Hz for 400 s",
        count: 4000,
        step: 0.1,
        turn: 10.0,
        ..B1
    },
    Track {
        name: "10 Hz for a day",
        count: 864_000,
        step: 0.1,
        turn: 1.0,
        range: 1e6,
        ..B1
    },
    Track {
        name: "10 Hz for a day, straight",
        count: 864_000,
        step: 0.1,
        turn: 0.0,
        range: 1e6,
        ..B1
    },
    Track {
        name: "1 kHz for 400 s",
        count: 400_000,
        step: 0.001,
        turn: 10.0,
        ..B1
    },
    Track {
        name: "south of the observer",
        axes: 3.1,
        turn: 1.0,
        ..B2
    },
    Track {
        name: "bearings of 5 arcsec",
        sigma: 2.4e-5,
        turn: 1.0,
        ..B2
    },
    Track {
        name: "at 100 km",
        range: 1e5,
        turn: 10.0,
        ..B2
    },
    Track {
        name: "clock at a day",
        clock: 86_400.3,
        uneven: true,
        turn: 1.0,
        ..B2
    },
    Track {
        name: "clock at 12 days",
        clock: 1e6,
        uneven: true,
        turn: 90.0,
        ..B2
    },
    Track {
        name: "clock at 12 days, straight",
        clock: 1e6,
        uneven: true,
        turn: 0.0,
        ..B2
    },
    Track {
        name: "clock at 116 days, straight",
        clock: 1e7,
        uneven: true,
        turn: 0.0,
        ..B2
    },
    Track {
        name: "clock at 116 days",
        clock: 1e7,
        uneven: true,
        turn: 1.0,
        ..B2
    },
    Track {
        name: "2 s of bearings",
        step: 0.1,
        turn: 10.0,
        ..B1
    },
];

/// One sample.
struct Sample {
    time: f64,
    observer: [f64; 2],
    target: [f64; 2],
}

impl Track {
    fn sample(&self, i: u32) -> Sample {
        let k = f64::from(i);
        let jitter = if self.uneven {
            0.1 * (k * k * 0.3).sin()
        } else {
            0.0
        };
        let time = self.step * (k + jitter);
        let leg = self.step * f64::from(self.count / 2);
        let (before, after) = (time.min(leg), (time - leg).max(0.0));
        let (sin, cos) = self.turn.to_radians().sin_cos();
        let observer = [5.0 * after * sin, 5.0 * (before + after * cos)];
        let target = position(&[0.0, self.range, 3.0, -1.0], time).unwrap();
        Sample {
            time,
            observer,
            target,
        }
    }

    fn watch<T: Real>(&self, noisy: bool) -> Answer<T> {
        let mut monitor = Monitor::new();
        for i in 0..self.count {
            let at = self.sample(i);
            // Not random, but as irregular; of the right size.
            let k = f64::from(i);
            let noise = if noisy {
                self.sigma * 2.0_f64.sqrt() * (k * k * 0.7).sin()
            } else {
                0.0
            };
            let angle = bearing(at.observer, at.target).unwrap() + self.axes + noise;
            let angle = wrap_angle(angle).unwrap();
            let range = (at.target[0] - at.observer[0]).hypot(at.target[1] - at.observer[1]);
            // With ranges the bounds are Fisher's; the test does without.
            let range = (!noisy).then_some(T::of(range));
            let pushed = monitor.push(
                T::of(self.clock + at.time),
                T::of(angle),
                T::of(self.sigma),
                range,
            );
            assert!(pushed.is_ok(), "{}: {pushed:?}", self.name);
        }
        monitor.answer()
    }

    /// What the monitor says in both precisions.
    pub fn compare(&self) -> Comparison {
        let (single, double) = (self.watch::<f32>(false), self.watch::<f64>(false));
        let (noisy, exact) = (self.watch::<f32>(true), self.watch::<f64>(true));
        let scale = exact.statistic.max(exact.dof);
        Comparison {
            rank: [single.rank, double.rank],
            bound: apart(&single.crlb_std, &double.crlb_std),
            statistic: (noisy.statistic.double() - exact.statistic).abs() / scale,
            p_value: (noisy.p_value.double() - exact.p_value).abs(),
        }
    }

    /// The same bound from rows as they come, with time from the first and the
    /// positions from an origin `offset` away: from their triangular factor, and
    /// from the information matrix. In f32, against f64 without offset.
    pub fn compare_rows(&self, offset: f64) -> [Result<f64, usize>; 2] {
        fn rows<T: Real>(track: &Track, offset: f64, sink: &mut impl RowSink<T, 4>) {
            let samples = || (0..track.count).map(|i| track.sample(i));
            let shift = |p: [f64; 2]| p.map(|x| T::of(x + offset));
            let times: Vec<T> = samples().map(|s| T::of(s.time)).collect();
            let observer: Vec<_> = samples().map(|s| shift(s.observer)).collect();
            let target: Vec<_> = samples().map(|s| shift(s.target)).collect();
            let sigma = [T::of(track.sigma)];
            let pushed = push_rows(&times, &observer, &target, &sigma, sink);
            assert!(pushed.is_ok(), "{}: {pushed:?}", track.name);
        }
        let mut double = SquareRootInformation::<f64, 4>::new();
        rows(self, 0.0, &mut double);
        let double = Spectrum::new(&double);
        let known = crlb_std(&double);
        let mut root = SquareRootInformation::<f32, 4>::new();
        rows(self, offset, &mut root);
        let spectrum = Spectrum::new(&root);
        let mut information = Information::<f32, 4>::new();
        rows(self, offset, &mut information);
        let from_root = if spectrum.rank() == double.rank() {
            Ok(apart(&crlb_std(&spectrum), &known))
        } else {
            Err(spectrum.rank())
        };
        // 1 / sqrt of what is left on each state when the others are eliminated.
        let from_matrix = core::array::from_fn::<_, 4, _>(|i| {
            information
                .marginalize_others(&[i])
                .map_or(f32::INFINITY, |left| 1.0 / left.matrix()[(0, 0)].sqrt())
        });
        [from_root, Ok(apart(&from_matrix, &known))]
    }
}

/// How far f32 is from f64.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    /// In f32 and in f64, of exact bearings with ranges.
    pub rank: [usize; 2],
    /// Worst relative difference of the finite bounds; infinite where only one
    /// of the two is.
    pub bound: f64,
    /// Of the test of noisy bearings: difference of the statistic as a part of it
    /// or of its degrees of freedom, and of the probability.
    pub statistic: f64,
    pub p_value: f64,
}

/// The worst relative difference; infinite where only one of a pair is finite.
pub fn apart<T: Real, const N: usize>(single: &[T; N], double: &[f64; N]) -> f64 {
    single.iter().zip(double).fold(0.0, |worst, (s, d)| {
        let s = s.double();
        let off = if s.is_infinite() && d.is_infinite() {
            0.0
        } else if s.is_finite() && d.is_finite() {
            (s / d - 1.0).abs()
        } else {
            f64::INFINITY
        };
        f64::max(worst, off)
    })
}

/// A dipole that passes one sensor (1 nT): position, velocity, moment, step, count.
#[derive(Clone, Copy, Debug)]
pub struct Dipole {
    pub name: &'static str,
    pub state: [f64; 9],
    pub step: f64,
    pub count: u32,
}

/// The reference cases, and a ship at a distance.
pub const DIPOLES: [Dipole; 3] = [
    Dipole {
        name: "D1",
        state: [-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0],
        step: 1.0,
        count: 21,
    },
    Dipole {
        name: "D2",
        state: [-8.0, 3.0, 2.0, 1.6, -0.1, 0.05, 40.0, -25.0, 80.0],
        step: 0.25,
        count: 41,
    },
    Dipole {
        name: "a ship at 300 m",
        state: [-800.0, 300.0, 20.0, 8.0, 0.3, 0.0, 3e5, 2e5, -4e5],
        step: 1.0,
        count: 200,
    },
];

/// Leaves out the state that is known.
struct WithoutHeight<T>(SquareRootInformation<T, 8>);

impl<T: Real> RowSink<T, 9> for WithoutHeight<T> {
    fn push(&mut self, row: &[T; 9]) -> Result<(), NumberError> {
        let [x, y, _, rest @ ..] = *row;
        let [vx, vy, vz, mx, my, mz] = rest;
        self.0.push(&[x, y, vx, vy, vz, mx, my, mz])
    }
}

impl Dipole {
    fn rows<T: Real>(&self, sink: &mut impl RowSink<T, 9>) {
        let times: Vec<T> = (0..self.count)
            .map(|k| T::of(self.step * f64::from(k)))
            .collect();
        let pass = Pass::of(&self.state.map(T::of));
        let sensors = [[T::zero(); 3]];
        let sigma = [T::of(1e-9)];
        let pushed = Sensors::vector(&sensors).push_rows(&times, &pass, &sigma, sink);
        assert!(pushed.is_ok(), "{}: {pushed:?}", self.name);
    }

    fn sums<T: Real>(&self) -> [[T; 9]; 9] {
        let mut sums = Accumulator::new();
        let pass = Pass::of(&self.state.map(T::of));
        for k in 0..self.count {
            let time = T::of(self.step * f64::from(k));
            let place = pass.seen_from(&[T::zero(); 3], time).unwrap();
            let pushed = sums.push(time, &place, &pass.moment, T::of(1e18));
            assert!(pushed.is_ok(), "{}: {pushed:?}", self.name);
        }
        sums.matrix()
    }

    /// Ranks of all nine states; the worst bound of the eight others where the
    /// height is known; the worst entry of the running sums, on the scale of its
    /// row and column.
    pub fn compare(&self) -> ([usize; 2], f64, f64) {
        let mut single = SquareRootInformation::<f32, 9>::new();
        self.rows(&mut single);
        let mut double = SquareRootInformation::<f64, 9>::new();
        self.rows(&mut double);
        let rank = [Spectrum::new(&single).rank(), Spectrum::new(&double).rank()];
        let mut single = WithoutHeight(SquareRootInformation::<f32, 8>::new());
        self.rows(&mut single);
        let mut double = WithoutHeight(SquareRootInformation::<f64, 8>::new());
        self.rows(&mut double);
        let bound = apart(
            &crlb_std(&Spectrum::new(&single.0)),
            &crlb_std(&Spectrum::new(&double.0)),
        );
        let (s, d) = (self.sums::<f32>(), self.sums::<f64>());
        let mut worst = 0.0;
        for i in 0..9 {
            for j in 0..9 {
                let off = (s[i][j].double() - d[i][j]).abs() / (d[i][i] * d[j][j]).sqrt();
                worst = f64::max(worst, off);
            }
        }
        (rank, bound, worst)
    }
}

/// Targets that two radars see, 60 km apart: where one starts (m), its velocity
/// (m/s), how many looks there are, 1 s apart.
#[derive(Clone, Copy, Debug)]
pub struct Radars {
    pub name: &'static str,
    pub start: [f64; 2],
    pub velocity: [f64; 2],
    pub looks: u32,
}

/// The motions of the reference, the last one abeam a radar: unobservable.
pub const RADARS: [Radars; 5] = [
    Radars {
        name: "motion 1",
        start: [-30e3, 40e3],
        velocity: [250.0, 0.0],
        looks: 481,
    },
    Radars {
        name: "motion 2",
        start: [30e3, 60_001.0],
        velocity: [0.0, -250.0],
        looks: 481,
    },
    Radars {
        name: "target A",
        start: [-20e3, 25e3],
        velocity: [400.0, 0.0],
        looks: 200,
    },
    Radars {
        name: "motion 3 (on the baseline)",
        start: [6000.5, 0.0],
        velocity: [100.0, 0.0],
        looks: 481,
    },
    Radars {
        name: "motion 4 (abeam a radar)",
        start: [0.0, 120_001.0],
        velocity: [0.0, -240.0],
        looks: 481,
    },
];

impl Radars {
    fn run<T: Real>(&self) -> (Spectrum<T, 4>, T) {
        let sigma = [T::of(50.0), T::of(0.1_f64.to_radians())];
        let zero = T::zero();
        let mut running = Running::new([zero, zero], [T::of(60e3), zero], sigma, sigma).unwrap();
        for k in 0..self.looks {
            let [x, y] = self.start;
            let at = position(&[x, y, self.velocity[0], self.velocity[1]], f64::from(k)).unwrap();
            let pushed = running.push(at.map(T::of));
            assert!(pushed.is_ok(), "{}: {pushed:?}", self.name);
        }
        (Spectrum::new(running.root()), running.eta())
    }

    /// Ranks, the worst bound, the degree.
    pub fn compare(&self) -> ([usize; 2], f64, [f64; 2]) {
        let ((single, s), (double, d)) = (self.run::<f32>(), self.run::<f64>());
        let bound = apart(&crlb_std(&single), &crlb_std(&double));
        ([single.rank(), double.rank()], bound, [s.double(), d])
    }
}
