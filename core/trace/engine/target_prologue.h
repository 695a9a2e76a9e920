// What target_all.inc needs, compiled for the baseline. See there.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#ifdef __x86_64__
#include <immintrin.h>
#endif

#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "core/trace/engine/engine.h"
#include "core/trace/exact_test.h"
#include "core/trace/leaf_test.h"
#include "core/wide/wide_tree.h"
