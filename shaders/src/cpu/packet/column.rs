//! Which of a column's solids the rays of a packet meet, and what they see there. The scalar code is
//! [`column`](crate::cpu::column) and [`solid`](crate::cpu::solid), to which columns with gaps or holes are left.

use super::hits::{Hits, Segments};
use super::lanes::{
    F, FastExtremes, I, Lanes, M, U, Vec2s, Vec3s, always, float, float_u, gather_page, gather_where, has, lanes_of,
    splat, splat_u, to_i, to_u,
};
use super::node_rays::NodeRays;
use super::objects::{ColumnFaces, ObjectWords};
use crate::cpu::ray::{SUN_LIFT_CELLS, SceneRef};
use crate::cpu::walk::walk_column;
use crate::cpu::words::{azimuth_directions, codes_per_row};
use crate::layout::{ATTRIBUTE_PLANE, ROOF_PLANE, STRIP_PLANE};
use crate::pack::{
    AO_SHIFT, AZIMUTH_SHIFT, AZIMUTHS, CLIP_CONCAVE, CLIP_CORNER, CLIP_OFFSET_SHIFT, FLAGS_SHIFT, HEIGHT_BITS,
    HEIGHT_MASK,
};
use fearless_simd::prelude::*;
use glam::IVec2;
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::{CLIP_STEPS_PER_CELL, MIN_NORMAL_Z, flag};
use insula_protocol::texel::{AO_MAX, OPAQUE};

/// The columns that rays have come to, in the lanes of `lanes`: their numbers, where the rays cross their cells, their words.
pub(super) struct ColumnCrossing<S: Simd> {
    pub(super) lanes: M<S>,
    pub(super) number: U<S>,
    pub(super) ta: F<S>,
    pub(super) te: F<S>,
    pub(super) word: U<S>,
}

/// Columns without gaps.
struct PlainColumns<S: Simd> {
    number: U<S>,
    flags: U<S>,
    attributes: U<S>,
    /// Normals of the tops, if a column is inclined.
    top_normal: Option<Vec3s<S>>,
    strip: U<S>,
    clip: U<S>,
    centre: Vec2s<S>,
    z_min: F<S>,
    z_max: F<S>,
    slope: Vec2s<S>,
}

/// As the scalar `ClipSplit`.
struct ClipSplits<S: Simd> {
    begin: F<S>,
    end: F<S>,
    concave: M<S>,
    walls: [U<S>; 3],
}

/// The first solids that the rays meet.
struct FoundSolids<S: Simd> {
    lanes: M<S>,
    s: F<S>,
    /// Entered through the side; else through the top or the bottom.
    side: M<S>,
    bottom_face: M<S>,
    /// Beyond the plane that clips the column.
    outer: M<S>,
    wall: U<S>,
    bottom: F<S>,
    top: F<S>,
}

/// The part of the rays that is inside of a solid, entered through a side, the top or the bottom.
struct Spans<S: Simd> {
    s: F<S>,
    e: F<S>,
    top: M<S>,
    bottom: M<S>,
}

/// Gathers what the rays hit in their columns.
#[inline(always)]
pub(super) fn hit_columns<S: Simd>(
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    rays: &NodeRays<'_, S>,
    found: &ColumnCrossing<S>,
    hits: &mut Hits<S>,
) {
    let simd = rays.simd;
    let rare = found.lanes & has(simd, found.word, u32::from(flag::GAP | flag::HOLES) << FLAGS_SHIFT);
    let plain = found.lanes & !rare;
    let mut left = rare;
    if plain.any_true() {
        left |= hit_plain_columns(scene, segments, rays, found, plain, hits);
    }
    for lane in lanes_of::<S>(left) {
        let mut ray = segments.lane(scene, lane);
        ray.node = rays.lane(lane);
        let number = found.number[lane] as i32;
        let cell = IVec2::new(number % NODE_CELLS as i32, number / NODE_CELLS as i32);
        walk_column(&mut ray, cell, found.ta[lane], found.te[lane], found.word[lane]);
        hits.set_lane(lane, &ray.hit);
    }
}

