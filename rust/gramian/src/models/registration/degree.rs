//! The running degree of observability of two sensors' biases.

use super::pair::Plane;
use super::{Error, Layout};
use crate::scalar::{Real, check_finite};
use crate::square_root::SquareRootInformation;

/// eta = 2 det((1/K) sum of projectors)^(1/4), look by look, without allocation.
///
/// It lies in [0, 1], has no unit and does not grow with the number of looks
/// alone: 0 while some combination of biases is free, 1 where the looks' planes
/// are spread evenly.
///
/// # Source
/// The projectors are those of the model of Zhu, Tang & He 2013, whitened; their mean's
/// determinant as a degree is ours.
///
/// ```
/// use gramian::registration::degree::Running;
/// let sigma = [50.0, 1.7e-3];
/// let mut running = Running::new([0.0, 0.0], [60e3, 0.0], sigma, sigma).unwrap();
/// running.push([20e3, 30e3]).unwrap();
/// assert_eq!(running.eta(), 0.0);
/// running.push([45e3, 25e3]).unwrap();
/// assert!(running.eta() > 0.2);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Running<T> {
    sensors: [[T; 2]; 2],
    sigma: [[T; 2]; 2],
    root: SquareRootInformation<T, 4>,
    looks: u32,
}

impl<T: Real> Running<T> {
    /// Sensors at `a` and `b` (east, north), with their deviations of range and
    /// azimuth.
    ///
    /// # Units
    /// m, m and rad.
    ///
    /// # Errors
    /// As [`Layout::check`].
    pub fn new(a: [T; 2], b: [T; 2], sigma_a: [T; 2], sigma_b: [T; 2]) -> Result<Self, Error> {
        let (sensors, sigma) = ([a, b], [sigma_a, sigma_b]);
        Layout::PAIR.check(sensors.as_flattened(), sigma.as_flattened())?;
        Ok(Self {
            sensors,
            sigma,
            root: SquareRootInformation::new(),
            looks: 0,
        })
    }

    /// Takes in one look at a target at `position`.
    ///
    /// # Errors
    /// As [`Plane::new`], with the number of the look. It is not taken in then.
    pub fn push(&mut self, position: [T; 2]) -> Result<(), Error> {
        self.push_from(self.sensors, position)
    }

    /// The same of sensors on platforms, at these places now.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn push_from(&mut self, sensors: [[T; 2]; 2], position: [T; 2]) -> Result<(), Error> {
        check_finite("position", &position).map_err(|error| error.at(self.looks as usize))?;
        let offset = |s: usize| [position[0] - sensors[s][0], position[1] - sensors[s][1]];
        let plane = Plane::new(offset(0), offset(1), &self.sigma[0], &self.sigma[1])
            .map_err(|error| error.at(self.looks as usize))?;
        for row in plane.basis() {
            self.root.absorb(&row);
        }
        self.looks = self.looks.saturating_add(1);
        Ok(())
    }

    /// Number of looks so far.
    pub fn looks(&self) -> u32 {
        self.looks
    }

    /// The triangular factor of the looks, in biases over their deviations.
    pub fn root(&self) -> &SquareRootInformation<T, 4> {
        &self.root
    }

    /// The degree so far; 0 before two looks.
    pub fn eta(&self) -> T {
        if self.looks < 2 {
            return T::zero();
        }
        let two = T::one() + T::one();
        two * self.root.root_determinant().sqrt() / T::of(f64::from(self.looks))
    }
}
