// SPDX-License-Identifier: Apache-2.0
#include "core/store/file_system.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

namespace kdray::core {
namespace {

Error ErrnoError(const char* what, int error) {
  ErrorCode code = ErrorCode::kIo;
  switch (error) {
    case ENOENT:
      code = ErrorCode::kNotFound;
      break;
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
    case EROFS:
      code = ErrorCode::kStoreFull;
      break;
    case EMFILE:
    case ENFILE:
    case ENOMEM:
      code = ErrorCode::kMemoryFull;
      break;
    case ELOOP:  // O_NOFOLLOW met a link
    case EISDIR:
    case ENXIO:  // a FIFO or socket
      code = ErrorCode::kCorrupt;
      break;
    default:
      break;
  }
  return Error{code, std::string("cannot ") + what + ": " +
                         std::error_code(error, std::generic_category()).message()};
}

template <class Call>
auto RetryInterrupted(const Call& call) {
  for (;;) {
    const auto result = call();
    if (result >= 0 || errno != EINTR) return result;
  }
}

class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&&) = delete;
  ~Descriptor() {
    if (fd_ >= 0) close(fd_);
  }
  int get() const { return fd_; }
  bool ok() const { return fd_ >= 0; }

 private:
  int fd_;
};

Descriptor OpenRetrying(const std::filesystem::path& path, int flags, mode_t mode = 0) {
  return Descriptor(
      RetryInterrupted([&] { return open(path.c_str(), flags | O_CLOEXEC | O_NOFOLLOW, mode); }));
}

class PosixWritableFile final : public WritableFile {
 public:
  explicit PosixWritableFile(Descriptor fd) : fd_(std::move(fd)) {}

  Status Append(std::span<const std::byte> bytes) override {
    while (!bytes.empty()) {
      const ssize_t written =
          RetryInterrupted([&] { return write(fd_.get(), bytes.data(), bytes.size()); });
      if (written < 0) return ErrnoError("write a file", errno);
      bytes = bytes.subspan(static_cast<std::size_t>(written));
    }
    return {};
  }
  Status Sync() override {
    if (RetryInterrupted([&] { return fsync(fd_.get()); }) != 0) {
      return ErrnoError("sync a file", errno);
    }
    return {};
  }

 private:
  Descriptor fd_;
};

std::int64_t Nanoseconds(const timespec& time) {
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}

class PosixReadableFile final : public ReadableFile {
 public:
  PosixReadableFile(Descriptor fd, const FileVersion& version)
      : fd_(std::move(fd)), version_(version) {}

  std::uint64_t size() const override { return version_.bytes; }
  std::optional<FileVersion> version() const override { return version_; }
  Status ReadAt(std::uint64_t offset, std::span<std::byte> out) const override {
    while (!out.empty()) {
      const ssize_t count = RetryInterrupted(
          [&] { return pread(fd_.get(), out.data(), out.size(), static_cast<off_t>(offset)); });
      if (count < 0) return ErrnoError("read a file", errno);
      if (count == 0) return Error{ErrorCode::kCorrupt, "a stored file is shorter than it was"};
      offset += static_cast<std::uint64_t>(count);
      out = out.subspan(static_cast<std::size_t>(count));
    }
    return {};
  }

 private:
  Descriptor fd_;
  FileVersion version_;
};

class PosixFileLock final : public FileLock {
 public:
  explicit PosixFileLock(Descriptor fd) : fd_(std::move(fd)) {}

 private:
  Descriptor fd_;
};

// Opened for writing, because some file systems lock only such files; on a read-only disk for
// reading.
Descriptor OpenForLock(const std::filesystem::path& path) {
  Descriptor fd = OpenRetrying(path, O_RDWR | O_CREAT, S_IRUSR | S_IWUSR);
  return fd.ok() || errno != EROFS ? std::move(fd) : OpenRetrying(path, O_RDONLY);
}

bool IsOwnRegularFile(const struct stat& status) {
  return S_ISREG(status.st_mode) && status.st_uid == geteuid();
}

std::int64_t ModifiedMs(const struct stat& status) {
  return std::int64_t{status.st_mtim.tv_sec} * 1000 + status.st_mtim.tv_nsec / 1'000'000;
}

class Posix final : public FileSystem {
 public:
  Result<std::unique_ptr<WritableFile>> Create(const Path& path) override {
    Descriptor fd = OpenRetrying(path, O_WRONLY | O_CREAT | O_EXCL, S_IRUSR | S_IWUSR);
    if (!fd.ok()) return ErrnoError("make a file", errno);
    return std::unique_ptr<WritableFile>(std::make_unique<PosixWritableFile>(std::move(fd)));
  }

