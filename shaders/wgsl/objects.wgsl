// Objects of what a ray hits: their words in palettes. CPU twin: src/cpu/objects.rs.

// Address of the palette word of the object of the solid that `meets` found; 0 if it has none.
fn object_of_solid(i: u32) -> u32 {
    if !OBJECTS {
        return 0u;
    }
    let objects = nodes[node_ray.index].objects;
    if objects.y == 0u {
        return 0u;
    }
    let word = read_word(objects.x * PAGE_WORDS + i);
    let mask = (1u << OBJECT_BITS) - 1u;
    let roof = word & mask;
    let wall = (word >> OBJECT_BITS) & mask;
    let lower = word >> (2u * OBJECT_BITS);
    let top = found.span.face == TOP_FACE;
    var place = wall;
    if found.solid == OUTER_SOLID || (found.solid == LOWER_SOLID && top) {
        place = lower;
    } else if (found.solid == UPPER_SOLID && top) || wall == 0u {
        place = roof;
    }
    return select(objects.y + place - 1u, 0u, place == 0u);
}

// Address of the palette word of the triangle at `at` (in vec4s) of a mesh; 0 if it has none.
fn object_of_triangle(at: u32, palette: u32) -> u32 {
    if !OBJECTS || palette == 0u {
        return 0u;
    }
    let place = read_vec4(at + 1u).x >> 16u;
    return select(palette + place - 1u, 0u, place == 0u);
}

// Whether rays pass through an object.
fn is_hidden(object: u32) -> bool {
    if !OBJECTS || object == 0u {
        return false;
    }
    return (read_word(object) & PALETTE_HIDDEN) != 0u;
}

// The colour that an object has instead of `albedo`, linear RGB.
fn object_colour(object: u32, albedo: vec3<f32>) -> vec3<f32> {
    if !OBJECTS || object == 0u {
        return albedo;
    }
    let word = read_word(object);
    if (word & PALETTE_COLOURED) != 0u {
        return linear_of(word);
    }
    return albedo;
}
