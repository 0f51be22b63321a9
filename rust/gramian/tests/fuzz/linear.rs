//! Linear systems.

use crate::draw::{Draw, Number};
use gramian::linear;

pub fn levels<T: Number>(draw: &mut Draw<T>) {
    let mut a = draw.arrays::<4, 4>();
    // Zeros are what makes a system: most couplings do not exist.
    for x in a.as_flattened_mut() {
        if draw.below(2) == 0 && x.is_finite() {
            *x = T::zero();
        }
    }
    let c = draw.arrays::<4, 2>();
    if let Some(found) = draw.taken(linear::levels(&a, &c)) {
        assert!(found.ranks.iter().all(|&rank| rank <= 4));
        assert!(found.states.iter().flatten().all(|&level| level < 4));
    }
    let rtol: T = linear::default_rtol(draw.index(1 << 40));
    draw.finite(&[rtol]);
}
