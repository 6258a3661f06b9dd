//! The city's file `thumbnail.jpg`: its first view as viewers show it, for lists and previews of links.
//!
//! Drawn by the CPU ray-caster from the tiles that the view asks for, in a fixed amount of memory: the cost is that of the picture, not
//! that of the city. All rays are drawn by the definition, so that the picture does not depend on the machine's instructions.

use super::files::write_synced;
use super::tile_bytes::TileContent;
use super::tile_tree::TileTree;
use crate::error::BakeError;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use insula_archive::city::open_archive;
use insula_archive::limits::MAX_OPENING_TIME;
pub(super) use insula_protocol::route::THUMBNAIL_FILE as FILE_NAME;
use insula_protocol::route::THUMBNAIL_PX;
use insula_protocol::{Manifest, TileKind};
use insula_shaders::cpu::instruction_set::InstructionSet;
use insula_shaders::cpu::raycast::{Pixels, Sampling};
use insula_shaders::cpu::render::render_with;
use insula_shaders::layout::Shading;
use insula_viewer::cache::{AtlasCache, InsertResult, pages_for, slots_for};
use insula_viewer::camera::{Camera, View};
use insula_viewer::decode::{DecodedTile, decode};
use insula_viewer::frame::{FrameData, FrameInputs, RenderSettings};
use insula_viewer::render::CpuAdapter;
use insula_viewer::scene::{SceneTree, TileEvent, TileKey};
use insula_viewer::select::occlusion_feedback::OcclusionFeedback;
use insula_viewer::select::shadow_casters::{ShadowCasters, shadow_casters};
use insula_viewer::select::transitions::Transitions;
use insula_viewer::select::{Selection, SelectionScratch, select};
use insula_viewer::sun::{Daylight, SunOptions};
use rayon::ThreadPool;
use rayon::prelude::*;
use std::collections::HashSet;
use std::path::Path;
use std::time::{Duration, Instant};

/// The picture of cities that were baked earlier: seen from straight above.
pub(super) const OLD_FILE_NAME: &str = "thumbnail.png";
/// A comment in the file, by which it is told from a picture that somebody put in its place, whatever the encoder writes around it.
const MARK: &[u8] = b"\xff\xfe\0\x11drawn by Insula";
/// Bytes of the file in which the comment is.
pub(super) const HEAD_BYTES: usize = 64;
/// How pictures begin that have no comment.
const UNMARKED: &[u8] = b"\xff\xd8\xff\xe0\0\x10JFIF\0\x01\x02\0\0\x01\0\x01\0\0\xff\xc0";
/// How that of earlier cities begins.
pub(super) const OLD_SIGNATURE: &[u8] = b"\x89PNG";

/// Rays along a pixel's side.
const SAMPLES: u32 = 2;
/// Quality of the JPEG file, 1 to 100.
const QUALITY: u8 = 85;
/// Memory for tiles.
const CACHE_BYTES: u64 = 160 << 20;
/// Most times that missing tiles are read. Each time the next levels are found; a city has 24 at most.
const MAX_PASSES: u32 = 64;
/// Tiles that are decoded at once.
const TILES_AT_ONCE: usize = 64;

/// Writes the picture into `folder`, which has the subtrees of the city; those that it shares with other cities are in folders in `beside`.
/// Returns its size in bytes. Fails with the reason if a tile cannot be read, or the file not be written.
pub(super) fn write(
    [folder, beside]: [&Path; 2],
    city: &TileTree,
    tiles: &mut (dyn TileContent + Send),
    manifest: &Manifest,
    pool: &ThreadPool,
) -> Result<u64, String> {
    let deadline = Instant::now() + MAX_OPENING_TIME;
    let subtrees = open_archive(folder, beside, manifest.shared(), TileKind::Subtree, deadline);
    let subtrees = subtrees.map_err(|error| error.to_string())?;
    let text = |error: BakeError| error.to_string();
    let mut read = |key: TileKey| {
        let missing = || "it is not in the city".to_owned();
        match key.kind() {
            TileKind::Subtree => {
                let tile = subtrees.tile(key.id).map_err(|error| error.to_string())?;
                Ok(tile.map(Vec::from))
            }
            TileKind::Mesh => {
                let mesh = city.mesh(key.id).iter().find(|mesh| mesh.lod == key.lod).ok_or_else(missing)?;
                tiles.mesh(mesh).map(Some).map_err(text)
            }
            _ => tiles.tile(city.get(key.id).ok_or_else(missing)?).map(Some).map_err(text),
        }
    };
    let mut picture = Picture::new(manifest, !city.meshes().is_empty());
    let pixels = pool.install(|| {
        picture.load(&mut read)?;
        Ok::<_, String>(picture.draw())
    })?;
    let jpeg = encode(&pixels).map_err(|error| error.to_string())?;
    write_synced(&folder.join(FILE_NAME), &jpeg).map_err(text)?;
    Ok(jpeg.len() as u64)
}

