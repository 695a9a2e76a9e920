// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <memory>

#include "clients/cpp/command/answer_facts.h"
#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/ending.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/picture_size.h"
#include "clients/cpp/command/render_time.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"
#include "clients/cpp/command/turntable.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

// Every field of the daemon's renders (tests/clients/contract_test.py compares the two). Values are
// sent unchanged; the server checks their ranges.
constexpr std::array kFields = {
    Field{"width", "PIXELS", "640 when left out"},
    Field{"height", "PIXELS", "480 when left out"},
    Field{"mode", "NAME", kRenderModeHelp, kRenderModeValues},
    Field{"projection", "NAME", kProjectionHelp, kProjectionValues},
    Field{"eye", "X,Y,Z", "Where the camera stands; chosen to frame the mesh when left out"},
    Field{"target", "X,Y,Z", "What it looks at"},
    Field{"up", "X,Y,Z",
          "What is up in the picture; the y axis, or z in a view along y, when left out"},
    Field{"view", "NAME", kViewHelp, kViewValues},
    Field{"fov_deg", "DEGREES", "Perspective: vertical angle of view: 40 when left out"},
    Field{"view_height", "LENGTH",
          "Orthographic: height of the picture in mesh units; frames the mesh when left out"},
    Field{"h_fov_deg", "DEGREES", "Spherical: horizontal angle of view: 360 when left out"},
    Field{"v_fov_deg", "DEGREES", "Spherical: vertical angle of view: 180 when left out"},
    Field{"intrinsic", "FX,FY,CX,CY", "Perspective: focal lengths and principal point in pixels"},
    Field{"extrinsic", "16 NUMBERS",
          "Perspective: world to camera, row by row, x right, y down, z forward"},
    Field{"depth_range", "NEAR,FAR",
          "Depth pictures: depths of the greys; those of the whole picture when left out"},
    Field{"samples", "N",
          "Rays a pixel; when left out 1 in a .npy, and in a .png as many as smooth edges need"},
    Field{"precision", "NAME", kPrecisionHelp, kPrecisionValues},
    Field{"color", "R,G,B", "Of the surface, sRGB in 0..1, or file: 0.93,0.88,0.81 when left out"},
    Field{"background", "R,G,B",
          "sRGB in 0..1, or transparent; white when left out, black unless the mode shows light"},
    Field{"lights", "JSON",
          "[{\"direction\":[0,-1,-1],\"intensity\":1,\"color\":[1,1,1]},{\"position\":[0,2,0]}]; a "
          "light at "
          "the eye when left out"},
    Field{"shadows", "BOOL", "Surfaces hide lights: false when left out", "true,false"},
    Field{"smooth", "BOOL", "Shade by the vertex normals of the file: false when left out",
          "true,false"},
    Field{"ao_radius", "LENGTH",
          "Ambient occlusion: how far surfaces count; a tenth of the mesh's size when left out"},
    Field{"edges", "BOOL", "Draw the edges of the file's faces: false when left out", "true,false"},
    Field{"cells_depth", "DEPTH", "Draw the tree's boxes of that depth"},
    Field{"region", "X0,Y0,X1,Y1", "Only these pixels of the whole picture, half-open"},
    Field{"seed", "N", "Of the random samples: 0 when left out"},
    Field{"budget_ms", "MS", "The best picture within that time"},
    Field{"max_noise", "NOISE", "Each pixel stops below this standard error"},
    Field{"max_samples", "N", "At most that many rays a pixel: 1024 when left out"},
    Field{"deadline_ms", "MS", "Give up after that time: 60000 when left out"},
};

struct Options {
  std::string tree;
  std::string output;
  std::string size;
  int turntable = 0;
  std::array<std::string, kFields.size()> values;
};

Parameters FieldsOf(const Options& options) {
  Parameters fields = ParametersOf(kFields, options.values);
  if (options.size.empty()) return fields;
  const PictureSize size = ParsePictureSize(options.size);
  for (const auto& [name, value] : {std::pair("width", size.width), {"height", size.height}}) {
    if (std::any_of(fields.begin(), fields.end(), [&](const auto& f) { return f.first == name; })) {
      throw UsageError("--size and --" + std::string(name) + " exclude each other");
    }
    fields.emplace_back(name, std::to_string(value));
  }
  return fields;
}

