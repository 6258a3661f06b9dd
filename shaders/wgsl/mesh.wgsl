// What a ray meets in a leaf that is drawn as a mesh: the GPU's twin of src/cpu/mesh.rs; one module with raycast.wgsl, which
// has the bindings.
//
// In: a leaf that a ray crosses. Out: `gathered`. Next: raycast.wgsl goes on, or is done.

const EDGE_SLACK: f32 = 2e-5;
const BOX_SLACK: f32 = 0.5;
const TIE_M: f32 = 1e-4;
const MESH_LIFT_M: f32 = 0.02;
const MESH_LIFT_SHARE: f32 = 1e-4;
const FLATTEST: f32 = 0.15;
const ROOF_OF_WALL: f32 = 0.02;
const UNKNOWN_AO: f32 = 0.7;
// src/mesh/mod.rs
const COUNT_SHIFT: u32 = 30u;
const PLACE: u32 = 0x3fffffffu;
const STACK: u32 = 32u;
const TILE_PX: u32 = 64u;
const PLACES: f32 = 1024.0;

struct MeshRay {
    o: vec3<f32>,
    d: vec3<f32>,
    inv: vec3<f32>,
    enter_m: f32,
}

struct MeshHit {
    t: f32,
    four: u32,
    u: f32,
    v: f32,
}

// A half that is still to be looked at, and where it begins.
struct Later {
    at: u32,
    t: f32,
}

var<private> mesh_ray: MeshRay;
var<private> mesh_hit: MeshHit;

fn four(at: u32) -> vec4<u32> {
    if COUNT {
        counts.z++;
    }
    return fours[at];
}

fn low_halves(words: vec3<u32>) -> vec3<f32> {
    return vec3<f32>(words & vec3<u32>(0xffffu));
}

fn high_halves(words: vec3<u32>) -> vec3<f32> {
    return vec3<f32>(words >> vec3<u32>(16u));
}

fn halves(word: u32) -> vec2<f32> {
    return vec2<f32>(f32(word & 0xffffu), f32(word >> 16u));
}

fn walk_mesh(index: u32) {
    if COUNT {
        counts.x++;
    }
    let head = nodes[index].mesh - 1u;
    let place = bitcast<vec4<f32>>(four(head));
    let about = four(head + 1u);
    let whole = four(head + 2u);
    let step_m = place.w;
    let zero = vec3<f32>(nodes[index].place.xy, nodes[index].mesh_z_m) + place.xyz;
    let o = (leg.origin - zero) / step_m;
    var d = leg.dir / step_m;
    d = select(d, vec3<f32>(1e-12), abs(d) < vec3<f32>(1e-12));
    mesh_ray = MeshRay(o, d, 1.0 / d, 0.0);
    let span = box_span(whole);
    if span.x > span.y || span.x > leg.reach_m {
        return;
    }
    mesh_ray.o += d * span.x;
    mesh_ray.enter_m = span.x;
    mesh_hit = MeshHit(min(leg.reach_m, span.y + 1.0) - span.x, 0u, 0.0, 0.0);
    nearest(about.x);
    if mesh_hit.four == 0u {
        return;
    }
    if leg.to_sun {
        gathered.left = 0.0;
        return;
    }
    show(index, step_m, about);
}

fn box_span(words: vec4<u32>) -> vec2<f32> {
    let low = (low_halves(words.xyz) - BOX_SLACK - mesh_ray.o) * mesh_ray.inv;
    let high = (high_halves(words.xyz) + BOX_SLACK - mesh_ray.o) * mesh_ray.inv;
    let begin = min(low, high);
    let end = max(low, high);
    return vec2<f32>(max(max(max(begin.x, begin.y), begin.z), 0.0), min(min(end.x, end.y), end.z));
}

fn nearest(root: u32) {
    var stack: array<Later, STACK>;
    var height = 0u;
    var at = root;
    loop {
        let count = at >> COUNT_SHIFT;
        let place = at & PLACE;
        if count > 0u {
            for (var k = 0u; k < count; k++) {
                triangle(place + 2u * k);
            }
            if leg.to_sun && mesh_hit.four != 0u {
                return;
            }
        } else {
            let a = four(place);
            let b = four(place + 1u);
            let span_a = box_span(a);
            let span_b = box_span(b);
            let meets_a = span_a.x <= span_a.y && span_a.x <= mesh_hit.t;
            let meets_b = span_b.x <= span_b.y && span_b.x <= mesh_hit.t;
            let a_first = meets_a && (!meets_b || span_a.x <= span_b.x);
            if meets_a && meets_b && height < STACK {
                stack[height].at = select(a.w, b.w, a_first);
                stack[height].t = select(span_a.x, span_b.x, a_first);
                height++;
            }
            if meets_a || meets_b {
                at = select(b.w, a.w, a_first);
                continue;
            }
        }
        loop {
            if height == 0u {
                return;
            }
            height--;
            if stack[height].t <= mesh_hit.t {
                break;
            }
        }
        at = stack[height].at;
    }
}

