//! What a bake will cost, known once the triangles are sorted into blocks.

use insula_protocol::text::human_bytes;

use crate::{config::BakeConfig, scene::partition::LeafBlock};

/// Time of one thread for each triangle of a block, or of its margin: Delft at cells of 1 and 0.5 m.
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

/// A warning if the bake of `triangles` in these blocks takes hours or writes hundreds of gigabytes; one line.
pub(super) fn warning(blocks: &[LeafBlock], triangles: u64, config: &BakeConfig) -> Option<String> {
    let leaves = blocks.iter().map(|block| f64::from(block.leaves.count_ones())).sum::<f64>();
    let copies = blocks.iter().map(|block| block.triangles as f64).sum::<f64>();
    let seconds = (copies * SECONDS_PER_COPY + leaves * SECONDS_PER_LEAF) / config.threads as f64;
    let bytes = leaves * BYTES_PER_LEAF + triangles as f64 * BYTES_PER_TRIANGLE;
    (seconds >= LONG_SECONDS || bytes >= MANY_BYTES).then(|| {
        format!(
            "with cells of {} m this bake takes about {} on {} and {} for the city; a larger --cell takes less of both",
            config.cell_m,
            duration(seconds),
            if config.threads == 1 { "one thread".to_owned() } else { format!("{} threads", config.threads) },
            human_bytes(bytes as u64),
        )
    })
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
    use crate::{BakeOptions, scene::block_content::BlockContent};

    fn config(cell_m: f64) -> BakeConfig {
        let options = BakeOptions { out: "city".into(), cell_m, threads: Some(2), ..BakeOptions::default() };
        BakeConfig::new(&options).unwrap()
    }

    fn blocks(count: u32, triangles: u64) -> Vec<LeafBlock> {
        let block = |x| LeafBlock { x, y: 0, leaves: 0b1111, triangles, content: BlockContent::default() };
        (0..count).map(block).collect()
    }

    #[test]
    fn only_bakes_of_hours_are_worth_a_warning() {
        assert_eq!(warning(&blocks(1000, 1000), 500_000, &config(1.0)), None);
        // 100,000 blocks of 4 leaves and 1,000 triangles: 9,000 s of one thread, on two.
        let long = warning(&blocks(100_000, 1000), 50_000_000, &config(0.25)).unwrap();
        assert!(long.contains("cells of 0.25 m") && long.contains("about 75 minutes on 2 threads"), "{long}");
        assert!(long.contains("880.0 MB") && long.contains("--cell"), "{long}");
    }

    #[test]
    fn durations_have_the_unit_of_their_size() {
        let all = [20.0, 600.0, 5000.0, 7300.0, 100_000.0, 900_000.0].map(duration);
        assert_eq!(all, ["a minute", "10 minutes", "83 minutes", "2 hours", "28 hours", "10 days"]);
    }
}
