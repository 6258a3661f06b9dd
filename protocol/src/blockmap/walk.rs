//! The walk over a map's values that writing and reading share. It defines the order of the format.

use super::texel_coder::QuantisationSteps;
use super::{
    BlockMap, COLUMNS, Z_CODE_MAX, appearance, bottoms, check_texel_limit, facades, flag, strip_rows, tops, walls,
};
use crate::codec::range::BitCoder;
use crate::error::DecodeError;

impl BlockMap {
    /// Passes all columns to `coder`. A writing coder finds them in the map and leaves there what a reader will see;
    /// for a reading coder the map must be [`BlockMap::empty`]. Fails on inverted or excessive heights, and on more
    /// than [`MAX_TEXELS`](super::MAX_TEXELS) strip texels.
    pub fn walk<C: BitCoder>(&mut self, coder: &mut C, steps: QuantisationSteps) -> Result<(), DecodeError> {
        let column_tops = tops::code(coder, self);
        bottoms::code(coder, self, &column_tops);
        facades::code_exposed(coder, self);
        check_heights(self)?;
        let facade = facades::facade_order(self);
        walls::code(coder, self, &facade);
        appearance::code(coder, self, &facade, steps);
        Ok(())
    }
}

/// Checks heights and the number of strip texels before memory is allocated for these.
fn check_heights(map: &BlockMap) -> Result<(), DecodeError> {
    let mut texels = 0;
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
        if map.z_min[i] >= map.z_max[i] || map.z_max[i] > Z_CODE_MAX {
            return Err(DecodeError::Invalid("a column's heights are inverted or out of range"));
        }
        if map.flags[i] & flag::EXPOSED != 0 {
            texels += usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1);
        }
    }
    check_texel_limit(texels)
}
