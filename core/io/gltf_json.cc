// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_json.h"

#include "core/io/gltf_document.h"
#include "core/io/gltf_json_source.h"
#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

using Json = nlohmann::json;

void Empty(Json& json) noexcept {
  if (!json.is_structured()) return;
  for (Json& child : json) Empty(child);
  json.clear();
}

// Counts the values of a text before they are made, and finds where it is not JSON.
class Counter : public nlohmann::json_sax<Json> {
 public:
  bool null() override { return Value(); }
  bool boolean(bool) override { return Value(); }
  bool number_integer(number_integer_t) override { return Value(); }
  bool number_unsigned(number_unsigned_t) override { return Value(); }
  bool number_float(number_float_t, const string_t&) override { return Value(); }
  bool string(string_t& text) override {
    string_bytes_ += text.size() + sizeof(std::string);
    return Value();
  }
  bool binary(binary_t&) override { return Value(); }
  bool start_object(std::size_t) override { return Begin(); }
  bool key(string_t& text) override {
    string_bytes_ += text.size();
    ++members_;
    return true;
  }
  bool end_object() override { return End(); }
  bool start_array(std::size_t) override { return Begin(); }
  bool end_array() override { return End(); }
  bool parse_error(std::size_t, const std::string&, const Json::exception&) override {
    return false;
  }

  bool is_too_long() const { return values_ > kMaxGltfValues; }
  bool is_too_deep() const { return depth_ > kMaxGltfDepth; }

  /// The memory of the values and of the document that is made of them, at most.
  std::uint64_t Bytes() const {
    constexpr std::uint64_t kValueBytes = 4 * sizeof(Json);               // in an array that grows
    constexpr std::uint64_t kMemberBytes = 128;                           // a node of a map
    constexpr std::uint64_t kContainerBytes = 64 + 2 * sizeof(GltfNode);  // and the largest item
    return (values_ - members_) * kValueBytes + members_ * kMemberBytes + 3 * string_bytes_ +
           containers_ * kContainerBytes;
  }

 private:
  bool Value() { return ++values_ <= kMaxGltfValues; }
  bool Begin() {
    ++containers_;
    return ++depth_ <= kMaxGltfDepth && Value();
  }
  bool End() {
    --depth_;
    return true;
  }

  std::uint64_t values_ = 0;
  std::uint64_t members_ = 0;
  std::uint64_t containers_ = 0;
  std::uint64_t string_bytes_ = 0;
  std::size_t depth_ = 0;
};

}  // namespace

GltfJson::~GltfJson() { Empty(json); }

Result<GltfJson> ParseGltfJson(std::string_view text, std::uint64_t first_byte, CancelPoll* poll,
                               const std::function<Status(std::uint64_t)>& on_bytes) {
  JsonSource counted(text, poll);
  Counter counter;
  const bool is_json =
      Json::sax_parse(JsonSource::Iterator(&counted), JsonSource::Iterator(), &counter);
  if (poll->stopped()) return poll->ToError();
  if (counter.is_too_long()) {
    return Error{ErrorCode::kMeshTooLarge,
                 "the glTF file has more than " + std::to_string(kMaxGltfValues) + " JSON values"};
  }
  if (counter.is_too_deep()) {
    return AtByte(first_byte + counted.position(), "JSON values are nested deeper than " +
                                                       std::to_string(kMaxGltfDepth) + " levels");
  }
  if (!is_json) {
    return AtByte(
        first_byte + (counted.AtEnd() ? text.size() : counted.last_position()),
        counted.AtEnd() ? "the text is not JSON here, at its end" : "the text is not JSON here");
  }
  const std::uint64_t uri_bytes = 3 * counted.uris().size() * sizeof(std::string_view);
  if (Status told = on_bytes(counter.Bytes() + uri_bytes); !told.ok()) {
    return std::move(told).error();
  }
  JsonSource source(text, poll);
  GltfJson parsed(Json::parse(JsonSource::Iterator(&source), JsonSource::Iterator(), nullptr,
                              /*allow_exceptions=*/false));
  if (poll->stopped()) return poll->ToError();
  parsed.uris = source.uris();
  return parsed;
}

}  // namespace kdray::core
