//! How many pixels each node of a cut got.
//!
//! In: a picture's hits. Out: a count a node. Next: the client's selection learns what is hidden.

/// Pixels of each of `nodes` nodes; hits of others are ignored.
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
    fn counts_nodes_and_nothing_else() {
        assert_eq!(hit_counts(&[2, 0, NO_NODE, 2, 3], 3), [1, 0, 2]);
    }
}