/// The same for the columns in `plain`. Returns the rays that are left to the scalar code.
#[inline(always)]
fn hit_plain_columns<S: Simd>(
    scene: &SceneRef<'_>,
    segments: &Segments<S>,
    rays: &NodeRays<'_, S>,
    crossing: &ColumnCrossing<S>,
    plain: M<S>,
    hits: &mut Hits<S>,
) -> M<S> {
    let simd = rays.simd;
    let columns = PlainColumns::read(scene, rays, crossing, plain);
    let solids = columns.meets(rays, crossing, plain);
    if solids.lanes.all_false() {
        return solids.lanes;
    }
    let is_roof = !solids.outer & !solids.side & !solids.bottom_face;
    let faces = ColumnFaces { outer: solids.outer, wall: !is_roof };
    let objects = ObjectWords::of_columns(simd, scene, rays.node, solids.lanes, columns.number, faces);
    let hidden = solids.lanes & objects.hidden(simd);
    if segments.to_sun {
        // Whatever is met and not hidden shadows.
        hits.is_hit |= solids.lanes & !hidden;
        return hidden;
    }
    let exposed = has(simd, columns.flags, u32::from(flag::EXPOSED));
    let is_row = !solids.outer & !is_roof & exposed;
    // A column that shows its top only, met from another side.
    let left = hidden | (solids.lanes & !solids.outer & !is_roof & !exposed);
    let (mut texel, mut left) = (splat_u(simd, 0), left);
    let in_strip = solids.lanes & (is_row | solids.outer);
    if (solids.lanes & !in_strip).any_true() {
        texel = gather_page(simd, rays.words.planes[ROOF_PLANE], columns.number);
    }
    if in_strip.any_true() {
        let at = is_row.select(columns.row_at(rays, &solids), columns.strip + 1);
        texel = in_strip.select(gather_where(simd, scene.atlas, at, in_strip), texel);
        let is_open = (texel & OPAQUE).simd_eq(splat_u(simd, 0));
        left |= solids.lanes & is_row & is_open;
    }
    let lanes = solids.lanes & !left;
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let flat = Vec3s::<S> { x: zero, y: zero, z: solids.bottom_face.select(-one, one) };
    let mut normal = flat;
    if (lanes & solids.side).any_true() {
        let face = rays.face_normal(columns.centre);
        let wall = columns.wall_normal(rays, segments, &solids, face);
        normal = Vec3s::select(solids.side, Vec3s::select(solids.outer, face, wall), normal);
    }
    if (lanes & is_roof).any_true() {
        let top = columns.top_normal.unwrap_or_else(always!(|| decode_normal(simd, columns.attributes)));
        normal = Vec3s::select(is_roof, top, normal);
    }
    record(scene, rays, (segments, lanes, columns.flags), (solids.s, texel, normal, &objects), hits);
    left
}

/// Ends the rays in `lanes` at texels.
#[inline(always)]
fn record<S: Simd>(
    scene: &SceneRef<'_>,
    rays: &NodeRays<'_, S>,
    (segments, lanes, flags): (&Segments<S>, M<S>, U<S>),
    (t, texel, normal, objects): (F<S>, U<S>, Vec3s<S>, &ObjectWords<S>),
    hits: &mut Hits<S>,
) {
    let simd = rays.simd;
    hits.is_hit |= lanes;
    hits.colour = lanes.select(objects.colour_words(simd, texel), hits.colour);
    hits.object = lanes.select(objects.address, hits.object);
    hits.ao = lanes.select(float_u::<S>(texel >> AO_SHIFT) / f32::from(AO_MAX), hits.ao);
    hits.normal = Vec3s::select(lanes, normal, hits.normal);
    hits.flags = lanes.select(flags, hits.flags);
    hits.distance_m = lanes.select(t, hits.distance_m);
    hits.node = lanes.select(splat_u(simd, rays.index), hits.node);
    if scene.frame.shadow_m > 0.0 {
        let lift = splat(simd, rays.node.cell_m * SUN_LIFT_CELLS);
        let origin = segments.dir.scale(t) + normal.scale(lift);
        hits.shadow_origin = Vec3s::select(lanes, origin, hits.shadow_origin);
    }
}

