//! Point clouds made by hand.

use laz::{LasZipCompressor, LazVlrBuilder};
use std::io::{Cursor, Write};

/// A point; the numbers are centimetres.
#[derive(Debug, Clone, Copy)]
pub(super) struct TestPoint {
    pub(super) numbers: [i32; 3],
    pub(super) class: u8,
    /// Synthetic 1, key point 2, withheld 4, overlap 8.
    pub(super) flags: u8,
    /// The number of the reflection, and of all of its beam.
    pub(super) returns: [u8; 2],
}

impl TestPoint {
    /// A single reflection from the ground at a place in metres.
    pub(super) fn ground(x_m: f64, y_m: f64, z_m: f64) -> Self {
        let numbers = [x_m, y_m, z_m].map(|metres| (metres * 100.0).round() as i32);
        Self { numbers, class: 2, flags: 0, returns: [1, 1] }
    }

    pub(super) fn class(self, class: u8) -> Self {
        Self { class, ..self }
    }

    pub(super) fn flags(self, flags: u8) -> Self {
        Self { flags, ..self }
    }

    pub(super) fn returns(self, number: u8, count: u8) -> Self {
        Self { returns: [number, count], ..self }
    }
}

/// How the points of a test file are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TestPacking {
    None,
    /// In chunks with this many points.
    Fixed(u32),
    /// In chunks with 1, 2, 3, ... points, such as those of COPC.
    Growing,
    /// Without chunks, as early versions did.
    OneRun,
}

