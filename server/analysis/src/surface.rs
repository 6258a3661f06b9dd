//! The surface of a city as analyses see it: the top of each cell, and the object that it belongs to.

use crate::kinds::Kinds;
use crate::raster::Raster;
use insula_export::leaves::LeafObjects;
use insula_export::raster::{CellExtent, visit_tops};
use insula_export::selection::ObjectSelection;
use insula_export::source::ExportSource;
use insula_export::table::ExportError;
use insula_objects::FeatureKind;
use insula_protocol::mesh_tile::NO_OBJECT;
use insula_protocol::octahedral;
use std::collections::{BTreeMap, HashMap};

/// Most cells of one analysis. They are in memory, with about 25 bytes each.
pub const MAX_CELLS: u64 = 64 << 20;

/// Codes of [`CitySurface::kind`] above all indices of buildings.
const NOTHING: u32 = u32::MAX;
const GROUND: u32 = u32::MAX - 1;
const OTHER: u32 = u32::MAX - 2;
const GENERATED: u32 = u32::MAX - 3;

/// What the top of a cell belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TopKind {
    /// Nothing was baked there.
    Nothing,
    /// Land and water, and generated ground where the source has no terrain at all.
    Ground,
    /// Generated ground around the terrain of the source, and in its holes.
    Generated,
    /// A building, as an index into [`CitySurface::buildings`].
    Roof(u32),
    /// Trees, bridges, masts and all else that stands.
    Other,
}

impl TopKind {
    /// Whether it is ground, of the source or generated.
    pub(crate) fn is_ground(self) -> bool {
        matches!(self, Self::Ground | Self::Generated)
    }

    fn code(self) -> u32 {
        match self {
            Self::Nothing => NOTHING,
            Self::Ground => GROUND,
            Self::Generated => GENERATED,
            Self::Other => OTHER,
            Self::Roof(building) => building,
        }
    }

    fn of_code(code: u32) -> Self {
        match code {
            NOTHING => Self::Nothing,
            GROUND => Self::Ground,
            GENERATED => Self::Generated,
            OTHER => Self::Other,
            building => Self::Roof(building),
        }
    }
}

/// A building with its parts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Building {
    /// Number of the object.
    pub number: u32,
    /// Of the source; empty if it has none.
    pub identifier: String,
}

/// Planes above the ground, and the tops of all else.
#[derive(Debug, Clone)]
pub(crate) struct MeasuredPlanes {
    pub(crate) tops: Raster<f32>,
    pub(crate) normals: Raster<u16>,
}

/// The tops of the cells of a part of a city, row by row from the south-west.
#[derive(Debug, Clone)]
pub struct CitySurface {
    pub extent: CellExtent,
    /// Side of a cell in metres.
    pub cell_m: f64,
    /// World position of the south-western corner.
    pub corner: [f64; 2],
    /// World height that `tops` count from.
    pub base_m: f64,
    /// Metres above `base_m`; negative infinity where nothing was baked.
    pub(crate) tops: Raster<f32>,
    /// Octahedral codes of the normals of the tops.
    pub(crate) normals: Raster<u16>,
    /// Where light is measured, if not at the tops.
    pub(crate) measured: Option<MeasuredPlanes>,
    kinds: Kinds,
    /// Indices of the cells with a wall below their tops, ascending, with the direction of its normal in 1/256 turns, 0 east, 64 north.
    walls: Vec<(u32, u8)>,
    pub buildings: Vec<Building>,
}

impl CitySurface {
    /// Reads the surface of an area in world metres, or of the whole city. Fails if the area has no or too many cells, or if tiles cannot be
    /// read.
    pub fn read(source: &dyn ExportSource, area: Option<[[f64; 2]; 2]>) -> Result<Self, ExportError> {
        let manifest = source.manifest();
        let extent = CellExtent::of(manifest, area)?;
        if extent.len() > MAX_CELLS {
            let reason = format!("{} x {} cells; choose a smaller box", extent.size[0], extent.size[1]);
            return Err(ExportError::TooLarge { format: "an analysis", reason });
        }
        let [width, height] = extent.size.map(|side| side as usize);
        let cells = width * height;
        let corner = [0, 1].map(|k| manifest.origin[k] + f64::from(extent.min[k]) * manifest.cell_m);
        let mut surface = Self {
            extent,
            cell_m: manifest.cell_m,
            corner,
            base_m: manifest.origin[2],
            tops: Raster::filled(width, height, f32::NEG_INFINITY),
            normals: Raster::filled(width, height, up()),
            measured: None,
            kinds: Kinds::default(),
            walls: Vec::new(),
            buildings: Vec::new(),
        };
        let everything = ObjectSelection::default();
        let mut objects = KindsOfObjects::new(source, &everything);
        let mut kinds = vec![NOTHING; cells];
        let mut failure = None;
        visit_tops(source, extent, &mut |cell, top| {
            let index = extent.index(cell);
            surface.tops.values[index] = (f64::from(top.height) - surface.base_m) as f32;
            surface.normals.values[index] = top.normal.unwrap_or_else(up);
            surface.walls.extend(top.wall.map(|wall| (index as u32, wall)));
            match objects.get(top.object) {
                Ok(TopKind::Ground) if top.is_generated && manifest.has_terrain => kinds[index] = GENERATED,
                Ok(kind) => kinds[index] = kind.code(),
                Err(error) => failure = Some(error),
            }
        })?;
        surface.walls.sort_unstable();
        surface.kinds = Kinds::new(width, kinds.chunks_exact(width.max(1)));
        surface.buildings = objects.buildings;
        failure.map_or(Ok(surface), Err)
    }