impl<S: Simd> NodeRays<'_, S> {
    /// Normals of the cells' faces through which the rays enter.
    #[inline(always)]
    fn face_normal(&self, centre: Vec2s<S>) -> Vec3s<S> {
        let simd = self.simd;
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let near_x = (centre.x + 0.5 - self.ahead.x - self.o.x) * self.inv.x;
        let near_y = (centre.y + 0.5 - self.ahead.y - self.o.y) * self.inv.y;
        let across_x = near_x.simd_ge(near_y);
        Vec3s {
            x: across_x.select(one - self.ahead.x * 2.0, zero),
            y: across_x.select(zero, one - self.ahead.y * 2.0),
            z: zero,
        }
    }
}

impl<S: Simd> PlainColumns<S> {
    #[inline(always)]
    fn read(scene: &SceneRef<'_>, rays: &NodeRays<'_, S>, crossing: &ColumnCrossing<S>, lanes: M<S>) -> Self {
        let (simd, atlas) = (rays.simd, scene.atlas);
        let number = crossing.number;
        let flags = lanes.select(crossing.word >> FLAGS_SHIFT, splat_u(simd, 0));
        let bit = always!(|flag: u8| has(simd, flags, u32::from(flag)));
        let attributes = gather_page(simd, rays.words.planes[ATTRIBUTE_PLANE], number);
        let (exposed, clipped) = (bit(flag::EXPOSED), bit(flag::CLIPPED));
        let (mut strip, mut clip) = (splat_u(simd, 0), splat_u(simd, 0));
        if exposed.any_true() {
            strip = exposed.select(gather_page(simd, rays.words.planes[STRIP_PLANE], number), strip);
        }
        if clipped.any_true() {
            clip = gather_where(simd, atlas, strip, clipped);
        }
        let zero = splat(simd, 0.0);
        let mut slope = Vec2s::<S> { x: zero, y: zero };
        let mut top_normal = None;
        let inclined = bit(flag::INCLINED);
        if inclined.any_true() {
            let n = decode_normal(simd, attributes);
            slope = slope_codes(simd, inclined, n, rays.node.z_shift());
            top_normal = Some(n);
        }
        let side = NODE_CELLS as u32;
        Self {
            number,
            flags,
            attributes,
            top_normal,
            strip,
            clip,
            centre: Vec2s::<S> {
                x: float_u::<S>(number & (side - 1)) + 0.5,
                y: float_u::<S>(number >> side.ilog2()) + 0.5,
            },
            z_min: float_u::<S>((crossing.word >> HEIGHT_BITS) & HEIGHT_MASK),
            z_max: float_u::<S>(crossing.word & HEIGHT_MASK),
            slope,
        }
    }

    /// The first solids that the rays in `lanes` meet.
    #[inline(always)]
    fn meets(&self, rays: &NodeRays<'_, S>, crossing: &ColumnCrossing<S>, lanes: M<S>) -> FoundSolids<S> {
        let simd = rays.simd;
        let clipped = has(simd, self.flags, u32::from(flag::CLIPPED)) & lanes;
        let (zero, none) = (splat(simd, 0.0), M::<S>::splat(simd, false));
        let mut found = FoundSolids::<S> {
            lanes: none,
            s: zero,
            side: none,
            bottom_face: none,
            outer: none,
            wall: (self.attributes >> AZIMUTH_SHIFT) & (AZIMUTHS - 1),
            bottom: self.z_min,
            top: self.z_max,
        };
        let (ta, te) = (crossing.ta, crossing.te);
        if clipped.all_false() {
            self.meet_part(rays, lanes & ta.simd_lt(te), [ta, te], none, found.wall, &mut found);
            return found;
        }
        let split = self.clip_split(rays, clipped, ta, te);
        let has_outer = (self.clip & HEIGHT_MASK).simd_ne(splat_u(simd, 0));
        let parts = [(ta, split.begin), (split.begin, split.end), (split.end, te)];
        for (part, (s, e)) in parts.into_iter().enumerate() {
            let outer = if part == 1 { split.concave } else { !split.concave };
            let wanted = lanes & !found.lanes & s.simd_lt(e) & (!outer | has_outer);
            if wanted.any_true() {
                self.meet_part(rays, wanted, [s, e], outer, split.walls[part], &mut found);
            }
        }
        found
    }

