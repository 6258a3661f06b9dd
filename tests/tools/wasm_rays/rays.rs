//! Draws a scene that `rays --dump` has written, for `run.mjs`: on one thread, as a worker of the browser viewer does.

use insula_shaders::{
    cpu::{
        instruction_set::InstructionSet,
        raycast::{Sampling, SceneRef},
        render::render_with,
    },
    layout::FrameUniform,
};
use std::sync::{Mutex, PoisonError};

/// Words of the frame, the grid, the nodes, the summaries and the atlas.
static PARTS: Mutex<[Vec<u32>; 5]> = Mutex::new([const { Vec::new() }; 5]);

/// Makes room for a part of the scene. Returns its address, or 0 if there is no such part.
#[unsafe(no_mangle)]
pub extern "C" fn make_room(part: usize, words: usize) -> *mut u32 {
    let mut parts = PARTS.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(part) = parts.get_mut(part) else { return std::ptr::null_mut() };
    part.resize(words, 0);
    part.as_mut_ptr()
}

/// Draws the frame: in packets, or ray by ray. Returns the sum of its pixels' words; 0 if there is no frame.
#[unsafe(no_mangle)]
pub extern "C" fn draw(in_packets: bool) -> u32 {
    let parts = PARTS.lock().unwrap_or_else(PoisonError::into_inner);
    let [frame, grid, nodes, summaries, atlas] = &*parts;
    let Ok(frame) = bytemuck::try_from_bytes::<FrameUniform>(bytemuck::cast_slice(frame)) else { return 0 };
    let (grid, nodes) = (bytemuck::cast_slice(grid), bytemuck::cast_slice(nodes));
    let scene = SceneRef { frame, grid, nodes, summaries, atlas };
    let set = InstructionSet::best().filter(|_| in_packets);
    let pixels = render_with(&scene, set, Sampling::Full);
    pixels.colour.iter().fold(0, |sum: u32, word| sum.wrapping_mul(31).wrapping_add(*word))
}
