// SPDX-License-Identifier: Apache-2.0
// The files of the data directory, their limit, and their order of use. Only bookkeeping:
// scene_store.h does the disk work.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>

namespace kdray::core {

/// The groups of files that count and can be evicted. Records, of about a kilobyte, do not count.
/// kUnrecorded are mesh files without a record.
enum class FileGroup : std::uint8_t { kMeshes, kParsed, kTrees, kMeasured, kUnrecorded };
inline constexpr std::size_t kFileGroups = 5;

class DiskUsage;

/// Room reserved for a file that is being written; returned when destroyed. For one thread at a
/// time.
class DiskRoom {
 public:
  DiskRoom(DiskRoom&& other) noexcept
      : usage_(std::exchange(other.usage_, nullptr)), bytes_(other.bytes_) {}
  DiskRoom& operator=(DiskRoom&&) = delete;
  ~DiskRoom();

 private:
  friend class DiskUsage;
  DiskRoom(DiskUsage* usage, std::uint64_t bytes) : usage_(usage), bytes_(bytes) {}
  DiskUsage* usage_;
  std::uint64_t bytes_;
};

/// The bytes of an unfinished upload on disk; not counted after its destruction. For one thread at
/// a time.
class ArrivingRoom {
 public:
  ArrivingRoom(ArrivingRoom&& other) noexcept
      : usage_(std::exchange(other.usage_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
  ArrivingRoom& operator=(ArrivingRoom&&) = delete;
  ~ArrivingRoom();

  /// False if all unfinished uploads would exceed the limit.
  [[nodiscard]] bool Grow(std::uint64_t bytes);

 private:
  friend class DiskUsage;
  explicit ArrivingRoom(DiskUsage* usage) : usage_(usage) {}
  DiskUsage* usage_;
  std::uint64_t bytes_ = 0;
};

/// The limit applies to files. Unfinished uploads may take as much again, so no mesh is evicted for
/// an upload before it is complete. Safe from many threads at once.
class DiskUsage {
  struct File {
    std::string name;
    std::uint64_t bytes;
  };
  using Index = std::map<std::string, std::list<File>::iterator, std::less<>>;

 public:
  explicit DiskUsage(std::optional<std::uint64_t> limit_bytes) : limit_(limit_bytes) {}

  /// The entry of a file, made before the file, so adding it cannot fail.
  class Note {
   public:
    Note(std::string_view name, std::uint64_t bytes);

   private:
    friend class DiskUsage;
    std::list<File> file_;
    Index index_;
  };
  /// Adds a file, used now.
  void Set(FileGroup group, Note note) noexcept;
  void Set(FileGroup group, std::string_view name, std::uint64_t bytes) {
    Set(group, Note(name, bytes));
  }
  /// Moves the file to the group `to`; no effect if it is not in `from`.
  void Move(FileGroup from, FileGroup to, std::string_view name) noexcept;
  /// False if it is not in the group.
  bool Drop(FileGroup group, std::string_view name);
  void Use(FileGroup group, std::string_view name);

  /// nullopt if it would exceed the limit.
  std::optional<DiskRoom> TryReserve(std::uint64_t bytes);
  /// For an upload, which begins without bytes.
  ArrivingRoom BeginArrival() { return ArrivingRoom(this); }
  /// Whether files without kUnrecorded, and unfinished uploads, are within the limit.
  bool IsWithinLimit() const;
  /// Whether `bytes` would fit without any derived file.
  bool FitsBesideMeshes(std::uint64_t bytes) const;
  /// The least recently used file of a group, except those in `except`.
  std::optional<std::string> Oldest(FileGroup group,
                                    const std::set<std::string>& except = {}) const;

  /// Size of a file; 0 if it is not in the group.
  std::uint64_t BytesOf(FileGroup group, std::string_view name) const;
  std::uint64_t Count(FileGroup group) const;
  /// Bytes of all files, without reserved room.
  std::uint64_t total() const;
  /// Bytes of all files except meshes.
  std::uint64_t derived() const;
  std::optional<std::uint64_t> limit() const { return limit_; }

 private:
  friend class DiskRoom;
  friend class ArrivingRoom;
  struct Group {
    std::list<File> files;  // most recently used first
    Index index;
    std::uint64_t bytes = 0;
  };
  void Erase(Group* group, std::list<File>::iterator file);
  bool Fits(std::uint64_t bytes, std::uint64_t used) const {
    return !limit_ || (used <= *limit_ && bytes <= *limit_ - used);
  }
  std::uint64_t TotalLocked() const;
  Group& At(FileGroup group) { return groups_[static_cast<std::size_t>(group)]; }
  const Group& At(FileGroup group) const { return groups_[static_cast<std::size_t>(group)]; }

  const std::optional<std::uint64_t> limit_;
  mutable std::mutex mutex_;
  std::array<Group, kFileGroups> groups_;
  std::uint64_t reserved_ = 0;
  std::uint64_t arriving_ = 0;
};

}  // namespace kdray::core
