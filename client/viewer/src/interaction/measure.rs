//! Measures lines, areas and heights between clicked points.

use super::units::{area_text, length_text};
use glam::{DVec2, DVec3};
use insula_protocol::text::fixed;

/// Most points of a figure.
const MAX_POINTS: usize = 1000;

/// What is measured.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum MeasureKind {
    /// A line through any number of points.
    #[default]
    Line,
    /// The horizontal area of a polygon.
    Area,
    /// The difference in height of two points.
    Height,
}

impl MeasureKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Line, Self::Area, Self::Height];

    /// Name for people.
    pub fn word(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::Area => "area",
            Self::Height => "height",
        }
    }
}

/// The tool and its points, in the city's coordinates.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeasureTool {
    /// Whether clicks set points.
    pub is_active: bool,
    kind: MeasureKind,
    points: Vec<DVec3>,
}

impl MeasureTool {
    /// Activates the tool, or deactivates it. The points are deleted, the kind stays.
    pub fn toggle(&mut self) {
        *self = Self { is_active: !self.is_active, kind: self.kind, points: Vec::new() };
    }

    /// Activates the tool, goes to its next kind, or deactivates it after the last one.
    pub fn next(&mut self) {
        let next = MeasureKind::ALL.iter().position(|kind| *kind == self.kind).map_or(0, |at| at + 1);
        match MeasureKind::ALL.get(next) {
            _ if !self.is_active => *self = Self { is_active: true, ..Self::default() },
            Some(kind) => self.set_kind(*kind),
            None => *self = Self::default(),
        }
    }

    /// What is measured.
    pub fn kind(&self) -> MeasureKind {
        self.kind
    }

    /// Measures something else. Lines and areas keep their points.
    pub fn set_kind(&mut self, kind: MeasureKind) {
        if self.kind != kind && [self.kind, kind].contains(&MeasureKind::Height) {
            self.points.clear();
        }
        self.kind = kind;
    }

    /// The points in the order of the clicks.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Adds a point. A third point of a height starts a new measurement. Returns `false` if the figure has too many points.
    pub fn add_point(&mut self, point: DVec3) -> bool {
        if self.kind == MeasureKind::Height && self.points.len() == 2 {
            self.points.clear();
        }
        let has_room = self.points.len() < MAX_POINTS;
        if has_room {
            self.points.push(point);
        }
        has_room
    }

    /// Removes the last point.
    pub fn undo(&mut self) {
        self.points.pop();
    }

    /// Removes all points.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// The lines of the figure; that of an area is closed.
    pub fn lines(&self) -> impl Iterator<Item = [DVec3; 2]> {
        let closing = match self.points[..] {
            [first, _, .., last] if self.kind == MeasureKind::Area => Some([last, first]),
            _ => None,
        };
        self.points.windows(2).map(|ends| [ends[0], ends[1]]).chain(closing)
    }

    /// The result as lengths and areas with their units; none before there is one. Of a line its length, that on the map and how far it
    /// rises, or the last three of its last part if it has more; of an area its size and the length of its outline, or that alone if the
    /// outline crosses itself; of a height the difference, both heights and how far they are apart on the map.
    pub fn figures(&self) -> Vec<String> {
        match (self.kind, &self.points[..]) {
            (_, [] | [_]) | (MeasureKind::Area, [_, _]) => Vec::new(),
            (MeasureKind::Line, points) => line_figures(points),
            (MeasureKind::Area, points) => area_figures(points),
            (MeasureKind::Height, [a, b, ..]) => {
                [b.z - a.z, a.z, b.z, a.truncate().distance(b.truncate())].map(length_text).to_vec()
            }
        }
    }

    /// The result, or what the user should do next; `None` if the tool is inactive.
    pub fn text(&self) -> Option<String> {
        if !self.is_active {
            return None;
        }
        Some(match (self.kind, &self.figures()[..], &self.points[..]) {
            (MeasureKind::Line, [long, level, up], _) => format!("{long} long, {level} horizontally, {up} up"),
            (MeasureKind::Line, [long, level, last, last_level, up], _) => {
                format!("{long} long, {level} horizontally; last part {last}, {last_level} horizontally, {up} up")
            }
            (MeasureKind::Area, [around], _) => {
                format!("the outline crosses itself: undo a point; its length is {around}")
            }
            (MeasureKind::Area, [size, around], _) => format!("{size} in plan, {around} around"),
            (MeasureKind::Height, [up, from, to, apart], _) => {
                format!("{up} higher ({from} to {to}), {apart} apart horizontally")
            }
            (_, _, [p]) => {
                let [x, y, z] = p.to_array().map(|v| fixed(v, 1));
                format!("from {x}, {y}, {z}: click the next point")
            }
            (MeasureKind::Area, _, [_, _]) => "click the third point of the area".to_owned(),
            (kind, ..) => format!("{}: click a first point", kind.word()),
        })
    }
}

fn line_figures(points: &[DVec3]) -> Vec<String> {
    let sum = |length: fn(DVec3) -> f64| points.windows(2).map(|ends| length(ends[1] - ends[0])).sum::<f64>();
    let mut figures = vec![sum(DVec3::length), sum(horizontal_length)];
    if let [.., a, b] = points {
        let last = *b - *a;
        if points.len() > 2 {
            figures.extend([last.length(), horizontal_length(last)]);
        }
        figures.push(last.z);
    }
    figures.into_iter().map(length_text).collect()
}

