// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/batch.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <functional>
#include <limits>
#include <utility>

#include "clients/cpp/command/text.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

constexpr std::uint64_t kHeaderBytes = 64 << 10;
constexpr std::uint64_t kFirstRows = 20'000;  // some hundredths of a second
constexpr double kPartSeconds = 0.7;          // short enough for a bar, long enough for the server
constexpr const char* kNpyType = "application/x-npy";

// Rows that an answer's elements are numbered by begin at 0 in every part.
void AddToRowNumbers(std::string& data, std::size_t element_bytes, std::size_t number_bytes,
                     std::uint64_t first_row) {
  for (std::size_t i = 0; i + element_bytes <= data.size(); i += element_bytes) {
    std::uint64_t number = 0;
    std::memcpy(&number, data.data() + i, number_bytes);  // little-endian
    number += first_row;
    std::memcpy(data.data() + i, &number, number_bytes);
  }
}

// One array out of the arrays of all parts.
class Joiner {
 public:
  Joiner(const BatchQuery& query, std::vector<std::uint64_t> leading_shape, OutputFile& file)
      : query_(query), shape_(std::move(leading_shape)), file_(file) {}

  std::uint64_t parts() const { return parts_; }

  void Add(const std::string& answer, std::uint64_t first_row) {
    ++parts_;
    NpyHeader header = ParseNpyHeader(answer);
    if (header.shape.empty()) throw ConnectionError("the server's answer is not an array of rows");
    const std::string_view data = std::string_view(answer).substr(header.data_offset);
    if (query_.numbers_rows) {
      const std::uint64_t elements = header.shape.front();
      std::string numbered(data);
      if (elements > 0) {
        const std::size_t number_bytes = header.descr.starts_with("[('ray', '<i4')") ? 4 : 8;
        AddToRowNumbers(numbered, data.size() / elements, number_bytes, first_row);
      }
      held_ += numbered;
      held_elements_ += elements;
      descr_ = std::move(header.descr);
      return;
    }
    if (!has_begun_) {
      header.shape.erase(header.shape.begin());
      header.shape.insert(header.shape.begin(), shape_.begin(), shape_.end());
      file_.Write(EncodeNpyHeader(header));
      has_begun_ = true;
    }
    file_.Write(data);
  }

  // How many hits there are is known only now, and the header comes first.
  void Finish() {
    if (!query_.numbers_rows) return;
    file_.Write(EncodeNpyHeader({.descr = descr_, .shape = {held_elements_}}));
    file_.Write(held_);
  }

 private:
  const BatchQuery& query_;
  std::vector<std::uint64_t> shape_;
  OutputFile& file_;
  std::uint64_t parts_ = 0;
  bool has_begun_ = false;
  std::string descr_;
  std::string held_;
  std::uint64_t held_elements_ = 0;
};

// How many rows to send next: those of a part's time, at the speed so far.
class PartSize {
 public:
  explicit PartSize(std::uint64_t limit) : limit_(std::max<std::uint64_t>(limit, 1)) {}

  std::uint64_t Next() const { return std::min(next_, limit_); }

  void Took(std::uint64_t rows, std::chrono::duration<double> time) {
    const double rate = static_cast<double>(rows) / std::max(time.count(), 1e-6);
    // At most four times the part before, whose time may have been mostly the connection's.
    next_ = static_cast<std::uint64_t>(
        std::clamp(rate * kPartSeconds, 1000.0, 4 * static_cast<double>(rows)));
    next_ = std::max<std::uint64_t>(next_, 1);
  }

 private:
  std::uint64_t limit_;
  std::uint64_t next_ = kFirstRows;
};

using Ask = std::function<Answer(std::uint64_t first, std::uint64_t count)>;

AnswerFacts RunParts(std::uint64_t rows, std::uint64_t limit, Joiner& joiner, ProgressBar& bar,
                     const Ask& ask) {
  AnswerFacts facts;
  PartSize size(limit);
  std::uint64_t done = 0;
  do {  // once even without rows, for the type of the answer
    const std::uint64_t count = std::min(size.Next(), rows - done);
    const auto asked = std::chrono::steady_clock::now();
    const Answer answer = ask(done, count);
    joiner.Add(answer.body, done);
    facts.Add(AnswerFacts::Of(answer.response));
    size.Took(count, std::chrono::steady_clock::now() - asked);
    done += count;
    bar.Update(static_cast<double>(done));
  } while (done < rows);
  joiner.Finish();
  return facts;
}

std::uint64_t MaxRays(Client& client) {
  return client.ServiceInfo()["limits"]["max_rays"].Count().value_or(kFirstRows);
}

// Elements of the shape and their bytes, or nullopt beyond 64 bits. The shape is a claim of the
// file.
std::optional<std::uint64_t> CheckedProduct(const std::vector<std::uint64_t>& factors) {
  std::uint64_t product = 1;
  for (const std::uint64_t factor : factors) {
    if (factor != 0 && product > std::numeric_limits<std::uint64_t>::max() / factor) {
      return std::nullopt;
    }
    product *= factor;
  }
  return product;
}

std::string ColumnsText(const std::vector<std::uint64_t>& columns) {
  std::string text;
  for (const std::uint64_t column : columns) {
    text += (text.empty() ? "" : " or ") + std::to_string(column);
  }
  return text;
}

}  // namespace

bool Rows::CanBeSplit() const { return header && !header->fortran_order; }

bool IsSplit(const Rows& rows) { return rows.CanBeSplit() && rows.count > kFirstRows; }

