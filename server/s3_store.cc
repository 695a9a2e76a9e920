// SPDX-License-Identifier: Apache-2.0
#include "server/s3_store.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstring>
#include <ctime>
#include <map>
#include <mutex>
#include <pugixml.hpp>
#include <string>
#include <utility>
#include <vector>

#include "server/s3_requests.h"

namespace kdray::server {
namespace {

using core::CancelToken;
using core::Error;
using core::ErrorCode;
using core::ObjectInfo;
using core::ObjectPage;
using core::PutMode;
using core::Result;
using core::Status;
using Request = S3Request;
using Answer = S3Answer;

constexpr long kJoinSeconds = 60;

/// 2026-11-29T11:22:33.000Z; 0 for another text.
std::int64_t ParseIsoMs(const char* text) {
  std::tm parts{};
  if (strptime(text, "%Y-%m-%dT%H:%M:%S", &parts) == nullptr) return 0;
  return static_cast<std::int64_t>(timegm(&parts)) * 1000;
}

std::optional<std::uint64_t> ParseSize(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

/// The code of S3's error, or "".
std::string ErrorCodeOf(const Answer& answer) {
  pugi::xml_document document;
  if (!document.load_buffer(answer.text.data(), answer.text.size())) return "";
  std::string code = document.child("Error").child_value("Code");
  if (code.size() > 64 || !std::all_of(code.begin(), code.end(), [](char c) {
        return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
      })) {
    return "";
  }
  return code;
}

Error Altered(const char* what) {
  return Error{ErrorCode::kCorrupt, std::string("the store's answer ") + what};
}

class S3Store final : public core::ObjectStore {
 public:
  S3Store(const StoreUrl& url, SettingsSource source, AwsSettings settings)
      : prefix_(url.prefix.empty() ? "" : url.prefix + "/"),
        requests_(url.bucket, std::move(source), std::move(settings)) {}

  std::int64_t NowMs() const override { return requests_.NowMs(); }

  Result<ObjectPage> List(std::string_view prefix, std::string_view after, std::size_t limit,
                          const CancelToken& cancel) override {
    Request request;
    request.query = {
        {"list-type", "2"}, {"max-keys", std::to_string(limit)}, {"prefix", FullKey(prefix)}};
    if (!after.empty()) request.query["start-after"] = FullKey(after);
    const Result<Answer> answer = Send(request, cancel);
    if (!answer.ok()) return answer.error();
    if (answer->status != 200) return Refused(*answer);
    pugi::xml_document document;
    const bool is_xml = document.load_buffer(answer->text.data(), answer->text.size());
    const pugi::xml_node result = document.child("ListBucketResult");
    if (!is_xml || !result) return Altered("is no list");
    ObjectPage page;
    for (const pugi::xml_node object : result.children("Contents")) {
      const std::string_view key = object.child_value("Key");
      const auto bytes = ParseSize(object.child_value("Size"));
      const std::string start = FullKey("");
      if (!key.starts_with(start) || !bytes) return Altered("is no list of this prefix");
      page.objects.push_back({std::string(key.substr(start.size())), *bytes,
                              ParseIsoMs(object.child_value("LastModified"))});
    }
    page.has_more = std::string_view(result.child_value("IsTruncated")) == "true";
    return page;
  }

  Result<ObjectInfo> Head(std::string_view key, const CancelToken& cancel) override {
    Request request;
    request.method = "HEAD";
    request.key = FullKey(key);
    const Result<Answer> answer = Send(request, cancel);
    if (!answer.ok()) return answer.error();
    if (answer->status != 200) return Refused(*answer);
    const auto bytes = ParseSize(answer->length);
    if (!bytes) return Altered("has no length");
    ObjectInfo info{std::string(key), *bytes, 0};
    info.modified_ms = S3Requests::ParseDate(answer->modified).value_or(0) * 1000;
    return info;
  }

  Status Get(std::string_view key, std::uint64_t offset, std::span<std::byte> out,
             const CancelToken& cancel) override {
    Request request;
    request.key = FullKey(key);
    request.out = out;
    request.headers["range"] =
        "bytes=" + std::to_string(offset) + "-" + std::to_string(offset + out.size() - 1);
    const Result<Answer> answer = Send(request, cancel);
    if (!answer.ok()) return answer.error();
    if (answer->status == 416) return Altered("says that the object is shorter");
    // A store may send all of a small object.
    const bool is_whole = answer->status == 200 && offset == 0;
    if (answer->status != 206 && !is_whole) return Refused(*answer);
    if (answer->filled != out.size()) return Altered("ends too early");
    return {};
  }

  Status Put(std::string_view key, std::span<const std::byte> bytes, PutMode mode,
             const CancelToken& cancel) override {
    Request request;
    request.method = "PUT";
    request.key = FullKey(key);
    request.body = bytes;
    request.has_body = true;
    const Result<Answer> answer = Write(request, mode, cancel);
    if (!answer.ok()) return answer.error();
    return {};
  }

  Status Delete(std::string_view key, const CancelToken& cancel) override {
    Request request;
    request.method = "DELETE";
    request.key = FullKey(key);
    const Result<Answer> answer = Send(request, cancel);
    if (!answer.ok()) return answer.error();
    if (answer->status == 204 || answer->status == 200) return {};
    Error error = Refused(*answer);
    if (error.code == ErrorCode::kNotFound) return {};
    return error;
  }

  Result<std::string> BeginParts(std::string_view key, const CancelToken& cancel) override {
    Request request;
    request.method = "POST";
    request.key = FullKey(key);
    request.query = {{"uploads", ""}};
    request.has_body = true;
    const Result<Answer> answer = Write(request, PutMode::kReplace, cancel);
    if (!answer.ok()) return answer.error();
    pugi::xml_document document;
    (void)document.load_buffer(answer->text.data(), answer->text.size());
    std::string upload = document.child("InitiateMultipartUploadResult").child_value("UploadId");
    if (upload.empty()) return Altered("names no upload");
    return upload;
  }

  Result<std::string> PutPart(std::string_view key, std::string_view upload, int number,
                              std::span<const std::byte> bytes,
                              const CancelToken& cancel) override {
    Request request;
    request.method = "PUT";
    request.key = FullKey(key);
    request.query = {{"partNumber", std::to_string(number)}, {"uploadId", std::string(upload)}};
    request.body = bytes;
    request.has_body = true;
    Result<Answer> answer = Write(request, PutMode::kReplace, cancel);
    if (!answer.ok()) return std::move(answer).error();
    if (answer->etag.empty()) return Altered("has no tag");
    return std::move(answer->etag);
  }

  Status FinishParts(std::string_view key, std::string_view upload,
                     std::span<const std::string> tags, PutMode mode,
                     const CancelToken& cancel) override {
    pugi::xml_document list;
    pugi::xml_node root = list.append_child("CompleteMultipartUpload");
    int number = 1;
    for (const std::string& tag : tags) {
      pugi::xml_node part = root.append_child("Part");
      part.append_child("PartNumber").text().set(number++);
      part.append_child("ETag").text().set(tag.c_str());
    }
    struct Writer final : pugi::xml_writer {
      void write(const void* data, std::size_t size) override {
        text.append(static_cast<const char*>(data), size);
      }
      std::string text;
    } writer;
    list.save(writer, "", pugi::format_raw);
    Request request;
    request.method = "POST";
    request.key = FullKey(key);
    request.query = {{"uploadId", std::string(upload)}};
    request.body = std::as_bytes(std::span(writer.text));
    request.has_body = true;
    request.headers["content-type"] = "application/xml";
    // S3 joins the parts before it answers.
    request.stall_seconds = kJoinSeconds;
    const Result<Answer> answer = Write(request, mode, cancel);
    if (!answer.ok()) return answer.error();
    if (answer->status == 412) return AbortParts(key, upload, cancel);
    // S3 begins the answer before it knows its end, so an error may follow the status 200.
    pugi::xml_document document;
    (void)document.load_buffer(answer->text.data(), answer->text.size());
    if (!document.child("CompleteMultipartUploadResult")) {
      return core::StoreIsAway("the store could not join the parts: " + ErrorCodeOf(*answer));
    }
    return {};
  }

  Status AbortParts(std::string_view key, std::string_view upload,
                    const CancelToken& cancel) override {
    Request request;
    request.method = "DELETE";
    request.key = FullKey(key);
    request.query = {{"uploadId", std::string(upload)}};
    const Result<Answer> answer = Send(request, cancel);
    if (!answer.ok()) return answer.error();
    if (answer->status == 204 || answer->status == 200) return {};
    Error error = Refused(*answer);
    if (error.code == ErrorCode::kNotFound) return {};
    return error;
  }

 private:
  std::string FullKey(std::string_view key) const { return prefix_ + std::string(key); }

  /// A refusal may have its cause in the clock of this machine: S3 refuses a signature whose time
  /// is more than a quarter of an hour from its own. Then the request is signed once more, by the
  /// clock of the answer. The status tells it, because the answer to HEAD names no error.
  Result<Answer> Send(const Request& request, const CancelToken& cancel) {
    Result<Answer> answer = requests_.Send(request, cancel);
    if (!answer.ok() || answer->status != 403 || !requests_.FollowClock(*answer)) return answer;
    return requests_.Send(request, cancel);
  }

  /// A request that must succeed. 412 is success, if it is asked for: the object is there.
  Result<Answer> Write(Request request, PutMode mode, const CancelToken& cancel) {
    const bool is_conditional = mode == PutMode::kKeep && has_conditional_writes_;
    if (is_conditional) request.headers["if-none-match"] = "*";
    Result<Answer> answer = Send(request, cancel);
    if (!answer.ok()) return answer;
    if (answer->status == 200 || answer->status == 204) return answer;
    if (is_conditional && answer->status == 412) return answer;
    if (is_conditional && (answer->status == 501 || ErrorCodeOf(*answer) == "NotImplemented")) {
      has_conditional_writes_ = false;
      return core::StoreIsAway("the store has no conditional writes; the next attempt uses none");
    }
    return Refused(*answer);
  }

  /// What an answer that is no success means. May change the credentials for the next attempt.
  Error Refused(const Answer& answer) {
    const std::string code = ErrorCodeOf(answer);
    const std::string what =
        "HTTP status " + std::to_string(answer.status) + (code.empty() ? "" : " " + code);
    if (code == "RequestTimeTooSkewed") {
      return core::StoreIsAway("the clocks of store and server differ too much: " + what);
    }
    // The answer to HEAD names no error.
    const bool may_have_expired = code == "ExpiredToken" || code == "InvalidAccessKeyId" ||
                                  code == "TokenRefreshRequired" || code == "InvalidToken" ||
                                  (code.empty() && (answer.status == 400 || answer.status == 403));
    if (may_have_expired && requests_.RenewCredentials(answer)) {
      return core::StoreIsAway("the credentials have expired: " + what);
    }
    if (answer.status == 404 && code != "NoSuchBucket") {
      return Error{ErrorCode::kNotFound, "the store has no such object"};
    }
    const bool is_passing = answer.status == 408 || answer.status == 409 || answer.status == 429 ||
                            (answer.status >= 500 && answer.status != 501 && answer.status != 505 &&
                             answer.status != 507) ||
                            code == "RequestTimeout" || code == "BadDigest" ||
                            code == "XAmzContentSHA256Mismatch" || code == "IncompleteBody";
    if (is_passing) return core::StoreIsAway("the store is busy or altered: " + what);
    return Error{ErrorCode::kStoreFull, "the store refuses: " + what};
  }

  const std::string prefix_;  // of all keys, with a slash at its end, or empty
  S3Requests requests_;
  std::atomic<bool> has_conditional_writes_{true};
};

}  // namespace

Result<std::unique_ptr<core::ObjectStore>> MakeS3Store(const StoreUrl& url,
                                                       SettingsSource settings) {
  if (Status started = S3Requests::Start(); !started.ok()) return std::move(started).error();
  Result<AwsSettings> read = settings();
  if (!read.ok()) return std::move(read).error();
  return std::unique_ptr<core::ObjectStore>(
      std::make_unique<S3Store>(url, std::move(settings), *std::move(read)));
}

}  // namespace kdray::server
