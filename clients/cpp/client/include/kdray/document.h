// SPDX-License-Identifier: Apache-2.0
// A value of a JSON answer, read leniently. Only its .cc knows the JSON library.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace kdray::client {

/// An immutable JSON value; copies are cheap. A member that is absent or of another kind reads as
/// empty, so answers of older and newer servers work too.
class Document {
 public:
  /// null.
  Document();

  explicit Document(std::string text);
  explicit Document(const char* text) : Document(std::string(text)) {}
  explicit Document(double number);  ///< null if it is not finite
  explicit Document(std::uint64_t count);
  explicit Document(bool flag);

  /// nullopt if `text` is not JSON.
  static std::optional<Document> Parse(std::string_view text);

  bool IsObject() const;

  /// The member; null if it is absent or this is not an object.
  Document operator[](const char* name) const;

  /// The elements; empty if this is not an array.
  std::vector<Document> Items() const;

  // This value, or nullopt if it has another kind.
  std::optional<std::string> Text() const;
  std::optional<double> Number() const;
  std::optional<std::uint64_t> Count() const;  ///< an integer of at least 0
  std::optional<bool> Flag() const;

  /// The numbers of an array; other elements are left out.
  std::vector<double> Numbers() const;

  /// An array of these.
  static Document ArrayOf(const std::vector<Document>& items);

  /// An object of these members, in this order.
  static Document ObjectOf(const std::vector<std::pair<std::string, Document>>& members);

  /// The JSON text, indented by two blanks.
  std::string Indented() const;

 private:
  struct Node;  ///< the JSON library's value

  explicit Document(std::shared_ptr<const Node> node) : node_(std::move(node)) {}

  std::shared_ptr<const Node> node_;  ///< shares the ownership of the whole answer
};

}  // namespace kdray::client
