// SPDX-License-Identifier: Apache-2.0
// The kdray service as functions: one for each endpoint that the command uses.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "kdray/document.h"
#include "kdray/transport.h"

namespace kdray::client {

/// The fields that clients use, and the server's whole description of the tree.
struct Tree {
  std::string id;
  bool ready = false;
  double progress = 0;  ///< 0..1 while it is built
  bool is_new = false;  ///< this call stored it or started its build (201 or 202, not 200)
  Document description;
};

struct TreePage {
  std::vector<Tree> trees;  ///< newest first
  std::optional<std::string> next;
};

/// An answer's bytes and its headers.
struct Answer {
  std::string body;
  HttpResponse response;  ///< its body has moved to `body`
};

/// Speed and accuracy measured on a mesh, or the progress of the measurement.
struct Tradeoff {
  bool ready = false;
  double progress = 0;  ///< 0..1
  Document document;    ///< the server's whole answer
};

/// Calls wait for the answer. All throw Refusal if the server answers with an error,
/// ConnectionError if it does not answer, and LocalFileError if a file to send cannot be read. Not
/// safe from several threads: use one Client per thread.
class Client {
 public:
  explicit Client(ClientOptions options) : transport_(std::move(options)) {}

  /// `url` as ParseServerUrl reads it. Throws UsageError if it is invalid.
  explicit Client(const std::string& url, const std::string& token = {})
      : Client(ClientOptions{.server = ParseServerUrl(url), .token = token}) {}

  /// GET /v1: version, formats, builds, precisions, limits.
  Document ServiceInfo();

  /// GET /v1/trees/{id}; waits at most `wait_ms` until the tree is built.
  Tree GetTree(const std::string& id, int wait_ms = 0);

  /// The same, or nullopt if the server has no such tree.
  std::optional<Tree> FindTree(const std::string& id);

  /// GET /v1/trees, one page; `after` is `next` of the previous page.
  TreePage ListTrees(const std::string& after = {});

  /// POST /v1/trees with the mesh's bytes. `sha256` is their hash, if it is known. It is sent as
  /// Content-Digest, by which a proxy before several servers finds the server of the mesh.
  Tree CreateTree(const Payload& mesh, const std::string& build, int wait_ms,
                  const ByteProgress& on_sent = {}, const std::string& sha256 = {});

  /// POST /v1/trees?mesh=: another build of a stored mesh; nullopt if the server does not have it.
  std::optional<Tree> CreateTreeOfStoredMesh(const std::string& sha256, const std::string& build,
                                             int wait_ms);

  void DeleteTree(const std::string& id);

  /// GET /v1/trees/{id}/mesh, piece by piece.
  void DownloadMesh(const std::string& id, const BodySink& sink);

  /// POST /v1/trees/{id}/{query} with a batch; `query` is `rays/closest`, `points/inside`,
  /// `visibility` and so on, `accept` the media type of the answer. batches.h has typed forms.
  Answer Query(const std::string& id, const std::string& query, const Parameters& options,
               const Payload& rows, const std::string& accept, const ByteProgress& on_sent = {});

  /// GET /v1/trees/{id}/render.png or render.npy.
  Answer Render(const std::string& id, const std::string& format, const Parameters& fields);

  /// GET /v1/trees/{id}/cells.
  Document Cells(const std::string& id, int depth);

  /// POST /v1/trees/{id}/tradeoff: starts a measurement, or joins the running one, and waits at
  /// most `wait_ms` for its end.
  Tradeoff MeasureTradeoff(const std::string& id, int wait_ms);

  /// GET /v1/trees/{id}/tradeoff; nullopt if there is no result.
  std::optional<Tradeoff> FindTradeoff(const std::string& id, int wait_ms = 0);

  /// DELETE /v1/trees/{id}/tradeoff: stops measuring and deletes the result.
  void ForgetTradeoff(const std::string& id);

  const ClientOptions& options() const { return transport_.options(); }

 private:
  HttpResponse Call(const HttpRequest& request);

  Transport transport_;
};

/// The tree id of a mesh with this hash.
std::string TreeIdOf(const std::string& sha256, const std::string& build);

/// An id short enough for a table: twelve digits of the digest, then the build.
std::string ShortTreeId(std::string_view id);

}  // namespace kdray::client