struct Corners {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
}

fn corners_of(words: vec4<u32>, last: u32) -> Corners {
    let low = vec4<f32>(words & vec4<u32>(0xffffu));
    let high = vec4<f32>(words >> vec4<u32>(16u));
    return Corners(vec3<f32>(low.x, high.x, low.y), vec3<f32>(high.y, low.z, high.z), vec3<f32>(low.w, high.w, f32(last & 0xffffu)));
}

fn triangle(at: u32) {
    if COUNT {
        counts.w++;
    }
    let corners = corners_of(four(at), four(at + 1u).x);
    let e1 = corners.b - corners.a;
    let e2 = corners.c - corners.a;
    let start = mesh_ray.o - corners.a;
    let p = cross(mesh_ray.d, e2);
    let scale = 1.0 / dot(e1, p);
    let u = dot(start, p) * scale;
    let q = cross(start, e1);
    let v = dot(mesh_ray.d, q) * scale;
    let t = dot(e2, q) * scale;
    let inside = u >= -EDGE_SLACK && v >= -EDGE_SLACK && u + v <= 1.0 + EDGE_SLACK;
    let nearer = t < mesh_hit.t - TIE_M || (t < mesh_hit.t + TIE_M && at < mesh_hit.four);
    if inside && t >= 0.0 && nearer {
        mesh_hit = MeshHit(t, at, u, v);
    }
}

fn show(index: u32, step_m: f32, about: vec4<u32>) {
    let looks = four(mesh_hit.four + 1u);
    let corners = corners_of(four(mesh_hit.four), looks.x);
    let across = cross(corners.b - corners.a, corners.c - corners.a);
    let facing = select(-across, across, dot(across, leg.dir) < 0.0);
    let area = length(across);
    let normal = select(-leg.dir, facing / area, area > 0.0);
    let t = mesh_ray.enter_m + mesh_hit.t;
    let p = leg.origin + leg.dir * t;
    let u = clamp(mesh_hit.u, 0.0, 1.0);
    let v = clamp(mesh_hit.v, 0.0, 1.0);
    var albedo = vec3<f32>(0.0);
    if about.y == 0u {
        let a = linear_of(looks.y);
        albedo = a + (linear_of(looks.z) - a) * u + (linear_of(looks.w) - a) * v;
    } else {
        let size = halves(about.y);
        let a = halves(looks.y) / 65535.0 * size;
        let e1 = halves(looks.z) / 65535.0 * size - a;
        let e2 = halves(looks.w) / 65535.0 * size - a;
        let texels_per_m = sqrt(abs(e1.x * e2.y - e1.y * e2.x) / max(area * step_m * step_m, 1e-12));
        let pixel = 2.0 * length(frame.up) / f32(frame.height_px * max(frame.samples, 1u));
        let flat = sqrt(max(abs(dot(normal, leg.dir)), FLATTEST));
        let level = log2(max(t * pixel * texels_per_m / flat, 1.0));
        albedo = texture(about, (a + e1 * u + e2 * v) / size, level);
    }
    let ao = open_sky(index, p, normal);
    let share = gathered.left;
    gathered.albedo += albedo * share;
    gathered.ao += ao * share;
    gathered.normal += normal * share;
    gathered.mean_m += t * share;
    gathered.left = 0.0;
    if share > 0.5 {
        gathered.flags = MESH_FLAG;
        gathered.level = nodes[index].level;
        gathered.distance = t;
        gathered.node = index;
        gathered.sun_from = p + normal * (MESH_LIFT_M + MESH_LIFT_SHARE * t);
    }
}

fn texture(about: vec4<u32>, uv: vec2<f32>, wanted: f32) -> vec3<f32> {
    let levels = max(about.z, 1u);
    let level = min(wanted, f32(levels - 1u));
    let fine = u32(level);
    var table = about.w;
    for (var k = 0u; k < fine; k++) {
        table += squares(about.y, k);
    }
    let squared = bilinear(about.y, table, fine, uv);
    let coarse = min(fine + 1u, levels - 1u);
    let coarser = bilinear(about.y, select(table, table + squares(about.y, fine), coarse > fine), coarse, uv);
    return decode(sqrt(max(mix(squared, coarser, level - f32(fine)), vec3<f32>(0.0))));
}

