//! Exports of objects as tables with footprints.
//!
//! | module | contents |
//! |---|---|
//! | `report` | what was done and why it failed |
//! | `city` | blocks of objects through a cache; what is selected |
//! | `grid` | whole coordinates on the map |
//! | `gather`, `columns` | the footprint of each object from meshes, or from columns where there are none |
//! | `outline` | union of triangles, without slivers |
//! | `record` | the columns of the tables |
//! | `csv`, `geojson`, `geoparquet`, `flatgeobuf` | the formats; `wkb` and `projjson` for geometries and coordinate systems |

pub(crate) mod city;
pub(crate) mod columns;
mod csv;
mod flatgeobuf;
pub(crate) mod gather;
pub(crate) mod geojson;
mod geoparquet;
pub(crate) mod grid;
mod outline;
mod projjson;
pub(crate) mod record;
mod report;
#[cfg(test)]
pub(crate) mod test_city;
#[cfg(test)]
mod tests;
mod wkb;

use crate::format::{Format, Projections};
use crate::source::{ExportSource, SourceError};
use city::{City, Plan};
pub use csv::cell as csv_cell;
use gather::{Footprint, visit_footprints};
use grid::{LeafOrder, node_area};
use insula_archive::new_file::NewFile;
use insula_objects::Value;
use insula_objects::family::{PartValues, inherit};
use insula_protocol::mesh_tile::MAX_LODS;
use insula_protocol::subtree::NodeMesh;
use insula_protocol::{Manifest, Subtree, TileId};
use record::{Field, Record};
pub use report::{ExportError, ExportReport, attribution};
use roaring::RoaringBitmap;
use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Writes rows in one format.
pub(crate) trait RecordWriter {
    /// Writes a row, or returns why the format cannot have it. Fails if the file cannot be written.
    fn write(&mut self, record: &Record) -> Result<Option<&'static str>, ExportError>;
    /// Ends the file. Fails if it cannot be written.
    fn finish(self: Box<Self>) -> Result<File, ExportError>;
}

/// What the writers of all tables need.
struct TableSetup<'a> {
    /// Of the city, for people.
    title: &'a str,
    fields: &'a [Field],
    projections: &'a Projections<'a>,
    attribution: &'a str,
    path: &'a Path,
    /// Cells that spreadsheets run as formulas are written as they are.
    keeps_formulas: bool,
}

/// Path and text of the file beside a CSV table that has the attribution; `None` if there is none.
pub(crate) fn sidecar(manifest: &Manifest, out: &Path) -> Option<(PathBuf, String)> {
    csv::sidecar(out, &report::attribution(manifest))
}

/// How tables are written.
#[derive(Debug, Clone, Copy, Default)]
pub struct TableOptions {
    /// Texts that spreadsheets run as formulas stay as they are in CSV files, instead of getting an apostrophe before them.
    pub keeps_formulas: bool,
    /// Each part of a building has a row of its own, instead of one row for the building.
    pub keeps_parts: bool,
}

/// Numbers of objects that are none of the city's, as columns of a table.
#[derive(Debug, Clone, Default)]
pub struct AddedValues {
    pub names: Vec<String>,
    /// By the number of the object, in the order of the names.
    pub values: HashMap<u32, Vec<Option<f64>>>,
}

/// Writes a row for each selected object of `plan`. Fails if tiles cannot be read or the file cannot be written.
pub(crate) fn write(
    city: &City<'_>,
    format: Format,
    plan: &Plan,
    projections: &Projections<'_>,
    (options, added): (TableOptions, &AddedValues),
    out: &Path,
) -> Result<ExportReport, ExportError> {
    let fields = record::fields(city.source.schema(), &added.names);
    write_rows((format, options.keeps_formulas), city.manifest, &fields, projections, out, &mut |writer, report| {
        write_records(city, plan, added, writer, report)
    })
}

/// Passes rows to a writer, and counts them.
type WriteRows<'a> = &'a mut dyn FnMut(&mut dyn RecordWriter, &mut ExportReport) -> Result<(), ExportError>;

