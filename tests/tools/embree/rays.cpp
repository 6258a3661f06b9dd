// Casts one ray a pixel with Embree 3: rays.cpp's only caller is run.py beside it.
//
// rays TRIANGLES WIDTH HEIGHT ROUNDS THREADS CAMERA...: TRIANGLES has nine floats for each triangle, a CAMERA is
// NAME,X,Y,Z,TARGET_X,TARGET_Y,TARGET_Z,VERTICAL_FIELD_OF_VIEW_DEGREES in the same coordinates, Z up. Prints a line of JSON for each.
#include <embree3/rtcore.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>
#include <thread>
#include <vector>

struct Vec {
  float x, y, z;
};
static Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
static Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
static Vec operator*(Vec a, float s) { return {a.x * s, a.y * s, a.z * s}; }
static float dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
static Vec unit(Vec a) { return a * (1.0f / std::sqrt(dot(a, a))); }

struct Camera {
  std::string name;
  Vec eye, forward, right, up;
};

static const int BAND_ROWS = 16;
static const Vec SUN = unit({-0.45f, -0.55f, 0.71f});

// Light from the sun on what was hit; the sky is as bright as its height.
static float shade(Vec dir, float u, Vec normal, bool is_hit) {
  if (!is_hit) return 0.5f + 0.5f * dir.z;
  Vec n = unit(normal);
  if (dot(n, dir) > 0) n = n * -1.0f;
  return 0.2f + 0.8f * std::max(0.0f, dot(n, SUN)) + 0.0f * u;
}

static Vec direction(const Camera &camera, int x, int y, int width, int height) {
  float right = (x + 0.5f) / width * 2 - 1, down = (y + 0.5f) / height * 2 - 1;
  return unit(camera.forward + camera.right * right - camera.up * down);
}

static void start(RTCRayHit &query, Vec eye, Vec dir) {
  query.ray.org_x = eye.x, query.ray.org_y = eye.y, query.ray.org_z = eye.z;
  query.ray.dir_x = dir.x, query.ray.dir_y = dir.y, query.ray.dir_z = dir.z;
  query.ray.tnear = 0, query.ray.tfar = std::numeric_limits<float>::infinity();
  query.ray.time = 0, query.ray.mask = ~0u, query.ray.flags = 0;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
}

static void single(RTCScene scene, const Camera &camera, int width, int height, int y, float *row) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  for (int x = 0; x < width; x++) {
    Vec dir = direction(camera, x, y, width, height);
    RTCRayHit query;
    start(query, camera.eye, dir);
    rtcIntersect1(scene, &context, &query);
    Vec normal = {query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z};
    row[x] = shade(dir, query.hit.u, normal, query.hit.geomID != RTC_INVALID_GEOMETRY_ID);
  }
}

// Blocks of 4 x 2 pixels.
static void packets(RTCScene scene, const Camera &camera, int width, int height, int y, float *row) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  for (int x = 0; x < width; x += 4) {
    alignas(32) int valid[8];
    RTCRayHit8 query;
    Vec dirs[8];
    for (int i = 0; i < 8; i++) {
      int px = x + i % 4, py = y + i / 4;
      valid[i] = px < width && py < height ? -1 : 0;
      dirs[i] = direction(camera, px, py, width, height);
      query.ray.org_x[i] = camera.eye.x, query.ray.org_y[i] = camera.eye.y, query.ray.org_z[i] = camera.eye.z;
      query.ray.dir_x[i] = dirs[i].x, query.ray.dir_y[i] = dirs[i].y, query.ray.dir_z[i] = dirs[i].z;
      query.ray.tnear[i] = 0, query.ray.tfar[i] = std::numeric_limits<float>::infinity();
      query.ray.time[i] = 0, query.ray.mask[i] = ~0u, query.ray.flags[i] = 0;
      query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect8(valid, scene, &context, &query);
    for (int i = 0; i < 8; i++) {
      if (!valid[i]) continue;
      Vec normal = {query.hit.Ng_x[i], query.hit.Ng_y[i], query.hit.Ng_z[i]};
      row[i / 4 * width + x + i % 4] =
          shade(dirs[i], query.hit.u[i], normal, query.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID);
    }
  }
}

// Seconds of a frame on threads that take bands of rows as they become free.
template <typename Draw>
static double frame(int thread_count, int rows_at_once, int width, int height, std::vector<float> &image, Draw draw) {
  auto begin = std::chrono::steady_clock::now();
  std::atomic<int> next{0};
  auto work = [&] {
    for (int band; (band = next.fetch_add(BAND_ROWS)) < height;)
      for (int y = band; y < std::min(band + BAND_ROWS, height); y += rows_at_once) draw(y, &image[size_t(y) * width]);
  };
  std::vector<std::thread> threads;
  for (int i = 1; i < thread_count; i++) threads.emplace_back(work);
  work();
  for (auto &thread : threads) thread.join();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

int main(int argc, char **argv) {
  if (argc < 8) return 2;
  int width = std::atoi(argv[2]), height = std::atoi(argv[3]), rounds = std::atoi(argv[4]), threads = std::atoi(argv[5]);
  FILE *file = std::fopen(argv[1], "rb");
  if (!file) return 1;
  std::fseek(file, 0, SEEK_END);
  size_t count = std::ftell(file) / 36;
  std::rewind(file);
  // Such as "isa=avx2"; empty: the widest that the processor has.
  RTCDevice device = rtcNewDevice(argv[6]);
  RTCScene scene = rtcNewScene(device);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto *corners = (float *)rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3 * count);
  auto *numbers = (unsigned *)rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, count);
  if (!corners || !numbers || std::fread(corners, 36, count, file) != count) return 1;
  std::fclose(file);
  for (size_t i = 0; i < 3 * count; i++) numbers[i] = unsigned(i);
  rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  auto begin = std::chrono::steady_clock::now();
  rtcCommitScene(scene);
  double build_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  std::vector<float> image(size_t(width) * (height + 1));
  for (int i = 7; i < argc; i++) {
    char name[64];
    float v[7];
    if (std::sscanf(argv[i], "%63[^,],%f,%f,%f,%f,%f,%f,%f", name, v, v + 1, v + 2, v + 3, v + 4, v + 5, v + 6) != 8) return 2;
    Vec eye = {v[0], v[1], v[2]}, forward = unit(Vec{v[3], v[4], v[5]} - eye);
    Vec right = unit(cross(forward, {0, 0, 1})), up = cross(right, forward);
    float tan = std::tan(v[6] * 3.14159265f / 360);
    Camera camera = {name, eye, forward, right * (tan * width / height), up * tan};
    double best_single = 1e9, best_packets = 1e9;
    for (int round = 0; round < rounds; round++) {
      best_single = std::min(best_single, frame(threads, 1, width, height, image, [&](int y, float *row) {
                               single(scene, camera, width, height, y, row);
                             }));
      best_packets = std::min(best_packets, frame(threads, 2, width, height, image, [&](int y, float *row) {
                                packets(scene, camera, width, height, y, row);
                              }));
    }
    double rays = double(width) * height / 1e6;
    std::printf("{\"view\":\"%s\",\"triangles\":%zu,\"build_s\":%.2f,\"single_mrays\":%.2f,\"packets_mrays\":%.2f}\n", name, count,
                build_s, rays / best_single, rays / best_packets);
  }
  rtcReleaseScene(scene);
  rtcReleaseDevice(device);
}
