//! The formats of one file, and what they need to know of the city's coordinate system.

/// A format of one file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated values (RFC 4180) with the footprint as well-known text.
    Csv,
    /// GeoJSON (RFC 7946).
    GeoJson,
    /// GeoParquet 1.1.
    GeoParquet,
    /// FlatGeobuf 3.
    FlatGeobuf,
    /// CityJSON 2.0 text sequences.
    CityJsonSeq,
    /// Heights as GeoTIFF 1.1.
    GeoTiff,
}

impl Format {
    /// All formats with their names on the command line.
    pub const NAMES: [(&str, Self); 6] = [
        ("csv", Self::Csv),
        ("geojson", Self::GeoJson),
        ("geoparquet", Self::GeoParquet),
        ("flatgeobuf", Self::FlatGeobuf),
        ("cityjsonseq", Self::CityJsonSeq),
        ("geotiff", Self::GeoTiff),
    ];

    /// Whether it is a table with a row for each object.
    #[must_use]
    pub fn is_table(self) -> bool {
        !matches!(self, Self::CityJsonSeq | Self::GeoTiff)
    }
}

/// The city's coordinate system, as far as the caller knows it.
#[derive(Clone, Copy, Default)]
pub struct Projections<'a> {
    /// Longitude and latitude in degrees of WGS 84 of a place in world metres; `None` where the projection does not reach. Only
    /// GeoJSON needs it.
    pub to_lon_lat: Option<&'a dyn Fn([f64; 2]) -> Option<[f64; 2]>>,
    /// EPSG code of the projected system of the plane, such as 28992 where the manifest says `EPSG:7415`.
    pub epsg: Option<u32>,
    /// Its definition. Only GeoParquet needs it, because its readers do not look codes up.
    pub definition: Option<&'a PlaneDefinition>,
}

/// How a projected coordinate system is defined.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneDefinition {
    /// EPSG code of the geographic system that is projected, such as 4289. With it, readers find the shift of its datum.
    pub base_epsg: u32,
    /// Definition for PROJ, such as `+proj=utm +zone=32 +ellps=GRS80 +units=m`.
    pub proj: String,
    /// Semi-major axis in metres and inverse flattening of the ellipsoid; infinite for a sphere.
    pub ellipsoid: [f64; 2],
    /// Whether the registry has the northing before the easting. Files have the easting first all the same.
    pub is_north_first: bool,
}
