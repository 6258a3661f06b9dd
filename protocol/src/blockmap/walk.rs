//! The way over a map's values that writing and reading share.
//!
//! In: a [`BitCoder`] and a map. Out: what the coder made of it, and the map as a reader sees it. Next: `encode` and `decode`
//! put a tile around it.

use super::{
    BlockMap, COLUMNS, MAX_TEXELS, Z_CODE_MAX,
    appearance::{self, Loss},
    flag, geometry, strip_rows, walls,
};
use crate::{codec::range::BitCoder, error::DecodeError};

impl BlockMap {
    /// Hands all columns to `coder`, in the order of the format. A coder that writes finds them in the map and leaves there
    /// what a reader will see; for one that reads the map is [`BlockMap::empty`]. Errors: heights or strips that no map has.
    pub fn walk<C: BitCoder>(&mut self, coder: &mut C, loss: Loss) -> Result<(), DecodeError> {
        geometry::columns(coder, self);
        walls::exposed(coder, self);
        check_strips(self)?;
        let steps = walls::facades(self);
        walls::walls(coder, self, &steps);
        appearance::code(coder, self, &steps, loss);
        Ok(())
    }
}

/// Heights and the number of strip texels; checked before any is allocated.
fn check_strips(map: &BlockMap) -> Result<(), DecodeError> {
    let mut sum = 0;
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
        if map.z_min[i] >= map.z_max[i] || map.z_max[i] > Z_CODE_MAX {
            return Err(DecodeError::Invalid("a column's heights are turned around or out of range"));
        }
        if map.flags[i] & flag::EXPOSED != 0 {
            sum += usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1);
        }
    }
    if sum > MAX_TEXELS {
        let (found, limit) = (sum as u64, MAX_TEXELS as u64);
        return Err(DecodeError::Limit { what: "the number of strip texels", found, limit });
    }
    Ok(())
}
