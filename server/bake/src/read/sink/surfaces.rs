//! Surfaces and meshes in space: placed, triangulated and coloured.

use super::materials::ReadMaterial;
use super::outward::{Facing, ShellSums, has_direction};
use super::{FLUSH_TRIANGLES, SceneSink};
use crate::read::scene_builder::{OpenObject, WorldTriangle};
use crate::scene::scratch_scene::StoredMaterial;
use insula_dress::alpha_mask::{AlphaMask, Piece};
use insula_dress::facade::FacadeUse;
use insula_dress::footprint::by_use;
use insula_dress::image_cut::cut_at_images;
use insula_dress::palette::{BuildingLook, ObjectShape, SurfaceFacts, WallKind, area_vector, normal_z, object_kind};
use insula_dress::polygon::CROSSING;
use insula_source::object::{FeatureKind, SourceObject, Surface, SurfaceRole, TriangleMesh, WholeBuilding, Wrap};
use insula_source::report::ColourOrigin;

/// An object of a flat kind is a volume if its surfaces that face down have this share of the area of those that face up.
const VOLUME_SHARE: f64 = 0.3;
/// Bits by which the colours of vertices are rounded, so that a scan does not have a material for each of its triangles.
const VERTEX_COLOUR_BITS: u32 = 3;

/// The edges of holes are true to this part of a cell.
const MIN_EDGE_CELLS: f64 = 0.125;

/// What the surfaces of an object have in common.
struct ObjectLook<'o> {
    /// As in CityJSON.
    object_type: &'o str,
    look: BuildingLook,
    facade_use: FacadeUse,
    /// Whether all triangles are turned to their other side.
    is_turned: bool,
}

/// World positions of a mesh's positions; `None` for those that are invalid.
type PlacedMesh = Vec<Option<[f64; 3]>>;

/// Colour, texture and kind of a surface.
#[derive(Clone, Copy)]
struct SurfaceLook {
    /// Number of the scene's material.
    material: u32,
    wrap: Option<Wrap>,
    /// Number of the mask that cuts holes.
    mask: Option<u32>,
    is_facade: bool,
}

/// A look whose material has no number in the scene yet.
struct UnnumberedLook {
    stored: StoredMaterial,
    origin: ColourOrigin,
    look: SurfaceLook,
}