fn encode(pixels: &Pixels) -> image::ImageResult<Vec<u8>> {
    let rgb: Vec<u8> = pixels.colour.iter().flat_map(|colour| colour.to_le_bytes().into_iter().take(3)).collect();
    let mut jpeg = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, QUALITY);
    encoder.encode(&rgb, pixels.width_px, pixels.height_px, ExtendedColorType::Rgb8)?;
    Ok(marked(jpeg))
}

/// A JPEG file with [`MARK`] behind its first segment, which readers expect at its place.
fn marked(mut jpeg: Vec<u8>) -> Vec<u8> {
    let first = match jpeg.get(2..6) {
        Some([0xff, 0xe0, high, low]) => 2 + usize::from(u16::from_be_bytes([*high, *low])),
        _ => 0,
    };
    let at = (2 + first).min(jpeg.len());
    drop(jpeg.splice(at..at, MARK.iter().copied()));
    jpeg
}

/// Whether a file of this name that begins so is a picture of a bake, or the start of one.
pub(super) fn is_own(head: &[u8]) -> bool {
    let is_marked = || head.windows(MARK.len()).any(|bytes| bytes == MARK);
    head.starts_with(UNMARKED) || UNMARKED.starts_with(head) || is_marked()
}

/// The first view of a city, and the tiles that it asks for.
struct Picture {
    view: View,
    settings: RenderSettings,
    tree: SceneTree,
    cache: AtlasCache,
    adapter: CpuAdapter,
    scratch: SelectionScratch,
    selection: Selection,
    casters: ShadowCasters,
}

impl Picture {
    /// The view without tiles, in the light that viewers begin with.
    fn new(manifest: &Manifest, has_meshes: bool) -> Self {
        // A picture from above does not need the sets of what streets see.
        let manifest = Manifest { street_sets: false, ..manifest.clone() };
        let [width_px, height_px] = THUMBNAIL_PX;
        let pages = pages_for(CACHE_BYTES);
        // The rest is for what casts shadows into the view.
        let budget_pages = pages / 4 * 3;
        let view = View {
            camera: Camera::overview(&manifest, f64::from(width_px) / f64::from(height_px)),
            width_px,
            height_px,
            tau_px: 1.0,
            switching: None,
            budget_pages,
            budget_nodes: slots_for(budget_pages),
        };
        Self {
            view,
            settings: Daylight::new(&SunOptions::default(), &manifest).render_settings(Shading::Lit, SAMPLES),
            tree: SceneTree::new(manifest).with_meshes(has_meshes),
            cache: AtlasCache::new(pages),
            adapter: CpuAdapter::new(pages),
            scratch: SelectionScratch::default(),
            selection: Selection::default(),
            casters: ShadowCasters::default(),
        }
    }

    /// Reads tiles until the view lacks none, or the memory is full. A view asks for the subtrees below its eye before it knows whether
    /// there are some: where land is plain, there are none. Fails with the reason if a tile cannot be read or decoded.
    fn load(&mut self, read: &mut impl FnMut(TileKey) -> Result<Option<Vec<u8>>, String>) -> Result<(), String> {
        let of =
            |key: TileKey, reason: String| format!("{} {}, LOD {}: {reason}", key.kind().file_name(), key.id, key.lod);
        for _ in 0..MAX_PASSES {
            let missing = self.select();
            if missing.is_empty() {
                return Ok(());
            }
            for keys in missing.chunks(TILES_AT_ONCE) {
                let read = |key: &TileKey| Ok((*key, read(*key).map_err(|reason| of(*key, reason))?));
                let found = keys.iter().map(read).collect::<Result<Vec<_>, String>>()?;
                let decode = |(key, bytes): &(TileKey, Option<Vec<u8>>)| {
                    bytes.as_ref().map(|bytes| decode(*key, bytes)).transpose()
                };
                let decoded: Vec<_> = found.par_iter().map(decode).collect();
                for (key, tile) in keys.iter().zip(decoded) {
                    let Some(tile) = tile.map_err(|error| of(*key, error.to_string()))? else {
                        self.apply(*key, &[TileEvent::Refuse]);
                        continue;
                    };
                    if !self.take_in(*key, tile) {
                        self.select();
                        return Ok(());
                    }
                }
            }
        }
        Ok(())
    }