/// A point cloud with a scale of centimetres.
#[derive(Debug, Clone)]
pub(super) struct TestCloud {
    pub(super) format: u8,
    pub(super) points: Vec<TestPoint>,
    pub(super) packing: TestPacking,
    pub(super) extra_bytes: u16,
    pub(super) scale: [f64; 3],
    pub(super) offset: [f64; 3],
    /// Lowest and highest x and y; those of the points if they are `None`.
    pub(super) bounds: Option<[[f64; 2]; 2]>,
    pub(super) has_wkt_flag: bool,
    /// User, number and bytes of the records before the points.
    pub(super) records: Vec<(&'static str, u16, Vec<u8>)>,
    /// The same behind the points.
    pub(super) late_records: Vec<(&'static str, u16, Vec<u8>)>,
}

impl TestCloud {
    pub(super) fn new(points: Vec<TestPoint>) -> Self {
        Self {
            format: 1,
            points,
            packing: TestPacking::None,
            extra_bytes: 0,
            scale: [0.01; 3],
            offset: [0.0; 3],
            bounds: None,
            has_wkt_flag: false,
            records: Vec::new(),
            late_records: Vec::new(),
        }
    }

    pub(super) fn format(self, format: u8) -> Self {
        Self { format, ..self }
    }

    pub(super) fn packing(self, packing: TestPacking) -> Self {
        Self { packing, ..self }
    }

    pub(super) fn record(mut self, user: &'static str, id: u16, bytes: Vec<u8>) -> Self {
        self.records.push((user, id, bytes));
        self
    }

    /// A record with a coordinate system as keys.
    pub(super) fn keys(self, keys: &[[u16; 2]]) -> Self {
        let entries = keys.iter().flat_map(|[key, value]| [*key, 0, 1, *value]);
        let numbers = [1, 1, 0, keys.len() as u16].into_iter().chain(entries);
        self.record("LASF_Projection", 34735, numbers.flat_map(u16::to_le_bytes).collect())
    }

    pub(super) fn wkt(mut self, text: &str) -> Self {
        self.has_wkt_flag = true;
        self.record("LASF_Projection", 2112, format!("{text}\0").into_bytes())
    }

    /// The file.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let (packed, description) = self.packed_points();
        let mut records = self.records.clone();
        records.extend(description.map(|bytes| ("laszip encoded", 22204, bytes)));
        let before: Vec<u8> = records.iter().flat_map(|record| record_bytes(record, false)).collect();
        let after: Vec<u8> = self.late_records.iter().flat_map(|record| record_bytes(record, true)).collect();
        let header_bytes = if self.is_new() { 375 } else { 227 };
        let points_offset = header_bytes + before.len();
        let mut file = self.header(header_bytes, points_offset, records.len(), packed.len());
        file.extend(before);
        file.extend(packed);
        if self.packing == TestPacking::OneRun || self.packing == TestPacking::None {
            file.extend(after);
            return file;
        }
        // The place of the table of chunks counts from the start of the points here.
        let place: [u8; 8] = file[points_offset..points_offset + 8].try_into().unwrap();
        let place = i64::from_le_bytes(place) + points_offset as i64;
        file[points_offset..points_offset + 8].copy_from_slice(&place.to_le_bytes());
        file.extend(after);
        file
    }

    fn is_new(&self) -> bool {
        self.format >= 6 || !self.late_records.is_empty()
    }

    fn header(&self, header_bytes: usize, points_offset: usize, records: usize, point_bytes: usize) -> Vec<u8> {
        let mut header = vec![0; header_bytes];
        let mut put = |offset: usize, bytes: &[u8]| header[offset..offset + bytes.len()].copy_from_slice(bytes);
        put(0, b"LASF");
        put(6, &u16::to_le_bytes(if self.has_wkt_flag { 16 } else { 0 }));
        put(24, &[1, if self.is_new() { 4 } else { 2 }]);
        put(94, &(header_bytes as u16).to_le_bytes());
        put(96, &(points_offset as u32).to_le_bytes());
        put(100, &(records as u32).to_le_bytes());
        put(104, &[self.format | if self.packing == TestPacking::None { 0 } else { 0x80 }]);
        put(105, &(self.record_bytes() as u16).to_le_bytes());
        put(107, &(self.points.len() as u32).to_le_bytes());
        let [low, high] = self.bounds.unwrap_or_else(|| self.point_bounds());
        for axis in 0..3 {
            put(131 + axis * 8, &self.scale[axis].to_le_bytes());
            put(155 + axis * 8, &self.offset[axis].to_le_bytes());
            let ends = if axis < 2 { [high[axis], low[axis]] } else { [0.0; 2] };
            put(179 + axis * 16, &ends[0].to_le_bytes());
            put(187 + axis * 16, &ends[1].to_le_bytes());
        }
        if self.is_new() {
            put(235, &((points_offset + point_bytes) as u64).to_le_bytes());
            put(243, &(self.late_records.len() as u32).to_le_bytes());
            put(247, &(self.points.len() as u64).to_le_bytes());
        }
        header
    }

    fn point_bounds(&self) -> [[f64; 2]; 2] {
        let along = |axis: usize| {
            let coordinate = move |point: &TestPoint| f64::from(point.numbers[axis]) * self.scale[axis];
            self.points.iter().map(coordinate).map(move |along| along + self.offset[axis])
        };
        [[0, 1].map(|axis| along(axis).fold(1e9, f64::min)), [0, 1].map(|axis| along(axis).fold(-1e9, f64::max))]
    }

    fn record_bytes(&self) -> usize {
        [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67][usize::from(self.format)] + usize::from(self.extra_bytes)
    }

    fn record_of(&self, point: &TestPoint) -> Vec<u8> {
        let mut record: Vec<u8> = point.numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let [number, count] = point.returns;
        record.extend([7, 0]);
        if self.format >= 6 {
            record.extend([number | count << 4, point.flags, point.class]);
        } else {
            record.extend([number | count << 3, point.class | (point.flags & 7) << 5]);
        }
        // What is not read, but differs from point to point: among it a time that the decoder takes for one.
        let seconds = 1e5 + f64::from(point.numbers[0] % 1000) / 1e3;
        record.resize(if self.format >= 6 { 22 } else { 20 }, 3);
        record.extend(seconds.to_le_bytes());
        record.truncate(self.record_bytes());
        let rest = record.len()..self.record_bytes();
        record.extend(rest.map(|index| (index * 7) as u8 ^ point.numbers[0] as u8));
        record
    }

    /// The points, and how they are packed in LASzip's words.
    fn packed_points(&self) -> (Vec<u8>, Option<Vec<u8>>) {
        let records: Vec<Vec<u8>> = self.points.iter().map(|point| self.record_of(point)).collect();
        let builder = LazVlrBuilder::default().with_point_format(self.format, self.extra_bytes).unwrap();
        let builder = match self.packing {
            TestPacking::None => return (records.concat(), None),
            TestPacking::Fixed(points) => builder.with_fixed_chunk_size(points),
            TestPacking::Growing => builder.with_variable_chunk_size(),
            TestPacking::OneRun => builder.with_fixed_chunk_size(u32::MAX - 1),
        };
        let vlr = builder.build();
        let mut description = Vec::new();
        vlr.write_to(&mut description).unwrap();
        let mut compressor = LasZipCompressor::new(Cursor::new(Vec::new()), vlr).unwrap();
        let (mut chunk, mut in_chunk) = (1, 0);
        for record in &records {
            if self.packing == TestPacking::Growing && in_chunk == chunk {
                compressor.finish_current_chunk().unwrap();
                (chunk, in_chunk) = (chunk + 1, 0);
            }
            compressor.compress_one(record).unwrap();
            in_chunk += 1;
        }
        compressor.done().unwrap();
        let mut packed = compressor.into_inner().into_inner();
        if self.packing == TestPacking::OneRun {
            description[0] = 1;
            packed.drain(..8);
        }
        (packed, Some(description))
    }
}

fn record_bytes((user, id, bytes): &(&'static str, u16, Vec<u8>), is_late: bool) -> Vec<u8> {
    let mut record = vec![0; 18];
    record[2..2 + user.len()].copy_from_slice(user.as_bytes());
    record.extend(id.to_le_bytes());
    match is_late {
        true => record.write_all(&(bytes.len() as u64).to_le_bytes()).unwrap(),
        false => record.write_all(&(bytes.len() as u16).to_le_bytes()).unwrap(),
    }
    record.extend([0; 32]);
    record.extend(bytes);
    record
}
