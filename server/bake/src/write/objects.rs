//! Writes `objects.pmtiles`: the schema of the objects' attributes, and the objects in blocks.
//!
//! The records of the numbered objects are read twice: for the types and ranges of the attributes,
//! and for the blocks.

use super::archive::{self, WrittenArchive};
use super::focus::Standing;
use super::sea::{SeaAndLand, is_sea};
use crate::error::BakeError;
use crate::scene::grid::CityGrid;
use crate::scene::object_numbers::NumberedObject;
use crate::scene::object_records::{ObjectRecords, RecordReader};
use insula_archive::Archive;
use insula_objects::FeatureKind;
use insula_objects::block::{self, BLOCK_OBJECTS, ObjectBounds, ObjectRecord};
use insula_objects::schema::{Schema, SchemaBuilder};
use insula_protocol::object_tile::{self, MAX_CONTENT_BYTES, SCHEMA_ID, block_id, block_number};
use insula_protocol::{DecodeError, TileId};
use insula_scratch::record_list::RecordList;
use std::collections::HashMap;
use std::path::Path;

/// The objects of a city.
pub(crate) struct NumberedRecords<'a> {
    pub(crate) records: &'a ObjectRecords,
    /// By number; `None` for numbers that are not in use.
    pub(crate) rows: &'a RecordList<Option<NumberedObject>>,
    /// From the scene's origin to that of the city's tiles, in metres.
    pub(crate) origin_m: [f64; 3],
    /// Names of the attributes whose texts can be searched, besides identifiers.
    pub(crate) searchable: Vec<String>,
}

impl NumberedRecords<'_> {
    /// The attributes of all objects. Fails if a record cannot be read.
    pub(crate) fn schema(&self) -> Result<Schema, BakeError> {
        let mut reader = self.records.reader()?;
        let mut builder = SchemaBuilder::default();
        self.rows.try_for_each(|_, row| {
            let Some(row) = row else { return Ok::<_, BakeError>(()) };
            for (name, value) in &reader.read(row.record)?.attributes {
                builder.add(name, value);
            }
            Ok(())
        })?;
        if builder.dropped() > 0 {
            tracing::warn!("{} values of attributes beyond the limit are left out", builder.dropped());
        }
        let mut schema = builder.finish(self.rows.len() as u32);
        let is_known = |name: &&String| schema.index_of(name).is_some();
        schema.searchable = self.searchable.iter().filter(is_known).cloned().collect();
        Ok(schema)
    }

    /// The kind of each object by number; `None` for numbers that are not in use. Fails if a record cannot be read.
    pub(crate) fn kinds(&self) -> Result<Vec<Option<FeatureKind>>, BakeError> {
        let mut reader = self.records.reader()?;
        let mut kinds = Vec::with_capacity(self.rows.len());
        self.rows.try_for_each(|_, row| {
            kinds.push(row.as_ref().map(|row| reader.read(row.record).map(|record| record.kind)).transpose()?);
            Ok::<_, BakeError>(())
        })?;
        Ok(kinds)
    }

    /// Number of buildings, each once with all its parts, of objects of these [kinds](Self::kinds). Fails if a row cannot be read.
    pub(crate) fn buildings(&self, kinds: &[Option<FeatureKind>]) -> Result<u64, BakeError> {
        let kind_of = |number: u32| kinds.get(number as usize).copied().flatten();
        let mut buildings = 0;
        self.rows.try_for_each(|number, row| {
            let kind = kind_of(number as u32).filter(|kind| kind.is_of_building());
            let parent = row.as_ref().and_then(|row| kind_of(row.parent?));
            let is_whole = kind.is_some_and(|kind| !parent.is_some_and(|parent| kind.is_part_of(parent)));
            buildings += u64::from(is_whole);
            Ok::<_, BakeError>(())
        })?;
        Ok(buildings)
    }

    /// The numbers of the objects of these [kinds](Self::kinds) that are sea, and of those that are terrain. Fails if a record cannot be
    /// read.
    pub(crate) fn sea_and_land(&self, kinds: &[Option<FeatureKind>]) -> Result<SeaAndLand, BakeError> {
        let mut reader = self.records.reader()?;
        let mut found = SeaAndLand::default();
        self.rows.try_for_each(|number, row| {
            match (row, kinds.get(number).copied().flatten()) {
                (Some(row), Some(FeatureKind::Water)) if is_sea(&reader.read(row.record)?) => {
                    found.sea.push(number as u32);
                }
                (Some(_), Some(FeatureKind::Relief)) => found.land.push(number as u32),
                _ => {}
            }
            Ok::<_, BakeError>(())
        })?;
        Ok(found)
    }

    /// Where objects of these [kinds](Self::kinds) stand. Fails if a row cannot be read.
    pub(crate) fn standing(&self, kinds: &[Option<FeatureKind>], grid: &CityGrid) -> Result<Standing, BakeError> {
        let mut standing = Standing::new(grid);
        self.rows.try_for_each(|number, row| {
            let stands = kinds.get(number).copied().flatten().is_some_and(Standing::stands);
            if let Some(bounds_m) = row.as_ref().and_then(|row| row.bounds_m).filter(|_| stands) {
                standing.add(bounds_m);
            }
            Ok::<_, BakeError>(())
        })?;
        Ok(standing.finish())
    }

    /// Writes the archive; for `base` see [`archive::write`]. Fails if a record cannot be read or the file cannot be written.
    pub(crate) fn write(
        &self,
        schema: &Schema,
        base: Option<&Archive>,
        path: &Path,
    ) -> Result<WrittenArchive, BakeError> {
        let mut used: Vec<u32> = Vec::new();
        self.rows.try_for_each(|number, row| {
            let block = (number / BLOCK_OBJECTS) as u32;
            used.extend((row.is_some() && used.last() != Some(&block)).then_some(block));
            Ok::<_, BakeError>(())
        })?;
        let mut ids: Vec<TileId> = used.into_iter().filter_map(block_id).collect();
        ids.push(SCHEMA_ID);
        let mut reader = self.records.reader()?;
        let names: HashMap<&str, u32> =
            (0..).zip(&schema.attributes).map(|(i, attribute)| (attribute.name.as_str(), i)).collect();
        archive::write(path, base, &ids, |id| {
            let content = match block_number(id) {
                None => encode_schema(schema),
                Some(block) => {
                    let first = block as usize * BLOCK_OBJECTS;
                    let mut records = Vec::with_capacity(BLOCK_OBJECTS);
                    self.rows.for_range(first..self.rows.len().min(first + BLOCK_OBJECTS), |_, row| {
                        records.push(self.record(row.as_ref(), &mut reader, schema, &names)?);
                        Ok::<_, BakeError>(())
                    })?;
                    encode_block(block, records, schema)
                }
            };
            content.and_then(|content| object_tile::encode(id, &content)).map_err(BakeError::tile(id, "encoded"))
        })
    }

    fn record(
        &self,
        row: Option<&NumberedObject>,
        reader: &mut RecordReader<'_>,
        schema: &Schema,
        names: &HashMap<&str, u32>,
    ) -> Result<Option<ObjectRecord>, BakeError> {
        let Some(row) = row else { return Ok(None) };
        let record = reader.read(row.record)?;
        let value = |(name, value): &(String, _)| {
            let attribute = *names.get(name.as_str())?;
            Some((attribute, schema.convert(attribute as usize, value)))
        };
        let mut attributes: Vec<_> = record.attributes.iter().filter_map(value).collect();
        attributes.sort_by_key(|(attribute, _)| *attribute);
        let decimetres = |z_m: f32, axis: usize| ((f64::from(z_m) - self.origin_m[axis]) * 10.0).round() as i32;
        let bounds = row.bounds_m.map(|bounds| {
            let [min, max] = bounds.map(|corner| std::array::from_fn(|axis| decimetres(corner[axis], axis)));
            ObjectBounds { min, max }
        });
        let (identifier, kind, parent) = (record.identifier, record.kind, row.parent);
        Ok(Some(ObjectRecord { identifier, kind, parent, bounds, attributes }))
    }
}

