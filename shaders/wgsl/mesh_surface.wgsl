// Texture and ambient occlusion of a mesh's surface. CPU twin: src/cpu/mesh_surface.rs.

// Linear RGB of a texture at `uv`, blended between the two levels nearest to `wanted`.
fn sample_texture(info: vec4<u32>, uv: vec2<f32>, wanted: f32) -> vec3<f32> {
    let levels = max(info.z & LEVELS_MASK, 1u);
    let level = min(wanted, f32(levels - 1u));
    let fine = u32(level);
    var table = info.w;
    for (var k = 0u; k < fine; k++) {
        table += tiles_of_level(info.y, k);
    }
    let squared = bilinear(info.y, table, fine, uv);
    let coarse = min(fine + 1u, levels - 1u);
    let coarse_table = select(table, table + tiles_of_level(info.y, fine), coarse > fine);
    let coarser = bilinear(info.y, coarse_table, coarse, uv);
    return linear_of_srgb(sqrt(max(mix(squared, coarser, level - f32(fine)), vec3<f32>(0.0))));
}

// Width and height of a level, in texels.
fn level_size(size: u32, level: u32) -> vec2<u32> {
    return max(vec2<u32>((size & 0xffffu) >> level, (size >> 16u) >> level), vec2<u32>(1u));
}

fn tiles_of_level(size: u32, level: u32) -> u32 {
    let along = (level_size(size, level) + TEXTURE_TILE_PX - 1u) / TEXTURE_TILE_PX;
    return along.x * along.y;
}

// Mean of the squares of the four texels around `uv`: squares of sRGB values are close to linear light.
fn bilinear(size: u32, table: u32, level: u32, uv: vec2<f32>) -> vec3<f32> {
    let extent = level_size(size, level);
    let at = uv * vec2<f32>(extent) - 0.5;
    let corner = floor(at);
    let part = at - corner;
    var sum = vec3<f32>(0.0);
    for (var k = 0; k < 4; k++) {
        let step = vec2<i32>(k & 1, k >> 1u);
        let p = vec2<u32>(clamp(vec2<i32>(corner) + step, vec2<i32>(0), vec2<i32>(extent) - 1));
        let across = (extent.x + TEXTURE_TILE_PX - 1u) / TEXTURE_TILE_PX;
        let first = read_word(table + p.y / TEXTURE_TILE_PX * across + p.x / TEXTURE_TILE_PX);
        let row = p.y % TEXTURE_TILE_PX * min(extent.x, TEXTURE_TILE_PX);
        let rgb = unpack4x8unorm(read_word(first + row + p.x % TEXTURE_TILE_PX)).rgb;
        let weight = select(1.0 - part, part, step == vec2<i32>(1));
        sum += rgb * rgb * (weight.x * weight.y);
    }
    return sum;
}

// What the columns around a mesh's surface know of it.
struct SurfaceLight {
    sky: f32,
    is_reflective: bool,
}

// Share of the sky at `p`: a weighted mean of what the four columns just below the surface store. The nearest of them
// says whether it is reflective.
fn surface_light(index: u32, p: vec3<f32>, normal: vec3<f32>) -> SurfaceLight {
    let cell_m = nodes[index].corner_and_cell_m.w;
    let below = p - nodes[index].corner_and_cell_m.xyz - normal * (0.5 * cell_m);
    let at = below.xy / cell_m + halves(nodes[index].leaf_offset) / LEAF_OFFSET_STEPS - 0.5;
    let z = below.z / bitcast<f32>(nodes[index].heights.x);
    let corner = floor(at);
    let part = at - corner;
    var sum = 0.0;
    var weights = 0.0;
    for (var k = 0; k < 4; k++) {
        let step = vec2<i32>(k & 1, k >> 1u);
        let cell = clamp(vec2<i32>(corner) + step, vec2<i32>(0), vec2<i32>(NODE_CELLS - 1));
        let near = select(1.0 - part, part, step == vec2<i32>(1));
        let sky = column_sky(index, cell, z, normal.z);
        let weight = (near.x * near.y + 1e-4) * sky.y;
        sum += sky.x * weight;
        weights += weight;
    }
    let nearest = clamp(vec2<i32>(floor(at + 0.5)), vec2<i32>(0), vec2<i32>(NODE_CELLS - 1));
    let walk = read_word(planes_of(nodes[index].pages)[WALK_PLANE] + u32(nearest.y * NODE_CELLS + nearest.x));
    let sky = select(unknown_sky(index, normal.z), sum / weights, weights > 0.0);
    return SurfaceLight(sky, (flags_of(walk) & REFLECTIVE) != 0u);
}