    /// Selects what the view shows. Returns the tiles that are missing.
    fn select(&mut self) -> Vec<TileKey> {
        self.selection = select(&self.view, &self.tree, &OcclusionFeedback::default(), &mut self.scratch);
        let stats = &self.selection.stats;
        let view = View {
            budget_pages: self.cache.capacity_pages().saturating_sub(stats.pages),
            budget_nodes: slots_for(self.cache.capacity_pages()).saturating_sub(stats.visited),
            tau_px: stats.tau_px,
            ..self.view
        };
        let sun = self.settings.shadow_casting_sun();
        self.casters = sun.map(|sun| shadow_casters(&view, sun, &self.tree, None)).unwrap_or_default();
        let mut keys = HashSet::new();
        let wanted = self.selection.requests.iter().chain(&self.casters.requests).map(|request| request.key);
        wanted.filter(|key| keys.insert(*key)).collect()
    }

    /// Takes in a decoded tile. Returns whether there was room for it.
    fn take_in(&mut self, key: TileKey, tile: DecodedTile) -> bool {
        match tile {
            DecodedTile::Subtree(subtree) => self.tree.merge(&subtree),
            DecodedTile::Packed(tile) => match self.cache.insert(key, tile, &mut self.adapter) {
                InsertResult::Inserted { .. } => {}
                InsertResult::Full { .. } => return false,
            },
            DecodedTile::Visibility(_) => {}
        }
        self.apply(key, &[TileEvent::Arrive, TileEvent::Upload]);
        true
    }

    /// Applies what happened to a tile that was requested.
    fn apply(&mut self, key: TileKey, events: &[TileEvent]) {
        for event in [TileEvent::Want { now: Duration::ZERO }, TileEvent::Start].iter().chain(events) {
            self.tree.apply(key, *event);
        }
    }

    /// Draws the view with the tiles that are there.
    fn draw(&mut self) -> Pixels {
        let mut transitions = Transitions::default();
        transitions.step(&self.selection, &self.tree, 0.0);
        let inputs = FrameInputs {
            transitions: &transitions,
            shadow_casters: &self.casters.nodes,
            generation: 0,
            error_px: self.selection.stats.visible_error_px,
        };
        let data = FrameData::new(inputs, &self.tree, &self.cache, &self.view, &self.settings);
        self.adapter.make_maps(&data.frame, &data.grid, &data.nodes);
        render_with(&self.adapter.scene_of(&data), InstructionSet::best(), Sampling::Full)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_bakes_are_known_whatever_the_encoder_writes() {
        let mut jpeg = Vec::new();
        let encoded = JpegEncoder::new(&mut jpeg).encode(&[9; 3 * 64], 8, 8, ExtendedColorType::Rgb8);
        encoded.unwrap();
        let own = marked(jpeg);
        assert!(is_own(&own[..HEAD_BYTES]) && is_own(UNMARKED) && is_own(&own[..10]));
        assert_eq!(image::load_from_memory(&own).unwrap().width(), 8);
        let other_encoder = marked(b"\xff\xd8\xff\xdb\0\x43 tables".to_vec());
        assert!(is_own(&other_encoder) && other_encoder.starts_with(b"\xff\xd8\xff\xfe"));
        assert!(!is_own(b"\xff\xd8\xff\xe1\0\x20Exif holiday"));
    }

    #[test]
    fn tiles_that_do_not_exist_are_asked_for_once() {
        let mut picture = Picture::new(&insula_test_support::small_city::manifest("city"), false);
        let mut asked = Vec::new();
        let mut nothing = |key| {
            asked.push(key);
            Ok(None)
        };
        picture.load(&mut nothing).unwrap();
        let distinct: HashSet<TileKey> = asked.iter().copied().collect();
        assert!(!asked.is_empty() && distinct.len() == asked.len(), "{asked:?}");
    }
}
