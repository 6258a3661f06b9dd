//! Light that a translucency map sends through a stone. GPU twin: `translucency.wgsl`.
//!
//! [`gathered`] integrates the light that enters around a point (Mischitelli 2007, equation 5.5) with few taps. The first is where the
//! point's sunray enters; the others lie on rings around it, in the plane of the surface there. A tap stands for a sector of its
//! ring, over which the dipole has a closed integral; so on a plane the taps add up to all of the light, whatever their number.

use super::landmark::unpack_normal;
use crate::translucency::{COARSEST_PX, FINE_TAPS, MAX_MAPS, OCCUPIED, TranslucencyMap, level_words};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// Rings of the two filters, and taps on each.
pub(crate) const FINE_RINGS: [u32; 2] = [4, 5];
pub(crate) const FAST_RINGS: [u32; 2] = [2, 4];
/// Radius of the area of the first tap, in distances of the point from the sources.
pub(crate) const FIRST_RADIUS: f32 = 1.5;
/// Least radius of that area, in texels.
pub(crate) const FIRST_TEXELS: f32 = 0.75;
/// Least cosine between the sun and the plane of the rings.
pub(crate) const MIN_ENTRY_COSINE: f32 = 0.15;
/// Texels of one surface differ in height by at most this many of their sides.
pub(crate) const SURFACE_STEP: f32 = 10.0;
/// Heights of a surface are not known better than this share of a texel's side.
pub(crate) const HEIGHT_SLACK: f32 = 0.25;
/// Least square of how much a sector is stretched to where its tap is.
pub(crate) const MIN_STRETCH: f32 = 0.25;
/// How far the taps of a ring are turned from those of the last one, in turns.
pub(crate) const RING_TURN: f32 = 0.381_966;

/// A landmark's hits are those whose stone pattern begins this near to the map's anchor, in metres.
pub(crate) const SAME_ANCHOR_M: f32 = 0.02;

/// The axes of a map: to the right, up, and towards the sun.
#[derive(Debug, Clone, Copy)]
pub struct MapAxes {
    pub right: Vec3,
    pub up: Vec3,
    pub sun: Vec3,
}

impl MapAxes {
    /// `side` is the horizontal unit vector towards the sun ([`crate::layout::Light::side`]).
    pub fn new(sun: Vec3, side: Vec2) -> Self {
        let right = Vec3::new(-side.y, side.x, 0.0);
        Self { right, up: sun.cross(right), sun }
    }
}

/// Light that enters around a place of the map.
#[derive(Debug, Clone, Copy)]
struct EntryTap {
    /// Share of the sun's light.
    entered: f32,
    /// Relative to the centre of the map.
    point: Vec3,
    normal: Vec3,
    is_surface: bool,
}

/// The part of a ring that a tap stands for.
#[derive(Debug, Clone, Copy)]
struct Sector {
    /// Share of the ring.
    share: f32,
    /// Squares of the tap's radius and of the ring's radii.
    square: f32,
    inner: f32,
    outer: f32,
    /// Side of a texel of the tap's level.
    texel_m: f32,
}

/// A map, and the point that light is gathered for.
struct Gatherer<'a> {
    words: &'a [u32],
    map: &'a TranslucencyMap,
    axes: &'a MapAxes,
    /// Relative to the centre of the map.
    point: Vec3,
    texel_m: f32,
}

/// Irradiance from the sun, in units of what falls on a surface that faces it, that a matt surface needs to send the light that
/// leaves the stone at `point`, by colour. `words` are the atlas; `point` is relative to the camera.
pub fn gathered(words: &[u32], map: &TranslucencyMap, axes: &MapAxes, point: Vec3) -> Vec3 {
    let point = point - Vec3::from(map.centre);
    let texel_m = 2.0 * map.radius_m / map.width_px as f32;
    Gatherer { words, map, axes, point, texel_m }.light()
}

