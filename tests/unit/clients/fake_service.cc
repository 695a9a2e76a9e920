// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/clients/fake_service.h"

#include <httplib.h>
#include <openssl/sha.h>

#include <algorithm>
#include <cctype>
#include <deque>
#include <nlohmann/json.hpp>
#include <thread>

namespace kdray::test {
namespace {

using Json = nlohmann::json;

std::string Sha256(const std::string& bytes) {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), digest);
  std::string text;
  for (const unsigned char byte : digest) {
    constexpr char kHex[] = "0123456789abcdef";
    text += {kHex[byte >> 4], kHex[byte & 15]};
  }
  return text;
}

void Refuse(httplib::Response& response, int status, const std::string& code,
            const std::string& detail) {
  response.status = status;
  response.set_content(ProblemJson(status, code, detail), "application/problem+json");
}

}  // namespace

std::string ProblemJson(int status, const std::string& code, const std::string& detail,
                        const std::string& more) {
  Json problem = {{"type", "/problems/" + code},
                  {"title", code},
                  {"status", status},
                  {"detail", detail},
                  {"code", code},
                  {"request_id", "req-7"}};
  problem.update(Json::parse(more));
  return problem.dump();
}

struct FakeService::Impl {
  struct StoredTree {
    std::string id;
    int polls_left = 0;
  };
  struct Scripted {
    std::string method;
    std::string target_prefix;
    FakeAnswer answer;
  };

  Json Describe(const StoredTree& tree) const {
    const bool ready = tree.polls_left <= 0;
    Json description = {{"id", tree.id},
                        {"state", ready ? "ready" : "building"},
                        {"progress", ready ? 1.0 : 0.5},
                        {"created_at", "2026-01-02T03:04:05.678Z"},
                        {"mesh",
                         {{"sha256", tree.id.substr(0, 64)},
                          {"format", "ply"},
                          {"bytes", 2048},
                          {"triangles", 1234567},
                          {"vertices", 617000},
                          {"bounds", {{"min", {-1, -1, -1}}, {"max", {1, 1, 1}}}},
                          {"health", {{"closed", false}, {"open_edges", 3}}}}},
                        {"something_new", "clients ignore what they do not know"}};
    if (ready)
      description["tree"] = {
          {"build", "kd-sah"}, {"nodes", 99}, {"leaves", 50}, {"build_ms", 12.5}, {"max_depth", 9}};
    return description;
  }

  StoredTree* Find(const std::string& id) {
    const auto tree =
        std::find_if(trees.begin(), trees.end(), [&](const StoredTree& t) { return t.id == id; });
    return tree == trees.end() ? nullptr : &*tree;
  }

  httplib::Server server;
  int port = 0;
  std::thread thread;
  mutable std::mutex mutex;  // of what follows
  std::vector<SeenRequest> seen;
  std::deque<StoredTree> trees;  // newest first
  std::map<std::string, std::string> meshes;
  std::vector<Scripted> scripted;
};

