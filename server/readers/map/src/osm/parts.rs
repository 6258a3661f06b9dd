//! Building parts and the outlines that they make up.
//!
//! An outline stands for the whole building in maps of the plane; where its parts are drawn too, only they have the shape. See
//! <https://wiki.openstreetmap.org/wiki/Simple_3D_Buildings>.

use super::box_tree::BoxTree;
use super::cover::{Bounds, bounds, covered_share, share_within};
use super::element::{ElementId, Position, Tags};
use super::emit::attributes;
use super::nesting::{Polygon, area};
use insula_dress::footprint::{BuildingHeight, Canopy, HeightHints};
use insula_source::problems::GUESSED;

/// A part belongs to the outline within which it is by this share at least.
const MIN_SHARE_WITHIN: f64 = 0.5;
/// Shares that differ by less are equal.
const EQUAL_SHARES: f64 = 0.05;
/// Parts that cover this share of an outline make up the whole building. OSM2World has the same limit.
const WHOLE: f64 = 0.9;
/// Parts that cover less of an outline on the ground stand on it, or are added to it.
const MOST: f64 = 0.5;
/// Parts that begin higher do not stand on the ground.
const ON_GROUND_M: f64 = 0.5;
/// Points of outlines and parts that are compared by area; beyond it outlines are kept. A country has some hundred million.
const MAX_COMPARED_POINTS: u64 = 1 << 31;
/// Longer values are not inherited. Values of OpenStreetMap have at most 255 characters.
const MAX_INHERITED_BYTES: usize = 1024;
/// Keys of an outline's tags that hold for its parts too, unless they have their own.
const INHERITED: &[&str] = &["building", "building:colour", "building:material", "roof:colour", "roof:material"];

#[derive(Debug)]
struct Part {
    id: ElementId,
    /// Range in `rings`.
    rings: [u32; 2],
    bounds: Bounds,
    heights: Heights,
    /// Whether a canopy is over or on another part.
    is_supported: bool,
    /// The outline that a relation names.
    named_outline: Option<ElementId>,
    parent: Option<ElementId>,
    /// Share within the parent, and the parent's area.
    parent_share: f64,
    parent_area: f64,
    /// Number of the parent's inherited tags.
    inherited: Option<u32>,
}

/// Where a building begins and ends above the ground.
#[derive(Debug, Clone, Copy)]
pub(super) struct Heights {
    base_m: f64,
    /// `None` if it is not known.
    top_m: Option<f64>,
    is_canopy: bool,
}

impl Heights {
    pub(super) fn of(tags: Tags<'_>) -> Self {
        let mut is_guess = false;
        let note = |kind: &str, _: &str| is_guess |= kind == GUESSED;
        let attributes = attributes(tags);
        let canopy = Canopy::of(&attributes);
        let height = match canopy {
            Some(canopy) => canopy.height(&attributes, HeightHints::default(), note),
            None => BuildingHeight::of(&attributes, HeightHints::default(), note),
        };
        let base_m = canopy.map_or(height.base_m, |canopy| canopy.base_m(&height, height.top_m));
        Self { base_m, top_m: (!is_guess).then_some(height.top_m), is_canopy: canopy.is_some() }
    }
}

/// A ring within the points of all parts.
#[derive(Debug, Clone, Copy)]
struct RingPlace {
    start: u64,
    count: u32,
    is_outer: bool,
}

#[derive(Debug, Default)]
pub(super) struct Parts {
    parts: Vec<Part>,
    rings: Vec<RingPlace>,
    points: Vec<Position>,
    tree: BoxTree,
    /// Outlines that relations name, with the numbers of their parts; sorted.
    named: Vec<(ElementId, u32)>,
    /// Keys and values of outlines' tags.
    inherited: Vec<Vec<(&'static str, String)>>,
    compared_points: u64,
}

/// A part whose outline is known.
pub(super) struct KnownPart<'p> {
    pub(super) parent: Option<ElementId>,
    pub(super) polygons: Vec<Polygon>,
    /// Keys and values of the outline's tags that hold for the part too.
    pub(super) inherited: &'p [(&'static str, String)],
    /// Whether it is a canopy over or on another part.
    pub(super) is_supported: bool,
}

/// What becomes of an outline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OutlineFate {
    Kept {
        /// Whether parts are within it.
        has_parts: bool,
    },
    /// Parts cover it.
    LeftOut,
    /// There are too many parts to compare.
    NotCompared,
}

