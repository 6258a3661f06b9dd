// Ray-casting the cut: the GPU's twin of src/cpu/raycast.rs; one module with node.wgsl, column.wgsl, mesh.wgsl and
// shade.wgsl.
//
// In: frame, grid, nodes, summaries, atlas. Out: colour, distance, hit. Next: compose.wgsl, or read-back.

struct FrameUniform {
    forward: vec3<f32>,
    width_px: u32,
    right: vec3<f32>,
    height_px: u32,
    up: vec3<f32>,
    samples: u32,
    sun: vec3<f32>,
    shading: u32,
    eye: vec2<f32>,
    eye_cell: vec2<i32>,
    side_m: f32,
    levels: u32,
    z_eye: f32,
    z_scale: f32,
    level_scale: f32,
    ground_z_m: f32,
    ground: u32,
    shadow_m: f32,
    light: Light,
    windows: array<vec4<i32>, 21>,
}

struct DrawNode {
    // In rows of four, each of which is read at once. South-west corner at height code 0, side of a column.
    place: vec4<f32>,
    // Bits of metres of a height code, lowest, highest; slot and z_shift.
    z: vec4<u32>,
    // Pages of its planes; in the upper bytes, how far its quarters lie below it.
    pages: vec4<u32>,
    level: u32,
    mesh: u32,
    mesh_z_m: f32,
    leaf_offset: u32,
}

@group(0) @binding(0) var<uniform> frame: FrameUniform;
@group(0) @binding(1) var<storage, read> grid: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> nodes: array<DrawNode>;
@group(0) @binding(3) var<storage, read> summaries: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read> atlas: array<u32>;
@group(0) @binding(5) var<storage, read_write> colour: array<u32>;
@group(0) @binding(6) var<storage, read_write> distance_m: array<f32>;
@group(0) @binding(7) var<storage, read_write> hit: array<u32>;
@group(0) @binding(8) var<storage, read> fours: array<vec4<u32>>;

const PAGE_WORDS: u32 = 4096u;
// In fours, one a block.
const SUMMARY_FOURS: u32 = 64u;
const SLOT_SHIFT: u32 = 3u;
const QUARTER_SHIFT: u32 = 24u;
const MAX_SAMPLES: u32 = 4u;
const BLOCK_CELLS: i32 = 8;
const BLOCKS: i32 = 8;
const NODE_CELLS: i32 = 64;
const GRID_MIXED: u32 = 1u;
const GRID_NODE_BIT: u32 = 0x80000000u;
const GRID_LEVEL_SHIFT: u32 = 26u;
const GRID_SHARE_SHIFT: u32 = 20u;
const GRID_NODES: u32 = 0x100000u;
const Z_TOP: f32 = 65535.0;
const NO_NODE: u32 = 0xffffffffu;
const MAX_STEPS: u32 = 4096u;
const OPAQUE: f32 = 0.02;
const SUN_LIFT_CELLS: f32 = 0.5;
const SUN_LIFT_M: f32 = 0.05;

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

// Of what a ray gathered.
const MESH_FLAG: u32 = 128u;

// What the walk is about to do.
const AT_SQUARE: u32 = 0u;
const AT_BLOCK: u32 = 1u;
const AT_CELL: u32 = 2u;
const AFTER_CELL: u32 = 3u;
const AT_MESH: u32 = 4u;
const AT_COLUMN: u32 = 5u;
const AT_NODE: u32 = 6u;

const FACE_SIDE: u32 = 0u;
const FACE_TOP: u32 = 1u;
const FACE_BOTTOM: u32 = 2u;

const NO_WALL: u32 = 256u;

const SOLID_UPPER: u32 = 0u;
const SOLID_LOWER: u32 = 1u;
const SOLID_OUTER: u32 = 2u;

// A way that is walked: from the eye to what is seen, or from there towards the sun.
struct Leg {
    origin: vec3<f32>,
    dir: vec3<f32>,
    reach_m: f32,
    eye_m: f32,
    to_sun: bool,
}

struct Gathered {
    albedo: vec3<f32>,
    ao: f32,
    normal: vec3<f32>,
    mean_m: f32,
    flags: u32,
    level: u32,
    left: f32,
    distance: f32,
    node: u32,
    sun_from: vec3<f32>,
}

struct NodeRay {
    index: u32,
    o: vec3<f32>,
    d: vec3<f32>,
    inv: vec2<f32>,
    // First words of the node's planes.
    pages: vec4<u32>,
    z_shift: u32,
    // First of its summary.
    summary: u32,
    cell_m: f32,
}

