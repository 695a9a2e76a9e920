// SPDX-License-Identifier: Apache-2.0
#include "server/s3_requests.h"

#include <curl/curl.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

#include "core/base/hash.h"
#include "core/store/object_store.h"
#include "server/s3_signature.h"

namespace kdray::server {
namespace {

using core::CancelToken;
using core::Error;
using core::ErrorCode;
using core::Result;
using core::Status;

constexpr long kConnectMs = 3000;
// A body does not wait longer for a 100, which not every store sends.
constexpr long kContinueMs = 100;
constexpr long kStallBytesPerSecond = 200;
// S3 allows a difference of 15 minutes. Less than this one comes from the network, not from clocks.
constexpr std::int64_t kMostClockDifferenceS = 60;
// Poll interval; a CancelToken has no notification.
constexpr int kLookAgainMs = 50;
// A page of 1000 keys has about 400 KiB.
constexpr std::size_t kMostXmlBytes = std::size_t{4} << 20;

// libcurl calls both kinds of handles void.
struct MultiFreer {
  void operator()(CURLM* multi) const { curl_multi_cleanup(multi); }
};
struct EasyFreer {
  void operator()(CURL* easy) const { curl_easy_cleanup(easy); }
};
struct ListFreer {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};
using HeaderList = std::unique_ptr<curl_slist, ListFreer>;

/// A connection that is kept: libcurl keeps it in the multi handle.
struct Line {
  std::unique_ptr<CURLM, MultiFreer> multi{curl_multi_init()};
  std::unique_ptr<CURL, EasyFreer> easy{curl_easy_init()};
};

/// Percent-encoded as the signature wants it: everything except A-Z, a-z, 0-9, '-', '.', '_', '~'.
std::string Encoded(std::string_view text, bool keep_slashes) {
  std::string encoded;
  for (const char c : text) {
    const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                          (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_' || c == '~';
    if (is_plain || (keep_slashes && c == '/')) {
      encoded += c;
    } else {
      constexpr char kDigits[] = "0123456789ABCDEF";
      const auto byte = static_cast<unsigned char>(c);
      encoded += {'%', kDigits[byte >> 4], kDigits[byte & 15]};
    }
  }
  return encoded;
}

std::string ToText(const std::map<std::string, std::string>& query) {
  std::string text;
  for (const auto& [name, value] : query) {
    text += (text.empty() ? "" : "&") + name + "=" + Encoded(value, false);
  }
  return text;
}

struct Transfer {
  const S3Request* request;
  S3Answer* answer;
  CURL* easy;
};

std::size_t OnBody(char* data, std::size_t one, std::size_t count, void* context) {
  const std::size_t bytes = one * count;
  const auto& transfer = *static_cast<Transfer*>(context);
  S3Answer& answer = *transfer.answer;
  long status = 0;
  curl_easy_getinfo(transfer.easy, CURLINFO_RESPONSE_CODE, &status);
  const std::span<std::byte> out = transfer.request->out;
  if (status < 300 && !out.empty()) {
    if (bytes > out.size() - answer.filled) {
      answer.is_too_long = true;
      return 0;
    }
    std::memcpy(out.data() + answer.filled, data, bytes);
    answer.filled += bytes;
    return bytes;
  }
  if (bytes > kMostXmlBytes - answer.text.size()) {
    answer.is_too_long = true;
    return 0;
  }
  answer.text.append(data, bytes);
  return bytes;
}

bool TakeHeader(std::string_view line, std::string_view name, std::string* value) {
  if (line.size() <= name.size() || line[name.size()] != ':') return false;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const char c = line[i];
    if ((c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c) != name[i]) return false;
  }
  line.remove_prefix(name.size() + 1);
  while (!line.empty() && line.front() == ' ') line.remove_prefix(1);
  while (!line.empty() && (line.back() == '\r' || line.back() == '\n' || line.back() == ' ')) {
    line.remove_suffix(1);
  }
  *value = line;
  return true;
}

std::size_t OnHeader(char* data, std::size_t one, std::size_t count, void* context) {
  const std::string_view line(data, one * count);
  S3Answer& answer = *static_cast<Transfer*>(context)->answer;
  (void)(TakeHeader(line, "etag", &answer.etag) ||
         TakeHeader(line, "content-length", &answer.length) ||
         TakeHeader(line, "last-modified", &answer.modified) ||
         TakeHeader(line, "date", &answer.date));
  return one * count;
}

std::int64_t MachineNowMs() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

Error Altered(const char* what) {
  return Error{ErrorCode::kCorrupt, std::string("the store's answer ") + what};
}

Error ErrorOf(CURLcode code, const S3Answer& answer) {
  if (answer.is_too_long) return Altered("is longer than it should be");
  if (code == CURLE_PARTIAL_FILE) return Altered("ends too early");
  if (code == CURLE_PEER_FAILED_VERIFICATION || code == CURLE_SSL_CACERT_BADFILE) {
    return Error{ErrorCode::kStoreFull, "the store's certificate is not valid"};
  }
  return core::StoreIsAway(std::string("the store does not answer: ") + curl_easy_strerror(code));
}

}  // namespace

struct S3Requests::State {
  State(std::string bucket, SettingsSource source, AwsSettings settings)
      : bucket_(std::move(bucket)), source_(std::move(source)), settings_(std::move(settings)) {}

