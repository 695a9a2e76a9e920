// What lies in the data directory, how much of it there may be, and what was used least recently.
// Only bookkeeping: core/store/scene_store.h does the disk work.
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

/// What counts, and is given up in turn. A catalog entry of about a kilobyte does not. kUnrecorded
/// are mesh files that no record names.
enum class FileGroup : std::uint8_t { kMeshes, kParsed, kTrees, kMeasured, kUnrecorded };
inline constexpr std::size_t kFileGroups = 5;

class DiskUsage;

/// Room that a file on its way will take; given back when destroyed. One thread at a time.
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

/// What an upload under way has on disk so far; no longer counted once destroyed. One thread at a
/// time.
class ArrivingRoom {
 public:
  ArrivingRoom(ArrivingRoom&& other) noexcept
      : usage_(std::exchange(other.usage_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
  ArrivingRoom& operator=(ArrivingRoom&&) = delete;
  ~ArrivingRoom();

  /// False when the uploads under way would come to more than the limit.
  [[nodiscard]] bool Grow(std::uint64_t bytes);

 private:
  friend class DiskUsage;
  explicit ArrivingRoom(DiskUsage* usage) : usage_(usage) {}
  DiskUsage* usage_;
  std::uint64_t bytes_ = 0;
};

/// The limit holds for the files. Uploads under way come on top, together at most as much again:
/// until one is complete, no mesh has to go for it. Safe from many threads at once.
class DiskUsage {
  struct File {
    std::string name;
    std::uint64_t bytes;
  };
  using Index = std::map<std::string, std::list<File>::iterator, std::less<>>;

 public:
  explicit DiskUsage(std::optional<std::uint64_t> limit_bytes) : limit_(limit_bytes) {}

  /// What is noted of a file, made before the file is: noting it can then not fail.
  class Note {
   public:
    Note(std::string_view name, std::uint64_t bytes);

   private:
    friend class DiskUsage;
    std::list<File> file_;
    Index index_;
  };
  /// A file is there now, and was used just now.
  void Set(FileGroup group, Note note) noexcept;
  void Set(FileGroup group, std::string_view name, std::uint64_t bytes) {
    Set(group, Note(name, bytes));
  }
  /// The file counts among those of `to` from now on; nothing when it is not among those of `from`.
  void Move(FileGroup from, FileGroup to, std::string_view name) noexcept;
  /// False when it was not there.
  bool Drop(FileGroup group, std::string_view name);
  void Use(FileGroup group, std::string_view name);

  /// Nothing when it would go beyond the limit.
  std::optional<DiskRoom> TryReserve(std::uint64_t bytes);
  /// For an upload, which begins with no bytes.
  ArrivingRoom BeginArrival() { return ArrivingRoom(this); }
  /// Whether files and uploads under way are within the limit, were kUnrecorded gone.
  bool IsWithinLimit() const;
  /// Whether there would be room for `bytes` with no derived file left.
  bool FitsBesideMeshes(std::uint64_t bytes) const;
  /// The file of a group that was used least recently, but for those in `except`.
  std::optional<std::string> Oldest(FileGroup group,
                                    const std::set<std::string>& except = {}) const;

  /// Of a file, 0 when it is not there.
  std::uint64_t BytesOf(FileGroup group, std::string_view name) const;
  std::uint64_t Count(FileGroup group) const;
  /// All files; room that is only reserved is not counted.
  std::uint64_t total() const;
  /// Of them, those that are no meshes.
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
