//! A client in memory, whose tiles come so many a frame, at its own time: cold at first, converged at last.
//!
//! In: a baked city, a view a frame. Out: the frame's arrays, or its picture. Next: what compares consecutive pictures.

use crate::baked::Baked;
use anyhow::{Context, Result};
use insula_client::render::CpuAdapter;
use insula_protocol::{Subtree, TileKind, mesh_tile};
use insula_shaders::cpu::{hit_counts::hit_counts, raycast::Pixels};
use insula_viewer::{
    cache::{AtlasCache, InsertResult, pages_for},
    camera::View,
    decode::{DecodedTile, decode},
    frame::{FrameData, FrameInputs, RenderSettings},
    scene::{SceneTree, TileEvent, TileKey},
    select::{
        Selection, SelectionScratch, occlusion_feedback::OcclusionFeedback, select, shadow_casters::shadow_casters,
        transitions::Transitions,
    },
};
use std::time::Duration;

/// Memory for tiles.
const CACHE_BYTES: u64 = 512 << 20;

/// A client that knows a city's subtrees and has none of its tiles.
pub struct Cold<'a> {
    city: &'a Baked,
    tree: SceneTree,
    cache: AtlasCache,
    adapter: CpuAdapter,
    sight: OcclusionFeedback,
    /// What passes from one level of detail to another.
    pub fades: Transitions,
    scratch: SelectionScratch,
    /// The last frame's.
    pub selection: Selection,
    generation: u64,
    now: Duration,
}

impl<'a> Cold<'a> {
    /// Without a tile. `fades`: whether levels of detail fade into each other.
    pub fn new(city: &'a Baked, fades: bool) -> Result<Self> {
        let mut tree = SceneTree::new(city.manifest().clone());
        let now = Duration::ZERO;
        for (id, bytes) in city.store.subtrees().tiles() {
            tree.merge(&Subtree::decode(&bytes?).with_context(|| format!("subtree {id}"))?);
            come(&mut tree, TileKey::subtree(id), now);
        }
        let pages = pages_for(CACHE_BYTES);
        let mut made = Self {
            city,
            tree,
            cache: AtlasCache::new(pages),
            adapter: CpuAdapter::new(pages),
            sight: OcclusionFeedback::default(),
            fades: Transitions::default(),
            scratch: SelectionScratch::default(),
            selection: Selection::default(),
            generation: 0,
            now,
        };
        made.fades.set_enabled(fades);
        Ok(made)
    }

    /// Selects, lets at most `tiles` of what is missing come, and gives the frame `secs` after the last one; whether it may
    /// differ from that.
    pub fn frame(&mut self, view: &View, look: &RenderSettings, tiles: usize, secs: f64) -> Result<(FrameData, bool)> {
        self.turn(view);
        let wanted: Vec<TileKey> = self.selection.requests.iter().map(|wanted| wanted.key).take(tiles).collect();
        for key in wanted {
            self.fetch(key)?;
        }
        let changed = self.turn(view) || self.fades.fading_count() > 0;
        self.generation += u64::from(self.fades.step(&self.selection, &self.tree, secs));
        let casters =
            look.shadow_casting_sun().map(|sun| shadow_casters(view, sun, &self.tree, None)).unwrap_or_default();
        let drawn = FrameInputs {
            transitions: &self.fades,
            shadow_casters: &casters.nodes,
            generation: self.generation,
            error_px: 0.0,
        };
        let data = FrameData::new(drawn, &self.tree, &self.cache, view, look);
        Ok((data, changed || self.fades.fading_count() > 0))
    }

    fn turn(&mut self, view: &View) -> bool {
        let selection = select(view, &self.tree, &self.sight, &mut self.scratch);
        let changed = selection.draw_tiles != self.selection.draw_tiles;
        self.generation += u64::from(changed);
        self.selection = selection;
        changed
    }

    fn fetch(&mut self, key: TileKey) -> Result<()> {
        let place = if key.kind() == TileKind::Mesh { mesh_tile::archive_id(key.id, key.lod) } else { Some(key.id) };
        let place = place.with_context(|| format!("{key:?}"))?;
        let bytes = self.city.store.tile(key.kind(), place)?.with_context(|| format!("no {key:?}"))?;
        let packed = match decode(key, &bytes).with_context(|| format!("{key:?}"))? {
            DecodedTile::Packed(tile) => tile,
            DecodedTile::Subtree(_) => return Ok(()),
        };
        match self.cache.insert(key, packed, &mut self.adapter) {
            InsertResult::Inserted { evicted } if evicted.is_empty() => come(&mut self.tree, key, self.now),
            _ => anyhow::bail!("the view needs more memory than there is"),
        }
        Ok(())
    }

    /// Draws a frame, and learns what its rays hit.
    pub fn draw(&mut self, data: &FrameData) -> Pixels {
        let pixels = self.adapter.draw(data);
        let size_px = [pixels.width_px, pixels.height_px];
        if !self.sight.covers(data.query.generation, size_px) {
            let whole = self.selection.requests.is_empty();
            self.sight.update(&data.query, &hit_counts(&pixels.hit, data.nodes.len()), whole, &self.tree);
        }
        pixels
    }

    /// Whether nothing more will change while the view stays.
    pub fn is_at_rest(&self, size_px: [u32; 2]) -> bool {
        let looked = self.sight.covers(self.generation, size_px);
        self.selection.requests.is_empty() && self.fades.fading_count() == 0 && looked
    }
}

/// All that happens to a tile until it is there.
fn come(tree: &mut SceneTree, key: TileKey, now: Duration) {
    for event in [TileEvent::Want { now }, TileEvent::Start, TileEvent::Arrive, TileEvent::Upload] {
        tree.apply(key, event);
    }
}
