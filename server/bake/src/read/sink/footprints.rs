//! Areas on the map: buildings by their attributes, other kinds as level surfaces.

use super::SceneSink;
use super::painted::stands_in_water;
use crate::read::scene_builder::{OpenObject, WorldTriangle};
use crate::scene::ObjectKind;
use crate::scene::scratch_scene::StoredMaterial;
use insula_dress::facade::FacadeUse;
use insula_dress::footprint::{
    BuildingHeight, Canopy, GroundPlan, GroundPlans, HeightHints, PrismMaterials, ResolvedColour, RoofTags,
    building_colours, by_use, needs_ground, posts,
};
use insula_dress::palette::{BuildingLook, ObjectShape, SurfaceFacts, WallKind};
use insula_dress::roof;
use insula_read_ground::HEIGHTS_M;
use insula_source::error::InputError;
use insula_source::object::{FeatureKind, Footprint, SourceObject, Surface, SurfaceRole};
use insula_source::problems::{GUESSED, GUESSED_FROM_LEVELS};

/// Height of piers and breakwaters above the water.
const PIER_M: f64 = 0.8;

/// Heights of level surfaces above the ground of the footprints, so that roads are drawn over land use, and rails over
/// roads.
pub(super) fn layer_m(object: &SourceObject) -> f64 {
    if stands_in_water(object) {
        return PIER_M;
    }
    match object.kind {
        FeatureKind::LandUse => 0.01,
        FeatureKind::Vegetation => 0.02,
        FeatureKind::Road => 0.05,
        FeatureKind::Rail => 0.07,
        _ => 0.0,
    }
}

/// How a building is made of its plan.
struct BuildingForm {
    height: BuildingHeight,
    /// Of a roof without walls.
    canopy: Option<Canopy>,
    roof: Option<RoofTags>,
    materials: PrismMaterials,
    facade_use: FacadeUse,
}

impl<'o> SceneSink<'_, 'o, '_> {
    /// Whether footprints lie outside of the wanted area. The scene builder sees that, too, but what is made of them, such as guessed
    /// heights, is counted by then.
    fn is_outside(&mut self, footprints: &[Footprint]) -> bool {
        let context = &mut *self.context;
        let Some([low, high]) = *self.wanted.get_or_insert_with(|| context.wanted_area()) else { return false };
        let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in footprints.iter().flat_map(|footprint| &footprint.rings).flatten() {
            let Some(place) = self.place_on_map(*corner) else { continue };
            (least, most) = ([0, 1].map(|k| least[k].min(place[k])), [0, 1].map(|k| most[k].max(place[k])));
        }
        // Without a place at all, they are skipped for that.
        least[0] <= most[0] && (0..2).any(|axis| most[axis] < low[axis] || least[axis] > high[axis])
    }

    /// Adds footprints of a building as one object, unless it is outside of the wanted area. Fails if the ground's height cannot be read.
    pub(super) fn add_buildings(&mut self, object: &SourceObject, footprints: &[Footprint]) -> Result<(), InputError> {
        if self.is_outside(footprints) {
            self.report.outside_bbox += 1;
            return Ok(());
        }
        let hints = self.hints_with_ground(object, footprints)?;
        let form = self.building_form(object, hints);
        let mut open = OpenObject::new(ObjectKind::Building);
        let mut fault = None;
        for footprint in footprints {
            let plans = self.ground_plans(object, footprint).unwrap_or_else(|reason| {
                fault = Some(reason);
                Vec::new()
            });
            for plan in plans {
                self.faces.clear();
                match self.build(object, footprint, &plan, &form) {
                    Ok(()) => {
                        let ground_m = match self.base_of_footprint(object, footprint) {
                            Some(base_m) => {
                                open.has_own_base = true;
                                base_m
                            }
                            None => self.lowest_ground_m(&plan.rings)?,
                        };
                        self.lift(ground_m);
                        if form.height.base_m > 0.0 {
                            open.ground_m = Some(open.ground_m.map_or(ground_m, |lowest| lowest.min(ground_m)));
                        }
                    }
                    Err(reason) => fault = Some(reason),
                }
                self.context.push(&mut open, &mut self.faces, form.facade_use);
            }
        }
        self.finish_areas(object, open, fault);
        Ok(())
    }

