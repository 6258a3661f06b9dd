//! Pages of the atlas whose words packets read without testing each place.

use super::lanes::{always, map4};
use crate::cpu::node::planes_of;
use crate::layout::{DrawNode, PAGE_WORDS, PLANES};

/// The words of a page that begins at `first`: zeros beyond the end of the atlas, and `None` if that is within the page.
#[inline(always)]
fn page_at(atlas: &[u32], first: usize) -> Option<&[u32; PAGE_WORDS]> {
    static ZEROS: [u32; PAGE_WORDS] = [0; PAGE_WORDS];
    match atlas.get(first..) {
        Some(words) if !words.is_empty() => words.first_chunk(),
        _ => Some(&ZEROS),
    }
}

/// The words of a node's planes; `None` if the atlas ends within one.
#[inline(always)]
pub(super) fn planes_at<'a>(atlas: &'a [u32], node: &DrawNode) -> Option<[&'a [u32; PAGE_WORDS]; PLANES]> {
    let [a, b, c, d] = map4(planes_of(node), always!(|first: usize| page_at(atlas, first)));
    Some([a?, b?, c?, d?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_beyond_the_atlas_are_zeros() {
        let atlas = vec![7; PAGE_WORDS + 1];
        assert_eq!(page_at(&atlas, 1), Some(&[7; PAGE_WORDS]));
        assert_eq!(page_at(&atlas, 2), None);
        assert_eq!(page_at(&atlas, PAGE_WORDS + 1), Some(&[0; PAGE_WORDS]));
        assert_eq!(page_at(&atlas, usize::MAX), Some(&[0; PAGE_WORDS]));
    }
}