/// Writes a table of these columns in a format, with formulas or not, of what a manifest names. Fails with the error of `rows`, or if the
/// file cannot be written.
pub(crate) fn write_rows(
    (format, keeps_formulas): (Format, bool),
    manifest: &Manifest,
    fields: &[Field],
    projections: &Projections<'_>,
    out: &Path,
    rows: WriteRows<'_>,
) -> Result<ExportReport, ExportError> {
    let attribution = report::attribution(manifest);
    let mut report = ExportReport { attribution: attribution.clone(), ..ExportReport::default() };
    let (output, file) = OutputFile::create(out)?;
    let title = &manifest.title;
    let setup = TableSetup { title, fields, projections, attribution: &attribution, path: out, keeps_formulas };
    let mut writer: Box<dyn RecordWriter> = match format {
        Format::GeoJson => Box::new(geojson::Writer::new(&setup, file)?),
        Format::GeoParquet => Box::new(geoparquet::Writer::new(&setup, file)?),
        Format::FlatGeobuf => Box::new(flatgeobuf::Writer::new(&setup, file)?),
        _ => Box::new(csv::Writer::new(&setup, file)?),
    };
    rows(writer.as_mut(), &mut report)?;
    report.bytes = output.commit(writer.finish()?)?;
    report.files.push(out.to_owned());
    match format {
        Format::Csv => csv::write_sidecar(&setup, &mut report)?,
        Format::GeoJson if projections.to_lon_lat.is_none() => report.warnings.push(
            "the city's coordinate system is not known: coordinates are its own, not longitude and latitude as GeoJSON asks for"
                .to_owned(),
        ),
        Format::GeoParquet if projections.definition.is_none() || projections.epsg.is_none() => {
            report.warnings.push("the city's coordinate system is not known: readers will ask for it".to_owned());
        }
        Format::FlatGeobuf if projections.epsg.is_none() => {
            report.warnings.push("the city's coordinate system is not known: readers will ask for it".to_owned());
        }
        _ => {}
    }
    Ok(report)
}

fn write_records(
    city: &City<'_>,
    plan: &Plan,
    added: &AddedValues,
    writer: &mut dyn RecordWriter,
    report: &mut ExportReport,
) -> Result<(), ExportError> {
    let mut written = RoaringBitmap::new();
    let mut write = |object: u32, footprint: Option<Footprint>| -> Result<(), ExportError> {
        let Some(stored) = city.record(object)? else { return Ok(()) };
        let parent = stored.parent.map(|parent| city.record(parent)).transpose()?.flatten();
        let (identifier, kind, mut attributes) = (stored.identifier, stored.kind, stored.attributes);
        if let Some(parent) = parent.as_ref().filter(|parent| kind.is_part_of(parent.kind)) {
            inherit(&mut attributes, &parent.attributes);
        }
        let mut of_parts = PartValues::default();
        for part in plan.parts_of(object) {
            of_parts.add(city.record(*part)?.into_iter().flat_map(|part| part.attributes));
        }
        of_parts.complete(&mut attributes);
        let parent = parent.map(|parent| parent.identifier);
        let added = added.values.get(&object).into_iter().flatten();
        let added = added.map(|value| value.map(Value::Float)).collect();
        let record = Record { object, identifier, parent, kind, footprint, attributes, added };
        match writer.write(&record)? {
            Some(reason) => report.skip(reason),
            None => {
                report.objects += 1;
                report.without_geometry += u64::from(record.footprint.is_none());
            }
        }
        Ok(())
    };
    visit_footprints(city, plan, &mut |object, footprint| {
        written.insert(object);
        write(object, Some(footprint))
    })?;
    for object in &plan.selected - &written {
        write(object, None)?;
    }
    Ok(())
}

/// What is known of the objects of which leaves are still to come.
pub(crate) struct OpenObjects<T> {
    open: HashMap<u32, T>,
    /// Position of the last leaf of each open object, and the object.
    closing: BTreeSet<(u64, u32)>,
}

impl<T> Default for OpenObjects<T> {
    fn default() -> Self {
        Self { open: HashMap::new(), closing: BTreeSet::new() }
    }
}

impl<T> OpenObjects<T> {
    /// What is known of an object, `new` if nothing is. Fails if its bounds cannot be read.
    pub(crate) fn get(
        &mut self,
        city: &City<'_>,
        plan: &Plan,
        object: u32,
        new: impl FnOnce() -> T,
    ) -> Result<&mut T, ExportError> {
        if !self.open.contains_key(&object) {
            self.closing.insert((plan.last_leaf(city, object)?, object));
        }
        Ok(self.open.entry(object).or_insert_with(new))
    }

