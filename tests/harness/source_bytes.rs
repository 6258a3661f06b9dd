//! How many bytes of a city's source files belong to some of its leaves.
//!
//! A face belongs to each leaf that it touches, borders included.
//!
//! - **OBJ**: the lines of a leaf's faces, and of the vertices, texture coordinates and normals that they use, each once. Other
//!   lines do not count.
//! - **Textures**: the file's bytes times the fraction of its texels that the faces show within the leaves. For
//!   [`SourceBytes::textures_used`], the fraction is of the texels that any face of the city shows, because other texels cost
//!   little in a compressed file.
//! - **Other formats**: the file's bytes times the fraction of the city's triangles in the leaves.
//!
//! [`SourceBytes::files`] counts whole files, because a viewer of the source cannot fetch parts: each OBJ file with a face in
//! the leaves and its material library, each texture that is visible in them, and all other files if they contain a triangle.

use anyhow::{Context, Result, bail};
use glam::DVec2;
use insula_bake::scene::Scene;
use insula_protocol::{Manifest, TileId};
use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    fs,
    path::{Path, PathBuf},
};

/// Side of the squares of texels that are treated as one, in pixels.
const GRAIN_PX: u32 = 2;

#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SourceBytes {
    pub text: f64,
    /// By area of the textures.
    pub textures: f64,
    /// By area that any face shows.
    pub textures_used: f64,
    pub files: f64,
}

/// Positions of the leaves.
#[derive(Debug, Clone, Copy)]
struct Squares {
    corner: DVec2,
    side_m: f64,
    depth: u8,
}

impl Squares {
    fn new(manifest: &Manifest) -> Self {
        let [x, y, _] = manifest.node_corner(TileId::ROOT);
        Self { corner: DVec2::new(x, y), side_m: manifest.node_side_m(manifest.depth), depth: manifest.depth }
    }

    /// The leaves that a triangle touches.
    fn leaves_of(&self, corners: [DVec2; 3]) -> Vec<TileId> {
        let p = corners.map(|p| (p - self.corner) / self.side_m);
        let (low, high) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
        let along = |low: f64, high: f64| (low.ceil() as i64 - 1).max(0)..=(high.floor() as i64).max(0);
        let mut leaves = Vec::new();
        for (x, y) in along(low.y, high.y).flat_map(|y| along(low.x, high.x).map(move |x| (x, y))) {
            let square = DVec2::new(x as f64, y as f64);
            if touches(p, square) {
                leaves.extend(TileId::new(self.depth, x as u32, y as u32));
            }
        }
        leaves
    }

    fn at(&self, p: DVec2) -> Option<TileId> {
        let at = ((p - self.corner) / self.side_m).max(DVec2::ZERO).floor();
        TileId::new(self.depth, at.x as u32, at.y as u32)
    }
}

/// Whether a triangle touches the square of side 1 at `low` (separating axis test).
fn touches(p: [DVec2; 3], low: DVec2) -> bool {
    let corners = [low, low + DVec2::X, low + DVec2::Y, low + DVec2::ONE];
    let range = |of: &[DVec2], axis: DVec2| {
        of.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], p| {
            [least.min(p.dot(axis)), most.max(p.dot(axis))]
        })
    };
    let sides = [p[1] - p[0], p[2] - p[1], p[0] - p[2]].map(DVec2::perp);
    [DVec2::X, DVec2::Y].into_iter().chain(sides).all(|axis| {
        let ([a, b], [c, d]) = (range(&p, axis), range(&corners, axis));
        a <= d && c <= b
    })
}

/// Positions in the file, with the numbers of their lines.
type Numbered = Vec<(DVec2, usize)>;

#[derive(Debug, Default)]
struct Line {
    bytes: usize,
    leaves: BTreeSet<TileId>,
    /// Index into [`Source::files`].
    file: usize,
}

#[derive(Debug)]
struct SourceTexture {
    bytes: u64,
    size: [u32; 2],
    /// The leaves that show each square of texels.
    shown: HashMap<u32, BTreeSet<TileId>>,
}

/// The bytes of a source by leaf.
#[derive(Debug, Default)]
pub struct Source {
    lines: Vec<Line>,
    /// Bytes of each OBJ file and its material library.
    files: Vec<u64>,
    textures: Vec<SourceTexture>,
    /// Bytes of other files, and the leaves of each of their triangles.
    rest_bytes: u64,
    triangles: Vec<BTreeSet<TileId>>,
    pub whole_bytes: u64,
}

impl Source {
    /// Reads `inputs`: OBJ files with their materials and textures, or other files, whose triangles are those of `scene`.
    pub fn read(inputs: &[PathBuf], scene: &Scene, manifest: &Manifest) -> Result<Self> {
        let squares = Squares::new(manifest);
        let mut source = Self::default();
        for path in inputs {
            source.whole_bytes += fs::metadata(path)?.len();
            if path.extension().is_some_and(|ext| ext == "obj") {
                source.obj(path, squares).with_context(|| path.display().to_string())?;
            } else {
                source.rest_bytes += fs::metadata(path)?.len();
            }
        }
        if source.rest_bytes > 0 {
            let origin = DVec2::new(scene.origin[0], scene.origin[1]);
            let place = |c: [f32; 3]| origin + DVec2::new(f64::from(c[0]), f64::from(c[1]));
            source.triangles =
                scene.triangles.iter().map(|t| squares.leaves_of(t.corners.map(place)).into_iter().collect()).collect();
        }
        Ok(source)
    }

