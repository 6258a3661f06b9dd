//! What a bake will cost, known once the inputs are read. It is within a factor of about two of cities that were measured.

use insula_protocol::{NODE_CELLS, text::human_bytes};

use crate::{
    config::BakeConfig,
    scene::{grid::BLOCK_LEAVES, scratch_scene::ScratchScene, triangle_store::RECORD_BYTES},
};

/// Time of one thread for each triangle of a block, or of its margin.
const SECONDS_PER_COPY: f64 = 50e-6;
/// Time of one thread for each leaf, with its share of parents.
const SECONDS_PER_LEAF: f64 = 0.01;
/// Bytes of a leaf, with its meshes and its share of parents.
const BYTES_PER_LEAF: f64 = 1200.0;
/// Bytes of the meshes of a triangle.
const BYTES_PER_TRIANGLE: f64 = 8.0;
/// A bake that takes longer is worth a warning.
const LONG_SECONDS: f64 = 3600.0;
/// A bake that writes more is worth a warning.
const MANY_BYTES: f64 = 100e9;
/// The warning also has the time at a cell this much larger.
const COARSER: f64 = 10.0;

/// The cost of a bake.
#[derive(Debug, Clone, Copy, PartialEq)]
struct BakeEstimate {
    seconds: f64,
    /// Size of the triangles in scratch files, where every block has those around it.
    scratch_bytes: f64,
    city_bytes: f64,
}

impl BakeEstimate {
    fn of(city: &ScratchScene, config: &BakeConfig, cell_m: f64) -> Self {
        let Some([min, max]) = city.bounds else { return Self { seconds: 0.0, scratch_bytes: 0.0, city_bytes: 0.0 } };
        let leaf_m = cell_m * NODE_CELLS as f64;
        let all_m2: f64 = [0, 1].map(|axis: usize| max[axis] - min[axis] + leaf_m).iter().product();
        let leaves = all_m2.min(city.extent.covered_m2) / (leaf_m * leaf_m);
        let triangles = city.triangles as f64;
        let triangle_m = (2.0 * city.extent.surface_m2 / triangles.max(1.0)).sqrt();
        let block_m = leaf_m * f64::from(BLOCK_LEAVES);
        let blocks_along = 1.0 + (2.0 * config.sample.margin_m + triangle_m) / block_m;
        let copies = triangles * blocks_along * blocks_along;
        Self {
            seconds: (copies * SECONDS_PER_COPY + leaves * SECONDS_PER_LEAF) / config.threads as f64,
            scratch_bytes: (triangles + copies) * RECORD_BYTES as f64,
            city_bytes: leaves * BYTES_PER_LEAF + triangles * BYTES_PER_TRIANGLE,
        }
    }
}

/// A warning if the bake takes hours or writes hundreds of gigabytes; one line.
pub(super) fn warning(city: &ScratchScene, config: &BakeConfig) -> Option<String> {
    let cell_m = config.cell_m;
    let cost = BakeEstimate::of(city, config, cell_m);
    if cost.seconds < LONG_SECONDS && cost.scratch_bytes + cost.city_bytes < MANY_BYTES {
        return None;
    }
    let bytes = |bytes: f64| human_bytes(bytes as u64);
    let is_refused = cost.scratch_bytes > config.scratch_bytes as f64;
    let refused = format!(" (--scratch allows {})", human_bytes(config.scratch_bytes));
    let coarser_m = cell_m * COARSER;
    let coarser = BakeEstimate::of(city, config, coarser_m);
    Some(format!(
        "with cells of {cell_m} m this bake takes about {} on {}, {} of scratch files{}, and {} for the city; \
         with --cell {coarser_m} it takes about {} and {}",
        duration(cost.seconds),
        if config.threads == 1 { "one thread".to_owned() } else { format!("{} threads", config.threads) },
        bytes(cost.scratch_bytes),
        if is_refused { refused.as_str() } else { "" },
        bytes(cost.city_bytes),
        duration(coarser.seconds),
        bytes(coarser.scratch_bytes + coarser.city_bytes),
    ))
}

/// A rounded duration, such as `3 hours`.
fn duration(seconds: f64) -> String {
    let [minutes, hours, days] = [60.0, 3600.0, 86_400.0].map(|unit| (seconds / unit).round());
    match (minutes, hours) {
        _ if hours >= 48.0 => format!("{days} days"),
        _ if minutes >= 90.0 => format!("{hours} hours"),
        _ if minutes >= 2.0 => format!("{minutes} minutes"),
        _ => "a minute".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BakeOptions, scene::Scene};

    /// A city of 1 km by 1 km with the surface of Delft.
    fn city(triangles: u64) -> ScratchScene {
        let mut city = ScratchScene::from_scene(Scene::default()).unwrap();
        city.bounds = Some([[0.0; 3], [1000.0, 1000.0, 30.0]]);
        city.triangles = triangles;
        city.extent.add(1.2e6, [3000.0, 3000.0]);
        city
    }

    fn config(cell_m: f64) -> BakeConfig {
        let options = BakeOptions { out: "city".into(), cell_m, threads: Some(2), ..BakeOptions::default() };
        BakeConfig::new(&options).unwrap()
    }

    #[test]
    fn only_bakes_of_hours_or_of_many_bytes_are_worth_a_warning() {
        for cell_m in [1.0, 0.5, 0.25] {
            assert_eq!(warning(&city(100_000), &config(cell_m)), None);
        }
        let fine = warning(&city(100_000), &config(0.01)).unwrap();
        assert!(fine.contains("cells of 0.01 m") && fine.contains(" hours on 2 threads"), "{fine}");
        assert!(fine.contains("(--scratch allows 68.7 GB)") && fine.contains("--cell 0.1 it takes about"), "{fine}");
        let many = warning(&city(400_000_000), &config(1.0)).unwrap();
        assert!(many.contains("GB of scratch files"), "{many}");
    }

    #[test]
    fn estimate_is_that_of_a_measured_city() {
        // Delft, 109,039 triangles on 1.2 square kilometres: 23 s of one thread at 1 m, and 58 s at 0.5 m.
        for (cell_m, measured) in [(1.0, 23.0), (0.5, 58.0)] {
            let seconds = 2.0 * BakeEstimate::of(&city(109_039), &config(cell_m), cell_m).seconds;
            assert!((measured / 2.0..measured * 2.0).contains(&seconds), "{seconds} s at {cell_m} m");
        }
    }

    #[test]
    fn durations_have_the_unit_of_their_size() {
        let all = [20.0, 600.0, 5000.0, 7300.0, 100_000.0, 900_000.0].map(duration);
        assert_eq!(all, ["a minute", "10 minutes", "83 minutes", "2 hours", "28 hours", "10 days"]);
    }
}
