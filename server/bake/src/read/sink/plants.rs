//! Trees and hedges: crowns on trunks in a few forms by what is known of the kind, and walls of leaves.

use super::SceneSink;
use super::ground_shapes::widen;
use crate::read::scene_builder::{OpenObject, WorldTriangle, hash_of_id};
use crate::scene::ObjectKind;
use insula_dress::facade::FacadeUse;
use insula_dress::footprint::{ResolvedColour, known_height_m, length_m};
use insula_dress::paint::mix_bits;
use insula_dress::palette::{BuildingLook, SurfaceFacts};
use insula_source::attributes::AttributeValue;
use insula_source::error::InputError;
use insula_source::object::{FeatureKind, PointOnGround, SourceObject, Strip};
use insula_source::problems::{NOT_UNDERSTOOD, TREE_HEIGHT, UNKNOWN_POINT};

/// Sides of a crown seen from above, and of a trunk.
const CROWN_SIDES: usize = 6;
const TRUNK_SIDES: usize = 4;
/// Points of a palm's crown.
const PALM_POINTS: usize = 12;
const HEIGHT_RANGE_M: std::ops::RangeInclusive<f64> = 0.3..=120.0;
/// Trees without a height differ by this share, and their crowns from the usual green by that.
const HEIGHT_VARIATION: f64 = 0.2;
const TONES: [f64; 3] = [0.88, 1.0, 1.12];
/// Hedges without a height, and their range.
const HEDGE_M: f64 = 1.3;
const HEDGE_RANGE_M: std::ops::RangeInclusive<f64> = 0.3..=8.0;
/// Kind of the problem that a height is no number, or 0. Heights of buildings are told apart.
const ODD_HEIGHT: &str = "height of a plant not understood, taken as unknown";
/// Bark, 8-bit sRGB.
const BARK: [u8; 3] = [104, 88, 74];

/// What a tree looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TreeForm {
    Round,
    /// Spruces and firs.
    Conical,
    /// Cypresses and Lombardy poplars.
    Columnar,
    /// Stone pines.
    Umbrella,
    Palm,
    /// Without a trunk.
    Shrub,
}

/// Sizes of a form. All but the first are shares of the height.
struct FormSizes {
    height_m: f64,
    /// Of the crown.
    width: f64,
    low: f64,
    /// Radius of the trunk.
    trunk: f64,
}

/// Forms by how a scientific name begins; the first that fits counts.
const NAMES: &[(TreeForm, &[&str])] = &[
    (TreeForm::Palm, &["phoenix", "washingtonia", "trachycarpus", "chamaerops", "syagrus", "cocos", "arecaceae"]),
    (TreeForm::Columnar, &["cupressus", "populus nigra", "thuja", "taxus"]),
    (TreeForm::Umbrella, &["pinus", "cedrus"]),
    (TreeForm::Conical, &["abies", "picea", "larix", "metasequoia", "sequoia", "pseudotsuga", "araucaria"]),
];

impl TreeForm {
    fn of(object: &SourceObject) -> Self {
        let text = |name: &str| object.attributes.get(name).and_then(AttributeValue::as_str);
        if text("natural") == Some("shrub") {
            return Self::Shrub;
        }
        let mut names = ["species", "taxon", "genus"].into_iter().filter_map(text).map(str::to_lowercase);
        let begins = |name: &str, starts: &[&str]| starts.iter().any(|start| name.starts_with(start));
        let by_name =
            names.find_map(|name| NAMES.iter().find(|(_, starts)| begins(&name, starts)).map(|(form, _)| *form));
        by_name.unwrap_or(match text("leaf_type") {
            Some("needleleaved") => Self::Conical,
            Some("palm") => Self::Palm,
            _ => Self::Round,
        })
    }

    fn sizes(self) -> FormSizes {
        let sizes = |height_m, width, low, trunk| FormSizes { height_m, width, low, trunk };
        match self {
            Self::Round => sizes(8.0, 0.62, 0.26, 0.022),
            Self::Conical => sizes(12.0, 0.38, 0.12, 0.016),
            Self::Columnar => sizes(11.0, 0.2, 0.06, 0.014),
            Self::Umbrella => sizes(11.0, 0.75, 0.55, 0.02),
            Self::Palm => sizes(9.0, 0.5, 0.72, 0.018),
            Self::Shrub => sizes(1.6, 0.9, 0.0, 0.0),
        }
    }

