//! Roofs over footprints: the closed surface of a building from its plan and the shape of its roof.
//!
//! Every roof is first a [`plan::Plan`]: faces that divide the footprint, with a height from 0 (eaves) to 1 (top) at each
//! point. Plans come from the straight skeleton ([`skeleton`], [`gables`]), from lines parallel to the ridge ([`over_ridge`])
//! or from a centre ([`tower`]). [`plan::Plan::bend`] breaks slopes, for mansards and barrels. [`shell`] adds walls and a
//! floor. All of them refer to shared points, so that no two faces leave a gap.

mod cut;
mod gables;
mod plan;
mod rectangle;
mod shell;
mod simple;
mod simplify;
mod skeleton;
#[cfg(test)]
mod tests;
mod tower;

use glam::DVec2;
use insula_source::object::Surface;
use insula_source::text::values_of;
use plan::{Plan, PlanPoint};
use rectangle::{Ridge, extent};

/// Roofs lower than this are flat.
const LEAST_ROOF_M: f64 = 1e-3;
/// Segments of a round roof from the eaves to the ridge, and rings of a dome.
const ROUND_STEPS: usize = 8;
/// A break of the slope, as shares of the run (from the eaves to the ridge) and of the rise.
const GAMBREL_BREAK: (f64, f64) = (0.4, 0.7);
const MANSARD_BREAK: (f64, f64) = (0.3, 0.7);
/// Usual angle of the slopes of most roofs.
const USUAL_ANGLE_DEG: f64 = 30.0;
/// Roofs whose height is only guessed are not higher.
const MAX_USUAL_HEIGHT_M: f64 = 15.0;

/// Shape of a roof, in the terms of OpenStreetMap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RoofShape {
    Flat,
    /// Two slopes that meet at a ridge between vertical gables.
    Gabled,
    /// Gabled, with a small slope at the top of each gable.
    HalfHipped,
    /// Equal slopes from all walls.
    Hipped,
    /// All slopes meet in one point.
    Pyramidal,
    /// A pyramid over a round plan.
    Cone,
    /// One slope.
    Skillion,
    /// Gabled, with slopes that are steeper at the eaves.
    Gambrel,
    /// Hipped, with slopes that are steeper at the eaves.
    Mansard,
    /// A barrel.
    Round,
    Dome,
    Onion,
    /// Gabled, with the ridge nearer to one side.
    Saltbox,
    /// Two slopes that fall from the walls to a valley.
    Butterfly,
}

/// Direction of the ridge over the smallest rectangle around the plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RoofOrientation {
    /// Parallel to the longer side.
    Along,
    /// Parallel to the shorter side.
    Across,
}

/// A roof to build. Heights share one zero; `base_m <= eaves_m <= top_m` and `base_m < top_m`.
#[derive(Debug, Clone, PartialEq)]
pub struct RoofSpec {
    pub shape: RoofShape,
    /// Height of the floor.
    pub base_m: f64,
    /// Height of the lowest points of the roof.
    pub eaves_m: f64,
    /// Height of the highest points of the roof.
    pub top_m: f64,
    /// Where the main slope faces, in degrees clockwise from north (the second axis). Ridges are perpendicular to it.
    pub direction_deg: Option<f64>,
    /// Counts if there is no direction.
    pub orientation: Option<RoofOrientation>,
}

/// Why a plan gets no such roof.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RoofFault {
    #[error("heights of the roof are not in order")]
    Heights,
    #[error("ring with fewer than three corners, a repeated corner or a coordinate that is no number")]
    Ring,
    #[error("ring without area or of the wrong direction")]
    Turn,
    #[error("rings cross or touch")]
    Crossing,
    #[error("too many corners for a roof")]
    TooManyCorners,
    #[error("straight skeleton not found")]
    Skeleton,
    #[error("roof faces do not fit")]
    Faces,
}

/// The shape of a name in OpenStreetMap's and Overture's terms, of several the first that is known; `None` if none is. Case, spaces,
/// hyphens and underscores do not matter.
pub fn roof_shape_by_name(names: &str) -> Option<RoofShape> {
    values_of(names).find_map(shape_by_name)
}