    /// Solids of one part of the rays' way through their cells.
    #[inline(always)]
    fn meet_part(
        &self,
        rays: &NodeRays<'_, S>,
        wanted: M<S>,
        [s, e]: [F<S>; 2],
        outer: M<S>,
        wall: U<S>,
        found: &mut FoundSolids<S>,
    ) {
        let simd = rays.simd;
        let zero = splat(simd, 0.0);
        let outer_top = float_u::<S>(self.clip & HEIGHT_MASK);
        let top = outer.select(outer_top, self.z_max);
        let (zs, ze) = (rays.z_at(s), rays.z_at(e));
        let (slope_x, slope_y) = (outer.select(zero, self.slope.x), outer.select(zero, self.slope.y));
        let has_slope = self.top_normal.is_some();
        let top_at = always!(|t: F<S>| {
            if !has_slope {
                return top;
            }
            let x = rays.o.x + rays.d.x * t - self.centre.x;
            let y = rays.o.y + rays.d.y * t - self.centre.y;
            top + (slope_x * x + slope_y * y)
        });
        let (over, above) = ([zs - top_at(s), ze - top_at(e)], [zs - self.z_min, ze - self.z_min]);
        let (spans, some) = clip_to_solid(simd, s, e, over, above);
        let side = !spans.top & !spans.bottom;
        // An eye inside a column (less than half a cell in front of a wall) sees out of it.
        let inside = spans.s.simd_le(zero) & side;
        let now = wanted & some & spans.s.simd_lt(spans.e) & !inside;
        found.lanes |= now;
        found.s = now.select(spans.s, found.s);
        found.side = now.select(side, found.side);
        found.bottom_face = now.select(spans.bottom, found.bottom_face);
        found.outer = now.select(outer, found.outer);
        found.wall = now.select(wall, found.wall);
        found.top = now.select(top, found.top);
    }

    /// How the planes of the columns in `clipped` split their rays.
    #[inline(always)]
    fn clip_split(&self, rays: &NodeRays<'_, S>, clipped: M<S>, ta: F<S>, te: F<S>) -> ClipSplits<S> {
        let simd = rays.simd;
        let zero = splat(simd, 0.0);
        let concave = has(simd, self.clip, CLIP_CONCAVE) & clipped;
        let side = concave.select(splat(simd, -1.0), splat(simd, 1.0));
        let wall = (self.attributes >> AZIMUTH_SHIFT) & (AZIMUTHS - 1);
        let mut split = ClipSplits::<S> { begin: ta, end: te, concave, walls: [wall; 3] };
        let corner = clipped & has(simd, self.clip, CLIP_CORNER);
        for (word, lanes) in [(self.attributes, clipped), (self.clip, corner)] {
            if lanes.all_false() {
                continue;
            }
            let wall = (word >> AZIMUTH_SHIFT) & (AZIMUTHS - 1);
            let offset = float::<S>(to_i::<S>(word) >> CLIP_OFFSET_SHIFT) / CLIP_STEPS_PER_CELL as f32;
            let n = directions(simd, wall);
            let beyond = always!(|t: F<S>| {
                let x = rays.o.x + rays.d.x * t - self.centre.x;
                let y = rays.o.y + rays.d.y * t - self.centre.y;
                side * (n.x * x + n.y * y - offset)
            });
            let (a, b) = (beyond(ta), beyond(te));
            let crossing = ta + (te - ta) * (a / (a - b));
            let (a_out, b_out) = (lanes & a.simd_gt(zero), lanes & b.simd_gt(zero));
            let whole = a_out & b_out;
            let enters = a_out & !whole & crossing.simd_gt(split.begin);
            let leaves = b_out & a.simd_le(zero) & crossing.simd_lt(split.end);
            split.begin = whole.select(te, enters.select(crossing, split.begin));
            split.walls[1] = enters.select(wall, split.walls[1]);
            split.end = leaves.select(crossing, split.end);
            split.walls[2] = leaves.select(wall, split.walls[2]);
        }
        // Never within: all of the ray is in the part before, which it enters through the cell's face.
        let never = split.begin.simd_ge(split.end);
        split.begin = never.select(te, split.begin);
        split.end = never.select(te, split.end);
        split
    }

