// Reflection from a rough surface. CPU twin: src/cpu/ward.rs.

// Directions along the grain, across it, and along the normal.
fn axes_of(normal: vec3<f32>, tangent: vec3<f32>) -> mat3x3<f32> {
    let flat = tangent - normal * dot(tangent, normal);
    let along = flat / max(length(flat), 1e-4);
    return mat3x3<f32>(along, cross(normal, along), normal);
}

// Ward's lobe without Fresnel's factor. `i` and `o` are unit vectors in the axes of the surface.
fn ward(alpha: vec2<f32>, i: vec3<f32>, o: vec3<f32>) -> f32 {
    if i.z <= 0.0 || o.z <= 0.0 {
        return 0.0;
    }
    let h = i + o;
    let slope = h.xy / (alpha * h.z);
    let upright = h.z * h.z;
    return exp(-dot(slope, slope)) * dot(h, h) / (0.5 * TAU * alpha.x * alpha.y * upright * upright);
}

fn fresnel(f0: vec3<f32>, cosine: f32) -> vec3<f32> {
    let grazing = clamp(1.0 - cosine, 0.0, 1.0);
    let square = grazing * grazing;
    return f0 + (1.0 - f0) * (square * square * grazing);
}

fn roughness_towards(alpha: vec2<f32>, dir: vec3<f32>) -> f32 {
    let size = dot(dir.xy, dir.xy);
    let along = alpha * dir.xy;
    return sqrt(select(alpha.x * alpha.y, dot(along, along) / max(size, 1e-6), size > 1e-6));
}

// Parts of the lobe's reflectance in all directions together.
fn lobe_reflectance(alpha: f32, cosine: f32) -> vec2<f32> {
    let powers = vec3<f32>(1.0, sqrt(alpha), alpha);
    let steep = (LOBE_FACTOR_3 * cosine + LOBE_FACTOR_2) * cosine + LOBE_FACTOR_1;
    let factor = dot(steep * cosine + LOBE_FACTOR_0, powers);
    let grazing = dot((LOBE_GRAZING_2 * cosine + LOBE_GRAZING_1) * cosine + LOBE_GRAZING_0, powers);
    let square = (1.0 - cosine) * (1.0 - cosine);
    return clamp(vec2<f32>(factor, grazing * square * square), vec2<f32>(0.0), vec2<f32>(1.0));
}

// Light that passes the lobe to the surface below, over 1 less the reflectance from straight ahead; at most.
fn transmitted(alpha: f32, cosine: f32) -> f32 {
    return 1.0 - min(lobe_reflectance(alpha, cosine).y, 1.0 - LOBE_SLACK) - LOBE_SLACK * (1.0 - cosine);
}

fn mean_transmitted(alpha: f32) -> f32 {
    return 1.0 - 0.04 / (1.0 + alpha * (2.2 + 2.7 * alpha));
}

fn scattered(f0: vec3<f32>, alpha: vec2<f32>, i: vec3<f32>, o: vec3<f32>) -> vec3<f32> {
    let way_in = transmitted(roughness_towards(alpha, i), clamp(i.z, MIN_FACING, 1.0));
    let way_out = transmitted(roughness_towards(alpha, o), clamp(o.z, MIN_FACING, 1.0));
    return (1.0 - f0) * (way_in * way_out / mean_transmitted(sqrt(0.5 * dot(alpha, alpha))));
}

fn lobe_occlusion(cosine: f32, open: f32, alpha: f32) -> f32 {
    return clamp(pow(cosine + open, exp2(-16.0 * alpha - 1.0)) - 1.0 + open, 0.0, 1.0);
}

fn openness(ao: f32, height: f32) -> f32 {
    let unknown = UNKNOWN_BELOW * max(-height, 0.0);
    return min((ao + unknown) / (0.5 + 0.5 * height + unknown), 1.0);
}

// Mean radiance of the surroundings in a lobe around `towards`.
fn surroundings(towards: vec3<f32>, alpha: f32, open: f32) -> vec3<f32> {
    let around = reflected_light(towards, open);
    let sharp = mix(around.ground, around.above, clamp(0.5 + towards.z / (3.0 * alpha), 0.0, 1.0));
    let matt = reflected(vec3<f32>(1.0), towards, open * (0.5 + 0.5 * towards.z)).sky;
    return mix(sharp, matt, min(alpha * alpha / MATT_VARIANCE, 1.0));
}

// The side of a stone that is seen.
struct StoneSide {
    normal: vec3<f32>,
    ao: f32,
    // Light of the sun that comes through the stone.
    through: vec3<f32>,
    is_translucent: bool,
}

// Light of a surface of stone that is seen in direction `dir`.
fn reflect_stone(stone: StoneSurface, side: StoneSide, dir: vec3<f32>) -> Radiance {
    let normal = side.normal;
    let ao = side.ao;
    let axes = axes_of(normal, stone.tangent);
    // Times the transposed axes.
    let view = -dir * axes;
    let light = frame.sun * axes;
    let facing = clamp(view.z, MIN_FACING, 1.0);
    let matt = reflected(stone.albedo, normal, ao);
    let towards = dir + normal * (2.0 * max(view.z, 0.0));
    let open = openness(ao, normal.z);
    let roughness = roughness_towards(stone.alpha, view);
    let parts = lobe_reflectance(roughness, facing);
    let seen = surroundings(towards, sqrt(stone.alpha.x * stone.alpha.y), open);
    let mirrored_sky = seen * (stone.f0 * parts.x + parts.y) * lobe_occlusion(facing, open, roughness);
    let share = fresnel(stone.f0, 0.5 * length(view + light));
    let lobe = ward(stone.alpha, light, view) * max(light.z, 0.0) * (0.5 * TAU) * sun_share_by_sky(ao);
    let out = (1.0 - stone.f0) * transmitted(roughness, facing);
    let gloss = frame.light.sun.rgb * share * lobe;
    if side.is_translucent {
        // No ray towards the sun is needed: the map knows where the sun is visible.
        let inside = stone.albedo * frame.light.sun.rgb * side.through;
        return Radiance((matt.sky + inside) * out + mirrored_sky, gloss);
    }
    return Radiance(
        matt.sky * out + mirrored_sky,
        matt.sun * scattered(stone.f0, stone.alpha, light, view) + gloss,
    );
}