    /// Adds areas as surfaces on the ground. Fails if its height cannot be read.
    pub(super) fn add_areas(&mut self, object: &SourceObject, footprints: &[Footprint]) -> Result<(), InputError> {
        let material = self.flat_material(object.kind);
        let mut open = OpenObject::new(ObjectKind::Terrain);
        let mut fault = None;
        for footprint in footprints {
            let plans = self.ground_plans(object, footprint).unwrap_or_else(|reason| {
                fault = Some(reason);
                Vec::new()
            });
            for plan in plans {
                self.faces.clear();
                let (triangulator, faces) = (&mut self.context.triangulator, &mut self.faces);
                match plan.cover(layer_m(object), material, triangulator, faces) {
                    Ok(areas) => areas.note_in(&mut self.report, &object.id),
                    Err(reason) => fault = Some(reason),
                }
                let base_m = self.base_of_footprint(object, footprint);
                self.drape(base_m)?;
                self.context.push(&mut open, &mut self.faces, FacadeUse::Windowless);
            }
        }
        self.finish_areas(object, open, fault);
        Ok(())
    }

    /// World height of the ground under an area, where the source tells it.
    fn base_of_footprint(&mut self, object: &SourceObject, footprint: &Footprint) -> Option<f64> {
        let corner = *footprint.rings.first()?.first()?;
        self.base_m(object, corner, footprint.ground)
    }

    /// Number of the material of a flat kind, by the palette.
    pub(super) fn flat_material(&mut self, kind: FeatureKind) -> u32 {
        let facts = SurfaceFacts { semantic: None, object_type: kind.cityjson_type(), material: None, normal_z: 1.0 };
        let (rgb, origin) = self.context.options.palette.resolve(None, &facts, &BuildingLook::PLAIN);
        self.number_of(ResolvedColour { rgb, origin, is_reflective: facts.is_reflective() })
    }

    /// Ends an object of areas. Without triangles it is skipped for the last fault.
    pub(super) fn finish_areas(&mut self, object: &SourceObject, open: OpenObject, fault: Option<&'static str>) {
        let id = || object.id.clone();
        match fault {
            Some(reason) if open.triangles == 0 => self.report.skip(reason, id),
            Some(reason) => self.report.problem(reason, id),
            None if open.triangles == 0 => self.report.skip("no surface with an area", id),
            None => {}
        }
        self.close(object, open);
    }

