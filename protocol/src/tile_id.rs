//! Ids of quadtree nodes.

use serde::{Deserialize, Serialize};

/// Deepest allowed level: 2^20 leaves per side.
pub const MAX_LEVEL: u8 = 20;

/// A node of a city's quadtree. Level 0 is the root; x grows to the east and y to the north.
///
/// A `TileId` is always valid: `level` is at most [`MAX_LEVEL`], and `x` and `y` are below `2^level`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "RawTileId", into = "RawTileId")]
pub struct TileId {
    level: u8,
    x: u32,
    y: u32,
}

#[derive(Serialize, Deserialize)]
struct RawTileId {
    level: u8,
    x: u32,
    y: u32,
}

impl TryFrom<RawTileId> for TileId {
    type Error = &'static str;
    fn try_from(raw: RawTileId) -> Result<Self, Self::Error> {
        Self::new(raw.level, raw.x, raw.y).ok_or("a tile id's x or y lies outside its level")
    }
}

impl From<TileId> for RawTileId {
    fn from(id: TileId) -> Self {
        Self { level: id.level, x: id.x, y: id.y }
    }
}

impl TileId {
    /// The root node.
    pub const ROOT: Self = Self { level: 0, x: 0, y: 0 };

    /// `None` if `level` is over [`MAX_LEVEL`], or `x` or `y` is not below `2^level`.
    pub const fn new(level: u8, x: u32, y: u32) -> Option<Self> {
        if level > MAX_LEVEL || x >> level != 0 || y >> level != 0 { None } else { Some(Self { level, x, y }) }
    }

    /// 0 for the root.
    pub const fn level(self) -> u8 {
        self.level
    }

    /// Column, `0..2^level`, to the east.
    pub const fn x(self) -> u32 {
        self.x
    }

    /// Row, `0..2^level`, to the north.
    pub const fn y(self) -> u32 {
        self.y
    }

    /// `None` for the root.
    pub const fn parent(self) -> Option<Self> {
        if self.level == 0 { None } else { Some(Self { level: self.level - 1, x: self.x >> 1, y: self.y >> 1 }) }
    }

    /// The position among the parent's children: bit 0 is east, bit 1 is north.
    pub const fn quadrant(self) -> usize {
        ((self.x & 1) | ((self.y & 1) << 1)) as usize
    }

    /// The child in `quadrant` (0 to 3); `None` at [`MAX_LEVEL`].
    pub const fn child(self, quadrant: usize) -> Option<Self> {
        if self.level >= MAX_LEVEL {
            return None;
        }
        let (dx, dy) = ((quadrant & 1) as u32, ((quadrant >> 1) & 1) as u32);
        Some(Self { level: self.level + 1, x: self.x * 2 + dx, y: self.y * 2 + dy })
    }

    /// The four children in quadrant order; none at [`MAX_LEVEL`].
    pub fn children(self) -> impl Iterator<Item = Self> {
        (0..4).filter_map(move |quadrant| self.child(quadrant))
    }

    /// The ancestor at `level`, which is the node itself at its own level; `None` at a deeper level.
    pub const fn ancestor(self, level: u8) -> Option<Self> {
        if level > self.level {
            return None;
        }
        let up = self.level - level;
        Some(Self { level, x: self.x >> up, y: self.y >> up })
    }
}

impl std::fmt::Display for TileId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}/{}", self.level, self.x, self.y)
    }
}

impl std::str::FromStr for TileId {
    type Err = &'static str;
    /// Parses `level/x/y`. Fails on anything else and on ids that cannot exist.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const WRONG: &str =
            "not a tile id: expected level/x/y, whole numbers with level at most 20, x and y below 2^level";
        let mut parts = text.split('/');
        let mut next = || parts.next().filter(|p| p.len() <= 10 && p.bytes().all(|b| b.is_ascii_digit())).ok_or(WRONG);
        let (level, x, y) = (next()?, next()?, next()?);
        if parts.next().is_some() {
            return Err(WRONG);
        }
        let number = |p: &str| p.parse::<u32>().map_err(|_| WRONG);
        let level = u8::try_from(number(level)?).map_err(|_| WRONG)?;
        Self::new(level, number(x)?, number(y)?).ok_or(WRONG)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parent_child_and_ancestor_agree() {
        let id = TileId::new(3, 5, 2).unwrap();
        assert_eq!(id.parent(), TileId::new(2, 2, 1));
        assert_eq!(id.parent().unwrap().child(id.quadrant()), Some(id));
        assert_eq!(id.ancestor(0), Some(TileId::ROOT));
        assert_eq!(id.ancestor(4), None);
        assert_eq!(TileId::ROOT.children().count(), 4);
    }

    #[test]
    fn invalid_ids_are_refused() {
        assert!(TileId::new(0, 1, 0).is_none());
        assert!(TileId::new(21, 0, 0).is_none());
        assert!(TileId::new(20, (1 << 20) - 1, 0).is_some());
        for wrong in ["", "1", "1/0", "1/2/0", "1/0/0/0", "-1/0/0", "1/+1/0", "1/0/0 ", "256/0/0", "1/99999999999/0"] {
            assert!(wrong.parse::<TileId>().is_err(), "{wrong:?}");
        }
        assert_eq!("3/5/2".parse::<TileId>().unwrap().to_string(), "3/5/2");
    }
}
