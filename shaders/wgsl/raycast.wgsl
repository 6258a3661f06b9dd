// Ray-casting the cut: the GPU's twin of src/cpu/raycast.rs; one module with shade.wgsl.
//
// In: frame, tree, nodes, summaries, atlas. Out: colour, distance, hit. Next: compose.wgsl, or read-back.

struct Frame {
    forward: vec3<f32>,
    width_px: u32,
    right: vec3<f32>,
    height_px: u32,
    up: vec3<f32>,
    root: u32,
    root_corner: vec3<f32>,
    root_side_m: f32,
    sun: vec3<f32>,
    shading: u32,
    ground_z_m: f32,
    ground: u32,
    samples: u32,
    pad: u32,
    light: Light,
}

struct TreeNode {
    child: vec4<u32>,
}

struct Node {
    corner: vec3<f32>,
    cell_m: f32,
    z_step_m: f32,
    z_lo: f32,
    z_hi: f32,
    z_shift: u32,
    pages: vec4<u32>,
    slot: u32,
    level: u32,
    pad: vec2<u32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> tree: array<TreeNode>;
@group(0) @binding(2) var<storage, read> nodes: array<Node>;
@group(0) @binding(3) var<storage, read> summaries: array<u32>;
@group(0) @binding(4) var<storage, read> atlas: array<u32>;
@group(0) @binding(5) var<storage, read_write> colour: array<u32>;
@group(0) @binding(6) var<storage, read_write> distance_m: array<f32>;
@group(0) @binding(7) var<storage, read_write> hit: array<u32>;

const PAGE_WORDS: u32 = 4096u;
const SUMMARY_WORDS: u32 = 64u;
const MAX_SAMPLES: u32 = 4u;
const BLOCK_CELLS: i32 = 8;
const BLOCKS: i32 = 8;
const NODE_CELLS: i32 = 64;
const TREE_EMPTY: u32 = 0u;
const TREE_NODE_BIT: u32 = 0x80000000u;
const NO_NODE: u32 = 0xffffffffu;
const MAX_TREE_STEPS: u32 = 4096u;
const OPAQUE: f32 = 0.02;

const OCCUPIED: u32 = 1u;
const EXPOSED: u32 = 2u;
const INCLINED: u32 = 4u;
const GAP: u32 = 8u;
const HOLES: u32 = 16u;
const SUSPENDED: u32 = 32u;
const CLIPPED: u32 = 64u;
const CLIP_STEPS_PER_CELL: f32 = 128.0;
// Of a clipped column's first word (src/pack.rs).
const CORNER: u32 = 0x1000u;
const CONCAVE: u32 = 0x2000u;

// What the walk is about to do.
const AT_SQUARE: u32 = 0u;
const AT_BLOCK: u32 = 1u;
const AT_CELL: u32 = 2u;
const AFTER_CELL: u32 = 3u;
const AFTER_BLOCK: u32 = 4u;

const FACE_SIDE: u32 = 0u;
const FACE_TOP: u32 = 1u;
const FACE_BOTTOM: u32 = 2u;

const SOLID_UPPER: u32 = 0u;
const SOLID_LOWER: u32 = 1u;
const SOLID_OUTER: u32 = 2u;

struct Gathered {
    rgb: vec3<f32>,
    left: f32,
    distance: f32,
    node: u32,
}

struct NodeRay {
    index: u32,
    dir: vec3<f32>,
    o: vec3<f32>,
    d: vec3<f32>,
    inv: vec2<f32>,
    // First words of the node's planes.
    pages: vec4<u32>,
    z_shift: u32,
}

// The column that `may_hit` found: its word, and how its top rises.
struct Touched {
    walk: u32,
    slope: vec2<f32>,
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

struct Square {
    word: u32,
    low: vec2<f32>,
    size: f32,
}

var<private> gathered: Gathered;
var<private> ray: NodeRay;
var<private> touched: Touched;

@compute @workgroup_size(8, 8)
fn raycast(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width_px || id.y >= frame.height_px {
        return;
    }
    let n = clamp(frame.samples, 1u, MAX_SAMPLES);
    var sum = vec3<f32>(0.0);
    let at = id.y * frame.width_px + id.x;
    for (var s = 0u; s < n * n; s++) {
        let offset = (vec2<f32>(f32(s % n), f32(s / n)) + 0.5) / f32(n);
        trace(ray_direction(vec2<f32>(id.xy) + offset));
        sum += gathered.rgb;
        if s == n * n / 2u {
            distance_m[at] = gathered.distance;
            hit[at] = gathered.node;
        }
    }
    colour[at] = encode_srgb(sum / f32(n * n));
}

fn ray_direction(p_px: vec2<f32>) -> vec3<f32> {
    let ndc = p_px / vec2<f32>(f32(frame.width_px), f32(frame.height_px)) * 2.0 - 1.0;
    return normalize(frame.forward + frame.right * ndc.x - frame.up * ndc.y);
}

fn nonzero(v: vec2<f32>) -> vec2<f32> {
    return select(v, vec2<f32>(1e-12), abs(v) < vec2<f32>(1e-12));
}

fn ahead_of(d: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(0.0), vec2<f32>(1.0), d > vec2<f32>(0.0));
}

fn trace(dir: vec3<f32>) {
    gathered = Gathered(vec3<f32>(0.0), 1.0, bitcast<f32>(infinity_bits()), NO_NODE);
    if frame.root != TREE_EMPTY {
        walk_tree(dir);
    }
    if gathered.left > OPAQUE {
        gathered.rgb += background(dir, 1.0) * gathered.left;
    }
}

// Infinity is no constant of WGSL: made from bits that the compiler cannot fold.
fn infinity_bits() -> u32 {
    return 0x7f800000u + frame.pad;
}

// The twin's walk_tree, walk_node and walk_block in one: nested loops that a column which may be hit leaves all at once, and
// that go on where they were. So the body of the innermost loop is small and the costly rest runs once a column: devices
// whose lanes run in step (and lavapipe, whose `if`s skip nothing) would otherwise pay for it at every cell.
fn walk_tree(dir: vec3<f32>) {
    let side = frame.root_side_m;
    let o = -frame.root_corner.xy / side;
    let d = nonzero(dir.xy / side);
    let inv = 1.0 / d;
    let ahead = ahead_of(d);
    let step = vec2<i32>(ahead * 2.0 - 1.0);
    let near = (1.0 - ahead - o) * inv;
    let far = (ahead - o) * inv;
    var t = max(max(near.x, near.y), 0.0);
    if t >= min(far.x, far.y) {
        return;
    }
    var p = clamp(o + d * t, vec2<f32>(0.0), vec2<f32>(1.0));
    if t == near.x {
        p.x = 1.0 - ahead.x;
    } else if t == near.y {
        p.y = 1.0 - ahead.y;
    }
    var phase = AT_SQUARE;
    var square_exit = t;
    var leaves_root = false;
    var node_end = t;
    var slot = 0u;
    var block = vec2<i32>(0);
    var block_end = t;
    var cell = vec2<i32>(0);
    var cell_end = t;
    var squares = 0u;
    for (var columns = 0u; columns < MAX_TREE_STEPS; columns++) {
        var found = false;
        loop {
            if phase == AT_SQUARE {
                let square = descend(p, ahead);
                let edge = square.low + ahead * square.size;
                let te = (edge - o) * inv;
                square_exit = max(min(te.x, te.y), t);
                p = clamp(o + d * square_exit, square.low, square.low + square.size);
                if te.x <= te.y {
                    p.x = edge.x;
                    leaves_root = edge.x == ahead.x;
                } else {
                    p.y = edge.y;
                    leaves_root = edge.y == ahead.y;
                }
                squares++;
                if (square.word & TREE_NODE_BIT) != 0u {
                    let index = square.word & ~TREE_NODE_BIT;
                    let entry = enter_node(index, dir, t, square_exit);
                    if entry.x <= entry.y {
                        t = entry.x;
                        node_end = entry.y;
                        slot = nodes[index].slot * SUMMARY_WORDS;
                        let start = floor((ray.o.xy + ray.d.xy * t) / f32(BLOCK_CELLS));
                        block = clamp(vec2<i32>(start), vec2<i32>(0), vec2<i32>(BLOCKS - 1));
                        phase = AT_BLOCK;
                    }
                }
            }
            loop {
                if phase == AT_SQUARE {
                    break;
                }
                if phase == AT_BLOCK {
                    let te = ((vec2<f32>(block) + ahead) * f32(BLOCK_CELLS) - ray.o.xy) * ray.inv;
                    block_end = max(min(min(te.x, te.y), node_end), t);
                    let summary = summaries[slot + u32(block.y * BLOCKS + block.x)];
                    let za = ray.o.z + ray.d.z * t;
                    let zb = ray.o.z + ray.d.z * block_end;
                    phase = AFTER_BLOCK;
                    if min(za, zb) <= f32(summary >> 16u) + 1.0 && max(za, zb) + 1.0 >= f32(summary & 0xffffu) {
                        let low = block * BLOCK_CELLS;
                        cell = clamp(vec2<i32>(floor(ray.o.xy + ray.d.xy * t)), low, low + (BLOCK_CELLS - 1));
                        phase = AT_CELL;
                    }
                }
                loop {
                    if phase != AT_CELL && phase != AFTER_CELL {
                        break;
                    }
                    let te = (vec2<f32>(cell) + ahead - ray.o.xy) * ray.inv;
                    let exit = min(te.x, te.y);
                    cell_end = max(min(exit, block_end), t);
                    if phase == AT_CELL && may_hit(cell, t, cell_end) {
                        found = true;
                        break;
                    }
                    let along_x = te.x <= te.y;
                    let next = cell + select(vec2<i32>(0, step.y), vec2<i32>(step.x, 0), along_x);
                    let same = all((next >> vec2<u32>(3u)) == block);
                    phase = select(AFTER_BLOCK, AT_CELL, exit < block_end && same);
                    cell = next;
                    t = cell_end;
                }
                if found {
                    break;
                }
                let te = ((vec2<f32>(block) + ahead) * f32(BLOCK_CELLS) - ray.o.xy) * ray.inv;
                let exit = min(te.x, te.y);
                t = max(min(exit, node_end), t);
                block += select(vec2<i32>(0, step.y), vec2<i32>(step.x, 0), te.x <= te.y);
                let inside = all(block >= vec2<i32>(0)) && all(block < vec2<i32>(BLOCKS));
                phase = select(AT_SQUARE, AT_BLOCK, exit < node_end && inside);
            }
            if found || leaves_root || squares >= MAX_TREE_STEPS {
                break;
            }
            t = square_exit;
        }
        if !found {
            return;
        }
        column(cell, t, cell_end);
        if gathered.left <= OPAQUE {
            return;
        }
        phase = AFTER_CELL;
    }
}

fn descend(p: vec2<f32>, ahead: vec2<f32>) -> Square {
    var square = Square(frame.root, vec2<f32>(0.0), 1.0);
    for (var i = 0u; i < 32u; i++) {
        if square.word == TREE_EMPTY || (square.word & TREE_NODE_BIT) != 0u {
            break;
        }
        square.size *= 0.5;
        let mid = square.low + square.size;
        let east = p.x > mid.x || (p.x == mid.x && ahead.x > 0.5);
        let north = p.y > mid.y || (p.y == mid.y && ahead.y > 0.5);
        square.low = select(square.low, mid, vec2<bool>(east, north));
        let quadrant = select(0u, 1u, east) | select(0u, 2u, north);
        square.word = tree[square.word].child[quadrant];
    }
    return square;
}

// Makes `ray`; gives where it is between the node's lowest and highest point (the first larger if nowhere).
fn enter_node(index: u32, dir: vec3<f32>, t_in: f32, t_out: f32) -> vec2<f32> {
    let cell_m = nodes[index].cell_m;
    let scale = vec3<f32>(1.0 / cell_m, 1.0 / cell_m, 1.0 / nodes[index].z_step_m);
    let o = -nodes[index].corner * scale;
    let d_xy = nonzero(dir.xy * scale.xy);
    var dz = dir.z * scale.z;
    dz = select(dz, 1e-12, abs(dz) < 1e-12);
    let a = (nodes[index].z_lo - 1.0 - o.z) / dz;
    let b = (nodes[index].z_hi + 1.0 - o.z) / dz;
    let pages = nodes[index].pages * PAGE_WORDS;
    ray = NodeRay(index, dir, o, vec3<f32>(d_xy, dz), 1.0 / d_xy, pages, nodes[index].z_shift);
    return vec2<f32>(max(t_in, min(a, b)), min(t_out, max(a, b)));
}

fn plane_word(plane: u32, i: u32) -> u32 {
    return atlas[ray.pages[plane] + i];
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
    let strip = plane_word(3u, i);
    let clip = select(0u, atlas[strip], (flags & CLIPPED) != 0u);
    let border = border_of((flags & CLIPPED) != 0u, attributes, clip, centre, ta, te);
    let outer_top = f32(clip & 0xfffu);
    let has_gap = (flags & GAP) != 0u;
    let gap = select(0u, atlas[strip + head_words(flags) - 1u], has_gap);
    let low = f32(gap & 0xffffu);
    let high = f32(gap >> 16u);
    for (var n = 0u; n < 6u; n++) {
        let part = n >> 1u;
        let second = (n & 1u) == 1u;
        let lower = second != (ray.d.z > 0.0);
        let outer = (part == 1u) == border.within_is_outer;
        let solid = select(select(SOLID_UPPER, SOLID_LOWER, lower), SOLID_OUTER, outer);
        let s = select(select(border.end, border.begin, part == 1u), ta, part == 0u);
        let e = select(select(te, border.end, part == 1u), border.begin, part == 0u);
        let missing = (outer && (second || outer_top == 0.0)) || (solid == SOLID_LOWER && !has_gap);
        if missing || s >= e {
            continue;
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
    if solid == SOLID_OUTER {
        var normal = vec3<f32>(0.0, 0.0, select(-1.0, 1.0, span.face == FACE_TOP));
        if span.face == FACE_SIDE {
            normal = face_normal(cell);
        }
        gather(span.s, atlas[strip_at + 1u] | (3u << 24u), normal, flags);
        return;
    }
    if solid == SOLID_UPPER && span.face == FACE_TOP {
        gather(span.s, plane_word(1u, i) | (3u << 24u), roof_normal, flags);
        return;
    }
    if (flags & EXPOSED) == 0u {
        var normal = roof_normal;
        if span.face == FACE_BOTTOM {
            normal = vec3<f32>(0.0, 0.0, -1.0);
        }
        if dot(normal, ray.dir) >= 0.0 {
            normal = face_normal(cell);
        }
        gather(span.s, plane_word(1u, i) | (3u << 24u), normal, flags);
        return;
    }
    let strip = strip_at + head_words(flags);
    let codes = f32(16u >> ray.z_shift);
    let first = i32(floor(f32((walk >> 12u) & 0xfffu) / codes));
    let row_low = i32(floor(bottom / codes));
    let row_high = i32(floor((top - 1.0) / codes));
    var row = clamp(i32(floor((ray.o.z + ray.d.z * span.s) / codes)), row_low, row_high);
    var s = span.s;
    var face = span.face;
    for (var n = 0; n < 256; n++) {
        let texel = atlas[u32(i32(strip) + row - first)];
        if ((texel >> 24u) & 3u) != 0u {
            var normal = vec3<f32>(0.0, 0.0, 1.0);
            if face == FACE_BOTTOM {
                normal = vec3<f32>(0.0, 0.0, -1.0);
            } else if face == FACE_SIDE {
                normal = wall_normal(cell, wall);
            }
            gather(s, texel, normal, flags);
        }
        if gathered.left <= OPAQUE || (flags & HOLES) == 0u {
            return;
        }
        let up = ray.d.z > 0.0;
        s = (f32(row + select(0, 1, up)) * codes - ray.o.z) / ray.d.z;
        face = select(FACE_TOP, FACE_BOTTOM, up);
        row += select(-1, 1, up);
        if s > span.e || row < row_low || row > row_high {
            return;
        }
    }
}

fn azimuth(turn: u32) -> vec2<f32> {
    let angle = f32(turn) * (6.2831855 / 256.0);
    return vec2<f32>(cos(angle), sin(angle));
}

fn wall_normal(cell: vec2<i32>, wall: u32) -> vec3<f32> {
    let normal = vec3<f32>(azimuth(wall), 0.0);
    if dot(normal, ray.dir) < 0.0 {
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
    let lit = shade(texel, normal, flags, nodes[ray.index].level, sun_by_sky(texel));
    gathered.rgb += through_haze(lit, ray.dir, t) * (alpha * gathered.left);
    let before = gathered.left;
    gathered.left *= 1.0 - alpha;
    if before > 0.5 && gathered.left <= 0.5 {
        gathered.distance = t;
        gathered.node = ray.index;
    }
}