    /// The plans of an area. Fails with the reason if it has none.
    fn ground_plans(&mut self, object: &SourceObject, footprint: &Footprint) -> Result<Vec<GroundPlan>, &'static str> {
        let mut notes = Vec::new();
        let found = GroundPlans::new(&footprint.rings, |point| self.place_on_map(point), |note| notes.push(note));
        notes.into_iter().for_each(|note| self.report.problem(note, || object.id.clone()));
        let GroundPlans { plans, areas } = found?;
        areas.note_in(&mut self.report, &object.id);
        Ok(plans)
    }

    /// What is known of the heights of a building besides its attributes, with the ground if they tell its top above sea level only.
    /// Fails if an elevation model cannot be read.
    fn hints_with_ground(
        &mut self,
        object: &SourceObject,
        footprints: &[Footprint],
    ) -> Result<HeightHints<'o>, InputError> {
        let hints = self.height_hints();
        if !needs_ground(&object.attributes, hints) {
            return Ok(hints);
        }
        let own = footprints.iter().filter_map(|footprint| {
            let [x, y] = *footprint.rings.first()?.first()?;
            Some(self.place([x, y, footprint.ground?])?[2])
        });
        let mut ground_m = own.filter(|base_m| HEIGHTS_M.contains(base_m)).reduce(f64::min);
        if ground_m.is_none() && !self.context.elevation.is_empty() {
            let corners = footprints.iter().filter_map(|footprint| footprint.rings.first()).flatten();
            let places: Vec<[f64; 2]> = corners.filter_map(|corner| self.place_on_map(*corner)).collect();
            ground_m = Some(self.lowest_ground_m(&[places])?);
        }
        Ok(HeightHints { ground_m, ..hints })
    }

    fn building_form(&mut self, object: &SourceObject, hints: HeightHints<'_>) -> BuildingForm {
        let (id, attributes) = (&object.id, &object.attributes);
        let options = self.context.options;
        let report = &mut self.report;
        report.footprints += 1;
        let canopy = Canopy::of(attributes);
        let mut is_told = hints.unit.is_none();
        let note = |kind: &str, detail: &str| {
            is_told &= !matches!(kind, GUESSED | GUESSED_FROM_LEVELS);
            report.problem(kind, || format!("{id}: {detail}"));
        };
        let height = match canopy {
            Some(canopy) => canopy.height(attributes, hints, note),
            None => BuildingHeight::of(attributes, hints, note),
        };
        if is_told {
            self.told_heights.add(id, height.top_m);
        }
        let roof = RoofTags::of(attributes, hints, |kind, detail| {
            report.problem(kind, || format!("{id}: {detail}"));
        });
        let look = BuildingLook::new(id, by_use(attributes, WallKind::of_use), &ObjectShape::default());
        let colours = building_colours(attributes, &options.palette, &look, |detail| {
            report.problem("colour not understood", || format!("{id}: {detail}"));
        });
        let windows = by_use(attributes, FacadeUse::of_use).unwrap_or_default();
        // Walls of glass need no windows.
        let is_windowless = colours.wall.is_reflective || canopy.is_some() || object.kind == FeatureKind::Generic;
        let facade_use = if is_windowless { FacadeUse::Windowless } else { windows };
        let [roof_number, wall, floor] =
            [colours.roof, colours.wall, colours.floor].map(|colour| self.number_of(colour));
        let materials = PrismMaterials { roof: roof_number, wall, floor };
        BuildingForm { height, canopy, roof, materials, facade_use }
    }

    pub(super) fn number_of(&mut self, ResolvedColour { rgb, origin, is_reflective }: ResolvedColour) -> u32 {
        self.report.colours.add(origin);
        self.context.builder.material(StoredMaterial { rgb, texture: None, is_reflective })
    }

    /// Makes a building of a plan. Fails with the reason if there is nothing to make.
    fn build(
        &mut self,
        object: &SourceObject,
        footprint: &Footprint,
        plan: &GroundPlan,
        form: &BuildingForm,
    ) -> Result<(), &'static str> {
        let base_m =
            |eaves_m: f64| form.canopy.map_or(form.height.base_m, |canopy| canopy.base_m(&form.height, eaves_m));
        let posts_m = |base_m: f64| if form.canopy.is_some() && !footprint.is_supported { base_m } else { 0.0 };
        if let Some(tags) = &form.roof {
            let mut spec = tags.spec(&plan.rings, &form.height);
            spec.base_m = base_m(spec.eaves_m);
            match roof::build(&plan.rings, &spec) {
                Ok(surfaces) => {
                    surfaces.iter().for_each(|surface| self.add_roof_surface(object, surface, &form.materials));
                    return self.add_posts(plan, posts_m(spec.base_m), form.materials);
                }
                Err(fault) => self.report.problem("roof made flat", || format!("{}: {fault}", object.id)),
            }
        }
        let height = BuildingHeight { base_m: base_m(form.height.top_m), ..form.height };
        let (triangulator, faces) = (&mut self.context.triangulator, &mut self.faces);
        let areas = plan.extrude(&height, form.materials, triangulator, faces)?;
        areas.note_in(&mut self.report, &object.id);
        self.add_posts(plan, posts_m(height.base_m), form.materials)
    }

    /// Adds posts of a height below a roof.
    fn add_posts(&mut self, plan: &GroundPlan, top_m: f64, materials: PrismMaterials) -> Result<(), &'static str> {
        let height = BuildingHeight { base_m: 0.0, top_m, is_without_roof: false };
        for post in posts(plan, top_m) {
            let first = self.faces.len();
            post.extrude(&height, materials, &mut self.context.triangulator, &mut self.faces)?;
            self.faces[first..].iter_mut().for_each(|face| face.is_facade = false);
        }
        Ok(())
    }

    /// Adds a surface of a building with a roof.
    fn add_roof_surface(&mut self, object: &SourceObject, surface: &Surface, materials: &PrismMaterials) {
        let (material, is_facade) = match surface.role {
            SurfaceRole::Roof => (materials.roof, false),
            SurfaceRole::Ground => (materials.floor, false),
            _ => (materials.wall, true),
        };
        match self.context.triangulator.triangulate(&surface.points, &surface.hole_starts) {
            Ok(triangles) => self.faces.extend(triangles.list.iter().map(|triangle| WorldTriangle {
                corners: triangle.map(|i| surface.points[i as usize]),
                uv: [[0.0; 2]; 3],
                material,
                is_facade,
            })),
            Err(fault) => self.report.problem(fault.reason(), || object.id.clone()),
        }
    }
}
