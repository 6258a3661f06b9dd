//! How far lines change a picture beside them and around junctions, in metres.

pub(super) const KERB_M: f64 = 0.15;
pub(super) const PAVEMENT_M: f64 = 2.0;
/// Width of what is painted beside a carriageway.
pub(super) const CASING_M: f64 = KERB_M + PAVEMENT_M;
/// The miter of a stripe's bend is at most this many times its distance from the line; sharper bends are cut.
pub(super) const MAX_MITER: f64 = 2.0;
/// Whole stripes are made of pieces of this length. A cut changes only the pieces that it touches: the edges of longer
/// ones would be rounded in another way, far from the cut.
pub(super) const WHOLE_PIECE_M: f64 = 6.0;
/// Wider streets end the lane lines of others no earlier. Wider lines have no lane lines and no round ends.
pub(super) const MAX_HALF_M: f64 = 15.0;
/// Lane lines end this far before the edge of the street that is met.
pub(super) const STOP_M: f64 = 2.0;
/// Streets that meet change a picture this far around the junction: along the street to the end of the piece of a lane
/// line that is cut, and across it to that of a bend.
pub(super) const JUNCTION_REACH_M: f64 = (MAX_HALF_M + STOP_M + WHOLE_PIECE_M) + MAX_MITER * MAX_HALF_M;
/// Lines that meet give each other round ends, which have this radius.
pub(super) const ROUND_END_REACH_M: f64 = MAX_HALF_M + CASING_M + 0.5;
const _: () = assert!(JUNCTION_REACH_M > ROUND_END_REACH_M, "streets have round ends too");
