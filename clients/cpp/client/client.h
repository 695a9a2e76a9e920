// The kdray service as functions: one for each endpoint that the command uses.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "clients/cpp/client/transport.h"

namespace kdray::client {

using Json = nlohmann::json;

/// What a client decides by, and the server's whole description of the tree behind it.
struct Tree {
  std::string id;
  bool ready = false;
  double progress = 0;  ///< 0..1 while it is built
  bool is_new = false;  ///< this call stored or began to build it (201 or 202, not 200)
  Json description;
};

struct TreePage {
  std::vector<Tree> trees;  ///< newest first
  std::optional<std::string> next;
};

/// An answer's bytes and what its headers say about them.
struct Answer {
  std::string body;
  HttpResponse response;  ///< its body has moved to `body`
};

/// Speed and accuracy as they were measured on a mesh, or how far that is.
struct Tradeoff {
  bool ready = false;
  double progress = 0;  ///< 0..1
  Json document;        ///< the server's whole answer
};

/// Calls wait for the answer. All throw Refusal when the server says no, ConnectionError when it
/// says nothing, and LocalFileError when a file to be sent cannot be read. Not safe from several
/// threads: give each its own.
class Client {
 public:
  explicit Client(ClientOptions options) : transport_(std::move(options)) {}

  /// GET /v1: version, formats, builds, precisions, limits.
  Json ServiceInfo();

  /// GET /v1/trees/{id}; waits until it is built, `wait_ms` at most.
  Tree GetTree(const std::string& id, int wait_ms = 0);

  /// The same, or nullopt where the server has no such tree.
  std::optional<Tree> FindTree(const std::string& id);

  /// GET /v1/trees, one page; `after` is `next` of the page before.
  TreePage ListTrees(const std::string& after = {});

  /// POST /v1/trees with the file's bytes.
  Tree CreateTree(const LocalFile& mesh, const std::string& build, int wait_ms,
                  const SendProgress& on_sent = {});

  /// POST /v1/trees?mesh=: another build of stored bytes; nullopt where the server has them not.
  std::optional<Tree> CreateTreeOfStoredMesh(const std::string& sha256, const std::string& build,
                                             int wait_ms);

  void DeleteTree(const std::string& id);

  /// GET /v1/trees/{id}/mesh, piece by piece.
  void DownloadMesh(const std::string& id, const BodySink& sink);

  /// POST /v1/trees/{id}/rays/{query}; `accept` is the wanted media type.
  Answer QueryRays(const std::string& id, const std::string& query, const Parameters& options,
                   const LocalFile& rays, const std::string& accept);

  /// GET /v1/trees/{id}/render.png or render.npy.
  Answer Render(const std::string& id, const std::string& format, const Parameters& fields);

  /// GET /v1/trees/{id}/cells.
  Json Cells(const std::string& id, int depth);

  /// POST /v1/trees/{id}/tradeoff: begins to measure, unless that is under way, and waits for the
  /// end, `wait_ms` at most.
  Tradeoff MeasureTradeoff(const std::string& id, int wait_ms);

  /// GET /v1/trees/{id}/tradeoff; nullopt where nothing was measured.
  std::optional<Tradeoff> FindTradeoff(const std::string& id, int wait_ms = 0);

  /// DELETE /v1/trees/{id}/tradeoff: stops measuring and forgets.
  void ForgetTradeoff(const std::string& id);

  const ClientOptions& options() const { return transport_.options(); }

 private:
  HttpResponse Call(const HttpRequest& request);

  Transport transport_;
};

/// The id that the service gives to a mesh with that digest.
std::string TreeIdOf(const std::string& sha256, const std::string& build);

/// An id short enough for a table: twelve digits of the digest, then the build.
std::string ShortTreeId(std::string_view id);

}  // namespace kdray::client
