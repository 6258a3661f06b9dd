//! Junctions: lane lines end before them, and lines that continue have round ends.

use crate::paint::class::LineClass;
use crate::paint::material::PaintMaterial;
use crate::paint::prepare::ReadyLine;
use crate::paint::reach::{MAX_HALF_M, STOP_M};
use std::collections::HashMap;

/// Points of lines are equal if their centimetres are.
const STEPS_PER_M: f64 = 100.0;

/// A point of streets.
#[derive(Debug, Clone, Copy, Default)]
struct JunctionNode {
    /// Parts of streets that begin there.
    arms: u32,
    /// Half widths of the two widest streets, with their numbers, the widest first.
    widest: [(f64, usize); 2],
}

/// Sets what lines do where they meet.
pub(super) fn join_lines(lines: &mut [ReadyLine]) {
    cut_at_junctions(lines);
    let mut ends: HashMap<([i64; 2], PaintMaterial), u32> = HashMap::new();
    let of = |line: &ReadyLine| {
        let material = match line.brush().material {
            // Streets go on as driveways.
            PaintMaterial::SideAsphalt => PaintMaterial::Asphalt,
            material => material,
        };
        [line.points.first(), line.points.last()].map(|end| end.map(|point| (key(*point), material)))
    };
    for line in lines.iter() {
        of(line).into_iter().flatten().for_each(|end| *ends.entry(end).or_default() += 1);
    }
    for line in lines {
        let is_round = |end| ends.get(&end).is_some_and(|count| *count > 1);
        line.goes_on = match line.class {
            // A river's mouth is in other water.
            LineClass::Waterway => [true; 2],
            LineClass::Pier | LineClass::Platform | LineClass::Steps => [false; 2],
            class if class.is_rail() || line.half_m > MAX_HALF_M => [false; 2],
            _ => of(line).map(|end| end.is_some_and(is_round)),
        };
    }
}

/// Sets the parts of streets without lane lines.
fn cut_at_junctions(lines: &mut [ReadyLine]) {
    let nodes = nodes(lines);
    for (number, line) in lines.iter_mut().enumerate().filter(|(_, line)| line.class.is_street()) {
        let mut cuts: Vec<[f64; 2]> = Vec::new();
        for (point, along_m) in line.points.iter().zip(&line.along_m) {
            let Some(node) = nodes.get(&key(*point)).filter(|node| node.arms > 2) else { continue };
            let Some((half_m, _)) = node.widest.iter().find(|(half_m, other)| *half_m > 0.0 && *other != number) else {
                continue;
            };
            let reach_m = half_m.min(MAX_HALF_M) + STOP_M;
            let (start, end) = (along_m - reach_m, along_m + reach_m);
            match cuts.last_mut() {
                Some(last) if last[1] >= start => last[1] = last[1].max(end),
                _ => cuts.push([start, end]),
            }
        }
        line.cuts_m = cuts;
    }
}

fn nodes(lines: &[ReadyLine]) -> HashMap<[i64; 2], JunctionNode> {
    let mut nodes: HashMap<[i64; 2], JunctionNode> = HashMap::new();
    for (number, line) in lines.iter().enumerate().filter(|(_, line)| line.class.is_street()) {
        let last = line.points.len() - 1;
        for (i, point) in line.points.iter().enumerate() {
            let node = nodes.entry(key(*point)).or_default();
            node.arms += if i == 0 || i == last { 1 } else { 2 };
            let [first, second] = &mut node.widest;
            if first.0 > 0.0 && first.1 == number {
                continue;
            }
            if line.half_m > first.0 {
                (*first, *second) = ((line.half_m, number), *first);
            } else if line.half_m > second.0 {
                *second = (line.half_m, number);
            }
        }
    }
    nodes
}

