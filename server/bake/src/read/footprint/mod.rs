//! Areas on the map, and what becomes of them: a building with height, roof and colours by its attributes, or a level
//! surface. The same for all formats.
//!
//! Names of attributes are those of OpenStreetMap, of city offices and of Overture.

mod canopy;
mod colour;
mod height;
mod height_names;
mod hidden;
mod kind;
mod line_width;
mod posts;
mod prism;
mod roof_tags;

pub(crate) use canopy::Canopy;
pub(crate) use colour::{ResolvedColour, building_colours, by_use};
pub(crate) use height::{
    BuildingHeight, GUESSED, GUESSED_FROM_LEVELS, HeightHints, NO_GROUND_HEIGHT, UNIT_GUESSED, has_height,
    known_height_m, length_m,
};
pub(crate) use height_names::is_height;
pub(crate) use hidden::{IN_TUNNEL, hidden, is_hidden};
#[cfg(test)]
pub(crate) use hidden::{INDOORS, UNDERGROUND};
pub(crate) use kind::kind_of;
pub(crate) use line_width::{
    AEROWAY_WIDTHS_M, HIGHWAY_WIDTHS_M, LANE_M, RAILWAY_WIDTHS_M, WATERWAY_WIDTHS_M, usual_width_m,
};
pub(crate) use posts::posts;
pub(crate) use prism::{GroundPlan, GroundPlans, PrismMaterials};
pub(crate) use roof_tags::RoofTags;
