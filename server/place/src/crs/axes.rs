//! Directions in which the coordinates of horizontal systems count.

/// A direction on the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    East,
    North,
    West,
    South,
}

/// Directions of the first and the second coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Axes(Direction, Direction);

impl Axes {
    /// East, then north.
    pub const EAST_NORTH: Self = Self(Direction::East, Direction::North);
    /// North, then east.
    pub const NORTH_EAST: Self = Self(Direction::North, Direction::East);

    /// `None` if both directions are along the same line.
    pub fn new(first: Direction, second: Direction) -> Option<Self> {
        let is_along_east = |direction| matches!(direction, Direction::East | Direction::West);
        (is_along_east(first) != is_along_east(second)).then_some(Self(first, second))
    }

    /// From letters such as `ne`.
    pub fn from_letters(letters: &str) -> Option<Self> {
        let direction = |letter| match letter {
            'e' => Some(Direction::East),
            'n' => Some(Direction::North),
            'w' => Some(Direction::West),
            's' => Some(Direction::South),
            _ => None,
        };
        let mut letters = letters.chars().map(direction);
        Self::new(letters.next()??, letters.next()??)
    }

    /// The other order of east and north; `None` for axes that count towards west or south.
    pub fn swapped(self) -> Option<Self> {
        match self {
            Self::EAST_NORTH => Some(Self::NORTH_EAST),
            Self::NORTH_EAST => Some(Self::EAST_NORTH),
            _ => None,
        }
    }

    /// The axes of files that have the coordinate along the equator first, whatever the system says.
    pub fn east_first(self) -> Self {
        match self {
            Self(Direction::West, Direction::South) => self,
            _ => Self::EAST_NORTH,
        }
    }

    /// Coordinates towards east and north.
    pub fn east_north(self, [first, second]: [f64; 2]) -> [f64; 2] {
        match (self.0, self.1) {
            (Direction::East, Direction::North) => [first, second],
            (Direction::North, Direction::East) => [second, first],
            (Direction::West, Direction::South) => [-first, -second],
            (Direction::South, Direction::West) => [-second, -first],
            (Direction::North, Direction::West) => [-second, first],
            (Direction::West, Direction::North) => [-first, second],
            (Direction::East, Direction::South) => [first, -second],
            (Direction::South, Direction::East) => [second, -first],
            // `new` refuses pairs along one line.
            _ => [first, second],
        }
    }
}
