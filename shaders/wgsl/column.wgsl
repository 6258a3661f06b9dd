// What a ray meets in a column: the GPU's twin of src/cpu/column.rs; one module with raycast.wgsl, which has the bindings.
//
// In: a cell that a ray crosses, from where to where. Out: `gathered`. Next: raycast.wgsl goes on, or is done.

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

// The twin's column up to its first return: whether the ray is between bottom and top somewhere in the cell.
fn may_hit(cell: vec2<i32>, ta: f32, te: f32) -> bool {
    let i = u32(cell.y * NODE_CELLS + cell.x);
    let walk = plane_word(0u, i);
    let z_max = f32(walk & 0xfffu);
    let z_min = f32((walk >> 12u) & 0xfffu);
    var slope = vec2<f32>(0.0);
    if ((walk >> 24u) & INCLINED) != 0u {
        let n = octahedral(plane_word(2u, i));
        slope = n.xy * (-f32(16u >> ray.z_shift) / max(n.z, 0.1));
    }
    let centre = vec2<f32>(cell) + 0.5;
    var highest = max(top_at(ta, z_max, slope, centre), top_at(te, z_max, slope, centre));
    if ((walk >> 24u) & (CLIPPED | GAP)) != 0u {
        highest = max(highest, z_max);
    }
    touched = Touched(walk, slope);
    let apart = min(z_at(ta), z_at(te)) > highest || max(z_at(ta), z_at(te)) < z_min;
    return ((walk >> 24u) & OCCUPIED) != 0u && !apart;
}

fn column(cell: vec2<i32>, ta: f32, te: f32) {
    let i = u32(cell.y * NODE_CELLS + cell.x);
    let walk = touched.walk;
    let flags = walk >> 24u;
    let z_max = f32(walk & 0xfffu);
    let z_min = f32((walk >> 12u) & 0xfffu);
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
    let border = border_of((flags & CLIPPED) != 0u, attributes, clip, centre, ta, te);
    let outer_top = f32(clip & 0xfffu);
    let has_gap = (flags & GAP) != 0u;
    var gap = 0u;
    if has_gap {
        gap = word(strip + head_words(flags) - 1u);
    }
    let low = f32(gap & 0xffffu);
    let high = f32(gap >> 16u);
    var n = 0u;
    loop {
        // On to a solid that is there: what follows is costly even for devices that then throw it away.
        var part = 0u;
        var solid = SOLID_UPPER;
        var outer = false;
        var s = te;
        var e = ta;
        loop {
            if n >= 6u || s < e {
                break;
            }
            part = n >> 1u;
            let second = (n & 1u) == 1u;
            let lower = second != (ray.d.z > 0.0);
            outer = (part == 1u) == border.within_is_outer;
            solid = select(select(SOLID_UPPER, SOLID_LOWER, lower), SOLID_OUTER, outer);
            let missing = (outer && (second || outer_top == 0.0)) || (solid == SOLID_LOWER && !has_gap);
            s = select(select(border.end, border.begin, part == 1u), ta, part == 0u);
            e = select(select(te, border.end, part == 1u), border.begin, part == 0u);
            e = select(e, s, missing);
            n++;
        }
        if s >= e {
            break;
        }
        let bottom = select(z_min, high, solid == SOLID_UPPER && has_gap);
        var over = vec2<f32>(z_at(s) - top_at(s, z_max, touched.slope, centre), z_at(e) - top_at(e, z_max, touched.slope, centre));
        var top = z_max;
        if solid != SOLID_UPPER {
            top = select(low, outer_top, outer);
            over = vec2<f32>(z_at(s) - top, z_at(e) - top);
        }
        let span = clip_solid(s, e, over, vec2<f32>(z_at(s) - bottom, z_at(e) - bottom));
        hit_solid(cell, i, walk, strip, solid, border.walls[part], span, bottom, top);
        if gathered.left <= OPAQUE {
            break;
        }
    }
}