FakeService::FakeService() : impl_(std::make_unique<Impl>()) {
  Impl& impl = *impl_;
  httplib::Server& server = impl.server;

  // Every request passes here first: it is noted, and answered when a test has scripted that.
  const auto wrap = [this, &impl](auto handler) {
    return [this, &impl, handler](const httplib::Request& request, httplib::Response& response) {
      const std::lock_guard lock(impl.mutex);
      SeenRequest seen = {request.method, request.target, {}, request.body};
      for (const auto& [name, value] : request.headers) {
        std::string lower = name;
        std::transform(lower.begin(), lower.end(), lower.begin(),
                       [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
        seen.headers.emplace(std::move(lower), value);
      }
      impl.seen.push_back(std::move(seen));
      for (auto script = impl.scripted.begin(); script != impl.scripted.end(); ++script) {
        if (script->method != request.method || !request.target.starts_with(script->target_prefix))
          continue;
        response.status = script->answer.status;
        response.set_content(script->answer.body, script->answer.content_type.c_str());
        impl.scripted.erase(script);
        return;
      }
      if (!token.empty() && request.get_header_value("Authorization") != "Bearer " + token)
        return Refuse(response, 401, "unauthorized", "a token is needed");
      handler(request, response);
    };
  };
  const auto with_tree = [&impl, wrap](auto handler) {
    return wrap([&impl, handler](const httplib::Request& request, httplib::Response& response) {
      Impl::StoredTree* tree = impl.Find(request.matches[1]);
      if (tree == nullptr)
        return Refuse(response, 404, "tree_not_found", "no tree of this id; upload again");
      handler(*tree, request, response);
    });
  };

  server.Get("/v1", wrap([this](const httplib::Request&, httplib::Response& response) {
               const Json info = {{"name", "kdrayd"},
                                  {"limits", {{"max_upload_bytes", max_upload_bytes.load()}}}};
               response.set_content(info.dump(), "application/json");
             }));

  server.Post("/v1/trees",
              wrap([this, &impl](const httplib::Request& request, httplib::Response& response) {
                std::string sha256 = request.get_param_value("mesh");
                if (!sha256.empty() && !impl.meshes.contains(sha256))
                  return Refuse(response, 404, "mesh_not_found", "no mesh of this digest");
                if (sha256.empty()) {
                  sha256 = Sha256(request.body);
                  impl.meshes[sha256] = request.body;
                }
                const std::string id = sha256 + "-" + request.get_param_value("build");
                response.status = 200;
                if (impl.Find(id) == nullptr) {
                  impl.trees.push_front({id, polls_until_ready});
                  response.status = polls_until_ready > 0 ? 202 : 201;
                }
                response.set_content(impl.Describe(*impl.Find(id)).dump(), "application/json");
              }));

  server.Get("/v1/trees",
             wrap([this, &impl](const httplib::Request& request, httplib::Response& response) {
               const std::string after = request.get_param_value("after");
               const std::size_t first = after.empty() ? 0 : std::stoul(after);
               const std::size_t last = std::min(first + page_size, impl.trees.size());
               Json page = {{"trees", Json::array()}, {"next", nullptr}};
               for (std::size_t i = first; i < last; ++i)
                 page["trees"].push_back(impl.Describe(impl.trees[i]));
               if (last < impl.trees.size()) page["next"] = std::to_string(last);
               response.set_content(page.dump(), "application/json");
             }));

  server.Get("/v1/trees/([^/]+)",
             with_tree([&impl](Impl::StoredTree& tree, const auto&, httplib::Response& response) {
               if (tree.polls_left > 0) --tree.polls_left;
               response.set_content(impl.Describe(tree).dump(), "application/json");
             }));
  server.Delete("/v1/trees/([^/]+)", with_tree([&impl](Impl::StoredTree& tree, const auto&,
                                                       httplib::Response& response) {
                  std::erase_if(impl.trees, [id = tree.id](const auto& t) { return t.id == id; });
                  response.status = 204;
                }));
  server.Get("/v1/trees/([^/]+)/mesh",
             with_tree([&impl](Impl::StoredTree& tree, const auto&, httplib::Response& response) {
               response.set_content(impl.meshes[tree.id.substr(0, 64)], "application/octet-stream");
             }));
  server.Get("/v1/trees/([^/]+)/render\\.(png|npy)",
             with_tree([](Impl::StoredTree&, const httplib::Request& request,
                          httplib::Response& response) {
               response.set_header("Kdray-Precision", "watertight");
               response.set_header("Server-Timing", "queue;dur=0.1, trace;dur=23.5");
               response.set_content("picture as " + std::string(request.matches[2]), "image/png");
             }));
  server.Post("/v1/trees/([^/]+)/rays/(closest|any)",
              with_tree([](Impl::StoredTree&, const httplib::Request& request,
                           httplib::Response& response) {
                response.set_header("Kdray-Invalid", "3");
                response.set_content("hits for " + request.body, "application/x-npy");
              }));
  server.Get("/v1/trees/([^/]+)/cells",
             with_tree([](Impl::StoredTree&, const auto&, httplib::Response& response) {
               const Json cells = {{"cells",
                                    {{{"min", {0, 0, 0}},
                                      {"max", {1, 2, 3}},
                                      {"depth", 1},
                                      {"leaf", true},
                                      {"triangles", 4321}}}}};
               response.set_content(cells.dump(), "application/json");
             }));

  // It measures nothing itself; tests script what it answers.
  const auto not_measured =
      with_tree([](Impl::StoredTree&, const auto&, httplib::Response& response) {
        Refuse(response, 404, "not_measured", "nothing has been measured for this tree");
      });
  server.Get("/v1/trees/([^/]+)/tradeoff", not_measured);
  server.Post("/v1/trees/([^/]+)/tradeoff", not_measured);
  server.Delete("/v1/trees/([^/]+)/tradeoff", not_measured);

  impl.port = server.bind_to_any_port("127.0.0.1");
  impl.thread = std::thread([&server] { server.listen_after_bind(); });
  while (!server.is_running()) std::this_thread::yield();
}

FakeService::~FakeService() {
  impl_->server.stop();
  impl_->thread.join();
}

std::string FakeService::Url() const { return "http://127.0.0.1:" + std::to_string(impl_->port); }

std::vector<SeenRequest> FakeService::Seen() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->seen;
}

std::vector<std::string> FakeService::Targets(const std::string& method) const {
  std::vector<std::string> targets;
  for (const SeenRequest& request : Seen())
    if (request.method == method) targets.push_back(request.target);
  return targets;
}

void FakeService::AddTree(const std::string& id, bool ready) {
  const std::lock_guard lock(impl_->mutex);
  impl_->trees.push_front({id, ready ? 0 : 1});
}

bool FakeService::HasTree(const std::string& id) const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->Find(id) != nullptr;
}

void FakeService::AnswerOnce(const std::string& method, const std::string& target_prefix,
                             FakeAnswer answer) {
  const std::lock_guard lock(impl_->mutex);
  impl_->scripted.push_back({method, target_prefix, std::move(answer)});
}

}  // namespace kdray::test