fn key(point: [f64; 2]) -> [i64; 2] {
    // Positions are within a million kilometres.
    point.map(|v| (v * STEPS_PER_M).round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paint::class::LineClass;
    use crate::paint::prepare::ReadyShapes;
    use crate::paint::shape::{PaintLine, PaintShape};

    fn cuts(lines: &[(LineClass, &[[f64; 2]])]) -> Vec<Vec<[f64; 2]>> {
        let shapes: Vec<PaintShape> =
            lines.iter().map(|(class, points)| PaintShape::Line(PaintLine::new(*class, points.to_vec()))).collect();
        let mut ready = ReadyShapes::new(&shapes, [[-1e6; 2], [1e6; 2]], 0.25);
        cut_at_junctions(&mut ready.lines);
        ready.lines.into_iter().map(|line| line.cuts_m).collect()
    }

    #[test]
    fn lane_lines_end_before_the_other_street() {
        let main: &[[f64; 2]] = &[[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]];
        let found = cuts(&[(LineClass::Residential, &[[50.0, 0.0], [50.0, 40.0]]), (LineClass::Primary, main)]);
        // The residential street is 5.5 m wide, the primary one 7 m.
        assert_eq!(found, [vec![[-5.5, 5.5]], vec![[45.25, 54.75]]]);
        for other in [LineClass::Service, LineClass::Footway, LineClass::Rail] {
            let found = cuts(&[(LineClass::Primary, main), (other, &[[50.0, 0.0], [50.0, 40.0]])]);
            assert!(found.iter().all(Vec::is_empty), "{other:?} {found:?}");
        }
    }

    #[test]
    fn a_street_that_goes_on_is_no_junction() {
        let found = cuts(&[
            (LineClass::Primary, &[[0.0, 0.0], [50.0, 0.0]]),
            (LineClass::Secondary, &[[50.0, 0.0], [100.0, 0.0]]),
        ]);
        assert!(found.iter().all(Vec::is_empty), "{found:?}");
        let found = cuts(&[
            (LineClass::Primary, &[[0.0, 0.0], [50.0, 0.0]]),
            (LineClass::Primary, &[[50.0, 0.0], [100.0, 0.0]]),
            (LineClass::Primary, &[[100.0, 50.0], [50.0, 0.0], [40.0, 50.0], [100.0, 50.0]]),
        ]);
        assert!(found.iter().all(|cuts| cuts.len() == 1), "{found:?}");
    }

    #[test]
    fn ends_are_round_where_the_same_material_goes_on() {
        let goes_on = |lines: &[(LineClass, &[[f64; 2]])]| {
            let shapes: Vec<PaintShape> =
                lines.iter().map(|(class, points)| PaintShape::Line(PaintLine::new(*class, points.to_vec()))).collect();
            let mut ready = ReadyShapes::new(&shapes, [[-1e6; 2], [1e6; 2]], 0.25);
            join_lines(&mut ready.lines);
            ready.lines.into_iter().map(|line| line.goes_on).collect::<Vec<_>>()
        };
        let (west, east): (&[[f64; 2]], &[[f64; 2]]) = (&[[0.0, 0.0], [50.0, 0.0]], &[[50.0, 0.0], [90.0, 9.0]]);
        let found = goes_on(&[(LineClass::Residential, west), (LineClass::Primary, east)]);
        assert_eq!(found, [[false, true], [true, false]]);
        let found = goes_on(&[(LineClass::Footway, west), (LineClass::Primary, east)]);
        assert_eq!(found, [[false; 2]; 2]);
        let ring = [[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 0.0]];
        assert_eq!(goes_on(&[(LineClass::Footway, &ring)]), [[true; 2]]);
        assert_eq!(goes_on(&[(LineClass::Waterway, west)]), [[true; 2]]);
        assert_eq!(goes_on(&[(LineClass::Rail, west), (LineClass::Rail, east)]), [[false; 2]; 2]);
    }

    #[test]
    fn near_junctions_make_one_cut() {
        let found = cuts(&[
            (LineClass::Residential, &[[50.0, 0.0], [50.0, 40.0]]),
            (LineClass::Residential, &[[54.0, 0.0], [54.0, -40.0]]),
            (LineClass::Primary, &[[0.0, 0.0], [50.0, 0.0], [54.0, 0.0], [100.0, 0.0]]),
        ]);
        assert_eq!(found[2], [[45.25, 58.75]]);
    }
}
