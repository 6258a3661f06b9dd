//! A share of a file: the features between two places, which the index gives. Without an index, and where only an area is wanted, the
//! first share is the whole file.

use super::super::feature::{FeatureWriter, MAX_DECISIVE};
use super::{
    MAGIC_BYTES, TICK_FEATURES, begin, feature_of, geometry_of, header_of, index, read_feature, read_frame, read_header,
};
use insula_source::error::InputError;
use insula_source::input::{Input, Share};
use insula_source::object::ObjectSink;
use std::io::Read;

/// Reads a share of a source. Fails as reading the whole source does, and if the index does not have the features in their order.
pub(crate) fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let file = input.random()?;
    let header_frame = read_header(input, &mut file.reader(0))?;
    let header = header_of(input, &header_frame)?;
    let Some(index_bytes) = index::bytes(input, &header)?.filter(|_| input.bbox_deg.is_none()) else {
        return match input.share.number {
            0 => super::read(&Input { share: Share::WHOLE, ..*input }, sink),
            _ => Ok(()),
        };
    };
    let mut writer = FeatureWriter::new(input, sink);
    let schema = begin(input, &header, &mut writer)?;
    let header_bytes = (MAGIC_BYTES + header_frame.len()) as u64;
    // What the first features decide, all shares must know.
    let decisive = schema.features.min(MAX_DECISIVE);
    let [start, end] = {
        let own = input.share.of(schema.features);
        let bound = |number: u64| if number == 0 { 0 } else { number.max(decisive) };
        [bound(own.start), bound(own.end)]
    };
    if start == end {
        return writer.finish();
    }
    let first_feature = header_bytes.saturating_add(index_bytes);
    let mut frame = Vec::new();
    if start > 0 {
        let mut reader = file.reader(first_feature);
        for number in 0..decisive {
            let Some(_) = read_frame(input, &mut reader, &mut frame, number)? else { break };
            let feature = feature_of(&frame).ok_or("malformed feature");
            if !writer.note(feature.and_then(|feature| geometry_of(&feature, &frame, &schema)))? {
                break;
            }
        }
    }
    let offset_of = |number: u64| {
        if number == schema.features {
            return Ok(None);
        }
        let mut offset = [0; 8];
        let place = header_bytes.saturating_add(index::place_of_offset(index_bytes, schema.features, number));
        file.reader(place).read_exact(&mut offset).map_err(|cause| InputError::io(input.label, cause))?;
        Ok(Some(u64::from_le_bytes(offset)))
    };
    let damaged = |number: u64, what: &str| InputError::damaged(input.label, format!("feature {}", number + 1), what);
    let first = offset_of(start)?.unwrap_or(0);
    let mut position = first;
    let mut reader = file.reader(first_feature.saturating_add(position));
    for number in start..end {
        let bytes = read_frame(input, &mut reader, &mut frame, number)?;
        position += bytes.ok_or_else(|| damaged(number, "it is announced, and not there"))?;
        read_feature(&frame, &schema, number, &mut writer)?;
        if (number - start) % TICK_FEATURES == 0 {
            writer.sink.tick(position - first);
        }
    }
    if offset_of(end)?.is_some_and(|next| next != position) {
        let what = "the index does not have the features in their order; bake without --work";
        return Err(damaged(end, what));
    }
    writer.finish()
}
