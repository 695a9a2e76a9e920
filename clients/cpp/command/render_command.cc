#include <array>
#include <memory>

#include "clients/cpp/client/error.h"
#include "clients/cpp/command/answer_text.h"
#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

// Every field of the daemon's renders (tests/clients/contract_test.py compares the two). Values are
// sent unchanged; the server checks their ranges.
constexpr std::array kFields = {
    Field{"width", "PIXELS", "640 when left out"},
    Field{"height", "PIXELS", "480 when left out"},
    Field{"mode", "NAME", kRenderModeHelp},
    Field{"projection", "NAME", kProjectionHelp},
    Field{"eye", "X,Y,Z", "Where the camera stands; chosen to frame the mesh when left out"},
    Field{"target", "X,Y,Z", "What it looks at"},
    Field{"up", "X,Y,Z",
          "What is up in the picture; the y axis, or z in a view along y, when left out"},
    Field{"view", "NAME", kViewHelp},
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
    Field{"precision", "NAME", kPrecisionHelp},
    Field{"color", "R,G,B", "Of the surface, sRGB in 0..1, or file: 0.93,0.88,0.81 when left out"},
    Field{"background", "R,G,B",
          "sRGB in 0..1, or transparent; white when left out, black unless the mode shows light"},
    Field{"lights", "JSON",
          "[{\"direction\":[0,-1,-1],\"intensity\":1,\"color\":[1,1,1]},{\"position\":[0,2,0]}]; a "
          "light at "
          "the eye when left out"},
    Field{"shadows", "BOOL", "Surfaces hide lights: false when left out"},
    Field{"smooth", "BOOL", "Shade by the vertex normals of the file: false when left out"},
    Field{"ao_radius", "LENGTH",
          "Ambient occlusion: how far surfaces count; a tenth of the mesh's size when left out"},
    Field{"edges", "BOOL", "Draw the edges of the file's faces: false when left out"},
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
  std::array<std::string, kFields.size()> values;
};

void Render(const Options& options, Session& session) {
  const bool is_npy = options.output.ends_with(".npy");
  if (!is_npy && options.output != "-" && !options.output.ends_with(".png"))
    throw UsageError("-o must end in .png or .npy, which selects the format");
  Parameters fields;
  for (std::size_t i = 0; i < kFields.size(); ++i)
    if (!options.values[i].empty()) fields.emplace_back(kFields[i].name, options.values[i]);

  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  const Answer answer = client.Render(id, is_npy ? "npy" : "png", fields);
  file.Write(answer.body);
  file.Commit();
  session.Say(options.output + ": " + ByteText(static_cast<double>(answer.body.size())) + ", " +
              AnswerText(answer.response));
}

}  // namespace

Subcommand RenderCommand(Session& session) {
  auto options = std::make_shared<Options>();
  Subcommand command = {.name = "render",
                        .help = "Picture of a tree's mesh, as .png or .npy",
                        .options = {{.name = "tree",
                                     .help = "Tree, or a mesh file to upload first",
                                     .value = &options->tree,
                                     .type = "ID|FILE",
                                     .required = true},
                                    {.name = "-o,--output",
                                     .help = "Picture to write: .png, .npy, or - (a PNG)",
                                     .value = &options->output,
                                     .type = "FILE",
                                     .required = true}},
                        .run = [options, &session] { Render(*options, session); }};
  for (std::size_t i = 0; i < kFields.size(); ++i)
    command.options.push_back(FieldOption(kFields[i], &options->values[i]));
  return command;
}

}  // namespace kdray::client