fn shape_by_name(name: &str) -> Option<RoofShape> {
    let letters: String = name.chars().filter(char::is_ascii_alphabetic).map(|c| c.to_ascii_lowercase()).collect();
    Some(match letters.as_str() {
        "flat" => RoofShape::Flat,
        "gabled" | "gable" | "pitched" | "dualpitched" => RoofShape::Gabled,
        "halfhipped" | "hippedandgabled" | "clippedgable" | "jerkinhead" => RoofShape::HalfHipped,
        "hipped" | "hip" => RoofShape::Hipped,
        "pyramidal" | "pyramid" | "tented" => RoofShape::Pyramidal,
        "cone" | "conical" => RoofShape::Cone,
        "skillion" | "shed" | "leanto" | "monopitch" => RoofShape::Skillion,
        "gambrel" => RoofShape::Gambrel,
        "mansard" => RoofShape::Mansard,
        "round" | "barrel" | "spherical" => RoofShape::Round,
        "dome" => RoofShape::Dome,
        "onion" => RoofShape::Onion,
        "saltbox" => RoofShape::Saltbox,
        "butterfly" => RoofShape::Butterfly,
        _ => return None,
    })
}

/// Height in metres of a roof whose height is not known, by the width of its plan and the given or the usual angle of its
/// slopes. 0 for flat roofs and for plans without area.
pub fn default_roof_height(shape: RoofShape, rings: &[Vec<[f64; 2]>], angle_deg: Option<f64>) -> f64 {
    let Some(width_m) = rectangle::usual_width_m(rings) else { return 0.0 };
    let by_angle = |run_m: f64, usual_deg: f64| {
        let height_m = run_m * libm::tan(angle_deg.unwrap_or(usual_deg).clamp(1.0, 85.0).to_radians());
        if angle_deg.is_some() { height_m } else { height_m.min(MAX_USUAL_HEIGHT_M) }
    };
    let half_m = width_m / 2.0;
    match shape {
        RoofShape::Flat => 0.0,
        RoofShape::Gabled | RoofShape::HalfHipped | RoofShape::Hipped => by_angle(half_m, USUAL_ANGLE_DEG),
        RoofShape::Pyramidal | RoofShape::Gambrel | RoofShape::Mansard => by_angle(half_m, 40.0),
        RoofShape::Cone => by_angle(half_m, 50.0),
        RoofShape::Skillion => by_angle(width_m, 10.0),
        RoofShape::Butterfly => by_angle(half_m, 15.0),
        RoofShape::Saltbox => by_angle(width_m * SALTBOX_RIDGE, 40.0),
        RoofShape::Round => half_m.min(MAX_USUAL_HEIGHT_M) * 0.6,
        RoofShape::Dome => half_m.min(2.0 * MAX_USUAL_HEIGHT_M),
        RoofShape::Onion => (1.2 * width_m).min(2.0 * MAX_USUAL_HEIGHT_M),
    }
}

/// The closed surface of a building: a floor at `base_m`, walls with gables, and roof faces. Every edge is shared by exactly
/// two of its faces.
///
/// `rings` are in metres: the outer ring counter-clockwise, then the holes clockwise, without repeated corners. Pyramids,
/// domes and onions whose centre does not see all walls become hipped roofs. Fails if the rings are no simple polygon, or if
/// the roof cannot be found.
pub fn build(rings: &[Vec<[f64; 2]>], spec: &RoofSpec) -> Result<Vec<Surface>, RoofFault> {
    let is_ordered = spec.base_m <= spec.eaves_m && spec.eaves_m <= spec.top_m && spec.base_m < spec.top_m;
    if !is_ordered || ![spec.base_m, spec.top_m].iter().all(|height_m| height_m.is_finite()) {
        return Err(RoofFault::Heights);
    }
    let outline = Outline::new(rings)?;
    let plan = if spec.top_m - spec.eaves_m < LEAST_ROOF_M { Plan::flat(&outline) } else { plan(&outline, spec)? };
    shell::close(&outline, &plan.checked()?, spec)
}

