//! A client without network and clock: each step loads a given number of tiles and advances by a given time.

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

const CACHE_BYTES: u64 = 512 << 20;

/// Knows the city's subtrees from the start, but has no tiles.
pub struct SteppedClient<'a> {
    city: &'a Baked,
    tree: SceneTree,
    cache: AtlasCache,
    adapter: CpuAdapter,
    feedback: OcclusionFeedback,
    pub transitions: Transitions,
    scratch: SelectionScratch,
    pub selection: Selection,
    generation: u64,
    now: Duration,
}

impl<'a> SteppedClient<'a> {
    /// `cross_fades`: whether levels of detail are cross-faded.
    pub fn new(city: &'a Baked, transitions: bool) -> Result<Self> {
        let mut tree = SceneTree::new(city.manifest().clone());
        let now = Duration::ZERO;
        for (id, bytes) in city.store.subtrees().tiles() {
            tree.merge(&Subtree::decode(&bytes?).with_context(|| format!("subtree {id}"))?);
            make_resident(&mut tree, TileKey::subtree(id), now);
        }
        let pages = pages_for(CACHE_BYTES);
        let mut client = Self {
            city,
            tree,
            cache: AtlasCache::new(pages),
            adapter: CpuAdapter::new(pages),
            feedback: OcclusionFeedback::default(),
            transitions: Transitions::default(),
            scratch: SelectionScratch::default(),
            selection: Selection::default(),
            generation: 0,
            now,
        };
        client.transitions.set_enabled(transitions);
        Ok(client)
    }

    /// Selects, loads at most `tiles` missing tiles, and returns the frame `secs` after the last one, and whether it may differ
    /// from that.
    pub fn frame(
        &mut self,
        view: &View,
        settings: &RenderSettings,
        tiles: usize,
        secs: f64,
    ) -> Result<(FrameData, bool)> {
        self.select_tiles(view);
        let wanted: Vec<TileKey> = self.selection.requests.iter().map(|wanted| wanted.key).take(tiles).collect();
        for key in wanted {
            self.fetch(key)?;
        }
        let changed = self.select_tiles(view) || self.transitions.fading_count() > 0;
        self.generation += u64::from(self.transitions.step(&self.selection, &self.tree, secs));
        let casters =
            settings.shadow_casting_sun().map(|sun| shadow_casters(view, sun, &self.tree, None)).unwrap_or_default();
        let drawn = FrameInputs {
            transitions: &self.transitions,
            shadow_casters: &casters.nodes,
            generation: self.generation,
            error_px: 0.0,
        };
        let data = FrameData::new(drawn, &self.tree, &self.cache, view, settings);
        Ok((data, changed || self.transitions.fading_count() > 0))
    }

    fn select_tiles(&mut self, view: &View) -> bool {
        let selection = select(view, &self.tree, &self.feedback, &mut self.scratch);
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
            DecodedTile::Subtree(_) | DecodedTile::Visibility(_) => return Ok(()),
        };
        match self.cache.insert(key, packed, &mut self.adapter) {
            InsertResult::Inserted { evicted } if evicted.is_empty() => make_resident(&mut self.tree, key, self.now),
            _ => anyhow::bail!("the view needs more memory than the cache has"),
        }
        Ok(())
    }

    /// Draws a frame and records which nodes its rays hit.
    pub fn draw(&mut self, data: &FrameData) -> Pixels {
        let pixels = self.adapter.draw(data);
        let size_px = [pixels.width_px, pixels.height_px];
        if !self.feedback.covers(data.query.generation, size_px) {
            let is_complete = self.selection.requests.is_empty();
            self.feedback.update(&data.query, &hit_counts(&pixels.hit, data.nodes.len()), is_complete, &self.tree);
        }
        pixels
    }

    /// Whether nothing will change while the view stays the same.
    pub fn is_at_rest(&self, size_px: [u32; 2]) -> bool {
        let has_feedback = self.feedback.covers(self.generation, size_px);
        self.selection.requests.is_empty() && self.transitions.fading_count() == 0 && has_feedback
    }
}

/// Brings a tile to the resident state.
fn make_resident(tree: &mut SceneTree, key: TileKey, now: Duration) {
    for event in [TileEvent::Want { now }, TileEvent::Start, TileEvent::Arrive, TileEvent::Upload] {
        tree.apply(key, event);
    }
}
