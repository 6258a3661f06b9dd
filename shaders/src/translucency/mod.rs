//! Translucency of stones by translucent shadow maps (Dachsbacher and Stamminger 2003; Mischitelli 2007, chapter 5).
//!
//! A map is an orthographic picture of a landmark from the sun: for each texel how much light enters there, the depth and the
//! normal of the surface. [`Dipole`] says how much of the light that enters at one point leaves at another.
//! [`crate::cpu::translucency`] makes maps and gathers light from them.

mod dipole;
mod map;

pub use dipole::Dipole;
pub(crate) use map::{COARSEST_PX, OCCUPIED};
pub use map::{
    FAST_TAPS, FINE_TAPS, MAP_WORDS, MAX_MAP_PX, MAX_MAPS, MIN_MAP_PX, MapPlace, TranslucencyMap, level_words,
    map_words,
};