    /// A surface of cells of a metre without walls of their own direction, for tests.
    #[cfg(test)]
    pub(crate) fn of_cells(size: [u32; 2], corner: [f64; 2], base_m: f64, tops: Vec<f32>, kinds: &[TopKind]) -> Self {
        Self {
            extent: CellExtent { min: [0, 0], size },
            cell_m: 1.0,
            corner,
            base_m,
            normals: Raster::filled(size[0] as usize, size[1] as usize, up()),
            tops: Raster { width: size[0] as usize, height: size[1] as usize, values: tops },
            measured: None,
            kinds: Kinds::new(
                size[0] as usize,
                kinds.chunks(size[0] as usize).map(|row| row.iter().map(|kind| kind.code()).collect::<Vec<u32>>()),
            ),
            walls: Vec::new(),
            buildings: vec![Building { number: 7, identifier: "house".to_owned() }],
        }
    }

    /// Metres above the base of the top of a cell; negative infinity where nothing was baked. Requires an index of a cell.
    #[must_use]
    pub fn top(&self, index: usize) -> f32 {
        self.tops.values[index]
    }

    /// What the top of a cell belongs to. Requires an index of a cell.
    #[must_use]
    pub fn kind(&self, index: usize) -> TopKind {
        TopKind::of_code(self.kinds.get(index))
    }

