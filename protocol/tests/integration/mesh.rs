//! The mesh codec: any triangles round trip exactly, and bytes that are not a mesh are refused.

use insula_protocol::mesh::half_edge::HalfEdgeMesh;
use insula_protocol::mesh::{Attribute, AttributeKind, EncodedMesh, Mesh, PositionGrid};
use insula_test_support::rng::Rng;
use insula_test_support::tier;

/// Random meshes of the full tier.
const MESHES: u64 = 3000;
const MUTATIONS: u64 = 20_000;

/// Triangles of a mesh under construction.
#[derive(Default)]
struct Soup {
    positions: Vec<[u32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    /// Adds a sheet of quads: open, or closed to a tube or torus; some are omitted.
    fn sheet(&mut self, rng: &mut Rng, most: u32) {
        let (w, h) = (3 + rng.below_u32(most), 3 + rng.below_u32(most));
        let (round, over) = (rng.one_in(2), rng.one_in(2));
        let first = self.positions.len() as u32;
        for i in 0..w * h {
            self.positions.push([
                200 + i % w * 9 + rng.below_u32(4),
                200 + i / w * 9 + rng.below_u32(4),
                300 + rng.below_u32(9),
            ]);
        }
        let holes = rng.below_u32(8);
        for y in 0..if over { h } else { h - 1 } {
            for x in 0..if round { w } else { w - 1 } {
                let at = |x: u32, y: u32| first + y % h * w + x % w;
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
                let pair = if rng.one_in(3) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                for triangle in pair {
                    if holes == 0 || !rng.one_in(2 + holes) {
                        self.triangles.push(triangle);
                    }
                }
            }
        }
    }

    /// Adds boxes, some with a corner at a vertex of another.
    fn boxes(&mut self, rng: &mut Rng, most: u32) {
        const SIDES: [[u32; 3]; 12] = [
            [0, 1, 5],
            [0, 5, 4],
            [1, 3, 7],
            [1, 7, 5],
            [3, 2, 6],
            [3, 6, 7],
            [2, 0, 4],
            [2, 4, 6],
            [4, 5, 7],
            [4, 7, 6],
            [0, 3, 1],
            [0, 2, 3],
        ];
        for _ in 0..1 + rng.below_u32(most) {
            let (x, y, z) = (rng.below_u32(3000), rng.below_u32(3000), 20 + rng.below_u32(600));
            let (w, d) = (10 + rng.below_u32(300), 10 + rng.below_u32(300));
            let corners: Vec<u32> = (0..8)
                .map(|i| {
                    if !self.positions.is_empty() && rng.one_in(12) {
                        return rng.below_u32(self.positions.len() as u32);
                    }
                    self.positions.push([x + (i & 1) * w, y + (i >> 1 & 1) * d, (i >> 2) * z]);
                    self.positions.len() as u32 - 1
                })
                .collect();
            let open = rng.one_in(3);
            self.triangles.extend(SIDES[..if open { 10 } else { 12 }].iter().map(|t| t.map(|i| corners[i as usize])));
        }
    }

    /// Adds triangles between random vertices, which are rarely manifold.
    fn random_triangles(&mut self, rng: &mut Rng, most: u32) {
        let first = self.positions.len() as u32;
        let vertices = 3 + rng.below_u32(most);
        self.positions.extend((0..vertices).map(|_| [0; 3].map(|_| rng.below_u32(4096))));
        for _ in 0..1 + rng.below_u32(3 * most) {
            self.triangles.push([0; 3].map(|_| first + rng.below_u32(vertices)));
        }
    }

    /// Merges some vertices, and reverses and duplicates some triangles.
    fn disturb(&mut self, rng: &mut Rng) {
        for _ in 0..rng.below_u32(4) {
            let vertices = self.positions.len() as u32;
            let (from, to) = (rng.below_u32(vertices), rng.below_u32(vertices));
            self.triangles.as_flattened_mut().iter_mut().filter(|v| **v == from).for_each(|v| *v = to);
        }
        for _ in 0..rng.below_u32(4) {
            let t = rng.below_u32(self.triangles.len() as u32) as usize;
            self.triangles[t].swap(0, 1);
            let t = rng.below_u32(self.triangles.len() as u32) as usize;
            self.triangles.push(self.triangles[t]);
        }
    }
}

fn attribute(rng: &mut Rng, kind: AttributeKind, soup: &Soup) -> Attribute {
    let components = if kind == AttributeKind::Colour { 3 } else { 2 };
    let bits = 6 + rng.below_u32(11) as u8;
    let seams = 1 + rng.below_u32(20);
    let own: Vec<[u32; 4]> = soup
        .positions
        .iter()
        .map(|p| std::array::from_fn(|c| if c < components { p[c] & ((1 << bits) - 1) } else { 0 }))
        .collect();
    let mut values = own.clone();
    let corners = soup.triangles.as_flattened().iter().map(|vertex| {
        if !rng.one_in(seams) {
            return *vertex;
        }
        values.push(std::array::from_fn(|c| if c < components { rng.below_u32(1 << bits) } else { 0 }));
        values.len() as u32 - 1
    });
    let corners = corners.collect();
    Attribute { kind, components: components as u8, bits, range: [0.5, 0.25], values, corners }
}

fn random(seed: u64, most: u32) -> Mesh {
    let mut rng = Rng::new(seed);
    let mut soup = Soup::default();
    for _ in 0..1 + rng.below_u32(5) {
        match rng.below_u32(3) {
            0 => soup.sheet(&mut rng, most),
            1 => soup.boxes(&mut rng, most),
            _ => soup.random_triangles(&mut rng, most),
        }
    }
    soup.disturb(&mut rng);
    let kinds = [AttributeKind::Normal, AttributeKind::Colour, AttributeKind::TexCoord, AttributeKind::Other];
    let mut attributes = Vec::new();
    for kind in kinds {
        if rng.one_in(4) {
            attributes.push(attribute(&mut rng, kind, &soup));
        }
    }
    let min = if rng.one_in(2) { [0.0, -5.5, 12.0] } else { [84_123.456, 447_000.1, -1.2] };
    let bits = 12 + rng.below_u32(5) as u8;
    Mesh {
        grid: PositionGrid { min, step: 0.015625, bits },
        positions: soup.positions,
        triangles: soup.triangles,
        attributes,
    }
}

/// Checks that a mesh round trips: shared vertices, triangles with their orientation after repair, and all values.
fn check(mesh: &Mesh) -> EncodedMesh {
    let encoded = mesh.encode().unwrap();
    let back = Mesh::decode(&encoded.bytes).unwrap();
    let (vertices, corners) = (&encoded.vertices, &encoded.corners);
    assert_eq!(back.grid, mesh.grid);
    let positions: Vec<_> = vertices.iter().map(|vertex| mesh.positions[*vertex as usize]).collect();
    assert!(back.positions == positions);
    let given = mesh.triangles.as_flattened();
    let expected = corners.iter().map(|corner| given[*corner as usize]);
    assert!(back.triangles.as_flattened().iter().map(|vertex| vertices[*vertex as usize]).eq(expected));
    let left_out = (encoded.report.degenerate + encoded.report.duplicate) as usize;
    assert_eq!(back.triangles.len() + left_out, mesh.triangles.len());
    // Every triangle occurs once, and only the counted ones are reversed.
    let mut seen = vec![false; mesh.triangles.len()];
    let mut turned = 0;
    for triangle in corners.as_chunks::<3>().0 {
        let t = triangle[0] / 3;
        assert!(!std::mem::replace(&mut seen[t as usize], true));
        let turn = triangle.map(|corner| corner - 3 * t);
        let forwards = [[0, 1, 2], [1, 2, 0], [2, 0, 1]].contains(&turn);
        assert!(forwards || [[0, 2, 1], [2, 1, 0], [1, 0, 2]].contains(&turn));
        turned += u32::from(!forwards);
    }
    assert_eq!(turned, encoded.report.turned);
    for (given, found) in mesh.attributes.iter().zip(&back.attributes) {
        assert_eq!(
            (given.kind, given.components, given.bits, given.range),
            (found.kind, found.components, found.bits, found.range)
        );
        let value = |attribute: &Attribute, corner: u32| attribute.values[attribute.corners[corner as usize] as usize];
        assert!((0..).zip(corners).all(|(new, old)| value(found, new) == value(given, *old)));
    }
    assert_eq!(mesh.attributes.len(), back.attributes.len());
    encoded
}

/// Number of random cases: that of an environment variable, for example 100000, or `full`, of which the quick tier takes a tenth.
fn count(variable: &str, full: u64) -> u64 {
    let by_tier = if tier::is_full() { full } else { full / 10 };
    std::env::var(variable).ok().and_then(|count| count.parse().ok()).unwrap_or(by_tier)
}

/// `INSULA_MESHES` sets the number of meshes.
#[test]
fn random_meshes_round_trip_exactly() {
    let count = count("INSULA_MESHES", MESHES);
    let mut by_flags = [0; 16];
    let by_coder = |by_flags: &[u32; 16]| [0, 1, 4, 8].map(|flags| by_flags[flags] + by_flags[flags + 2]);
    // Until each coder was used: some meshes are rare.
    for seed in 0..count.max(MESHES) {
        if seed >= count && by_coder(&by_flags).iter().all(|meshes| *meshes > 0) {
            break;
        }
        let mesh = random(seed, if seed % 50 == 0 { 30 } else { 9 });
        assert!(HalfEdgeMesh::new(&mesh.triangles, mesh.positions.len() as u32).is_sound(), "seed {seed}");
        by_flags[usize::from(check(&mesh).bytes[1])] += 1;
    }
    let every = by_coder(&by_flags);
    assert!(
        every.iter().all(|meshes| *meshes > 0),
        "meshes by coder (edges, architectural, edges and middle, degrees): {every:?}"
    );
}

#[test]
fn every_number_of_bits_round_trips() {
    for bits in 8..=16 {
        let mut mesh = random(7, 20);
        mesh.grid.bits = bits;
        for (i, position) in mesh.positions.iter_mut().enumerate() {
            *position = position.map(|v| if i % 3 == 0 { (1 << bits) - 1 - v % (1 << bits) } else { v % (1 << bits) });
        }
        check(&mesh);
    }
}

#[test]
fn positions_off_the_grid_are_refused() {
    let mut mesh = random(1, 9);
    mesh.positions[0][0] = 1 << mesh.grid.bits;
    mesh.triangles = vec![[0, 1, 2]];
    mesh.attributes.clear();
    assert!(mesh.encode().is_err());
    mesh.grid.bits = 17;
    assert!(mesh.encode().is_err());
}

#[test]
fn an_empty_mesh_round_trips() {
    let grid = PositionGrid::enclosing(&[], 12);
    let mesh = Mesh { grid, positions: vec![], triangles: vec![], attributes: vec![] };
    assert!(check(&mesh).bytes.len() < 40);
}

#[test]
fn truncated_and_extra_bytes_are_refused() {
    // One mesh for each position coder.
    let mut left = vec![0, 1, 4, 8];
    for seed in 0..MESHES {
        if left.is_empty() {
            break;
        }
        let bytes = random(seed, 9).encode().unwrap().bytes;
        let Some(at) = left.iter().position(|flags| *flags == bytes[1] & !2) else { continue };
        left.remove(at);
        for length in 0..bytes.len() {
            assert!(Mesh::decode(&bytes[..length]).is_err(), "{length}");
        }
        assert!(Mesh::decode(&[&bytes[..], &[0, 0]].concat()).is_err());
    }
    assert!(left.is_empty(), "no mesh has the flags {left:?}");
}

#[test]
fn unknown_flags_are_refused() {
    let bytes = random(3, 9).encode().unwrap().bytes;
    for flags in [5, 9, 12, 13, 16, 32, 64, 128] {
        let mut bytes = bytes.clone();
        bytes[1] = flags | bytes[1] & 2;
        assert_eq!(Mesh::decode(&bytes).unwrap_err().to_string(), "a mesh has unknown flags", "{flags}");
    }
}

/// `INSULA_MUTATIONS` sets the number of mutations.
#[test]
fn mutated_bytes_decode_to_a_valid_mesh_or_an_error() {
    let count = count("INSULA_MUTATIONS", MUTATIONS);
    let originals: Vec<Vec<u8>> = (0..64).map(|seed| random(seed, 9).encode().unwrap().bytes).collect();
    let mut rng = Rng::new(99);
    let mut read = 0;
    for i in 0..count.max(MUTATIONS) {
        if i >= count && read > 0 {
            break;
        }
        let mut bytes = originals[rng.below_u32(64) as usize].clone();
        for _ in 0..1 + rng.below_u32(4) {
            let at = rng.below_u32(bytes.len() as u32) as usize;
            match rng.below_u32(4) {
                0 => bytes[at] ^= 1 << rng.below_u32(8),
                1 => bytes[at] = rng.below_u32(256) as u8,
                2 => bytes.truncate(at.max(1)),
                _ => bytes[at..].rotate_left(1),
            }
        }
        if let Ok(mesh) = Mesh::decode(&bytes) {
            read += 1;
            assert!(mesh.triangles.as_flattened().iter().all(|vertex| (*vertex as usize) < mesh.positions.len()));
            assert!(mesh.positions.as_flattened().iter().all(|v| *v < 1 << mesh.grid.bits));
            for attribute in &mesh.attributes {
                assert_eq!(attribute.corners.len(), 3 * mesh.triangles.len());
                assert!(attribute.corners.iter().all(|value| (*value as usize) < attribute.values.len()));
            }
        }
    }
    assert!(read > 0, "no mutation decoded: the bytes after the header were never tested");
}

#[test]
fn a_tetrahedron_has_the_expected_bytes() {
    let positions = vec![[0, 0, 0], [4095, 0, 0], [0, 4095, 0], [0, 0, 4095]];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    let grid = PositionGrid { min: [1.0, 2.0, 3.0], step: 0.5, bits: 12 };
    let mesh = Mesh { grid, positions, triangles, attributes: vec![] };
    let hex: String = check(&mesh).bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(hex, "03010c000000803f00000040000040400000003f04041000ff50d50ba7725e636d46fb82323cc6f16cbe9f69");
}
