//! What is added to the city: pages that are never evicted, and the nodes that are drawn from them.

use super::{AtlasCache, CachedMesh, PAGE_BYTES, Upload, upload_mesh};
use crate::additions::{AdditionError, PackedAddition};
use bytemuck::Zeroable;
use glam::DVec3;
use insula_shaders::layout::{ADDED_LEVEL, DrawNode, PAGE_WORDS};

#[derive(Debug, Default)]
pub(super) struct ResidentAdditions {
    /// With the world positions that they are relative to.
    meshes: Vec<(DVec3, CachedMesh)>,
    /// A page of zeros: columns without anything in them, from which these meshes have no occlusion.
    blank_page: u32,
    pages: u32,
    is_shown: bool,
}

impl AtlasCache {
    /// Keeps meshes of what is added to the city resident, and shows them. To be called once, before any tile is inserted. Fails if they
    /// take more than half of the cache.
    pub fn set_additions(
        &mut self,
        additions: Vec<PackedAddition>,
        upload: &mut impl Upload,
    ) -> Result<(), AdditionError> {
        let needed = 1 + additions.iter().map(|addition| addition.mesh.pages.len()).sum::<usize>();
        let too_large = || AdditionError::TooLarge { needed_mib: (needed as u64 * PAGE_BYTES).div_ceil(1 << 20) };
        if needed > self.pages.count() as usize / 2 {
            return Err(too_large());
        }
        let pages = self.pages.take(needed as u32).ok_or_else(too_large)?;
        let (blank, mut free) = pages.split_first().ok_or_else(too_large)?;
        upload.write_page(*blank, &[0; PAGE_WORDS]);
        let mut meshes = Vec::with_capacity(additions.len());
        for PackedAddition { corner, mut mesh } in additions {
            let (own, rest) = free.split_at(mesh.pages.len());
            free = rest;
            mesh.relocate(own);
            let objects = mesh.objects.take();
            meshes.push((corner, upload_mesh(mesh, own, upload)));
            self.keep_palette(objects, upload);
        }
        self.additions = ResidentAdditions { meshes, blank_page: *blank, pages: needed as u32, is_shown: true };
        self.peak_pages = self.peak_pages.max(self.pages.used());
        Ok(())
    }

    /// Shows or hides what is added.
    pub fn show_additions(&mut self, is_shown: bool) {
        self.additions.is_shown = is_shown;
    }

    /// Number of pages for tiles, free or not.
    pub(crate) fn tile_pages(&self) -> u32 {
        self.capacity_pages() - self.additions.pages
    }

    /// Adds the nodes of what is added to those of a frame. Returns the number of the first, and how many they are.
    pub(crate) fn add_nodes(&self, nodes: &mut Vec<DrawNode>, eye: DVec3) -> [u32; 2] {
        let ResidentAdditions { meshes, blank_page, is_shown, .. } = &self.additions;
        if !is_shown {
            return [0; 2];
        }
        let first = nodes.len() as u32;
        nodes.extend(meshes.iter().map(|(corner, mesh)| {
            let corner = (*corner - eye).as_vec3();
            DrawNode {
                corner: corner.to_array(),
                cell_m: 1.0,
                z_step_m: 1.0,
                z_lo: mesh.z_m[0],
                z_hi: mesh.z_m[1],
                pages: DrawNode::pages_and_quarters([*blank_page; 4], [0; 4]),
                level: ADDED_LEVEL,
                mesh: 1 + mesh.head_page * (PAGE_WORDS / 4) as u32,
                mesh_z_m: corner.z,
                ..DrawNode::zeroed()
            }
        }));
        [first, meshes.len() as u32]
    }
}
