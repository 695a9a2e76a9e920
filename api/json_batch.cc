#include "api/json_batch.h"

#include <array>
#include <cstddef>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "api/json_cursor.h"
#include "api/json_pointer.h"
#include "api/quoted.h"

namespace kdray::api {
namespace {

using nlohmann::json;

constexpr std::size_t kMostColumns = 8;
constexpr std::size_t kNone = kMostColumns;

/// The form of a query's rows.
struct RowForm {
  std::string_view key;     ///< the one field of the object
  std::string_view wanted;  ///< a row in words
  std::array<std::size_t, 2> lengths;
  std::size_t nullable;  ///< column where null is infinity, or kNone
  ErrorCode too_many;
};

constexpr RowForm kRays = {"rays",
                           "6 numbers (ox oy oz dx dy dz) or 8 (then t_min t_max)",
                           {6, 8},
                           7,
                           ErrorCode::kTooManyRays};

/// SAX handler: an object with one field, an array of arrays of numbers. `emit(span)` gets each
/// row.
template <class Emit>
class RowReader {
 public:
  RowReader(std::string_view text, const RowForm& form, std::uint64_t max_rows, Emit emit,
            const ShouldStop& should_stop)
      : text_(text),
        form_(form),
        max_rows_(max_rows),
        emit_(std::move(emit)),
        should_stop_(should_stop) {}

  Check Read() {
    if (Check problem = RefuseNul(text_)) return problem;
    // The return value only repeats whether one of the callbacks returned false.
    try {
      json::sax_parse(JsonCursor(text_.data(), &seen_, &should_stop_),
                      JsonCursor(text_.data() + text_.size(), &seen_), this);
    } catch (const JsonStopped&) {
      return Problem{ErrorCode::kDeadlineExceeded, "the reading of the body was stopped"};
    }
    return std::move(problem_);
  }

  bool number_float(double value, const std::string&) { return Number(value); }
  bool number_unsigned(json::number_unsigned_t value) { return Number(static_cast<double>(value)); }
  bool number_integer(json::number_integer_t value) {
    // Numbers without a minus come as unsigned, so this 0 was written "-0".
    return Number(value == 0 ? -0.0 : static_cast<double>(value));
  }
  bool null() {
    if (level_ == Level::kRow && form_.nullable != kNone && column_ == form_.nullable) {
      return Number(std::numeric_limits<double>::infinity());
    }
    return WrongKind("null");
  }
  bool boolean(bool) { return WrongKind("a boolean"); }
  bool string(std::string&) { return WrongKind("a string"); }
  bool binary(json::binary_t&) { return WrongKind("binary data"); }

  bool start_object(std::size_t) {
    if (level_ != Level::kText) return WrongKind("an object");
    level_ = Level::kObject;
    return true;
  }
  bool key(std::string& key) {
    if (key != form_.key) {
      return Fail(ErrorCode::kInvalidParameter,
                  "there is no field " + Quoted(key) + "; the body has just '" +
                      std::string(form_.key) + "', and options are query parameters",
                  PointerStep(key));
    }
    if (std::exchange(has_rows_, true)) {
      return Fail(ErrorCode::kInvalidJson, "the key " + Quoted(key) + " is repeated",
                  PointerStep(key));
    }
    return true;
  }
  bool end_object() {
    if (has_rows_) return true;
    return Fail(ErrorCode::kInvalidJson, "the field '" + std::string(form_.key) + "' is missing",
                PointerStep(form_.key));
  }

