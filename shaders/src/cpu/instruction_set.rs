//! Instruction sets for which the packets of rays are compiled.

use fearless_simd::Level;

/// An instruction set for which packets are compiled.
#[derive(Debug, Clone, Copy)]
pub struct InstructionSet(Level);

impl InstructionSet {
    /// The best one of this machine; `None` where the scalar code is used.
    pub fn best() -> Option<Self> {
        Self::all().into_iter().next()
    }

    /// All that this machine has, the best first.
    pub fn all() -> Vec<Self> {
        let levels: &[Option<Level>] = &[
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Level::new().as_avx512().map(Level::Avx512),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Level::new().as_avx2().map(Level::Avx2),
            #[cfg(target_arch = "aarch64")]
            Level::new().as_neon().map(Level::Neon),
            #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
            Level::new().as_wasm_simd128().map(Level::WasmSimd128),
        ];
        levels.iter().flatten().copied().map(Self).collect()
    }

    pub(super) fn level(self) -> Level {
        self.0
    }

    /// Its name and number of lanes.
    pub fn name(self) -> &'static str {
        // Some machines have one instruction set.
        #[allow(unreachable_patterns)]
        match self.0 {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Level::Avx512(_) => "AVX-512, 16 rays",
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Level::Avx2(_) => "AVX2, 8 rays",
            #[cfg(target_arch = "aarch64")]
            Level::Neon(_) => "NEON, 4 rays",
            _ => "4 rays",
        }
    }
}
