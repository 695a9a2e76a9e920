#include <algorithm>

#include "clients/cpp/client/error.h"
#include "clients/cpp/client/npy.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"
#include "clients/cpp/sample/mesh_writer.h"
#include "clients/cpp/sample/sample_mesh.h"
#include "clients/cpp/sample/sample_rays.h"

namespace kdray::client {
namespace {

struct MeshOptions {
  std::string name;
  std::string output;
  SampleOptions sample;
};

void WriteSample(const MeshOptions& options, Session& session) {
  const auto format = MeshFormatOf(options.output);
  if (!format) throw UsageError("-o must end in .obj, .ply or .stl, which selects the format");
  OutputFile file(options.output, session.console());
  const SampleMesh mesh = MakeSample(*FindSampleShape(options.name), options.sample);
  file.Write(EncodeMesh(mesh, *format));
  file.Commit();
  session.Say(options.output + ": " + CountText(mesh.triangles.size()) + " triangles, " +
              CountText(mesh.vertices.size()) + " vertices");
}

struct RayOptions {
  std::vector<double> bounds;
  std::string tree;
  std::string output;
  std::uint64_t count = 0;
  std::uint64_t seed = 1;
};

Box BoundsOfTree(const std::string& id_or_file, Session& session) {
  Client client = session.Connect();
  const Tree tree = client.GetTree(session.TreeIdFor(client, id_or_file), 30000);
  try {
    const Json& bounds = tree.description.at("mesh").at("bounds");
    return {bounds.at("min").get<Point>(), bounds.at("max").get<Point>()};
  } catch (const Json::exception&) {
    throw UsageError("the description of this tree has no bounds; use --bounds");
  }
}

void WriteRays(const RayOptions& options, Session& session) {
  if (options.bounds.empty() == options.tree.empty())
    throw UsageError("sample-rays needs either --bounds or --tree");
  OutputFile file(options.output, session.console());
  Box box;
  if (options.bounds.empty()) {
    box = BoundsOfTree(options.tree, session);
  } else {
    std::copy_n(options.bounds.begin(), 3, box.min.begin());
    std::copy_n(options.bounds.begin() + 3, 3, box.max.begin());
  }
  const std::vector<float> rays = RaysTowardsBox(box, options.count, options.seed);
  file.Write(EncodeNpyRows(rays, 6));
  file.Commit();
  session.Say(options.output + ": " + CountText(options.count) + " rays");
}

}  // namespace

void AddSamples(CLI::App& app, Session& session) {
  auto mesh = std::make_shared<MeshOptions>();
  CLI::App* sample = app.add_subcommand("sample", "Write a sample mesh; needs no server");
  std::vector<std::string> names;
  std::string footer = "Shapes (n is --detail):";
  for (const SampleShape& shape : SampleShapes()) {
    names.emplace_back(shape.name);
    footer += "\n  " + std::string(shape.name) + ": " + std::string(shape.description) +
              "; n = " + std::to_string(shape.default_detail) + " when left out";
  }
  sample->footer(footer);
  sample->add_option("name", mesh->name, "Shape")->required()->check(CLI::IsMember(names));
  sample->add_option("-o,--output", mesh->output, "Mesh to write: .obj, .ply or .stl")
      ->required()
      ->type_name("FILE");
  sample
      ->add_option("--detail", mesh->sample.detail,
                   "Resolution: pieces along an edge of the shape's grid")
      ->check(CLI::Range(1, kMaxSampleDetail))
      ->type_name("N");
  sample->add_option("--seed", mesh->sample.seed, "Of the terrain")->type_name("N");
  sample->callback([mesh, &session] { WriteSample(*mesh, session); });

  auto rays = std::make_shared<RayOptions>();
  CLI::App* sample_rays =
      app.add_subcommand("sample-rays", "Write random rays towards a box, for `kdray rays`");
  sample_rays->add_option("--bounds", rays->bounds, "Box to aim at, six numbers")
      ->expected(6)
      ->delimiter(',')
      ->type_name("X0,Y0,Z0,X1,Y1,Z1");
  sample_rays->add_option("--tree", rays->tree, "Aim at this tree's mesh instead")
      ->type_name("ID|FILE");
  sample_rays->add_option("-n,--count", rays->count, "How many")
      ->required()
      ->check(CLI::Range(std::uint64_t{0}, std::uint64_t{100'000'000}))
      ->type_name("N");
  sample_rays->add_option("--seed", rays->seed, "Another seed gives other rays")->type_name("N");
  sample_rays->add_option("-o,--output", rays->output, "Rays to write: .npy of shape (N, 6)")
      ->required()
      ->type_name("FILE");
  sample_rays->callback([rays, &session] { WriteRays(*rays, session); });
}

}  // namespace kdray::client
