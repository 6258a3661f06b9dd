// What a ray meets in a column: the GPU's twin of src/cpu/column.rs; one module with raycast.wgsl, which has the bindings.
//
// In: a cell that a ray crosses, from where to where. Out: `gathered`. Next: raycast.wgsl goes on, or is done.

// What `beside` found.
struct WallBeside {
    place: u32,
    turn: u32,
}

struct Border {
    begin: f32,
    end: f32,
    within_is_outer: bool,
    walls: vec3<u32>,
}

struct Span {
    s: f32,
    e: f32,
    face: u32,
}

fn word(at: u32) -> u32 {
    if COUNT {
        counts.z++;
    }
    return atlas[at];
}

fn plane_word(plane: u32, i: u32) -> u32 {
    return word(ray.pages[plane] + i);
}

fn octahedral(code: u32) -> vec3<f32> {
    let c = vec2<f32>(f32(min(code & 255u, 254u)), f32(min((code >> 8u) & 255u, 254u)));
    var p = (c - 127.0) / 127.0;
    let z = 1.0 - abs(p.x) - abs(p.y);
    if z < 0.0 {
        let s = select(vec2<f32>(1.0), vec2<f32>(-1.0), p < vec2<f32>(0.0));
        p = (1.0 - abs(p.yx)) * s;
    }
    return normalize(vec3<f32>(p, z));
}

fn z_at(t: f32) -> f32 {
    return ray.o.z + ray.d.z * t;
}

fn top_at(t: f32, z_max: f32, slope: vec2<f32>, centre: vec2<f32>) -> f32 {
    return z_max + dot(slope, ray.o.xy + ray.d.xy * t - centre);
}

// Whether the ray may be in a solid somewhere in the cell, by one word alone.
fn may_hit(cell: vec2<i32>, ta: f32, te: f32, quad_top: f32) -> bool {
    let walk = plane_word(0u, u32(cell.y * NODE_CELLS + cell.x));
    let flags = walk >> 24u;
    touched = Touched(walk, vec2<f32>(0.0));
    let high = f32(walk & 0xfffu);
    let low = f32((walk >> 12u) & 0xfffu);
    let rises = ray.d.z > 0.0;
    let lower = z_at(select(te, ta, rises));
    let upper = z_at(select(ta, te, rises));
    let meets_one = lower <= select(high, quad_top, (flags & INCLINED) != 0u) && upper >= low;
    let leaves_gap = lower <= low || upper >= high;
    return (flags & OCCUPIED) != 0u && select(meets_one, leaves_gap, (flags & GAP) != 0u);
}

// The next solid of the column that the ray meets, from `next_solid` on; false if there is none.
fn meets(cell: vec2<i32>, ta: f32, te: f32) -> bool {
    let i = u32(cell.y * NODE_CELLS + cell.x);
    let walk = touched.walk;
    let flags = walk >> 24u;
    let centre = vec2<f32>(cell) + 0.5;
    let attributes = plane_word(2u, i);
    var strip = 0u;
    if (flags & EXPOSED) != 0u {
        strip = plane_word(3u, i);
    }
    var clip = 0u;
    if (flags & CLIPPED) != 0u {
        clip = word(strip);
    }
    if (flags & INCLINED) != 0u {
        let n = octahedral(attributes);
        touched.slope = n.xy * (-f32(16u >> ray.z_shift) / max(n.z, 0.1));
    }
    let border = border_of((flags & CLIPPED) != 0u, attributes, clip, centre, ta, te);
    let outer_top = f32(clip & 0xfffu);
    let has_gap = (flags & GAP) != 0u;
    var gap = 0u;
    if has_gap {
        gap = word(strip + head_words(flags) - 2u);
    }
    let bounds = bounds_of(walk, strip + head_words(flags));
    let z_max = bounds.x;
    let z_min = bounds.y;
    let low = f32(gap & 0xffffu);
    let high = f32(gap >> 16u);
    let last = select(6u, 4u, border.end >= te);
    var n = max(next_solid, select(2u, 0u, border.begin > ta));
    var found = false;
    loop {
        if found || n >= last {
            break;
        }
        let part = n >> 1u;
        let second = (n & 1u) == 1u;
        let lower = second != (ray.d.z > 0.0);
        let outer = (part == 1u) == border.within_is_outer;
        let solid = select(select(SOLID_UPPER, SOLID_LOWER, lower), SOLID_OUTER, outer);
        let missing = (outer && (second || outer_top == 0.0)) || (solid == SOLID_LOWER && !has_gap);
        let s = select(select(border.end, border.begin, part == 1u), ta, part == 0u);
        let e = select(select(te, border.end, part == 1u), border.begin, part == 0u);
        let bottom = select(z_min, high, solid == SOLID_UPPER && has_gap);
        let flat_top = select(low, outer_top, outer);
        let top = select(flat_top, z_max, solid == SOLID_UPPER);
        let slope = select(vec2<f32>(0.0), touched.slope, solid == SOLID_UPPER);
        let zs = z_at(s);
        let ze = z_at(e);
        let over = vec2<f32>(zs - top_at(s, top, slope, centre), ze - top_at(e, top, slope, centre));
        let span = clip_solid(s, e, over, vec2<f32>(zs - bottom, ze - bottom));
        let inside = span.s <= 0.0 && span.face == FACE_SIDE;
        found = !missing && s < e && span.s < span.e && !inside;
        met = Met(span, attributes, strip, solid, border.walls[part], bottom, top, z_min);
        n++;
    }
    next_solid = n;
    return found;
}

