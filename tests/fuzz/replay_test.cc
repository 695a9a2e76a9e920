// SPDX-License-Identifier: Apache-2.0
// Replays what the fuzzer begins with and what it has found, with every compiler: each seed, each
// file of tests/fuzz/corpus, and some thousand mutations of both.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include "tests/fuzz/fuzz_target.h"
#include "tests/support/seed.h"

namespace kdray::fuzz {
namespace {

constexpr int kMutations = 2000;  // of each input

/// The files of a target's corpus.
std::vector<Bytes> Corpus(std::string_view target) {
  std::vector<Bytes> inputs;
  const auto folder =
      std::filesystem::path(KDRAY_SOURCE_DIR) / "tests" / "fuzz" / "corpus" / target;
  if (!std::filesystem::exists(folder)) return inputs;
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    std::ifstream in(file.path(), std::ios::binary);
    inputs.push_back(
        ToBytes(std::string(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>())));
  }
  return inputs;
}

/// Changes a few places of the input, or joins it with a part of another.
Bytes Mutate(Bytes input, const Bytes& other, std::mt19937_64& random) {
  const auto below = [&random](std::size_t end) {
    return static_cast<std::ptrdiff_t>(random() % std::max<std::size_t>(end, 1));
  };
  for (std::size_t edit = 0, edits = 1 + random() % 4; edit < edits; ++edit) {
    const auto at = input.begin() + below(input.size());
    switch (random() % 7) {
      case 0:  // a bit
        if (!input.empty()) *at ^= static_cast<std::byte>(1u << random() % 8);
        break;
      case 1:  // a byte
        if (!input.empty()) *at = static_cast<std::byte>(random());
        break;
      case 2:  // the end is missing
        input.erase(at, input.end());
        break;
      case 3: {  // a part is missing
        const auto end = at + below(static_cast<std::size_t>(input.end() - at) + 1);
        input.erase(at, end);
        break;
      }
      case 4: {  // a part twice
        const Bytes part(at, at + below(static_cast<std::size_t>(input.end() - at) + 1));
        input.insert(input.begin() + below(input.size()), part.begin(), part.end());
        break;
      }
      case 5: {  // a part of another input
        const auto from = other.begin() + below(other.size());
        const Bytes part(from, from + below(static_cast<std::size_t>(other.end() - from) + 1));
        input.insert(at, part.begin(), part.end());
        break;
      }
      default: {  // a number that is extreme
        static constexpr std::string_view kExtremes[] = {
            "4294967295", "-1",         "18446744073709551616",  "1e999",           "nan",
            "0",          "2147483648", {"\xff\xff\xff\xff", 4}, {"\0\0\0\x80", 4}, {"\0", 1}};
        const Bytes extreme = ToBytes(kExtremes[random() % std::size(kExtremes)]);
        input.insert(at, extreme.begin(), extreme.end());
      }
    }
  }
  return input;
}

class Fuzz : public testing::TestWithParam<FuzzTarget> {};

TEST_P(Fuzz, KeepsItsPromisesForSeedsFindingsAndMutationsOfThem) {
  const FuzzTarget& target = GetParam();
  std::vector<Bytes> inputs = target.seeds();
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    EXPECT_TRUE(target.run(inputs[i])) << "seed " << i << " is not valid";
  }
  for (Bytes& input : Corpus(target.name)) inputs.push_back(std::move(input));
  inputs.emplace_back();
  std::mt19937_64 random = test::RandomEngine(std::hash<std::string_view>{}(target.name));
  for (const Bytes& input : inputs) {
    target.run(input);
    for (int i = 0; i < kMutations; ++i) {
      target.run(Mutate(input, inputs[random() % inputs.size()], random));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, Fuzz, testing::ValuesIn(AllTargets()),
                         [](const auto& target) { return std::string(target.param.name); });

}  // namespace
}  // namespace kdray::fuzz
