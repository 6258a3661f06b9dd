//! Triangles of lists, strips and fans, and the vertices that they use.

const TRIANGLES: u32 = 4;
const STRIP: u32 = 5;
const FAN: u32 = 6;

pub(super) fn is_triangles(mode: u32) -> bool {
    (TRIANGLES..=FAN).contains(&mode)
}

/// Triangles of a mode over `corners` corners with the vertices `vertex`. Strips and fans leave out triangles of two equal
/// corners, which join their parts.
pub(super) fn triangles(mode: u32, corners: usize, vertex: impl Fn(usize) -> u32) -> Vec<[u32; 3]> {
    let joined = |[a, b, c]: [u32; 3]| a == b || b == c || c == a;
    match mode {
        STRIP => {
            let triangle = |i: usize| {
                let [a, b] = if i.is_multiple_of(2) { [i, i + 1] } else { [i + 1, i] };
                [a, b, i + 2].map(&vertex)
            };
            (0..corners.saturating_sub(2)).map(triangle).filter(|triangle| !joined(*triangle)).collect()
        }
        FAN => {
            let triangle = |i: usize| [0, i + 1, i + 2].map(&vertex);
            (0..corners.saturating_sub(2)).map(triangle).filter(|triangle| !joined(*triangle)).collect()
        }
        _ => (0..corners / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2].map(&vertex)).collect(),
    }
}

/// Leaves out triangles with a vertex of `vertices` or more. Returns how many.
pub(super) fn drop_out_of_range(triangles: &mut Vec<[u32; 3]>, vertices: usize) -> usize {
    let before = triangles.len();
    triangles.retain(|triangle| triangle.iter().all(|vertex| (*vertex as usize) < vertices));
    before - triangles.len()
}

/// The vertices that triangles use, ascending, if they are fewer than `vertices`: many primitives may share one accessor. The
/// triangles then index into them. All must be below `vertices`.
pub(super) fn compact(triangles: &mut [[u32; 3]], vertices: usize) -> Option<Vec<u32>> {
    let corners = triangles.len() * 3;
    if corners >= vertices / 8 {
        let mut numbers = vec![u32::MAX; vertices];
        triangles.as_flattened().iter().for_each(|vertex| numbers[*vertex as usize] = 0);
        let used: Vec<u32> = (0..vertices as u32).filter(|vertex| numbers[*vertex as usize] == 0).collect();
        if used.len() == vertices {
            return None;
        }
        used.iter().zip(0..).for_each(|(vertex, number)| numbers[*vertex as usize] = number);
        triangles.as_flattened_mut().iter_mut().for_each(|vertex| *vertex = numbers[*vertex as usize]);
        return Some(used);
    }
    let mut used = triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    for vertex in triangles.as_flattened_mut() {
        *vertex = used.binary_search(vertex).unwrap_or(0) as u32;
    }
    Some(used)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_orientation() {
        assert_eq!(triangles(STRIP, 5, |i| i as u32), [[0, 1, 2], [2, 1, 3], [2, 3, 4]]);
        assert_eq!(triangles(FAN, 5, |i| i as u32), [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        assert_eq!(triangles(TRIANGLES, 7, |i| i as u32), [[0, 1, 2], [3, 4, 5]]);
        let joined = [0, 1, 2, 2, 5, 5, 6, 7];
        assert_eq!(triangles(STRIP, 8, |i| joined[i]), [[0, 1, 2], [6, 5, 7]], "degenerate triangles are no triangles");
        assert!(triangles(STRIP, 1, |_| 0).is_empty());
    }

    #[test]
    fn unused_vertices_are_dropped() {
        let mut list = vec![[7, 5, 7], [5, 9, 100]];
        assert_eq!(drop_out_of_range(&mut list, 10), 1);
        assert_eq!(compact(&mut list, 10), Some(vec![5, 7]));
        assert_eq!(list, [[1, 0, 1]]);
        let mut few = vec![[900, 5, 7]];
        assert_eq!(compact(&mut few, 1000), Some(vec![5, 7, 900]), "few of many");
        assert_eq!(few, [[2, 0, 1]]);
        assert_eq!(compact(&mut [[0, 1, 2]], 3), None, "all are used");
    }
}