// Share of the sky of a surface where no column is near.
fn unknown_sky(index: u32, upwards: f32) -> f32 {
    return select(UNKNOWN_AO, 0.5 + 0.5 * upwards, nodes[index].level == ADDED_LEVEL);
}

// Whether the place in front of a surface is within a column's solid: rays that see the surface from behind look at it
// from inside of a building.
fn is_inside(index: u32, p: vec3<f32>, normal: vec3<f32>) -> bool {
    let corner = nodes[index].corner_and_cell_m;
    let before = p - corner.xyz + normal * corner.w;
    let z = before.z / bitcast<f32>(nodes[index].heights.x);
    let walk = column_word(index, before);
    let flags = flags_of(walk);
    // A gap may be in front of the surface.
    if (flags & OCCUPIED) == 0u || (flags & GAP) != 0u {
        return false;
    }
    let bounds = bounds_of(walk, 0u);
    return z > bounds.y && z < bounds.x;
}

// Share of the sky that a column sees at height `z`, and the weight of that: 0 far above or below the column.
fn column_sky(index: u32, cell: vec2<i32>, z: f32, upwards: f32) -> vec2<f32> {
    let i = u32(cell.y * NODE_CELLS + cell.x);
    let planes = planes_of(nodes[index].pages);
    let walk = read_word(planes[WALK_PLANE] + i);
    let flags = flags_of(walk);
    let exposed = (flags & EXPOSED) != 0u;
    var texels = 0u;
    if exposed {
        texels = read_word(planes[STRIP_PLANE] + i) + head_words(flags);
    }
    let bounds = bounds_of(walk, texels);
    let z_max = bounds.x;
    let z_min = bounds.y;
    let codes = codes_per_row(z_shift_of(nodes[index].heights.w));
    if (flags & OCCUPIED) == 0u || z > z_max + 1.5 * codes || z < z_min - 1.5 * codes {
        return vec2<f32>(0.0);
    }
    let near_top = z > z_max - 1.5 * codes;
    if !exposed || (upwards > ROOF_NORMAL_Z && near_top) {
        if !near_top {
            return vec2<f32>(0.0);
        }
        // The occlusion of walls does not apply to roofs. That of a roof applies to walls with a small weight, and
        // halved, because walls see half of the sky.
        let known = select(vec2<f32>(0.5, ROOF_WEIGHT_ON_WALL), vec2<f32>(1.0), upwards > ROOF_NORMAL_Z);
        return vec2<f32>(ao_of(read_word(planes[ROOF_PLANE] + i)) / AO_MAX, 1.0) * known;
    }
    let first = floor(z_min / codes);
    let rows = floor((z_max - 1.0) / codes) - first;
    let row = clamp(z / codes - 0.5 - first, 0.0, rows);
    let low = floor(row);
    let a = read_word(texels + u32(low));
    let b = read_word(texels + u32(min(low + 1.0, rows)));
    let covered = vec2<f32>(vec2<bool>(!is_open(a), !is_open(b)));
    let weights = vec2<f32>(1.0 - (row - low), row - low) * covered;
    let weight = weights.x + weights.y;
    if weight <= 0.0 {
        return vec2<f32>(0.0);
    }
    return vec2<f32>((ao_of(a) * weights.x + ao_of(b) * weights.y) / (AO_MAX * weight), 1.0);
}
