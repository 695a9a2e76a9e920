// SPDX-License-Identifier: Apache-2.0
#include "server/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "api/errors.h"
#include "api/names.h"
#include "server/routes.h"

namespace kdray::server {
namespace {

using testing::HasSubstr;

struct Exposition {
  std::map<std::string, std::string> help, type;  ///< by family
  std::map<std::string, double> series;           ///< by name with labels
};

Exposition Parse(const std::string& text) {
  Exposition parsed;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string hash, kind, name, rest;
    if (line.starts_with("# ")) {
      words >> hash >> kind >> name;
      std::getline(words, rest);
      (kind == "HELP" ? parsed.help : parsed.type)[name] = rest.substr(1);
      continue;
    }
    const auto blank = line.rfind(' ');
    EXPECT_TRUE(parsed.series.emplace(line.substr(0, blank), std::stod(line.substr(blank))).second)
        << line << " twice";
  }
  return parsed;
}

double Value(const Metrics& metrics, const std::string& series) {
  const Exposition parsed = Parse(metrics.Text({}));
  const auto found = parsed.series.find(series);
  return found == parsed.series.end() ? -1 : found->second;
}

HttpRecord Record(std::string_view route, int status, double ms = 1) {
  HttpRecord record;
  record.method = "GET";
  record.route = route;
  record.status = status;
  record.ms = ms;
  record.bytes_in = 10;
  record.bytes_out = 100;
  return record;
}

/// Everything that clients can make it count.
void CountEverything(Metrics& metrics) {
  for (int status = 100; status < 600; ++status) {
    for (const Route& route : Routes()) metrics.Answered(Record(route.Label(), status));
    metrics.Answered(Record("", status));
    metrics.Answered(Record("/v1/trees/../etc", status));
  }
  for (const Route& route : Routes()) {
    for (const std::string_view precision : api::kPrecisionNames) {
      metrics.CountRows(route.path, precision, 1);
    }
  }
  metrics.ConnectionOpened();
  metrics.GotTurn(1);
}

SharedStoreCounters SharedValues() {
  SharedStoreCounters shared;
  shared.requests = {
      {"list", 20, 1}, {"head", 21, 2}, {"get", 22, 3}, {"put", 23, 4}, {"delete", 24, 0}};
  shared.times = {{0.005, 50}, {0.025, 60}, {0.1, 70}, {0.5, 80}, {2.5, 90}, {INFINITY, 120}};
  shared.seconds = 12.5;
  shared.retries = 5;
  shared.sent_bytes = 6;
  shared.received_bytes = 7;
  shared.lookups = 8;
  shared.meshes = {9, 10};
  shared.trees = {11, 12};
  shared.is_away = true;
  return shared;
}

/// With those that a daemon may lack.
CurrentValues AllValues() {
  CurrentValues now;
  now.backend.store_limit_bytes = 7;
  now.backend.store_free_bytes = 8;
  now.backend.shared = SharedValues();
  return now;
}

class MetricsWithAStoreOrWithout : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Metrics, MetricsWithAStoreOrWithout, testing::Bool());

TEST_P(MetricsWithAStoreOrWithout, HaveAtMost200SeriesWhateverClientsSend) {
  Metrics metrics(Routes(), GetParam());
  CountEverything(metrics);
  CurrentValues now = AllValues();
  if (!GetParam()) now.backend.shared.reset();
  const Exposition parsed = Parse(metrics.Text(now));
  EXPECT_LE(parsed.series.size(), Metrics::kMaxSeries);
  std::size_t requests = 0;
  double counted = 0;
  for (const auto& [series, value] : parsed.series) {
    if (!series.starts_with("kdray_http_requests_total{")) continue;
    ++requests;
    counted += value;
  }
  EXPECT_EQ(requests, Metrics::kMaxRequestSeries - (GetParam() ? Metrics::kSharedStoreSeries : 0));
  EXPECT_EQ(counted, 500.0 * static_cast<double>(Routes().size() + 2)) << "each request once";
}

