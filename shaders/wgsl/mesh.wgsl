// Hits of a ray on a leaf that is drawn as a mesh. CPU twin: src/cpu/mesh.rs.

// The ray in steps of the mesh's grid; `t` stays in metres.
struct MeshRay {
    o: vec3<f32>,
    inv: vec3<f32>,
    // First word of the palette, 0 without one.
    palette: u32,
    // Vec4s of a triangle.
    stride: u32,
    // Number of the longest axis of the direction.
    axis: u32,
    // Factors of the coordinate on that axis in the two others, which turn points from the origin on into a picture in which the
    // ray is a point, and its factor in `t`.
    shear: vec3<f32>,
    // Sign of the second coordinate of that picture.
    side: f32,
}

// The nearest triangle so far.
struct MeshHit {
    t: f32,
    // Its address in the atlas, in vec4s; 0 if there is none.
    triangle: u32,
    u: f32,
    v: f32,
    is_front: bool,
    // Address of its object's word in the palette, or 0.
    object: u32,
}

// A half of the tree that is still to be visited, and where the ray enters it.
struct PendingHalf {
    reference: u32,
    t: f32,
}

var<private> mesh_ray: MeshRay;
var<private> mesh_hit: MeshHit;

// Gathers what is added to the city where it is nearer than what was hit in the grid.
fn walk_additions() {
    for (var k = 0u; k < frame.additions.y; k++) {
        if segment.to_sun && ray_hit.is_hit {
            return;
        }
        walk_mesh(frame.additions.x + k);
    }
}

fn walk_mesh(index: u32) {
    if COUNT {
        counts.x++;
    }
    let head = nodes[index].mesh - 1u;
    let grid_corner = bitcast<vec4<f32>>(read_vec4(head));
    let info = read_vec4(head + 1u);
    let whole = read_vec4(head + 2u);
    let step_m = grid_corner.w;
    let zero = vec3<f32>(nodes[index].corner_and_cell_m.xy, nodes[index].mesh_z_m) + grid_corner.xyz;
    let o = (segment.origin - zero) / step_m;
    var d = segment.dir / step_m;
    d = select(d, vec3<f32>(MIN_DIRECTION), abs(d) < vec3<f32>(MIN_DIRECTION));
    set_mesh_ray(o, d);
    mesh_ray.palette = whole.w;
    mesh_ray.stride = triangle_stride(info);
    let span = box_span(whole);
    let reach_m = select(segment.reach_m, ray_hit.distance_m, ray_hit.is_hit);
    if span.x > span.y || span.x > reach_m {
        return;
    }
    mesh_hit = MeshHit(min(reach_m, span.y + 1.0), 0u, 0.0, 0.0, true, 0u);
    nearest_triangle(info.x);
    if mesh_hit.triangle == 0u {
        return;
    }
    if segment.to_sun {
        ray_hit.is_hit = true;
        return;
    }
    hit_triangle(index, step_m, info);
}

// Shears along the longest axis of `d`, so that coordinates do not grow (Woop, Benthin and Wald 2013).
fn set_mesh_ray(o: vec3<f32>, d: vec3<f32>) {
    let inv = 1.0 / d;
    let length = abs(d);
    mesh_ray.o = o;
    mesh_ray.inv = inv;
    // The cross product of the two other axes points along the ray.
    if length.z >= max(length.x, length.y) {
        mesh_ray.axis = 2u;
        mesh_ray.side = sign(d.z);
        mesh_ray.shear = vec3<f32>(d.x * inv.z, mesh_ray.side * d.y * inv.z, inv.z);
    } else if length.y >= length.x {
        mesh_ray.axis = 1u;
        mesh_ray.side = -sign(d.y);
        mesh_ray.shear = vec3<f32>(d.x * inv.y, mesh_ray.side * d.z * inv.y, inv.y);
    } else {
        mesh_ray.axis = 0u;
        mesh_ray.side = sign(d.x);
        mesh_ray.shear = vec3<f32>(d.y * inv.x, mesh_ray.side * d.z * inv.x, inv.x);
    }
}

// A point's two coordinates across the ray, and the one along the longest axis.
fn sheared(corner: vec3<f32>) -> vec3<f32> {
    let p = corner - mesh_ray.o;
    let q = select(select(p.yzx, p.xzy, mesh_ray.axis == 1u), p, mesh_ray.axis == 2u);
    return vec3<f32>(q.x - mesh_ray.shear.x * q.z, mesh_ray.side * q.y - mesh_ray.shear.y * q.z, q.z);
}

