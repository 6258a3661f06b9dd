// Which of a column's solids a ray meets. CPU twin: src/cpu/column.rs.
//
// A column is one solid, or two with a gap between them, and, where a plane clips it, a lower solid beyond the plane.
// The plane splits the ray's way through the cell into three parts: before, within and behind.

const NO_WALL: u32 = 256u;

const SIDE_FACE: u32 = 0u;
const TOP_FACE: u32 = 1u;
const BOTTOM_FACE: u32 = 2u;

// The only one, or the upper of two: its top is the roof.
const UPPER_SOLID: u32 = 0u;
// Below the gap.
const LOWER_SOLID: u32 = 1u;
// Beyond the plane that clips the column.
const OUTER_SOLID: u32 = 2u;

// The column that the walk is at: its word of the first plane, and the slope of its top in height codes per cell.
struct ColumnVisit {
    walk: u32,
    slope: vec2<f32>,
}

// The interval of the ray inside a solid: from `s` to `e`, entered through `face`. Empty if `s >= e`.
struct SolidSpan {
    s: f32,
    e: f32,
    face: u32,
}

// A solid that the ray meets, with the words of its column that `hit_solid` needs.
struct FoundSolid {
    span: SolidSpan,
    attributes: u32,
    strip: u32,
    solid: u32,
    // Azimuth of the wall through which the ray enters, if not through the cell's face.
    wall: u32,
    bottom: f32,
    top: f32,
    z_min: f32,
}

// How the planes of a clipped column split a ray: from `begin` to `end` it is on one side of them, else on the other.
struct ClipSplit {
    begin: f32,
    end: f32,
    within_is_outer: bool,
    // Azimuths of the walls through which the ray enters the part before, within and behind.
    walls: vec3<u32>,
}

var<private> column: ColumnVisit;
var<private> found: FoundSolid;

// Whether the column's word says that the ray may be in a solid somewhere in the cell. `quad_top` bounds the top of an
// inclined column.
fn may_hit(cell: vec2<i32>, ta: f32, te: f32, quad_top: f32) -> bool {
    let walk = read_plane(WALK_PLANE, u32(cell.y * NODE_CELLS + cell.x));
    let flags = flags_of(walk);
    column = ColumnVisit(walk, vec2<f32>(0.0));
    let high = high_of(walk);
    let low = low_of(walk);
    let rises = node_ray.d.z > 0.0;
    let lower = z_at(select(te, ta, rises));
    let upper = z_at(select(ta, te, rises));
    let meets_one = lower <= select(high, quad_top, (flags & INCLINED) != 0u) && upper >= low;
    let leaves_gap = lower <= low || upper >= high;
    return (flags & OCCUPIED) != 0u && select(meets_one, leaves_gap, (flags & GAP) != 0u);
}

// Makes `found` of the column's next solid that the ray meets, from `walk.solid` on; false if there is none. The column
// is read again for each solid, which is cheaper than to keep it while a solid is gathered.
fn meets(cell: vec2<i32>, ta: f32, te: f32) -> bool {
    let i = u32(cell.y * NODE_CELLS + cell.x);
    let flags = flags_of(column.walk);
    let centre = vec2<f32>(cell) + 0.5;
    let attributes = read_plane(ATTRIBUTE_PLANE, i);
    var strip = 0u;
    if (flags & EXPOSED) != 0u {
        strip = read_plane(STRIP_PLANE, i);
    }
    var clip = 0u;
    if (flags & CLIPPED) != 0u {
        clip = read_word(strip);
    }
    if (flags & INCLINED) != 0u {
        column.slope = slope_codes(attributes);
    }
    let split = clip_split((flags & CLIPPED) != 0u, attributes, clip, centre, ta, te);
    let outer_top = high_of(clip);
    let has_gap = (flags & GAP) != 0u;
    var gap = 0u;
    if has_gap {
        gap = read_word(strip + head_words(flags) - 2u);
    }
    let bounds = bounds_of(column.walk, strip + head_words(flags));
    let z_max = bounds.x;
    let z_min = bounds.y;
    let gap_heights = halves(gap);
    // Each part has two solids in the ray's order; parts that are empty are left out.
    let last = select(6u, 4u, split.end >= te);
    var n = max(walk.solid, select(2u, 0u, split.begin > ta));
    var found_one = false;
    loop {
        if found_one || n >= last {
            break;
        }
        let part = n >> 1u;
        let second = (n & 1u) == 1u;
        let lower = second != (node_ray.d.z > 0.0);
        let outer = (part == 1u) == split.within_is_outer;
        let solid = select(select(UPPER_SOLID, LOWER_SOLID, lower), OUTER_SOLID, outer);
        let missing = (outer && (second || outer_top == 0.0)) || (solid == LOWER_SOLID && !has_gap);
        let s = select(select(split.end, split.begin, part == 1u), ta, part == 0u);
        let e = select(select(te, split.end, part == 1u), split.begin, part == 0u);
        let bottom = select(z_min, gap_heights.y, solid == UPPER_SOLID && has_gap);
        let top = select(select(gap_heights.x, outer_top, outer), z_max, solid == UPPER_SOLID);
        let slope = select(vec2<f32>(0.0), column.slope, solid == UPPER_SOLID);
        let zs = z_at(s);
        let ze = z_at(e);
        let over = vec2<f32>(zs - top_at(s, top, slope, centre), ze - top_at(e, top, slope, centre));
        let span = clip_to_solid(s, e, over, vec2<f32>(zs - bottom, ze - bottom));
        // An eye inside a column (less than half a cell in front of a wall) sees out of it.
        let inside = span.s <= 0.0 && span.face == SIDE_FACE;
        found_one = !missing && s < e && span.s < span.e && !inside;
        found = FoundSolid(span, attributes, strip, solid, split.walls[part], bottom, top, z_min);
        n++;
    }
    walk.solid = n;
    return found_one;
}