    /// Removes an object whose last leaf is at `position` or before it.
    pub(crate) fn pop(&mut self, position: u64) -> Option<(u32, T)> {
        let (_, object) = self.closing.first().copied().filter(|(last, _)| *last <= position)?;
        self.closing.pop_first();
        self.open.remove_entry(&object)
    }
}

/// A file under a temporary name beside its final one. It is removed unless it is committed.
#[derive(Debug)]
pub(crate) struct OutputFile {
    path: PathBuf,
    new: NewFile,
}

impl OutputFile {
    /// Creates the file and returns it for writing. Fails if it cannot be created.
    pub(crate) fn create(path: &Path) -> Result<(Self, File), ExportError> {
        let new = NewFile::create(path).map_err(ExportError::write(path))?;
        let file = new.file().map_err(ExportError::write(path))?;
        Ok((Self { path: path.to_owned(), new }, file))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the file its name, in place of an older one. Returns its size in bytes. Fails if it cannot be written.
    pub(crate) fn commit(self, file: File) -> Result<u64, ExportError> {
        drop(file);
        self.new.commit().map_err(ExportError::write(&self.path))
    }
}

/// The path with `suffix` after its whole name.
pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// A node without children: a leaf, or land around the city that is not divided further.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EndNode {
    pub(crate) id: TileId,
    pub(crate) has_mesh: bool,
    /// Errors of the levels of detail of its mesh in metres, finest first; infinite beyond the last one.
    pub(crate) lod_errors_m: [f32; MAX_LODS as usize],
}

type Visit<'a> = &'a mut dyn FnMut(EndNode) -> Result<(), ExportError>;

/// Visits all end nodes that touch `area`, in world metres. Fails if a subtree cannot be read, and with the error of `visit`.
pub(crate) fn visit_end_nodes(
    source: &dyn ExportSource,
    area: [[f64; 2]; 2],
    visit: Visit<'_>,
) -> Result<(), ExportError> {
    let manifest = source.manifest();
    let walk = Walk { source, manifest, order: LeafOrder::of(manifest), area };
    walk.enter(TileId::ROOT, visit)
}

struct Walk<'a> {
    source: &'a dyn ExportSource,
    manifest: &'a Manifest,
    order: LeafOrder,
    area: [[f64; 2]; 2],
}

struct Nodes {
    root: TileId,
    child_masks: HashMap<TileId, u8>,
    lod_errors: HashMap<TileId, [f32; MAX_LODS as usize]>,
}

impl Walk<'_> {
    fn enter(&self, root: TileId, visit: Visit<'_>) -> Result<(), ExportError> {
        let subtree = self.source.subtree(root)?.ok_or_else(|| SourceError {
            what: format!("subtrees {root}"),
            reason: "the city does not have it: bake it again".to_owned(),
        })?;
        self.descend(root, &Nodes::of(root, &subtree), visit)
    }

    fn descend(&self, node: TileId, nodes: &Nodes, visit: Visit<'_>) -> Result<(), ExportError> {
        let [min, max] = node_area(self.manifest, node);
        if (0..2).any(|k| max[k] < self.area[0][k] || self.area[1][k] < min[k]) {
            return Ok(());
        }
        let Some(&child_mask) = nodes.child_masks.get(&node) else { return Ok(()) };
        if child_mask == 0 {
            let errors = nodes.lod_errors.get(&node);
            let lod_errors_m = errors.copied().unwrap_or([f32::INFINITY; MAX_LODS as usize]);
            return visit(EndNode { id: node, has_mesh: errors.is_some(), lod_errors_m });
        }
        if Subtree::is_root(node) && node != nodes.root {
            return self.enter(node, visit);
        }
        for child in self.order.children(node) {
            if child_mask >> child.quadrant() & 1 == 1 {
                self.descend(child, nodes, visit)?;
            }
        }
        Ok(())
    }
}

fn lod_errors(mesh: &NodeMesh) -> (TileId, [f32; MAX_LODS as usize]) {
    let mut errors = [f32::INFINITY; MAX_LODS as usize];
    errors.iter_mut().zip(&mesh.lods).for_each(|(error, lod)| *error = lod.error_m);
    (mesh.id, errors)
}

impl Nodes {
    fn of(root: TileId, subtree: &Subtree) -> Self {
        Self {
            root,
            child_masks: subtree.nodes.iter().map(|node| (node.id, node.child_mask)).collect(),
            lod_errors: subtree.meshes.iter().filter(|mesh| !mesh.lods.is_empty()).map(lod_errors).collect(),
        }
    }
}
