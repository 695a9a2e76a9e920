// SPDX-License-Identifier: Apache-2.0
// A stand-in for kdrayd that speaks the contract's words without tracing anything: for tests of
// what a client sends and of what it makes of the answers. The real daemon is met in tests/clients.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace kdray::test {

/// One request as it came in.
struct SeenRequest {
  std::string method;
  std::string target;                               ///< path and query, as sent
  std::multimap<std::string, std::string> headers;  ///< names in lower case
  std::string body;
};

struct FakeAnswer {
  int status = 200;
  std::string body;
  std::string content_type = "application/json";
};

/// Listens on a free port of 127.0.0.1 from construction to destruction.
class FakeService {
 public:
  FakeService();
  ~FakeService();

  std::string Url() const;

  /// What came in so far, oldest first.
  std::vector<SeenRequest> Seen() const;
  /// Targets of the requests with that method.
  std::vector<std::string> Targets(const std::string& method) const;

  /// A tree that is there from the start.
  void AddTree(const std::string& id, bool ready = true);
  bool HasTree(const std::string& id) const;

  /// Answers the next request whose target begins so with this instead.
  void AnswerOnce(const std::string& method, const std::string& target_prefix, FakeAnswer answer);

  std::atomic<int> polls_until_ready = 0;  ///< GETs that a new tree still answers `building`
  std::atomic<std::uint64_t> max_upload_bytes = std::uint64_t{1} << 30;
  std::string token;            ///< wanted of every request when not empty
  std::size_t page_size = 100;  ///< trees a page of the list

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A problem document. `more` is a JSON object with further members.
std::string ProblemJson(int status, const std::string& code, const std::string& detail,
                        const std::string& more = "{}");

}  // namespace kdray::test
