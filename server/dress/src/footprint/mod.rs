//! Areas on the map, and what becomes of them: a building with height, roof and colours by its attributes, or a level
//! surface. The same for all formats.
//!
//! Names of attributes are those of OpenStreetMap, of city offices and of Overture.

mod canopy;
mod colour;
mod ended;
mod height;
mod height_names;
mod hidden;
mod kind;
mod lengths;
mod line_width;
mod posts;
mod prism;
mod roof_tags;

pub use canopy::Canopy;
pub use colour::{ResolvedColour, building_colours, by_use};
pub use ended::{ENDED, has_ended};
pub use height::{BuildingHeight, HeightHints, has_height, known_height_m, needs_ground};
pub use height_names::is_height;
pub use hidden::{HAZARD, IN_TUNNEL, INDOORS, UNDERGROUND, hidden, is_hazard, is_hidden, is_yes};
pub use kind::kind_of;
pub use lengths::length_m;
pub use line_width::{AEROWAY_WIDTHS_M, HIGHWAY_WIDTHS_M, LANE_M, RAILWAY_WIDTHS_M, WATERWAY_WIDTHS_M, usual_width_m};
pub use posts::posts;
pub use prism::{GroundPlan, GroundPlans, PrismMaterials};
pub use roof_tags::RoofTags;