TEST(Metrics, FollowTheRulesOfPrometheusForNames) {
  Metrics metrics(Routes());
  CountEverything(metrics);
  const Exposition parsed = Parse(metrics.Text(AllValues()));
  EXPECT_GT(parsed.type.size(), 20U);
  for (const auto& [name, type] : parsed.type) {
    EXPECT_GT(parsed.help.at(name).size(), 10U) << name;
    EXPECT_THAT(name, testing::MatchesRegex("(kdray|process)_[a-z_]+[a-z]"));
    EXPECT_EQ(name.ends_with("_total"), type == "counter") << name;
    for (const char* word :
         {"counter", "gauge", "histogram", "milli", "_ms", "minutes", "kilo", "mega"}) {
      EXPECT_EQ(name.find(word), std::string::npos) << name;
    }
    for (const char* ending : {"_count", "_sum", "_bucket"}) EXPECT_FALSE(name.ends_with(ending));
    EXPECT_EQ(name.ends_with("_seconds"),
              type == "histogram" || name == "process_start_time_seconds")
        << name;
    EXPECT_THAT(type, testing::AnyOf("counter", "gauge", "histogram"));
  }
  std::set<std::string> units;
  for (const auto& [name, type] : parsed.type) {
    if (name.find("bytes") != std::string::npos) units.insert(name);
  }
  EXPECT_GE(units.size(), 5U);
}

TEST(Metrics, CountConnectionsThatFoundNoRoom) {
  Metrics metrics(Routes());
  metrics.ConnectionDropped(DropReason::kEvicted);
  metrics.ConnectionDropped(DropReason::kEvicted);
  metrics.ConnectionDropped(DropReason::kRefused);
  metrics.AcceptFailed();
  Exposition parsed = Parse(metrics.Text({}));
  const std::string name = "kdray_http_dropped_connections_total";
  EXPECT_EQ(parsed.series[name + "{reason=\"evicted\"}"], 2);
  EXPECT_EQ(parsed.series[name + "{reason=\"refused\"}"], 1);
  EXPECT_EQ(parsed.series[name + "{reason=\"closed\"}"], 0);
  EXPECT_EQ(parsed.series["kdray_http_accept_failures_total"], 1);
}

TEST(Metrics, CountRequestsByRouteAndStatus) {
  Metrics metrics(Routes());
  for (int i = 0; i < 3; ++i) metrics.Answered(Record("/v1/trees/{id}/rays/any", 200));
  metrics.Answered(Record("/v1/trees/{id}/rays/any", 404));
  metrics.Answered(Record("", 401));
  const auto requests = [&](const std::string& route, int status) {
    return Value(metrics, "kdray_http_requests_total{route=\"" + route + "\",status=\"" +
                              std::to_string(status) + "\"}");
  };
  EXPECT_EQ(requests("/v1/trees/{id}/rays/any", 200), 3);
  EXPECT_EQ(requests("/v1/trees/{id}/rays/any", 404), 1);
  EXPECT_EQ(requests("none", 401), 1);
  EXPECT_EQ(requests("/v1/trees/{id}/rays/closest", 200), -1);
  EXPECT_EQ(Value(metrics, "kdray_http_received_body_bytes_total"), 50);
  EXPECT_EQ(Value(metrics, "kdray_http_sent_bytes_total"), 500);
}

TEST(Metrics, KeepTheTimesOfTheClassesApart) {
  Metrics metrics(Routes());
  const auto count = [&](const std::string& request_class) {
    return Value(metrics,
                 "kdray_http_request_duration_seconds_count{class=\"" + request_class + "\"}");
  };
  metrics.Answered(Record("/v1/trees/{id}/rays/closest", 200, 3));
  metrics.Answered(Record("/v1/trees/{id}/render.png", 200, 3000));
  metrics.Answered(Record("/v1/trees", 200));  // a list
  HttpRecord upload = Record("/v1/trees", 201);
  upload.method = "POST";
  metrics.Answered(upload);
  metrics.Answered(Record("/healthz", 200));
  metrics.Answered(Record("", 400));
  EXPECT_EQ(count("query"), 1);
  EXPECT_EQ(count("render"), 1);
  EXPECT_EQ(count("upload"), 1);
  EXPECT_EQ(count("other"), 3);
  EXPECT_EQ(
      Value(metrics, "kdray_http_request_duration_seconds_bucket{class=\"query\",le=\"0.001\"}"),
      0);
  EXPECT_EQ(
      Value(metrics, "kdray_http_request_duration_seconds_bucket{class=\"query\",le=\"0.005\"}"),
      1);
  EXPECT_EQ(Value(metrics, "kdray_http_request_duration_seconds_sum{class=\"render\"}"), 3);
}

