// SPDX-License-Identifier: Apache-2.0
#include "core/io/draco_process.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstring>
#include <string_view>
#include <utility>

#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

constexpr const char* kProgram = "kdray-draco";

// Closed at the end of its scope; -1 for none.
class File {
 public:
  explicit File(int number = -1) : number_(number) {}
  File(File&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  File& operator=(File&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~File() { Close(); }
  void Close() {
    if (number_ >= 0) close(std::exchange(number_, -1));
  }
  int number() const { return number_; }

 private:
  int number_;
};

// A process that does not outlive this.
class Child {
 public:
  explicit Child(pid_t id) : id_(id) {}
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (id_ < 0) return;
    kill(id_, SIGKILL);
    (void)Wait();
  }
  // The status of its end, as of waitpid.
  int Wait() {
    int status = 0;
    while (waitpid(id_, &status, 0) < 0 && errno == EINTR) {
    }
    id_ = -1;
    return status;
  }

 private:
  pid_t id_;
};

Error NotNow(const char* what) {
  return Error{ErrorCode::kMemoryFull,
               std::string("the system has no ") + what + " for the Draco decoder now"};
}

// A file without a name that contains the bytes.
Result<File> FileOf(std::span<const std::byte> bytes, CancelPoll* poll) {
  File file(memfd_create("draco", MFD_CLOEXEC));
  if (file.number() < 0) return NotNow("file");
  constexpr std::size_t kPiece = std::size_t{1} << 20;
  std::size_t offset = 0;
  while (offset < bytes.size()) {
    if (poll->Spend(CancelPoll::kWorkPerLook)) return poll->ToError();
    const std::size_t size = std::min(kPiece, bytes.size() - offset);
    const ssize_t count =
        pwrite(file.number(), bytes.data() + offset, size, static_cast<off_t>(offset));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return NotNow("memory");
    offset += static_cast<std::size_t>(count);
  }
  return file;
}

// Far more than any honest data take; an attack that needs time in the square of its size ends.
std::uint64_t SecondsOf(const DracoForm& form) { return 10 + form.triangles / 100'000; }

std::vector<std::string> ArgumentsOf(const DracoForm& form) {
  const auto text = [](std::uint64_t number) { return std::to_string(number); };
  // Libraries are mapped, and take memory of their own only where they are used.
  constexpr std::uint64_t kMappedBytes = std::uint64_t{80} << 20;
  std::vector<std::string> arguments = {kProgram, text(form.Bytes() + kMappedBytes),
                                        text(SecondsOf(form)), text(form.vertices),
                                        text(form.triangles)};
  for (const DracoAttribute& wanted : form.wanted) {
    arguments.push_back(text(wanted.id) + ":" + text(wanted.component_type) + ":" +
                        text(wanted.components) + ":" + (wanted.is_needed ? "1" : "0"));
  }
  return arguments;
}

struct Started {
  pid_t id = -1;
  File answers;
};

// Standard input is `data`, standard output a pipe; nothing else of this process is inherited.
Result<Started> Start(const std::string& program, std::vector<std::string> arguments,
                      const File& data) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return NotNow("pipe");
  Started started;
  started.answers = File(ends[0]);
  const File out(ends[1]);
  std::vector<char*> pointers;
  for (std::string& argument : arguments) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  char* no_environment[] = {nullptr};
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  if (posix_spawn_file_actions_init(&actions) != 0) return NotNow("memory");
  posix_spawnattr_init(&attributes);
  sigset_t none, all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  const bool is_ready =
      posix_spawn_file_actions_adddup2(&actions, data.number(), STDIN_FILENO) == 0 &&
      posix_spawn_file_actions_adddup2(&actions, out.number(), STDOUT_FILENO) == 0 &&
      posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0) == 0 &&
      posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1) == 0;
  const int failed = is_ready ? posix_spawn(&started.id, program.c_str(), &actions, &attributes,
                                            pointers.data(), no_environment)
                              : ENOMEM;
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  if (failed != 0) return NotNow("process");
  return started;
}

// Appends what comes out of the pipe until its end, at most `most` bytes.
Status ReadAnswer(const File& pipe, std::uint64_t most, std::vector<std::byte>* answer,
                  CancelPoll* poll) {
  constexpr int kMillisecondsBetweenLooks = 20;
  constexpr std::size_t kPiece = std::size_t{1} << 18;
  for (;;) {
    if (poll->Spend(CancelPoll::kWorkPerLook)) return poll->ToError();
    pollfd waiting{pipe.number(), POLLIN, 0};
    if (::poll(&waiting, 1, kMillisecondsBetweenLooks) <= 0) continue;
    const std::size_t size = answer->size();
    answer->resize(size + kPiece);
    const ssize_t count = read(pipe.number(), answer->data() + size, kPiece);
    const bool again = count < 0 && (errno == EINTR || errno == EAGAIN);
    answer->resize(size + (count > 0 ? static_cast<std::size_t>(count) : 0));
    if (again) continue;
    if (count <= 0 || answer->size() > most) return {};
  }
}