impl SceneSink<'_, '_, '_> {
    /// Adds the surfaces of an object in space.
    pub(super) fn add_surfaces(
        &mut self,
        object: &SourceObject,
        polygons: &[Surface],
        meshes: &[TriangleMesh],
        whole: Option<WholeBuilding<'_>>,
    ) {
        let placed: Vec<Vec<[f64; 3]>> = polygons.iter().map(|surface| self.place_surface(object, surface)).collect();
        let placed_meshes: Vec<PlacedMesh> = meshes
            .iter()
            .map(|mesh| mesh.positions.iter().map(|position| self.place_in_space(*position)).collect())
            .collect();
        let is_turned = self.is_turned(object, (polygons, &placed), (meshes, &placed_meshes));
        let mut shape = ObjectShape::default();
        let (mut up_m2, mut down_m2) = (0.0, 0.0);
        for (surface, points) in polygons.iter().zip(&placed) {
            let z = area_vector(outer_ring(surface, points)).z;
            let z = if is_turned { -z } else { z };
            shape.add(z);
            up_m2 += z.max(0.0);
            down_m2 += (-z).max(0.0);
        }
        let is_building = matches!(object.kind, FeatureKind::Building | FeatureKind::BuildingPart);
        let own = WholeBuilding { id: object.parent.as_deref().unwrap_or(&object.id), attributes: &object.attributes };
        let WholeBuilding { id, attributes } = whole.unwrap_or(own);
        let mut look = ObjectLook {
            // A source may use the palette's own names, which say more than kinds.
            object_type: match self.context.options.palette.knows_object(&object.source_type) {
                true => &object.source_type,
                false => object.kind.cityjson_type(),
            },
            look: match is_building {
                true => BuildingLook::new(id, by_use(attributes, WallKind::of_use), &shape),
                false => BuildingLook::PLAIN,
            },
            facade_use: by_use(attributes, FacadeUse::of_use).unwrap_or_default(),
            is_turned,
        };
        // A model with windows of its own needs no others.
        if polygons.iter().any(|surface| matches!(surface.role, SurfaceRole::Window | SurfaceRole::Door)) {
            look.facade_use = FacadeUse::Windowless;
        }
        let has_volume = down_m2 > VOLUME_SHARE * up_m2;
        let mut open = OpenObject::new(object_kind(look.object_type, has_volume));
        open.has_own_base = matches!(look.object_type, "Building" | "BuildingPart");
        for (surface, points) in polygons.iter().zip(&placed) {
            self.add_surface(object, surface, points, &look);
            if self.faces.len() >= FLUSH_TRIANGLES && !self.flush(&mut open, look.facade_use) {
                break;
            }
        }
        for (mesh, placed) in meshes.iter().zip(&placed_meshes) {
            if !self.add_mesh(object, (mesh, placed), &look, &mut open) {
                break;
            }
        }
        self.flush(&mut open, look.facade_use);
        if open.triangles == 0 {
            self.report.skip("no surface with an area", || object.id.clone());
        }
        self.close(object, open);
    }

    /// Whether the surfaces of an object look to the wrong side.
    fn is_turned(
        &mut self,
        object: &SourceObject,
        polygons: (&[Surface], &[Vec<[f64; 3]>]),
        meshes: (&[TriangleMesh], &[PlacedMesh]),
    ) -> bool {
        let mut sums = ShellSums::default();
        for (surface, points) in polygons.0.iter().zip(polygons.1) {
            sums.add_polygon(points, &surface.hole_starts);
        }
        for (mesh, placed) in meshes.0.iter().zip(meshes.1) {
            mesh.triangles.iter().filter_map(|triangle| corners_of(*triangle, placed)).for_each(|corners| {
                sums.add_triangle(&corners);
            });
        }
        let (facing, has_direction) = (sums.facing(), has_direction(self.report.format));
        if has_direction {
            self.facings.add(facing);
        }
        match facing {
            Facing::Outward => false,
            Facing::Down => !has_direction,
            Facing::Inward => {
                if has_direction {
                    self.report.problem("body inside out, turned", || object.id.clone());
                }
                true
            }
        }
    }

    /// World positions of a surface's corners; none if one is invalid.
    fn place_surface(&mut self, object: &SourceObject, surface: &Surface) -> Vec<[f64; 3]> {
        let points: Option<Vec<[f64; 3]>> = surface.points.iter().map(|point| self.place_in_space(*point)).collect();
        points.unwrap_or_else(|| {
            self.report.problem("coordinate not a number or out of range", || place(object, surface));
            Vec::new()
        })
    }

    fn add_surface(&mut self, object: &SourceObject, surface: &Surface, points: &[[f64; 3]], look: &ObjectLook<'_>) {
        if points.is_empty() {
            return;
        }
        let material = self.materials.get(surface.material);
        if material.is_some_and(|material| material.is_invisible) {
            self.report.problem("invisible surface left out", || object.id.clone());
            return;
        }
        let semantic = surface.semantic.as_deref().or(surface.role.cityjson_semantic());
        let has_uv = surface.uv.len() == points.len();
        let drawn = self.surface_look(semantic, normal_z(outer_ring(surface, points)), material, has_uv, look);
        let triangles = match self.context.triangulator.triangulate(points, &surface.hole_starts) {
            Ok(triangles) => triangles,
            Err(fault) => {
                self.report.problem(fault.reason(), || format!("{}: {} corners", place(object, surface), points.len()));
                return;
            }
        };
        let min_edge_m = self.context.options.cell_m * MIN_EDGE_CELLS;
        if let Some(difference) = triangles.areas.difference() {
            self.report.problem(CROSSING, || format!("{}: {difference}", place(object, surface)));
        }
        self.report.colours.add(drawn.origin);
        let drawn = SurfaceLook { material: self.context.builder.material(drawn.stored), ..drawn.look };
        for triangle in triangles.list {
            let triangle = look.turned(*triangle);
            let corners = triangle.map(|i| points[i as usize]);
            let uv = triangle.map(|i| surface.uv.get(i as usize).map_or([0.0; 2], |uv| drawn.uv(*uv)));
            let mask = self.materials.mask(drawn.mask);
            drawn.add_triangle(corners, uv, mask, min_edge_m, &mut self.faces);
        }
    }

    /// Adds a mesh. Returns whether the object may have more triangles.
    fn add_mesh(
        &mut self,
        object: &SourceObject,
        (mesh, placed): (&TriangleMesh, &PlacedMesh),
        look: &ObjectLook<'_>,
        open: &mut OpenObject,
    ) -> bool {
        let material = self.materials.get(mesh.material);
        if material.is_some_and(|material| material.is_invisible) {
            self.report.problem("invisible surface left out", || object.id.clone());
            return true;
        }
        let has_uv = mesh.uv.len() == mesh.positions.len();
        let min_edge_m = self.context.options.cell_m * MIN_EDGE_CELLS;
        let mut last: Option<(f64, Option<[u8; 3]>, SurfaceLook)> = None;
        for triangle in &mesh.triangles {
            let triangle = look.turned(*triangle);
            let Some(corners) = corners_of(triangle, placed) else {
                self.report.problem("coordinate not a number or out of range", || object.id.clone());
                continue;
            };
            let normal_z = normal_z(&corners);
            let colour = mean_colour(mesh, triangle);
            let drawn = match last {
                Some((of_normal, of_colour, drawn)) if of_normal == normal_z && of_colour == colour => drawn,
                _ => {
                    let UnnumberedLook { stored, origin, look } =
                        self.surface_look(None, normal_z, tint(material, colour), has_uv, look);
                    self.report.colours.add(origin);
                    SurfaceLook { material: self.context.builder.material(stored), ..look }
                }
            };
            last = Some((normal_z, colour, drawn));
            let uv = triangle.map(|i| mesh.uv.get(i as usize).map_or([0.0; 2], |uv| drawn.uv(*uv)));
            let mask = self.materials.mask(drawn.mask);
            drawn.add_triangle(corners, uv, mask, min_edge_m, &mut self.faces);
            if self.faces.len() >= FLUSH_TRIANGLES && !self.flush(open, look.facade_use) {
                return false;
            }
        }
        true
    }

    /// The colour and texture of a surface. The palette gives them if the source does not. `semantic` is its type in CityJSON.
    fn surface_look(
        &self,
        semantic: Option<&str>,
        normal_z: f64,
        material: Option<ReadMaterial>,
        has_uv: bool,
        object: &ObjectLook<'_>,
    ) -> UnnumberedLook {
        let name = self.materials.name(material);
        let facts = SurfaceFacts { semantic, object_type: object.object_type, material: name, normal_z };
        let material = material.unwrap_or(ReadMaterial::PLAIN);
        let texture = material.texture.filter(|_| has_uv);
        let (rgb, origin) = match texture {
            Some(_) => (material.rgb.unwrap_or([255; 3]), ColourOrigin::Texture),
            None => match material.untextured_rgb.or(material.rgb) {
                Some(exact) if material.is_exact => (exact, ColourOrigin::Source),
                own => self.context.options.palette.resolve(own, &facts, &object.look),
            },
        };
        let is_reflective = facts.is_reflective() || material.is_reflective;
        let is_facade = texture.is_none()
            && !is_reflective
            && !material.is_opening
            && matches!(object.object_type, "Building" | "BuildingPart" | "BuildingUnit" | "BuildingStorey")
            && matches!(semantic, None | Some("WallSurface"));
        let look = SurfaceLook {
            material: 0,
            wrap: texture.map(|(_, wrap)| wrap),
            mask: texture.and(material.mask),
            is_facade,
        };
        let stored = StoredMaterial { rgb, texture: texture.map(|(number, _)| number), is_reflective };
        UnnumberedLook { stored, origin, look }
    }
}