    /// How light its leaves are, by those of broadleaved trees.
    fn lightness(self) -> f64 {
        match self {
            Self::Conical | Self::Columnar => 0.8,
            Self::Umbrella => 0.9,
            _ => 1.0,
        }
    }
}

impl SceneSink<'_, '_, '_> {
    /// Adds trees. Points of other kinds have no shape. Fails if the ground's height cannot be read.
    pub(super) fn add_points(&mut self, object: &SourceObject, points: &[PointOnGround]) -> Result<(), InputError> {
        if object.kind != FeatureKind::Vegetation {
            self.report.without_geometry += 1;
            if object.kind == FeatureKind::Generic {
                self.report.problem(UNKNOWN_POINT, || object.id.clone());
            }
            return Ok(());
        }
        let form = TreeForm::of(object);
        let told_m = self.plant_height_m(object);
        let known_m = told_m.filter(|height_m| HEIGHT_RANGE_M.contains(height_m));
        if let (Some(told_m), None) = (told_m, known_m) {
            self.report.problem(TREE_HEIGHT, || format!("{} is {told_m} m", object.id));
        }
        let crown_m = measured_m(object, "diameter_crown").filter(|width_m| HEIGHT_RANGE_M.contains(width_m));
        let bark = self.plant_material(Some(BARK), 1.0);
        let tones = TONES.map(|tone| self.plant_material(None, tone * form.lightness()));
        let mut open = OpenObject::new(ObjectKind::Building);
        let mut fault = None;
        for (number, point) in (0_u64..).zip(points) {
            let Some([x, y]) = self.place_on_map(point.place) else {
                fault = Some("coordinate not a number or out of range");
                continue;
            };
            // Elevation models tell the ground under the tree, too.
            let own_m = self.base_m(object, point.place, point.ground).filter(|_| self.context.elevation.is_empty());
            let ground_m = match own_m {
                Some(own_m) => own_m,
                None => self.context.ground_m([x, y])?,
            };
            let chance = mix_bits(hash_of_id(&object.id) ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            // From 0 to 1 each.
            let [size, turn, tone] = [0, 16, 32].map(|shift| f64::from((chance >> shift) as u16) / 65536.0);
            let sizes = form.sizes();
            let height_m = known_m.unwrap_or(sizes.height_m * (1.0 + HEIGHT_VARIATION * (2.0 * size - 1.0)));
            let tree = PlantedTree {
                foot: [x, y, ground_m],
                height_m,
                radius_m: crown_m.unwrap_or(height_m * sizes.width) / 2.0,
                turn,
                bark,
                leaves: tones[((tone * 3.0) as usize).min(2)],
            };
            tree.add(form, &sizes, &mut self.faces);
        }
        self.context.push(&mut open, &mut self.faces, FacadeUse::Windowless);
        self.finish_areas(object, open, fault);
        Ok(())
    }

    /// Adds hedges along lines. Fails if the ground's height cannot be read.
    pub(super) fn add_hedges(&mut self, object: &SourceObject, strips: &[Strip]) -> Result<(), InputError> {
        let height_m =
            self.plant_height_m(object).filter(|height_m| HEDGE_RANGE_M.contains(height_m)).unwrap_or(HEDGE_M);
        let material = self.plant_material(None, 1.0);
        let mut open = OpenObject::new(ObjectKind::Building);
        let mut fault = None;
        for strip in strips {
            let Some(points) = self.placed_line(strip) else {
                fault = Some("coordinate not a number or out of range");
                continue;
            };
            let lowest = strip.heights.iter().copied().reduce(f64::min);
            let base_m = strip.points.first().and_then(|point| self.base_m(object, *point, lowest));
            let mut quads = Vec::new();
            let level: Vec<[f64; 3]> = points.into_iter().map(|[x, y]| [x, y, 0.0]).collect();
            widen(&level, super::ground_shapes::half_width_m(strip), |quad| quads.push(quad));
            for quad in quads {
                let mut low = [[0.0; 3]; 4];
                for (corner, [x, y, _]) in low.iter_mut().zip(quad) {
                    let ground_m = match base_m.filter(|_| self.context.elevation.is_empty()) {
                        Some(base_m) => base_m,
                        None => self.context.ground_m([x, y])?,
                    };
                    *corner = [x, y, ground_m];
                }
                let high = low.map(|[x, y, z]| [x, y, z + height_m]);
                let mut add = |[a, b, c, d]: [[f64; 3]; 4]| {
                    self.faces.extend([face([a, b, c], material), face([a, c, d], material)]);
                };
                add(high);
                for side in 0..4 {
                    let next = (side + 1) % 4;
                    add([low[side], low[next], high[next], high[side]]);
                }
            }
            self.context.push(&mut open, &mut self.faces, FacadeUse::Windowless);
        }
        self.finish_areas(object, open, fault);
        Ok(())
    }

    /// Height of a plant that its attributes tell, in metres. Reports what is guessed of it, or not understood.
    fn plant_height_m(&mut self, object: &SourceObject) -> Option<f64> {
        let (hints, report) = (self.height_hints(), &mut self.report);
        known_height_m(&object.attributes, hints, |kind, detail| {
            let kind = if kind == NOT_UNDERSTOOD { ODD_HEIGHT } else { kind };
            report.problem(kind, || format!("{}: {detail}", object.id));
        })
    }

    /// Number of the material of a plant: in the palette's colour unless it has its own, lighter by a factor.
    fn plant_material(&mut self, own: Option<[u8; 3]>, lightness: f64) -> u32 {
        let object_type = FeatureKind::Vegetation.cityjson_type();
        let facts = SurfaceFacts { semantic: None, object_type, material: None, normal_z: 1.0 };
        let (green, origin) = self.context.options.palette.resolve(None, &facts, &BuildingLook::PLAIN);
        let rgb = own.unwrap_or(green).map(|v| (f64::from(v) * lightness).round().min(255.0) as u8);
        self.number_of(ResolvedColour { rgb, origin, is_reflective: false })
    }
}

