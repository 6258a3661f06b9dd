//! Coding of single texels: colour with a chosen loss, and ambient occlusion.
//!
//! A texel is predicted from three known ones by LOCO-I's median. The difference is divided by a quantisation step and
//! coded with a model that depends on how much the three differ.

use super::neighbours::median;
use crate::codec::range::{BitCoder, BitModel, NumberModel};
use crate::texel::{AO_MAX, Texel};

/// Quantisation steps of a map's colours and occlusion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QuantisationSteps {
    /// Step of the luma, in quarters; 4 is lossless.
    pub(super) colour: u16,
    /// Step of the occlusion; 1 is lossless.
    pub(super) ao: u8,
}

impl QuantisationSteps {
    pub(super) const LOSSLESS: Self = Self { colour: QUARTERS as u16, ao: 1 };
}

/// The coverage of an opaque texel; that of an open one is 0. Other values were used for partial coverage.
const OPAQUE_COVERAGE: u32 = 3;
/// Unit of the colour step.
const QUARTERS: i32 = 4;
/// Part of a step, in 1/256, that is added before rounding down. Less than half, because zero is the cheapest to code.
const ROUND_UP: i32 = 96;
/// Ratio of the steps of chroma and luma, in halves. Errors of chroma are less visible.
const CHROMA_STEPS: i32 = 3;

/// A colour as luma and two chroma differences (YCoCg-R; Malvar and Sullivan 2003).
pub(super) type Colour = [i16; 3];

pub(super) fn from_rgb(rgb: [u8; 3]) -> Colour {
    let [r, g, b] = rgb.map(i32::from);
    let orange = r - b;
    let t = b + (orange >> 1);
    let green = g - t;
    [t + (green >> 1), orange, green].map(|v| v as i16)
}

fn to_rgb(colour: Colour) -> [u8; 3] {
    let [y, orange, green] = colour.map(i32::from);
    let t = y - (green >> 1);
    let b = t - (orange >> 1);
    [b + orange, green + t, b].map(|v| v.clamp(0, 255) as u8)
}

/// A coded texel as a reader sees it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ReconstructedTexel {
    pub(super) colour: Colour,
    pub(super) ao: i16,
}

/// Number of classes of luma by the activity of the neighbourhood.
const LUMA_CLASSES: usize = 8;
/// Largest activity with an entry in the class table.
const MAX_ACTIVITY: i32 = 1023;

#[derive(Default)]
struct TexelModels {
    luma: [NumberModel; LUMA_CLASSES],
    /// By activity, and whether an earlier component differs from its prediction.
    chroma: [[NumberModel; 6]; 2],
    ao: [NumberModel; 8],
    /// By whether the texel below is open.
    coverage: [[BitModel; 3]; 2],
    /// Whether a palette colour is that of the first neighbour, and of the second.
    first: [BitModel; 3],
    second: BitModel,
    index: Vec<BitModel>,
}

/// Quantisation of the occlusion as tables. Levels are the same in all nodes, so that equal values on both sides of a
/// node's border stay equal.
struct AoTables {
    level_of_ao: [u8; 64],
    ao_of_level: [u8; 64],
    /// Class of a neighbourhood by its activity, which is at most twice the largest occlusion.
    classes: [u8; 128],
}

impl AoTables {
    fn new(step: u8) -> Self {
        let step = usize::from(step.max(1));
        Self {
            level_of_ao: std::array::from_fn(|v| ((v + step / 2) / step) as u8),
            ao_of_level: std::array::from_fn(|level| (level * step).min(usize::from(AO_MAX)) as u8),
            classes: std::array::from_fn(|activity| if activity == 0 { 0 } else { 1 + (activity / step).min(6) as u8 }),
        }
    }
}

fn quantise(v: i32, step: i32) -> i32 {
    let k = if step == QUARTERS { v.abs() } else { (v.abs() * QUARTERS * 256 + step * ROUND_UP) / (step * 256) };
    if v < 0 { -k } else { k }
}

pub(super) struct TexelCoder<'a, C> {
    coder: &'a mut C,
    steps: QuantisationSteps,
    ao: AoTables,
    models: Box<TexelModels>,
    /// Luma class of a neighbourhood by its activity; empty if there is a palette.
    luma_classes: Vec<u8>,
    palette: Option<Vec<Colour>>,
}