    /// Addresses of the rows of strips at which the rays enter.
    #[inline(always)]
    fn row_at(&self, rays: &NodeRays<'_, S>, solids: &FoundSolids<S>) -> U<S> {
        let simd = rays.simd;
        // A power of two: as exact as the quotient.
        let rows_per_code = 1.0 / codes_per_row(rays.node.z_shift());
        let row_of = always!(|z: F<S>| (z * rows_per_code).floor());
        let clipped = has(simd, self.flags, u32::from(flag::CLIPPED));
        let head = clipped.select(splat_u(simd, 2), splat_u(simd, 0));
        let (low, high) = (row_of(solids.bottom), row_of(solids.top - 1.0));
        let row = row_of(rays.z_at(solids.s)).fast_max(low).fast_min(high);
        let above: I<S> = (row - row_of(self.z_min)).to_int();
        self.strip + head + to_u::<S>(above)
    }

    /// Normals of walls that the rays enter from outside, else of the cells' faces.
    #[inline(always)]
    fn wall_normal(
        &self,
        rays: &NodeRays<'_, S>,
        segments: &Segments<S>,
        solids: &FoundSolids<S>,
        face: Vec3s<S>,
    ) -> Vec3s<S> {
        let simd = rays.simd;
        let Vec2s::<S> { x, y } = directions(simd, solids.wall);
        let normal = Vec3s::<S> { x, y, z: splat(simd, 0.0) };
        Vec3s::select(normal.dot(segments.dir).simd_lt(splat(simd, 0.0)), normal, face)
    }
}

/// As the scalar function; and whether there is such a part.
#[inline(always)]
fn clip_to_solid<S: Simd>(simd: S, ta: F<S>, te: F<S>, over: [F<S>; 2], above: [F<S>; 2]) -> (Spans<S>, M<S>) {
    let zero = splat(simd, 0.0);
    let (over_a, over_e) = (over[0].simd_gt(zero), over[1].simd_gt(zero));
    let (below_a, below_e) = (above[0].simd_lt(zero), above[1].simd_lt(zero));
    let some = !((over_a & over_e) | (below_a & below_e));
    let at_top = ta + (te - ta) * (over[0] / (over[0] - over[1]));
    let at_bottom = ta + (te - ta) * (above[0] / (above[0] - above[1]));
    let s = over_a.select(at_top, ta);
    let e = (!over_a & over_e).select(at_top, te);
    let bottom = below_a & at_bottom.simd_gt(s);
    let spans = Spans {
        s: bottom.select(at_bottom, s),
        e: (!below_a & below_e).select(e.fast_min(at_bottom), e),
        top: over_a & !bottom,
        bottom,
    };
    (spans, some)
}

/// Horizontal unit vectors.
#[inline(always)]
fn directions<S: Simd>(simd: S, azimuth: U<S>) -> Vec2s<S> {
    let table = azimuth_directions();
    let [x, y] =
        simd.pairs(always!(|lane: usize| bytemuck::cast(table[azimuth[lane] as usize % AZIMUTHS as usize].to_array())));
    Vec2s::<S> { x: x.bitcast(), y: y.bitcast() }
}

/// [`slope_codes`](crate::pack::slope_codes) of the columns in `lanes`, by the normals of their tops; 0 in the others.
#[inline(always)]
fn slope_codes<S: Simd>(simd: S, lanes: M<S>, n: Vec3s<S>, z_shift: u32) -> Vec2s<S> {
    let zero = splat(simd, 0.0);
    let scale = splat(simd, -codes_per_row(z_shift)) / n.z.fast_max(splat(simd, MIN_NORMAL_Z));
    Vec2s::<S> { x: lanes.select(n.x * scale, zero), y: lanes.select(n.y * scale, zero) }
}

/// [`octahedral::decode`](insula_protocol::octahedral::decode) of the lower halves of words.
#[inline(always)]
fn decode_normal<S: Simd>(simd: S, words: U<S>) -> Vec3s<S> {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let unpack = always!(|byte: U<S>| (float_u::<S>(byte.min(splat_u(simd, 254))) - 127.0) / 127.0);
    let (x, y) = (unpack(words & 0xff), unpack((words >> 8) & 0xff));
    let z = one - x.abs() - y.abs();
    let sign = always!(|v: F<S>| v.simd_lt(zero).select(-one, one));
    let lower = z.simd_lt(zero);
    let (folded_x, folded_y) = ((one - y.abs()) * sign(x), (one - x.abs()) * sign(y));
    let (x, y) = (lower.select(folded_x, x), lower.select(folded_y, y));
    let length = (x * x + y * y + z * z).sqrt();
    Vec3s::<S> { x: x / length, y: y / length, z: z / length }
}
