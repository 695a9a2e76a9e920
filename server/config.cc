#include "server/config.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <limits>
#include <sstream>
#include <thread>
#include <utility>

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

/// Turns `1048576`, `4GiB` or `10 GB` into the number of bytes; says what is wrong with anything
/// else. CLI11's own AsSizeValue takes -1 for a very large number.
std::string SizeToBytes(std::string& text) {
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
  std::string name = text.substr(static_cast<std::size_t>(end - text.data()));
  name.erase(0, name.find_first_not_of(' '));
  const auto unit = std::find_if(kUnits.begin(), kUnits.end(), [&name](const Unit& known) {
    return CLI::detail::to_lower(std::string(known.name)) == CLI::detail::to_lower(name);
  });
  if (error != std::errc() || unit == kUnits.end() || number == 0 ||
      number > std::numeric_limits<std::int64_t>::max() / unit->bytes) {
    return "'" + text +
           "' is not a size; write bytes, or a number with KiB, MiB, GiB, TiB, kB, MB, GB or TB";
  }
  text = std::to_string(number * unit->bytes);
  return {};
}

/// 4GiB; all sizes that are defaults are whole numbers of a unit.
std::string SizeText(std::uint64_t bytes) {
  for (const auto& [shift, unit] : {std::pair(30, "GiB"), {20, "MiB"}, {10, "KiB"}}) {
    const std::uint64_t size = std::uint64_t{1} << shift;
    if (bytes >= size && bytes % size == 0) return std::to_string(bytes / size) + unit;
  }
  return std::to_string(bytes);
}

class Options {
 public:
  explicit Options(CLI::App& app) : app_(app) {}

  template <class T>
  CLI::Option* Add(const std::string& name, T& value, const std::string& help) {
    return app_.add_option(name, value, help)->envname(EnvironmentName(name));
  }
  template <class T>
  CLI::Option* AddSize(const std::string& name, T& value, const std::string& help) {
    return Add(name, value, help)
        ->transform(CLI::Validator(SizeToBytes, "", "size"))
        ->type_name("SIZE");
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
  const auto count = [](std::uint64_t max) { return CLI::Range(std::uint64_t{1}, max); };
  constexpr std::uint64_t kMany = 1'000'000'000;

  options.Add("--host", config.host, "address to listen on")->capture_default_str();
  options.Add("--port", config.port, "port; 0 picks a free one")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  options.Add("--data-dir", data_dir, "where meshes and trees are kept")
      ->type_name("DIR")
      ->capture_default_str();
  options.Add("--threads", config.threads, "threads for queries, and as many for builds")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  options.AddSize("--memory-limit", config.memory_limit_bytes,
                  "memory for meshes, trees and requests (default " +
                      SizeText(config.memory_limit_bytes) + ")");
  options.AddSize("--store-limit", config.store_limit_bytes,
                  "disk space for meshes and trees (default: all there is)");
  options.AddSize("--max-upload", config.limits.max_upload_bytes,
                  "largest mesh (default " + SizeText(config.limits.max_upload_bytes) + ")");
  options.Add("--max-rays", config.limits.max_rays, "rays in a batch")
      ->check(count(kMany))
      ->capture_default_str();
  options.Add("--max-pixels", config.limits.max_pixels, "pixels of an image")
      ->check(count(std::uint64_t{1} << 30))
      ->capture_default_str();
  options.Add("--max-connections", config.max_connections, "connections at the same time")
      ->check(count(100'000))
      ->capture_default_str();
  options
      .Add("--max-running", max_running,
           "queries and renders computed at the same time (default: --threads, at least 2)")
      ->check(count(1024));
  options.Add("--max-queued", config.max_queued, "queries and renders that wait for their turn")
      ->check(CLI::Range(std::uint64_t{0}, kMany))
      ->capture_default_str();
  options.Add("--token-file", token_file, "tokens that clients must send, one a line")
      ->type_name("FILE");
  options
      .Add("--drain-timeout-ms", config.drain_timeout_ms,
           "time that requests under way get to finish after SIGTERM")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{3'600'000}))
      ->capture_default_str();

  try {
    app.parse(argc, argv);
    // CLI11 2.4 passes a wrong value in the environment in silence; asked again, it says why.
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