    /// The bytes that belong to these leaves.
    pub fn bytes_of(&self, leaves: &BTreeSet<TileId>) -> SourceBytes {
        let is_of = |of: &BTreeSet<TileId>| !of.is_disjoint(leaves);
        let lines: usize = self.lines.iter().filter(|line| is_of(&line.leaves)).map(|line| line.bytes).sum();
        let count = self.triangles.iter().filter(|of| is_of(of)).count() as f64;
        let share = count / self.triangles.len().max(1) as f64;
        let mut bytes = SourceBytes { text: lines as f64 + self.rest_bytes as f64 * share, ..SourceBytes::default() };
        let files: BTreeSet<usize> =
            self.lines.iter().filter(|line| is_of(&line.leaves)).map(|line| line.file).collect();
        let rest_bytes = if count > 0.0 { self.rest_bytes } else { 0 };
        bytes.files = (files.iter().map(|file| self.files[*file]).sum::<u64>() + rest_bytes) as f64;
        for texture in &self.textures {
            let shown = texture.shown.values().filter(|of| is_of(of)).count() as f64;
            bytes.files += if shown > 0.0 { texture.bytes as f64 } else { 0.0 };
            let [across, up] = texture.size.map(|side| side.div_ceil(GRAIN_PX));
            bytes.textures += texture.bytes as f64 * shown / f64::from(across * up);
            bytes.textures_used += texture.bytes as f64 * shown / texture.shown.len().max(1) as f64;
        }
        bytes
    }