impl Gatherer<'_> {
    fn light(&self) -> Vec3 {
        let (map, axes) = (self.map, self.axes);
        let first = self.entry_tap(self.point, 0);
        let facing = first.normal.dot(axes.sun);
        let plane = (first.normal + axes.sun * (MIN_ENTRY_COSINE - facing).max(0.0)).normalize_or(axes.sun);
        let cosine = plane.dot(axes.sun);
        let along = (axes.right - plane * plane.dot(axes.right)).normalize_or(axes.up);
        let across = plane.cross(along);
        // Along the normal: at grazing light, heights along the sun's rays are known less well.
        let depth_below = (first.point - self.point).dot(plane);
        let thickness_m =
            if first.is_surface { (depth_below.abs() - HEIGHT_SLACK * self.texel_m).max(0.0) } else { 0.0 };
        let depth_m = map.depth_m[1];
        let base = FIRST_RADIUS * (depth_m * depth_m + thickness_m * thickness_m).sqrt();
        let base = base.max(FIRST_TEXELS * self.texel_m / cosine.sqrt());
        let [rings, taps] = if map.taps >= FINE_TAPS { FINE_RINGS } else { FAST_RINGS };
        let reach_m = ((2.0 * thickness_m + map.reach_m) * map.reach_m).sqrt();
        let growth = (reach_m / base).max(1.1).powf(1.0 / rings as f32);
        let centre = if first.is_surface { self.point + plane * depth_below } else { self.point };
        let sector = Sector { share: 1.0, square: 0.0, inner: 0.0, outer: base * base, texel_m: self.texel_m };
        let mut sum = self.light_through(&first, &sector);
        let mut near = base;
        for ring in 0..rings {
            let far = near * growth;
            let radius = (near * far).sqrt();
            let side = (TAU * 0.5 * (far * far - near * near) / taps as f32 * cosine).sqrt();
            let level = (side / self.texel_m).max(1.0).log2() as u32;
            let texel_m = self.texel_m * (1u32 << level.min(16)) as f32;
            let sector =
                Sector { share: 1.0 / taps as f32, square: near * far, inner: near * near, outer: far * far, texel_m };
            for k in 0..taps {
                let turn = Vec2::from_angle(TAU * (k as f32 / taps as f32 + ring as f32 * RING_TURN));
                let place = centre + (along * turn.x + across * turn.y) * radius;
                sum += self.light_through(&self.entry_tap(place, level), &sector);
            }
            near = far;
        }
        sum * Vec3::from(map.share) * cosine
    }

    /// What leaves at the point of the light that enters in the sector of a tap.
    fn light_through(&self, tap: &EntryTap, sector: &Sector) -> Vec3 {
        if tap.entered <= 0.0 {
            return Vec3::ZERO;
        }
        let offset = self.point - tap.point;
        let exact = offset.dot(tap.normal);
        let height = exact - exact.clamp(-HEIGHT_SLACK * sector.texel_m, HEIGHT_SLACK * sector.texel_m);
        let flat = (offset.length_squared() - exact * exact).max(0.0);
        // The surface is not the plane of the rings: the sector is where its tap is, with the same area.
        let stretch =
            if sector.square > 0.0 { (flat / sector.square).clamp(MIN_STRETCH, 1.0 / MIN_STRETCH) } else { 1.0 };
        let rest = (flat - sector.square * stretch).max(0.0);
        let [inner, outer] = [sector.inner, sector.outer].map(|square| square * stretch + rest);
        let colour = |k: usize| {
            let (depth, source, transport) = (self.map.depth_m[k], self.map.height_m[k], self.map.transport[k]);
            let decay = |square: f32| {
                let distance = square.max(depth * depth).sqrt();
                (-transport * distance).exp() / distance
            };
            let term = |z: f32, length: f32| length * (decay(inner + z * z) - decay(outer + z * z));
            term(height + depth, depth) + term(height - source, source)
        };
        Vec3::new(colour(0), colour(1), colour(2)) * (tap.entered * sector.share / stretch)
    }

    /// The texels of a level around the place of `at`, of the surface that is nearest to the point's height.
    fn entry_tap(&self, at: Vec3, level: u32) -> EntryTap {
        let (map, axes) = (self.map, self.axes);
        let (mut width, mut first) = (map.width_px, map.address);
        for _ in 0..level {
            if width > COARSEST_PX {
                first += level_words(width);
                width /= 2;
            }
        }
        let side_m = 2.0 * map.radius_m;
        let place = Vec2::new(at.dot(axes.right), at.dot(axes.up));
        let texel = (place / side_m + 0.5) * width as f32 - 0.5;
        let corner = texel.floor();
        let part = texel - corner;
        let own = self.point.dot(axes.sun);
        let mut found = [([0, 0], 0.0, 0.0); 4];
        let (mut nearest, mut apart) = (0.0, f32::INFINITY);
        for k in 0..4u32 {
            let step = Vec2::new((k & 1) as f32, (k >> 1) as f32);
            let words = self.map_texel(first, width, corner + step);
            let height = map_height(words[0], map.radius_m);
            let weights = Vec2::ONE - step + (step * 2.0 - 1.0) * part;
            found[k as usize] = (words, height, weights.x * weights.y);
            if words[1] & OCCUPIED != 0 && (height - own).abs() < apart {
                (nearest, apart) = (height, (height - own).abs());
            }
        }
        let (mut entered, mut height, mut normal, mut weight) = (0.0, 0.0, Vec3::ZERO, 0.0);
        for (words, z, share) in found {
            if words[1] & OCCUPIED != 0 && (z - nearest).abs() <= SURFACE_STEP * side_m / width as f32 {
                entered += map_entered(words[0]) * share;
                height += z * share;
                normal += unpack_normal(words[1]) * share;
                weight += share;
            }
        }
        let point = axes.right * place.x + axes.up * place.y + axes.sun * (height / weight.max(1e-6));
        EntryTap { entered, point, normal: normal.normalize_or(axes.sun), is_surface: weight > 0.0 }
    }

    fn map_texel(&self, first: u32, width: u32, at: Vec2) -> [u32; 2] {
        let last = width as f32 - 1.0;
        if at.x < 0.0 || at.y < 0.0 || at.x > last || at.y > last {
            return [0, 0];
        }
        let place = first + at.y as u32 * width + at.x as u32;
        [place, place + width * width].map(|place| self.words.get(place as usize).copied().unwrap_or(0))
    }
}

/// Height of a texel towards the sun, from the centre of a map.
pub(super) fn map_height(word: u32, radius_m: f32) -> f32 {
    ((word & 0xffff) as f32 * (2.0 / 65_535.0) - 1.0) * radius_m
}

/// Share of the sun's light that enters at a texel.
pub(super) fn map_entered(word: u32) -> f32 {
    (word >> 16) as f32 / 65_535.0
}

/// The map of the landmark whose stone pattern begins at `anchor`.
pub(super) fn map_of(maps: &[TranslucencyMap; MAX_MAPS], anchor: Vec3) -> Option<&TranslucencyMap> {
    maps.iter().find(|map| map.width_px != 0 && anchor.distance(map.anchor.into()) <= SAME_ANCHOR_M)
}