// The column that `may_hit` found: its word, and how its top rises (`meets`).
struct Touched {
    walk: u32,
    slope: vec2<f32>,
}

// Highest points of a block's quads of 2 x 2 cells.
struct Quads {
    // Of the block, a little beyond what is there.
    lowest: f32,
    highest: f32,
    // Of the tops' six bits.
    step: f32,
    rows: vec4<u32>,
}

// The solid that `meets` found.
struct Met {
    span: Span,
    attributes: u32,
    strip: u32,
    solid: u32,
    wall: u32,
    bottom: f32,
    top: f32,
    z_min: f32,
}

// An entry of the grid, and the level that it is of.
struct Entry {
    words: vec2<u32>,
    k: u32,
}

// Set in a build that writes what rays did in place of what they saw: never in the product's.
override COUNT: bool = false;
// Cleared in a build for cuts without meshes.
override MESHES: bool = true;
// Set in a build for shadings other than LIT.
override FOR_STUDY: bool = false;

var<private> leg: Leg;
// Which of two nodes the ray sees where a square passes from one to the other.
var<private> threshold: u32;
var<private> gathered: Gathered;
var<private> ray: NodeRay;
var<private> touched: Touched;
var<private> met: Met;
var<private> next_solid: u32;
// Nodes, entries of the grid, words of summaries and atlas, cells; only with COUNT.
var<private> counts: vec4<u32>;

@compute @workgroup_size(8, 8)
fn raycast(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let id = pixel_of(group.xy, groups.y, lane);
    if id.x >= frame.width_px || id.y >= frame.height_px {
        return;
    }
    let n = clamp(frame.samples, 1u, MAX_SAMPLES);
    var sum = vec3<f32>(0.0);
    let at = id.y * frame.width_px + id.x;
    var sample = vec2<u32>(0u);
    for (var s = 0u; s < n * n; s++) {
        let offset = (vec2<f32>(sample) + 0.5) / f32(n);
        threshold = threshold_of(id, n, sample);
        let traced = trace(ray_direction(vec2<f32>(id) + offset));
        sum += traced.rgb;
        if s == n * n / 2u {
            distance_m[at] = traced.distance;
            hit[at] = traced.node;
        }
        // Without a division, which lavapipe does lane by lane.
        sample = select(vec2<u32>(sample.x + 1u, sample.y), vec2<u32>(0u, sample.y + 1u), sample.x + 1u == n);
    }
    colour[at] = encode_srgb(sum / f32(n * n));
    if COUNT {
        colour[at] = counts.x | (counts.y << 16u);
        distance_m[at] = f32(counts.z);
        hit[at] = counts.w;
    }
}

// Lanes that run in step are neighbours two pixels wide and four high (of 8 lanes; 8 wide and 4 high of 32): rays that do much the
// same, as what a city shows is more alike upwards than sideways. Every second row of workgroups comes in the second half of
// the dispatch, so that a device that parts it in two (lavapipe on two cores) gets as much sky in one half as in the other.
fn pixel_of(group: vec2<u32>, rows: u32, lane: u32) -> vec2<u32> {
    let half = (rows + 1u) / 2u;
    let row = select(group.y * 2u, (group.y - half) * 2u + 1u, group.y >= half);
    let within = vec2<u32>((lane & 1u) + ((lane >> 3u) & 3u) * 2u, ((lane >> 1u) & 3u) + (lane >> 5u) * 4u);
    return vec2<u32>(group.x, row) * 8u + within;
}

fn threshold_of(pixel: vec2<u32>, samples: u32, sample: vec2<u32>) -> u32 {
    let p = pixel * samples + sample + vec2<u32>(0u, samples / 2u);
    let a = p.x ^ p.y;
    let low = ((a & 4u) >> 1u) | ((p.y & 4u) >> 2u);
    return ((a & 1u) << 5u) | ((p.y & 1u) << 4u) | ((a & 2u) << 2u) | ((p.y & 2u) << 1u) | low;
}

fn ray_direction(p_px: vec2<f32>) -> vec3<f32> {
    let ndc = p_px / vec2<f32>(f32(frame.width_px), f32(frame.height_px)) * 2.0 - 1.0;
    return normalize(frame.forward + frame.right * ndc.x - frame.up * ndc.y);
}

// `min` and `max` of numbers: WGSL's own say what a NaN gives, which costs two more instructions where devices do not know it.
fn least(a: f32, b: f32) -> f32 {
    return select(b, a, a < b);
}

