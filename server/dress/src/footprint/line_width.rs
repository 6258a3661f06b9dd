//! Usual widths of lines by their class in OpenStreetMap, for all formats.

/// Widths of roads and paths in metres, without `width` and `lanes`. Of roads with several carriageways each is a way of its
/// own. Two lanes of 3 to 3.5 m for through roads, one with room to pass for others, as the wiki assumes in `Key:lanes` and
/// `Key:highway`; links have one lane with a margin.
pub const HIGHWAY_WIDTHS_M: &[(&str, f64)] = &[
    ("motorway", 9.0),
    ("trunk", 7.5),
    ("primary", 7.0),
    ("secondary", 6.5),
    ("tertiary", 6.0),
    ("unclassified", 5.0),
    ("residential", 5.5),
    ("living_street", 4.5),
    ("service", 3.5),
    ("road", 5.0),
    ("motorway_link", 5.0),
    ("trunk_link", 4.5),
    ("primary_link", 4.5),
    ("secondary_link", 4.0),
    ("tertiary_link", 4.0),
    ("busway", 3.5),
    ("bus_guideway", 3.0),
    ("raceway", 10.0),
    ("pedestrian", 5.0),
    ("track", 2.5),
    ("footway", 2.0),
    ("cycleway", 2.5),
    ("bridleway", 2.0),
    ("path", 1.2),
    ("steps", 2.0),
    ("via_ferrata", 0.6),
];

/// Widths of one track's bed in metres: the sleepers (2.6 m for standard gauge) and a margin.
pub const RAILWAY_WIDTHS_M: &[(&str, f64)] = &[
    ("rail", 3.2),
    ("light_rail", 3.0),
    ("subway", 3.2),
    ("tram", 2.6),
    ("narrow_gauge", 2.2),
    ("preserved", 3.2),
    ("funicular", 2.2),
    ("monorail", 1.5),
    ("miniature", 0.8),
];

/// Widths of runways and taxiways in metres: codes 3 and 4 of ICAO's Annex 14 have 30 to 45 m and 15 to 25 m.
pub const AEROWAY_WIDTHS_M: &[(&str, f64)] =
    &[("runway", 45.0), ("taxiway", 20.0), ("taxilane", 15.0), ("stopway", 45.0)];

/// Widths of waterways in metres. A river whose banks are known has an area as well.
pub const WATERWAY_WIDTHS_M: &[(&str, f64)] = &[
    ("river", 15.0),
    ("canal", 10.0),
    ("tidal_channel", 5.0),
    ("stream", 2.0),
    ("brook", 2.0),
    ("drain", 1.5),
    ("ditch", 1.0),
];

/// Width of a lane in metres, for `lanes`.
pub const LANE_M: f64 = 3.0;

/// The usual width of a class such as `residential`, `rail` or `stream`, in metres; `None` for an unknown class.
pub fn usual_width_m(class: &str) -> Option<f64> {
    let all = [HIGHWAY_WIDTHS_M, RAILWAY_WIDTHS_M, AEROWAY_WIDTHS_M, WATERWAY_WIDTHS_M];
    all.into_iter().flatten().find(|(known, _)| *known == class).map(|(_, width_m)| *width_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_class_has_its_own_width() {
        assert_eq!(usual_width_m("residential"), Some(5.5));
        assert_eq!(usual_width_m("tram"), Some(2.6));
        assert_eq!(usual_width_m("stream"), Some(2.0));
        assert_eq!(usual_width_m("corridor"), None);
    }
}