// The interval of the ray inside a box, in metres. Empty if the first value is larger.
fn box_span(words: vec4<u32>) -> vec2<f32> {
    let low = (vec3<f32>(words.xyz & vec3<u32>(0xffffu)) - BOX_SLACK - mesh_ray.o) * mesh_ray.inv;
    let high = (vec3<f32>(words.xyz >> vec3<u32>(16u)) + BOX_SLACK - mesh_ray.o) * mesh_ray.inv;
    let begin = min(low, high);
    let end = max(low, high);
    return vec2<f32>(max(max(max(begin.x, begin.y), begin.z), 0.0), min(min(end.x, end.y), end.z));
}

// Sets `mesh_hit` to the nearest triangle, or towards the sun to any triangle.
fn nearest_triangle(root: u32) {
    var stack: array<PendingHalf, TRAVERSAL_STACK>;
    var height = 0u;
    var reference = root;
    loop {
        let count = reference >> REFERENCE_COUNT_SHIFT;
        let at = reference & REFERENCE_MASK;
        if count > 0u {
            for (var k = 0u; k < count; k++) {
                test_triangle(at + mesh_ray.stride * k);
            }
            if segment.to_sun && mesh_hit.triangle != 0u {
                return;
            }
        } else {
            let a = read_vec4(at);
            let b = read_vec4(at + 1u);
            let span_a = box_span(a);
            let span_b = box_span(b);
            let meets_a = span_a.x <= span_a.y && span_a.x <= mesh_hit.t;
            let meets_b = span_b.x <= span_b.y && span_b.x <= mesh_hit.t;
            let a_first = meets_a && (!meets_b || span_a.x <= span_b.x);
            if meets_a && meets_b && height < TRAVERSAL_STACK {
                stack[height].reference = select(a.w, b.w, a_first);
                stack[height].t = select(span_a.x, span_b.x, a_first);
                height++;
            }
            if meets_a || meets_b {
                reference = select(b.w, a.w, a_first);
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
        reference = stack[height].reference;
    }
}

// A triangle's corners, in steps of the mesh's grid.
struct TriangleCorners {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
}

fn unpack_corners(words: vec4<u32>, last: u32) -> TriangleCorners {
    let low = vec4<f32>(words & vec4<u32>(0xffffu));
    let high = vec4<f32>(words >> vec4<u32>(16u));
    let c = vec3<f32>(low.w, high.w, f32(last & 0xffffu));
    return TriangleCorners(vec3<f32>(low.x, high.x, low.y), vec3<f32>(high.y, low.z, high.z), c);
}

// Watertight, from both sides (Woop, Benthin and Wald 2013, "Watertight ray/triangle intersection"): both triangles at an
// edge compute the same two products of its ends, so a ray that passes one of them within rounding meets the other.
// Comparisons with a NaN are false.
fn test_triangle(at: u32) {
    if COUNT {
        counts.w++;
    }
    let corners = unpack_corners(read_vec4(at), read_vec4(at + 1u).x);
    let a = sheared(corners.a);
    let b = sheared(corners.b);
    let c = sheared(corners.c);
    let x = vec3<f32>(a.x, b.x, c.x);
    let y = vec3<f32>(a.y, b.y, c.y);
    let products = x.yzx * y.zxy;
    let others = y.yzx * x.zxy;
    let sides = products - others;
    let slack = (abs(products) + abs(others)) * EDGE_SLACK;
    let is_back = all(sides + slack >= vec3<f32>(0.0));
    let is_front = all(sides - slack <= vec3<f32>(0.0));
    // Both: the ray sees the triangle edge-on, and meets its neighbours.
    if is_back == is_front {
        return;
    }
    var weights = max(select(sides, -sides, is_front), vec3<f32>(0.0));
    weights *= 1.0 / (weights.x + weights.y + weights.z);
    let t = (weights.x * a.z + weights.y * b.z + weights.z * c.z) * mesh_ray.shear.z;
    let tie = TIE_M + TIE_SHARE * t;
    if !(t >= 0.0 && t < mesh_hit.t + tie) {
        return;
    }
    let object = object_of_triangle(at, mesh_ray.palette);
    if is_hidden(object) {
        return;
    }
    let found = MeshHit(t, at, weights.y, weights.z, is_front, object);
    if t < mesh_hit.t - tie || wins_tie(found) {
        mesh_hit = found;
    }
}

// Which of two triangles at nearly the same place is seen.
fn wins_tie(found: MeshHit) -> bool {
    if found.is_front != mesh_hit.is_front {
        return found.is_front;
    }
    let a = normal_of(found.triangle);
    let b = normal_of(mesh_hit.triangle);
    let turn = cross(a, b);
    let in_one_plane = dot(turn, turn) <= PLANE_SINE_SQUARED * dot(a, a) * dot(b, b);
    return select(found.t < mesh_hit.t, found.triangle < mesh_hit.triangle, in_one_plane);
}

// A triangle's normal, as long as twice its area.
fn normal_of(at: u32) -> vec3<f32> {
    let corners = unpack_corners(read_vec4(at), read_vec4(at + 1u).x);
    return cross(corners.b - corners.a, corners.c - corners.a);
}

// Gathers the triangle that was hit. Nothing is visible behind it.
fn hit_triangle(index: u32, step_m: f32, info: vec4<u32>) {
    let carried = read_vec4(mesh_hit.triangle + 1u);
    let corners = unpack_corners(read_vec4(mesh_hit.triangle), carried.x);
    let across = cross(corners.b - corners.a, corners.c - corners.a);
    let turned = select(-1.0, 1.0, dot(across, segment.dir) < 0.0);
    let area = length(across);
    let flat = select(-segment.dir, across * turned / area, area > 0.0);
    let t = mesh_hit.t;
    let p = segment.origin + segment.dir * t;
    let u = mesh_hit.u;
    let v = mesh_hit.v;
    var albedo = vec3<f32>(0.0);
    if info.y == 0u {
        let a = linear_of(carried.y);
        albedo = a + (linear_of(carried.z) - a) * u + (linear_of(carried.w) - a) * v;
    } else {
        let size = halves(info.y);
        let a = halves(carried.y) / 65535.0 * size;
        let e1 = halves(carried.z) / 65535.0 * size - a;
        let e2 = halves(carried.w) / 65535.0 * size - a;
        let texels_per_m = sqrt(abs(e1.x * e2.y - e1.y * e2.x) / max(area * step_m * step_m, 1e-12));
        let pixel = 2.0 * length(frame.up) / f32(frame.height_px * max(frame.samples, 1u));
        let cosine = sqrt(max(abs(dot(flat, segment.dir)), MIN_COSINE));
        let level = log2(max(t * pixel * texels_per_m / cosine, 1.0));
        albedo = sample_texture(info, (a + e1 * u + e2 * v) / size, level);
    }
    var light = SurfaceLight(INSIDE_AO, false);
    let landmark = landmark_at(index, info, turned);
    if landmark.has_sky {
        light = SurfaceLight(landmark.sky, false);
    } else if mesh_hit.is_front || !is_inside(index, p, flat) {
        light = surface_light(index, p, flat);
    }
    let flags = MESH_FLAG | select(0u, REFLECTIVE, light.is_reflective);
    let shadow_origin = p + flat * (MESH_LIFT_M + MESH_LIFT_SHARE * t);
    var normal = flat;
    if landmark.is_one {
        normal = normal_towards(landmark.normal, segment.dir);
    }
    var colour = object_colour(mesh_hit.object, albedo);
    if FOR_STUDY && (frame.shading == SHADING_WIRE || frame.shading == SHADING_TRIANGLES) {
        colour = shown_triangle(corners, step_m);
    }
    // A colour of an object replaces its stone.
    let stone = select(0u, landmark.stone, all(colour == albedo));
    let level = nodes[index].level;
    ray_hit = RayHit(
        true, colour, light.sky, normal, flags, level, t, index, mesh_hit.object, shadow_origin, stone, p - landmark.origin,
    );
}

// Colour of the triangle that was hit in SHADING_WIRE and SHADING_TRIANGLES.
fn shown_triangle(corners: TriangleCorners, step_m: f32) -> vec3<f32> {
    if frame.shading == SHADING_TRIANGLES {
        return triangle_tint(corners);
    }
    let ab = corners.b - corners.a;
    let ac = corners.c - corners.a;
    let p = ab * mesh_hit.u + ac * mesh_hit.v;
    let nearest = min(min(distance_to(p, ab), distance_to(p, ac)), distance_to(p - ab, ac - ab));
    let pixel_m = mesh_hit.t * 2.0 * length(frame.up) / f32(frame.height_px);
    return mix(WIRE_SURFACE, WIRE_LINE, max(1.0 - nearest * step_m / pixel_m, 0.0));
}

// How far the ray through `p` passes a line through the origin.
fn distance_to(p: vec3<f32>, along: vec3<f32>) -> f32 {
    let across = cross(segment.dir, along);
    return abs(dot(p, across)) / max(length(across), 1e-12);
}

// A colour that follows from the place of a triangle in its mesh.
fn triangle_tint(corners: TriangleCorners) -> vec3<f32> {
    let parts = vec3<u32>(corners.a + corners.b * 3.0 + corners.c * 7.0) * vec3<u32>(73856093u, 19349663u, 83492791u);
    let mixed = parts.x ^ parts.y ^ parts.z;
    return unpack4x8unorm(mixed ^ (mixed >> 13u)).rgb * 0.8 + 0.1;
}
