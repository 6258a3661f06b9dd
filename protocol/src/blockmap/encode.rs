//! A V-BlockMap's bytes. The sections are described byte by byte in `docs/formats.md`.

use super::{BlockMap, COLUMNS, Outer, flag, predict};
use crate::{
    error::DecodeError,
    texel::Texel,
    tile::{Kind, TileWriter},
};

/// Section tags.
pub(super) mod tag {
    pub(in super::super) const META: u8 = 1;
    pub(in super::super) const FLAGS: u8 = 2;
    pub(in super::super) const Z_MAX: u8 = 3;
    pub(in super::super) const Z_MIN: u8 = 4;
    pub(in super::super) const GAPS: u8 = 5;
    pub(in super::super) const NORMALS: u8 = 6;
    pub(in super::super) const AZIMUTHS: u8 = 7;
    pub(in super::super) const ROOF_RGB: u8 = 8;
    pub(in super::super) const ROOF_AO: u8 = 9;
    pub(in super::super) const STRIP_RGB: u8 = 10;
    pub(in super::super) const STRIP_AO: u8 = 11;
    pub(in super::super) const CLIP_OFFSETS: u8 = 12;
    pub(in super::super) const OUTER_Z: u8 = 13;
    pub(in super::super) const OUTER_RGB: u8 = 14;
    pub(in super::super) const OUTER_AO: u8 = 15;
    pub(in super::super) const CORNERS: u8 = 16;
}

impl BlockMap {
    /// The tile's bytes; the same map gives the same bytes.
    pub fn encode(&self) -> Result<Vec<u8>, DecodeError> {
        self.check()?;
        let mut writer = TileWriter::new(Kind::BlockMap, self.id);
        let mut meta = Vec::with_capacity(9);
        meta.extend_from_slice(&self.cell_m.to_le_bytes());
        meta.extend_from_slice(&self.z_base_cells.to_le_bytes());
        meta.push(self.z_shift);
        writer.section(tag::META, &meta)?;
        writer.section(tag::FLAGS, &self.flags)?;
        let occupied: Vec<usize> = (0..COLUMNS).filter(|i| self.flags[*i] & flag::OCCUPIED != 0).collect();
        writer.section(tag::Z_MAX, &self.residuals(&self.z_max, &occupied))?;
        writer.section(tag::Z_MIN, &self.residuals(&self.z_min, &occupied))?;
        let gaps: Vec<u16> = self.gaps.iter().flatten().copied().collect();
        let mut bytes = Vec::new();
        predict::push_planes(&mut bytes, &gaps);
        writer.section(tag::GAPS, &bytes)?;
        let normals: Vec<u16> = occupied.iter().map(|i| self.roof_normal[*i]).collect();
        bytes.clear();
        predict::push_planes(&mut bytes, &normals);
        writer.section(tag::NORMALS, &bytes)?;
        let exposed = occupied.iter().filter(|i| self.flags[**i] & flag::EXPOSED != 0);
        let azimuths: Vec<u8> = exposed.map(|i| self.wall_azimuth[*i]).collect();
        writer.section(tag::AZIMUTHS, &azimuths)?;
        let roof: Vec<Texel> = occupied.iter().map(|i| self.roof[*i]).collect();
        writer.section(tag::ROOF_RGB, &colours(&roof))?;
        writer.section(tag::ROOF_AO, &occlusions(&roof))?;
        writer.section(tag::STRIP_RGB, &colours(&self.strips))?;
        writer.section(tag::STRIP_AO, &occlusions(&self.strips))?;
        let offsets: Vec<u8> = self.clips.iter().map(|clip| clip.offset as u8).collect();
        writer.section(tag::CLIP_OFFSETS, &offsets)?;
        // What the corner is, then the azimuths and offsets of those that are one.
        let mut corners: Vec<u8> =
            self.clips.iter().map(|clip| clip.corner.map_or(0, |c| 1 + u8::from(c.concave))).collect();
        corners.extend(self.clips.iter().filter_map(|clip| clip.corner).flat_map(|c| [c.azimuth, c.offset as u8]));
        writer.section(tag::CORNERS, &corners)?;
        // A height of zero, which nothing beyond a wall has, stands for an empty other side.
        let outer: Vec<Outer> = self.clips.iter().map(|clip| clip.outer.unwrap_or_default()).collect();
        bytes.clear();
        predict::push_planes(&mut bytes, &outer.iter().map(|o| o.z).collect::<Vec<_>>());
        writer.section(tag::OUTER_Z, &bytes)?;
        let roof: Vec<Texel> = outer.iter().filter(|o| o.z != 0).map(|o| o.roof).collect();
        writer.section(tag::OUTER_RGB, &colours(&roof))?;
        writer.section(tag::OUTER_AO, &occlusions(&roof))?;
        writer.finish()
    }

    fn residuals(&self, values: &[u16], occupied: &[usize]) -> Vec<u8> {
        let known = |j: usize| self.flags[j] & flag::OCCUPIED != 0;
        let mut last = 0;
        let mut out = Vec::with_capacity(occupied.len());
        for &i in occupied {
            out.push(predict::residual(values[i], predict::guess(values, known, i, last)));
            last = values[i];
        }
        let mut bytes = Vec::with_capacity(out.len() * 2);
        predict::push_planes(&mut bytes, &out);
        bytes
    }
}

/// Green, then red and blue as differences from it: three planes of differences from the texel before.
fn colours(texels: &[Texel]) -> Vec<u8> {
    let mut planes = [const { Vec::new() }; 3];
    let mut last = [0u8; 3];
    for texel in texels {
        let [r, g, b] = texel.rgb();
        let now = [g, r.wrapping_sub(g), b.wrapping_sub(g)];
        for (plane, (now, last)) in planes.iter_mut().zip(now.iter().zip(last)) {
            plane.push(now.wrapping_sub(last));
        }
        last = now;
    }
    planes.concat()
}

/// The fourth bytes as differences from the one before.
fn occlusions(texels: &[Texel]) -> Vec<u8> {
    let mut last = 0u8;
    let mut step = |texel: &Texel| {
        let now = (texel.0 >> 24) as u8;
        now.wrapping_sub(std::mem::replace(&mut last, now))
    };
    texels.iter().map(&mut step).collect()
}
