// SPDX-License-Identifier: Apache-2.0
// Large arrays of rays, which are decoded while they arrive: the answer is the same however they
// come, and clients that send something else get what is due to them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "server/core_backend.h"
#include "server/handlers/ray_body.h"
#include "tests/support/npy_array.h"
#include "tests/support/obj_text.h"
#include "tests/support/seed.h"
#include "tests/support/service_fixture.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using test::Json;
using test::RawAnswer;
using test::RawClient;
using test::RunningService;
using testing::HasSubstr;

/// Rays around a sphere; every thousandth row is invalid.
template <class T>
std::vector<T> Rows(std::size_t rows, std::size_t columns) {
  auto engine = test::RandomEngine(1207);
  std::uniform_real_distribution<T> uniform(-1.5, 1.5);
  std::vector<T> numbers(rows * columns);
  for (std::size_t row = 0; row < rows; ++row) {
    T* const n = &numbers[row * columns];
    for (std::size_t i = 0; i < 6; ++i) n[i] = uniform(engine);
    if (columns == 8) n[6] = T{0.125}, n[7] = T{3};
    if (row % 1000 == 999) n[row % 6] = std::numeric_limits<T>::quiet_NaN();
  }
  return numbers;
}

/// The same array in Fortran order, which is not decoded while it arrives.
template <class T>
std::string FortranArray(const std::vector<T>& numbers, std::size_t columns) {
  const std::size_t rows = numbers.size() / columns;
  std::vector<T> turned(numbers.size());
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t c = 0; c < columns; ++c) turned[c * rows + row] = numbers[row * columns + c];
  }
  std::string file = test::NpyArray(turned, columns);
  const std::string order = "'fortran_order': False, ";
  file.replace(file.find(order), order.size(), "'fortran_order': True,  ");
  return file;
}

std::string Chunked(const std::string& path, std::string_view body, std::size_t chunk_bytes,
                    const std::string& end = "0\r\n\r\n") {
  std::string request =
      "POST " + path + " HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\n\r\n";
  for (; !body.empty(); body.remove_prefix(std::min(chunk_bytes, body.size()))) {
    const std::string_view chunk = body.substr(0, chunk_bytes);
    std::array<char, 20> size{};
    std::snprintf(size.data(), size.size(), "%zx\r\n", chunk.size());
    request.append(size.data()).append(chunk).append("\r\n");
  }
  return request + end;
}

class ArrivingRaysOverHttp : public testing::Test {
 protected:
  ArrivingRaysOverHttp() {
    CoreBackendOptions options;
    options.data_dir = folder_.path() / "data";
    options.threads = 2;
    backend_ = MakeCoreBackend(options).value();
    Start({});
  }
  ~ArrivingRaysOverHttp() override {
    running_.reset();
    backend_->Shutdown();
  }
  void Start(ServiceOptions options) {
    options.limits.max_rays = 1'000'000;
    running_ = std::make_unique<RunningService>(*backend_, options);
    tree_ = "/v1/trees/" +
            running_->Upload(test::ObjText(test::BumpySphere({0, 0, 0}, 1, 16, 24, 0.3)));
  }
  std::string Path(const std::string& query) const { return tree_ + "/rays/" + query; }
  RawAnswer Ask(const std::string& request) {
    auto answer = test::Ask(running_->port(), request);
    EXPECT_TRUE(answer);
    return answer.value_or(RawAnswer());
  }
  void ExpectNoMemoryHeld() {
    EXPECT_TRUE(test::WaitUntil([this] { return running_->service().request_memory_used() == 0; }));
  }

