// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/load.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <mutex>
#include <thread>

#include "clients/cpp/command/answer_facts.h"

namespace kdray::client {

using Clock = std::chrono::steady_clock;

double LoadResult::Percentile(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0;
  const double rank = std::ceil(share * static_cast<double>(sorted.size())) - 1;
  return sorted[static_cast<std::size_t>(
      std::clamp(rank, 0.0, static_cast<double>(sorted.size() - 1)))];
}

double LoadResult::Rate() const {
  return seconds > 0 ? static_cast<double>(latencies_ms.size()) / seconds : 0;
}

LoadResult RunLoad(const ClientOptions& options, int connections,
                   std::chrono::duration<double> duration,
                   const std::function<Answer(Client&)>& ask) {
  LoadResult result;
  std::mutex mutex;  // of result and failure
  std::exception_ptr failure;
  std::atomic<bool> stop = false;
  const auto begin = Clock::now();
  const auto end = begin + std::chrono::duration_cast<Clock::duration>(duration);

  const auto work = [&] {
    std::vector<double> latencies_ms, trace_ms;
    try {
      Client client(options);
      ask(client);  // connects, and loads the tree
      do {
        const auto sent = Clock::now();
        const Answer answer = ask(client);
        const std::chrono::duration<double, std::milli> took = Clock::now() - sent;
        latencies_ms.push_back(took.count());
        const auto traced = TimingOf(answer.response.Header("server-timing"), "trace");
        if (traced) trace_ms.push_back(*traced);
      } while (Clock::now() < end && !stop);
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
      stop = true;
    }
    const std::lock_guard lock(mutex);
    result.latencies_ms.insert(result.latencies_ms.end(), latencies_ms.begin(), latencies_ms.end());
    result.trace_ms.insert(result.trace_ms.end(), trace_ms.begin(), trace_ms.end());
  };
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < connections; ++i) threads.emplace_back(work);
  }
  if (failure) std::rethrow_exception(failure);
  result.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  std::sort(result.latencies_ms.begin(), result.latencies_ms.end());
  std::sort(result.trace_ms.begin(), result.trace_ms.end());
  return result;
}

}  // namespace kdray::client