// Highest and lowest point of a column whose strip's texels begin at `texels`.
fn bounds_of(walk: u32, texels: u32) -> vec2<f32> {
    var bounds = walk;
    if ((walk >> 24u) & GAP) != 0u {
        bounds = word(texels - 1u);
    }
    return vec2<f32>(f32(bounds & 0xfffu), f32((bounds >> 12u) & 0xfffu));
}

fn head_words(flags: u32) -> u32 {
    return select(0u, 2u, (flags & CLIPPED) != 0u) + select(0u, 2u, (flags & GAP) != 0u);
}

fn border_of(clipped: bool, attributes: u32, clip: u32, centre: vec2<f32>, ta: f32, te: f32) -> Border {
    let first = (attributes >> 16u) & 255u;
    let concave = (clip & CONCAVE) != 0u;
    let side = select(1.0, -1.0, concave);
    var border = Border(ta, te, concave, vec3<u32>(first));
    let planes = select(0u, select(1u, 2u, (clip & CORNER) != 0u), clipped);
    for (var k = 0u; k < planes; k++) {
        let word = select(attributes, clip, k == 1u);
        let turn = (word >> 16u) & 255u;
        let offset = f32(bitcast<i32>(word) >> 24u) / CLIP_STEPS_PER_CELL;
        let n = azimuth(turn);
        let a = side * (dot(n, ray.o.xy + ray.d.xy * ta - centre) - offset);
        let b = side * (dot(n, ray.o.xy + ray.d.xy * te - centre) - offset);
        let through = ta + (te - ta) * (a / (a - b));
        if a > 0.0 && b > 0.0 {
            border.begin = te;
        } else if a > 0.0 && through > border.begin {
            border.begin = through;
            border.walls.y = turn;
        } else if b > 0.0 && a <= 0.0 && through < border.end {
            border.end = through;
            border.walls.z = turn;
        }
    }
    if border.begin >= border.end {
        border.begin = te;
        border.end = te;
    }
    return border;
}

fn clip_solid(ta: f32, te: f32, over: vec2<f32>, above: vec2<f32>) -> Span {
    let none = Span(1.0, 0.0, FACE_SIDE);
    var span = Span(ta, te, FACE_SIDE);
    if over.x > 0.0 {
        if over.y > 0.0 {
            return none;
        }
        span.s = ta + (te - ta) * (over.x / (over.x - over.y));
        span.face = FACE_TOP;
    } else if over.y > 0.0 {
        span.e = ta + (te - ta) * (over.x / (over.x - over.y));
    }
    if above.x < 0.0 {
        if above.y < 0.0 {
            return none;
        }
        let s = ta + (te - ta) * (above.x / (above.x - above.y));
        if s > span.s {
            span.s = s;
            span.face = FACE_BOTTOM;
        }
    } else if above.y < 0.0 {
        span.e = min(span.e, ta + (te - ta) * (above.x / (above.x - above.y)));
    }
    return span;
}