TEST(Metrics, CountRowsByQueryAndPrecision) {
  Metrics metrics(Routes());
  metrics.CountRows("/v1/trees/{id}/rays/closest", "watertight", 64);
  metrics.CountRows("/v1/trees/{id}/rays/closest", "watertight", 36);
  metrics.CountRows("/v1/trees/{id}/rays/any", "exact", 5);
  metrics.CountRows("/v1/trees/{id}/render.png", "exact", 5);
  metrics.CountRows("/v1/trees/{id}/rays/any", "auto", 5);
  EXPECT_EQ(Value(metrics, "kdray_rays_total{precision=\"watertight\",query=\"closest\"}"), 100);
  EXPECT_EQ(Value(metrics, "kdray_rays_total{precision=\"exact\",query=\"any\"}"), 5);
  EXPECT_EQ(Value(metrics, "kdray_rays_total{precision=\"fast\",query=\"any\"}"), 0);
}

TEST(Metrics, CountTheRaysOfPicturesByKind) {
  Metrics metrics(Routes());
  api::RenderCounts counts;
  counts.camera_rays = 100;
  counts.shadow_rays = 7;
  metrics.CountPicture(counts);
  metrics.CountPicture(counts);
  EXPECT_EQ(Value(metrics, "kdray_picture_rays_total{kind=\"camera\"}"), 200);
  EXPECT_EQ(Value(metrics, "kdray_picture_rays_total{kind=\"shadow\"}"), 14);
  EXPECT_EQ(Value(metrics, "kdray_picture_rays_total{kind=\"occlusion\"}"), 0);
}

TEST(Metrics, TellWhyWorkWasCancelled) {
  Metrics metrics(Routes());
  HttpRecord record = Record("/v1/trees/{id}/rays/any", 504);
  record.error_code = "deadline_exceeded";
  metrics.Answered(record);
  metrics.Answered(Record("/v1/trees/{id}/rays/any", kClientGone));
  EXPECT_EQ(Value(metrics, "kdray_cancelled_requests_total{reason=\"deadline\"}"), 1);
  EXPECT_EQ(Value(metrics, "kdray_cancelled_requests_total{reason=\"client\"}"), 1);
  EXPECT_EQ(Value(metrics, "kdray_http_clients_gone_total"), 1);
}

TEST(Metrics, ReadWhatOthersCount) {
  Metrics metrics(Routes());
  CurrentValues now;
  now.queued = 3;
  now.dropped_log_lines = 4;
  now.backend.builds = 5;
  now.backend.store_bytes = 6;
  const std::string text = metrics.Text(now);
  EXPECT_THAT(text, HasSubstr("\nkdray_queued_requests 3\n"));
  EXPECT_THAT(text, HasSubstr("\nkdray_dropped_log_lines_total 4\n"));
  EXPECT_THAT(text, HasSubstr("\nkdray_tree_builds_total 5\n"));
  EXPECT_THAT(text, HasSubstr("\nkdray_store_bytes 6\n"));
}

