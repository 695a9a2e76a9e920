// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/simd/closest-inl.h"
