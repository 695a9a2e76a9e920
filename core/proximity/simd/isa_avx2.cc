// SPDX-License-Identifier: Apache-2.0
#ifdef __x86_64__
#define KDRAY_ISA_AVX2
#include "core/proximity/simd/closest-inl.h"
#endif