// Where a picture goes, and what is said about it.
struct Picture {
  std::string file;
  std::uint64_t bytes = 0;
  AnswerFacts facts;

  std::string Text() const {
    const std::string text = facts.Text();
    return file + ": " + ByteText(static_cast<double>(bytes)) + (text.empty() ? "" : ", " + text);
  }
  std::vector<std::pair<std::string, Document>> Members() const {
    std::vector<std::pair<std::string, Document>> members = {{"file", Document(file)},
                                                             {"bytes", Document(bytes)}};
    for (auto& member : facts.Members()) members.push_back(std::move(member));
    return members;
  }
};

Picture RenderTo(OutputFile& file, const std::string& name, Client& client, const std::string& id,
                 const std::string& format, const Parameters& fields) {
  const Answer answer = client.Render(id, format, fields);
  file.Write(answer.body);
  return {name, answer.body.size(), AnswerFacts::Of(answer.response)};
}

void RenderOne(const Options& options, const std::string& format, Session& session) {
  const Parameters fields = FieldsOf(options);
  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  Picture picture;
  {
    const RenderWork work = RenderWorkOf(fields);
    ProgressBar bar = session.Bar("rendering", work.pixels, {.name = "pixels"});
    if (!session.quiet()) bar.Expect(ExpectedTime(client, id, format, fields));
    picture = RenderTo(file, options.output, client, id, format, fields);
  }
  file.Commit();
  session.Report(picture.Members(), picture.Text());
}

void RenderTurntable(const Options& options, const std::string& format, Session& session) {
  const Parameters fields = FieldsOf(options);
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  const auto frames =
      TurntableFrames(fields, client.GetTree(id, 30000).description, format, options.turntable);
  std::vector<Document> pictures;
  std::uint64_t bytes = 0;
  {
    ProgressBar bar = session.Bar("rendering", options.turntable, {.name = "pictures"});
    bar.Update(0);
    for (int i = 0; i < options.turntable; ++i) {
      const std::string name = FrameName(options.output, i, options.turntable);
      OutputFile file(name, session.console());
      const Picture picture =
          RenderTo(file, name, client, id, format, frames[static_cast<std::size_t>(i)]);
      file.Commit();
      bytes += picture.bytes;
      if (session.json()) pictures.push_back(Document::ObjectOf(picture.Members()));
      bar.Update(i + 1);
    }
  }
  const std::string first = FrameName(options.output, 0, options.turntable);
  const std::string last = FrameName(options.output, options.turntable - 1, options.turntable);
  session.Report({{"pictures", Document::ArrayOf(pictures)}},
                 (options.output == "-" ? "-" : first + " to " + last) + ": " +
                     std::to_string(options.turntable) + " pictures, " +
                     ByteText(static_cast<double>(bytes)));
}

void Render(const Options& options, Session& session) {
  session.RefuseJsonBeside(options.output);
  const std::string format = TypeOfOutput(options.output, {"png", "npy"});
  if (options.turntable > 0) {
    RenderTurntable(options, format, session);
  } else {
    RenderOne(options, format, session);
  }
}

}  // namespace

Subcommand RenderCommand(Session& session) {
  auto options = std::make_shared<Options>();
  Subcommand command = {
      .name = "render",
      .help = "Picture of a tree's mesh, as .png or .npy",
      .options = {TreeOption(&options->tree),
                  {.name = "-o,--output",
                   .help = "Picture to write: .png, .npy, or - for standard output (a PNG)",
                   .value = &options->output,
                   .type = "FILE",
                   .required = true},
                  {.name = "--size",
                   .help = "Width and height in pixels, as 1920x1080",
                   .value = &options->size,
                   .type = "WxH"},
                  {.name = "--turntable",
                   .help = "As many pictures on a circle around the mesh: FILE-0.png and so on; to "
                           "standard output one after another, as ffmpeg -f image2pipe reads them",
                   .value = &options->turntable,
                   .type = "N",
                   .range = Option::Range{1, 10000}}},
      .run = [options, &session] { Render(*options, session); }};
  AddFieldOptions(&command, kFields, options->values);
  return command;
}

}  // namespace kdray::client
