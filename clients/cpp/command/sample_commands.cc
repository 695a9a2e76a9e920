// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>

#include "clients/cpp/command/ending.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"
#include "clients/cpp/sample/mesh_writer.h"
#include "clients/cpp/sample/sample_mesh.h"
#include "clients/cpp/sample/sample_rays.h"
#include "kdray/error.h"
#include "kdray/npy.h"

namespace kdray::client {
namespace {

struct MeshOptions {
  std::string name;
  std::string output;
  SampleOptions sample;
};

void WriteSample(const MeshOptions& options, Session& session) {
  session.RefuseJsonBeside(options.output);
  const std::string ending = TypeOfOutput(options.output, {"ply", "obj", "stl"});
  const auto format = MeshFormatOf("mesh." + ending);
  OutputFile file(options.output, session.console());
  const SampleMesh mesh = MakeSample(*FindSampleShape(options.name), options.sample);
  file.Write(EncodeMesh(mesh, *format));
  file.Commit();
  const std::uint64_t triangles = mesh.triangles.size(), vertices = mesh.vertices.size();
  session.Report({{"file", Document(options.output)},
                  {"triangles", Document(triangles)},
                  {"vertices", Document(vertices)}},
                 options.output + ": " + CountText(triangles) + " triangles, " +
                     CountText(vertices) + " vertices");
}

constexpr std::uint64_t kRaysOfAPart = 100'000;

struct RayOptions {
  std::vector<double> bounds;
  std::string tree;
  std::string output;
  std::uint64_t count = 100'000;
  std::uint64_t seed = 1;
};

Box BoundsOfTree(const std::string& id_or_file, Session& session) {
  Client client = session.Connect();
  const Tree tree = client.GetTree(session.TreeIdFor(client, id_or_file), 30000);
  const Document bounds = tree.description["mesh"]["bounds"];
  const std::vector<double> min = bounds["min"].Numbers();
  const std::vector<double> max = bounds["max"].Numbers();
  if (min.size() != 3 || max.size() != 3)
    throw UsageError("the description of this tree has no bounds; use --bounds");
  return {{min[0], min[1], min[2]}, {max[0], max[1], max[2]}};
}

void WriteRays(const RayOptions& options, Session& session) {
  if (!options.bounds.empty() && !options.tree.empty()) {
    throw UsageError("--bounds and --tree both say where to aim; give one of them");
  }
  session.RefuseJsonBeside(options.output);
  TypeOfOutput(options.output, {"npy"});
  Box box = {{-1, -1, -1}, {1, 1, 1}};
  if (!options.tree.empty()) {
    box = BoundsOfTree(options.tree, session);
  } else if (!options.bounds.empty()) {
    std::copy_n(options.bounds.begin(), 3, box.min.begin());
    std::copy_n(options.bounds.begin() + 3, 3, box.max.begin());
  }
  OutputFile file(options.output, session.console());
  file.Write(EncodeNpyHeader({.descr = "<f4", .shape = {options.count, 6}}));
  {
    ProgressBar bar = session.Bar("writing", static_cast<double>(options.count), {.name = "rays"});
    RaysTowardsBox rays(box, options.seed);
    for (std::uint64_t done = 0; done < options.count;) {
      const std::uint64_t count = std::min(kRaysOfAPart, options.count - done);
      file.Write(LittleEndianFloats(rays.Next(count)));
      done += count;
      bar.Update(static_cast<double>(done));
    }
  }
  file.Commit();
  session.Report({{"file", Document(options.output)}, {"rays", Document(options.count)}},
                 options.output + ": " + CountedText(options.count, "rays"));
}

Subcommand SampleCommand(Session& session) {
  auto options = std::make_shared<MeshOptions>();
  std::vector<std::string> names;
  std::string footer = "Shapes (n is --detail):";
  for (const SampleShape& shape : SampleShapes()) {
    names.emplace_back(shape.name);
    footer += "\n  " + std::string(shape.name) + ": " + std::string(shape.description) +
              "; n = " + std::to_string(shape.default_detail) + " when left out";
  }
  return {.name = "sample",
          .help = "Write a sample mesh; needs no server",
          .options = {{.name = "name",
                       .help = "Shape",
                       .value = &options->name,
                       .required = true,
                       .choices = std::move(names)},
                      {.name = "-o,--output",
                       .help = "Mesh to write: .ply, .obj or .stl, or - for standard output (.ply)",
                       .value = &options->output,
                       .type = "FILE",
                       .required = true},
                      {.name = "--detail",
                       .help = "Resolution: pieces along an edge of the shape's grid",
                       .value = &options->sample.detail,
                       .type = "N",
                       .range = Option::Range{1, kMaxSampleDetail}},
                      {.name = "--seed",
                       .help = "Of the terrain",
                       .value = &options->sample.seed,
                       .type = "N"}},
          .footer = std::move(footer),
          .run = [options, &session] { WriteSample(*options, session); }};
}

Subcommand SampleRaysCommand(Session& session) {
  auto options = std::make_shared<RayOptions>();
  return {.name = "sample-rays",
          .help = "Write random rays towards a box, for `kdray rays`",
          .options = {{.name = "--bounds",
                       .help = "Box to aim at, six numbers: -1,-1,-1,1,1,1 when left out",
                       .value = &options->bounds,
                       .type = "X0,Y0,Z0,X1,Y1,Z1",
                       .count = 6,
                       .split_at_commas = true},
                      {.name = "--tree",
                       .help = "Aim at this tree's mesh instead",
                       .value = &options->tree,
                       .type = "ID|FILE"},
                      {.name = "-n,--count",
                       .help = "How many",
                       .value = &options->count,
                       .type = "N",
                       .help_tells_default = true,
                       .range = Option::Range{0, 100'000'000}},
                      {.name = "--seed",
                       .help = "Another seed gives other rays",
                       .value = &options->seed,
                       .type = "N"},
                      {.name = "-o,--output",
                       .help = "Rays to write: .npy of shape (N, 6), or - for standard output",
                       .value = &options->output,
                       .type = "FILE",
                       .required = true}},
          .run = [options, &session] { WriteRays(*options, session); }};
}

}  // namespace

std::vector<Subcommand> SampleCommands(Session& session) {
  return {SampleCommand(session), SampleRaysCommand(session)};
}

}  // namespace kdray::client
