// SPDX-License-Identifier: Apache-2.0
#include "kdray/client.h"

#include "kdray/error.h"

namespace kdray::client {
namespace {

constexpr std::size_t kDigestLength = 64;
constexpr std::size_t kShortDigestLength = 12;

Document ParseAnswer(const HttpResponse& response) {
  std::optional<Document> document = Document::Parse(response.body);
  if (document && document->IsObject()) return *std::move(document);
  throw Refusal({.status = response.status,
                 .code = {},
                 .detail = "the answer is not the JSON object of kdray's contract (is it "
                           "a kdray server?)",
                 .request_id = response.Header("x-request-id")});
}

Tree TreeFrom(Document description, int status) {
  Tree tree;
  tree.id = description["id"].Text().value_or("");
  tree.ready = description["state"].Text() == "ready";
  tree.progress = description["progress"].Number().value_or(tree.ready ? 1 : 0);
  tree.is_new = status != 200;
  tree.description = std::move(description);
  return tree;
}

Tradeoff TradeoffFrom(Document document) {
  Tradeoff tradeoff;
  tradeoff.ready = document["state"].Text() == "measured";
  tradeoff.progress = document["progress"].Number().value_or(0);
  tradeoff.document = std::move(document);
  return tradeoff;
}

// Ids come from people, so characters that an id cannot have must not become part of a path.
std::string TreePath(const std::string& id) {
  if (id.find_first_not_of("0123456789abcdefghijklmnopqrstuvwxyz.-") != std::string::npos)
    throw UsageError("'" + Printable(id) + "' is not a tree id");
  return "/v1/trees/" + id;
}

}  // namespace

HttpResponse Client::Call(const HttpRequest& request) {
  HttpResponse response = transport_.Send(request);
  if (response.status < 200 || response.status > 299)
    throw Refusal(ParseProblem(response.status, response.body, response.Header("x-request-id")));
  return response;
}

Document Client::ServiceInfo() { return ParseAnswer(Call({.path = "/v1"})); }

Tree Client::GetTree(const std::string& id, int wait_ms) {
  Parameters query;
  if (wait_ms > 0) query.emplace_back("wait_ms", std::to_string(wait_ms));
  const auto response = Call({.path = TreePath(id), .query = std::move(query)});
  return TreeFrom(ParseAnswer(response), response.status);
}

std::optional<Tree> Client::FindTree(const std::string& id) {
  try {
    return GetTree(id);
  } catch (const Refusal& refusal) {
    if (refusal.problem.code == "tree_not_found") return std::nullopt;
    throw;
  }
}

TreePage Client::ListTrees(const std::string& after) {
  Parameters query;
  if (!after.empty()) query.emplace_back("after", after);
  const auto response = Call({.path = "/v1/trees", .query = std::move(query)});
  const Document document = ParseAnswer(response);
  TreePage page;
  for (Document& description : document["trees"].Items())
    page.trees.push_back(TreeFrom(std::move(description), response.status));
  page.next = document["next"].Text();
  return page;
}

Tree Client::CreateTree(const Payload& mesh, const std::string& build, int wait_ms,
                        const ByteProgress& on_sent, const std::string& sha256) {
  const auto response = Call({.method = "POST",
                              .path = "/v1/trees",
                              .query = {{"build", build}, {"wait_ms", std::to_string(wait_ms)}},
                              .content_type = "application/octet-stream",
                              .content_digest = sha256.empty() ? "" : ContentDigest(sha256),
                              .payload = &mesh,
                              .on_sent = on_sent});
  return TreeFrom(ParseAnswer(response), response.status);
}

std::optional<Tree> Client::CreateTreeOfStoredMesh(const std::string& sha256,
                                                   const std::string& build, int wait_ms) {
  try {
    const auto response =
        Call({.method = "POST",
              .path = "/v1/trees",
              .query = {{"mesh", sha256}, {"build", build}, {"wait_ms", std::to_string(wait_ms)}}});
    return TreeFrom(ParseAnswer(response), response.status);
  } catch (const Refusal& refusal) {
    if (refusal.problem.code == "mesh_not_found") return std::nullopt;
    throw;
  }
}

void Client::DeleteTree(const std::string& id) { Call({.method = "DELETE", .path = TreePath(id)}); }

void Client::DownloadMesh(const std::string& id, const BodySink& sink) {
  Call({.path = TreePath(id) + "/mesh", .sink = sink});
}

Answer Client::Query(const std::string& id, const std::string& query, const Parameters& options,
                     const Payload& rows, const std::string& accept, const ByteProgress& on_sent) {
  HttpResponse response = Call({.method = "POST",
                                .path = TreePath(id) + "/" + query,
                                .query = options,
                                .accept = accept,
                                .content_type = "application/octet-stream",
                                .payload = &rows,
                                .on_sent = on_sent});
  std::string body = std::move(response.body);
  return {std::move(body), std::move(response)};
}

Answer Client::Render(const std::string& id, const std::string& format, const Parameters& fields) {
  HttpResponse response = Call({.path = TreePath(id) + "/render." + format, .query = fields});
  std::string body = std::move(response.body);
  return {std::move(body), std::move(response)};
}

Document Client::Cells(const std::string& id, int depth) {
  return ParseAnswer(
      Call({.path = TreePath(id) + "/cells", .query = {{"depth", std::to_string(depth)}}}));
}

Tradeoff Client::MeasureTradeoff(const std::string& id, int wait_ms) {
  return TradeoffFrom(ParseAnswer(Call({.method = "POST",
                                        .path = TreePath(id) + "/tradeoff",
                                        .query = {{"wait_ms", std::to_string(wait_ms)}}})));
}

std::optional<Tradeoff> Client::FindTradeoff(const std::string& id, int wait_ms) {
  try {
    return TradeoffFrom(ParseAnswer(Call(
        {.path = TreePath(id) + "/tradeoff", .query = {{"wait_ms", std::to_string(wait_ms)}}})));
  } catch (const Refusal& refusal) {
    if (refusal.problem.code == "not_measured") return std::nullopt;
    throw;
  }
}

void Client::ForgetTradeoff(const std::string& id) {
  Call({.method = "DELETE", .path = TreePath(id) + "/tradeoff"});
}

std::string TreeIdOf(const std::string& sha256, const std::string& build) {
  return sha256 + "-" + build;
}

std::string ShortTreeId(std::string_view id) {
  if (id.size() <= kDigestLength) return std::string(id);
  return std::string(id.substr(0, kShortDigestLength)) + std::string(id.substr(kDigestLength));
}

}  // namespace kdray::client
