//! The range of heights that colours show, which no schema has.

use super::ColorBy;
use crate::block::ObjectBlock;
use crate::filter::Source;

/// Blocks whose objects stand for all of a city.
const SAMPLED_BLOCKS: u32 = 64;
/// Share of the heights that lie below the end of the colours.
const SHARE_BELOW: f64 = 0.98;
/// Where colours may end, in metres: round heights, whose quarters are round, too.
const ENDS_M: [f64; 9] = [5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0, 200.0, 400.0];

/// Numbers of the blocks whose heights stand for those of a city with `count` blocks.
pub fn sampled_blocks(count: u32) -> impl Iterator<Item = u32> {
    let step = count.div_ceil(SAMPLED_BLOCKS).max(1);
    (0..count).step_by(step as usize)
}

impl ColorBy {
    /// Whether the colours are a gradient of heights: see [`Self::over_heights`].
    pub fn is_of_heights(&self) -> bool {
        self.source == Source::Height && self.range().is_some()
    }

    /// Lets a gradient of heights end at a round height that nearly all objects of some [blocks](sampled_blocks) stay below, so that low
    /// towns and high ones have all colours. Other colours stay as they are.
    #[must_use]
    pub fn over_heights<'a>(self, blocks: impl IntoIterator<Item = &'a ObjectBlock>) -> Self {
        if !self.is_of_heights() {
            return self;
        }
        let mut heights = Vec::new();
        for block in blocks {
            let values = block.ids().iter().filter_map(|id| self.value(block, *id)?.as_f64());
            heights.extend(values.filter(|height| *height > 0.0));
        }
        heights.sort_by(f64::total_cmp);
        let Some(last) = heights.len().checked_sub(1) else { return self };
        let high = heights[(last as f64 * SHARE_BELOW) as usize];
        let [.., highest] = ENDS_M;
        let end = ENDS_M.into_iter().find(|end| high <= *end).unwrap_or(highest);
        self.with_range([0.0, end])
    }
}
