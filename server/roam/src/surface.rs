//! Surfaces of height fields, tile by tile.

use super::borders::Borders;
use super::diamond::Place;
use super::field::{HeightField, HeightSource};
use super::mesh::TerrainMesh;

/// Steps along the side of a tile of `triangulate`.
pub const TILE_STEPS: u32 = 1024;
/// Vertex of a place that has none yet.
const NONE: u32 = u32::MAX;

/// The surface of a field within `max_error_m` of all its samples. It covers every cell with data at all corners of one
/// of its halves and nothing else. Fields with less than two samples along a side have no triangles.
pub fn triangulate(field: &HeightField, max_error_m: f32) -> TerrainMesh {
    let Ok(borders) = Borders::survey(field, TILE_STEPS, max_error_m);
    let tiling = borders.tiling();
    let mut mesh = TerrainMesh::default();
    let mut vertices = TileVertices::new(tiling.side());
    let mut kept = KeptBorders::new(field.size()[0], tiling.side());
    for tile in tiling.tiles() {
        let Ok(part) = tiling.read(field, tile);
        kept.give(tile, &mut vertices);
        let mut halved = borders.start(&part, tile);
        halved.halve_downwards();
        halved.draw(&mut |corners| {
            let triangle = corners.map(|place| vertices.vertex(place, &mut mesh.vertices));
            mesh.triangles.push(triangle);
        });
        kept.take(&vertices);
    }
    mesh
}

/// The part of the surface in one tile of those that were surveyed, with places of the whole grid. It has the same
/// vertices on each border as the tile on the other side.
pub fn triangulate_region<S: HeightSource>(
    source: &S,
    borders: &Borders,
    tile: [u32; 2],
) -> Result<TerrainMesh, S::Error> {
    let (mut mesh, tiling) = (TerrainMesh::default(), borders.tiling());
    if !tiling.has_tile(tile) {
        return Ok(mesh);
    }
    let part = tiling.read(source, tile)?;
    let mut halved = borders.start(&part, tile);
    halved.halve_downwards();
    let mut vertices = TileVertices::new(tiling.side());
    vertices.start(tile);
    halved.draw(&mut |corners| mesh.triangles.push(corners.map(|place| vertices.vertex(place, &mut mesh.vertices))));
    Ok(mesh)
}

struct TileVertices {
    side: u32,
    corner: Place,
    /// In rows.
    numbers: Vec<u32>,
}

impl TileVertices {
    fn new(side: u32) -> Self {
        let line = side as usize + 1;
        Self { side, corner: [0, 0], numbers: vec![NONE; line * line] }
    }

    fn start(&mut self, tile: [u32; 2]) {
        self.corner = tile.map(|n| n * self.side);
        self.numbers.fill(NONE);
    }

    /// The vertex of a place; the first time, it is added.
    fn vertex(&mut self, place: Place, vertices: &mut Vec<Place>) -> u32 {
        let [x, y] = [0, 1].map(|axis| (place[axis] - self.corner[axis]) as usize);
        let number = &mut self.numbers[y * (self.side as usize + 1) + x];
        if *number == NONE {
            *number = vertices.len() as u32;
            vertices.push(place);
        }
        *number
    }
}

/// Vertices on borders that later tiles share, row by row of tiles.
struct KeptBorders {
    /// Of the whole row between this row of tiles and the one before.
    row: Vec<u32>,
    /// Of the column between this tile and the one before.
    column: Vec<u32>,
}

impl KeptBorders {
    fn new(width: u32, side: u32) -> Self {
        let line = side as usize + 1;
        Self { row: vec![NONE; width.next_multiple_of(side) as usize + line], column: vec![NONE; line] }
    }

    /// Begins a tile with the vertices on its borders to the tiles before it.
    fn give(&self, tile: [u32; 2], vertices: &mut TileVertices) {
        vertices.start(tile);
        let (line, first) = (self.column.len(), vertices.corner[0] as usize);
        vertices.numbers[..line].copy_from_slice(&self.row[first..first + line]);
        if tile[0] > 0 {
            for (y, number) in self.column.iter().enumerate() {
                vertices.numbers[y * line] = *number;
            }
        }
    }

    /// Takes the vertices on the borders to the tiles after it.
    fn take(&mut self, vertices: &TileVertices) {
        let (line, first) = (self.column.len(), vertices.corner[0] as usize);
        self.row[first..first + line].copy_from_slice(&vertices.numbers[(line - 1) * line..]);
        for (y, number) in self.column.iter_mut().enumerate() {
            *number = vertices.numbers[(y + 1) * line - 1];
        }
    }
}
