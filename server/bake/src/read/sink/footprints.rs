//! Areas on the map: buildings by their attributes, other kinds as level surfaces.

use super::SceneSink;
use super::painted::stands_in_water;
use crate::error::InputError;
use crate::read::facade::FacadeUse;
use crate::read::footprint::{
    BuildingHeight, GroundPlan, PrismMaterials, ResolvedColour, RoofTags, building_colours, by_use,
};
use crate::read::object::{FeatureKind, Footprint, SourceObject, Surface, SurfaceRole};
use crate::read::palette::{BuildingLook, ObjectShape, SurfaceFacts, WallKind};
use crate::read::roof;
use crate::read::scene_builder::{OpenObject, WorldTriangle};
use crate::scene::{ObjectKind, scratch_scene::StoredMaterial};

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
    roof: Option<RoofTags>,
    materials: PrismMaterials,
    facade_use: FacadeUse,
}

impl SceneSink<'_, '_, '_> {
    /// Adds footprints of a building as one object. Fails if the ground's height cannot be read.
    pub(super) fn add_buildings(&mut self, object: &SourceObject, footprints: &[Footprint]) -> Result<(), InputError> {
        let form = self.building_form(object);
        let mut open = OpenObject::new(ObjectKind::Building);
        let mut fault = None;
        for footprint in footprints {
            self.faces.clear();
            let plan = self.ground_plan(object, footprint);
            match plan.and_then(|plan| self.build(object, &plan, &form).map(|()| plan)) {
                Ok(plan) => {
                    let ground_m = match self.base_of_footprint(object, footprint) {
                        Some(base_m) => {
                            self.lift(base_m);
                            open.has_own_base = true;
                            base_m
                        }
                        None => self.stand(&plan.rings)?,
                    };
                    if form.height.base_m > 0.0 {
                        open.ground_m = Some(open.ground_m.map_or(ground_m, |lowest| lowest.min(ground_m)));
                    }
                }
                Err(reason) => fault = Some(reason),
            }
            self.context.push(&mut open, &mut self.faces, form.facade_use);
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
            self.faces.clear();
            let covered = self.ground_plan(object, footprint).and_then(|plan| {
                let (triangulator, faces) = (&mut self.context.triangulator, &mut self.faces);
                plan.cover(layer_m(object), material, triangulator, faces)
            });
            match covered {
                Ok(true) => {}
                Ok(false) => self.report.problem("ring crosses itself", || object.id.clone()),
                Err(reason) => fault = Some(reason),
            }
            let base_m = self.base_of_footprint(object, footprint);
            self.drape(base_m)?;
            self.context.push(&mut open, &mut self.faces, FacadeUse::Windowless);
        }
        self.finish_areas(object, open, fault);
        Ok(())
    }

    /// World height of the ground under an area, where the source has one.
    fn base_of_footprint(&mut self, object: &SourceObject, footprint: &Footprint) -> Option<f64> {
        let corner = *footprint.rings.first()?.first()?;
        self.base_m(object, corner, footprint.base_z)
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

    fn ground_plan(&mut self, object: &SourceObject, footprint: &Footprint) -> Result<GroundPlan, &'static str> {
        let mut notes = Vec::new();
        let plan = GroundPlan::new(&footprint.rings, |point| self.place_on_map(point), |note| notes.push(note));
        notes.into_iter().for_each(|note| self.report.problem(note, || object.id.clone()));
        plan
    }

    fn building_form(&mut self, object: &SourceObject) -> BuildingForm {
        let (id, attributes) = (&object.id, &object.attributes);
        let (options, hints) = (self.context.options, self.height_hints());
        let report = &mut self.report;
        report.footprints += 1;
        let height = BuildingHeight::of(attributes, hints, |kind, detail| {
            report.problem(kind, || format!("{id}: {detail}"));
        });
        let roof = RoofTags::of(attributes, |name| {
            report.problem("shape of roof not known, made flat", || format!("{id}: {name}"));
        });
        let look = BuildingLook::new(id, by_use(attributes, WallKind::of_use), &ObjectShape::new());
        let colours = building_colours(attributes, &options.palette, &look, |detail| {
            report.problem("colour not understood", || format!("{id}: {detail}"));
        });
        let windows = by_use(attributes, FacadeUse::of_use).unwrap_or_default();
        // Walls of glass need no windows.
        let facade_use = if colours.wall.is_reflective { FacadeUse::Windowless } else { windows };
        let [roof_number, wall, floor] =
            [colours.roof, colours.wall, colours.floor].map(|colour| self.number_of(colour));
        BuildingForm { height, roof, materials: PrismMaterials { roof: roof_number, wall, floor }, facade_use }
    }

    pub(super) fn number_of(&mut self, ResolvedColour { rgb, origin, is_reflective }: ResolvedColour) -> u32 {
        self.report.colours.add(origin);
        self.context.builder.material(StoredMaterial { rgb, texture: None, is_reflective })
    }

    /// Makes a building of a plan. Fails with the reason if there is nothing to make.
    fn build(&mut self, object: &SourceObject, plan: &GroundPlan, form: &BuildingForm) -> Result<(), &'static str> {
        if let Some(tags) = &form.roof {
            match roof::build(&plan.rings, &tags.spec(&plan.rings, &form.height)) {
                Ok(surfaces) => {
                    surfaces.iter().for_each(|surface| self.add_part(object, surface, &form.materials));
                    return Ok(());
                }
                Err(fault) => self.report.problem("roof made flat", || format!("{}: {fault}", object.id)),
            }
        }
        let (triangulator, faces) = (&mut self.context.triangulator, &mut self.faces);
        if !plan.extrude(&form.height, form.materials, triangulator, faces)? {
            self.report.problem("ring crosses itself", || object.id.clone());
        }
        Ok(())
    }

    /// Adds a surface of a building with a roof.
    fn add_part(&mut self, object: &SourceObject, surface: &Surface, materials: &PrismMaterials) {
        let (material, is_facade) = match surface.role {
            SurfaceRole::Roof => (materials.roof, false),
            SurfaceRole::Ground => (materials.floor, false),
            _ => (materials.wall, true),
        };
        match self.context.triangulator.triangulate(&surface.points, &surface.hole_starts) {
            Ok(triangles) => self.faces.extend(triangles.iter().map(|triangle| WorldTriangle {
                corners: triangle.map(|i| surface.points[i as usize]),
                uv: [[0.0; 2]; 3],
                material,
                is_facade,
            })),
            Err(fault) => self.report.problem(fault.reason(), || object.id.clone()),
        }
    }
}
