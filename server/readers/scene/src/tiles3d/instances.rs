//! Instances of i3dm: where and how often a glTF stands.

use super::batch_column::component_by_name;
use super::container::Tables;
use super::globe;
use crate::bytes::{Number, NumberType, f32_at, part, u16_at};
use glam::{DMat3, DMat4, DVec3};
use serde_json::Value;

#[derive(Debug)]
pub(super) struct Instances<'a> {
    pub(super) count: u32,
    places: Places<'a>,
    /// Added to all places.
    center: DVec3,
    turn: Turn<'a>,
    scale: Option<&'a [u8]>,
    scale_xyz: Option<&'a [u8]>,
    batch_ids: Option<(&'a [u8], NumberType)>,
}

#[derive(Debug)]
enum Places<'a> {
    Exact(&'a [u8]),
    Quantized { bytes: &'a [u8], offset: DVec3, scale: DVec3 },
}

/// Directions of the axes of the instances.
#[derive(Debug)]
enum Turn<'a> {
    /// As those of the tile.
    None,
    /// East, north and up at the place of each.
    EastNorthUp,
    /// Up and right vectors.
    Vectors { up: &'a [u8], right: &'a [u8] },
    /// The same as two 16-bit numbers each.
    Octahedral { up: &'a [u8], right: &'a [u8] },
}

impl<'a> Instances<'a> {
    /// Reads the feature table of an i3dm. Fails with what is missing or cut short.
    pub(super) fn new(tables: &Tables<'a>) -> Result<Self, String> {
        let count = tables.feature_json.get("INSTANCES_LENGTH").and_then(Value::as_u64);
        let count = count.and_then(|count| u32::try_from(count).ok()).ok_or("INSTANCES_LENGTH is missing")?;
        // The bytes of a property with `size` bytes for each instance.
        let property = |name: &str, size: u64| -> Result<Option<&'a [u8]>, String> {
            let Some(property) = tables.feature_json.get(name) else { return Ok(None) };
            let offset = property.get("byteOffset").and_then(Value::as_u64).unwrap_or(0);
            let bytes = part(tables.feature_binary, offset, u64::from(count) * size);
            bytes.map(Some).ok_or_else(|| format!("{name} is cut short"))
        };
        let places = match (property("POSITION", 12)?, property("POSITION_QUANTIZED", 6)?) {
            (Some(bytes), _) => Places::Exact(bytes),
            (None, Some(bytes)) => {
                let vector = |name: &str| {
                    tables.global_vector(name).map(DVec3::from_array).ok_or_else(|| format!("{name} is missing"))
                };
                let offset = vector("QUANTIZED_VOLUME_OFFSET")?;
                Places::Quantized { bytes, offset, scale: vector("QUANTIZED_VOLUME_SCALE")? }
            }
            (None, None) => return Err("POSITION is missing".to_owned()),
        };
        let exact = property("NORMAL_UP", 12)?.zip(property("NORMAL_RIGHT", 12)?);
        let octahedral = property("NORMAL_UP_OCT32P", 4)?.zip(property("NORMAL_RIGHT_OCT32P", 4)?);
        let is_east_north_up = tables.feature_json.get("EAST_NORTH_UP").and_then(Value::as_bool) == Some(true);
        let turn = match (exact, octahedral) {
            (Some((up, right)), _) => Turn::Vectors { up, right },
            (None, Some((up, right))) => Turn::Octahedral { up, right },
            (None, None) if is_east_north_up => Turn::EastNorthUp,
            (None, None) => Turn::None,
        };
        let ids = tables.feature_json.get("BATCH_ID");
        let component = ids.and_then(|ids| ids.get("componentType")).and_then(Value::as_str);
        let component = component.and_then(component_by_name).unwrap_or(NumberType::U16);
        let batch_ids = property("BATCH_ID", component.bytes() as u64)?.map(|bytes| (bytes, component));
        Ok(Self {
            count,
            places,
            center: tables.global_vector("RTC_CENTER").map_or(DVec3::ZERO, DVec3::from_array),
            turn,
            scale: property("SCALE", 4)?,
            scale_xyz: property("SCALE_NON_UNIFORM", 12)?,
            batch_ids,
        })
    }

    pub(super) fn feature(&self, instance: u32) -> u32 {
        let Some((bytes, component)) = self.batch_ids else { return instance };
        let id = component.read(bytes, instance as usize * component.bytes());
        id.and_then(Number::to_u32).unwrap_or(instance)
    }

    /// Number of features that the instances are.
    pub(super) fn feature_count(&self) -> u32 {
        match self.batch_ids {
            Some(_) => (0..self.count).map(|i| self.feature(i)).max().map_or(0, |last| last.saturating_add(1)),
            None => self.count,
        }
    }

    /// Turns a position of the model (z up) into one of the tile. `None` if the instance has no finite place.
    pub(super) fn transform(&self, instance: u32) -> Option<DMat4> {
        let i = instance as usize;
        let place = self.center
            + match self.places {
                Places::Exact(bytes) => vector_at(bytes, i)?,
                Places::Quantized { bytes, offset, scale } => {
                    let step = |axis: usize| u16_at(bytes, 6 * i + 2 * axis).map(|step| f64::from(step) / 65535.0);
                    offset + scale * DVec3::new(step(0)?, step(1)?, step(2)?)
                }
            };
        let axes = match self.turn {
            Turn::None => DMat3::IDENTITY,
            Turn::EastNorthUp => DMat3::from_mat4(globe::east_north_up(place)),
            Turn::Vectors { up, right } => axes(vector_at(up, i)?, vector_at(right, i)?),
            Turn::Octahedral { up, right } => axes(octahedral_at(up, i)?, octahedral_at(right, i)?),
        };
        let mut scale = DVec3::ONE;
        if let Some(bytes) = self.scale {
            scale *= f64::from(f32_at(bytes, 4 * i)?);
        }
        if let Some(bytes) = self.scale_xyz {
            scale *= vector_at(bytes, i)?;
        }
        let transform = DMat4::from_mat3_translation(axes * DMat3::from_diagonal(scale), place);
        transform.is_finite().then_some(transform)
    }
}

/// Axes of an instance: x is right and y is up, as the format defines.
fn axes(up: DVec3, right: DVec3) -> DMat3 {
    let (up, right) = (up.normalize_or_zero(), right.normalize_or_zero());
    DMat3::from_cols(right, up, right.cross(up))
}

fn vector_at(bytes: &[u8], index: usize) -> Option<DVec3> {
    let at = |axis: usize| f32_at(bytes, 12 * index + 4 * axis).map(f64::from);
    Some(DVec3::new(at(0)?, at(1)?, at(2)?))
}

/// A direction by its place on an unfolded octahedron (Cigolle and others 2014).
fn octahedral_at(bytes: &[u8], index: usize) -> Option<DVec3> {
    let at = |axis: usize| u16_at(bytes, 4 * index + 2 * axis).map(|step| f64::from(step) / 65535.0 * 2.0 - 1.0);
    let (x, y) = (at(0)?, at(1)?);
    let z = 1.0 - x.abs() - y.abs();
    let folded = if z < 0.0 {
        DVec3::new((1.0 - y.abs()) * x.signum(), (1.0 - x.abs()) * y.signum(), z)
    } else {
        DVec3::new(x, y, z)
    };
    Some(folded.normalize_or_zero())
}