Error Damaged(const std::string& why) { return Error{ErrorCode::kInvalidMesh, why}; }

Error WhyItEnded(int status, const DracoForm& form) {
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU) {
    return Damaged("the Draco data take more than " + std::to_string(SecondsOf(form)) +
                   " s of processor time");
  }
  return Damaged("the Draco data are damaged");
}

// The places of the parts in the answer.
Result<DracoMesh> Divided(std::vector<std::byte> bytes, const DracoForm& form, CancelPoll* poll) {
  DracoMesh mesh;
  std::size_t at = 1;
  mesh.corners_begin = at;
  at += 12 * form.triangles;
  for (const DracoAttribute& wanted : form.wanted) {
    if (at >= bytes.size()) return Damaged("the Draco data are damaged");
    const bool is_there = bytes[at++] == std::byte{1};
    mesh.values_begin.push_back(is_there ? std::optional(at) : std::nullopt);
    if (is_there) at += wanted.value_bytes * form.vertices;
    if (!is_there && wanted.is_needed) return Damaged("the Draco data are damaged");
  }
  if (at != bytes.size()) return Damaged("the Draco data are damaged");
  mesh.bytes = std::move(bytes);
  // The process is trusted no more than its data.
  bool is_valid = true;
  PolledLoop(3 * form.triangles, 2, poll,
             [&](std::size_t i) { is_valid = is_valid && mesh.Corner(i) < form.vertices; });
  if (poll->stopped()) return poll->ToError();
  if (!is_valid) return Damaged("the Draco data are damaged");
  return mesh;
}

std::uint64_t AnswerBytes(const DracoForm& form) {
  std::uint64_t bytes = 1 + 12 * form.triangles;
  for (const DracoAttribute& wanted : form.wanted) bytes += 1 + wanted.value_bytes * form.vertices;
  return bytes;
}

}  // namespace

// The program itself, its tables of triangles and corners, the attributes before and after their
// transformation; the answer in both processes. 980,000 triangles with positions took a fourth of
// it.
std::uint64_t DracoForm::Bytes() const {
  constexpr std::uint64_t kProgramBytes = std::uint64_t{16} << 20;
  const std::uint64_t decoded =
      triangles * (128 + 96 * attributes) + vertices * (64 + 64 * attributes);
  return kProgramBytes + 2 * encoded_bytes + decoded + 3 * AnswerBytes(*this);
}

std::uint32_t DracoMesh::Corner(std::uint64_t i) const {
  std::uint32_t corner;
  std::memcpy(&corner, bytes.data() + corners_begin + 4 * i, sizeof corner);
  return corner;
}

std::optional<std::string> FindDracoProgram() {
  char path[PATH_MAX];
  const ssize_t size = readlink("/proc/self/exe", path, sizeof path);
  if (size <= 0) return std::nullopt;
  const std::string_view self(path, static_cast<std::size_t>(size));
  const std::string folder(self.substr(0, self.rfind('/') + 1));
  for (const char* place : {"", "../libexec/kdray/"}) {
    std::string program = folder + place + kProgram;
    if (access(program.c_str(), X_OK) == 0) return program;
  }
  return std::nullopt;
}

Result<DracoMesh> DecodeDraco(std::span<const std::byte> encoded, const DracoForm& form,
                              CancelPoll* poll) {
  const std::optional<std::string> program = FindDracoProgram();
  if (!program) {
    return Error{ErrorCode::kUnsupportedMeshFormat,
                 std::string("Draco data are not read here: the program ") + kProgram +
                     ", which decodes them, is not installed"};
  }
  const Result<File> data = FileOf(encoded, poll);
  if (!data.ok()) return data.error();
  const Result<Started> started = Start(*program, ArgumentsOf(form), *data);
  if (!started.ok()) return started.error();
  Child child(started->id);
  std::vector<std::byte> answer;
  constexpr std::uint64_t kLongestText = 1000;
  const std::uint64_t most = std::max(AnswerBytes(form), kLongestText);
  Status read = ReadAnswer(started->answers, most, &answer, poll);
  if (!read.ok()) return std::move(read).error();
  if (answer.size() > most) return Damaged("the Draco data are damaged");
  const int status = child.Wait();
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || answer.empty()) {
    return WhyItEnded(status, form);
  }
  if (answer.front() == std::byte{'e'}) {
    return Damaged({reinterpret_cast<const char*>(answer.data()) + 1, answer.size() - 1});
  }
  return Divided(std::move(answer), form, poll);
}

}  // namespace kdray::core