  bool start_array(std::size_t) {
    if (level_ == Level::kObject) {
      level_ = Level::kRows;
      return true;
    }
    if (level_ != Level::kRows) return WrongKind("an array");
    if (row_ == max_rows_) {
      Problem problem{form_.too_many,
                      "the batch has more than " + std::to_string(max_rows_) + " rows",
                      PointerStep(form_.key)};
      problem.limit = static_cast<double>(max_rows_);
      problem_ = std::move(problem);
      return false;
    }
    level_ = Level::kRow;
    column_ = 0;
    return true;
  }
  bool end_array() {
    if (level_ == Level::kRows) {
      level_ = Level::kObject;
      return true;
    }
    if (column_ != form_.lengths[0] && column_ != form_.lengths[1]) {
      return Fail(ErrorCode::kInvalidJson,
                  "the row has " + std::to_string(column_) + " numbers; a row is " +
                      std::string(form_.wanted),
                  RowPointer());
    }
    emit_(std::span<const double>(numbers_.data(), column_));
    level_ = Level::kRows;
    ++row_;
    return true;
  }

  bool parse_error(std::size_t, const std::string& last_token, const json::exception& error) {
    constexpr int kNumberOverflow = 406;
    if (error.id == kNumberOverflow) {
      return Fail(ErrorCode::kInvalidJson,
                  "the number " + Quoted(last_token) + " is beyond the range of double", Pointer());
    }
    problem_ = NotJson(text_, seen_, error.what());
    return false;
  }

 private:
  enum class Level { kText, kObject, kRows, kRow };

  bool Number(double value) {
    if (level_ != Level::kRow) return WrongKind("a number");
    if (column_ == form_.lengths.back()) {
      return Fail(ErrorCode::kInvalidJson,
                  "the row has more than " + std::to_string(column_) + " numbers; a row is " +
                      std::string(form_.wanted),
                  RowPointer());
    }
    numbers_[column_++] = value;
    return true;
  }

  bool WrongKind(std::string_view came) {
    const std::string key(form_.key);
    std::string wanted;
    switch (level_) {
      case Level::kText:
        wanted = "the body must be an object {\"" + key + "\": [[…],…]}";
        break;
      case Level::kObject:
        wanted = "'" + key + "' must be an array of rows";
        break;
      case Level::kRows:
        wanted = "a row must be an array of " + std::string(form_.wanted);
        break;
      case Level::kRow:
        wanted = "a number was expected";
        if (form_.nullable != kNone && came == "null") wanted += " (null stands for t_max only)";
        break;
    }
    return Fail(ErrorCode::kInvalidJson, wanted + ", not " + std::string(came), Pointer());
  }

  bool Fail(ErrorCode code, std::string detail, std::string pointer) {
    problem_ = JsonProblem(code, text_, seen_, std::move(detail), std::move(pointer));
    return false;
  }

  std::string RowPointer() const { return PointerStep(form_.key) + PointerStep(row_); }
  std::string Pointer() const {
    switch (level_) {
      case Level::kText:
        return "";
      case Level::kObject:
        return PointerStep(form_.key);
      case Level::kRows:
        return RowPointer();
      case Level::kRow:
        break;
    }
    return RowPointer() + PointerStep(column_);
  }

  std::string_view text_;
  const RowForm& form_;
  std::uint64_t max_rows_;
  Emit emit_;
  const ShouldStop& should_stop_;
  const char* seen_ = text_.data();
  Level level_ = Level::kText;
  std::size_t row_ = 0, column_ = 0;
  bool has_rows_ = false;
  std::array<double, kMostColumns> numbers_{};
  Check problem_;
};

}  // namespace

Outcome<std::vector<RayRow<double>>> ReadRayRows(std::string_view json_text, double t_min,
                                                 double t_max, std::uint64_t max_rows,
                                                 const ShouldStop& should_stop) {
  std::vector<RayRow<double>> rows;
  const auto emit = [&](std::span<const double> n) {
    const bool with_interval = n.size() == 8;
    rows.push_back({n[0], n[1], n[2], with_interval ? n[6] : t_min, n[3], n[4], n[5],
                    with_interval ? n[7] : t_max});
  };
  RowReader reader(json_text, kRays, max_rows, emit, should_stop);
  if (Check problem = reader.Read()) return *std::move(problem);
  return rows;
}

}  // namespace kdray::api
