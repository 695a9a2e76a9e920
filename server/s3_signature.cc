// SPDX-License-Identifier: Apache-2.0
#include "server/s3_signature.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <algorithm>
#include <ctime>
#include <new>
#include <span>
#include <string_view>

#include "core/base/hash.h"

namespace kdray::server {
namespace {

constexpr std::string_view kAlgorithm = "AWS4-HMAC-SHA256";

core::Sha256Digest Hmac(std::string_view key, std::string_view text) {
  core::Sha256Digest digest;
  const unsigned char* const made = HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()),
                                         reinterpret_cast<const unsigned char*>(text.data()),
                                         text.size(), digest.bytes.data(), nullptr);
  if (made == nullptr) throw std::bad_alloc();
  return digest;
}

std::string_view AsText(const core::Sha256Digest& digest) {
  return {reinterpret_cast<const char*>(digest.bytes.data()), digest.bytes.size()};
}

}  // namespace

std::string AmzDate(std::int64_t seconds) {
  const auto time = static_cast<std::time_t>(seconds);
  std::tm parts{};
  gmtime_r(&time, &parts);
  char text[32];
  return {text, std::strftime(text, sizeof(text), "%Y%m%dT%H%M%SZ", &parts)};
}

std::string S3Authorization(const S3Signable& request, const AwsCredentials& credentials,
                            const std::string& region) {
  std::string headers, names;
  for (const auto& [name, value] : request.headers) {
    headers += name + ":" + value + "\n";
    names += (names.empty() ? "" : ";") + name;
  }
  const std::string canonical = request.method + "\n" + request.path + "\n" + request.query + "\n" +
                                headers + "\n" + names + "\n" +
                                request.headers.at("x-amz-content-sha256");
  const std::string& date = request.headers.at("x-amz-date");
  const std::string day = date.substr(0, 8);
  const std::string scope = day + "/" + region + "/s3/aws4_request";
  const std::string text = std::string(kAlgorithm) + "\n" + date + "\n" + scope + "\n" +
                           core::HashBytes(std::as_bytes(std::span(canonical))).ToHex();
  core::Sha256Digest key = Hmac("AWS4" + credentials.secret, day);
  for (const std::string_view part :
       {std::string_view(region), std::string_view("s3"), std::string_view("aws4_request")}) {
    key = Hmac(AsText(key), part);
  }
  return std::string(kAlgorithm) + " Credential=" + credentials.key_id + "/" + scope +
         ", SignedHeaders=" + names + ", Signature=" + Hmac(AsText(key), text).ToHex();
}

}  // namespace kdray::server
