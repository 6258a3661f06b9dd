//! Levels of detail by distance instead of error.

use super::parse_positive;
use clap::Args;
use insula_viewer::switching::{MAX_SWITCHES, SwitchDistances, SwitchVolume};

/// Options of levels of detail by distance.
#[derive(Debug, Clone, Default, PartialEq, Args)]
pub struct SwitchArgs {
    /// Distances in metres, ascending: up to the first one the finest level of detail is drawn, and beyond each one the next
    /// coarser level [default: levels by `--tau`]
    #[arg(long, value_name = "M,M,...", value_delimiter = ',', value_parser = parse_positive)]
    switch: Vec<f64>,
    /// Volume around a node to which these distances are measured
    #[arg(long, value_parser = ["box", "sphere"], default_value = "box", requires = "switch")]
    switch_volume: String,
}

impl SwitchArgs {
    /// The switching distances, if there are any, and the tau of a frame for which `tau_px` is asked. Fails if they do not ascend.
    pub fn switching(&self, tau_px: f64) -> Result<(Option<SwitchDistances>, f64), String> {
        if self.switch.is_empty() {
            return Ok((None, tau_px));
        }
        let volume = if self.switch_volume == "sphere" { SwitchVolume::Sphere } else { SwitchVolume::Box };
        let distances = SwitchDistances::new(&self.switch, volume);
        // Their errors are 1 where a level is to be drawn.
        let found = distances.map(|distances| (Some(distances), 1.0));
        found.ok_or_else(|| format!("--switch needs 1 to {MAX_SWITCHES} distances that ascend"))
    }
}