  template <class T>
  void ExpectSameAnswers(std::size_t rows, std::size_t columns) {
    const std::vector<T> numbers = Rows<T>(rows, columns);
    const std::string array = test::NpyArray(numbers, columns);
    const std::string fortran = FortranArray(numbers, columns);
    ASSERT_GT(array.size(), kDecodedBytes);
    for (const std::string query :
         {"closest", "closest?dtype=f8&fields=t,triangle,point", "any", "count", "all?max_hits=3",
          "closest?precision=fast&t_min=0.1"}) {
      const RawAnswer want = running_->Ask("POST", Path(query), fortran);
      ASSERT_EQ(want.status, 200) << want.body;
      ASSERT_EQ(want.Header("kdray-invalid"), std::to_string(rows / 1000));
      const RawAnswer declared = running_->Ask("POST", Path(query), array);
      const RawAnswer chunked = Ask(Chunked(Path(query), array, 100'003));
      for (const RawAnswer& answer : {declared, chunked}) {
        EXPECT_EQ(answer.status, 200);
        EXPECT_TRUE(answer.body == want.body) << query << " " << rows << " " << columns;
        for (const char* header : {"kdray-invalid", "kdray-truncated", "kdray-precision"}) {
          EXPECT_EQ(answer.Header(header), want.Header(header)) << query;
        }
        EXPECT_THAT(answer.Header("server-timing"), HasSubstr("parse;dur="));
      }
    }
    ExpectNoMemoryHeld();
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<Backend> backend_;
  std::unique_ptr<RunningService> running_;
  std::string tree_;
};

TEST_F(ArrivingRaysOverHttp, GiveTheSameAnswerHoweverTheyAreSent) {
  // Fewer than a block of memory has, exactly as many, and some more.
  ExpectSameAnswers<float>(50'001, 6);
  ExpectSameAnswers<float>(131'072, 8);
  ExpectSameAnswers<double>(65'537, 6);
}

TEST_F(ArrivingRaysOverHttp, ListTheirInvalidRowsInJsonToo) {
  const std::string array = test::NpyArray(Rows<float>(140'000, 6), 6);
  const RawAnswer answer =
      running_->Ask("POST", Path("any"), array, "Accept: application/json\r\n");
  ASSERT_EQ(answer.status, 200);
  const auto invalid = Json(answer).at("invalid").get<std::vector<std::uint64_t>>();
  ASSERT_EQ(invalid.size(), 140U);
  for (std::size_t i = 0; i < invalid.size(); ++i) EXPECT_EQ(invalid[i], 1000 * i + 999);
}

TEST_F(ArrivingRaysOverHttp, MayArriveInSmallPieces) {
  const std::string array = test::NpyArray(Rows<float>(60'000, 6), 6);
  const RawAnswer want = running_->Ask("POST", Path("any"), array);
  RawClient client(running_->port());
  const std::string head = "POST " + Path("any") + " HTTP/1.1\r\nHost: h\r\nContent-Length: " +
                           std::to_string(array.size()) + "\r\n\r\n";
  // Rows are cut at every byte.
  const std::size_t small = array.size() - 4000;
  ASSERT_TRUE(client.Send(head + array.substr(0, small)));
  for (std::size_t at = small; at < array.size(); at += 17) {
    ASSERT_TRUE(client.Send(std::string_view(array).substr(at, 17)));
    if (at % 10 == 0) std::this_thread::sleep_for(1ms);
  }
  const auto answer = client.Read();
  ASSERT_TRUE(answer);
  EXPECT_TRUE(answer->body == want.body);
}

TEST_F(ArrivingRaysOverHttp, OfAnotherSizeThanTheirHeaderSaysAreInvalid) {
  const std::string array = test::NpyArray(Rows<float>(60'000, 6), 6);
  const std::string shorter = array.substr(0, array.size() - 25), longer = array + "and more";
  for (const std::string& body : {shorter, longer}) {
    const RawAnswer declared = running_->Ask("POST", Path("closest"), body);
    const RawAnswer chunked = Ask(Chunked(Path("closest"), body, 50'000));
    const std::string present = std::to_string(body.size() - (array.size() - 60'000 * 24));
    for (const RawAnswer& answer : {declared, chunked}) {
      EXPECT_EQ(RunningService::CodeOf(answer), "invalid_array");
      EXPECT_EQ(Json(answer).at("detail"), "the array's shape and type make 1440000 bytes, and " +
                                               present + " follow the header");
    }
  }
  ExpectNoMemoryHeld();
}

TEST_F(ArrivingRaysOverHttp, GetTheSameRefusalsAsSmallOnes) {
  const std::string array = test::NpyArray(Rows<float>(60'000, 6), 6);
  EXPECT_EQ(running_->Code("POST", Path("any"), test::NpyArray(Rows<float>(60'000, 8), 6)),
            "200");  // 80,000 rows of 6
  EXPECT_EQ(running_->Code("POST", Path("any"), test::NpyArray(std::vector<float>(700'000), 7)),
            "invalid_array");
  EXPECT_EQ(running_->Code("POST", Path("any"), test::NpyArray(std::vector<int>(600'000), 6)),
            "invalid_array");
  EXPECT_EQ(running_->Code("POST", Path("any"), test::NpyArray(std::vector<float>(6'000'006), 6)),
            "too_many_rays");
  EXPECT_EQ(running_->Code("POST", Path("any"), array, "Content-Type: text/plain\r\n"),
            "unsupported_media_type");
  EXPECT_EQ(running_->Code("POST", Path("any"), array, "Accept: text/plain\r\n"), "not_acceptable");
  EXPECT_EQ(running_->Code("POST", Path("any?deadline_ms=0"), array), "invalid_parameter");
  // The end of a chunked body is missing.
  EXPECT_EQ(RunningService::CodeOf(Ask(Chunked(Path("any"), array, 70'000, "x\r\n"))),
            "malformed_request");
  ExpectNoMemoryHeld();
}

TEST_F(ArrivingRaysOverHttp, OfClientsThatLeaveAreForgotten) {
  const std::string array = test::NpyArray(Rows<float>(200'000, 6), 6);
  const std::string head = "POST " + Path("any") + " HTTP/1.1\r\nHost: h\r\nContent-Length: " +
                           std::to_string(array.size()) + "\r\n\r\n";
  for (const std::size_t bytes : {2'000'000U, 4'500'000U}) {
    for (const bool reset : {false, true}) {
      RawClient client(running_->port());
      ASSERT_TRUE(client.Send(head + array.substr(0, bytes)));
      EXPECT_TRUE(test::WaitUntil([&] {
        return running_->service().request_memory_used() > bytes;  // in blocks
      }));
      reset ? client.Reset() : client.Close();
      ExpectNoMemoryHeld();
    }
  }
  EXPECT_EQ(running_->Code("POST", Path("any"), array), "200");
}

TEST_F(ArrivingRaysOverHttp, ThatWouldTakeMostOfTheMemoryAreReceivedAsTheyAre) {
  ServiceOptions small;
  small.request_memory_bytes = 32 << 20;  // of it 24 for bodies
  Start(small);
  const std::vector<float> numbers = Rows<float>(450'000, 6);  // 10 MiB, and 14 as rays
  const RawAnswer large = running_->Ask("POST", Path("any"), test::NpyArray(numbers, 6));
  ASSERT_EQ(large.status, 200) << large.body;
  EXPECT_TRUE(large.body == running_->Ask("POST", Path("any"), FortranArray(numbers, 6)).body);
  EXPECT_EQ(running_->Code("POST", Path("any"), test::NpyArray(Rows<float>(60'000, 6), 6)), "200");
  ExpectNoMemoryHeld();
}

TEST_F(ArrivingRaysOverHttp, GiveWayToOlderBodiesWhenMemoryIsShort) {
  ServiceOptions options;
  constexpr std::uint64_t kMost = 96 << 20;  // for bodies
  options.request_memory_bytes = kMost / 3 * 4 + 4096;
  Start(options);
  const std::string array = test::NpyArray(Rows<float>(1'000'000, 6), 6);  // 8 blocks, 32 MiB
  const std::string head = "POST " + Path("any") + " HTTP/1.1\r\nHost: h\r\nContent-Length: " +
                           std::to_string(array.size()) + "\r\n\r\n";
  const std::string_view start = std::string_view(array).substr(0, 1);
  const std::string_view middle = std::string_view(array).substr(1, array.size() - 100);
  const std::string_view end = std::string_view(array).substr(1 + middle.size());
  const auto used = [this] { return running_->service().request_memory_used(); };
  std::vector<std::unique_ptr<RawClient>> clients;
  for (std::size_t i = 0; i < 4; ++i) {
    clients.push_back(std::make_unique<RawClient>(running_->port()));
    clients.back()->Send(head + std::string(start));
    ASSERT_TRUE(test::WaitUntil([&] { return used() == i + 1; }));
  }
  // The newest ones first. There is room for three.
  for (const std::size_t i : {3U, 2U, 1U}) clients[i]->Send(middle);
  ASSERT_TRUE(test::WaitUntil([&] { return used() == kMost + 1; })) << used();
  clients[0]->Send(middle);
  clients[0]->Send(end);
  EXPECT_EQ(clients[0]->Read().value_or(RawAnswer()).status, 200);
  clients[3]->Send(end);
  EXPECT_EQ(RunningService::CodeOf(clients[3]->Read().value_or(RawAnswer())), "memory_full");
  for (const std::size_t i : {1U, 2U}) {
    clients[i]->Send(end);
    EXPECT_EQ(clients[i]->Read().value_or(RawAnswer()).status, 200) << i;
  }
  ExpectNoMemoryHeld();
}

}  // namespace
}  // namespace kdray::server
