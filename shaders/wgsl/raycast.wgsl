// Casts the rays of a frame. CPU twin: src/cpu/raycast.rs.
//
// In: frame, grid, nodes, summaries, atlas. Out: colour, distance, hit. Next: compose.wgsl, hit_counts.wgsl or
// read-back.

struct TracedRay {
    rgb: vec3<f32>,
    distance_m: f32,
    node: u32,
    // Address of its object's word in a palette, or 0.
    object: u32,
    is_outlined: bool,
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
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
    var outlined = 0u;
    var object = 0u;
    // The sun's disc. The rays go to points on a spiral over it.
    let across = vec3<f32>(-frame.light.side.y, frame.light.side.x, 0.0) * frame.sun_radius;
    let along = cross(across, frame.sun);
    let angle = TAU * gradient_noise(id);
    var turn = vec2<f32>(cos(angle), sin(angle));
    airlight = low_sky(ray_direction(vec2<f32>(id) + 0.5));
    var rays = n * n;
    for (var s = 0u; s < rays; s++) {
        // Rays beyond those of the pixel go through the centres of its neighbours.
        let is_own = s < n * n;
        let neighbour = select(neighbour_of(s), vec2<i32>(0), is_own);
        let place = select(vec2<u32>(0u), sample, is_own);
        let offset = (vec2<f32>(place) + 0.5) / f32(n) + vec2<f32>(neighbour);
        threshold = threshold_of(id + bitcast<vec2<u32>>(neighbour), n, place);
        let sun = frame.sun + (across * turn.x + along * turn.y) * sqrt((f32(s) + 0.5) / f32(n * n));
        turn = vec2<f32>(turn.x * GOLDEN_COS - turn.y * GOLDEN_SIN, turn.x * GOLDEN_SIN + turn.y * GOLDEN_COS);
        let traced = trace(ray_direction(vec2<f32>(id) + offset), sun);
        outlined += select(0u, 1u, traced.is_outlined);
        if OBJECTS && !is_own {
            continue;
        }
        sum += traced.rgb;
        // One ray alone cannot disagree with others about an object.
        if OBJECTS && n == 1u && traced.is_outlined {
            rays = 5u;
        }
        if s == n * n / 2u {
            pixel_distance_m[at] = traced.distance_m;
            pixel_hit[at] = traced.node;
            object = traced.object;
        }
        // Without a division: lavapipe divides lane by lane.
        sample = select(vec2<u32>(sample.x + 1u, sample.y), vec2<u32>(0u, sample.y + 1u), sample.x + 1u == n);
    }
    // The outline of an object is where the rays of a pixel disagree about it.
    let rgb = select(sum / f32(n * n), OUTLINE_RGB, OBJECTS && outlined > 0u && outlined < rays);
    if FOR_STUDY && frame.shading == SHADING_OBJECTS {
        pixel_colour[at] = object;
    } else if FOR_STUDY && frame.shading != SHADING_LIT {
        pixel_colour[at] = encode_srgb(rgb);
    } else {
        pixel_colour[at] = encode_radiance(rgb);
    }
    if COUNT {
        pixel_colour[at] = counts.x | (counts.y << 16u);
        pixel_distance_m[at] = f32(counts.z);
        pixel_hit[at] = counts.w;
    }
}

// Lanes that run in step are neighbours: two pixels wide and four high with 8 lanes, 8 wide and 4 high with 32. A city
// varies less along a column of pixels than along a row, so these rays do similar work. The odd rows of workgroups come
// in the second half of the dispatch, so that a device that splits it in two (lavapipe on two cores) gets as much sky
// in either half.
fn pixel_of(group: vec2<u32>, rows: u32, lane: u32) -> vec2<u32> {
    let half = (rows + 1u) / 2u;
    let row = select(group.y * 2u, (group.y - half) * 2u + 1u, group.y >= half);
    let within = vec2<u32>((lane & 1u) + ((lane >> 3u) & 3u) * 2u, ((lane >> 1u) & 3u) + (lane >> 5u) * 4u);
    return vec2<u32>(group.x, row) * vec2<u32>(WORKGROUP_X, WORKGROUP_Y) + within;
}

fn threshold_of(pixel: vec2<u32>, samples: u32, sample: vec2<u32>) -> u32 {
    let p = pixel * samples + sample + vec2<u32>(0u, samples / 2u);
    return (order_of(p) << 6u) | order_of(p >> vec2<u32>(3u));
}