/// A length that an object has, in metres.
fn measured_m(object: &SourceObject, name: &str) -> Option<f64> {
    match object.attributes.get(name)? {
        AttributeValue::Text(text) => length_m(text),
        value => value.as_f64(),
    }
}

fn face(corners: [[f64; 3]; 3], material: u32) -> WorldTriangle {
    WorldTriangle { corners, uv: [[0.0; 2]; 3], material, is_facade: false }
}

struct PlantedTree {
    foot: [f64; 3],
    height_m: f64,
    /// Of the crown.
    radius_m: f64,
    /// Turns about the trunk.
    turn: f64,
    bark: u32,
    leaves: u32,
}

impl PlantedTree {
    fn add(&self, form: TreeForm, sizes: &FormSizes, faces: &mut Vec<WorldTriangle>) {
        let crown_m = 1.0 - sizes.low;
        if sizes.trunk > 0.0 {
            // Into the crown, so that no gap shows.
            let top = sizes.low + 0.2 * crown_m;
            self.add_trunk(top, sizes.trunk * self.height_m, faces);
        }
        // Heights as shares of the crown, and radii as shares of its radius.
        match form {
            TreeForm::Round => self.add_crown(sizes.low, 0.0, &[(0.28, 0.86), (0.62, 1.0)], faces),
            TreeForm::Columnar => self.add_crown(sizes.low, 0.0, &[(0.15, 0.8), (0.5, 1.0)], faces),
            TreeForm::Umbrella => self.add_crown(sizes.low, 0.15, &[(0.35, 1.0), (0.75, 0.75)], faces),
            TreeForm::Shrub => self.add_crown(0.0, 0.0, &[(0.2, 0.95), (0.65, 0.8)], faces),
            TreeForm::Conical => self.add_crown(sizes.low, 0.06, &[(0.04, 1.0), (0.5, 0.52)], faces),
            TreeForm::Palm => self.add_fronds(sizes.low, faces),
        }
    }

    /// A point at a share of the height and at a radius.
    fn at(&self, side: usize, sides: usize, height: f64, radius_m: f64) -> [f64; 3] {
        let (sin, cos) = libm::sincos((side as f64 / sides as f64 + self.turn) * std::f64::consts::TAU);
        let [x, y, z] = self.foot;
        [x + radius_m * cos, y + radius_m * sin, z + height * self.height_m]
    }

    fn add_trunk(&self, top: f64, radius_m: f64, faces: &mut Vec<WorldTriangle>) {
        for side in 0..TRUNK_SIDES {
            let point =
                |side: usize, height: f64, radius_m: f64| self.at(side % TRUNK_SIDES, TRUNK_SIDES, height, radius_m);
            let (a, b) = (point(side, 0.0, 1.25 * radius_m), point(side + 1, 0.0, 1.25 * radius_m));
            let (c, d) = (point(side + 1, top, radius_m), point(side, top, radius_m));
            faces.extend([face([a, b, c], self.bark), face([a, c, d], self.bark)]);
        }
    }

