// SPDX-License-Identifier: Apache-2.0
#include "kdray/batches.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "kdray/error.h"
#include "kdray/npy.h"

namespace kdray::client {
namespace {

static_assert(std::endian::native == std::endian::little, "rows are sent as they lie in memory");
static_assert(sizeof(Ray) == 6 * sizeof(double) && sizeof(Vector3) == 3 * sizeof(double));

constexpr std::uint64_t kRowsOfAPart = 1'000'000;

// The server's limit, or ours if it does not tell one.
std::uint64_t RowsOfAPart(Client& client, std::size_t rows) {
  if (rows <= 1000) return rows;  // every server takes these; saves a request
  const auto limit = client.ServiceInfo()["limits"]["max_rays"].Count();
  return std::clamp<std::uint64_t>(limit.value_or(kRowsOfAPart), 1, kRowsOfAPart);
}

// The elements of an answer, which must be an array of this type with one element for each row.
std::string_view Elements(const Answer& answer, const char* descr, std::size_t bytes,
                          std::uint64_t rows) {
  const NpyHeader header = ParseNpyHeader(answer.body);
  const std::string_view data = std::string_view(answer.body).substr(header.data_offset);
  if (header.descr != descr || header.shape.size() != 1 || header.shape[0] != rows ||
      data.size() != rows * bytes) {
    throw ConnectionError("the server's answer is not an array of " + std::to_string(rows) +
                          " elements " + descr);
  }
  return data;
}

// Sends rows of doubles and decodes the answer's elements, each of `bytes` bytes.
template <class Row, class Decode>
void Query(Client& client, const std::string& id, const std::string& query,
           std::span<const Row> rows, Parameters options, const char* descr, std::size_t bytes,
           const Decode& decode) {
  options.emplace_back("dtype", "f8");
  const std::uint64_t columns = sizeof(Row) / sizeof(double);
  const std::uint64_t part = std::max<std::uint64_t>(RowsOfAPart(client, rows.size()), 1);
  while (!rows.empty()) {
    const auto sent = rows.first(std::min<std::uint64_t>(part, rows.size()));
    std::string body = EncodeNpyHeader({.descr = "<f8", .shape = {sent.size(), columns}});
    body.append(reinterpret_cast<const char*>(sent.data()), sent.size_bytes());
    const Answer answer = client.Query(id, query, options, Payload::OfBytes(query, std::move(body)),
                                       "application/x-npy");
    const std::string_view data = Elements(answer, descr, bytes, sent.size());
    for (std::size_t i = 0; i < sent.size(); ++i) decode(data.data() + i * bytes);
    rows = rows.subspan(sent.size());
  }
}

template <class T>
T Take(const char*& bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  bytes += sizeof value;
  return value;
}

// Elements that are one number each.
template <class Wire, class T, class Row>
std::vector<T> Numbers(Client& client, const std::string& id, const std::string& query,
                       std::span<const Row> rows, const Parameters& options, const char* descr) {
  std::vector<T> numbers;
  numbers.reserve(rows.size());
  Query(client, id, query, rows, options, descr, sizeof(Wire),
        [&](const char* bytes) { numbers.push_back(static_cast<T>(Take<Wire>(bytes))); });
  return numbers;
}

}  // namespace

std::vector<Hit> ClosestHits(Client& client, const std::string& id, std::span<const Ray> rays,
                             const Parameters& options) {
  std::vector<Hit> hits;
  hits.reserve(rays.size());
  Parameters all = options;
  all.emplace_back("fields", "t,triangle,u,v");
  Query(client, id, "rays/closest", rays, std::move(all),
        "[('t', '<f8'), ('triangle', '<i8'), ('u', '<f8'), ('v', '<f8')]", 32,
        [&](const char* bytes) {
          Hit& hit = hits.emplace_back();
          hit.t = Take<double>(bytes);
          hit.triangle = Take<std::int64_t>(bytes);
          hit.u = Take<double>(bytes);
          hit.v = Take<double>(bytes);
        });
  return hits;
}

std::vector<std::uint8_t> AnyHits(Client& client, const std::string& id, std::span<const Ray> rays,
                                  const Parameters& options) {
  // `any` has no numbers, but knows `dtype` all the same.
  return Numbers<std::uint8_t, std::uint8_t>(client, id, "rays/any", rays, options, "|b1");
}

std::vector<std::uint64_t> CountHits(Client& client, const std::string& id,
                                     std::span<const Ray> rays, const Parameters& options) {
  return Numbers<std::uint64_t, std::uint64_t>(client, id, "rays/count", rays, options, "<u8");
}

std::vector<ClosestPoint> ClosestPoints(Client& client, const std::string& id,
                                        std::span<const Vector3> points,
                                        const Parameters& options) {
  std::vector<ClosestPoint> found;
  found.reserve(points.size());
  Parameters all = options;
  all.emplace_back("fields", "distance,point,triangle");
  Query(client, id, "points/closest", points, std::move(all),
        "[('distance', '<f8'), ('point', '<f8', (3,)), ('triangle', '<i8')]", 40,
        [&](const char* bytes) {
          ClosestPoint& closest = found.emplace_back();
          closest.distance = Take<double>(bytes);
          closest.point = Take<Vector3>(bytes);
          closest.triangle = Take<std::int64_t>(bytes);
        });
  return found;
}

std::vector<double> SignedDistances(Client& client, const std::string& id,
                                    std::span<const Vector3> points, const Parameters& options) {
  return Numbers<double, double>(client, id, "points/signed-distance", points, options, "<f8");
}

std::vector<Side> Inside(Client& client, const std::string& id, std::span<const Vector3> points,
                         const Parameters& options) {
  return Numbers<std::int8_t, Side>(client, id, "points/inside", points, options, "|i1");
}

}  // namespace kdray::client
