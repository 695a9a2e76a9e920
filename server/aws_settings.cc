// SPDX-License-Identifier: Apache-2.0
#include "server/aws_settings.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <utility>

namespace kdray::server {
namespace {

using core::Error;
using core::ErrorCode;
using core::Result;

bool IsLowerOrDigit(char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); }

bool IsBucket(std::string_view name) {
  return name.size() >= 3 && name.size() <= 63 && IsLowerOrDigit(name.front()) &&
         IsLowerOrDigit(name.back()) && std::all_of(name.begin(), name.end(), [](char c) {
           return IsLowerOrDigit(c) || c == '.' || c == '-';
         });
}

bool IsPrefix(std::string_view prefix) {
  if (prefix.size() > 512) return false;
  while (!prefix.empty()) {
    const std::size_t slash = std::min(prefix.find('/'), prefix.size());
    const std::string_view part = prefix.substr(0, slash);
    if (part.empty() || part == "." || part == "..") return false;
    if (!std::all_of(part.begin(), part.end(), [](char c) { return c > ' ' && c < 127; })) {
      return false;
    }
    prefix.remove_prefix(std::min(slash + 1, prefix.size()));
  }
  return true;
}

std::string_view Trimmed(std::string_view text) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  return text;
}

using Section = std::map<std::string, std::string>;

// The section [name] of an INI file as the AWS tools write it; empty if the file or the section
// does not exist. Indented lines belong to a nested setting, and are skipped.
Section ReadSection(const std::string& path, const std::string& name) {
  Section section;
  std::ifstream file(path);
  bool is_inside = false;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == ' ' || line[0] == '\t') continue;
    const std::string_view text = Trimmed(line);
    if (text.empty() || text[0] == '#' || text[0] == ';') continue;
    if (text.front() == '[') {
      is_inside = text.back() == ']' && Trimmed(text.substr(1, text.size() - 2)) == name;
      continue;
    }
    const std::size_t equals = text.find('=');
    if (!is_inside || equals == std::string_view::npos) continue;
    section[std::string(Trimmed(text.substr(0, equals)))] = Trimmed(text.substr(equals + 1));
  }
  return section;
}

bool IsEndpoint(const std::string& url) {
  const bool is_http = url.starts_with("http://"), is_https = url.starts_with("https://");
  const std::string host = url.substr(std::min(url.size(), is_https ? 8 : std::size_t{7}));
  return (is_http || is_https) && !host.empty() &&
         host.find_first_of("/?#@ \t") == std::string::npos;
}

}  // namespace

Result<StoreUrl> ParseStoreUrl(std::string_view text) {
  constexpr std::string_view kScheme = "s3://";
  StoreUrl url;
  if (text.starts_with(kScheme)) {
    std::string_view rest = text.substr(kScheme.size());
    const std::size_t slash = std::min(rest.find('/'), rest.size());
    url.bucket = rest.substr(0, slash);
    rest.remove_prefix(std::min(slash + 1, rest.size()));
    if (rest.ends_with('/')) rest.remove_suffix(1);
    url.prefix = rest;
  }
  if (!IsBucket(url.bucket) || !IsPrefix(url.prefix)) {
    return Error{ErrorCode::kInvalidArgument,
                 "must be s3://BUCKET or s3://BUCKET/PREFIX, not '" + std::string(text) + "'"};
  }
  return url;
}

Environment ProcessEnvironment() {
  return [](const std::string& name) -> std::optional<std::string> {
    const char* const value = std::getenv(name.c_str());
    if (value == nullptr || *value == '\0') return std::nullopt;
    return std::string(value);
  };
}

Result<AwsSettings> ReadAwsSettings(const Environment& environment) {
  const std::string home = environment("HOME").value_or("") + "/.aws/";
  const std::string profile = environment("AWS_PROFILE").value_or("default");
  const Section secrets = ReadSection(
      environment("AWS_SHARED_CREDENTIALS_FILE").value_or(home + "credentials"), profile);
  const Section config = ReadSection(environment("AWS_CONFIG_FILE").value_or(home + "config"),
                                     profile == "default" ? profile : "profile " + profile);
  const auto find = [](const Section& section, const std::string& name) {
    const auto found = section.find(name);
    return found == section.end() ? std::string() : found->second;
  };

  AwsSettings settings;
  // The parts of one credential come from one place.
  AwsCredentials& credentials = settings.credentials;
  if (const auto key_id = environment("AWS_ACCESS_KEY_ID")) {
    credentials = {*key_id, environment("AWS_SECRET_ACCESS_KEY").value_or(""),
                   environment("AWS_SESSION_TOKEN").value_or("")};
  } else {
    const Section& from = secrets.contains("aws_access_key_id") ? secrets : config;
    credentials = {find(from, "aws_access_key_id"), find(from, "aws_secret_access_key"),
                   find(from, "aws_session_token")};
  }
  if (credentials.key_id.empty() || credentials.secret.empty()) {
    return Error{ErrorCode::kInvalidArgument,
                 "the store needs credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or "
                 "the profile '" +
                     profile + "' in the files of AWS"};
  }
  std::optional<std::string> region = environment("AWS_REGION");
  if (!region) region = environment("AWS_DEFAULT_REGION");
  if (!region && !find(config, "region").empty()) region = find(config, "region");
  if (region) settings.region = *region;
  if (!std::all_of(settings.region.begin(), settings.region.end(),
                   [](char c) { return IsLowerOrDigit(c) || c == '-'; })) {
    return Error{
        ErrorCode::kInvalidArgument,
        "the region has characters other than a-z, 0-9 and '-': '" + settings.region + "'"};
  }
  std::optional<std::string> endpoint = environment("AWS_ENDPOINT_URL_S3");
  if (!endpoint) endpoint = environment("AWS_ENDPOINT_URL");
  settings.endpoint = endpoint.value_or(find(config, "endpoint_url"));
  if (settings.endpoint.ends_with('/')) settings.endpoint.pop_back();
  if (!settings.endpoint.empty() && !IsEndpoint(settings.endpoint)) {
    return Error{ErrorCode::kInvalidArgument,
                 "the endpoint of the store must be http://HOST[:PORT] or https://HOST[:PORT], not "
                 "'" +
                     settings.endpoint + "'"};
  }
  settings.ca_file = environment("AWS_CA_BUNDLE").value_or(find(config, "ca_bundle"));
  return settings;
}

}  // namespace kdray::server
