// Shared by the stages of the ray-caster: bindings, overrides, the ray, its hit. CPU twin: src/cpu/ray.rs.

@group(0) @binding(BINDING_FRAME) var<uniform> frame: FrameUniform;
@group(0) @binding(BINDING_GRID) var<storage, read> grid: array<vec2<u32>>;
@group(0) @binding(BINDING_NODES) var<storage, read> nodes: array<DrawNode>;
@group(0) @binding(BINDING_SUMMARIES) var<storage, read> summaries: array<vec4<u32>>;
@group(0) @binding(BINDING_ATLAS) var<storage, read> atlas: array<u32>;
@group(0) @binding(BINDING_COLOUR) var<storage, read_write> pixel_colour: array<u32>;
@group(0) @binding(BINDING_DISTANCE) var<storage, read_write> pixel_distance_m: array<f32>;
@group(0) @binding(BINDING_HIT) var<storage, read_write> pixel_hit: array<u32>;
@group(0) @binding(BINDING_ATLAS_VEC4S) var<storage, read> atlas_vec4s: array<vec4<u32>>;

// Writes the rays' work instead of their colours. Set only to measure.
override COUNT: bool = false;
// Cleared for draw lists without meshes.
override MESHES: bool = true;
// Set for shadings other than SHADING_LIT.
override FOR_STUDY: bool = false;
// Whether walls have lit windows.
override WINDOWS: bool = false;
// Whether objects have colours or are hidden, or the frame shows objects.
override OBJECTS: bool = false;

// Whether anything is added to the city.
override ADDITIONS: bool = false;
// Whether there are meshes with landmarks.
override LANDMARKS: bool = false;
// Whether there are translucency maps.
override TRANSLUCENT: bool = false;

// A part of a ray: from the eye to the visible surface, or from there towards the sun.
struct RaySegment {
    // Relative to the camera, in metres.
    origin: vec3<f32>,
    dir: vec3<f32>,
    reach_m: f32,
    // Distance from the eye to the origin.
    eye_m: f32,
    // Whether this is a shadow segment, which only tests whether anything is in the way.
    to_sun: bool,
}

// The surface that a ray segment has hit. Of a shadow segment, only `is_hit` is set.
struct RayHit {
    is_hit: bool,
    // Linear RGB.
    albedo: vec3<f32>,
    // Share of the sky that it sees, 0 to 1.
    ao: f32,
    normal: vec3<f32>,
    flags: u32,
    level: u32,
    distance_m: f32,
    node: u32,
    // Address of its object's word in a palette, or 0. Only with OBJECTS.
    object: u32,
    // Where the ray towards the sun begins.
    shadow_origin: vec3<f32>,
    // 1 + number of its stone; 0 without. Only with LANDMARKS.
    stone: u32,
    // Place in the stone's pattern, in metres from its origin.
    stone_point: vec3<f32>,
}

// The ray inside of a node: x and y in cells, z in height codes; `t` stays in metres.
struct NodeRay {
    index: u32,
    o: vec3<f32>,
    d: vec3<f32>,
    inv: vec2<f32>,
    // First words of the node's planes in the atlas.
    planes: vec4<u32>,
    z_shift: u32,
    // First of its blocks in `summaries`.
    summary: u32,
    cell_m: f32,
}

var<private> segment: RaySegment;
// Which of two nodes the ray sees where one cross-fades into the other, and which thin columns it hits: 0 to 4,095.
var<private> threshold: u32;
var<private> ray_hit: RayHit;
var<private> node_ray: NodeRay;
// Nodes, entries of the grid, words of summaries and atlas, cells. Only with COUNT.
var<private> counts: vec4<u32>;

// Height of the ray in the node, in codes.
fn z_at(t: f32) -> f32 {
    return node_ray.o.z + node_ray.d.z * t;
}

fn read_word(at: u32) -> u32 {
    if COUNT {
        counts.z++;
    }
    return atlas[at];
}

fn read_vec4(at: u32) -> vec4<u32> {
    if COUNT {
        counts.z++;
    }
    return atlas_vec4s[at];
}

fn read_plane(plane: u32, i: u32) -> u32 {
    return read_word(node_ray.planes[plane] + i);
}