  struct Address {
    std::string origin;  // as https://host:port
    std::string host;    // as the header has it
    std::string path;    // encoded
    std::string query;   // encoded, without '?'
    std::string ToUrl() const { return origin + path + (query.empty() ? "" : "?" + query); }
  };
  // Amazon's buckets have hosts of their own. Other services, and names with dots, which no
  // certificate covers, have the bucket in the path.
  Address AddressOf(const S3Request& request, const AwsSettings& settings) const {
    Address address{settings.endpoint, "", "/" + bucket_ + "/", ToText(request.query)};
    if (settings.endpoint.empty()) {
      const bool has_dot = bucket_.find('.') != std::string::npos;
      const std::string host = "s3." + settings.region + ".amazonaws.com";
      address.origin = "https://" + (has_dot ? "" : bucket_ + ".") + host;
      if (!has_dot) address.path = "/";
    }
    address.path += Encoded(request.key, true);
    address.host = address.origin.substr(address.origin.find("//") + 2);
    // Clients do not name the port of the scheme.
    const std::string_view port = address.origin.starts_with("https:") ? ":443" : ":80";
    if (address.host.ends_with(port)) address.host.resize(address.host.size() - port.size());
    return address;
  }

  bool RenewCredentials(const S3Answer& answer) {
    {
      const std::lock_guard lock(mutex_);
      if (version_ != answer.settings) return true;
    }
    Result<AwsSettings> settings = source_();
    if (!settings.ok()) return false;
    const std::lock_guard lock(mutex_);
    if (version_ != answer.settings) return true;
    const AwsCredentials& old = settings_.credentials;
    const AwsCredentials& now = settings->credentials;
    const bool has_changed = old.key_id != now.key_id || old.secret != now.secret ||
                             old.session_token != now.session_token;
    if (!has_changed) return false;
    settings_ = *std::move(settings);
    ++version_;
    return true;
  }

  Line TakeLine() {
    {
      const std::lock_guard lock(mutex_);
      if (!lines_.empty()) {
        Line line = std::move(lines_.back());
        lines_.pop_back();
        return line;
      }
    }
    return {};
  }
  void GiveBack(Line line) {
    const std::lock_guard lock(mutex_);
    lines_.push_back(std::move(line));
  }

  Result<S3Answer> Send(const S3Request& request, const CancelToken& cancel) {
    if (cancel.ShouldStop()) return cancel.ToError();
    S3Answer answer;
    AwsSettings settings;
    {
      const std::lock_guard lock(mutex_);
      settings = settings_;
      answer.settings = version_;
    }
    Line line = TakeLine();
    CURL* const easy = line.easy.get();
    if (easy == nullptr || line.multi == nullptr) {
      return Error{ErrorCode::kMemoryFull, "there is no memory for a request to the store"};
    }
    const Address address = AddressOf(request, settings);
    const std::string url = address.ToUrl();
    answer.signed_at_s = NowMs() / 1000;
    const HeaderList headers = HeadersOf(request, address, settings, answer.signed_at_s);
    Transfer transfer{&request, &answer, easy};

    curl_easy_reset(easy);
    curl_easy_setopt(easy, CURLOPT_URL, url.c_str());
    curl_easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(easy, CURLOPT_PATH_AS_IS, 1L);
    curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(easy, CURLOPT_CONNECTTIMEOUT_MS, kConnectMs);
    curl_easy_setopt(easy, CURLOPT_LOW_SPEED_TIME, request.stall_seconds);
    curl_easy_setopt(easy, CURLOPT_LOW_SPEED_LIMIT, kStallBytesPerSecond);
    curl_easy_setopt(easy, CURLOPT_EXPECT_100_TIMEOUT_MS, kContinueMs);
    if (!settings.ca_file.empty()) {
      curl_easy_setopt(easy, CURLOPT_CAINFO, settings.ca_file.c_str());
    }
    curl_easy_setopt(easy, CURLOPT_HTTPHEADER, headers.get());
    curl_easy_setopt(easy, CURLOPT_WRITEFUNCTION, OnBody);
    curl_easy_setopt(easy, CURLOPT_WRITEDATA, &transfer);
    curl_easy_setopt(easy, CURLOPT_HEADERFUNCTION, OnHeader);
    curl_easy_setopt(easy, CURLOPT_HEADERDATA, &transfer);
    if (request.has_body) {
      // The first byte of an empty body is not read.
      static constexpr char kNothing = 0;
      curl_easy_setopt(easy, CURLOPT_POSTFIELDSIZE_LARGE,
                       static_cast<curl_off_t>(request.body.size()));
      curl_easy_setopt(
          easy, CURLOPT_POSTFIELDS,
          request.body.empty() ? &kNothing : reinterpret_cast<const char*>(request.body.data()));
    }
    if (std::strcmp(request.method, "HEAD") == 0) {
      curl_easy_setopt(easy, CURLOPT_NOBODY, 1L);
    } else if (std::strcmp(request.method, "GET") != 0) {
      curl_easy_setopt(easy, CURLOPT_CUSTOMREQUEST, request.method);
    }

    const std::optional<CURLcode> code = Run(line.multi.get(), easy, cancel);
    if (!code) return cancel.ToError();  // the connection is closed with the line
    if (*code != CURLE_OK) return ErrorOf(*code, answer);
    curl_easy_getinfo(easy, CURLINFO_RESPONSE_CODE, &answer.status);
    curl_easy_reset(easy);
    GiveBack(std::move(line));
    return answer;
  }