    /// The kinds of a row, cell by cell: cheaper than one by one. Requires a row.
    pub(crate) fn kinds_of_row(&self, row: usize) -> impl Iterator<Item = TopKind> + '_ {
        self.kinds.row(row).map(TopKind::of_code)
    }

    /// Whether anything was baked at a cell. Requires an index of a cell.
    #[must_use]
    pub fn is_known(&self, index: usize) -> bool {
        self.tops.values[index].is_finite()
    }

    /// Direction of the normal of the wall below a cell's top, in degrees from the grid's north over east; `None` without a wall.
    #[must_use]
    pub fn wall_azimuth_deg(&self, index: usize) -> Option<f64> {
        let at = self.walls.binary_search_by_key(&(index as u32), |(cell, _)| *cell).ok()?;
        let turns = f64::from(self.walls[at].1) / 256.0;
        Some((90.0 - turns * 360.0).rem_euclid(360.0))
    }

    /// Square metres of a cell's top, as it is inclined. Requires an index of a cell.
    #[must_use]
    pub fn area_m2(&self, index: usize) -> f64 {
        let [_, _, up] = octahedral::decode(self.normals.values[index]);
        // What is steeper is no roof.
        self.cell_m * self.cell_m / f64::from(up).max(0.17)
    }

    /// World height of the ground at a place in world metres, or of the nearest ground up to two cells away; `None` if there is none.
    #[must_use]
    pub fn ground_at(&self, place: [f64; 2]) -> Option<f64> {
        const NEAR: usize = 2;
        let [x, y] = self.cell_at(place)?;
        let [width, height] = self.size();
        let range = |at: usize, side: usize| at.saturating_sub(NEAR)..(at + NEAR + 1).min(side);
        let cells = range(y, height).flat_map(|row| range(x, width).map(move |column| (column, row)));
        let ground = cells.filter(|(column, row)| self.kind(row * width + column).is_ground());
        let nearest = ground.min_by_key(|(column, row)| column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2))?;
        Some(self.base_m + f64::from(self.top(nearest.1 * width + nearest.0)))
    }

    /// World height of the top at a place; `None` where nothing was baked.
    #[must_use]
    pub fn top_at(&self, place: [f64; 2]) -> Option<f64> {
        let [x, y] = self.cell_at(place)?;
        let top = self.top(y * self.size()[0] + x);
        top.is_finite().then(|| self.base_m + f64::from(top))
    }

    /// The surface with other, level tops of some cells, as metres above the base, and what they belong to.
    pub(crate) fn changed(&self, changes: &BTreeMap<usize, (f32, TopKind)>) -> Self {
        let mut surface = self.clone();
        for (index, (top, _)) in changes {
            (surface.tops.values[*index], surface.normals.values[*index]) = (*top, up());
        }
        surface.walls.retain(|(index, _)| !changes.contains_key(&(*index as usize)));
        let [width, height] = self.size();
        surface.kinds = Kinds::new(
            width,
            (0..height).map(|y| {
                let mut codes: Vec<u32> = self.kinds.row(y).collect();
                for (index, (_, kind)) in changes.range(y * width..(y + 1) * width) {
                    codes[index - y * width] = kind.code();
                }
                codes
            }),
        );
        surface
    }

    /// Makes columns rows, or rows again, of heights and normals. Nothing else may be asked of a surface that is turned.
    pub(crate) fn turn(&mut self) {
        self.tops = self.tops.transposed();
        self.normals = self.normals.transposed();
        if let Some(MeasuredPlanes { tops, normals }) = &mut self.measured {
            (*tops, *normals) = (tops.transposed(), normals.transposed());
        }
    }

    /// Measures the light of the ground on level planes so many metres above it; of 0, on the ground itself.
    pub(crate) fn measure_above_ground(&mut self, metres: f64) {
        self.measured = (metres > 0.0).then(|| {
            let (mut tops, mut normals) = (self.tops.clone(), self.normals.clone());
            for y in 0..tops.height {
                let cells = tops.row_mut(y).iter_mut().zip(normals.row_mut(y)).zip(self.kinds_of_row(y));
                cells.filter(|(_, kind)| kind.is_ground()).for_each(|((top, normal), _)| {
                    *top += metres as f32;
                    *normal = up();
                });
            }
            MeasuredPlanes { tops, normals }
        });
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        self.extent.size.map(|side| side as usize)
    }

    /// Lower and upper corner on the map, in world metres.
    #[must_use]
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        let size = self.size().map(|cells| cells as f64 * self.cell_m);
        [self.corner, [0, 1].map(|k| self.corner[k] + size[k])]
    }

    /// World position of the south-western corner of a cell, which is counted from the city's corner.
    #[must_use]
    pub fn corner_of(&self, cell: [u32; 2]) -> [f64; 2] {
        [0, 1].map(|k| self.corner[k] + (f64::from(cell[k]) - f64::from(self.extent.min[k])) * self.cell_m)
    }

    /// The cell of a place in world metres; `None` outside of the surface.
    #[must_use]
    pub fn cell_at(&self, place: [f64; 2]) -> Option<[usize; 2]> {
        let cell = [0, 1].map(|k| ((place[k] - self.corner[k]) / self.cell_m).floor());
        let is_inside = (0..2).all(|k| cell[k] >= 0.0 && cell[k] < self.extent.size[k] as f64);
        is_inside.then(|| cell.map(|v| v as usize))
    }
}

/// The code of the normal of a level top.
pub(crate) fn up() -> u16 {
    octahedral::encode([0.0, 0.0, 1.0])
}

/// What the objects of a city are.
struct KindsOfObjects<'a> {
    objects: LeafObjects<'a>,
    known: HashMap<u32, TopKind>,
    /// Indices of buildings by number.
    places: HashMap<u32, u32>,
    buildings: Vec<Building>,
    /// The latest answer: neighbours mostly show the same object.
    latest: (u32, TopKind),
}

impl<'a> KindsOfObjects<'a> {
    fn new(source: &'a dyn ExportSource, selection: &'a ObjectSelection) -> Self {
        Self {
            objects: LeafObjects::new(source, selection),
            known: HashMap::new(),
            places: HashMap::new(),
            buildings: Vec::new(),
            latest: (NO_OBJECT, TopKind::Ground),
        }
    }

    /// Fails if the objects cannot be read.
    fn get(&mut self, number: u32) -> Result<TopKind, ExportError> {
        if self.latest.0 == number {
            return Ok(self.latest.1);
        }
        let kind = match self.known.get(&number) {
            Some(kind) => *kind,
            None => {
                let kind = self.read(number)?;
                self.known.insert(number, kind);
                kind
            }
        };
        self.latest = (number, kind);
        Ok(kind)
    }

    fn read(&mut self, number: u32) -> Result<TopKind, ExportError> {
        let object = self.objects.get(number)?;
        let kind = object.kind;
        if insula_export::leaves::is_land(kind) {
            return Ok(TopKind::Ground);
        }
        if !matches!(kind, FeatureKind::Building | FeatureKind::BuildingPart) {
            return Ok(TopKind::Other);
        }
        let whole = self.objects.whole(number)?;
        let identifier = self.objects.get(whole)?.identifier.clone();
        let next = self.buildings.len() as u32;
        let index = *self.places.entry(whole).or_insert(next);
        if index == next {
            self.buildings.push(Building { number: whole, identifier });
        }
        Ok(TopKind::Roof(index))
    }
}