fn most(a: f32, b: f32) -> f32 {
    return select(b, a, a > b);
}

fn nonzero(v: vec2<f32>) -> vec2<f32> {
    return select(v, vec2<f32>(1e-12), abs(v) < vec2<f32>(1e-12));
}

fn ahead_of(d: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(0.0), vec2<f32>(1.0), d > vec2<f32>(0.0));
}

struct Traced {
    rgb: vec3<f32>,
    distance: f32,
    node: u32,
}

// Both legs in one loop, so that the walk's code is there once.
fn trace(dir: vec3<f32>) -> Traced {
    let never = bitcast<f32>(infinity_bits());
    var seen = Gathered();
    var lit = Lit();
    var sun_seen = 1.0;
    air = Air(horizon(dir), glow(dir));
    leg = Leg(vec3<f32>(0.0), dir, never, 0.0, false);
    loop {
        gathered = Gathered(vec3<f32>(0.0), 0.0, vec3<f32>(0.0), 0.0, 0u, 0u, 1.0, never, NO_NODE, vec3<f32>(0.0));
        if frame.levels != 0u {
            walk_grid();
        }
        if leg.to_sun {
            sun_seen = select(0.0, gathered.left, gathered.left > OPAQUE);
            break;
        }
        seen = gathered;
        var eye_m = seen.distance;
        lit = light_of(seen, dir);
        if seen.left > OPAQUE {
            let behind = background(dir);
            lit = Lit(lit.sky + behind.sky * seen.left, lit.sun + behind.sun * seen.left);
            if seen.left > 0.5 {
                eye_m = ground_distance(dir);
                seen.sun_from = dir * eye_m + vec3<f32>(0.0, 0.0, SUN_LIFT_M);
            }
        }
        if frame.shadow_m <= 0.0 || all(lit.sun <= vec3<f32>(0.0)) || eye_m >= NEVER_M {
            break;
        }
        leg = Leg(seen.sun_from, frame.sun, frame.shadow_m, eye_m, true);
    }
    return Traced(develop(lit.sky + lit.sun * sun_seen), seen.distance, seen.node);
}

// The twin's Gathered::light.
fn light_of(seen: Gathered, dir: vec3<f32>) -> Lit {
    let share = 1.0 - seen.left;
    if share <= 0.0 {
        return Lit(vec3<f32>(0.0), vec3<f32>(0.0));
    }
    let length_squared = dot(seen.normal, seen.normal);
    let normal = select(-dir, seen.normal * inverseSqrt(length_squared), length_squared > 1e-12);
    let lit = through_haze(shade(seen.albedo / share, seen.ao / share, normal, seen.flags, seen.level), seen.mean_m / share);
    return Lit(lit.sky * share, lit.sun * share);
}

// Infinity is no constant of WGSL: made from bits that the compiler cannot fold.
fn infinity_bits() -> u32 {
    return 0x7f800000u + bitcast<u32>(frame.light.pad);
}

