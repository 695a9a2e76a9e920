// SPDX-License-Identifier: Apache-2.0
#include "api/hit_encoder.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string_view>
#include <type_traits>
#include <utility>

#include "api/json_text.h"
#include "api/names.h"

namespace kdray::api {
namespace {

static_assert(std::endian::native == std::endian::little,
              ".npy elements are written as they are; a big-endian machine has to swap them");

template <class T>
using IntegerOf = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;

/// `value` in T, never -0; a finite number stays finite.
template <class T>
T Narrow(double value) {
  if constexpr (std::is_same_v<T, float>) {
    constexpr double kMost = static_cast<double>(std::numeric_limits<float>::max());
    // Without a branch, since hits and misses follow each other at random.
    const double clamped = std::clamp(value, -kMost, kMost);
    value = std::isfinite(value) ? clamped : value;
  }
  return static_cast<T>(value) + T{0};
}

/// The t of a hit is finite: a hit never looks like a miss.
double FiniteT(const RayHit& hit) {
  constexpr double kMost = std::numeric_limits<double>::max();
  return hit.triangle < 0 ? hit.t : std::clamp(hit.t, -kMost, kMost);
}

/// Calls f with a function from a hit's number to the field's value: a double, an std::int64_t, or
/// an array of doubles.
template <class F>
void VisitField(RayField field, const Hits& hits, const F& f) {
  switch (field) {
    case RayField::kT:
      return f([h = hits.hits](std::size_t i) { return FiniteT(h[i]); });
    case RayField::kTriangle:
      return f([h = hits.hits](std::size_t i) { return std::int64_t{h[i].triangle}; });
    case RayField::kU:
      return f([h = hits.hits](std::size_t i) { return h[i].u; });
    case RayField::kV:
      return f([h = hits.hits](std::size_t i) { return h[i].v; });
    case RayField::kNormal:
      return f([n = hits.normals](std::size_t i) { return n[i]; });
    case RayField::kPoint:
      return f([p = hits.points](std::size_t i) { return p[i]; });
    case RayField::kSide:
      return f([s = hits.sides](std::size_t i) { return std::int64_t{s[i]}; });
    case RayField::kGroup:
      return f([g = hits.groups](std::size_t i) { return std::int64_t{g[i]}; });
    case RayField::kUv:
      return f([uv = hits.uvs](std::size_t i) { return uv[i]; });
    case RayField::kShadingNormal:
      return f([n = hits.shading_normals](std::size_t i) { return n[i]; });
  }
}

bool IsInteger(RayField field) {
  return field == RayField::kTriangle || field == RayField::kSide || field == RayField::kGroup;
}
/// The numbers of a field.
std::size_t LengthOf(RayField field) {
  switch (field) {
    case RayField::kNormal:
    case RayField::kPoint:
    case RayField::kShadingNormal:
      return 3;
    case RayField::kUv:
      return 2;
    default:
      return 1;
  }
}

// ---- One value ----

template <class T>
void PutBytes(char* out, double value) {
  const T number = Narrow<T>(value);
  std::memcpy(out, &number, sizeof(number));
}
template <class T>
void PutBytes(char* out, std::int64_t value) {
  // No accepted upload has 2^31 triangles, so <i4 represents every number.
  const auto number = static_cast<IntegerOf<T>>(value);
  std::memcpy(out, &number, sizeof(number));
}
template <class T, std::size_t kLength>
void PutBytes(char* out, const std::array<double, kLength>& vector) {
  for (std::size_t axis = 0; axis < kLength; ++axis) {
    PutBytes<T>(out + axis * sizeof(T), vector[axis]);
  }
}

template <class T>
char* PutText(char* out, double value) {
  return PutNumber(out, Narrow<T>(value));
}
template <class T>
char* PutText(char* out, std::int64_t value) {
  return PutInteger(out, value);
}
template <class T, std::size_t kLength>
char* PutText(char* out, const std::array<double, kLength>& vector) {
  // What the file does not have is null as a whole.
  if (std::isnan(vector[0])) return PutWord(out, "null");
  for (std::size_t axis = 0; axis < kLength; ++axis) {
    *out++ = axis == 0 ? '[' : ',';
    out = PutNumber(out, Narrow<T>(vector[axis]));
  }
  *out++ = ']';
  return out;
}

// ---- Hits ----

/// A hit in both forms, by the requested fields.
class HitForm {
 public:
  HitForm(std::vector<RayField> fields, NumberType numbers)
      : fields_(std::move(fields)), numbers_(numbers) {
    for (const RayField field : fields_) {
      bytes_ += LengthOf(field) * NumberBytes();
      std::string key = names_.empty() ? "{\"" : ",\"";
      key.append(Name(field)).append("\":");
      most_text_bytes_ += key.size() + LengthOf(field) * (kMostNumberBytes + 1) + 2;
      names_.push_back(std::move(key));
    }
  }

