// The walk of a ray segment: over the grid's squares, into nodes, over blocks and cells. CPU twin: src/cpu/walk.rs.
//
// One state machine: `next_*` and `*_in_*` are loops that resume where they stopped (`walk.phase`) and run until all
// lanes need what comes next: a node, a block, a cell, a column that may be hit (`may_hit`), a solid (`meets`), its
// texel (`hit_solid`). Devices whose lanes run in step pay for everything that stands in a loop in each of its rounds,
// and lavapipe for both sides of every `if`, so expensive work stands outside of the loops that run often. The CPU
// nests the same steps.
//
//           next_square            begin_node
//   SQUARE -------------> NODE -----------------> MESH     gathered by walk_mesh, then SQUARE
//    ^  ^  `- walk.done:    | |
//    |  |     the end       | | the ray meets its heights
//    |  +-------------------+ v
//    |   passes over it     BLOCK <---------------+
//    |                        |                   |
//    |             next_block v                   |
//    |   +----------------> CELL                  |
//    |   |                    |                   |
//    |   |          next_cell v may_hit           |
//    |   |                  COLUMN --------> solid, gathered by hit_solid, then COLUMN
//    |   |                    |      meets        |
//    |   |                    v no further solid  |
//    |   +------------- AFTER_CELL                |
//    |     same block         | next block        |
//    +------------------------+-------------------+
//          node left
//
// From BLOCK the ray also leaves the node, if it passes above or below all further blocks.

const AT_SQUARE: u32 = 0u;
const AT_NODE: u32 = 1u;
const AT_BLOCK: u32 = 2u;
const AT_CELL: u32 = 3u;
const AT_COLUMN: u32 = 4u;
const AFTER_CELL: u32 = 5u;
const AT_MESH: u32 = 6u;

// The segment in the grid: x and y in finest squares, z in steps of the grid's heights; `t` in metres.
struct GridRay {
    o: vec2<f32>,
    d: vec2<f32>,
    inv: vec2<f32>,
    z: f32,
    dz: f32,
    rises: bool,
    // 1 along the axes on which the ray's coordinate grows, else 0; and the same as a step, 1 or -1.
    ahead: vec2<f32>,
    forward: vec2<i32>,
    step: vec2<i32>,
    t_end: f32,
    // Along the grid's side.
    squares: i32,
}

struct Walk {
    phase: u32,
    // Where the ray is, in metres from its origin.
    t: f32,
    // Entries of the grid that were read.
    steps: u32,
    // Whether the walk has ended.
    done: bool,
    // The next square, the level to look it up at, and where the ray leaves the present one.
    square: vec2<i32>,
    level: u32,
    square_exit: f32,
    node: u32,
    node_end: f32,
    block: vec2<i32>,
    block_end: f32,
    next_block: vec2<i32>,
    after_block: u32,
    tops: QuadTops,
    cell: vec2<i32>,
    cell_end: f32,
    next_cell: vec2<i32>,
    // The ray leaves the block with this cell.
    leaves_block: bool,
    // The next of the column's solids in the ray's order.
    solid: u32,
}

// Highest points of a block's quads of 2 x 2 cells, in height codes.
struct QuadTops {
    // Highest point of the block, with a margin of one code for rounding.
    lowest: f32,
    highest: f32,
    // Height of one unit of a quad's six bits.
    unit: f32,
    rows: vec4<u32>,
}

// An entry of the grid, and the level that it is of.
struct GridEntry {
    words: vec2<u32>,
    level: u32,
}

var<private> grid_ray: GridRay;
var<private> walk: Walk;

fn walk_grid() {
    if !begin_walk() {
        return;
    }
    for (var hits = 0u; hits < MAX_STEPS; hits++) {
        if !next_solid() {
            return;
        }
        if MESHES && walk.phase == AT_MESH {
            walk_mesh(walk.node);
            walk.phase = AT_SQUARE;
        } else {
            hit_solid(walk.cell);
        }
        if ray_hit.is_hit {
            return;
        }
    }
}