Payload Rows::Part(std::uint64_t first, std::uint64_t part_count) const {
  const NpyHeader part = {.descr = header->descr, .shape = {part_count, header->shape.back()}};
  return Payload::Join(
      {Payload::OfBytes(bytes.name(), EncodeNpyHeader(part)),
       bytes.Part(header->data_offset + first * row_bytes, part_count * row_bytes)});
}

Rows ReadRows(const Payload& bytes, const RowForm& form) {
  std::string head(std::min(bytes.size(), kHeaderBytes), '\0');
  bytes.Read(0, head);
  Rows rows = {.bytes = bytes};
  if (!head.starts_with(kNpyMagic)) {
    const std::size_t first = head.find_first_not_of(" \t\r\n");
    if (first != std::string::npos && head[first] == '{') return rows;
    throw LocalFileError(bytes.name() + ": neither a .npy array nor JSON {\"" + form.noun +
                         "\": [[…],…]}");
  }
  try {
    rows.header = ParseNpyHeader(head);
  } catch (const LocalFileError& error) {
    throw LocalFileError(bytes.name() + ": " + error.what());
  }
  const NpyHeader& header = *rows.header;
  const std::uint64_t columns = header.shape.empty() ? 0 : header.shape.back();
  if ((header.descr != "<f4" && header.descr != "<f8") ||
      std::find(form.columns.begin(), form.columns.end(), columns) == form.columns.end()) {
    throw LocalFileError(bytes.name() + ": " + form.noun + " are <f4 or <f8 with " +
                         ColumnsText(form.columns) + " columns; this is " + header.descr +
                         " with " + std::to_string(columns));
  }
  const std::uint64_t number_bytes = header.descr == "<f4" ? 4 : 8;
  const auto elements = CheckedProduct(header.shape);
  const std::uint64_t held = (bytes.size() - header.data_offset) / number_bytes;
  if (!elements || *elements != held || bytes.size() != header.data_offset + held * number_bytes) {
    throw LocalFileError(bytes.name() + ": the header names " +
                         (elements ? CountText(*elements) : "more than 2^64") + " numbers, and " +
                         ByteText(static_cast<double>(bytes.size() - header.data_offset)) +
                         " follow it, which are " + CountText(held));
  }
  rows.count = *elements / columns;
  rows.row_bytes = columns * number_bytes;
  return rows;
}

std::string RowsText(const Rows& rows, const char* noun) {
  return rows.header ? CountedText(rows.count, noun) : "";
}

AnswerFacts RunBatch(Client& client, const std::string& id, const BatchQuery& query,
                     const Rows& rows, OutputFile& file, ProgressBar& bar) {
  const bool may_split = rows.CanBeSplit() && rows.count > 0 && !query.wants_json;
  if (!may_split || !IsSplit(rows)) {
    const auto on_sent = [&](std::uint64_t sent) { bar.Update(static_cast<double>(sent)); };
    try {
      const Answer answer = client.Query(id, query.path, query.options, rows.bytes,
                                         query.wants_json ? "application/json" : kNpyType, on_sent);
      file.Write(answer.body);
      return AnswerFacts::Of(answer.response);
    } catch (const Refusal& refusal) {
      // A server that takes less than our smallest part.
      if (!may_split || refusal.problem.code != "too_many_rays") throw;
    }
  }
  // Without an axis of rows, as of one point of shape (3,), the batch is small and not split.
  std::vector<std::uint64_t> leading(rows.header->shape.begin(), rows.header->shape.end() - 1);
  Joiner joiner(query, std::move(leading), file);
  bar.Update(0);
  return RunParts(
      rows.count, MaxRays(client), joiner, bar, [&](std::uint64_t first, std::uint64_t count) {
        return client.Query(id, query.path, query.options, rows.Part(first, count), kNpyType);
      });
}

AnswerFacts RunVisibility(Client& client, const std::string& id, const Parameters& options,
                          const Rows& from, const Rows& to, OutputFile& file, ProgressBar& bar) {
  const std::uint64_t pairs_of_a_row = std::max<std::uint64_t>(to.count, 1);
  const BatchQuery query = {.path = "visibility", .options = options};
  Joiner joiner(query, {from.count}, file);
  bar.Update(0);
  const Payload all_to = to.bytes.Part(to.header->data_offset, to.count * to.row_bytes);
  const auto ask = [&](std::uint64_t first, std::uint64_t count) {
    const NpyHeader header = {.descr = from.header->descr, .shape = {count + to.count, 3}};
    const Payload sets = Payload::Join(
        {Payload::OfBytes(from.bytes.name(), EncodeNpyHeader(header)),
         from.bytes.Part(from.header->data_offset + first * from.row_bytes, count * from.row_bytes),
         all_to});
    Parameters parameters = options;
    parameters.emplace_back("from_count", std::to_string(count));
    return client.Query(id, query.path, parameters, sets, kNpyType);
  };
  const std::uint64_t limit = std::min(MaxRays(client), 50 * kFirstRows) / pairs_of_a_row;
  AnswerFacts facts = RunParts(from.count, limit, joiner, bar, ask);
  // Every part counts the invalid points of the second set; a question without a first set counts
  // them alone.
  if (joiner.parts() > 1 && facts.invalid.value_or(0) > 0) {
    const std::uint64_t parts = joiner.parts();
    const auto in_to = AnswerFacts::Of(ask(0, 0).response).invalid.value_or(0);
    facts.invalid = *facts.invalid - in_to * (parts - 1);
  }
  return facts;
}

}  // namespace kdray::client
