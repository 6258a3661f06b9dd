/** How casts are drawn by WebGL 2. */

/** Nothing was hit. Compilers may take infinity for impossible. */
const NOTHING = '!(metres < 1e9)';

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
uniform sampler2D colours;
uniform sampler2D distances;
uniform mat4 castToClip;
uniform vec2 tangents;
uniform vec4 lowest;
vec3 beside(vec2 place, float metres) {
  return normalize(vec3(place * tangents, 1.0)) * metres;
}
bool isShown(vec3 position) {
  return dot(lowest, vec4(position, 1.0)) >= 0.0;
}
`;

/** From where a cast was made: a triangle that contains the screen. */
export const STILL = {
  vertex: `#version 300 es
precision highp float;
out vec2 at;
void main() {
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(at, 0.0, 1.0);
}`,
  fragment: `${HEAD}
uniform mat3 viewToCast;
in vec2 at;
out vec4 colour;
void main() {
  vec3 ray = viewToCast * vec3(at, 1.0);
  vec2 place = ray.xy / ray.z;
  vec2 share = vec2(0.5 + 0.5 * place.x, 0.5 - 0.5 * place.y);
  if (ray.z <= 0.0 || any(lessThan(share, vec2(0.0))) || any(greaterThanEqual(share, vec2(1.0)))) discard;
  float metres = texelFetch(distances, ivec2(share * vec2(textureSize(distances, 0))), 0).r;
  if (${NOTHING}) discard;
  vec3 position = beside(place, metres);
  if (!isShown(position)) discard;
  vec4 clip = castToClip * vec4(position, 1.0);
  float depth = 0.5 + 0.5 * clip.z / clip.w;
  if (clip.w <= 0.0 || depth < 0.0) discard;
  gl_FragDepth = gl_DepthRange.near + gl_DepthRange.diff * min(depth, 1.0);
  colour = vec4(textureLod(colours, share, 0.0).rgb, 1.0);
}`,
};

/** Points of an instance, where they are drawn in instances. */
export const RUN = 1024;

/** Most points: a cast with more pixels is thinned. */
const MAX_POINTS = 1 << 18;

/**
 * Every how manieth pixel of a cast becomes a point, and the number of these.
 * @param {{width: number, height: number}} cast
 */
export function pointsOf({ width, height }) {
  const stride = Math.ceil(Math.sqrt((width * height) / MAX_POINTS));
  return { stride, count: Math.ceil(width / stride) * Math.ceil(height / stride) };
}

/** From elsewhere: a point for each pixel of a cast, where its surface is. */
export const MOVED = {
  vertex: `${HEAD}
uniform float pointSize;
uniform int stride;
flat out vec3 rgb;
void main() {
  ivec2 size = textureSize(distances, 0);
  int number = gl_VertexID + gl_InstanceID * ${RUN};
  int across = (size.x + stride - 1) / stride;
  ivec2 pixel = ivec2(number % across, number / across) * stride;
  float metres = all(lessThan(pixel, size)) ? texelFetch(distances, pixel, 0).r : 1e30;
  vec2 share = (vec2(pixel) + 0.5) / vec2(size);
  rgb = textureLod(colours, share, 0.0).rgb;
  vec2 place = vec2(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y);
  vec3 position = beside(place, metres);
  gl_Position = castToClip * vec4(position, 1.0);
  if (${NOTHING} || !isShown(position)) gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
  float before = metres / length(vec3(place * tangents, 1.0));
  gl_PointSize = clamp(pointSize * before / max(gl_Position.w, 1e-3), 1.0, 64.0);
}`,
  fragment: `#version 300 es
precision highp float;
flat in vec3 rgb;
out vec4 colour;
void main() {
  colour = vec4(rgb, 1.0);
}`,
};

/** Points overlap by this share, so that a surface that is seen from another side has fewer holes. */
export const OVERLAP = 1.5;
/** Eyes that are nearer to each other than this are the same. */
export const SAME_EYE_M = 0.01;