impl ObjectLook<'_> {
    /// A triangle with the direction of its object.
    fn turned(&self, [a, b, c]: [u32; 3]) -> [u32; 3] {
        if self.is_turned { [a, c, b] } else { [a, b, c] }
    }
}

impl SurfaceLook {
    /// Texture coordinates; zero without a texture.
    fn uv(self, uv: [f32; 2]) -> [f32; 2] {
        if self.wrap.is_some() { uv } else { [0.0; 2] }
    }

    /// Adds a triangle without the holes of its texture. Textures repeat in the scene.
    fn add_triangle(
        self,
        corners: [[f64; 3]; 3],
        uv: [[f32; 2]; 3],
        mask: Option<&AlphaMask>,
        min_edge_m: f64,
        faces: &mut Vec<WorldTriangle>,
    ) {
        let wrap = self.wrap.unwrap_or_default();
        cut_at_images((corners, uv), wrap, &mut |piece| match mask {
            None => faces.push(self.triangle(piece)),
            Some(mask) => mask.cut(piece, min_edge_m, &mut |piece| faces.push(self.triangle(piece))),
        });
    }

    fn triangle(self, (corners, uv): Piece) -> WorldTriangle {
        WorldTriangle { corners, uv, material: self.material, is_facade: self.is_facade }
    }
}

