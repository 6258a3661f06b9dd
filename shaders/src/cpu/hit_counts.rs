//! Counts the pixels of each node of the draw list. GPU twin: `hit_counts.wgsl`.

/// Pixels of each of the draw list's `nodes` nodes, from the hits of a frame. Other hits are ignored.
pub fn hit_counts(hit: &[u32], nodes: usize) -> Vec<u32> {
    let mut pixels = vec![0; nodes];
    for node in hit {
        if let Some(count) = pixels.get_mut(*node as usize) {
            *count += 1;
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::NO_NODE;

    #[test]
    fn counts_the_listed_nodes_only() {
        assert_eq!(hit_counts(&[2, 0, NO_NODE, 2, 3], 3), [1, 0, 2]);
    }
}
