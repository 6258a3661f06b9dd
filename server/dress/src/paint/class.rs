//! What areas and lines are: classes with their layers and usual widths.

use super::material::listed;
use serde::{Deserialize, Serialize};

listed! {
    /// What an area is.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
    pub enum AreaClass {
        Residential,
        /// Offices, shops, schools, hospitals.
        Commercial,
        Industrial,
        RailwayLand,
        /// Building sites, landfills, waste land.
        Construction,
        Park,
        Cemetery,
        /// Fields. They have rows along their longer direction.
        Farmland,
        /// Meadows, orchards and other grass that is seldom mown.
        Meadow,
        /// Lawns.
        Grass,
        Scrub,
        /// Woods, seen from above: crowns.
        Forest,
        Wetland,
        /// Sand and beaches.
        Sand,
        /// Bare rock and scree.
        Rock,
        Water,
        Parking,
        /// Squares and pedestrian areas.
        Square,
        /// Areas of paths and pavements.
        Pavement,
        /// Platforms of stations and stops.
        Platform,
        Pier,
        /// Sports pitches and tracks.
        Pitch,
        Playground,
        /// Areas of roads: carriageways, aprons.
        Carriageway,
        /// Areas of tracks.
        TrackBed,
    }
}

/// Layers of areas, from the lowest. Within a layer, smaller areas are painted over larger ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum AreaLayer {
    /// Land use. It is painted first: a pond in a park or a wood in a cemetery covers it.
    Use,
    /// Land cover: plants, soil and water. Smaller areas cover larger ones: ponds cover woods, islands cover lakes.
    Cover,
    Paved,
    Carriageway,
}

impl AreaClass {
    /// The class of a flat object by its type in CityJSON or CityGML, such as `WaterBody`; `None` for types that are
    /// not painted.
    #[must_use]
    pub fn of_object_type(name: &str) -> Option<Self> {
        Some(match name {
            "PlantCover" => Self::Meadow,
            "LandUse" => Self::Residential,
            "WaterBody" | "Waterway" | "WaterSurface" => Self::Water,
            "Road" | "TrafficArea" => Self::Carriageway,
            "AuxiliaryTrafficArea" => Self::Pavement,
            "TransportSquare" | "Square" => Self::Square,
            "Railway" => Self::TrackBed,
            _ => return None,
        })
    }

    /// Where it lies among the areas.
    pub fn layer(self) -> AreaLayer {
        use AreaClass::{
            Carriageway, Cemetery, Commercial, Construction, Farmland, Forest, Grass, Industrial, Meadow, Park,
            Parking, Pavement, Pier, Pitch, Platform, Playground, RailwayLand, Residential, Rock, Sand, Scrub, Square,
            TrackBed, Water, Wetland,
        };
        match self {
            Residential | Commercial | Industrial | RailwayLand | Construction | Park | Cemetery => AreaLayer::Use,
            Farmland | Meadow | Grass | Scrub | Forest | Wetland | Sand | Rock | Water => AreaLayer::Cover,
            TrackBed | Parking | Square | Pavement | Platform | Pier | Pitch | Playground => AreaLayer::Paved,
            Carriageway => AreaLayer::Carriageway,
        }
    }
}

listed! {
    /// What a line is. Later classes are painted over earlier ones.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
    pub enum LineClass {
        /// Rivers, canals, streams and ditches.
        Waterway,
        Pier,
        Platform,
        /// Railways on ballast.
        Rail,
        NarrowGauge,
        /// Tracks in the street.
        Tram,
        /// Ways of fields and woods.
        Track,
        /// Trodden paths and bridleways.
        Path,
        Footway,
        Cycleway,
        Steps,
        /// Streets for people on foot.
        Pedestrian,
        Taxiway,
        Runway,
        /// Driveways, alleys, lanes of parking areas.
        Service,
        /// Streets in which people walk on the carriageway.
        LivingStreet,
        Residential,
        /// Minor roads between places.
        Unclassified,
        Tertiary,
        Secondary,
        Primary,
        Trunk,
        Motorway,
        /// Zebra crossings, from kerb to kerb or beyond. Stripes are painted on carriageways only.
        Zebra,
    }
}

impl LineClass {
    /// Usual width in metres, for lines whose width is no number.
    #[must_use]
    pub fn usual_width_m(self) -> f64 {
        match self {
            Self::Waterway => 4.0,
            Self::Pier | Self::Platform | Self::Zebra => 3.0,
            Self::Rail => 3.2,
            Self::NarrowGauge => 2.2,
            Self::Tram => 2.6,
            Self::Track | Self::Cycleway => 2.5,
            Self::Path => 1.2,
            Self::Footway | Self::Steps => 2.0,
            Self::Pedestrian | Self::Unclassified => 5.0,
            Self::Taxiway => 20.0,
            Self::Runway => 45.0,
            Self::Service => 3.5,
            Self::LivingStreet => 4.5,
            Self::Residential => 5.5,
            Self::Tertiary => 6.0,
            Self::Secondary => 6.5,
            Self::Primary => 7.0,
            Self::Trunk => 7.5,
            Self::Motorway => 9.0,
        }
    }

    /// Whether it is a railway.
    pub fn is_rail(self) -> bool {
        matches!(self, Self::Rail | Self::NarrowGauge | Self::Tram)
    }

    /// Whether it is for people on foot or bicycles.
    pub fn is_path(self) -> bool {
        (Self::Track..=Self::Pedestrian).contains(&self)
    }

    /// Whether it is for cars and aircraft.
    pub fn is_road(self) -> bool {
        (Self::Taxiway..=Self::Motorway).contains(&self)
    }

    /// Whether it ends the lane lines of streets that it meets.
    pub fn is_street(self) -> bool {
        (Self::LivingStreet..=Self::Motorway).contains(&self)
    }

    /// Whether it usually has pavements where it is built up.
    pub fn has_sidewalks(self) -> bool {
        (Self::Residential..=Self::Primary).contains(&self)
    }
}