    /// A crown of two rings between a lower and an upper point. The lower point is a share of the crown above its lower end.
    fn add_crown(&self, low: f64, dent: f64, rings: &[(f64, f64); 2], faces: &mut Vec<WorldTriangle>) {
        let height = |share: f64| low + share * (1.0 - low);
        let point = |side: usize, ring: usize| {
            let (share, radius) = rings[ring];
            // Every other corner of the upper ring stands back, for a rougher outline.
            let rough = if (side + ring).is_multiple_of(2) { 1.0 } else { 0.9 };
            self.at(side % CROWN_SIDES, CROWN_SIDES, height(share), self.radius_m * radius * rough)
        };
        let (bottom, top) = (self.at(0, 1, height(dent), 0.0), self.at(0, 1, 1.0, 0.0));
        for side in 0..CROWN_SIDES {
            let [a, b] = [side, side + 1].map(|side| point(side, 0));
            let [c, d] = [side + 1, side].map(|side| point(side, 1));
            let quad = [face([a, b, c], self.leaves), face([a, c, d], self.leaves)];
            faces.extend([face([b, a, bottom], self.leaves), face([d, c, top], self.leaves)]);
            faces.extend(quad);
        }
    }

    /// The crown of a palm: a star that hangs down at its points.
    fn add_fronds(&self, low: f64, faces: &mut Vec<WorldTriangle>) {
        let point = |side: usize| {
            let side = side % PALM_POINTS;
            let (height, radius) = if side.is_multiple_of(2) { (low + 0.06, 1.0) } else { (low + 0.2, 0.4) };
            self.at(side, PALM_POINTS, height, self.radius_m * radius)
        };
        let (bottom, top) = (self.at(0, 1, low + 0.08, 0.0), self.at(0, 1, 1.0, 0.0));
        for side in 0..PALM_POINTS {
            let (a, b) = (point(side), point(side + 1));
            faces.extend([face([a, b, top], self.leaves), face([b, a, bottom], self.leaves)]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    const FORMS: [TreeForm; 6] =
        [TreeForm::Round, TreeForm::Conical, TreeForm::Columnar, TreeForm::Umbrella, TreeForm::Palm, TreeForm::Shrub];

    fn faces(form: TreeForm) -> Vec<WorldTriangle> {
        let sizes = form.sizes();
        let (height_m, radius_m) = (sizes.height_m, sizes.height_m * sizes.width / 2.0);
        let tree = PlantedTree { foot: [5.0, 6.0, 7.0], height_m, radius_m, turn: 0.3, bark: 0, leaves: 1 };
        let mut faces = Vec::new();
        tree.add(form, &sizes, &mut faces);
        faces
    }

    #[test]
    fn trees_are_small_closed_and_have_their_size() {
        for form in FORMS {
            let (faces, sizes) = (faces(form), form.sizes());
            assert!(faces.len() <= 60, "{form:?} {}", faces.len());
            let crown: Vec<&WorldTriangle> = faces.iter().filter(|face| face.material == 1).collect();
            let mut edges: HashMap<[[u64; 3]; 2], i32> = HashMap::new();
            let mut volume = 0.0;
            for face in &crown {
                let corners = face.corners.map(|corner| corner.map(f64::to_bits));
                for i in 0..3 {
                    let (a, b) = (corners[i], corners[(i + 1) % 3]);
                    *edges.entry(if a < b { [a, b] } else { [b, a] }).or_default() += if a < b { 1 } else { -1 };
                }
                let [a, b, c] = face.corners.map(|[x, y, z]| glam::DVec3::new(x - 5.0, y - 6.0, z - 7.0));
                volume += a.dot(b.cross(c)) / 6.0;
            }
            assert!(edges.values().all(|sum| *sum == 0), "{form:?}: the crown is closed");
            assert!(volume > 0.0, "{form:?}: it is seen from outside");
            let heights = || faces.iter().flat_map(|face| face.corners).map(|corner| corner[2]);
            assert_eq!(heights().fold(f64::MIN, f64::max), 7.0 + sizes.height_m, "{form:?}");
            let foot = heights().fold(f64::MAX, f64::min);
            assert!((7.0..7.1).contains(&foot), "{form:?} {foot}");
        }
    }
}