fn plan(outline: &Outline, spec: &RoofSpec) -> Result<Plan, RoofFault> {
    let ridge = || Ridge::of(outline, spec.direction_deg, spec.orientation);
    let bent = |plan: Result<Plan, RoofFault>, bends: &[(f64, f64)]| plan.and_then(|plan| plan.bend(bends));
    match spec.shape {
        RoofShape::Flat => Ok(Plan::flat(outline)),
        RoofShape::Hipped => gables::hipped(outline),
        RoofShape::Mansard => bent(gables::hipped(outline), &[MANSARD_BREAK]),
        RoofShape::Gabled => gabled(outline, spec, Profile::Gabled),
        RoofShape::HalfHipped => gabled(outline, spec, Profile::HalfHipped),
        RoofShape::Gambrel => bent(gabled(outline, spec, Profile::Gabled), &[GAMBREL_BREAK]),
        RoofShape::Round => bent(gabled(outline, spec, Profile::Gabled), &quarter_circle()),
        RoofShape::Skillion => over_ridge(outline, &Ridge::of_slope(outline, spec), Profile::Skillion),
        RoofShape::Saltbox => over_ridge(outline, &ridge(), Profile::Saltbox),
        RoofShape::Butterfly => over_ridge(outline, &ridge(), Profile::Butterfly),
        RoofShape::Pyramidal | RoofShape::Cone => tower::over(outline, tower::PYRAMID),
        RoofShape::Dome => tower::over(outline, &tower::dome(ROUND_STEPS)),
        RoofShape::Onion => tower::over(outline, tower::ONION),
    }
}

/// A roof with gables: by the ridge's direction if that is given or clear from the plan, else by the skeleton.
fn gabled(outline: &Outline, spec: &RoofSpec, profile: Profile) -> Result<Plan, RoofFault> {
    let is_given = spec.direction_deg.is_some() || spec.orientation.is_some();
    if !is_given
        && !rectangle::is_nearly_rectangular(outline)
        && let Ok(plan) = gables::gabled(outline, profile == Profile::HalfHipped)
    {
        return Ok(plan);
    }
    over_ridge(outline, &Ridge::of(outline, spec.direction_deg, spec.orientation), profile)
}

/// Points of a quarter of a circle, from the eaves (excluded) to the ridge (excluded).
fn quarter_circle() -> Vec<(f64, f64)> {
    let angle = |i: usize| std::f64::consts::FRAC_PI_2 * i as f64 / ROUND_STEPS as f64;
    (1..ROUND_STEPS).map(|i| (1.0 - libm::cos(angle(i)), libm::sin(angle(i)))).collect()
}

/// Plans with more corners get no roof but a flat one.
const MAX_CORNERS: usize = 2000;
/// Coordinates beyond this have too few digits left.
const MAX_COORDINATE_M: f64 = 1e8;
/// Corners nearer than this to each other, or to another edge, are taken as touching.
const TOUCH_M: f64 = 1e-6;

/// A simple polygon with holes. Corners are numbered through all rings.
struct Outline {
    /// The outer ring counter-clockwise, then the holes clockwise, in metres from the centre of the outer ring's box.
    rings: Vec<Vec<DVec2>>,
    /// Corners as they were given.
    given: Vec<[f64; 2]>,
    /// Centre, in the coordinates that were given.
    centre: DVec2,
    area_m2: f64,
}

impl Outline {
    /// Checks rings. Fails if they are no simple polygon, or have too many corners.
    fn new(rings: &[Vec<[f64; 2]>]) -> Result<Self, RoofFault> {
        if rings.iter().map(Vec::len).sum::<usize>() > MAX_CORNERS {
            return Err(RoofFault::TooManyCorners);
        }
        let is_valid = |corner: &[f64; 2]| corner.iter().all(|x| x.abs() < MAX_COORDINATE_M);
        if rings.is_empty() || rings.iter().any(|ring| ring.len() < 3 || !ring.iter().all(is_valid)) {
            return Err(RoofFault::Ring);
        }
        let corners = |ring: &[[f64; 2]]| ring.iter().map(|&corner| DVec2::from_array(corner)).collect::<Vec<_>>();
        let outer = corners(&rings[0]);
        let [low, high] =
            [outer.iter().fold(outer[0], |a, b| a.min(*b)), outer.iter().fold(outer[0], |a, b| a.max(*b))];
        let centre = ((low + high) / 2.0).round();
        let centred: Vec<Vec<DVec2>> =
            rings.iter().map(|ring| corners(ring).into_iter().map(|corner| corner - centre).collect()).collect();
        check(&centred)?;
        let area_m2 = centred.iter().map(|ring| simple::area(ring)).sum();
        Ok(Self { rings: centred, given: rings.concat(), centre, area_m2 })
    }

    /// All corners in the order of their numbers.
    fn corners(&self) -> Vec<DVec2> {
        self.rings.concat()
    }