fn head_words(flags: u32) -> u32 {
    return select(0u, 2u, (flags & CLIPPED) != 0u) + select(0u, 1u, (flags & GAP) != 0u);
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

fn hit_solid(
    cell: vec2<i32>,
    i: u32,
    walk: u32,
    strip_at: u32,
    solid: u32,
    wall: u32,
    span: Span,
    bottom: f32,
    top: f32,
) {
    let inside = span.s <= 0.0 && span.face == FACE_SIDE;
    if span.s >= span.e || inside || gathered.left <= OPAQUE {
        return;
    }
    let flags = walk >> 24u;
    let roof_normal = octahedral(plane_word(2u, i));
    var texel = 0u;
    var normal = vec3<f32>(0.0, 0.0, select(1.0, -1.0, span.face == FACE_BOTTOM));
    var rows = false;
    if solid == SOLID_OUTER {
        texel = word(strip_at + 1u) | (3u << 24u);
        if span.face == FACE_SIDE {
            normal = face_normal(cell);
        }
    } else if solid == SOLID_UPPER && span.face == FACE_TOP {
        texel = plane_word(1u, i) | (3u << 24u);
        normal = roof_normal;
    } else if (flags & EXPOSED) != 0u {
        rows = true;
    } else if span.face == FACE_SIDE && beside(cell, span.s) {
        texel = wall_beside.texel;
        normal = wall_beside.normal;
    } else {
        texel = plane_word(1u, i) | (3u << 24u);
        if span.face != FACE_BOTTOM {
            normal = roof_normal;
        }
        if dot(normal, leg.dir) >= 0.0 {
            normal = face_normal(cell);
        }
    }
    let strip = strip_at + head_words(flags);
    let codes = f32(16u >> ray.z_shift);
    let first = i32(floor(f32((walk >> 12u) & 0xfffu) / codes));
    let row_low = i32(floor(bottom / codes));
    let row_high = i32(floor((top - 1.0) / codes));
    var row = clamp(i32(floor((ray.o.z + ray.d.z * span.s) / codes)), row_low, row_high);
    let up = ray.d.z > 0.0;
    var s = span.s;
    if rows && span.face == FACE_SIDE {
        normal = wall_normal(cell, wall);
    }
    for (var n = 0; n < 256; n++) {
        if rows {
            texel = word(u32(i32(strip) + row - first));
        }
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

fn beside(cell: vec2<i32>, t: f32) -> bool {
    let before = cell + vec2<i32>(face_normal(cell).xy);
    if any(before < vec2<i32>(0)) || any(before >= vec2<i32>(NODE_CELLS)) {
        return false;
    }
    let i = u32(before.y * NODE_CELLS + before.x);
    let walk = plane_word(0u, i);
    let flags = walk >> 24u;
    let z = z_at(t);
    let z_min = f32((walk >> 12u) & 0xfffu);
    if (flags & EXPOSED) == 0u || z < z_min || z >= f32(walk & 0xfffu) {
        return false;
    }
    let codes = f32(16u >> ray.z_shift);
    let row = u32(floor(z / codes) - floor(z_min / codes));
    let texel = word(plane_word(3u, i) + head_words(flags) + row);
    wall_beside = WallBeside(texel | (3u << 24u), wall_normal(cell, (plane_word(2u, i) >> 16u) & 255u));
    return ((texel >> 24u) & 3u) != 0u;
}

fn azimuth(turn: u32) -> vec2<f32> {
    let angle = f32(turn) * (6.2831855 / 256.0);
    return vec2<f32>(cos(angle), sin(angle));
}

fn wall_normal(cell: vec2<i32>, wall: u32) -> vec3<f32> {
    let normal = vec3<f32>(azimuth(wall), 0.0);
    if dot(normal, leg.dir) < 0.0 {
        return normal;
    }
    return face_normal(cell);
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
        gathered.level = nodes[ray.index].level;
        if gathered.left <= 0.5 {
            gathered.distance = t;
            gathered.node = ray.index;
            gathered.sun_from = leg.dir * t + normal * (nodes[ray.index].cell_m * SUN_LIFT_CELLS);
        }
    }
}
