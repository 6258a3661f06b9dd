//! Places of meshes, whose formats have none. Those without one whose coordinates are degrees, although their formats have metres only, or
//! metres from the centre of the Earth, as the contents of 3D Tiles have them.

use super::SceneSink;
use crate::read::context::{ObjUpAxis, ReadContext};
use crate::read::scene_builder::OpenObject;
use insula_place::local_frame::{self, LocalFrame};
use insula_place::placement::{MeshExtent, Placement};
use insula_source::error::InputError;
use insula_source::object::{CrsReference, ObjectSink, Shape};
use insula_source::problems::NO_CRS;
use insula_source::source::CitySource;

/// What is known of the coordinates of a mesh without a place.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct UnplacedMesh {
    /// Of all objects so far.
    extent: Option<MeshExtent>,
}

impl ReadContext<'_> {
    /// The place of a mesh file, which has no coordinate system: where the user says, else that of the other sources.
    /// Fails if the file that places it is invalid.
    pub(super) fn place_of_mesh(&mut self, source: &CitySource<'_>) -> Result<(Placement, LocalFrame), InputError> {
        let found = match self.addition_place.clone() {
            None => local_frame::find(source, self.options.placing.at.filter(|_| !self.is_addition))?,
            place => place,
        };
        match found {
            Some((reference, frame)) => {
                let mut placement = self.world.place(&source.label, &reference)?;
                self.settle(&mut placement, &source.label, frame.apply([0.0; 3]))?;
                Ok((placement, frame))
            }
            None => Ok((Placement::Unknown, LocalFrame::IDENTITY)),
        }
    }

    /// Whether y points up in files that do not tell it.
    pub(super) fn is_y_up(&self) -> bool {
        self.options.obj_up == ObjUpAxis::Y && !self.is_addition
    }
}

impl SceneSink<'_, '_, '_> {
    /// Takes a mesh as one in degrees, or around the centre of the Earth, if its first object is certainly so. A monument stays as it is.
    pub(super) fn seek_mesh_place(&mut self, shape: &Shape) -> Result<(), InputError> {
        let is_first = self.unplaced_mesh.is_some_and(|mesh| mesh.extent.is_none());
        let Shape::Surfaces { polygons, meshes } = shape else { return Ok(()) };
        if !is_first || self.context.options.is_monument {
            return Ok(());
        }
        let of_polygons = polygons.iter().flat_map(|surface| &surface.points);
        let positions = of_polygons.chain(meshes.iter().flat_map(|mesh| &mesh.positions));
        let Some(extent) = MeshExtent::of(positions.map(|position| self.frame.apply(*position))) else { return Ok(()) };
        let (reference, first, text) = if extent.is_certainly_geocentric() {
            let text = format!("{} are taken as metres from the centre of the Earth (EPSG:4978)", extent.text());
            (CrsReference::east_first("EPSG:4978"), extent.middle().into(), text)
        } else if extent.is_certainly_in_degrees() {
            let first = extent.first_shape();
            let (Some(reference), text) = self.context.world.guess(&first) else { return Ok(()) };
            (reference, first, text)
        } else {
            return Ok(());
        };
        self.report.problem(NO_CRS, || text);
        let frame = self.frame;
        self.set_crs(&reference)?;
        self.frame = frame;
        self.context.settle(&mut self.placement, &self.source.label, first)
    }

    pub(super) fn note_mesh_extent(&mut self, open: &OpenObject) {
        if let (Some(mesh), Some(bounds)) = (&mut self.unplaced_mesh, open.bounds()) {
            let own = MeshExtent::of(bounds.into_iter());
            mesh.extent = mesh.extent.into_iter().chain(own).reduce(MeshExtent::join);
        }
    }

    /// Reports a mesh without a place that has one which is not read, or was taken to be in metres although it looks like one in degrees.
    pub(super) fn report_unplaced_mesh(&mut self) {
        if self.unplaced_mesh.is_some()
            && let Some(text) = local_frame::unread_place(self.source)
        {
            self.report.problem(NO_CRS, || text);
        }
        let extent = self.unplaced_mesh.and_then(|mesh| mesh.extent);
        if let Some(extent) = extent.filter(MeshExtent::looks_like_degrees) {
            let advice = "reproject the mesh to a system in metres";
            let text = format!("{} look like degrees and are taken as metres; {advice}", extent.text());
            self.report.problem(NO_CRS, || text);
        }
    }
}
