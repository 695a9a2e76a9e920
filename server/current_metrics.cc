// SPDX-License-Identifier: Apache-2.0
#include "server/current_metrics.h"

#include <prometheus/client_metric.h>
#include <prometheus/metric_type.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "server/backend.h"

namespace kdray::server {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

MetricFamily Single(MetricType type, const char* name, const char* help, double value) {
  MetricFamily family{.name = name, .help = help, .type = type, .metric = {{}}};
  (type == MetricType::Counter ? family.metric[0].counter.value : family.metric[0].gauge.value) =
      value;
  return family;
}

ClientMetric Count(std::vector<ClientMetric::Label> labels, std::uint64_t value) {
  ClientMetric metric;
  metric.label = std::move(labels);
  metric.counter.value = static_cast<double>(value);
  return metric;
}

MetricFamily RequestsOf(const SharedStoreCounters& shared) {
  MetricFamily family{.name = "kdray_shared_store_requests_total",
                      .help =
                          "Requests to the shared store, by operation and outcome: answered, or "
                          "failed (no answer, a refusal, an altered answer).",
                      .type = MetricType::Counter,
                      .metric = {}};
  for (const SharedStoreCounters::Requests& requests : shared.requests) {
    const std::string operation(requests.operation);
    family.metric.push_back(
        Count({{"operation", operation}, {"outcome", "answered"}}, requests.answered));
    family.metric.push_back(
        Count({{"operation", operation}, {"outcome", "failed"}}, requests.failed));
  }
  return family;
}

MetricFamily TimesOf(const SharedStoreCounters& shared) {
  ClientMetric metric;
  metric.histogram.sample_sum = shared.seconds;
  for (const SharedStoreCounters::TimeClass& time_class : shared.times) {
    metric.histogram.sample_count = time_class.requests;
    metric.histogram.bucket.push_back({time_class.requests, time_class.most_seconds});
  }
  return {.name = "kdray_shared_store_request_duration_seconds",
          .help = "Time of requests to the shared store.",
          .type = MetricType::Histogram,
          .metric = {std::move(metric)}};
}

MetricFamily FilesOf(const SharedStoreCounters& shared) {
  MetricFamily family{.name = "kdray_shared_store_files_total",
                      .help =
                          "Files that were needed and found, by kind (mesh, tree) and place: "
                          "directory (the data directory, a cache of the store), or store.",
                      .type = MetricType::Counter,
                      .metric = {}};
  const auto add = [&](const char* file, const SharedStoreCounters::Files& files) {
    family.metric.push_back(Count({{"file", file}, {"place", "directory"}}, files.here));
    family.metric.push_back(Count({{"file", file}, {"place", "store"}}, files.fetched));
  };
  add("mesh", shared.meshes);
  add("tree", shared.trees);
  return family;
}

void AppendSharedStore(const SharedStoreCounters& shared, std::vector<MetricFamily>& families) {
  const auto counter = [&](const char* name, const char* help, std::uint64_t value) {
    families.push_back(Single(MetricType::Counter, name, help, static_cast<double>(value)));
  };
  families.push_back(RequestsOf(shared));
  families.push_back(TimesOf(shared));
  families.push_back(FilesOf(shared));
  families.push_back(Single(MetricType::Gauge, "kdray_shared_store_away",
                            "1 while the shared store does not answer, else 0.",
                            shared.is_away ? 1 : 0));
  counter("kdray_shared_store_retries_total", "Requests to the shared store that were repeated.",
          shared.retries);
  counter("kdray_shared_store_sent_bytes_total", "Bytes of objects sent to the shared store.",
          shared.sent_bytes);
  counter("kdray_shared_store_received_bytes_total",
          "Bytes of objects received from the shared store.", shared.received_bytes);
  counter("kdray_shared_store_lookups_total",
          "Questions to the shared store whether a tree exists.", shared.lookups);
}

}  // namespace

void AppendCurrent(const CurrentValues& now, std::vector<MetricFamily>& families) {
  const auto counter = [&](const char* name, const char* help, std::uint64_t value) {
    families.push_back(Single(MetricType::Counter, name, help, static_cast<double>(value)));
  };
  const auto gauge = [&](const char* name, const char* help, std::uint64_t value) {
    families.push_back(Single(MetricType::Gauge, name, help, static_cast<double>(value)));
  };
  const BackendCounters& backend = now.backend;
  gauge("kdray_running_requests", "Requests that compute now.", now.running);
  gauge("kdray_queued_requests", "Requests that wait for their turn now.", now.queued);
  gauge("kdray_request_memory_bytes", "Memory of bodies, rows and images of running requests.",
        now.request_memory_bytes);
  gauge("kdray_library_memory_bytes", "Memory of meshes, trees and builds.", backend.memory_bytes);
  gauge("kdray_library_memory_limit_bytes", "Most memory for meshes, trees and builds.",
        backend.memory_limit_bytes);
  gauge("kdray_memory_limit_bytes", "Most memory for the whole daemon (--memory-limit).",
        now.memory_limit_bytes);
  gauge("kdray_store_bytes", "Disk space of meshes, trees and derived files.", backend.store_bytes);
  if (backend.store_limit_bytes) {
    gauge("kdray_store_limit_bytes", "Most disk space for them (--store-limit).",
          *backend.store_limit_bytes);
  }
  if (backend.store_free_bytes) {
    gauge("kdray_store_free_bytes", "Free space on the disk of the data directory.",
          *backend.store_free_bytes);
  }
  gauge("kdray_trees", "Tree ids that exist now.", backend.trees);
  gauge("kdray_unrecorded_meshes", "Stored meshes without a tree.", backend.unrecorded_meshes);
  gauge("kdray_unreadable_meshes", "Meshes of trees that are damaged or missing.",
        backend.unreadable_meshes);
  counter("kdray_tree_cache_hits_total", "Trees that requests found in memory.",
          backend.cache_hits);
  counter("kdray_tree_loads_total", "Trees read from disk instead of built.", backend.loads);
  counter("kdray_tree_builds_total", "Trees built, rebuilt ones included.", backend.builds);
  counter("kdray_tree_rebuilds_total", "Builds of trees that were ready before.", backend.rebuilds);
  counter("kdray_binary_tree_rebuilds_total", "Binary trees rebuilt for cells.",
          backend.binary_rebuilds);
  counter("kdray_mesh_parses_total", "Mesh files read.", backend.parses);
  counter("kdray_attribute_reads_total", "Mesh files read for their attributes.",
          backend.attribute_reads);
  counter("kdray_evictions_total", "Meshes and trees dropped from memory to make room.",
          backend.evictions);
  counter("kdray_damaged_files_total", "Stored files that failed their check.",
          backend.damaged_files);
  counter("kdray_dropped_log_lines_total", "Log lines dropped because they were not read in time.",
          now.dropped_log_lines);
  gauge("process_resident_memory_bytes", "Memory of the process, as the system counts it.",
        now.process.resident_bytes);
  gauge("process_open_fds", "Open file descriptors.", now.process.open_descriptors);
  gauge("process_max_fds", "Most open file descriptors.", now.process.max_descriptors);
  families.push_back(Single(MetricType::Counter, "process_cpu_seconds_total",
                            "Processor time of all threads, user and system.",
                            now.process.cpu_seconds));
  if (backend.shared) AppendSharedStore(*backend.shared, families);
}

}  // namespace kdray::server