TEST(Metrics, TellWhatIsCountedOfASharedStore) {
  Metrics metrics(Routes(), true);
  Exposition parsed = Parse(metrics.Text(AllValues()));
  const std::string store = "kdray_shared_store_";
  const auto requests = [&](const std::string& operation, const std::string& outcome) {
    return parsed.series[store + "requests_total{operation=\"" + operation + "\",outcome=\"" +
                         outcome + "\"}"];
  };
  EXPECT_EQ(requests("list", "answered"), 20);
  EXPECT_EQ(requests("put", "failed"), 4);
  EXPECT_EQ(parsed.series[store + "request_duration_seconds_bucket{le=\"0.025\"}"], 60);
  EXPECT_EQ(parsed.series[store + "request_duration_seconds_bucket{le=\"+Inf\"}"], 120);
  EXPECT_EQ(parsed.series[store + "request_duration_seconds_count"], 120);
  EXPECT_EQ(parsed.series[store + "request_duration_seconds_sum"], 12.5);
  EXPECT_EQ(parsed.series[store + "retries_total"], 5);
  EXPECT_EQ(parsed.series[store + "sent_bytes_total"], 6);
  EXPECT_EQ(parsed.series[store + "received_bytes_total"], 7);
  EXPECT_EQ(parsed.series[store + "lookups_total"], 8);
  EXPECT_EQ(parsed.series[store + "files_total{file=\"mesh\",place=\"directory\"}"], 9);
  EXPECT_EQ(parsed.series[store + "files_total{file=\"tree\",place=\"store\"}"], 12);
  EXPECT_EQ(parsed.series[store + "away"], 1);
  std::size_t lines = 0;
  for (const auto& [series, value] : parsed.series) lines += series.starts_with(store) ? 1 : 0;
  EXPECT_EQ(lines, Metrics::kSharedStoreSeries);
  EXPECT_EQ(metrics.Text({}).find(store), std::string::npos);
}

TEST(Metrics, TellLimitsOnlyIfThereAreAny) {
  Metrics metrics(Routes());
  CurrentValues now = AllValues();
  now.memory_limit_bytes = 9;
  now.backend.memory_limit_bytes = 5;
  Exposition parsed = Parse(metrics.Text(now));
  EXPECT_EQ(parsed.series["kdray_memory_limit_bytes"], 9);
  EXPECT_EQ(parsed.series["kdray_library_memory_limit_bytes"], 5);
  EXPECT_EQ(parsed.series["kdray_store_limit_bytes"], 7);
  EXPECT_EQ(parsed.series["kdray_store_free_bytes"], 8);
  EXPECT_EQ(Value(metrics, "kdray_store_limit_bytes"), -1);
  EXPECT_EQ(Value(metrics, "kdray_store_free_bytes"), -1);
}

TEST(Metrics, TellWhatTheSystemSaysOfTheProcess) {
  const ProcessValues before = ReadProcessValues();
  const std::vector<char> memory(std::size_t{64} << 20, 1);
  const int descriptor = ::dup(0);
  ASSERT_GE(descriptor, 0);
  volatile double work = 0;
  while (ReadProcessValues().cpu_seconds < before.cpu_seconds + 0.02) work = work + 1;
  const ProcessValues after = ReadProcessValues();
  ::close(descriptor);
  EXPECT_GE(after.resident_bytes, before.resident_bytes + memory.size() / 2);
  EXPECT_EQ(after.open_descriptors, before.open_descriptors + 1);
  EXPECT_GT(after.max_descriptors, after.open_descriptors);
  Metrics metrics(Routes());
  CurrentValues now;
  now.process = after;
  Exposition parsed = Parse(metrics.Text(now));
  EXPECT_EQ(parsed.series["process_open_fds"], static_cast<double>(after.open_descriptors));
  EXPECT_EQ(parsed.series["process_max_fds"], static_cast<double>(after.max_descriptors));
  EXPECT_EQ(parsed.series["process_resident_memory_bytes"],
            static_cast<double>(after.resident_bytes));
  EXPECT_NEAR(parsed.series["process_cpu_seconds_total"], after.cpu_seconds, 1e-6);
}

TEST(Metrics, CountFromManyThreads) {
  Metrics metrics(Routes());
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 4; ++i) {
      threads.emplace_back([&metrics] {
        for (int j = 0; j < 1000; ++j) {
          metrics.ConnectionOpened();
          metrics.Answered(Record(j % 2 == 0 ? "/v1" : "/docs", 200 + j % 3));
          metrics.ConnectionClosed();
        }
      });
    }
  }
  EXPECT_EQ(Value(metrics, "kdray_http_accepted_connections_total"), 4000);
  EXPECT_EQ(Value(metrics, "kdray_http_connections"), 0);
  EXPECT_EQ(Value(metrics, "kdray_http_request_duration_seconds_count{class=\"other\"}"), 4000);
}

}  // namespace
}  // namespace kdray::server