// The twin's walk_grid, walk_node and walk_block in one: nested loops that go on where they were (`phase`), each of which runs
// until all lanes need what is behind it: a node, a block, a cell, a column that may be hit (`may_hit`), a solid that is
// (`meets`), its texel (`hit_solid`). Devices whose lanes run in step (and lavapipe, whose `if`s skip nothing) pay for whatever
// stands in a loop at each of its rounds, so what is costly stands outside of what is often run.
fn walk_grid() {
    let o = frame.eye + leg.origin.xy / frame.side_m;
    let z_from = frame.z_eye + leg.origin.z * frame.z_scale;
    let d = nonzero(leg.dir.xy / frame.side_m);
    let inv = 1.0 / d;
    var dz = leg.dir.z * frame.z_scale;
    dz = select(dz, 1e-12, abs(dz) < 1e-12);
    let ahead = ahead_of(d);
    let forward = vec2<i32>(ahead);
    let step = forward * 2 - 1;
    let squares = 1i << (frame.levels - 1u);
    let low = vec2<f32>(-frame.eye_cell);
    let near = (low + (1.0 - ahead) * f32(squares) - o) * inv;
    let far = (low + ahead * f32(squares) - o) * inv;
    let za = (-1.0 - z_from) / dz;
    let zb = (Z_TOP + 1.0 - z_from) / dz;
    var t = max(max(max(near.x, near.y), min(za, zb)), 0.0);
    let t_end = min(min(min(far.x, far.y), max(za, zb)), leg.reach_m);
    if t >= t_end {
        return;
    }
    var square = clamp(vec2<i32>(floor(o + d * t)) + frame.eye_cell, vec2<i32>(0), vec2<i32>(squares - 1));
    var k = level_at(leg.eye_m + t);
    let rises = dz > 0.0;
    var phase = AT_SQUARE;
    var square_exit = t;
    var done = false;
    var index = 0u;
    var node_end = t;
    var block = vec2<i32>(0);
    var block_end = t;
    var quads = Quads();
    var cell = vec2<i32>(0);
    var cell_end = t;
    // Where the ray goes on behind the block and behind the cell.
    var next_block = vec2<i32>(0);
    var after_block = AT_SQUARE;
    var next_cell = vec2<i32>(0);
    var leaves = false;
    var steps = 0u;
    for (var hits = 0u; hits < MAX_STEPS; hits++) {
        var met_one = false;
        loop {
            var candidate = phase == AT_COLUMN;
            loop {
                // To a node whose heights the ray comes to.
                loop {
                    loop {
                        if phase != AT_SQUARE || done {
                            break;
                        }
                        t = square_exit;
                        let entry = look_up(square, k);
                        steps++;
                        let is_node = (entry.words.x & GRID_NODE_BIT) != 0u;
                        k = select(entry.k, (entry.words.x >> GRID_LEVEL_SHIFT) & 31u, is_node);
                        let corner = (square >> vec2<u32>(k)) << vec2<u32>(k);
                        let edge = corner + (forward << vec2<u32>(k));
                        let te = (vec2<f32>(edge - frame.eye_cell) - o) * inv;
                        let exit = most(least(least(te.x, te.y), t_end), t);
                        let z_in = z_from + dz * t;
                        let z_out = z_from + dz * exit;
                        let below = least(z_in, z_out) <= f32(entry.words.y >> 16u) + 1.0;
                        let meets = below && most(z_in, z_out) + 1.0 >= f32(entry.words.y & 0xffffu);
                        if meets && entry.words.x == GRID_MIXED && k > 0u {
                            k--;
                            done = steps >= MAX_STEPS;
                            continue;
                        }
                        if meets && is_node {
                            index = seen_by(entry.words.x);
                            phase = AT_NODE;
                        }
                        square_exit = exit;
                        var next = vec2<i32>(floor(o + d * exit)) + frame.eye_cell;
                        next = clamp(next, corner, corner + ((1i << k) - 1i));
                        let beyond = edge - 1 + forward;
                        next = select(vec2<i32>(next.x, beyond.y), vec2<i32>(beyond.x, next.y), te.x <= te.y);
                        let inside = all(next >= vec2<i32>(0)) && all(next < vec2<i32>(squares));
                        done = exit >= t_end || !inside || steps >= MAX_STEPS;
                        let apart = firstLeadingBit(u32((square.x ^ next.x) | (square.y ^ next.y)));
                        k = min(level_at(leg.eye_m + exit), apart);
                        square = next;
                    }
                    if phase == AT_NODE {
                        let span = enter_node(index, t, square_exit);
                        phase = AT_SQUARE;
                        if MESHES && nodes[index].mesh != 0u {
                            phase = AT_MESH;
                        } else if span.x <= span.y {
                            if COUNT {
                                counts.x++;
                            }
                            t = span.x;
                            node_end = span.y;
                            let start = floor((ray.o.xy + ray.d.xy * t) / f32(BLOCK_CELLS));
                            block = clamp(vec2<i32>(start), vec2<i32>(0), vec2<i32>(BLOCKS - 1));
                            phase = AT_BLOCK;
                        }
                    }
                    if phase != AT_SQUARE || done {
                        break;
                    }
                }
                if MESHES && phase == AT_MESH {
                    candidate = true;
                    break;
                }
                if phase == AT_SQUARE {
                    break;
                }
                // To a column that may be hit.
                loop {
                    if phase == AT_SQUARE || candidate {
                        break;
                    }
                    // Over the blocks that the ray flies over.
                    loop {
                        if phase != AT_BLOCK {
                            break;
                        }
                        let te = ((vec2<f32>(block) + ahead) * f32(BLOCK_CELLS) - ray.o.xy) * ray.inv;
                        let exit = least(te.x, te.y);
                        block_end = most(least(exit, node_end), t);
                        if COUNT {
                            counts.z++;
                        }
                        quads = quads_of(summaries[ray.summary + u32(block.y * BLOCKS + block.x)]);
                        let lower = z_at(select(block_end, t, rises));
                        let upper = z_at(select(t, block_end, rises));
                        let low = block * BLOCK_CELLS;
                        let start = vec2<i32>(floor(ray.o.xy + ray.d.xy * t));
                        cell = clamp(start, low, low + (BLOCK_CELLS - 1));
                        next_block = block + select(vec2<i32>(0, step.y), vec2<i32>(step.x, 0), te.x <= te.y);
                        let inside = all(next_block >= vec2<i32>(0)) && all(next_block < vec2<i32>(BLOCKS));
                        after_block = select(AT_SQUARE, AT_BLOCK, exit < node_end && inside);
                        if lower <= quads.highest && upper >= quads.lowest {
                            phase = AT_CELL;
                            break;
                        }
                        block = next_block;
                        phase = after_block;
                        t = block_end;
                    }
                    loop {
                        // Over the cells of quads that the ray flies over.
                        loop {
                            if phase == AFTER_CELL {
                                phase = select(AT_CELL, after_block, leaves);
                                block = select(block, next_block, leaves);
                                t = select(cell_end, block_end, leaves);
                                cell = next_cell;
                            }
                            if phase != AT_CELL {
                                break;
                            }
                            let te = (vec2<f32>(cell) + ahead - ray.o.xy) * ray.inv;
                            let exit = least(te.x, te.y);
                            cell_end = most(least(exit, block_end), t);
                            next_cell = cell + select(vec2<i32>(0, step.y), vec2<i32>(step.x, 0), te.x <= te.y);
                            leaves = exit >= block_end || any((next_cell >> vec2<u32>(3u)) != block);
                            if z_at(select(cell_end, t, rises)) <= quad_top(quads, cell) {
                                break;
                            }
                            phase = AFTER_CELL;
                        }
                        if phase != AT_CELL {
                            break;
                        }
                        if COUNT {
                            counts.w++;
                        }
                        phase = AFTER_CELL;
                        if may_hit(cell, t, cell_end, quad_top(quads, cell)) {
                            next_solid = 0u;
                            candidate = true;
                            break;
                        }
                    }
                }
                if candidate || done {
                    break;
                }
            }
            if !candidate {
                break;
            }
            met_one = (MESHES && phase == AT_MESH) || meets(cell, t, cell_end);
            if met_one {
                break;
            }
            phase = AFTER_CELL;
        }
        if !met_one {
            return;
        }
        if MESHES && phase == AT_MESH {
            walk_mesh(index);
            phase = AT_SQUARE;
        } else {
            hit_solid(cell);
            phase = AT_COLUMN;
        }
        if gathered.left <= OPAQUE {
            return;
        }
    }
}

