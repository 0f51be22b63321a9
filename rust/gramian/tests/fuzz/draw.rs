//! Random numbers of any bits, and what is asked of the answers.

use gramian::scalar::Real;

/// A number type with its bits.
pub trait Number: Real {
    /// Decimal exponents of the smallest and the largest number.
    const RANGE: (f64, f64);
    fn of_bits(bits: u64) -> Self;
    fn special(index: u64) -> Self;
}

macro_rules! number {
    ($type:ident, $bits:ty, $range:expr) => {
        impl Number for $type {
            const RANGE: (f64, f64) = $range;
            #[allow(clippy::cast_possible_truncation)]
            fn of_bits(bits: u64) -> Self {
                Self::from_bits(bits as $bits)
            }
            fn special(index: u64) -> Self {
                let values = [
                    0.0,
                    -0.0,
                    1.0,
                    -1.0,
                    Self::INFINITY,
                    Self::NEG_INFINITY,
                    Self::NAN,
                    Self::MIN_POSITIVE,
                    -Self::MIN_POSITIVE,
                    Self::from_bits(1),
                    Self::MAX,
                    Self::MIN,
                    Self::EPSILON,
                    core::$type::consts::PI,
                ];
                values[usize::try_from(index).unwrap() % values.len()]
            }
        }
    };
}
number!(f32, u32, (-45.0, 38.5));
#[allow(clippy::unnecessary_cast)]
mod double {
    use super::Number;
    number!(f64, u64, (-323.0, 308.2));
}

/// What the entries of a pattern look like.
#[derive(Clone, Copy)]
pub enum Kind {
    Bits,
    Anything,
    Ordinary,
    OrdinaryButOne,
    /// Decimal exponents up to this part of the type's range.
    Wide(f64),
    /// One size for all, up to rounding of their own.
    Scaled(f64),
}

pub fn all_finite<T: Number>(values: &[T]) -> bool {
    values.iter().all(|&x| x.is_finite())
}

pub struct Draw<T> {
    name: &'static str,
    state: u64,
    pattern: u64,
    kind: Kind,
    pub sound: bool,
    mark: core::marker::PhantomData<T>,
}

impl<T: Number> Draw<T> {
    pub fn new(name: &'static str) -> Self {
        Self {
            name,
            state: 0,
            pattern: 0,
            kind: Kind::Bits,
            sound: true,
            mark: core::marker::PhantomData,
        }
    }

    /// `SplitMix64`.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, count: u64) -> u64 {
        self.bits() % count
    }

    pub fn index(&mut self, count: usize) -> usize {
        usize::try_from(self.below(count as u64)).unwrap()
    }

    /// In [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn start(&mut self, pattern: u64) {
        self.pattern = pattern;
        self.state = pattern.wrapping_mul(0xd134_2543_de82_ef95) ^ 0x5851_f42d;
        self.again();
        let size = (self.uniform() * 2.0 - 1.0) * T::RANGE.1;
        self.kind = match self.below(12) {
            0 => Kind::Bits,
            1 => Kind::Anything,
            2..=4 => Kind::Ordinary,
            5 | 6 => Kind::OrdinaryButOne,
            7 => Kind::Wide(1.0),
            8 => Kind::Wide(0.5),
            9 => Kind::Wide(0.1),
            _ => Kind::Scaled(size),
        };
    }

    /// Inputs count for the next call from here on.
    pub fn again(&mut self) {
        self.sound = true;
    }

    pub fn ordinary(&mut self) -> T {
        let scale = [1.0, 10.0, 1e4][self.index(3)];
        // Whole numbers meet each other and zero.
        let value = (self.uniform() * 2.0 - 1.0) * scale;
        T::of(if self.below(4) == 0 {
            value.round()
        } else {
            value
        })
    }

    pub fn free(&mut self) -> T {
        match self.kind {
            Kind::Bits => T::of_bits(self.bits()),
            Kind::Anything => match self.below(4) {
                0 => T::of_bits(self.bits()),
                1 => {
                    let index = self.below(64);
                    T::special(index)
                }
                2 => self.wide(1.0),
                _ => self.ordinary(),
            },
            Kind::Ordinary => self.ordinary(),
            Kind::OrdinaryButOne => {
                if self.below(8) == 0 {
                    let index = self.below(64);
                    T::special(index)
                } else {
                    self.ordinary()
                }
            }
            Kind::Wide(part) => self.wide(part),
            Kind::Scaled(exponent) => {
                let value = self.ordinary().double();
                // In two steps: the power alone may not be a number.
                T::of(value * 10_f64.powf(exponent / 2.0)) * T::of(10_f64.powf(exponent / 2.0))
            }
        }
    }

    pub fn wide(&mut self, part: f64) -> T {
        let (least, most) = T::RANGE;
        let exponent = part * (least + self.uniform() * (most - least));
        let value = T::of(10_f64.powf(exponent));
        if self.below(2) == 0 { value } else { -value }
    }

    /// A number that must be finite.
    pub fn x(&mut self) -> T {
        let value = self.free();
        self.sound &= value.is_finite();
        value
    }

    /// A magnitude that may be infinite.
    pub fn or_infinite(&mut self) -> T {
        let value = self.free().abs();
        self.sound &= value.is_finite() || value == T::INFINITY;
        value
    }

    /// Above zero more often than not.
    pub fn positive(&mut self) -> T {
        let value = self.x();
        if self.below(8) == 0 {
            value
        } else {
            value.abs()
        }
    }

    pub fn array<const N: usize>(&mut self) -> [T; N] {
        core::array::from_fn(|_| self.x())
    }

    pub fn arrays<const N: usize, const M: usize>(&mut self) -> [[T; N]; M] {
        core::array::from_fn(|_| self.array())
    }

    pub fn positives<const N: usize>(&mut self) -> [T; N] {
        core::array::from_fn(|_| self.positive())
    }

    pub fn numbers(&mut self, count: usize) -> Vec<T> {
        (0..count).map(|_| self.x()).collect()
    }

    /// Instants, increasing more often than not.
    pub fn times(&mut self, count: usize) -> Vec<T> {
        let mut times = self.numbers(count);
        if self.below(8) > 0 {
            for i in 1..count {
                times[i] = times[i - 1] + times[i].abs();
                self.sound &= times[i].is_finite();
            }
        }
        times
    }

    pub fn place(&self) -> String {
        format!("{}, pattern {}", self.name, self.pattern)
    }

    /// A result, `None` for an error. Nothing may be taken that is not finite.
    pub fn taken<V, E>(&self, result: Result<V, E>) -> Option<V> {
        if result.is_ok() {
            assert!(self.sound, "{}: taken though not finite", self.place());
        }
        result.ok()
    }

    pub fn finite(&self, values: &[T]) {
        for x in values {
            assert!(x.is_finite(), "{}: gave {x}", self.place());
        }
    }

    /// Not negative, perhaps infinite.
    pub fn bounds(&self, values: &[T]) {
        for x in values {
            assert!(*x >= T::zero(), "{}: gave {x}", self.place());
        }
    }

    /// Anything but NaN.
    pub fn ordered(&self, values: &[T]) {
        for x in values {
            assert!(
                x.partial_cmp(&T::zero()).is_some(),
                "{}: gave {x}",
                self.place()
            );
        }
    }

    pub fn unchanged<V: PartialEq + core::fmt::Debug, E>(
        &self,
        result: &Result<(), E>,
        now: &V,
        before: &V,
    ) {
        if result.is_err() {
            assert_eq!(now, before, "{}: an error changed it", self.place());
        }
    }
}