// Gathers what the ray sees of the solid that `meets` found.
fn hit_solid(cell: vec2<i32>) {
    let i = u32(cell.y * NODE_CELLS + cell.x);
    let walk = touched.walk;
    let span = met.span;
    let strip_at = met.strip;
    let solid = met.solid;
    let bottom = met.bottom;
    let top = met.top;
    let flags = walk >> 24u;
    let side = span.face == FACE_SIDE;
    let face = face_normal(cell);
    let outer = solid == SOLID_OUTER;
    let roof = solid == SOLID_UPPER && span.face == FACE_TOP;
    let rows = !outer && !roof && (flags & EXPOSED) != 0u;
    var place = select(ray.pages.y + i, strip_at + 1u, outer);
    var wall = select(NO_WALL, met.wall, rows && side);
    if !outer && !rows && side {
        let found = beside(cell + vec2<i32>(face.xy), span.s);
        place = select(place, found.place, found.turn != NO_WALL);
        wall = found.turn;
    }
    var normal = vec3<f32>(0.0, 0.0, select(1.0, -1.0, span.face == FACE_BOTTOM));
    if wall != NO_WALL {
        normal = wall_normal(face, wall);
    } else if outer {
        normal = select(normal, face, side);
    } else if !rows {
        normal = select(normal, octahedral(met.attributes), span.face != FACE_BOTTOM);
        if !roof && dot(normal, leg.dir) >= 0.0 {
            normal = face;
        }
    }
    let codes = f32(16u >> ray.z_shift);
    let first = i32(strip_at + head_words(flags)) - i32(floor(met.z_min / codes));
    let row_low = i32(floor(bottom / codes));
    let row_high = i32(floor((top - 1.0) / codes));
    var row = clamp(i32(floor(z_at(span.s) / codes)), row_low, row_high);
    let up = ray.d.z > 0.0;
    var s = span.s;
    for (var n = 0; n < 256; n++) {
        let texel = word(select(place, u32(first + row), rows)) | select(3u << 24u, 0u, rows);
        gather(s, texel, normal, flags);
        if !rows || gathered.left <= OPAQUE || (flags & HOLES) == 0u {
            return;
        }
        s = (f32(row + select(0, 1, up)) * codes - ray.o.z) / ray.d.z;
        normal = vec3<f32>(0.0, 0.0, select(1.0, -1.0, up));
        row += select(-1, 1, up);
        if s > span.e || row < row_low || row > row_high {
            return;
        }
    }
}

// The wall of the column `before` at `t`, if it has one there.
fn beside(before: vec2<i32>, t: f32) -> WallBeside {
    let none = WallBeside(0u, NO_WALL);
    if any(before < vec2<i32>(0)) || any(before >= vec2<i32>(NODE_CELLS)) {
        return none;
    }
    let i = u32(before.y * NODE_CELLS + before.x);
    let walk = plane_word(0u, i);
    let flags = walk >> 24u;
    if (flags & EXPOSED) == 0u {
        return none;
    }
    let strip = plane_word(3u, i) + head_words(flags);
    let bounds = bounds_of(walk, strip);
    let z = z_at(t);
    let z_min = bounds.y;
    if z < z_min || z >= bounds.x {
        return none;
    }
    let codes = f32(16u >> ray.z_shift);
    let place = strip + u32(floor(z / codes) - floor(z_min / codes));
    if ((word(place) >> 24u) & 3u) == 0u {
        return none;
    }
    return WallBeside(place, (plane_word(2u, i) >> 16u) & 255u);
}

fn azimuth(turn: u32) -> vec2<f32> {
    let angle = f32(turn) * (6.2831855 / 256.0);
    return vec2<f32>(cos(angle), sin(angle));
}

fn wall_normal(face: vec3<f32>, wall: u32) -> vec3<f32> {
    let normal = vec3<f32>(azimuth(wall), 0.0);
    return select(face, normal, dot(normal, leg.dir) < 0.0);
}

fn face_normal(cell: vec2<i32>) -> vec3<f32> {
    let ahead = ahead_of(ray.d.xy);
    let near = (vec2<f32>(cell) + 1.0 - ahead - ray.o.xy) * ray.inv;
    if near.x >= near.y {
        return vec3<f32>(1.0 - 2.0 * ahead.x, 0.0, 0.0);
    }
    return vec3<f32>(0.0, 1.0 - 2.0 * ahead.y, 0.0);
}

fn gather(t: f32, texel: u32, normal: vec3<f32>, flags: u32) {
    let alpha = f32((texel >> 24u) & 3u) / 3.0;
    let before = gathered.left;
    let share = before * alpha;
    gathered.left *= 1.0 - alpha;
    if leg.to_sun {
        return;
    }
    gathered.albedo += linear_of(texel) * share;
    gathered.ao += f32(texel >> 26u) / 63.0 * share;
    gathered.normal += normal * share;
    gathered.mean_m += t * share;
    if share > 0.0 && before > 0.5 {
        gathered.flags = flags;
        if FOR_STUDY {
            gathered.level = nodes[ray.index].level;
        }
        if gathered.left <= 0.5 {
            gathered.distance = t;
            gathered.node = ray.index;
            gathered.sun_from = leg.dir * t + normal * (ray.cell_m * SUN_LIFT_CELLS);
        }
    }
}
