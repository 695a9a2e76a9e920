// SPDX-License-Identifier: Apache-2.0
#include "core/store/tradeoff_file.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/store/checked_file.h"
#include "core/store/facts_codec.h"

namespace kdray::core {
namespace {

// Increment the version when the layout, or the meaning of a number, changes.
constexpr FileKind kTradeoffFileKind{"kdraytrd", 2};

void Put(const ErrorRate& rate, CheckedWriter* writer) {
  writer->Put(rate.count);
  writer->Put(rate.rays);
}
ErrorRate GetRate(CheckedReader* reader) {
  ErrorRate rate;
  rate.count = reader->Get<std::uint64_t>();
  rate.rays = reader->Get<std::uint64_t>();
  return rate;
}

void Put(const Accuracy& accuracy, CheckedWriter* writer) {
  PutEnum(accuracy.precision, writer);
  PutBool(accuracy.leaks.has_value(), writer);
  if (accuracy.leaks) Put(*accuracy.leaks, writer);
  Put(accuracy.wrong_triangles, writer);
  Put(accuracy.unconnected_triangles, writer);
  Put(accuracy.folds, writer);
  Put(accuracy.missed_hits, writer);
  Put(accuracy.extra_hits, writer);
  writer->Put(accuracy.t_error.rays);
  writer->Put(accuracy.t_error.p999);
  writer->Put(accuracy.t_error.max);
}
Accuracy GetAccuracy(CheckedReader* reader) {
  Accuracy accuracy;
  accuracy.precision = GetEnum<Precision>(reader);
  if (GetBool(reader)) accuracy.leaks = GetRate(reader);
  accuracy.wrong_triangles = GetRate(reader);
  accuracy.unconnected_triangles = GetRate(reader);
  accuracy.folds = GetRate(reader);
  accuracy.missed_hits = GetRate(reader);
  accuracy.extra_hits = GetRate(reader);
  accuracy.t_error.rays = reader->Get<std::uint64_t>();
  accuracy.t_error.p999 = reader->Get<double>();
  accuracy.t_error.max = reader->Get<double>();
  return accuracy;
}

void Put(const Steps& steps, CheckedWriter* writer) {
  writer->Put(steps.rays);
  writer->Put(steps.nodes);
  writer->Put(steps.triangles);
}
Steps GetSteps(CheckedReader* reader) {
  Steps steps;
  steps.rays = reader->Get<std::uint64_t>();
  steps.nodes = reader->Get<double>();
  steps.triangles = reader->Get<double>();
  return steps;
}

void Put(const MeasuredBuild& build, CheckedWriter* writer) {
  PutEnum(build.build, writer);
  writer->Put(build.build_ms);
  writer->Put(build.bytes);
  writer->Put(build.sah_cost);
  Put(build.random, writer);
  Put(build.aimed, writer);
}
MeasuredBuild GetBuild(CheckedReader* reader) {
  MeasuredBuild build;
  build.build = GetEnum<BuildKind>(reader);
  build.build_ms = reader->Get<double>();
  build.bytes = reader->Get<std::uint64_t>();
  build.sah_cost = reader->Get<double>();
  build.random = GetSteps(reader);
  build.aimed = GetSteps(reader);
  return build;
}

void Put(const Speed& speed, CheckedWriter* writer) {
  writer->Put(speed.rays_per_s);
  writer->Put(speed.slowest);
  writer->Put(speed.fastest);
}
Speed GetSpeed(CheckedReader* reader) {
  Speed speed;
  speed.rays_per_s = reader->Get<double>();
  speed.slowest = reader->Get<double>();
  speed.fastest = reader->Get<double>();
  return speed;
}

void Put(const MeasuredPair& pair, CheckedWriter* writer) {
  PutEnum(pair.build, writer);
  PutEnum(pair.precision, writer);
  Put(pair.random, writer);
  Put(pair.aimed, writer);
  Put(pair.differences, writer);
}
MeasuredPair GetPair(CheckedReader* reader) {
  MeasuredPair pair;
  pair.build = GetEnum<BuildKind>(reader);
  pair.precision = GetEnum<Precision>(reader);
  pair.random = GetSpeed(reader);
  pair.aimed = GetSpeed(reader);
  pair.differences = GetRate(reader);
  return pair;
}

template <class T>
void PutAll(const std::vector<T>& values, CheckedWriter* writer) {
  writer->Put(static_cast<std::uint8_t>(values.size()));
  for (const T& value : values) Put(value, writer);
}
template <class T>
std::vector<T> GetAll(T (*get)(CheckedReader*), CheckedReader* reader) {
  std::vector<T> values(reader->Get<std::uint8_t>());
  for (T& value : values) value = get(reader);
  return values;
}

}  // namespace

Result<NewBlob> WriteTradeoffFile(const Sha256Digest& mesh, const MeasuredTradeoff& measured,
                                  NewBlob blob) {
  CheckedWriter writer(std::move(blob), kTradeoffFileKind);
  writer.Put(mesh);
  writer.Put(measured.measured_ms);
  const Tradeoff& tradeoff = measured.tradeoff;
  writer.Put(tradeoff.triangles);
  PutBool(tradeoff.closed, &writer);
  PutBool(tradeoff.from_inside, &writer);
  writer.Put(tradeoff.seed);
  writer.Put(std::int32_t{tradeoff.threads});
  writer.Put(tradeoff.load_average);
  writer.Put(tradeoff.runs);
  writer.Put(tradeoff.disturbed_runs);
  writer.Put(tradeoff.total_ms);
  PutAll(tradeoff.precisions, &writer);
  PutAll(tradeoff.builds, &writer);
  PutAll(tradeoff.pairs, &writer);
  return std::move(writer).Finish();
}

Result<MeasuredTradeoff> ReadTradeoffFile(const Sha256Digest& mesh,
                                          std::unique_ptr<ReadableFile> file) {
  CheckedReader reader(std::move(file), kTradeoffFileKind);
  if (reader.Get<Sha256Digest>() != mesh) reader.Fail();
  MeasuredTradeoff measured;
  measured.measured_ms = reader.Get<std::int64_t>();
  Tradeoff& tradeoff = measured.tradeoff;
  tradeoff.triangles = reader.Get<std::uint64_t>();
  tradeoff.closed = GetBool(&reader);
  tradeoff.from_inside = GetBool(&reader);
  tradeoff.seed = reader.Get<std::uint64_t>();
  tradeoff.threads = reader.Get<std::int32_t>();
  tradeoff.load_average = reader.Get<double>();
  tradeoff.runs = reader.Get<std::uint64_t>();
  tradeoff.disturbed_runs = reader.Get<std::uint64_t>();
  tradeoff.total_ms = reader.Get<double>();
  tradeoff.precisions = GetAll(GetAccuracy, &reader);
  tradeoff.builds = GetAll(GetBuild, &reader);
  tradeoff.pairs = GetAll(GetPair, &reader);
  if (Status status = reader.Finish(); !status.ok()) return std::move(status).error();
  return measured;
}

}  // namespace kdray::core