// False if the segment misses the grid.
fn begin_walk() -> bool {
    let o = frame.eye + segment.origin.xy / frame.side_m;
    let z = frame.z_eye + segment.origin.z * frame.z_scale;
    let d = nonzero(segment.dir.xy / frame.side_m);
    let inv = 1.0 / d;
    var dz = segment.dir.z * frame.z_scale;
    dz = select(dz, MIN_DIRECTION, abs(dz) < MIN_DIRECTION);
    let ahead = ahead_of(d);
    let forward = vec2<i32>(ahead);
    let squares = 1i << (frame.levels - 1u);
    let low = vec2<f32>(-frame.eye_cell);
    let near = (low + (1.0 - ahead) * f32(squares) - o) * inv;
    let far = (low + ahead * f32(squares) - o) * inv;
    let za = (-1.0 - z) / dz;
    let zb = (Z_TOP + 1.0 - z) / dz;
    let t = max(max(max(near.x, near.y), min(za, zb)), 0.0);
    let t_end = min(min(min(far.x, far.y), max(za, zb)), segment.reach_m);
    grid_ray = GridRay(o, d, inv, z, dz, dz > 0.0, ahead, forward, forward * 2 - 1, t_end, squares);
    walk.phase = AT_SQUARE;
    walk.t = t;
    walk.steps = 0u;
    walk.done = false;
    walk.square = clamp(vec2<i32>(floor(o + d * t)) + frame.eye_cell, vec2<i32>(0), vec2<i32>(squares - 1));
    walk.level = level_at(segment.eye_m + t);
    walk.square_exit = t;
    return t < t_end;
}

// Goes on to the next solid (`found`) or mesh; false if the walk has ended.
fn next_solid() -> bool {
    var found_one = false;
    loop {
        next_column();
        found_one = MESHES && walk.phase == AT_MESH;
        if found_one || walk.phase != AT_COLUMN {
            break;
        }
        found_one = meets(walk.cell, walk.t, walk.cell_end);
        if found_one {
            break;
        }
        walk.phase = AFTER_CELL;
    }
    return found_one;
}

// To AT_COLUMN, AT_MESH or the end.
fn next_column() {
    loop {
        next_node();
        if (MESHES && walk.phase == AT_MESH) || walk.phase == AT_SQUARE {
            break;
        }
        column_in_node();
        if walk.phase == AT_COLUMN || walk.done {
            break;
        }
    }
}

// To a node whose heights the ray meets, or the end.
fn next_node() {
    loop {
        next_square();
        if walk.phase == AT_NODE {
            begin_node();
        }
        if walk.phase != AT_SQUARE || walk.done {
            break;
        }
    }
}

// To a square that a node fills, or the end.
fn next_square() {
    loop {
        if walk.phase != AT_SQUARE || walk.done {
            break;
        }
        walk.t = walk.square_exit;
        let entry = look_up(walk.square, walk.level);
        walk.steps++;
        let is_node = (entry.words.x & GRID_NODE_BIT) != 0u;
        let k = select(entry.level, (entry.words.x >> GRID_LEVEL_SHIFT) & GRID_LEVEL_MASK, is_node);
        let corner = (walk.square >> vec2<u32>(k)) << vec2<u32>(k);
        let edge = corner + (grid_ray.forward << vec2<u32>(k));
        let te = (vec2<f32>(edge - frame.eye_cell) - grid_ray.o) * grid_ray.inv;
        let exit = fast_max(fast_min(fast_min(te.x, te.y), grid_ray.t_end), walk.t);
        let z_in = grid_ray.z + grid_ray.dz * walk.t;
        let z_out = grid_ray.z + grid_ray.dz * exit;
        let below = fast_min(z_in, z_out) <= f32(entry.words.y >> 16u) + 1.0;
        let meets_heights = below && fast_max(z_in, z_out) + 1.0 >= f32(entry.words.y & 0xffffu);
        if meets_heights && entry.words.x == GRID_MIXED && k > 0u {
            walk.level = k - 1u;
            walk.done = walk.steps >= MAX_STEPS;
            continue;
        }
        if meets_heights && is_node {
            walk.node = seen_node(entry.words.x);
            walk.phase = AT_NODE;
        }
        walk.square_exit = exit;
        var next = vec2<i32>(floor(grid_ray.o + grid_ray.d * exit)) + frame.eye_cell;
        next = clamp(next, corner, corner + ((1i << k) - 1i));
        let beyond = edge - 1 + grid_ray.forward;
        next = select(vec2<i32>(next.x, beyond.y), vec2<i32>(beyond.x, next.y), te.x <= te.y);
        let inside = all(next >= vec2<i32>(0)) && all(next < vec2<i32>(grid_ray.squares));
        walk.done = exit >= grid_ray.t_end || !inside || walk.steps >= MAX_STEPS;
        // The largest square that holds the next place and not this one: larger ones were found to be mixed.
        let apart = firstLeadingBit(u32((walk.square.x ^ next.x) | (walk.square.y ^ next.y)));
        walk.level = min(level_at(segment.eye_m + exit), apart);
        walk.square = next;
    }
}