fn quads_of(rows: vec4<u32>) -> Quads {
    let bytes = rows >> vec4<u32>(24u);
    let lowest = f32(bytes.x | (bytes.y << 8u));
    let highest = f32(bytes.z | (bytes.w << 8u));
    return Quads(lowest - 1.0, highest + 1.0, (highest - lowest) * (1.0 / 63.0), rows);
}

// Highest point of the cell's quad, and a little more.
fn quad_top(quads: Quads, cell: vec2<i32>) -> f32 {
    let share = (quads.rows[(cell.y >> 1u) & 3] >> (u32((cell.x >> 1u) & 3) * 6u)) & 63u;
    return quads.lowest + 2.0 + f32(share) * quads.step;
}

// The node that the ray sees in a square: the one that the entry names, or the one behind it.
fn seen_by(entry: u32) -> u32 {
    return (entry & (GRID_NODES - 1u)) + select(0u, 1u, threshold < ((entry >> GRID_SHARE_SHIFT) & 63u));
}

// The level whose nodes are good enough at a distance.
fn level_at(t: f32) -> u32 {
    return min((bitcast<u32>(most(t * frame.level_scale, 1.0)) >> 23u) - 127u, frame.levels - 1u);
}

// The entry for a finest square at level `k`, or at the first coarser level whose window holds it.
fn look_up(square: vec2<i32>, k: u32) -> Entry {
    for (var level = k; level < frame.levels; level++) {
        let place = (square >> vec2<u32>(level)) - frame.windows[level].zw;
        let log2_side = u32(frame.windows[level].y);
        if all((place >> vec2<u32>(log2_side)) == vec2<i32>(0)) {
            if COUNT {
                counts.y++;
            }
            return Entry(grid[u32(frame.windows[level].x + (place.y << log2_side) + place.x)], level);
        }
    }
    return Entry(vec2<u32>(0u), frame.levels - 1u);
}