// The slope of an inclined column's top, in height codes per cell: the plane rises against its normal.
fn slope_codes(attributes: u32) -> vec2<f32> {
    let n = octahedral(attributes);
    return n.xy * (-codes_per_row(node_ray.z_shift) / max(n.z, MIN_NORMAL_Z));
}

fn top_at(t: f32, z_max: f32, slope: vec2<f32>, centre: vec2<f32>) -> f32 {
    return z_max + dot(slope, node_ray.o.xy + node_ray.d.xy * t - centre);
}

// Highest and lowest point of a column whose strip's texels begin at `texels`.
fn bounds_of(walk: u32, texels: u32) -> vec2<f32> {
    var bounds = walk;
    if (flags_of(walk) & GAP) != 0u {
        bounds = read_word(texels - 1u);
    }
    return vec2<f32>(high_of(bounds), low_of(bounds));
}

// A ray is inside of one plane, or of both planes of a convex corner, for one part of its way; likewise beyond both
// planes of a concave corner.
fn clip_split(clipped: bool, attributes: u32, clip: u32, centre: vec2<f32>, ta: f32, te: f32) -> ClipSplit {
    let concave = (clip & CLIP_CONCAVE) != 0u;
    let side = select(1.0, -1.0, concave);
    var split = ClipSplit(ta, te, concave, vec3<u32>(azimuth_of(attributes)));
    let planes = select(0u, select(1u, 2u, (clip & CLIP_CORNER) != 0u), clipped);
    for (var k = 0u; k < planes; k++) {
        let word = select(attributes, clip, k == 1u);
        let wall = azimuth_of(word);
        let offset = clip_offset_of(word);
        let n = azimuth_direction(wall);
        let a = side * (dot(n, node_ray.o.xy + node_ray.d.xy * ta - centre) - offset);
        let b = side * (dot(n, node_ray.o.xy + node_ray.d.xy * te - centre) - offset);
        let crossing = ta + (te - ta) * (a / (a - b));
        if a > 0.0 && b > 0.0 {
            split.begin = te;
        } else if a > 0.0 && crossing > split.begin {
            split.begin = crossing;
            split.walls.y = wall;
        } else if b > 0.0 && a <= 0.0 && crossing < split.end {
            split.end = crossing;
            split.walls.z = wall;
        }
    }
    // Never within: all of the ray is in the part before, which it enters through the cell's face.
    if split.begin >= split.end {
        split.begin = te;
        split.end = te;
    }
    return split;
}

// The part of `ta` to `te` below the top (`over` <= 0) and above the bottom (`above` >= 0). Both are linear along the
// ray and given at its two ends.
fn clip_to_solid(ta: f32, te: f32, over: vec2<f32>, above: vec2<f32>) -> SolidSpan {
    let none = SolidSpan(1.0, 0.0, SIDE_FACE);
    var span = SolidSpan(ta, te, SIDE_FACE);
    if over.x > 0.0 {
        if over.y > 0.0 {
            return none;
        }
        span.s = ta + (te - ta) * (over.x / (over.x - over.y));
        span.face = TOP_FACE;
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
            span.face = BOTTOM_FACE;
        }
    } else if above.y < 0.0 {
        span.e = min(span.e, ta + (te - ta) * (above.x / (above.x - above.y)));
    }
    return span;
}