  std::size_t bytes() const { return bytes_; }
  std::size_t most_text_bytes() const { return most_text_bytes_; }

  std::string DescrOf(RayField field) const {
    const char* kind = IsInteger(field) ? "'<i" : "'<f";
    return kind + std::to_string(NumberBytes()) + "'";
  }
  /// `columns` stand before those of the fields.
  std::string StructuredDescr(const std::string& columns) const {
    std::string descr = "[" + columns;
    for (const RayField field : fields_) {
      if (descr.size() > 1) descr += ", ";
      descr.append("('").append(Name(field)).append("', ").append(DescrOf(field));
      const std::size_t length = LengthOf(field);
      descr += length == 1 ? ")" : ", (" + std::to_string(length) + ",))";
    }
    return descr + "]";
  }

  /// Writes the hits, `stride` bytes from one to the next.
  void PutNpy(const Hits& hits, char* out, std::size_t stride) const {
    VisitNumbers([&]<class T>(T) {
      if (is_default_) return PutDefaultFields<T>(hits, out, stride);
      // Field by field: so the loop over hits has no branch that depends on the field.
      for (const RayField field : fields_) {
        VisitField(field, hits, [&](const auto& value) {
          for (std::size_t i = 0; i < hits.size(); ++i) PutBytes<T>(out + i * stride, value(i));
        });
        out += LengthOf(field) * sizeof(T);
      }
    });
  }

  char* PutJson(const Hits& hits, std::size_t i, char* out) const {
    VisitNumbers([&]<class T>(T) {
      for (std::size_t f = 0; f < fields_.size(); ++f) {
        out = PutWord(out, names_[f]);
        VisitField(fields_[f], hits, [&](const auto& value) { out = PutText<T>(out, value(i)); });
      }
    });
    *out++ = '}';
    return out;
  }

  const std::vector<RayField>& fields() const { return fields_; }
  std::size_t NumberBytes() const { return numbers_ == NumberType::kF4 ? 4 : 8; }

 private:
  /// t, triangle, u and v, which most requests ask for, in one pass over the hits. Without
  /// branches, since hits and misses follow each other at random.
  template <class T>
  static void PutDefaultFields(const Hits& hits, char* out, std::size_t stride) {
    // GCC's vectors (manual, "Using Vector Instructions through Built-in Functions").
    using Doubles [[gnu::vector_size(2 * sizeof(double))]] = double;
    using Numbers [[gnu::vector_size(2 * sizeof(T))]] = T;
    constexpr T kMost = std::numeric_limits<T>::max();
    constexpr T kLargestT[] = {kMost, std::numeric_limits<T>::infinity()};  // of a hit, of a miss
    static_assert(offsetof(RayHit, v) == offsetof(RayHit, u) + sizeof(double));
    // What is beyond T's range is infinite after the conversion. A NaN passes: comparisons with it
    // are false.
    for (const RayHit& hit : hits.hits) {
      Doubles u_v;
      std::memcpy(&u_v, &hit.u, sizeof(u_v));
      Numbers uv = __builtin_convertvector(u_v, Numbers);
      uv = uv > kMost ? Numbers{} + kMost : uv;
      uv = uv < -kMost ? Numbers{} - kMost : uv;
      uv += T{0};
      const T largest_t = kLargestT[hit.triangle < 0];
      auto t = static_cast<T>(hit.t);
      t = t > largest_t ? largest_t : t;
      t = t < -largest_t ? -largest_t : t;
      t += T{0};
      const auto triangle = static_cast<IntegerOf<T>>(hit.triangle);
      std::memcpy(out, &t, sizeof(t));
      std::memcpy(out + sizeof(t), &triangle, sizeof(triangle));
      std::memcpy(out + 2 * sizeof(t), &uv, sizeof(uv));
      out += stride;
    }
  }

  template <class F>
  void VisitNumbers(const F& f) const {
    if (numbers_ == NumberType::kF4) {
      f(float{});
    } else {
      f(double{});
    }
  }

  std::vector<RayField> fields_;
  NumberType numbers_;
  const bool is_default_ =
      fields_ == std::vector{RayField::kT, RayField::kTriangle, RayField::kU, RayField::kV};
  std::size_t bytes_ = 0, most_text_bytes_ = 1;
  std::vector<std::string> names_;  ///< `{"t":`, `,"u":`
};

class ClosestEncoder final : public RowEncoder<ClosestRows> {
 public:
  explicit ClosestEncoder(HitForm form) : form_(std::move(form)) {}