  Result<std::unique_ptr<ReadableFile>> Open(const Path& path) override {
    // O_NONBLOCK: opening a FIFO must not block.
    Descriptor fd = OpenRetrying(path, O_RDONLY | O_NONBLOCK);
    if (!fd.ok()) return ErrnoError("open a file", errno);
    struct stat status {};
    if (fstat(fd.get(), &status) != 0) return ErrnoError("examine a file", errno);
    if (!IsOwnRegularFile(status)) {
      return Error{ErrorCode::kCorrupt, "a stored file is not a regular file of this user"};
    }
    return std::unique_ptr<ReadableFile>(std::make_unique<PosixReadableFile>(
        std::move(fd), FileVersion{.device = status.st_dev,
                                   .inode = status.st_ino,
                                   .bytes = static_cast<std::uint64_t>(status.st_size),
                                   .modified_ns = Nanoseconds(status.st_mtim),
                                   .changed_ns = Nanoseconds(status.st_ctim)}));
  }

  Status Rename(const Path& from, const Path& to) override {
    if (rename(from.c_str(), to.c_str()) != 0) return ErrnoError("rename a file", errno);
    return {};
  }

  Status Remove(const Path& path) override {
    if (unlink(path.c_str()) != 0) return ErrnoError("remove a file", errno);
    return {};
  }

  Status SyncDirectory(const Path& path) override {
    // A folder may be a link to a larger disk; only files may not.
    const Descriptor fd(
        RetryInterrupted([&] { return open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC); }));
    if (!fd.ok() || RetryInterrupted([&] { return fsync(fd.get()); }) != 0) {
      return ErrnoError("sync a folder", errno);
    }
    return {};
  }

  Result<FolderInfo> Examine(const Path& directory) override {
    struct stat status {};
    if (stat(directory.c_str(), &status) != 0) return ErrnoError("examine a folder", errno);
    if (!S_ISDIR(status.st_mode)) return Error{ErrorCode::kCorrupt, "this is not a folder"};
    return FolderInfo{status.st_uid, geteuid()};
  }

  Status MakeDirectory(const Path& path) override {
    std::error_code error;
    if (std::filesystem::is_directory(path, error)) return {};
    if (path.has_parent_path() && path.parent_path() != path) {
      if (Status parent = MakeDirectory(path.parent_path()); !parent.ok()) return parent;
    }
    if (mkdir(path.c_str(), S_IRWXU) != 0 && errno != EEXIST) {
      return ErrnoError("make a folder", errno);
    }
    if (!std::filesystem::is_directory(path, error)) return ErrnoError("make a folder", ENOTDIR);
    // Otherwise a power failure could remove the folder with its files.
    const Path parent = std::filesystem::absolute(path, error).parent_path();
    return error ? ErrnoError("make a folder", error.value()) : SyncDirectory(parent);
  }

  Result<std::vector<FileInfo>> List(const Path& directory) override {
    const std::unique_ptr<DIR, int (*)(DIR*)> dir(opendir(directory.c_str()), closedir);
    if (!dir) return ErrnoError("list a folder", errno);
    std::vector<FileInfo> files;
    for (;;) {
      errno = 0;
      const dirent* entry = readdir(dir.get());
      if (entry == nullptr) break;
      struct stat status {};
      if (fstatat(dirfd(dir.get()), entry->d_name, &status, AT_SYMLINK_NOFOLLOW) != 0) {
        if (errno == ENOENT) continue;  // removed meanwhile
        return ErrnoError("list a folder", errno);
      }
      std::string name = entry->d_name;
      if (name == "." || name == "..") continue;
      files.push_back({std::move(name), static_cast<std::uint64_t>(status.st_size),
                       ModifiedMs(status), IsOwnRegularFile(status)});
    }
    if (errno != 0) return ErrnoError("list a folder", errno);
    return files;
  }

  Status Touch(const Path& path) override {
    if (utimensat(AT_FDCWD, path.c_str(), nullptr, AT_SYMLINK_NOFOLLOW) != 0) {
      return ErrnoError("touch a file", errno);
    }
    return {};
  }

  Result<std::uint64_t> FreeBytes(const Path& directory) override {
    struct statvfs status {};
    if (statvfs(directory.c_str(), &status) != 0) return ErrnoError("examine the disk", errno);
    return std::uint64_t{status.f_bavail} * std::uint64_t{status.f_frsize};
  }

  Result<std::unique_ptr<FileLock>> Lock(const Path& path) override {
    Descriptor fd = OpenForLock(path);
    if (!fd.ok()) return ErrnoError("open the lock file", errno);
    if (RetryInterrupted([&] { return flock(fd.get(), LOCK_EX | LOCK_NB); }) != 0) {
      if (errno == EWOULDBLOCK) {
        return Error{ErrorCode::kInvalidArgument, "another process uses the data directory"};
      }
      return ErrnoError("lock the data directory", errno);
    }
    return std::unique_ptr<FileLock>(std::make_unique<PosixFileLock>(std::move(fd)));
  }
};

}  // namespace

FileSystem& PosixFileSystem() {
  static Posix file_system;
  return file_system;
}

}  // namespace kdray::core
