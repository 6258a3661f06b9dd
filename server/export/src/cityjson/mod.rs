//! CityJSON 2.0 text sequences (<https://www.cityjson.org/cityjsonseq/>): a line of metadata, then a feature on each line: an object
//! with its parts.
//!
//! Geometries are the triangles of the finest meshes, and where plain nodes have none, level areas of their columns, merged where they
//! are in one plane. Vertices are in millimetres from the
//! city's corner. The attribution is in the title, because the schema allows no other member of `metadata`.

mod family;
mod surfaces;
#[cfg(test)]
mod tests;

use crate::table::city::{City, Plan};
use crate::table::{ExportError, ExportReport, OutputFile};
use family::{Family, Member, visit_families};
use insula_objects::{FeatureKind, ObjectRecord};
use roaring::RoaringBitmap;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use surfaces::Surfaces;

const ADDRESS: &str = "https://www.opengis.net/def/crs/EPSG/0";

/// Writes the selected objects with their parts and parents. Fails if tiles cannot be read or the file cannot be written.
pub(crate) fn write(city: &City<'_>, plan: &Plan, out: &Path) -> Result<ExportReport, ExportError> {
    let mut report = ExportReport::new(city.source);
    let (output, file) = OutputFile::create(out)?;
    let head = metadata(city, &mut report);
    let mut lines = Lines { city, out: BufWriter::new(file), path: out, written: RoaringBitmap::new() };
    lines.put(&head)?;
    let has_mesh = visit_families(city, plan, &mut |family| lines.write_family(family, &mut report))?;
    if !has_mesh && !plan.selected.is_empty() {
        let warning = "no mesh shows the selected objects, so they have no geometry, or level areas only: bake with meshes, or \
            export 3D Tiles";
        report.warnings.push(warning.to_owned());
    }
    lines.write_rest(plan, &mut report)?;
    let file = lines.out.into_inner().map_err(|error| ExportError::write(out)(error.into_error()))?;
    report.bytes = output.commit(file)?;
    report.files.push(out.to_owned());
    Ok(report)
}

fn metadata(city: &City<'_>, report: &mut ExportReport) -> Value {
    let manifest = city.manifest;
    let unit = city.grid.unit_m();
    let [x, y] = city.grid.origin();
    let title = match report.attribution.as_str() {
        "" => manifest.title.clone(),
        attribution => format!("{} (data: {attribution})", manifest.title),
    };
    let mut metadata = json!({ "title": title, "geographicalExtent": manifest.bounds.concat() });
    let code =
        manifest.crs.as_deref().and_then(|crs| crs.strip_prefix("EPSG:")).filter(|code| code.parse::<u32>().is_ok());
    match code {
        Some(code) => metadata["referenceSystem"] = json!(format!("{ADDRESS}/{code}")),
        None => {
            report.warnings.push("the city's coordinate system has no EPSG code: the file does not name it".to_owned())
        }
    }
    json!({
        "type": "CityJSON",
        "version": "2.0",
        "transform": { "scale": [unit, unit, 0.001], "translate": [x, y, origin_z(city)] },
        "metadata": metadata,
        "CityObjects": {},
        "vertices": [],
    })
}

/// Height of vertices of z 0, with three decimals.
fn origin_z(city: &City<'_>) -> f64 {
    (city.manifest.origin[2] * 1000.0).round() / 1000.0
}

/// Writes the lines of a file.
struct Lines<'a> {
    city: &'a City<'a>,
    out: BufWriter<File>,
    path: &'a Path,
    /// Numbers of the written objects.
    written: RoaringBitmap,
}