// The order of a place in a pattern of 8 x 8.
fn order_of(p: vec2<u32>) -> u32 {
    let a = p.x ^ p.y;
    let low = ((a & 4u) >> 1u) | ((p.y & 4u) >> 2u);
    return ((a & 1u) << 5u) | ((p.y & 1u) << 4u) | ((a & 2u) << 2u) | ((p.y & 2u) << 1u) | low;
}

// Neighbours of a pixel, by the number of the ray from 1 to 4: to the left, to the right, above and below.
fn neighbour_of(ray: u32) -> vec2<i32> {
    let step = select(1, -1, (ray & 1u) == 1u);
    return select(vec2<i32>(0, step), vec2<i32>(step, 0), ray <= 2u);
}

fn ray_direction(p_px: vec2<f32>) -> vec3<f32> {
    let ndc = p_px / vec2<f32>(f32(frame.width_px), f32(frame.height_px)) * 2.0 - 1.0;
    return normalize(frame.forward + frame.right * ndc.x - frame.up * ndc.y);
}

// Both segments share one loop, so that the walk's code exists only once.
fn trace(dir: vec3<f32>, sun: vec3<f32>) -> TracedRay {
    let infinity = bitcast<f32>(infinity_bits());
    var seen = RayHit();
    var light = Radiance();
    var sun_share = 1.0;
    segment = RaySegment(vec3<f32>(0.0), dir, infinity, 0.0, false);
    loop {
        ray_hit = RayHit();
        ray_hit.distance_m = infinity;
        ray_hit.node = NO_NODE;
        if frame.levels != 0u {
            walk_grid();
        }
        if ADDITIONS {
            walk_additions();
        }
        if segment.to_sun {
            sun_share = select(1.0, 0.0, ray_hit.is_hit);
            break;
        }
        seen = ray_hit;
        seen.ao = max(seen.ao, frame.light.sky_up.w);
        var eye_m = seen.distance_m;
        if seen.is_hit {
            light = radiance_of(seen, dir);
        } else {
            light = background(dir);
            eye_m = ground_distance(dir);
            seen.shadow_origin = dir * eye_m + vec3<f32>(0.0, 0.0, SUN_LIFT_M);
        }
        if frame.shadow_m <= 0.0 || all(light.sun <= vec3<f32>(0.0)) || eye_m >= NO_GROUND_M {
            break;
        }
        let origin = floor(seen.shadow_origin * ORIGINS_PER_M + 0.5) / ORIGINS_PER_M;
        segment = RaySegment(origin, sun, frame.shadow_m, eye_m, true);
    }
    var is_outlined = false;
    if OBJECTS && seen.object != 0u {
        is_outlined = (read_word(seen.object) & PALETTE_OUTLINED) != 0u;
    }
    return TracedRay(light.sky + light.sun * sun_share, seen.distance_m, seen.node, seen.object, is_outlined);
}

fn radiance_of(hit: RayHit, dir: vec3<f32>) -> Radiance {
    let length_squared = dot(hit.normal, hit.normal);
    var normal = select(-dir, hit.normal * inverseSqrt(length_squared), length_squared > 1e-12);
    var lit = Radiance();
    var share = 0.0;
    if is_bare(hit.albedo) {
        share = sea_share(dir * hit.distance_m, normal.z);
    }
    if share >= 1.0 {
        return sea(dir, hit.distance_m);
    }
    if has_stone(hit) {
        lit = light_of_stone(hit, normal, dir);
    } else {
        normal = lit_normal(hit.albedo, normal);
        lit = shade(with_sea_albedo(hit.albedo, normal.z, hit.flags), hit.ao, normal, hit.flags, hit.level);
    }
    if !FOR_STUDY || frame.shading == SHADING_LIT {
        if frame.light.street.w > 0.0 {
            lit.sky += lamp_light(hit, normal, dir * hit.distance_m);
        }
        if (hit.flags & REFLECTIVE) != 0u {
            lit = mirrored(lit, normal, hit.ao, dir, hit.distance_m);
        }
        if WINDOWS {
            lit.sky += lit_windows(dir * hit.distance_m, normal, hit.distance_m);
        }
    }
    lit = apply_haze(lit, dir, hit.distance_m);
    if share > 0.0 {
        return coast(lit, share, dir, hit.distance_m);
    }
    return lit;
}

// WGSL has no constant for infinity: these bits are made so that no compiler can fold them.
fn infinity_bits() -> u32 {
    return 0x7f800000u + bitcast<u32>(frame.light.zero);
}
