//! The tiles of all levels, from sorted triangles: of a whole city, or of a region of one.

use super::context::{FinishedTiles, TileContext};
use super::far_land::FarLand;
use super::hashed::HashedPartition;
use super::leaves::LeafBaker;
use super::parents;
use crate::error::BakeError;
use crate::report::StageClock;
use crate::scene::scratch_scene::ScratchScene;
use crate::write::tile_pack::StoredTile;
use std::ops::Range;

/// Bakes the leaves of a partition with their meshes, then the levels above, up to `top`. `land` gives the land around these leaves. Takes
/// the city to free it early. Fails as `land` does, or with the first error of a tile.
pub(super) fn bake<'l>(
    context: &TileContext<'_>,
    clock: &mut StageClock,
    city: ScratchScene,
    HashedPartition { partition, hashes }: &HashedPartition,
    top: u8,
    land: impl FnOnce(&[StoredTile]) -> Result<Option<FarLand<'l>>, BakeError>,
) -> Result<FinishedTiles, BakeError> {
    let (mut tiles, depth) = (FinishedTiles::new(context), context.grid.depth);
    let packs = clock.time("sample", || LeafBaker { context, city: &city, partition }.bake_all(hashes))?;
    drop(city);
    tiles.add_level(depth, packs);
    let land = land(tiles.tree.level(depth))?;
    bake_parents(context, clock, land.as_ref(), top..depth, &mut tiles)?;
    Ok(tiles)
}

/// Bakes levels from the tiles of the one below them. Fails with the first error of a tile.
pub(super) fn bake_parents(
    context: &TileContext<'_>,
    clock: &mut StageClock,
    land: Option<&FarLand<'_>>,
    levels: Range<u8>,
    tiles: &mut FinishedTiles,
) -> Result<(), BakeError> {
    for level in levels.rev() {
        let bake = || parents::bake_level(context, tiles, land, level);
        let packs = clock.time(&format!("level {level}"), bake)?;
        tiles.add_level(level, packs);
    }
    Ok(())
}
