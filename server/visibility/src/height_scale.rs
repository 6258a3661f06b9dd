//! Heights as small numbers.

/// Metres of one code.
const STEP_M: f64 = 0.125;

/// Heights above the city's origin as codes from 1 to 65,535, of an eighth of a metre each. Code 0 is below everything.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HeightScale {
    base_m: f64,
}

impl HeightScale {
    /// A scale for heights from `lowest_m` on.
    pub(crate) fn new(lowest_m: f64) -> Self {
        Self { base_m: (lowest_m / STEP_M).floor() * STEP_M - STEP_M }
    }

    /// The highest code that is not above a height.
    pub(crate) fn down(&self, z_m: f64) -> u16 {
        ((z_m - self.base_m) / STEP_M).floor().clamp(0.0, f64::from(u16::MAX)) as u16
    }

    /// The lowest code that is not below a height.
    pub(crate) fn up(&self, z_m: f64) -> u16 {
        ((z_m - self.base_m) / STEP_M).ceil().clamp(1.0, f64::from(u16::MAX)) as u16
    }

    /// The height of a code, in metres above the city's origin.
    pub(crate) fn height_m(&self, code: u16) -> f32 {
        (self.base_m + f64::from(code) * STEP_M) as f32
    }

    /// The code of a height as a fraction.
    pub(crate) fn code_at(&self, z_m: f64) -> f32 {
        ((z_m - self.base_m) / STEP_M) as f32
    }

    pub(crate) fn code_m(&self) -> f32 {
        STEP_M as f32
    }
}