// From AT_NODE to AT_MESH, to the node's first block, or on to the next square.
fn begin_node() {
    let span = enter_node(walk.node, walk.t, walk.square_exit);
    walk.phase = AT_SQUARE;
    if MESHES && nodes[walk.node].mesh != 0u {
        walk.phase = AT_MESH;
    } else if span.x <= span.y {
        if COUNT {
            counts.x++;
        }
        walk.t = span.x;
        walk.node_end = span.y;
        let first = floor((node_ray.o.xy + node_ray.d.xy * span.x) / f32(BLOCK_CELLS));
        walk.block = clamp(vec2<i32>(first), vec2<i32>(0), vec2<i32>(NODE_BLOCKS - 1));
        walk.phase = AT_BLOCK;
    }
}

// To AT_COLUMN, or to AT_SQUARE behind the node.
fn column_in_node() {
    loop {
        if walk.phase == AT_SQUARE || walk.phase == AT_COLUMN {
            break;
        }
        next_block();
        column_in_block();
    }
}

// Over the blocks that the ray passes above or below.
fn next_block() {
    loop {
        if walk.phase != AT_BLOCK {
            break;
        }
        let te = ((vec2<f32>(walk.block) + grid_ray.ahead) * f32(BLOCK_CELLS) - node_ray.o.xy) * node_ray.inv;
        let exit = fast_min(te.x, te.y);
        walk.block_end = fast_max(fast_min(exit, walk.node_end), walk.t);
        if COUNT {
            counts.z++;
        }
        walk.tops = quad_tops(summaries[node_ray.summary + u32(walk.block.y * NODE_BLOCKS + walk.block.x)]);
        let lower = z_at(select(walk.block_end, walk.t, grid_ray.rises));
        let upper = z_at(select(walk.t, walk.block_end, grid_ray.rises));
        let low = walk.block * BLOCK_CELLS;
        let first = vec2<i32>(floor(node_ray.o.xy + node_ray.d.xy * walk.t));
        walk.cell = clamp(first, low, low + (BLOCK_CELLS - 1));
        walk.next_block = walk.block + step_to_neighbour(te);
        let inside = all(walk.next_block >= vec2<i32>(0)) && all(walk.next_block < vec2<i32>(NODE_BLOCKS));
        walk.after_block = select(AT_SQUARE, AT_BLOCK, exit < walk.node_end && inside);
        if lower <= walk.tops.highest && upper >= walk.tops.lowest {
            walk.phase = AT_CELL;
            break;
        }
        walk.block = walk.next_block;
        walk.phase = walk.after_block;
        walk.t = walk.block_end;
    }
}

