//! A part of a wall with whole bays and storeys.

use super::pattern::CELLS;

/// A rectangle of a wall with whole bays and storeys. Lengths are along the wall and upwards, in metres.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FacadeZone {
    /// Ends along the wall, at which bays begin and end.
    pub(super) along_m: [f64; 2],
    /// Where faces are cut: a little beyond the storeys if the wall has nothing else there.
    pub(super) z_m: [f64; 2],
    pub(super) bays: u32,
    /// The first storey with windows, and the one after the last.
    pub(super) storeys: [u32; 2],
    /// Height of the floor of storey 0.
    pub(super) base_m: f64,
    pub(super) storey_m: f64,
}

impl FacadeZone {
    /// Bays from the zone's start and storeys from the floor of the first; the plinth below it is negative.
    pub(super) fn uv(&self, along_m: f64, z_m: f64) -> [f32; 2] {
        let share = (along_m - self.along_m[0]) / (self.along_m[1] - self.along_m[0]);
        let cells = [share * f64::from(self.bays), (z_m - self.base_m) / self.storey_m];
        cells.map(|cells| (cells / f64::from(CELLS)) as f32)
    }

    pub(super) fn windows(&self) -> u64 {
        u64::from(self.bays).saturating_mul(u64::from(self.storeys[1] - self.storeys[0]))
    }
}
