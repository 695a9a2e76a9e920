// SPDX-License-Identifier: Apache-2.0
// The points that a laser scanner would see: one spherical image of positions, or beams at given
// elevations by ray queries.
#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <memory>

#include "clients/cpp/command/answer_facts.h"
#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/ending.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/picture_size.h"
#include "clients/cpp/command/scan.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"
#include "kdray/error.h"
#include "kdray/npy.h"

namespace kdray::client {
namespace {

constexpr std::array kFields = {
    Field{"eye", "X,Y,Z", "Where the scanner stands: the middle of the mesh when left out"},
    Field{"target", "X,Y,Z", "The direction of the middle column"},
    Field{"up", "X,Y,Z", "The scanner's axis: 0,1,0 when left out"},
    Field{"h_fov_deg", "DEGREES", "Horizontal angle of view: 360 when left out"},
    Field{"v_fov_deg", "DEGREES", "Vertical angle of view: 180 when left out"},
    Field{"precision", "NAME", kPrecisionHelp, kPrecisionValues},
    Field{"deadline_ms", "MS",
          "Give up on a part of the scan after that time: 60000 when left out"},
};

constexpr std::uint64_t kFirstRays = 20'000;
constexpr double kPartSeconds = 0.7;
constexpr std::uint64_t kMostRaysOfAPart = 2'000'000;

struct Options {
  std::string tree;
  std::string output;
  std::string size = "1024x512";
  std::string elevations;
  std::array<std::string, kFields.size()> values;
};

std::string ValueOf(const Parameters& fields, const std::string& name) {
  for (const auto& [known, value] : fields) {
    if (known == name) return value;
  }
  return {};
}

std::uint64_t LimitOf(Client& client, const char* name) {
  return client.ServiceInfo()["limits"][name].Count().value_or(kMostRaysOfAPart);
}

struct Scan {
  std::string points;  // rows of three doubles
  std::uint64_t rays = 0;
  AnswerFacts facts;
};

// Rows of the scan that are asked for together: those of a part's time, at the speed so far.
// `limit` is the server's, in rays.
template <class Ask>
void AskInParts(std::uint64_t rows, std::uint64_t columns, std::uint64_t limit, ProgressBar& bar,
                const Ask& ask) {
  limit = std::min(limit, kMostRaysOfAPart);
  std::uint64_t part = std::max<std::uint64_t>(std::min(kFirstRays, limit) / columns, 1);
  bar.Update(0);
  for (std::uint64_t done = 0; done < rows;) {
    const std::uint64_t count = std::min(part, rows - done);
    const auto begin = std::chrono::steady_clock::now();
    ask(done, count);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    done += count;
    bar.Update(static_cast<double>(done * columns));
    const double wanted = static_cast<double>(count) * kPartSeconds / std::max(took.count(), 1e-6);
    const auto most =
        static_cast<double>(std::max<std::uint64_t>(std::min(4 * count, limit / columns), 1));
    part = static_cast<std::uint64_t>(std::clamp(wanted, 1.0, most));
  }
}

// A spherical image, some rows of pixels at a time.
Scan ScanByImage(Client& client, const std::string& id, const Options& options,
                 const Parameters& given, Session& session) {
  const PictureSize size = ParsePictureSize(options.size);
  Parameters fields = given;
  fields.insert(fields.end(), {{"projection", "spherical"},
                               {"mode", "position"},
                               {"width", std::to_string(size.width)},
                               {"height", std::to_string(size.height)}});
  Scan scan = {.points = {}, .rays = size.width * size.height, .facts = {}};
  ProgressBar bar = session.Bar("scanning", static_cast<double>(scan.rays), {.name = "rays"});
  const std::uint64_t limit = LimitOf(client, "max_pixels");
  AskInParts(size.height, size.width, limit, bar, [&](std::uint64_t first, std::uint64_t count) {
    Parameters region = fields;
    region.emplace_back("region", "0," + std::to_string(first) + "," + std::to_string(size.width) +
                                      "," + std::to_string(first + count));
    const Answer answer = client.Render(id, "npy", region);
    const NpyHeader header = ParseNpyHeader(answer.body);
    AppendFinite(std::string_view(answer.body).substr(header.data_offset), scan.points);
    scan.facts.Add(AnswerFacts::Of(answer.response));
  });
  return scan;
}

double DegreesOf(const Parameters& fields, const char* name, double absent, double most) {
  const std::string text = ValueOf(fields, name);
  if (text.empty()) return absent;
  double degrees = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), degrees);
  if (error != std::errc() || end != text.data() + text.size() || !(degrees > 0) ||
      degrees > most) {
    throw UsageError("--h-fov-deg must be above 0 and at most " + NumberText(most) + ", not '" +
                     text + "'");
  }
  return degrees;
}