impl Lines<'_> {
    fn put(&mut self, line: &Value) -> Result<(), ExportError> {
        writeln!(self.out, "{line}").map_err(ExportError::write(self.path))
    }

    fn write_family(&mut self, family: Family, report: &mut ExportReport) -> Result<(), ExportError> {
        let Some(members) = family.members else {
            report.skip("its meshes have too many triangles for one feature");
            self.written.insert(family.root);
            return Ok(());
        };
        // Parents without geometry belong to the feature too.
        let mut objects: BTreeMap<u32, ObjectRecord> = BTreeMap::new();
        for &member in members.keys().chain([&family.root]) {
            for object in std::iter::once(member).chain(self.city.ancestors(member)?) {
                if let Some(record) = self.city.record(object)? {
                    objects.insert(object, record);
                }
            }
        }
        let keys = keys(&objects);
        let mut city_objects = Map::new();
        let mut vertices = Vec::new();
        for (&object, record) in &objects {
            let mut json = self.city_object(object, record, &objects, &keys);
            match members.get(&object) {
                Some(member) if !member.triangles.is_empty() => {
                    let surfaces = Surfaces::of(&member.triangles, self.city.grid.units(member.tolerance_m));
                    json["geometry"] = json!([geometry(record.kind, &surfaces, vertices.len())]);
                    vertices.extend(surfaces.vertices);
                }
                _ => report.without_geometry += 1,
            }
            city_objects.insert(key_of(&keys, object), json);
            self.written.insert(object);
            report.objects += 1;
        }
        self.put(&json!({
            "type": "CityJSONFeature",
            "id": key_of(&keys, family.root),
            "CityObjects": city_objects,
            "vertices": vertices,
        }))
    }

    /// Writes the selected objects that no mesh shows, each with those of its family.
    fn write_rest(&mut self, plan: &Plan, report: &mut ExportReport) -> Result<(), ExportError> {
        let mut rest = Vec::new();
        for object in &plan.selected - &self.written {
            rest.push((self.city.ancestors(object)?.last().copied().unwrap_or(object), object));
        }
        rest.sort_unstable();
        for family in rest.chunk_by(|(root, _), (other, _)| root == other) {
            let Some(&(root, _)) = family.first() else { continue };
            if self.written.contains(root) {
                family.iter().for_each(|_| report.skip("no mesh shows it, and its parent was written before"));
                continue;
            }
            let members = family.iter().map(|(_, object)| (*object, Member::default())).collect();
            self.write_family(Family { root, members: Some(members) }, report)?;
        }
        Ok(())
    }

    fn city_object(
        &self,
        object: u32,
        record: &ObjectRecord,
        objects: &BTreeMap<u32, ObjectRecord>,
        keys: &BTreeMap<u32, String>,
    ) -> Value {
        let parent =
            record.parent.filter(|parent| *parent != object).and_then(|parent| Some((parent, objects.get(&parent)?)));
        let mut json = json!({ "type": type_of(record.kind, parent.map(|(_, parent)| parent.kind)) });
        let schema = self.city.source.schema();
        let mut attributes = Map::new();
        for (index, value) in &record.attributes {
            if let Some(attribute) = schema.attributes.get(*index as usize) {
                attributes.insert(attribute.name.clone(), json!(value));
            }
        }
        if !attributes.is_empty() {
            json["attributes"] = Value::Object(attributes);
        }
        if let Some((parent, _)) = parent {
            json["parents"] = json!([key_of(keys, parent)]);
        }
        let children = objects.iter().filter(|(child, record)| record.parent == Some(object) && **child != object);
        let children: Vec<String> = children.map(|(child, _)| key_of(keys, *child)).collect();
        if !children.is_empty() {
            json["children"] = json!(children);
        }
        json
    }
}

/// Keys of a feature's objects: their identifiers, or `object-NUMBER` where there is none or another object has it.
fn keys(objects: &BTreeMap<u32, ObjectRecord>) -> BTreeMap<u32, String> {
    let mut taken = std::collections::BTreeSet::new();
    let key = |(object, record): (&u32, &ObjectRecord)| {
        let own = Some(record.identifier.clone()).filter(|id| !id.is_empty() && taken.insert(id.clone()));
        (*object, own.unwrap_or_else(|| format!("object-{object}")))
    };
    objects.iter().map(key).collect()
}

fn key_of(keys: &BTreeMap<u32, String>, object: u32) -> String {
    keys.get(&object).cloned().unwrap_or_else(|| format!("object-{object}"))
}

/// The type of an object of CityJSON. Only objects with a parent may be parts.
fn type_of(kind: FeatureKind, parent: Option<FeatureKind>) -> &'static str {
    match (kind, parent) {
        (FeatureKind::BuildingPart, None) => "Building",
        (FeatureKind::Building, Some(FeatureKind::Building | FeatureKind::BuildingPart)) => "BuildingPart",
        (FeatureKind::Bridge, Some(FeatureKind::Bridge)) => "BridgePart",
        (FeatureKind::Tunnel, Some(FeatureKind::Tunnel)) => "TunnelPart",
        _ => kind.cityjson_type(),
    }
}

/// Surfaces whose vertices follow `first` others.
fn geometry(kind: FeatureKind, surfaces: &Surfaces, first: usize) -> Value {
    let boundaries: Vec<Vec<Vec<usize>>> = surfaces
        .polygons
        .iter()
        .map(|rings| rings.iter().map(|ring| ring.iter().map(|vertex| first + vertex).collect()).collect())
        .collect();
    // The specification asks for it.
    let geometry_type = if kind == FeatureKind::Relief { "CompositeSurface" } else { "MultiSurface" };
    json!({ "type": geometry_type, "lod": "2", "boundaries": boundaries })
}
