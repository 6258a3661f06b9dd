//! What a view needs most: priorities of diamonds.

use glam::Vec3;

/// A diamond, in metres: columns along x, rows along y, heights along z.
#[derive(Debug, Clone, Copy)]
pub struct Node {
    /// Both ends of the longest edge, then the right angles on both sides of it. One outside of the field is the first
    /// end; a height without data is the field's lowest.
    pub corners_m: [Vec3; 4],
    /// Lowest and highest corner of a box around the diamond and around those of all diamonds that can be halved only
    /// after it.
    pub reach_m: [Vec3; 2],
    /// Upper bound of the vertical distance from the samples, of this diamond and of all in its reach.
    pub error_m: f32,
}

/// Which diamonds are halved first. Closures are priorities too.
///
/// No diamond should have a higher priority than one that must be halved before it. That holds for what grows with
/// `error_m` and does not shrink for a larger `reach_m`. Where it does not hold, the lower of both counts.
pub trait Priority {
    /// Not a number and negative numbers count as zero.
    fn priority(&self, node: &Node) -> f32;
}

impl<F: Fn(&Node) -> f32> Priority for F {
    fn priority(&self, node: &Node) -> f32 {
        self(node)
    }
}

/// Upper bound of the error on the screen in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenError {
    pub eye_m: Vec3,
    /// Height of the picture in pixels through twice the tangent of half its angle of view.
    pub pixels_at_1_m: f32,
    /// Distance up to which all is equally near.
    pub near_m: f32,
}

impl Priority for ScreenError {
    fn priority(&self, node: &Node) -> f32 {
        let nearest = self.eye_m.clamp(node.reach_m[0], node.reach_m[1]);
        node.error_m * self.pixels_at_1_m / self.eye_m.distance(nearest).max(self.near_m)
    }
}

/// Order in which diamonds are halved: by priority, then the larger first, then by number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Key {
    /// Bits of a positive number, which have the same order.
    pub(super) priority: u32,
    pub(super) rank: u32,
    pub(super) index: usize,
}

/// A priority's place in the order.
pub(super) fn ordered(priority: f32) -> u32 {
    if priority > 0.0 { priority.min(f32::MAX).to_bits() } else { 0 }
}
