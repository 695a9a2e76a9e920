// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/simd/kernels-inl.h"
