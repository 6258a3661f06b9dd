//! Palettes by name, from `colorous`.

use colorous::{Color, Gradient};

/// Gradients by name. Later ones have a neutral colour in the middle.
const GRADIENTS: [(&str, Gradient); 9] = [
    ("viridis", colorous::VIRIDIS),
    ("cividis", colorous::CIVIDIS),
    ("magma", colorous::MAGMA),
    ("inferno", colorous::INFERNO),
    ("plasma", colorous::PLASMA),
    ("turbo", colorous::TURBO),
    ("red-blue", colorous::RED_BLUE),
    ("brown-teal", colorous::BROWN_GREEN),
    ("spectral", colorous::SPECTRAL),
];

/// The name of the palette of classes.
pub(super) const CLASSES: &str = "classes";
/// Maximum number of classes with a colour of their own.
pub(super) const MAX_CLASSES: usize = 12;
/// Colours of Tableau's set before its grey, which would look like the one of other values.
const COLORED: usize = 9;

/// Where colours come from.
#[derive(Debug, Clone, Copy)]
pub(super) enum ColorPalette {
    Gradient(Gradient),
    /// Colours that are as different as possible.
    Classes,
}

impl ColorPalette {
    pub(super) const DEFAULT: Self = Self::Gradient(colorous::VIRIDIS);

    pub(super) fn from_name(name: &str) -> Option<Self> {
        let gradient =
            GRADIENTS.iter().find(|(known, _)| *known == name).map(|(_, gradient)| Self::Gradient(*gradient));
        gradient.or((name == CLASSES).then_some(Self::Classes))
    }

    /// All names, for error messages and menus.
    pub(super) fn names() -> impl Iterator<Item = &'static str> {
        GRADIENTS.iter().map(|(name, _)| *name).chain([CLASSES])
    }

    /// The colour of class `class` of `count`, at most [`MAX_CLASSES`].
    pub(super) fn class(self, class: usize, count: usize) -> [u8; 3] {
        let set: &[Color] = if count <= COLORED { &colorous::TABLEAU10 } else { &colorous::PAIRED };
        match self {
            Self::Gradient(gradient) => sample(gradient, class as f64 / count.saturating_sub(1).max(1) as f64),
            Self::Classes => set.get(class).map_or(super::OTHER_RGB, rgb),
        }
    }
}

/// The colour of a gradient at `at` between 0 and 1.
pub(super) fn sample(gradient: Gradient, at: f64) -> [u8; 3] {
    rgb(&gradient.eval_continuous(at.clamp(0.0, 1.0)))
}

fn rgb(color: &Color) -> [u8; 3] {
    [color.r, color.g, color.b]
}
