//! Azimuths of walls: their coding, and their directions as integers.

use crate::codec::range::{BitCoder, BitModel, NumberModel};

/// Number of recent azimuths that can be referred to by their position in a list.
const RECENT: usize = 16;

/// Cosines of the first quarter turn of azimuths, in 1/16384. A table, so that all machines agree.
#[rustfmt::skip]
const COSINE: [i16; 65] = [
    16384, 16379, 16364, 16340, 16305, 16261, 16207, 16143, 16069, 15986, 15893, 15791, 15679,
    15557, 15426, 15286, 15137, 14978, 14811, 14635, 14449, 14256, 14053, 13842, 13623, 13395,
    13160, 12916, 12665, 12406, 12140, 11866, 11585, 11297, 11003, 10702, 10394, 10080, 9760,
    9434, 9102, 8765, 8423, 8076, 7723, 7366, 7005, 6639, 6270, 5897, 5520, 5139,
    4756, 4370, 3981, 3590, 3196, 2801, 2404, 2006, 1606, 1205, 804, 402, 0,
];

/// The unit vector of an azimuth in 1/16384.
pub(super) fn direction(azimuth: u8) -> [i32; 2] {
    let cosine = |azimuth: u8| {
        let from_axis = if azimuth > 128 { 256 - usize::from(azimuth) } else { usize::from(azimuth) };
        if from_axis > 64 { -i32::from(COSINE[128 - from_axis]) } else { i32::from(COSINE[from_axis]) }
    };
    [cosine(azimuth), cosine(azimuth.wrapping_sub(64))]
}

/// Models of azimuths. Where there are two, the first is for a column's own wall and the second for a corner's.
#[derive(Default)]
pub(super) struct AzimuthModels {
    nearby: [[BitModel; 3]; 2],
    is_recent: [BitModel; 2],
    recent: [[BitModel; RECENT - 1]; 2],
    turn: [NumberModel; 2],
    /// Recent azimuths, the latest first.
    list: Vec<u8>,
}

impl AzimuthModels {
    /// Codes an azimuth: as one of `nearby`, else as a recent one, else as a turn from the latest. For a corner, `own`
    /// is the azimuth of the column's own wall, which the other wall cannot have.
    pub(super) fn code<C: BitCoder>(
        &mut self,
        coder: &mut C,
        nearby: impl Iterator<Item = u8>,
        own: Option<u8>,
        value: u8,
    ) -> u8 {
        let is_corner = usize::from(own.is_some());
        for (k, azimuth) in nearby.filter(|azimuth| Some(*azimuth) != own).enumerate() {
            if coder.bit(&mut self.nearby[is_corner][k.min(2)], value == azimuth) {
                return azimuth;
            }
        }
        let found = self.list.iter().position(|azimuth| *azimuth == value);
        if coder.bit(&mut self.is_recent[is_corner], found.is_some()) {
            let at = coder.choice(&mut self.recent[is_corner], found.unwrap_or(0) as u32) as usize;
            let at = at.min(self.list.len().saturating_sub(1));
            let azimuth = self.list.get(at).copied().unwrap_or_default();
            if let Some(front) = self.list.get_mut(..=at) {
                front.rotate_right(1);
            }
            return azimuth;
        }
        let latest = self.list.first().copied().unwrap_or(0);
        let turn = coder.number(&mut self.turn[is_corner], i32::from(value.wrapping_sub(latest) as i8));
        let azimuth = latest.wrapping_add(turn as u8);
        self.list.truncate(RECENT - 1);
        self.list.insert(0, azimuth);
        azimuth
    }
}
