//! Accessors: typed elements in buffers, with sparse replacements.

use super::buffers::Buffers;
use super::fault::Fault;
use super::schema::{Accessor, Root, Sparse};
use crate::bytes::{Number, NumberType};
use std::borrow::Cow;

/// Kind of all faults of accessors.
const KIND: &str = "accessor of a glTF is invalid";

/// The type of a component by its code in WebGL.
fn component_of_code(code: u32) -> Option<NumberType> {
    NumberType::by_name("5120 5121 5122 5123 5124 5125 - - 5126 5130", &code.to_string())
}

/// The number at a byte; 0 if it is not all there.
#[inline]
fn value_at(component: NumberType, bytes: &[u8], at: usize) -> f64 {
    component.read(bytes, at).map_or(0.0, Number::to_f64)
}

/// Elements of an accessor. All of them are in bounds.
pub(super) struct Column<'a> {
    /// From the first element on.
    pub(super) bytes: Cow<'a, [u8]>,
    pub(super) count: usize,
    /// Between elements.
    pub(super) stride: usize,
    pub(super) component: NumberType,
    /// Components of an element.
    pub(super) width: usize,
    pub(super) is_normalised: bool,
}

impl Column<'_> {
    /// An element; components beyond its width, and elements beyond the end, are 0.
    pub(super) fn get<const N: usize>(&self, index: usize) -> [f64; N] {
        let size = self.component.bytes();
        let start = index.saturating_mul(self.stride);
        let mut values = [0.0; N];
        for (k, value) in values.iter_mut().enumerate().take(self.width) {
            *value = value_at(self.component, &self.bytes, start.saturating_add(k * size));
        }
        if self.is_normalised {
            let scale = self.component.largest();
            values.iter_mut().for_each(|value| *value = (*value / scale).max(-1.0));
        }
        values
    }

    /// An element of whole numbers: an index or an identifier.
    pub(super) fn whole(&self, index: usize) -> u32 {
        let start = index.saturating_mul(self.stride);
        value_at(self.component, &self.bytes, start).round() as u32
    }
}

/// Elements of an accessor. Fails if any of them is out of bounds.
pub(super) fn column<'a>(root: &'a Root, buffers: &'a Buffers<'_>, index: usize) -> Result<Column<'a>, Fault> {
    let accessor = root.accessors.get(index).ok_or_else(|| Fault::missing("accessor", index))?;
    let fault = |what: &str| Fault::new(KIND, format!("accessor {index}: {what}"));
    let (component, width) = layout(accessor).map_err(fault)?;
    let count = usize::try_from(accessor.count).map_err(|_| fault("its count is too large"))?;
    let size = component.bytes() * width;
    let dense = match accessor.buffer_view {
        Some(view) => {
            // Elements in one place would cost the file nothing.
            let stride = accessor.stride.filter(|stride| *stride > 0).or(buffers.stride(view));
            let stride = stride.map_or(Some(size), |stride| usize::try_from(stride).ok());
            let stride = stride.ok_or_else(|| fault("its stride is too large"))?;
            let bytes = elements(buffers.view(view)?, accessor.byte_offset, count, stride, size).map_err(fault)?;
            Column { bytes: Cow::Borrowed(bytes), count, stride, component, width, is_normalised: accessor.normalized }
        }
        None => {
            buffers.budget().take_zeros(accessor.count)?;
            buffers.budget().take_bytes(accessor.count.saturating_mul(size as u64))?;
            let zeros = Cow::Owned(vec![0; count * size]);
            Column { bytes: zeros, count, stride: size, component, width, is_normalised: accessor.normalized }
        }
    };
    match &accessor.sparse {
        Some(sparse) => replaced(dense, sparse, buffers, fault),
        None => Ok(dense),
    }
}

/// Type and number of the components of an element.
pub(super) fn layout(accessor: &Accessor) -> Result<(NumberType, usize), &'static str> {
    let component = component_of_code(accessor.component_type).ok_or("its component type is unknown")?;
    let width = match &*accessor.shape {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => return Err("its type is unknown"),
    };
    Ok((component, width))
}

/// The bytes from the first element on, which hold all elements.
fn elements(view: &[u8], offset: u64, count: usize, stride: usize, size: usize) -> Result<&[u8], &'static str> {
    let bytes = usize::try_from(offset).ok().and_then(|offset| view.get(offset..));
    let needed = match count.checked_sub(1) {
        Some(steps) => steps.checked_mul(stride).and_then(|start| start.checked_add(size)),
        None => Some(0),
    };
    match (bytes, needed) {
        (Some(bytes), Some(needed)) if needed <= bytes.len() => Ok(bytes),
        _ => Err("its elements are beyond the end of the buffer view"),
    }
}

/// A packed copy in which the sparse elements are replaced.
fn replaced<'a>(
    dense: Column<'_>,
    sparse: &Sparse,
    buffers: &Buffers<'_>,
    fault: impl Fn(&str) -> Fault,
) -> Result<Column<'a>, Fault> {
    let size = dense.component.bytes() * dense.width;
    let bytes = dense.count.checked_mul(size).ok_or_else(|| fault("it is too large"))?;
    buffers.budget().take_bytes(bytes as u64)?;
    let mut packed = vec![0; bytes];
    for (index, element) in packed.chunks_exact_mut(size).enumerate() {
        let start = index * dense.stride;
        if let Some(source) = dense.bytes.get(start..start + size) {
            element.copy_from_slice(source);
        }
    }
    let count = usize::try_from(sparse.count).map_err(|_| fault("its sparse count is too large"))?;
    let number =
        component_of_code(sparse.indices.component_type).ok_or_else(|| fault("unknown type of sparse indices"))?;
    let places = buffers.view(sparse.indices.buffer_view)?;
    let places = elements(places, sparse.indices.byte_offset, count, number.bytes(), number.bytes()).map_err(&fault)?;
    let values = buffers.view(sparse.values.buffer_view)?;
    let values = elements(values, sparse.values.byte_offset, count, size, size).map_err(&fault)?;
    for (place, value) in places.chunks_exact(number.bytes()).zip(values.chunks_exact(size)).take(count) {
        let start = (value_at(number, place, 0) as usize).saturating_mul(size);
        let element =
            packed.get_mut(start..start.saturating_add(size)).ok_or_else(|| fault("sparse index out of range"))?;
        element.copy_from_slice(value);
    }
    let Column { count, component, width, is_normalised, .. } = dense;
    Ok(Column { bytes: Cow::Owned(packed), count, stride: size, component, width, is_normalised })
}
