//! Rings that are made of curves: arcs, circles and curves that are run through backwards.

use super::names::{Class, Names};
use super::tree::{AttributeKind, Content, Tree};
use insula_source::arc::{circle_in_space, divide_arcs_in_space};
use std::ops::Range;

/// Arcs through more positions are not read: each becomes many segments.
const MAX_CONTROLS: usize = 512;

/// The positions of curves one behind the other; `None` if one is of another form, or elsewhere in the file.
pub(super) fn points_of_curves(tree: &Tree, names: &Names, elements: Range<u32>) -> Option<Vec<[f64; 3]>> {
    let mut points = Vec::new();
    let mut next = elements.start;
    // The first element contains the others.
    while next < elements.end {
        add_curve(tree, names, next, &mut points)?;
        next = tree.node(next).end;
    }
    Some(points)
}

fn add_curve(tree: &Tree, names: &Names, node: u32, into: &mut Vec<[f64; 3]>) -> Option<()> {
    if tree.attribute(node, AttributeKind::Href).is_some() {
        return None;
    }
    match tree.class(names, node) {
        Class::Arc => {
            let controls = controls_of(tree, node);
            let is_whole = controls.len() >= 3 && controls.len() % 2 == 1 && controls.len() <= MAX_CONTROLS;
            append(is_whole.then(|| divide_arcs_in_space(&controls))?, into);
        }
        Class::Circle => append(circle_in_space(controls_of(tree, node).get(..3)?.try_into().ok()?), into),
        Class::OtherCurve => return None,
        Class::OrientableCurve => {
            let mut own = Vec::new();
            tree.children(node).try_for_each(|child| add_curve(tree, names, child, &mut own))?;
            if tree.attribute(node, AttributeKind::Orientation) == Some("-") {
                own.reverse();
            }
            append(own, into);
        }
        _ => {
            if let Content::Points { start, end } = tree.node(node).content {
                append(tree.points.get(start as usize..end as usize)?.to_vec(), into);
            }
            tree.children(node).try_for_each(|child| add_curve(tree, names, child, into))?;
        }
    }
    Some(())
}

/// All positions within an element.
fn controls_of(tree: &Tree, node: u32) -> Vec<[f64; 3]> {
    let points = tree.subtree(node).filter_map(|node| match tree.node(node).content {
        Content::Points { start, end } => tree.points.get(start as usize..end as usize),
        _ => None,
    });
    points.flatten().copied().collect()
}

/// Adds the positions of a curve, whose first one may be the last so far.
fn append(curve: Vec<[f64; 3]>, into: &mut Vec<[f64; 3]>) {
    let shared = usize::from(!into.is_empty() && into.last() == curve.first());
    into.extend(curve.into_iter().skip(shared));
}