/// A block. One with more text than a tile holds loses its attributes.
fn encode_block(block: u32, mut records: Vec<Option<ObjectRecord>>, schema: &Schema) -> Result<Vec<u8>, DecodeError> {
    match block::encode(block, &records, schema) {
        Ok(content) if content.len() <= MAX_CONTENT_BYTES => Ok(content),
        Ok(_) | Err(DecodeError::Limit { .. }) => {
            tracing::warn!("objects {}: too much text, their attributes are left out", block as usize * BLOCK_OBJECTS);
            records.iter_mut().flatten().for_each(|record| record.attributes.clear());
            block::encode(block, &records, schema)
        }
        Err(error) => Err(error),
    }
}

/// The schema as JSON, without its most frequent values if it would be too long with them.
fn encode_schema(schema: &Schema) -> Result<Vec<u8>, DecodeError> {
    let json =
        |schema: &Schema| serde_json::to_vec(schema).map_err(|_| DecodeError::Invalid("a schema that is not JSON"));
    let content = json(schema)?;
    if content.len() <= MAX_CONTENT_BYTES {
        return Ok(content);
    }
    let mut short = schema.clone();
    short.attributes.iter_mut().for_each(|attribute| attribute.top.clear());
    json(&short)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::object_records::SourceRecord;
    use crate::scene::triangle_store::TriangleStore;
    use insula_objects::FeatureKind;

    #[test]
    fn a_building_counts_once_with_all_its_parts() {
        use FeatureKind::{Bridge, Building, BuildingPart, Generic, Vegetation};
        let objects = [
            (Building, None),
            (BuildingPart, Some(0)),
            // A part of a part, as rooms of a storey are.
            (BuildingPart, Some(1)),
            (Generic, None),
            // Of a group of houses.
            (Building, Some(3)),
            // Its parent is not in the city.
            (BuildingPart, Some(8)),
            (Vegetation, None),
            (Bridge, None),
        ];
        let mut records = ObjectRecords::for_triangles(&TriangleStore::Memory(Vec::new()));
        let mut row = |(kind, parent): (FeatureKind, Option<u32>)| {
            let record = SourceRecord { identifier: String::new(), kind, attributes: Vec::new() };
            Some(NumberedObject { record: records.push(record), parent, bounds_m: None })
        };
        let mut rows: Vec<_> = objects.into_iter().map(&mut row).collect();
        rows.push(None);
        let rows = rows.into();
        let numbered = NumberedRecords { records: &records, rows: &rows, origin_m: [0.0; 3], searchable: Vec::new() };
        assert_eq!(numbered.buildings(&numbered.kinds().unwrap()).unwrap(), 3);
    }
}
