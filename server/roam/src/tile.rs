//! Which triangles of one root square are halved so that none is farther from a sample than a limit.

use super::deviation::deviation;
use super::diamond::{Corners, Diamond, Place, halves, middle, roots, upwards};
use super::field::{DataCover, HeightField};

/// A root square, called a tile: its samples and its halved diamonds.
pub(super) struct Tile<'a> {
    /// The tile's samples, to both of its ends.
    field: &'a HeightField,
    side: u32,
    corner: Place,
    limit_m: f64,
    /// Whether the diamond in the middle of which a sample lies is halved.
    is_halved: Vec<bool>,
}

impl<'a> Tile<'a> {
    pub(super) fn new(field: &'a HeightField, side: u32, limit_m: f64) -> Self {
        let [corner, _] = field.ends();
        Self { field, side, corner, limit_m, is_halved: vec![false; field.len()] }
    }

    /// Halves each diamond in which a triangle of any size is too far from a sample.
    pub(super) fn halve_upwards(&mut self) {
        for centre in upwards(self.field.ends(), self.side) {
            let (Some(index), Some(diamond)) = (self.field.index(centre), Diamond::at(centre, self.side)) else {
                continue;
            };
            if self.is_halved[index] || self.triangles(diamond).any(|corners| self.is_far(&corners)) {
                self.is_halved[index] = true;
                for apex in diamond.apexes.into_iter().flatten().filter_map(|apex| self.field.index(apex)) {
                    self.is_halved[apex] = true;
                }
            }
        }
    }

    /// Halves triangles from the largest down until none is too far from a sample: those that belong to the surface,
    /// and no others. It needs fewer triangles than `halve_upwards`, because a triangle may be near all samples
    /// although a smaller one in it is not.
    pub(super) fn halve_downwards(&mut self) {
        let mut waiting: Vec<Corners> = roots(self.corner, self.side).collect();
        let given = std::mem::replace(&mut self.is_halved, vec![false; self.field.len()]);
        for index in (0..given.len()).filter(|index| given[*index]) {
            self.halve(self.field.place(index), &mut waiting);
        }
        while let Some(corners) = waiting.pop() {
            let Some(centre) = middle(&corners).filter(|_| !self.field.is_outside(&corners)) else { continue };
            match self.field.index(centre) {
                None => waiting.extend(halves(corners, centre)),
                Some(index) if !self.is_halved[index] && self.is_far(&corners) => self.halve(centre, &mut waiting),
                Some(_) => (),
            }
        }
    }

    /// Halves a diamond and before it those of which it is a part. The new triangles are added to `waiting`.
    fn halve(&mut self, centre: Place, waiting: &mut Vec<Corners>) {
        let (Some(index), Some(diamond)) = (self.field.index(centre), Diamond::at(centre, self.side)) else { return };
        if std::mem::replace(&mut self.is_halved[index], true) {
            return;
        }
        for apex in diamond.apexes.into_iter().flatten() {
            self.halve(apex, waiting);
        }
        waiting.extend(self.triangles(diamond).flat_map(|corners| halves(corners, centre)));
    }

    /// Whether a sample is farther from a triangle than the limit.
    fn is_far(&self, corners: &Corners) -> bool {
        deviation(self.field, corners, self.limit_m) > self.limit_m
    }

    fn triangles(&self, diamond: Diamond) -> impl Iterator<Item = Corners> + use<> {
        let (corner, side) = (self.corner, self.side);
        let is_inside = move |p: &Place| (0..2).all(|axis| (corner[axis]..=corner[axis] + side).contains(&p[axis]));
        diamond.triangles().filter(move |corners| corners.iter().all(is_inside))
    }

    pub(super) fn is_halved(&self, place: Place) -> bool {
        self.field.index(place).is_some_and(|index| self.is_halved[index])
    }

    pub(super) fn set_halved(&mut self, place: Place) {
        if let Some(index) = self.field.index(place) {
            self.is_halved[index] = true;
        }
    }

    pub(super) fn draw(&self, emit: &mut impl FnMut(Corners)) {
        for root in roots(self.corner, self.side) {
            draw(self.field, root, &|index| self.is_halved[index], emit);
        }
    }
}

/// Emits the triangles in a triangle that are not halved and have data.
pub(super) fn draw(
    field: &HeightField,
    corners: Corners,
    is_halved: &impl Fn(usize) -> bool,
    emit: &mut impl FnMut(Corners),
) {
    if field.is_outside(&corners) {
        return;
    }
    // A triangle with the middle of its longest edge outside of the field crosses the border.
    match middle(&corners) {
        Some(centre) if field.index(centre).is_none_or(is_halved) => {
            halves(corners, centre).into_iter().for_each(|half| draw(field, half, is_halved, emit));
        }
        _ if field.cover(&corners) == DataCover::Full => emit(corners),
        _ => (),
    }
}