/// World positions of a triangle's corners; `None` if one is invalid.
fn corners_of(triangle: [u32; 3], placed: &PlacedMesh) -> Option<[[f64; 3]; 3]> {
    let [a, b, c] = triangle.map(|i| placed.get(i as usize).copied().flatten());
    Some([a?, b?, c?])
}

/// Where a surface is, for the report.
fn place(object: &SourceObject, surface: &Surface) -> String {
    match surface.line {
        0 => object.id.clone(),
        line => format!("line {line}"),
    }
}

/// The placed outer ring of a surface; empty if it is invalid.
fn outer_ring<'p>(surface: &Surface, points: &'p [[f64; 3]]) -> &'p [[f64; 3]] {
    let end = surface.hole_starts.first().map_or(points.len(), |start| *start as usize);
    points.get(..end).unwrap_or(points)
}

/// The rounded mean colour of a triangle's vertices, if they have colours.
fn mean_colour(mesh: &TriangleMesh, triangle: [u32; 3]) -> Option<[u8; 3]> {
    if mesh.colours.len() != mesh.positions.len() || mesh.colours.is_empty() {
        return None;
    }
    let of = triangle.map(|i| mesh.colours.get(i as usize).copied().unwrap_or_default());
    Some(std::array::from_fn(|channel| {
        let mean = of.iter().map(|rgb| u32::from(rgb[channel])).sum::<u32>() / 3;
        let step = 1 << VERTEX_COLOUR_BITS;
        ((mean + step / 2) / step * step).min(255) as u8
    }))
}

/// The material with the colour of vertices, which multiplies its own.
fn tint(material: Option<ReadMaterial>, colour: Option<[u8; 3]>) -> Option<ReadMaterial> {
    let Some(colour) = colour else { return material };
    let material = material.unwrap_or(ReadMaterial::PLAIN);
    let own = material.rgb.unwrap_or([255; 3]);
    let rgb = std::array::from_fn(|channel| (u32::from(own[channel]) * u32::from(colour[channel]) / 255) as u8);
    Some(ReadMaterial { rgb: Some(rgb), untextured_rgb: None, ..material })
}