impl<'a, C: BitCoder> TexelCoder<'a, C> {
    pub(super) fn new(coder: &'a mut C, steps: QuantisationSteps, palette: Option<Vec<Colour>>) -> Self {
        let step = u32::from(steps.colour);
        let class = |activity: u32| match activity * 8 / step {
            0 => 0,
            1..=2 => 1,
            3..=4 => 2,
            5..=7 => 3,
            8..=11 => 4,
            12..=18 => 5,
            19..=30 => 6,
            _ => 7,
        };
        let luma_classes =
            if palette.is_none() { (0..=MAX_ACTIVITY as u32).map(|v| class(v) as u8).collect() } else { Vec::new() };
        let mut models = Box::<TexelModels>::default();
        if let Some(palette) = &palette {
            let values = palette.len().next_power_of_two();
            models.index = vec![BitModel::default(); values - 1];
        }
        Self { coder, steps, ao: AoTables::new(steps.ao), models, luma_classes, palette }
    }

    /// Codes an opaque texel, predicted from three known ones.
    #[inline]
    pub(super) fn code(&mut self, value: Texel, known: &[ReconstructedTexel; 3]) -> (Texel, ReconstructedTexel) {
        let colour =
            if self.palette.is_some() { self.code_index(value, known) } else { self.code_colour(value, known) };
        let ao = self.code_ao(i32::from(value.ao()), known.map(|k| i32::from(k.ao)));
        (Texel::new(to_rgb(colour), ao as u8), ReconstructedTexel { colour, ao })
    }

    /// Codes whether a texel is open, predicted from the one below.
    pub(super) fn code_coverage(&mut self, is_open_below: bool, is_open: bool) -> bool {
        let coverage = |is_open: bool| if is_open { 0 } else { OPAQUE_COVERAGE };
        let models = &mut self.models.coverage[usize::from(is_open_below)];
        self.coder.choice(models, coverage(is_open)) == 0
    }

    fn code_ao(&mut self, value: i32, [a, b, c]: [i32; 3]) -> i16 {
        let activity = (a - c).abs() + (b - c).abs();
        let class = usize::from(self.ao.classes[activity as usize & 127]);
        let level = |ao: i32| i32::from(self.ao.level_of_ao[ao as usize & 63]);
        let expected = level(median(a, b, c));
        // The nearest level, even if the prediction is only a little off: where it may drift, both sides of a border differ.
        let difference = if C::WRITES { level(value) - expected } else { 0 };
        let difference = self.coder.number(&mut self.models.ao[class], difference);
        i16::from(self.ao.ao_of_level[(expected + difference).clamp(0, i32::from(AO_MAX)) as usize])
    }

    fn code_colour(&mut self, value: Texel, known: &[ReconstructedTexel; 3]) -> Colour {
        let target = if C::WRITES { from_rgb(value.rgb()).map(i32::from) } else { [0; 3] };
        let [a, b, c] = known.map(|k| k.colour.map(i32::from));
        let step = i32::from(self.steps.colour);
        let expected = median(a[0], b[0], c[0]);
        let activity = (a[0] - c[0]).abs() + (b[0] - c[0]).abs();
        let class = usize::from(self.luma_classes[activity.min(MAX_ACTIVITY) as usize]);
        let k = if C::WRITES { quantise(target[0] - expected, step) } else { 0 };
        let k = self.coder.number(&mut self.models.luma[class], k);
        let mut out = [(expected + ((k * step) / QUARTERS)).clamp(0, 255), 0, 0];
        let step = if step == QUARTERS { step } else { step * CHROMA_STEPS / 2 };
        let mut differs = usize::from(k != 0);
        for n in 1..3 {
            let expected = median(a[n], b[n], c[n]);
            let activity = ((a[n] - c[n]).abs() + (b[n] - c[n]).abs()) * QUARTERS;
            let class = usize::from(activity * 2 >= step) + usize::from(activity >= step * 2);
            let k = if C::WRITES { quantise(target[n] - expected, step) } else { 0 };
            let k = self.coder.number(&mut self.models.chroma[n - 1][class * 2 + differs], k);
            differs |= usize::from(k != 0);
            out[n] = (expected + ((k * step) / QUARTERS)).clamp(-255, 255);
        }
        out.map(|v| v as i16)
    }

    /// Codes a palette colour: as that of the first or second known texel, else by its index.
    fn code_index(&mut self, value: Texel, known: &[ReconstructedTexel; 3]) -> Colour {
        let palette = self.palette.as_deref().unwrap_or_default();
        if let [one] = palette {
            return *one;
        }
        let target = if C::WRITES { from_rgb(value.rgb()) } else { [0; 3] };
        let [a, b, c] = known.map(|k| k.colour);
        let context = usize::from(a == b) + usize::from(b == c);
        if self.coder.bit(&mut self.models.first[context], target == a) {
            return a;
        }
        if a != b && self.coder.bit(&mut self.models.second, target == b) {
            return b;
        }
        let index = palette.iter().position(|colour| *colour == target).unwrap_or(0);
        let index = self.coder.choice(&mut self.models.index, index as u32) as usize;
        palette.get(index).copied().unwrap_or(a)
    }
}
