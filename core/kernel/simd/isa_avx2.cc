// SPDX-License-Identifier: Apache-2.0
#ifdef __x86_64__
#define KDRAY_ISA_AVX2
#include "core/kernel/simd/kernels-inl.h"
#endif