// To AT_COLUMN, or behind the block.
fn column_in_block() {
    loop {
        next_cell();
        if walk.phase != AT_CELL {
            break;
        }
        if COUNT {
            counts.w++;
        }
        walk.phase = AFTER_CELL;
        if may_hit(walk.cell, walk.t, walk.cell_end, quad_top(walk.tops, walk.cell)) {
            walk.solid = 0u;
            walk.phase = AT_COLUMN;
            break;
        }
    }
}

// Over the cells of quads that the ray passes above.
fn next_cell() {
    loop {
        if walk.phase == AFTER_CELL {
            walk.phase = select(AT_CELL, walk.after_block, walk.leaves_block);
            walk.block = select(walk.block, walk.next_block, walk.leaves_block);
            walk.t = select(walk.cell_end, walk.block_end, walk.leaves_block);
            walk.cell = walk.next_cell;
        }
        if walk.phase != AT_CELL {
            break;
        }
        let te = (vec2<f32>(walk.cell) + grid_ray.ahead - node_ray.o.xy) * node_ray.inv;
        let exit = fast_min(te.x, te.y);
        walk.cell_end = fast_max(fast_min(exit, walk.block_end), walk.t);
        walk.next_cell = walk.cell + step_to_neighbour(te);
        walk.leaves_block = exit >= walk.block_end || any((walk.next_cell >> vec2<u32>(BLOCK_SHIFT)) != walk.block);
        if z_at(select(walk.cell_end, walk.t, grid_ray.rises)) <= quad_top(walk.tops, walk.cell) {
            break;
        }
        walk.phase = AFTER_CELL;
    }
}

// To the neighbour whose boundary the ray reaches first.
fn step_to_neighbour(te: vec2<f32>) -> vec2<i32> {
    return select(vec2<i32>(0, grid_ray.step.y), vec2<i32>(grid_ray.step.x, 0), te.x <= te.y);
}

fn quad_tops(rows: vec4<u32>) -> QuadTops {
    let bytes = rows >> vec4<u32>(SUMMARY_BYTE_SHIFT);
    let lowest = f32(bytes.x | (bytes.y << 8u));
    let highest = f32(bytes.z | (bytes.w << 8u));
    return QuadTops(lowest - 1.0, highest + 1.0, (highest - lowest) * (1.0 / QUAD_TOP_MAX), rows);
}

// Highest point of the cell's quad, with the same margin.
fn quad_top(tops: QuadTops, cell: vec2<i32>) -> f32 {
    let units = (tops.rows[(cell.y >> 1u) & 3] >> (u32((cell.x >> 1u) & 3) * QUAD_TOP_BITS)) & QUAD_TOP_MASK;
    return tops.lowest + 2.0 + f32(units) * tops.unit;
}

// The node that the ray sees in a square: the one that the entry names, or the next one, from which the square
// cross-fades.
fn seen_node(entry: u32) -> u32 {
    return (entry & GRID_NODE_MASK) + select(0u, 1u, (threshold >> 6u) < ((entry >> GRID_SHARE_SHIFT) & GRID_SHARE_MASK));
}

// The level whose nodes are good enough at distance `t`: its exponent is the logarithm, rounded down.
fn level_at(t: f32) -> u32 {
    return min((bitcast<u32>(fast_max(t * frame.level_scale, 1.0)) >> 23u) - 127u, frame.levels - 1u);
}

// The entry for a finest square at `level`, or at the first coarser level whose window holds it.
fn look_up(square: vec2<i32>, level: u32) -> GridEntry {
    for (var k = level; k < frame.levels; k++) {
        let place = (square >> vec2<u32>(k)) - frame.windows[k].zw;
        let log2_side = u32(frame.windows[k].y);
        if all((place >> vec2<u32>(log2_side)) == vec2<i32>(0)) {
            if COUNT {
                counts.y++;
            }
            return GridEntry(grid[u32(frame.windows[k].x + (place.y << log2_side) + place.x)], k);
        }
    }
    return GridEntry(vec2<u32>(0u), frame.levels - 1u);
}
