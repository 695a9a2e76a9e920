// What was modelled and why, in words, for the people who asked for a tree.
#pragma once

#include <string>

#include "core/catalog/records.h"

namespace kdray::server {

/// A few plain sentences: the structure, how vertices are kept, what `auto` precision means here,
/// and what is not promised. Says less while less is known.
std::string DescribePlan(const core::TreeRecord& record);

}  // namespace kdray::server
