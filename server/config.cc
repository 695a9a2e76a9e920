// SPDX-License-Identifier: Apache-2.0
#include "server/config.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <functional>
#include <limits>
#include <sstream>
#include <thread>
#include <utility>

#include "server/http/message.h"

namespace kdray::server {
namespace {

/// --data-dir as KDRAY_DATA_DIR.
std::string EnvironmentName(const std::string& option) {
  std::string name = "KDRAY_";
  for (const char c : option.substr(2)) {
    name += c == '-' ? '_' : static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
  }
  return name;
}

/// Reads a value's text; returns the error, or "" if it is valid.
using Take = std::function<std::string(const std::string& text)>;

Take TakeInteger(std::int64_t min, std::int64_t max, std::function<void(std::int64_t)> set) {
  return [min, max, set = std::move(set)](const std::string& text) -> std::string {
    std::int64_t value = 0;
    const char* const last = text.data() + text.size();
    const auto [end, error] = std::from_chars(text.data(), last, value);
    if (error != std::errc() || end != last || value < min || value > max) {
      return "must be an integer from " + std::to_string(min) + " to " + std::to_string(max) +
             ", not '" + text + "'";
    }
    set(value);
    return {};
  };
}

/// `1048576`, `4GiB` or `10 GB`.
Take TakeSize(std::function<void(std::uint64_t)> set) {
  return [set = std::move(set)](const std::string& text) -> std::string {
    struct Unit {
      std::string_view name;
      std::uint64_t bytes;
    };
    constexpr std::array kUnits = {
        Unit{"", 1},
        Unit{"B", 1},
        Unit{"KB", 1'000},
        Unit{"MB", 1'000'000},
        Unit{"GB", 1'000'000'000},
        Unit{"TB", 1'000'000'000'000},
        Unit{"KIB", std::uint64_t{1} << 10},
        Unit{"MIB", std::uint64_t{1} << 20},
        Unit{"GIB", std::uint64_t{1} << 30},
        Unit{"TIB", std::uint64_t{1} << 40},
    };
    std::uint64_t number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    std::string_view name(text);
    name.remove_prefix(static_cast<std::size_t>(end - text.data()));
    name.remove_prefix(std::min(name.find_first_not_of(' '), name.size()));
    const auto unit = std::find_if(kUnits.begin(), kUnits.end(), [name](const Unit& known) {
      return EqualsIgnoringCase(known.name, name);
    });
    if (error != std::errc() || unit == kUnits.end() || number == 0 ||
        number > std::numeric_limits<std::int64_t>::max() / unit->bytes) {
      return "'" + text +
             "' is not a size; write bytes, or a number with KiB, MiB, GiB, TiB, kB, MB, GB or TB";
    }
    set(number * unit->bytes);
    return {};
  };
}

/// "4GiB"; all default sizes are whole numbers of a unit.
std::string SizeText(std::uint64_t bytes) {
  for (const auto& [shift, unit] : {std::pair(30, "GiB"), {20, "MiB"}, {10, "KiB"}}) {
    const std::uint64_t size = std::uint64_t{1} << shift;
    if (bytes >= size && bytes % size == 0) return std::to_string(bytes / size) + unit;
  }
  return std::to_string(bytes);
}

/// CLI11's conversions are templates for each type, which take as long to compile as the rest of
/// this file, and its AsSizeValue reads -1 as a very large number.
class Options {
 public:
  explicit Options(CLI::App& app) : app_(app) {}

  CLI::Option* Add(const std::string& name, const std::string& help, const char* type, Take take) {
    const auto callback = [name, take = std::move(take)](const CLI::results_t& values) {
      const std::string problem = take(values.back());
      if (!problem.empty()) throw CLI::ValidationError(name, problem);
      return true;
    };
    return app_.add_option(name, callback, help)->envname(EnvironmentName(name))->type_name(type);
  }
  /// An empty text is mostly a variable of the shell that is not set. As a host it would be every
  /// address, as the file of the tokens no tokens.
  void AddText(const std::string& name, std::string& value, const std::string& help,
               const char* type) {
    const auto take = [&value](const std::string& text) -> std::string {
      if (text.empty()) return "must not be empty";
      value = text;
      return {};
    };
    Add(name, help, type, take)->default_str(value);
  }
  /// An integer, whose default the help shows.
  template <class T>
  void AddInteger(const std::string& name, T& value, std::int64_t min, std::int64_t max,
                  const std::string& help) {
    const auto set = [&value](std::int64_t number) { value = static_cast<T>(number); };
    Add(name, help, "N", TakeInteger(min, max, set))->default_str(std::to_string(value));
  }
  template <class T>
  void AddSize(const std::string& name, T& value, const std::string& help) {
    Add(name, help, "SIZE", TakeSize([&value](std::uint64_t bytes) { value = bytes; }));
  }

 private:
  CLI::App& app_;
};

}  // namespace

std::variant<Config, ConfigExit> ParseConfig(int argc, const char* const* argv) {
  Config config;
  config.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  std::optional<std::size_t> max_running;
  std::string data_dir = config.data_dir, token_file;

  CLI::App app(
      "kdrayd: ray queries and renders over meshes, by HTTP. Every option may also be set in the "
      "environment, "
      "--data-dir as KDRAY_DATA_DIR and so on.",
      "kdrayd");
  app.set_version_flag("--version", "kdrayd " KDRAY_VERSION);
  app.get_formatter()->column_width(34);
  Options options(app);
  constexpr std::int64_t kMany = 1'000'000'000;

  options.AddText("--host", config.host, "address to listen on", "TEXT");
  options.AddInteger("--port", config.port, 0, 65535, "port; 0 chooses a free one");
  options.AddText("--data-dir", data_dir, "directory of meshes and trees", "DIR");
  options.Add("--store",
              "bucket that replicas share, s3://BUCKET or s3://BUCKET/PREFIX, with the settings of "
              "AWS; --data-dir is its cache (default: none)",
              "URL", [&config](const std::string& text) -> std::string {
                auto url = ParseStoreUrl(text);
                if (!url.ok()) return url.error().message;
                config.store = *std::move(url);
                return {};
              });
  options.AddInteger("--threads", config.threads, 1, 1024,
                     "threads for queries, and as many for builds");
  options.AddSize("--memory-limit", config.memory_limit_bytes,
                  "memory for meshes, trees, and requests until they are answered (default " +
                      SizeText(config.memory_limit_bytes) + ")");
  options.AddSize("--store-limit", config.store_limit_bytes,
                  "disk space for meshes and trees (default: the whole disk)");
  options.AddSize("--max-upload", config.limits.max_upload_bytes,
                  "largest mesh (default " + SizeText(config.limits.max_upload_bytes) + ")");
  options.AddInteger("--max-rays", config.limits.max_rays, 1, kMany, "rays in a batch");
  options.AddInteger("--max-pixels", config.limits.max_pixels, 1, std::int64_t{1} << 30,
                     "pixels of an image");
  options.AddInteger("--max-connections", config.max_connections, 1, 100'000,
                     "simultaneous connections");
  options.Add("--max-running",
              "queries and renders of about one size that compute at the same time (default: "
              "--threads, at least 2)",
              "N", TakeInteger(1, 1024, [&](std::int64_t value) {
                max_running = static_cast<std::size_t>(value);
              }));
  options.AddInteger("--max-queued", config.max_queued, 0, kMany,
                     "queries and renders of about one size that wait for their turn");
  options.AddText("--token-file", token_file,
                  "file of the tokens that clients must send, one per line; SIGHUP reads it again",
                  "FILE");
  options.Add("--allow-origin",
              "origins whose pages in browsers may use this server, as https://example.org, or * "
              "for all (default: none)",
              "ORIGIN,...", [&config](const std::string& text) -> std::string {
                auto parsed = CorsPolicy::Parse(text);
                if (auto* problem = std::get_if<std::string>(&parsed)) return *std::move(problem);
                config.cors = std::get<CorsPolicy>(std::move(parsed));
                return {};
              });
  options.AddInteger("--drain-timeout-ms", config.drain_timeout_ms, 0, 3'600'000,
                     "time for running requests to finish after SIGTERM");
  options
      .Add("--log-level", "least level of the lines on standard error: info, warning or error",
           "LEVEL",
           [&config](const std::string& text) -> std::string {
             const auto level = ParseLogLevel(text);
             if (!level) return "must be info, warning or error, not '" + text + "'";
             config.log_level = *level;
             return {};
           })
      ->default_str(std::string(Name(config.log_level)));

  try {
    app.parse(argc, argv);
    // CLI11 2.4 silently ignores an invalid value in the environment; a second check gives the
    // cause.
    for (CLI::Option* option : app.get_options()) {
      const std::string name = option->get_envname();
      const char* const value = name.empty() ? nullptr : std::getenv(name.c_str());
      if (value == nullptr || *value == '\0' || option->count() != 0) continue;
      option->add_result(value);
      option->run_callback();
    }
  } catch (const CLI::ParseError& stop) {
    std::ostringstream out, err;
    const int code = app.exit(stop, out, err);
    return code == 0 ? ConfigExit{0, out.str()} : ConfigExit{2, err.str()};
  }
  config.data_dir = data_dir;
  config.token_file = token_file;
  config.max_running =
      max_running.value_or(std::max<std::size_t>(2, static_cast<std::size_t>(config.threads)));
  return config;
}

}  // namespace kdray::server
