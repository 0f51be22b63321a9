//! The one place where a vector path is chosen.
//!
//! A kernel is written once over [`pulp::Simd`] and runs as AVX-512, AVX2 + FMA,
//! NEON or plain scalars, whichever this CPU has. Tests run a kernel on every
//! path of the machine they are on ([`Path::available`]) and compare.

/// The vector paths a kernel can be run on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// The widest the CPU has.
    Best,
    /// 8 lanes of f64 (x86-64-v4).
    Avx512,
    /// 4 lanes of f64 with fused multiply-add (x86-64-v3).
    Avx2,
    /// One lane: the reference the others are tested against.
    Plain,
}

impl Path {
    /// The paths that this CPU can run, widest first, without `Best`.
    pub fn available() -> impl Iterator<Item = Self> {
        [Self::Avx512, Self::Avx2, Self::Plain]
            .into_iter()
            .filter(|path| path.is_available())
    }

    fn is_available(self) -> bool {
        match self {
            Self::Best | Self::Plain => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => pulp::x86::V4::try_new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => pulp::x86::V3::try_new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
        }
    }

    /// Runs a kernel on this path; on the best one where the CPU lacks it.
    #[inline]
    pub fn run<K: pulp::WithSimd>(self, kernel: K) -> K::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                if let Some(simd) = pulp::x86::V4::try_new() {
                    return simd.vectorize(|| kernel.with_simd(simd));
                }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                if let Some(simd) = pulp::x86::V3::try_new() {
                    return simd.vectorize(|| kernel.with_simd(simd));
                }
            }
            Self::Plain => return kernel.with_simd(pulp::Scalar::new()),
            _ => {}
        }
        pulp::Arch::new().dispatch(kernel)
    }
}