    /// The numbers of the corners of each ring.
    fn ring_numbers(&self) -> Vec<Vec<usize>> {
        let mut start = 0;
        let numbers = |ring: &Vec<DVec2>| {
            start += ring.len();
            (start - ring.len()..start).collect()
        };
        self.rings.iter().map(numbers).collect()
    }
}

fn check(rings: &[Vec<DVec2>]) -> Result<(), RoofFault> {
    for (i, ring) in rings.iter().enumerate() {
        for (k, corner) in ring.iter().enumerate() {
            if corner.distance(ring[(k + 1) % ring.len()]) <= TOUCH_M {
                return Err(RoofFault::Ring);
            }
        }
        let area_m2 = simple::area(ring);
        let turned_m2 = if i == 0 { area_m2 } else { -area_m2 };
        if turned_m2.is_nan() || turned_m2 <= TOUCH_M {
            return Err(RoofFault::Turn);
        }
    }
    if !simple::is_simple(rings, TOUCH_M) {
        return Err(RoofFault::Crossing);
    }
    let is_inside = |hole: &Vec<DVec2>| {
        simple::contains(&rings[..1], hole[0])
            && rings[1..]
                .iter()
                .all(|other| std::ptr::eq(hole, other) || !simple::contains(std::slice::from_ref(other), hole[0]))
    };
    if rings[1..].iter().all(is_inside) { Ok(()) } else { Err(RoofFault::Crossing) }
}

/// Distance of a saltbox's ridge from its short side, as a share of the width.
const SALTBOX_RIDGE: f64 = 0.33;
/// Part of the height that the gables of a half-hipped roof keep.
const HALF_HIP_RISE: f64 = 0.5;
/// A half-hip takes no more than this share of the ridge.
const MAX_HALF_HIP_SHARE: f64 = 0.4;

/// Heights across the ridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Profile {
    Gabled,
    HalfHipped,
    Saltbox,
    Skillion,
    Butterfly,
}

/// A roof between the outermost corners on both sides of the ridge.
fn over_ridge(outline: &Outline, ridge: &Ridge, profile: Profile) -> Result<Plan, RoofFault> {
    let across = ridge.along.perp();
    let (low, high) = extent(&outline.rings[0], across);
    let width_m = high - low;
    if width_m.is_nan() || width_m <= 0.0 {
        return Err(RoofFault::Turn);
    }
    // From 0 on the right of the ridge to 1 on its left.
    let side = move |point: &PlanPoint| (point.at.dot(across) - low) / width_m;
    let mut plan = Plan::undivided(outline, |_| 0.0);
    let crease = match profile {
        Profile::Skillion => {
            plan.set_rise(side);
            return Ok(plan);
        }
        Profile::Gabled | Profile::HalfHipped | Profile::Butterfly => 0.5,
        Profile::Saltbox => SALTBOX_RIDGE,
    };
    plan.cut(|point| side(point) - crease)?;
    plan.set_rise(|point| (side(point) / crease).min((1.0 - side(point)) / (1.0 - crease)));
    match profile {
        Profile::Butterfly => plan.set_rise(|point| 1.0 - point.rise),
        Profile::HalfHipped => clip_ends(&mut plan, outline, ridge, width_m)?,
        _ => {}
    }
    Ok(plan)
}

/// Lowers both ends of a gabled roof to slopes as steep as the others.
fn clip_ends(plan: &mut Plan, outline: &Outline, ridge: &Ridge, width_m: f64) -> Result<(), RoofFault> {
    let (start, end) = extent(&outline.rings[0], ridge.along);
    let run_m = (width_m / 2.0 * (1.0 - HALF_HIP_RISE)).min(MAX_HALF_HIP_SHARE * (end - start));
    let slope = (1.0 - HALF_HIP_RISE) / run_m;
    if !slope.is_finite() {
        return Err(RoofFault::Turn);
    }
    let at_start = |point: &PlanPoint| HALF_HIP_RISE + slope * (point.at.dot(ridge.along) - start);
    let at_end = |point: &PlanPoint| HALF_HIP_RISE + slope * (end - point.at.dot(ridge.along));
    plan.cut(|point| at_start(point) - point.rise)?;
    plan.cut(|point| at_end(point) - point.rise)?;
    plan.set_rise(|point| point.rise.min(at_start(point)).min(at_end(point)));
    // The middle of the ridge may be outside of the outline.
    let highest = plan.points.iter().map(|point| point.rise).fold(f64::MIN_POSITIVE, f64::max);
    plan.set_rise(|point| point.rise / highest);
    Ok(())
}
