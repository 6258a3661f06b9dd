//! The ray-casters with the atlas that each reads: the CPU's in main memory, and with the feature `gpu` that of a device.
//!
//! They take pages by [`Upload`](crate::cache::Upload) and draw a [`FrameData`](crate::frame::FrameData).

mod adapter_info;
mod cpu;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(feature = "gpu")]
mod trial;

pub use adapter_info::AdapterInfo;
pub use cpu::CpuAdapter;
#[cfg(feature = "gpu")]
pub use gpu::{GpuAdapter, GpuDevice};
use insula_shaders::layout::FrameUniform;
use insula_shaders::translucency::MAX_MAPS;
#[cfg(feature = "gpu")]
pub use trial::TrialCity;

/// Which translucency maps an atlas holds, by their keys.
#[derive(Debug, Default)]
struct MadeMaps {
    keys: [u32; MAX_MAPS],
}

impl MadeMaps {
    /// Numbers of the frame's maps that the atlas does not hold. To be made before the frame is drawn.
    fn begin(&mut self, frame: &FrameUniform) -> Vec<usize> {
        let is_outdated =
            |number: &usize| frame.map_keys[*number] != 0 && frame.map_keys[*number] != self.keys[*number];
        let outdated: Vec<usize> = (0..MAX_MAPS).filter(is_outdated).collect();
        outdated.iter().for_each(|number| self.keys[*number] = frame.map_keys[*number]);
        outdated
    }
}