impl Parts {
    pub(super) fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }

    /// Memory of the parts in bytes.
    pub(super) fn bytes(&self) -> u64 {
        let bytes = self.parts.len() * size_of::<Part>() + self.rings.len() * size_of::<RingPlace>();
        (bytes + self.points.len() * size_of::<Position>()) as u64
    }

    /// Adds a part. `named_outline` is the one that a relation names.
    pub(super) fn push(
        &mut self,
        id: ElementId,
        polygons: &[Polygon],
        heights: Heights,
        named_outline: Option<ElementId>,
    ) {
        let first = self.rings.len() as u32;
        for polygon in polygons {
            for (i, ring) in polygon.iter().enumerate() {
                let start = self.points.len() as u64;
                self.rings.push(RingPlace { start, count: ring.len() as u32, is_outer: i == 0 });
                self.points.extend_from_slice(ring);
            }
        }
        self.parts.push(Part {
            id,
            rings: [first, self.rings.len() as u32],
            bounds: bounds(polygons.iter().flatten().flatten()).unwrap_or_default(),
            heights,
            is_supported: false,
            named_outline,
            parent: None,
            parent_share: 0.0,
            parent_area: 0.0,
            inherited: None,
        });
    }

    /// Makes the parts ready for their outlines, after the last part.
    pub(super) fn finish(&mut self) {
        self.tree = BoxTree::new(self.parts.iter().map(|part| part.bounds));
        let named = self.parts.iter().zip(0..).filter_map(|(part, i)| Some((part.named_outline?, i)));
        self.named = named.collect();
        self.named.sort_unstable();
        self.find_support();
    }

    /// Finds the canopies that are over or on other parts.
    fn find_support(&mut self) {
        for number in 0..self.parts.len() {
            let Part { heights, bounds, .. } = self.parts[number];
            if !heights.is_canopy || self.compared_points > MAX_COMPARED_POINTS {
                continue;
            }
            let mut near = Vec::new();
            self.tree.overlapping(bounds, |part| near.push(part));
            near.retain(|part| *part as usize != number && !self.parts[*part as usize].heights.is_canopy);
            self.compared_points += near.iter().map(|part| self.point_count(*part)).sum::<u64>();
            let canopy = self.rings_of(number as u32);
            let is_within = |part: &u32| {
                let (own, of_part) = (self.rings_of(*part), self.parts[*part as usize].bounds);
                share_within(&own, of_part, &canopy) >= MIN_SHARE_WITHIN
                    || share_within(&canopy, bounds, &own) >= MIN_SHARE_WITHIN
            };
            self.parts[number].is_supported = near.iter().any(is_within);
        }
    }

    /// Finds the parts of an outline.
    pub(super) fn settle_outline(&mut self, id: ElementId, tags: Tags<'_>, polygons: &[Polygon]) -> OutlineFate {
        // Tagged as both and above the ground, it is a storey on other parts, which do not stand for it.
        let is_upper_part =
            || tags.get("building:part").is_some_and(|value| value != "no") && Heights::of(tags).base_m >= ON_GROUND_M;
        if self.parts.is_empty() || is_upper_part() {
            return OutlineFate::Kept { has_parts: false };
        }
        let rings: Vec<&[Position]> = polygons.iter().flatten().map(Vec::as_slice).collect();
        let Some(bounds) = bounds(rings.iter().copied().flatten()) else {
            return OutlineFate::Kept { has_parts: false };
        };
        let first = self.named.partition_point(|(outline, _)| *outline < id);
        let named = self.named[first..].iter().take_while(|(outline, _)| *outline == id).map(|(_, part)| *part);
        let mut members: Vec<(u32, f64)> = named.map(|part| (part, 1.0)).collect();
        let mut near = Vec::new();
        self.tree.overlapping(bounds, |part| near.push(part));
        let outline_points: usize = rings.iter().map(|ring| ring.len()).sum();
        let compared = near.iter().chain(members.iter().map(|(part, _)| part));
        let points: u64 = compared.map(|part| self.point_count(*part) + outline_points as u64).sum();
        self.compared_points += points;
        if self.compared_points > MAX_COMPARED_POINTS {
            return OutlineFate::NotCompared;
        }
        near.retain(|part| self.parts[*part as usize].named_outline.is_none() && self.parts[*part as usize].id != id);
        members.extend(near.into_iter().filter_map(|part| {
            let share = share_within(&self.rings_of(part), self.parts[part as usize].bounds, &rings);
            (share >= MIN_SHARE_WITHIN).then_some((part, share))
        }));
        if members.is_empty() {
            return OutlineFate::Kept { has_parts: false };
        }
        let outline_area = polygons.iter().flatten().map(|ring| area(ring).abs()).fold(0.0, f64::max);
        let inherited = self.keep_inherited(tags);
        for (part, share) in &members {
            self.parts[*part as usize].offer_parent(id, *share, outline_area, inherited);
        }
        let members: Vec<u32> = members.into_iter().map(|(part, _)| part).collect();
        match self.make_up(&members, &rings, bounds, tags) {
            true => OutlineFate::LeftOut,
            false => OutlineFate::Kept { has_parts: true },
        }
    }

    /// Whether parts stand for the whole outline, by how much of it they cover and by their heights.
    ///
    /// Some parts are on top of an outline that is mapped as the building's base, or next to it, though they should be all of
    /// the building. Without the outline they would float, and its rest would be missing.
    fn make_up(&self, members: &[u32], outline: &[&[Position]], bounds: Bounds, tags: Tags<'_>) -> bool {
        let share = |is_counted: &dyn Fn(&Part) -> bool| {
            let counted = members.iter().filter(|part| is_counted(&self.parts[**part as usize]));
            let covering: Vec<Vec<&[Position]>> = counted.map(|part| self.rings_of(*part)).collect();
            covered_share(outline, bounds, &covering)
        };
        // A roof without walls does not stand on the ground either.
        if Heights::of(tags).is_canopy {
            return share(&|_| true) >= WHOLE;
        }
        let on_ground = share(&|part| part.heights.base_m < ON_GROUND_M);
        if !(MOST..WHOLE).contains(&on_ground) {
            return on_ground >= WHOLE;
        }
        // The outline's height is that of the highest part, or it would bury the others.
        let tops = members.iter().filter_map(|part| self.parts[*part as usize].heights.top_m);
        let is_whole_height = Heights::of(tags).top_m.is_some_and(|top_m| tops.fold(0.0, f64::max) <= top_m);
        is_whole_height || share(&|_| true) >= WHOLE
    }

    fn keep_inherited(&mut self, tags: Tags<'_>) -> Option<u32> {
        let own = INHERITED.iter().filter_map(|key| {
            Some((
                *key,
                tags.get(key).filter(|value| *value != "yes" && value.len() <= MAX_INHERITED_BYTES)?.to_owned(),
            ))
        });
        let own: Vec<(&'static str, String)> = own.collect();
        if own.is_empty() {
            return None;
        }
        self.inherited.push(own);
        u32::try_from(self.inherited.len() - 1).ok()
    }

    fn rings_of(&self, part: u32) -> Vec<&[Position]> {
        let [from, to] = self.parts[part as usize].rings;
        self.rings[from as usize..to as usize].iter().map(|ring| self.points_of(ring)).collect()
    }

    fn point_count(&self, part: u32) -> u64 {
        let [from, to] = self.parts[part as usize].rings;
        self.rings[from as usize..to as usize].iter().map(|ring| u64::from(ring.count)).sum()
    }

    fn points_of(&self, ring: &RingPlace) -> &[Position] {
        &self.points[ring.start as usize..ring.start as usize + ring.count as usize]
    }

    /// The part with a number; `None` if it has another identifier.
    pub(super) fn get(&self, number: usize, id: ElementId) -> Option<KnownPart<'_>> {
        let part = self.parts.get(number).filter(|part| part.id == id)?;
        let mut polygons: Vec<Polygon> = Vec::new();
        for ring in &self.rings[part.rings[0] as usize..part.rings[1] as usize] {
            let points = self.points_of(ring).to_vec();
            match polygons.last_mut().filter(|_| !ring.is_outer) {
                Some(polygon) => polygon.push(points),
                None => polygons.push(vec![points]),
            }
        }
        let inherited = part.inherited.and_then(|number| self.inherited.get(number as usize));
        let inherited = inherited.map(Vec::as_slice).unwrap_or_default();
        Some(KnownPart { parent: part.parent, polygons, inherited, is_supported: part.is_supported })
    }
}

impl Part {
    /// Takes an outline as the parent if it is a better one: with more of the part in it, or else smaller.
    fn offer_parent(&mut self, id: ElementId, share: f64, area: f64, inherited: Option<u32>) {
        let is_better = share > self.parent_share + EQUAL_SHARES
            || share > self.parent_share - EQUAL_SHARES && area < self.parent_area;
        if self.parent.is_none() || is_better {
            (self.parent, self.parent_share, self.parent_area) = (Some(id), share, area);
            self.inherited = inherited;
        }
    }
}