  // All headers that libcurl does not make itself, with the signature of them all.
  static HeaderList HeadersOf(const S3Request& request, const Address& address,
                              const AwsSettings& settings, std::int64_t now_s) {
    S3Signable parts{request.method, address.path, address.query, request.headers};
    std::map<std::string, std::string>& headers = parts.headers;
    headers["host"] = address.host;
    headers["x-amz-date"] = AmzDate(now_s);
    headers["x-amz-content-sha256"] = core::HashBytes(request.body).ToHex();
    if (!settings.credentials.session_token.empty()) {
      headers["x-amz-security-token"] = settings.credentials.session_token;
    }
    if (request.has_body) headers.try_emplace("content-type", "application/octet-stream");
    const std::string signature = S3Authorization(parts, settings.credentials, settings.region);

    HeaderList list;
    const auto add = [&](const std::string& name, const std::string& value) {
      curl_slist* const longer = curl_slist_append(list.get(), (name + ": " + value).c_str());
      if (longer == nullptr) throw std::bad_alloc();
      (void)list.release();
      list.reset(longer);
    };
    for (const auto& [name, value] : headers) add(name, value);
    add("authorization", signature);
    return list;
  }

  std::int64_t NowMs() const { return MachineNowMs() + clock_offset_ms_; }

  bool FollowClock(const S3Answer& answer) {
    const std::optional<std::int64_t> date = S3Requests::ParseDate(answer.date);
    if (!date || std::abs(*date - answer.signed_at_s) <= kMostClockDifferenceS) return false;
    clock_offset_ms_ = *date * 1000 - MachineNowMs();
    return true;
  }

  /// nullopt if it was cancelled.
  static std::optional<CURLcode> Run(CURLM* multi, CURL* easy, const CancelToken& cancel) {
    struct Removal {
      ~Removal() { curl_multi_remove_handle(multi, easy); }
      CURLM* multi;
      CURL* easy;
    };
    if (curl_multi_add_handle(multi, easy) != CURLM_OK) return CURLE_FAILED_INIT;
    const Removal removal{multi, easy};
    for (int running = 1;;) {
      if (curl_multi_perform(multi, &running) != CURLM_OK) return CURLE_FAILED_INIT;
      if (running == 0) break;
      if (cancel.ShouldStop()) return std::nullopt;
      curl_multi_poll(multi, nullptr, 0, kLookAgainMs, nullptr);
    }
    int left = 0;
    while (const CURLMsg* message = curl_multi_info_read(multi, &left)) {
      if (message->msg == CURLMSG_DONE) return message->data.result;
    }
    return CURLE_FAILED_INIT;
  }

  const std::string bucket_;
  const SettingsSource source_;

  mutable std::mutex mutex_;
  AwsSettings settings_;
  std::uint64_t version_ = 0;  // of settings_
  std::vector<Line> lines_;    // that no request uses

  std::atomic<std::int64_t> clock_offset_ms_{0};  // from this machine's clock to the store's
};

Status S3Requests::Start() {
  static const CURLcode started = curl_global_init(CURL_GLOBAL_DEFAULT);
  if (started == CURLE_OK) return {};
  return Error{ErrorCode::kMemoryFull, "the HTTP client does not start"};
}

std::optional<std::int64_t> S3Requests::ParseDate(const std::string& text) {
  const std::time_t time = curl_getdate(text.c_str(), nullptr);
  if (time <= 0) return std::nullopt;
  return std::int64_t{time};
}

S3Requests::S3Requests(std::string bucket, SettingsSource source, AwsSettings settings)
    : state_(std::make_unique<State>(std::move(bucket), std::move(source), std::move(settings))) {}

S3Requests::~S3Requests() = default;

Result<S3Answer> S3Requests::Send(const S3Request& request, const CancelToken& cancel) {
  return state_->Send(request, cancel);
}

bool S3Requests::RenewCredentials(const S3Answer& answer) {
  return state_->RenewCredentials(answer);
}

bool S3Requests::FollowClock(const S3Answer& answer) { return state_->FollowClock(answer); }

std::int64_t S3Requests::NowMs() const { return state_->NowMs(); }

}  // namespace kdray::server
