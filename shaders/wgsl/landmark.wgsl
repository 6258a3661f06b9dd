// The surface of landmarks: smooth normals, occlusion at vertices, and the place in a stone's pattern. CPU twin:
// src/cpu/landmark.rs.

struct LandmarkSurface {
    is_one: bool,
    // Of length 1, on the side that is seen.
    normal: vec3<f32>,
    // Visible share of the sky.
    sky: f32,
    has_sky: bool,
    // 1 + number of the stone, 0 without.
    stone: u32,
    // Origin of the stone's pattern, relative to the camera.
    origin: vec3<f32>,
}

// The smooth normal, turned to the viewer as far as needed.
fn normal_towards(normal: vec3<f32>, dir: vec3<f32>) -> vec3<f32> {
    let facing = -dot(normal, dir);
    if facing >= MIN_FACING_NORMAL {
        return normal;
    }
    return normalize(normal - dir * (MIN_FACING_NORMAL - facing));
}

// Vec4s of a triangle of a mesh with these facts in its head.
fn triangle_stride(info: vec4<u32>) -> u32 {
    return select(2u, 3u, (info.z >> LANDMARK_COUNT_SHIFT) > 0u);
}

// The landmark that the hit triangle belongs to. `turned` is -1 if the triangle is seen from behind.
fn landmark_at(index: u32, info: vec4<u32>, turned: f32) -> LandmarkSurface {
    var surface = LandmarkSurface(false, vec3<f32>(0.0), 0.0, false, 0u, vec3<f32>(0.0));
    let count = info.z >> LANDMARK_COUNT_SHIFT;
    if !LANDMARKS || count == 0u {
        return surface;
    }
    let words = read_vec4(mesh_hit.triangle + 2u);
    let number = words.w & ~LANDMARK_OCCLUSION_BIT;
    if number == 0u || number > count {
        return surface;
    }
    let entry = read_vec4(nodes[index].mesh - 1u + HEAD_VEC4S + (number - 1u) * LANDMARK_VEC4S);
    let a = unpack_normal(words.x);
    let b = unpack_normal(words.y);
    let c = unpack_normal(words.z);
    let normal = (a + (b - a) * mesh_hit.u + (c - a) * mesh_hit.v) * turned;
    let length_squared = dot(normal, normal);
    let sky = vec3<f32>(words.xyz >> vec3<u32>(24u)) / 255.0;
    surface.is_one = true;
    surface.normal = select(a * turned, normal * inverseSqrt(length_squared), length_squared > 1e-12);
    surface.sky = sky.x + (sky.y - sky.x) * mesh_hit.u + (sky.z - sky.x) * mesh_hit.v;
    surface.has_sky = (words.w & LANDMARK_OCCLUSION_BIT) != 0u;
    surface.stone = entry.x;
    let corner = vec3<f32>(nodes[index].corner_and_cell_m.xy, nodes[index].mesh_z_m);
    surface.origin = corner + bitcast<vec3<f32>>(entry.yzw);
    return surface;
}

// The unit vector of an octahedral normal.
fn unpack_normal(word: u32) -> vec3<f32> {
    let at = vec2<f32>(f32(word & 0xfffu), f32((word >> 12u) & 0xfffu)) * (2.0 / 4095.0) - 1.0;
    let z = 1.0 - abs(at.x) - abs(at.y);
    let fold = max(-z, 0.0);
    let folded = select(at + fold, at - fold, at >= vec2<f32>(0.0));
    return normalize(vec3<f32>(folded, z));
}

// Light of a surface of stone. Studies see the stone's colour as that of other surfaces.
fn light_of_stone(hit: RayHit, normal: vec3<f32>, dir: vec3<f32>) -> Radiance {
    let pixel = 2.0 * length(frame.up) / f32(frame.height_px * max(frame.samples, 1u));
    let cosine = sqrt(max(abs(dot(normal, dir)), MIN_COSINE));
    let footprint_m = hit.distance_m * pixel / cosine;
    let found = stone_surface(frame.stones[hit.stone - 1u], hit.stone_point, normal, hit.ao, footprint_m);
    if !FOR_STUDY || frame.shading == SHADING_LIT {
        var side = StoneSide(normal, hit.ao, vec3<f32>(0.0), false);
        if TRANSLUCENT {
            let point = dir * hit.distance_m;
            let map = map_of(point - hit.stone_point);
            if map > 0u {
                side.through = gathered(map - 1u, point);
                side.is_translucent = true;
            }
        }
        return reflect_stone(found, side, dir);
    }
    return shade(found.albedo, hit.ao, normal, hit.flags, hit.level);
}

fn has_stone(hit: RayHit) -> bool {
    return LANDMARKS && hit.stone > 0u && hit.stone <= MAX_STONES && frame.stones[hit.stone - 1u].kind != 0u;
}