    fn obj(&mut self, path: &Path, squares: Squares) -> Result<()> {
        let text = fs::read_to_string(path)?;
        let file = self.files.len();
        self.files.push(text.len() as u64);
        let mut textures = BTreeMap::new();
        let mut material = None;
        let (mut points, mut places, mut normals) = (Numbered::new(), Numbered::new(), Vec::new());
        for text in text.split_inclusive('\n') {
            let mut words = text.split_whitespace();
            let line = self.lines.len();
            let pair = |mut words: std::str::SplitWhitespace<'_>| -> Result<DVec2> {
                let mut number = || anyhow::Ok(words.next().context("a number is missing")?.parse::<f64>()?);
                Ok(DVec2::new(number()?, number()?))
            };
            match words.next() {
                Some("v") => points.push((pair(words)?, line)),
                Some("vt") => places.push((pair(words)?, line)),
                Some("vn") => normals.push(line),
                Some("f") => {
                    let corners = words.map(corner).collect::<Result<Vec<_>>>()?;
                    let of = face(&corners, &points, squares)?;
                    let used = corners.iter().flat_map(|[p, t, n]| {
                        let place = |i: &usize, of: &Numbered| of.get(i.wrapping_sub(1)).map(|of| of.1);
                        [place(p, &points), place(t, &places), normals.get(n.wrapping_sub(1)).copied()]
                    });
                    used.flatten().for_each(|line| self.lines[line].leaves.extend(&of));
                    if let Some(texture) = material.and_then(|name: &str| textures.get(name)) {
                        let texture: &mut SourceTexture = &mut self.textures[*texture];
                        for k in 2..corners.len() {
                            let at = [0, k - 1, k].map(|k| {
                                Some((points.get(corners[k][0] - 1)?.0, places.get(corners[k][1].wrapping_sub(1))?.0))
                            });
                            if let [Some(a), Some(b), Some(c)] = at {
                                texture.show([a, b, c], squares);
                            }
                        }
                    }
                    self.lines.push(Line { bytes: text.len(), leaves: of, file });
                    continue;
                }
                Some("usemtl") => material = words.next(),
                Some("mtllib") => {
                    let library = path.with_file_name(words.next().unwrap_or_default());
                    let bytes = fs::metadata(&library)?.len();
                    self.whole_bytes += bytes;
                    self.files[file] += bytes;
                    self.library(&library, &mut textures)?;
                    continue;
                }
                _ => continue,
            }
            self.lines.push(Line { bytes: text.len(), leaves: BTreeSet::new(), file });
        }
        Ok(())
    }

    fn library(&mut self, path: &Path, textures: &mut BTreeMap<String, usize>) -> Result<()> {
        let mut name = String::new();
        for line in fs::read_to_string(path)?.lines() {
            match line.trim().split_once(char::is_whitespace) {
                Some(("newmtl", of)) => name = of.trim().to_owned(),
                Some(("map_Kd", file)) => {
                    let file = path.with_file_name(file.trim());
                    let bytes = fs::metadata(&file)?.len();
                    let (width, height) = image::image_dimensions(&file)?;
                    self.whole_bytes += bytes;
                    textures.insert(name.clone(), self.textures.len());
                    self.textures.push(SourceTexture { bytes, size: [width, height], shown: HashMap::new() });
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Numbers of a corner's vertex, texture coordinate and normal; 0 if missing.
fn corner(word: &str) -> Result<[usize; 3]> {
    let mut numbers = [0; 3];
    for (number, digits) in numbers.iter_mut().zip(word.split('/')) {
        *number =
            if digits.is_empty() { 0 } else { digits.parse().context("only numbers from the file's start on")? };
    }
    if numbers[0] == 0 {
        bail!("a corner without a vertex")
    }
    Ok(numbers)
}

fn face(corners: &[[usize; 3]], points: &Numbered, squares: Squares) -> Result<BTreeSet<TileId>> {
    let place = |k: usize| points.get(corners[k][0] - 1).map(|point| point.0).context("a vertex that is not there");
    let mut leaves = BTreeSet::new();
    for k in 2..corners.len() {
        leaves.extend(squares.leaves_of([place(0)?, place(k - 1)?, place(k)?]));
    }
    Ok(leaves)
}

impl SourceTexture {
    /// Records which leaves show which texels. Each corner has a position on the ground and a texture coordinate.
    fn show(&mut self, corners: [(DVec2, DVec2); 3], squares: Squares) {
        let [across, up] = self.size.map(|side| side.div_ceil(GRAIN_PX));
        let size = DVec2::new(f64::from(across), f64::from(up));
        let p = corners.map(|(_, uv)| DVec2::new(uv.x, 1.0 - uv.y) * size);
        let double = (p[1] - p[0]).perp_dot(p[2] - p[0]);
        let low = (p[0].min(p[1]).min(p[2]) - 0.5).ceil().as_i64vec2();
        let high = (p[0].max(p[1]).max(p[2]) - 0.5).floor().as_i64vec2();
        for (x, y) in (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| (x, y))) {
            let at = DVec2::new(x as f64, y as f64) + 0.5;
            let weight = |i: usize, k: usize| (p[i] - at).perp_dot(p[k] - at) / double;
            let weights = [weight(1, 2), weight(2, 0), weight(0, 1)];
            if weights.iter().all(|weight| *weight >= 0.0) {
                let ground = (0..3).fold(DVec2::ZERO, |sum, k| sum + corners[k].0 * weights[k]);
                let [x, y] = [(x, across), (y, up)].map(|(v, side)| v.rem_euclid(side.into()) as u32);
                self.shown.entry(y * across + x).or_default().extend(squares.at(ground));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_in_the_leaves_that_it_touches() {
        let squares = Squares { corner: DVec2::new(10.0, 20.0), side_m: 2.0, depth: 3 };
        let of = |p: [[f64; 2]; 3]| squares.leaves_of(p.map(DVec2::from)).len();
        assert_eq!(of([[10.5, 20.5], [11.0, 20.5], [10.5, 21.0]]), 1);
        assert_eq!(of([[10.5, 20.5], [13.4, 20.5], [10.5, 23.4]]), 3, "not the one across the slope");
        assert_eq!(of([[11.0, 21.0], [13.0, 21.0], [11.0, 21.0]]), 2, "a wall");
        assert_eq!(of([[12.0, 20.5], [12.0, 21.0], [12.0, 21.5]]), 2, "on a border");
    }

    #[test]
    fn a_surface_over_two_leaves_counts_half_for_each() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
        write(
            "a.obj",
            "mtllib a.mtl\nv 0 0 0\nv 4 0 0\nv 4 2 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 1 .5\nvt 0 .5\nusemtl m\nf 1/1 2/2 3/3 4/4\n",
        );
        write("a.mtl", "newmtl m\nmap_Kd a.png\n");
        image::RgbImage::new(64, 64).save(folder.path().join("a.png")).unwrap();
        let squares = Squares { corner: DVec2::ZERO, side_m: 2.0, depth: 1 };
        let mut source = Source::default();
        source.obj(&folder.path().join("a.obj"), squares).unwrap();
        let texture = source.textures[0].bytes as f64;
        let [west, east] = [0, 1].map(|x| source.bytes_of(&BTreeSet::from([TileId::new(1, x, 0).unwrap()])));
        assert_eq!(west, east);
        assert_eq!(west.text, 80.0);
        assert!((west.textures / texture - 0.25).abs() < 0.01 && (west.textures_used / texture - 0.5).abs() < 0.02);
        let none = source.bytes_of(&BTreeSet::from([TileId::new(1, 1, 1).unwrap()]));
        assert_eq!(none.textures, 0.0);
        let bytes = |name: &str| fs::metadata(folder.path().join(name)).unwrap().len();
        let whole = ["a.obj", "a.mtl", "a.png"].map(bytes).iter().sum::<u64>();
        assert_eq!([west.files, none.files], [whole as f64, whole as f64 - texture]);
    }
}
