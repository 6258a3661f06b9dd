//! The size of saved pictures.

use egui::{ComboBox, DragValue, Ui};

/// Sides of a picture, in pixels.
const SIDES: std::ops::RangeInclusive<u32> = 16..=8192;
/// Most pixels of a picture: 8192 x 4096. Its colours and radiances take 12 bytes each while it is drawn.
const MAX_PIXELS: u64 = 1 << 25;

/// Choice of a size.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum PictureFormat {
    /// As large as the window.
    #[default]
    Window,
    FullHd,
    UltraHd,
    /// The size of the two fields.
    Custom,
}

impl PictureFormat {
    const ALL: [Self; 4] = [Self::Window, Self::FullHd, Self::UltraHd, Self::Custom];

    fn word(self) -> &'static str {
        match self {
            Self::Window => "window",
            Self::FullHd => "1920 x 1080",
            Self::UltraHd => "3840 x 2160",
            Self::Custom => "other size",
        }
    }
}

/// What the user chose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureSize {
    pub format: PictureFormat,
    /// Width and height of [`PictureFormat::Custom`].
    pub custom_px: [u32; 2],
}

impl Default for PictureSize {
    fn default() -> Self {
        Self { format: PictureFormat::Window, custom_px: [7680, 4320] }
    }
}

impl PictureSize {
    /// Width and height of a picture, for a window of this size.
    pub fn size_px(&self, window_px: [u32; 2]) -> [u32; 2] {
        match self.format {
            PictureFormat::Window => bounded(window_px),
            PictureFormat::FullHd => [1920, 1080],
            PictureFormat::UltraHd => [3840, 2160],
            PictureFormat::Custom => bounded(self.custom_px),
        }
    }

    /// Lays the choice out. Returns whether a picture is asked for.
    pub fn show(&mut self, ui: &mut Ui) -> bool {
        ui.horizontal(|ui| {
            ComboBox::from_id_salt("picture size").width(96.0).selected_text(self.format.word()).show_ui(ui, |ui| {
                for format in PictureFormat::ALL {
                    ui.selectable_value(&mut self.format, format, format.word());
                }
            });
            if self.format == PictureFormat::Custom {
                for side in &mut self.custom_px {
                    ui.add(DragValue::new(side).range(SIDES).speed(8.0));
                }
            }
            ui.button("Save picture").on_hover_text("P").clicked()
        })
        .inner
    }
}

/// The size within the limits: too many pixels are reduced at the same proportions.
pub fn bounded(size_px: [u32; 2]) -> [u32; 2] {
    let [width, height] = size_px.map(|side| side.clamp(*SIDES.start(), *SIDES.end()));
    let pixels = u64::from(width) * u64::from(height);
    if pixels <= MAX_PIXELS {
        return [width, height];
    }
    let scale = (MAX_PIXELS as f64 / pixels as f64).sqrt();
    [width, height].map(|side| (f64::from(side) * scale) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_bounded() {
        assert_eq!(bounded([0, u32::MAX]), [16, 8192]);
        assert_eq!(bounded([8192, 4096]), [8192, 4096]);
        for size in [[8192, 8192], [8192, 5000], [u32::MAX; 2]] {
            let [width, height] = bounded(size);
            assert!(u64::from(width) * u64::from(height) <= MAX_PIXELS && width >= 5700, "{width} x {height}");
        }
        let mut size = PictureSize::default();
        assert_eq!(size.size_px([1280, 800]), [1280, 800]);
        for (format, expected) in [(PictureFormat::UltraHd, [3840, 2160]), (PictureFormat::Custom, [7, 9])] {
            (size.format, size.custom_px) = (format, [7, 9]);
            assert_eq!(size.size_px([1280, 800]), expected.map(|side| side.max(16)));
        }
    }
}
