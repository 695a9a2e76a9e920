// SPDX-License-Identifier: Apache-2.0
// The real LoadedTree: answers queries on a scene of core's library, in an arena for each query.
#pragma once

#include <atomic>
#include <memory>

#include "api/limits.h"
#include "core/catalog/tree_id.h"
#include "core/library/tree_library.h"
#include "core/scene/scene.h"
#include "server/backend.h"
#include "server/query_arenas.h"

namespace kdray::server {

/// What all trees of a backend share. Thread-safe.
struct QueryRunner {
  const api::Limits limits;
  QueryArenas arenas;
  std::atomic<int> queries{0};  ///< running now; the library's measurements read it
};

/// `scene` is that of tree `id` in `library`. Both pointers must outlive the result.
std::unique_ptr<const LoadedTree> MakeCoreLoadedTree(QueryRunner* runner,
                                                     core::TreeLibrary* library,
                                                     const core::TreeId& id, core::Scene scene);

}  // namespace kdray::server
