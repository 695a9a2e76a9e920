// SPDX-License-Identifier: Apache-2.0
// A SAX handler for batches in JSON: rows of numbers without a document tree, and errors that name
// the row and the number. Only for the .cc files that read batches, because it includes the parser.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "api/json_cursor.h"
#include "api/json_pointer.h"
#include "api/quoted.h"
#include "api/should_stop.h"
#include "api/types.h"

namespace kdray::api {

/// The form of a query's rows.
struct RowForm {
  static constexpr std::size_t kMostColumns = 8;

  std::span<const std::string_view> keys;  ///< the fields of the object, all required
  std::string_view wanted;                 ///< a row in words
  std::array<std::size_t, 2> lengths;      ///< numbers of a row, ascending
  std::optional<std::size_t> nullable;     ///< column where null is infinity
  ErrorCode too_many;                      ///< more rows of a field than allowed
};

/// SAX handler: an object whose fields are arrays of arrays of numbers. `emit(key, span)` gets each
/// row and the number of its field.
template <class Emit>
class RowReader {
  using json = nlohmann::json;

 public:
  RowReader(std::string_view text, const RowForm& form, std::uint64_t max_rows, Emit emit,
            const ShouldStop& should_stop)
      : text_(text),
        form_(form),
        max_rows_(max_rows),
        emit_(std::move(emit)),
        should_stop_(should_stop) {}

  Check Read() {
    if (Check problem = RefuseNul("the body", text_)) {
      const bool is_object = text_.starts_with('{');
      return is_object ? *std::move(problem) : NameTheForms(*std::move(problem));
    }
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
    if (level_ == Level::kRow && form_.nullable == column_) {
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
    const auto found = std::find(form_.keys.begin(), form_.keys.end(), key);
    if (found == form_.keys.end()) {
      return Fail(ErrorCode::kInvalidParameter,
                  "there is no field " + Quoted(key) + "; the body has just " + Keys() +
                      ", and options are query parameters",
                  PointerStep(key));
    }
    key_ = static_cast<std::size_t>(found - form_.keys.begin());
    if ((seen_keys_ >> key_ & 1u) != 0) {
      return Fail(ErrorCode::kInvalidJson, "the key " + Quoted(key) + " is repeated",
                  PointerStep(key));
    }
    seen_keys_ |= 1u << key_;
    row_ = 0;
    return true;
  }
  bool end_object() {
    for (std::size_t k = 0; k < form_.keys.size(); ++k) {
      if ((seen_keys_ >> k & 1u) != 0) continue;
      return Fail(ErrorCode::kInvalidJson,
                  "the field '" + std::string(form_.keys[k]) + "' is missing",
                  PointerStep(form_.keys[k]));
    }
    return true;
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
                      PointerStep(form_.keys[key_])};
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
    emit_(key_, std::span<const double>(numbers_.data(), column_));
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
    Problem problem = NotJson("the body", text_, seen_, error.what());
    problem_ = level_ == Level::kText ? NameTheForms(std::move(problem)) : std::move(problem);
    return false;
  }

 private:
  enum class Level { kText, kObject, kRows, kRow };

  /// For a body that does not even begin as JSON does, such as the bytes of an array without its
  /// header.
  static Problem NameTheForms(Problem problem) {
    problem.detail += "; a batch is JSON or a .npy file (numpy.save)";
    return problem;
  }

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
    const std::string key(form_.keys[key_]);
    std::string wanted;
    switch (level_) {
      case Level::kText:
        for (const std::string_view each : form_.keys) {
          wanted += wanted.empty() ? "" : ", ";
          wanted += "\"" + std::string(each) + "\": [[…],…]";
        }
        wanted = "the body must be an object {" + wanted + "}";
        break;
      case Level::kObject:
        wanted = "'" + key + "' must be an array of rows";
        break;
      case Level::kRows:
        wanted = "a row must be an array of " + std::string(form_.wanted);
        break;
      case Level::kRow:
        wanted = "a number was expected";
        if (form_.nullable && came == "null") wanted += " (null stands for t_max only)";
        break;
    }
    return Fail(ErrorCode::kInvalidJson, wanted + ", not " + std::string(came), Pointer());
  }

  bool Fail(ErrorCode code, std::string detail, std::string pointer) {
    problem_ = JsonProblem(code, text_, seen_, std::move(detail), std::move(pointer));
    return false;
  }

  std::string Keys() const {
    std::string keys;
    for (const std::string_view key : form_.keys) {
      keys += (keys.empty() ? "'" : " and '") + std::string(key) + "'";
    }
    return keys;
  }
  std::string RowPointer() const { return PointerStep(form_.keys[key_]) + PointerStep(row_); }
  std::string Pointer() const {
    switch (level_) {
      case Level::kText:
        return "";
      case Level::kObject:
        return PointerStep(form_.keys[key_]);
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
  std::size_t key_ = 0, row_ = 0, column_ = 0;
  unsigned seen_keys_ = 0;  ///< bit k: keys[k]
  std::array<double, RowForm::kMostColumns> numbers_{};
  Check problem_;
};

}  // namespace kdray::api
