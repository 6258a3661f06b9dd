// Fields of the atlas's words (src/pack.rs). CPU twin: src/cpu/words.rs.

fn flags_of(walk: u32) -> u32 {
    return walk >> FLAGS_SHIFT;
}

// The higher one of a word's two heights, in height codes.
fn high_of(word: u32) -> f32 {
    return f32(word & HEIGHT_MASK);
}

fn low_of(word: u32) -> f32 {
    return f32((word >> HEIGHT_BITS) & HEIGHT_MASK);
}

// Azimuth of a wall's normal, AZIMUTHS to a turn.
fn azimuth_of(word: u32) -> u32 {
    return (word >> AZIMUTH_SHIFT) & (AZIMUTHS - 1u);
}

// Horizontal unit vector.
fn azimuth_direction(azimuth: u32) -> vec2<f32> {
    let angle = f32(azimuth) * (TAU / f32(AZIMUTHS));
    return vec2<f32>(cos(angle), sin(angle));
}

// Distance of a clipping plane from the cell's centre, in cells.
fn clip_offset_of(word: u32) -> f32 {
    return f32(bitcast<i32>(word) >> CLIP_OFFSET_SHIFT) / CLIP_STEPS_PER_CELL;
}

// Whether a column with these flags and attributes is thin.
fn is_thin(flags: u32, attributes: u32) -> bool {
    return (flags & (HOLES | CLIPPED)) == HOLES && (attributes >> CLIP_OFFSET_SHIFT) != 0u;
}

// The code of the share of a thin column's sides, or of its top and underside.
fn thin_share(attributes: u32, side: bool) -> u32 {
    return select(attributes & 0xffu, attributes >> CLIP_OFFSET_SHIFT, side);
}

// Whether a ray is among the share, given as a code, of all rays that hit what they meet in column `i`.
fn hits_share(share: u32, threshold: u32, i: u32) -> bool {
    return (((threshold << 4u) + i * THIN_STEP) & 0xffffu) < share * (share + 2u);
}

// Whether rays pass a texel.
fn is_open(texel: u32) -> bool {
    return (texel & OPAQUE) == 0u;
}

// Share of the sky that a texel sees, 0 to AO_MAX.
fn ao_of(texel: u32) -> f32 {
    return f32(texel >> AO_SHIFT);
}

// Words of a strip in front of its texels.
fn head_words(flags: u32) -> u32 {
    return select(0u, 2u, (flags & CLIPPED) != 0u) + select(0u, 2u, (flags & GAP) != 0u);
}

// Height codes of a strip's row.
fn codes_per_row(z_shift: u32) -> f32 {
    return f32(STEPS_PER_CELL >> z_shift);
}

// Halves of a word, the lower first.
fn halves(word: u32) -> vec2<f32> {
    return vec2<f32>(f32(word & 0xffffu), f32(word >> 16u));
}

// Direction of an octahedral code's two bytes (Cigolle and others 2014).
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
