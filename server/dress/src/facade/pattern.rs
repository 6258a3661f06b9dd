//! The texture of a facade: four by four cells of one bay and one storey each, which differ in their panes.

use super::FacadeUse;

/// Cells along a texture's side.
pub(super) const CELLS: u32 = 4;
/// Texels along a cell's side: about 10 cm.
const CELL_TEXELS: u32 = 32;

/// Panes: mostly dark, some with curtains.
const PANES: [[u8; 3]; 8] =
    [[54, 64, 74], [48, 57, 67], [60, 70, 78], [54, 64, 74], [50, 60, 66], [66, 74, 80], [46, 54, 64], [112, 112, 106]];

/// Texels along the texture's side.
pub const SIDE_TEXELS: u32 = CELLS * CELL_TEXELS;

/// A window in its cell, in texels from the cell's left and bottom.
struct WindowShape {
    /// Ends of the opening from the left.
    across: [u32; 2],
    /// Ends of the opening from the bottom.
    up: [u32; 2],
    /// Widths of the panes with the bar to their right.
    pane: u32,
    frame: [u8; 3],
}

fn shape_of(facade_use: FacadeUse) -> WindowShape {
    match facade_use {
        FacadeUse::Office => WindowShape { across: [3, 29], up: [9, 26], pane: 5, frame: [128, 131, 133] },
        FacadeUse::Home | FacadeUse::Windowless => {
            WindowShape { across: [10, 23], up: [9, 25], pane: 6, frame: [206, 204, 198] }
        }
    }
}

/// Draws the facade of walls with colour `wall`: [`SIDE_TEXELS`] rows of as many texels, from the top.
pub(super) fn draw(facade_use: FacadeUse, wall: [u8; 3]) -> Vec<[u8; 3]> {
    let side = SIDE_TEXELS;
    let shape = shape_of(facade_use);
    let texel = |i: u32| {
        let (x, y) = (i % side, side - 1 - i / side);
        let cell = [x / CELL_TEXELS, y / CELL_TEXELS];
        shape.texel([x % CELL_TEXELS, y % CELL_TEXELS], cell, wall)
    };
    (0..side * side).map(texel).collect()
}

impl WindowShape {
    /// The colour at a texel of a cell.
    fn texel(&self, [x, y]: [u32; 2], cell: [u32; 2], wall: [u8; 3]) -> [u8; 3] {
        let [left, right] = self.across;
        let [bottom, top] = self.up;
        // The sill stands out by a texel to both sides.
        if y + 1 == bottom && (left - 1..=right).contains(&x) {
            return scaled(wall, 112);
        }
        if !(left..right).contains(&x) || !(bottom..top).contains(&y) {
            return wall;
        }
        let (across, up) = (x - left, y - bottom);
        let is_frame = across % self.pane == 0 || across + 1 == right - left || up == 0 || y + 1 == top;
        if is_frame {
            // The reveal shades the upper end.
            return if y + 1 == top { scaled(self.frame, 80) } else { self.frame };
        }
        let pane = PANES[pane_number(cell, across / self.pane) as usize];
        if y + 2 == top { scaled(pane, 75) } else { pane }
    }
}

/// A number below 8 for a pane; panes of a window often agree.
fn pane_number([x, y]: [u32; 2], pane: u32) -> u32 {
    let mixed = (x * 0x9e37 + y * 0x79b9 + (pane / 2) * 0x58d1 + 0x2545).wrapping_mul(0x9e37_79b1);
    mixed >> 29
}

fn scaled(rgb: [u8; 3], percent: u32) -> [u8; 3] {
    rgb.map(|v| (u32::from(v) * percent / 100).min(255) as u8)
}
