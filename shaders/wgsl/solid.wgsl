// Surfaces of a solid that a ray hits: roof, wall strip, and surfaces behind the strip's holes. CPU twin:
// src/cpu/solid.rs.

// The wall of a neighbouring column: its texel and its azimuth.
struct AdjacentWall {
    texel_at: u32,
    wall: u32,
}

// Hits the first opaque texel of the solid that `meets` found, if there is one.
fn hit_solid(cell: vec2<i32>) {
    let i = u32(cell.y * NODE_CELLS + cell.x);
    let object = object_of_solid(i);
    if is_hidden(object) {
        return;
    }
    let span = found.span;
    let solid = found.solid;
    let flags = flags_of(column.walk);
    let side = span.face == SIDE_FACE;
    let thin = is_thin(flags, found.attributes) && solid == UPPER_SOLID;
    if thin && !hits_share(thin_share(found.attributes, side), threshold, i) {
        return;
    }
    let face = face_normal(cell);
    let outer = solid == OUTER_SOLID;
    let roof = solid == UPPER_SOLID && span.face == TOP_FACE;
    let has_rows = !outer && !roof && (flags & EXPOSED) != 0u;
    // The address is found first, so that one read serves every kind of texel.
    var texel_at = select(node_ray.planes[ROOF_PLANE] + i, found.strip + 1u, outer);
    var wall = select(NO_WALL, found.wall, has_rows && side);
    if !outer && !has_rows && side {
        let adjacent = adjacent_wall(cell + vec2<i32>(face.xy), span.s);
        texel_at = select(texel_at, adjacent.texel_at, adjacent.wall != NO_WALL);
        wall = adjacent.wall;
    }
    var normal = vec3<f32>(0.0, 0.0, select(1.0, -1.0, span.face == BOTTOM_FACE));
    var below_top = 0.0;
    if wall != NO_WALL {
        normal = wall_normal(face, wall);
    } else if outer {
        normal = select(normal, face, side);
    } else if !has_rows {
        normal = select(normal, octahedral(found.attributes), span.face != BOTTOM_FACE && !thin);
        if !roof && dot(normal, segment.dir) >= 0.0 {
            normal = face;
        } else if !roof && side {
            // It shows its top, and has the light of that: between blocks, where one is a little higher, the sun would not reach it.
            below_top = max(found.top - z_at(span.s), 0.0);
        }
    }
    let codes = codes_per_row(node_ray.z_shift);
    let first = i32(found.strip + head_words(flags)) - i32(floor(found.z_min / codes));
    let row_low = i32(floor(found.bottom / codes));
    let row_high = i32(floor((found.top - 1.0) / codes));
    var row = clamp(i32(floor(z_at(span.s) / codes)), row_low, row_high);
    let up = node_ray.d.z > 0.0;
    var s = span.s;
    for (var n = 0; n < MAX_STRIP_ROWS; n++) {
        let texel = read_word(select(texel_at, u32(first + row), has_rows));
        if !has_rows || !is_open(texel) {
            hit_texel(s, texel, normal, below_top, flags, object);
            return;
        }
        s = (f32(row + select(0, 1, up)) * codes - node_ray.o.z) / node_ray.d.z;
        normal = vec3<f32>(0.0, 0.0, select(1.0, -1.0, up));
        row += select(-1, 1, up);
        if s > span.e || row < row_low || row > row_high {
            return;
        }
    }
}

// The wall of column `before`, if it has one at `t`. Between the planes of two clipped columns of one wall, a ray may
// reach the column behind them: it shows the wall that the ray slipped through.
fn adjacent_wall(before: vec2<i32>, t: f32) -> AdjacentWall {
    let none = AdjacentWall(0u, NO_WALL);
    if any(before < vec2<i32>(0)) || any(before >= vec2<i32>(NODE_CELLS)) {
        return none;
    }
    let i = u32(before.y * NODE_CELLS + before.x);
    let walk = read_plane(WALK_PLANE, i);
    let flags = flags_of(walk);
    if (flags & EXPOSED) == 0u {
        return none;
    }
    let strip = read_plane(STRIP_PLANE, i) + head_words(flags);
    let bounds = bounds_of(walk, strip);
    let z = z_at(t);
    let z_min = bounds.y;
    if z < z_min || z >= bounds.x {
        return none;
    }
    let codes = codes_per_row(node_ray.z_shift);
    let texel_at = strip + u32(floor(z / codes) - floor(z_min / codes));
    if is_open(read_word(texel_at)) {
        return none;
    }
    let attributes = read_plane(ATTRIBUTE_PLANE, i);
    if is_thin(flags, attributes) {
        return none;
    }
    return AdjacentWall(texel_at, azimuth_of(attributes));
}

// Normal of a wall that the ray enters from outside, else of the cell's face.
fn wall_normal(face: vec3<f32>, wall: u32) -> vec3<f32> {
    let normal = vec3<f32>(azimuth_direction(wall), 0.0);
    return select(face, normal, dot(normal, segment.dir) < 0.0);
}

// Normal of the cell's face through which the ray enters.
fn face_normal(cell: vec2<i32>) -> vec3<f32> {
    let ahead = ahead_of(node_ray.d.xy);
    let near = (vec2<f32>(cell) + 1.0 - ahead - node_ray.o.xy) * node_ray.inv;
    if near.x >= near.y {
        return vec3<f32>(1.0 - 2.0 * ahead.x, 0.0, 0.0);
    }
    return vec3<f32>(0.0, 1.0 - 2.0 * ahead.y, 0.0);
}

// Ends the segment at a texel with a normal, so many codes below the place whose sun it has. It is lit only once, when the ray has ended.
fn hit_texel(t: f32, texel: u32, normal: vec3<f32>, below: f32, flags: u32, object: u32) {
    ray_hit.is_hit = true;
    if segment.to_sun {
        return;
    }
    ray_hit.albedo = object_colour(object, linear_of(texel));
    ray_hit.object = object;
    ray_hit.stone = 0u;
    ray_hit.ao = ao_of(texel) / AO_MAX;
    ray_hit.normal = normal;
    ray_hit.flags = flags;
    if FOR_STUDY {
        ray_hit.level = nodes[node_ray.index].level;
    }
    ray_hit.distance_m = t;
    ray_hit.node = node_ray.index;
    let lift = vec3<f32>(0.0, 0.0, below * segment.dir.z / node_ray.d.z);
    ray_hit.shadow_origin = segment.dir * t + normal * (node_ray.cell_m * SUN_LIFT_CELLS) + lift;
}