  std::string Descr() const override {
    return is_plain() ? form_.DescrOf(form_.fields()[0]) : form_.StructuredDescr("");
  }
  std::vector<std::size_t> ElementShape() const override {
    const std::size_t length = is_plain() ? LengthOf(form_.fields()[0]) : 1;
    return length == 1 ? std::vector<std::size_t>() : std::vector<std::size_t>{length};
  }
  std::size_t ElementBytes() const override { return form_.bytes(); }
  void PutNpy(const ClosestRows& rows, char* out) const override {
    form_.PutNpy(rows.hits, out, form_.bytes());
  }

  std::size_t MostJsonBytes(const ClosestRows& rows) const override {
    return rows.size() * (form_.most_text_bytes() + 1);
  }
  char* PutJson(const ClosestRows& rows, char* out) const override {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (rows.first_row + i != 0) *out++ = ',';
      out =
          rows.hits.hits[i].triangle < 0 ? PutWord(out, "null") : form_.PutJson(rows.hits, i, out);
    }
    return out;
  }

 private:
  bool is_plain() const { return form_.fields().size() == 1; }

  HitForm form_;
};

class AllEncoder final : public RowEncoder<AllRows> {
 public:
  explicit AllEncoder(HitForm form) : form_(std::move(form)) {}

  std::string Descr() const override {
    return form_.StructuredDescr("('ray', '<i" + std::to_string(form_.NumberBytes()) + "')");
  }
  std::size_t ElementBytes() const override { return form_.NumberBytes() + form_.bytes(); }
  void PutNpy(const AllRows& rows, char* out) const override {
    form_.PutNpy(rows.hits, out + form_.NumberBytes(), ElementBytes());
    for (std::size_t i = 0; i < rows.counts.size(); ++i) {
      const auto ray = static_cast<std::int64_t>(rows.first_row + i);
      for (std::uint32_t hit = 0; hit < rows.counts[i]; ++hit, out += ElementBytes()) {
        std::memcpy(out, &ray, form_.NumberBytes());  // its low half for <i4
      }
    }
  }

  std::size_t MostJsonBytes(const AllRows& rows) const override {
    return rows.size() * 3 + rows.hits.size() * (form_.most_text_bytes() + 1);
  }
  char* PutJson(const AllRows& rows, char* out) const override {
    std::size_t hit = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (rows.first_row + i != 0) *out++ = ',';
      *out++ = '[';
      for (std::uint32_t k = 0; k < rows.counts[i]; ++k) {
        if (k != 0) *out++ = ',';
        out = form_.PutJson(rows.hits, hit++, out);
      }
      *out++ = ']';
    }
    return out;
  }

 private:
  HitForm form_;
};

// ---- Booleans and numbers ----

class AnyEncoder final : public RowEncoder<AnyRows> {
 public:
  std::string Descr() const override { return "'|b1'"; }
  std::size_t ElementBytes() const override { return 1; }
  void PutNpy(const AnyRows& rows, char* out) const override {
    std::copy(rows.occluded.begin(), rows.occluded.end(), out);
  }
  std::size_t MostJsonBytes(const AnyRows& rows) const override { return rows.size() * 6; }
  char* PutJson(const AnyRows& rows, char* out) const override {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (rows.first_row + i != 0) *out++ = ',';
      out = PutWord(out, rows.occluded[i] != 0 ? "true" : "false");
    }
    return out;
  }
};

class CountEncoder final : public RowEncoder<CountRows> {
 public:
  explicit CountEncoder(NumberType numbers) : bytes_(numbers == NumberType::kF4 ? 4 : 8) {}

  std::string Descr() const override { return "'<u" + std::to_string(bytes_) + "'"; }
  std::size_t ElementBytes() const override { return bytes_; }
  void PutNpy(const CountRows& rows, char* out) const override {
    for (const std::uint64_t count : rows.counts) {
      std::memcpy(out, &count, bytes_);  // its low half for <u4
      out += bytes_;
    }
  }
  std::size_t MostJsonBytes(const CountRows& rows) const override { return rows.size() * 11; }
  char* PutJson(const CountRows& rows, char* out) const override {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (rows.first_row + i != 0) *out++ = ',';
      out = PutInteger(out, rows.counts[i]);
    }
    return out;
  }

 private:
  std::size_t bytes_;
};

}  // namespace

std::unique_ptr<RowEncoder<ClosestRows>> EncoderOfClosest(std::vector<RayField> fields,
                                                          NumberType numbers) {
  return std::make_unique<ClosestEncoder>(HitForm(std::move(fields), numbers));
}
std::unique_ptr<RowEncoder<AllRows>> EncoderOfAll(std::vector<RayField> fields,
                                                  NumberType numbers) {
  return std::make_unique<AllEncoder>(HitForm(std::move(fields), numbers));
}
std::unique_ptr<RowEncoder<AnyRows>> EncoderOfAny() { return std::make_unique<AnyEncoder>(); }
std::unique_ptr<RowEncoder<CountRows>> EncoderOfCount(NumberType numbers) {
  return std::make_unique<CountEncoder>(numbers);
}

}  // namespace kdray::api
