// SPDX-License-Identifier: Apache-2.0
// Decodes one Draco mesh: a process of its own, because the library can neither be interrupted nor
// kept within limits, and a fault in it must not end the daemon. core/io/draco_process.cc starts
// it.
//   kdray-draco MEMORY_BYTES SECONDS VERTICES TRIANGLES [ID:TYPE:COMPONENTS:NEEDED]…
// The data come from standard input; the answer (codec/draco_decoder.h) goes to standard output.
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "codec/draco_decoder.h"

namespace {

using kdray::codec::DracoClaims;
using kdray::codec::WantedAttribute;

constexpr int kWrongUse = 2;

std::optional<std::uint64_t> Number(std::string_view text) {
  std::uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

std::optional<WantedAttribute> Attribute(std::string_view text) {
  std::uint64_t parts[4] = {};
  for (int i = 0; i < 4; ++i) {
    const std::size_t end = i == 3 ? text.size() : text.find(':');
    if (end == std::string_view::npos) return std::nullopt;
    const std::optional<std::uint64_t> part = Number(text.substr(0, end));
    if (!part) return std::nullopt;
    parts[i] = *part;
    text.remove_prefix(i == 3 ? end : end + 1);
  }
  return WantedAttribute{static_cast<std::uint32_t>(parts[0]), static_cast<int>(parts[1]),
                         static_cast<int>(parts[2]), parts[3] != 0};
}

// What the process may take. Sanitizers reserve terabytes of addresses.
void Limit(std::uint64_t bytes, std::uint64_t seconds) {
  const auto set = [](auto resource, std::uint64_t most) {
    const rlimit limit{most, most};
    setrlimit(resource, &limit);
  };
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  set(RLIMIT_AS, bytes);
#else
  (void)bytes;
#endif
  set(RLIMIT_CPU, seconds);
  set(RLIMIT_CORE, 0);
  set(RLIMIT_FSIZE, 0);
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // never outlives the thread that waits for it
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
}

bool ReadAll(std::vector<char>* data) {
  std::size_t size = 0;
  for (;;) {
    data->resize(size + (std::size_t{1} << 20));
    const ssize_t count = read(STDIN_FILENO, data->data() + size, data->size() - size);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return false;
    size += static_cast<std::size_t>(count);
    data->resize(size);
    if (count == 0) return true;
  }
}

bool WriteAll(std::string_view answer) {
  while (!answer.empty()) {
    const ssize_t count = write(STDOUT_FILENO, answer.data(), answer.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    answer.remove_prefix(static_cast<std::size_t>(count));
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  constexpr int kNumbers = 4;
  std::uint64_t numbers[kNumbers] = {};
  for (int i = 0; i < kNumbers; ++i) {
    const auto number = i + 1 < argc ? Number(argv[i + 1]) : std::nullopt;
    if (!number) return kWrongUse;
    numbers[i] = *number;
  }
  Limit(numbers[0], numbers[1]);
  DracoClaims claims{numbers[2], numbers[3], {}};
  for (int i = kNumbers + 1; i < argc; ++i) {
    const auto attribute = Attribute(argv[i]);
    if (!attribute) return kWrongUse;
    claims.attributes.push_back(*attribute);
  }
  std::vector<char> data;
  if (!ReadAll(&data)) return 1;
  return WriteAll(kdray::codec::DecodeDraco(data, claims)) ? 0 : 1;
}