fn horizontal_length(line: DVec3) -> f64 {
    line.truncate().length()
}

fn area_figures(points: &[DVec3]) -> Vec<String> {
    let corners: Vec<DVec2> = points.iter().map(|p| p.truncate()).collect();
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    let around = length_text(sides.map(|(a, b)| a.distance(*b)).sum());
    if crosses_itself(&corners) { vec![around] } else { vec![area_text(polygon_area(&corners)), around] }
}

/// Area of a polygon whose sides do not cross, in the square of its unit. Coordinates are taken from the first corner: products
/// of a country's coordinates would lose the digits of a house.
pub fn polygon_area(corners: &[DVec2]) -> f64 {
    let Some((first, others)) = corners.split_first() else { return 0.0 };
    let doubled: f64 = others.windows(2).map(|ends| (ends[0] - *first).perp_dot(ends[1] - *first)).sum();
    (doubled * 0.5).abs()
}

/// Whether two sides of a closed polygon cross. Sides that only touch do not.
pub fn crosses_itself(corners: &[DVec2]) -> bool {
    let side = |i: usize| [corners[i], corners[(i + 1) % corners.len()]];
    (0..corners.len()).any(|i| (0..i).any(|j| do_cross(side(i), side(j))))
}

fn do_cross([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> bool {
    let is_left = |from: DVec2, to: DVec2, p: DVec2| (to - from).perp_dot(p - from);
    is_left(a, b, c) * is_left(a, b, d) < 0.0 && is_left(c, d, a) * is_left(c, d, b) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tool(kind: MeasureKind, points: &[[f64; 3]]) -> MeasureTool {
        let mut tool = MeasureTool::default();
        tool.toggle();
        tool.set_kind(kind);
        for point in points {
            assert!(tool.add_point((*point).into()));
        }
        tool
    }

    #[test]
    fn a_line_has_a_total_and_a_last_part_and_can_be_undone() {
        let mut line = tool(MeasureKind::Line, &[[0.0; 3], [3.0, 4.0, 12.0]]);
        assert_eq!(line.text().unwrap(), "13.00 m long, 5.00 m horizontally, 12.00 m up");
        line.add_point(DVec3::new(3.0, 4.0, 2.0));
        let text = "23.00 m long, 5.00 m horizontally; last part 10.00 m, 0.00 m horizontally, -10.00 m up";
        assert_eq!(line.text().unwrap(), text);
        assert_eq!((line.lines().count(), line.figures().len()), (2, 5));
        line.undo();
        line.undo();
        assert!(line.text().unwrap().contains("click the next point"));
        line.undo();
        line.undo();
        assert_eq!(line.text().unwrap(), "line: click a first point");
        line.toggle();
        assert!(line.figures().is_empty());
        assert_eq!((line.text(), line), (None, MeasureTool::default()));
    }

    #[test]
    fn areas_are_exact_far_from_the_origin() {
        // A house of 10 m x 8 m with a notch of 2 m x 3 m, in the coordinates of a country.
        let outline =
            [[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [5.0, 8.0], [5.0, 5.0], [3.0, 5.0], [3.0, 8.0], [0.0, 8.0]];
        let corners = outline.map(|[x, y]| [4_321_000.0 + x, 5_678_000.0 + y, 30.0 + 0.7 * x]);
        let area = tool(MeasureKind::Area, &corners);
        assert_eq!(area.text().unwrap(), "74.0 m\u{b2} in plan, 42.00 m around");
        assert_eq!(area.lines().count(), 8);
        let mut reversed = corners;
        reversed.reverse();
        assert_eq!(tool(MeasureKind::Area, &reversed).text(), area.text());
        assert_eq!((polygon_area(&[]), polygon_area(&[DVec2::ONE; 2])), (0.0, 0.0));
    }

    #[test]
    fn an_outline_that_crosses_itself_has_no_area() {
        let bow_tie = tool(MeasureKind::Area, &[[0.0; 3], [10.0, 10.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]]);
        assert!(bow_tie.text().unwrap().starts_with("the outline crosses itself"));
        assert_eq!(bow_tie.figures().len(), 1);
        // A corner on another side only touches it.
        assert!(!crosses_itself(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 0.0], [0.0, 4.0]].map(DVec2::from)));
    }

    #[test]
    fn a_height_is_the_difference_of_two_points_and_a_third_starts_again() {
        let mut height = tool(MeasureKind::Height, &[[0.0, 0.0, 2.5], [3.0, 4.0, 110.0]]);
        assert_eq!(height.text().unwrap(), "107.5 m higher (2.50 m to 110.0 m), 5.00 m apart horizontally");
        height.add_point(DVec3::ONE);
        assert_eq!(height.points(), [DVec3::ONE]);
        height.set_kind(MeasureKind::Line);
        assert!(height.points().is_empty());
    }

    #[test]
    fn a_figure_has_a_limited_number_of_points() {
        let mut line = tool(MeasureKind::Line, &[]);
        let added = (0..2 * MAX_POINTS).filter(|i| line.add_point(DVec3::splat(*i as f64))).count();
        assert_eq!((added, line.points().len()), (MAX_POINTS, MAX_POINTS));
        assert!(!line.text().unwrap().is_empty());
    }
}