// Beams as rays: one row of columns for each elevation.
Scan ScanByBeams(Client& client, const std::string& id, const Options& options,
                 const Parameters& fields, Session& session) {
  if (!ValueOf(fields, "v_fov_deg").empty()) {
    throw UsageError("--v-fov-deg and --elevations both say where the beams are; give one of them");
  }
  Scanner scanner;
  scanner.elevations_deg = ParseElevations(options.elevations);
  scanner.steps = ParsePictureSize(options.size).width;
  scanner.h_fov_deg = DegreesOf(fields, "h_fov_deg", 360, 360);
  if (const auto up = ValueOf(fields, "up"); !up.empty()) scanner.up = ParseVector(up, "--up");
  if (const auto eye = ValueOf(fields, "eye"); !eye.empty()) {
    scanner.eye = ParseVector(eye, "--eye");
  } else {
    scanner.eye = Framing::Of(client.GetTree(id, 30000).description).center;
  }
  const double up_length = Length(scanner.up);
  const Vector3 unit_up = up_length > 0 ? (1 / up_length) * scanner.up : Vector3{0, 1, 0};
  const std::string target = ValueOf(fields, "target");
  scanner.forward = target.empty() ? -1.0 * *TowardViewer(unit_up, "")
                                   : ParseVector(target, "--target") - scanner.eye;

  const std::vector<Ray> rays = scanner.Rays();
  Parameters query = {{"fields", "point"}, {"dtype", "f8"}};
  for (const char* name : {"precision", "deadline_ms"}) {
    if (const auto value = ValueOf(fields, name); !value.empty()) query.emplace_back(name, value);
  }
  Scan scan = {.points = {}, .rays = rays.size(), .facts = {}};
  ProgressBar bar = session.Bar("scanning", static_cast<double>(scan.rays), {.name = "rays"});
  const std::uint64_t limit = LimitOf(client, "max_rays");
  AskInParts(rays.size(), 1, limit, bar, [&](std::uint64_t first, std::uint64_t count) {
    std::string body = EncodeNpyHeader({.descr = "<f8", .shape = {count, 6}});
    body.append(reinterpret_cast<const char*>(&rays[first]), count * sizeof(Ray));
    const Answer answer = client.Query(
        id, "rays/closest", query, Payload::OfBytes("beams", std::move(body)), "application/x-npy");
    const NpyHeader header = ParseNpyHeader(answer.body);
    AppendFinite(std::string_view(answer.body).substr(header.data_offset), scan.points);
    scan.facts.Add(AnswerFacts::Of(answer.response));
  });
  return scan;
}

void RunScan(const Options& options, Session& session) {
  session.RefuseJsonBeside(options.output);
  const std::string type = TypeOfOutput(options.output, {"npy", "ply"});
  const Parameters fields = ParametersOf(kFields, options.values);
  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  const Scan scan = options.elevations.empty() ? ScanByImage(client, id, options, fields, session)
                                               : ScanByBeams(client, id, options, fields, session);
  const std::uint64_t points = scan.points.size() / sizeof(Vector3);
  file.Write(type == "ply" ? PlyPointCloudHeader(points)
                           : EncodeNpyHeader({.descr = "<f8", .shape = {points, 3}}));
  file.Write(scan.points);
  file.Commit();
  std::vector<std::pair<std::string, Document>> members = {{"file", Document(options.output)},
                                                           {"tree", Document(id)},
                                                           {"rays", Document(scan.rays)},
                                                           {"points", Document(points)}};
  for (auto& member : scan.facts.Members()) members.push_back(std::move(member));
  const std::string text = scan.facts.Text();
  session.Report(members, options.output + ": " + CountedText(points, "points") + " of " +
                              CountedText(scan.rays, "rays") + (text.empty() ? "" : ", " + text));
}

}  // namespace

Subcommand ScanCommand(Session& session) {
  auto options = std::make_shared<Options>();
  Subcommand command = {
      .name = "scan",
      .help = "Points that a laser scanner sees, as an array or a point cloud; misses are left out",
      .options = {TreeOption(&options->tree),
                  {.name = "-o,--output",
                   .help = "Points to write: .npy of shape (N, 3), .ply, or - for standard output "
                           "(.npy)",
                   .value = &options->output,
                   .type = "FILE",
                   .required = true},
                  {.name = "--size",
                   .help = "Columns and rows of the scan; with --elevations only the columns count",
                   .value = &options->size,
                   .type = "WxH",
                   .help_tells_default = true},
                  {.name = "--elevations",
                   .help = "Beams at these elevations in degrees, comma-separated, instead of "
                           "evenly spaced rows",
                   .value = &options->elevations,
                   .type = "DEGREES"}},
      .run = [options, &session] { RunScan(*options, session); }};
  AddFieldOptions(&command, kFields, options->values);
  return command;
}

}  // namespace kdray::client