fn level_size(size: u32, level: u32) -> vec2<u32> {
    return max(vec2<u32>((size & 0xffffu) >> level, (size >> 16u) >> level), vec2<u32>(1u));
}

fn squares(size: u32, level: u32) -> u32 {
    let along = (level_size(size, level) + TILE_PX - 1u) / TILE_PX;
    return along.x * along.y;
}

fn bilinear(size: u32, table: u32, level: u32, uv: vec2<f32>) -> vec3<f32> {
    let extent = level_size(size, level);
    let at = uv * vec2<f32>(extent) - 0.5;
    let corner = floor(at);
    let part = at - corner;
    var sum = vec3<f32>(0.0);
    for (var k = 0; k < 4; k++) {
        let step = vec2<i32>(k & 1, k >> 1u);
        let p = vec2<u32>(clamp(vec2<i32>(corner) + step, vec2<i32>(0), vec2<i32>(extent) - 1));
        let square = table + p.y / TILE_PX * ((extent.x + TILE_PX - 1u) / TILE_PX) + p.x / TILE_PX;
        let texel = word(word(square) + p.y % TILE_PX * min(extent.x, TILE_PX) + p.x % TILE_PX);
        let rgb = unpack4x8unorm(texel).rgb;
        let weight = select(1.0 - part, part, step == vec2<i32>(1));
        sum += rgb * rgb * (weight.x * weight.y);
    }
    return sum;
}

fn decode(srgb: vec3<f32>) -> vec3<f32> {
    return select(pow((srgb + 0.055) / 1.055, vec3<f32>(2.4)), srgb / 12.92, srgb <= vec3<f32>(0.04045));
}

fn open_sky(index: u32, p: vec3<f32>, normal: vec3<f32>) -> f32 {
    let cell_m = nodes[index].place.w;
    let below = p - nodes[index].place.xyz - normal * (0.5 * cell_m);
    let at = below.xy / cell_m + halves(nodes[index].leaf_offset) / PLACES - 0.5;
    let z = below.z / bitcast<f32>(nodes[index].z.x);
    let corner = floor(at);
    let part = at - corner;
    var sum = 0.0;
    var weights = 0.0;
    for (var k = 0; k < 4; k++) {
        let step = vec2<i32>(k & 1, k >> 1u);
        let cell = clamp(vec2<i32>(corner) + step, vec2<i32>(0), vec2<i32>(NODE_CELLS - 1));
        let near = select(1.0 - part, part, step == vec2<i32>(1));
        let told = column_sky(index, cell, z, normal.z);
        let weight = (near.x * near.y + 1e-4) * told.y;
        sum += told.x * weight;
        weights += weight;
    }
    return select(UNKNOWN_AO, sum / weights, weights > 0.0);
}

fn column_sky(index: u32, cell: vec2<i32>, z: f32, upwards: f32) -> vec2<f32> {
    let i = u32(cell.y * NODE_CELLS + cell.x);
    let pages = pages_of(nodes[index].pages);
    let walk = word(pages.x + i);
    let flags = walk >> 24u;
    let exposed = (flags & EXPOSED) != 0u;
    var strip = 0u;
    if exposed {
        strip = word(pages.w + i) + head_words(flags);
    }
    let bounds = bounds_of(walk, strip);
    let z_max = bounds.x;
    let z_min = bounds.y;
    let codes = f32(16u >> shift_of(nodes[index].z.w));
    if (flags & OCCUPIED) == 0u || z > z_max + 1.5 * codes || z < z_min - 1.5 * codes {
        return vec2<f32>(0.0);
    }
    let near = z > z_max - 1.5 * codes;
    if !exposed || (upwards > 0.7 && near) {
        if !near {
            return vec2<f32>(0.0);
        }
        let told = select(vec2<f32>(0.5, ROOF_OF_WALL), vec2<f32>(1.0), upwards > 0.7);
        return vec2<f32>(f32(word(pages.y + i) >> 26u) / 63.0, 1.0) * told;
    }
    let first = floor(z_min / codes);
    let rows = floor((z_max - 1.0) / codes) - first;
    let row = clamp(z / codes - 0.5 - first, 0.0, rows);
    let low = floor(row);
    let a = word(strip + u32(low));
    let b = word(strip + u32(min(low + 1.0, rows)));
    let there = vec2<f32>(vec2<bool>(((a >> 24u) & 3u) != 0u, ((b >> 24u) & 3u) != 0u));
    let weights = vec2<f32>(1.0 - (row - low), row - low) * there;
    let weight = weights.x + weights.y;
    if weight <= 0.0 {
        return vec2<f32>(0.0);
    }
    return vec2<f32>((f32(a >> 26u) * weights.x + f32(b >> 26u) * weights.y) / (63.0 * weight), 1.0);
}
