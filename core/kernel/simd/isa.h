// SPDX-License-Identifier: Apache-2.0
// The instruction set that the -inl.h headers of this folder are compiled for. Each isa_*.cc names
// one before it includes them, so a header read there is compiled for that set alone, in a
// namespace of its own; read anywhere else it is compiled for the baseline.
//
// Each -inl.h includes first, and then puts what it defines between KDRAY_BEGIN_ISA() and
// KDRAY_END_ISA(). So no function of another header is compiled with instructions that an older
// processor lacks: the linker could keep that copy for the whole program. The form is that of
// Highway (hwy/examples/skeleton-inl.h).
#pragma once

#ifdef __x86_64__
#include <immintrin.h>
#endif

#if defined(KDRAY_ISA_AVX512)
#define KDRAY_ISA isa_avx512
#define KDRAY_ISA_TARGET "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma,bmi,bmi2,lzcnt,popcnt,f16c"
#elif defined(KDRAY_ISA_AVX2)
#define KDRAY_ISA isa_avx2
#define KDRAY_ISA_TARGET "avx2,fma,bmi,bmi2,lzcnt,popcnt,f16c"
#else
#define KDRAY_ISA isa_baseline
#endif

#define KDRAY_PRAGMA(text) _Pragma(#text)
#define KDRAY_ASK_FOR_SEMICOLON static_assert(true, "")

#if !defined(KDRAY_ISA_TARGET)
#define KDRAY_BEGIN_ISA() KDRAY_ASK_FOR_SEMICOLON
#define KDRAY_END_ISA() KDRAY_ASK_FOR_SEMICOLON
#elif defined(__clang__)
#define KDRAY_CLANG_TARGET(target_name) \
  KDRAY_PRAGMA(clang attribute push(__attribute__((target(target_name))), apply_to = function))
#define KDRAY_BEGIN_ISA() KDRAY_CLANG_TARGET(KDRAY_ISA_TARGET) KDRAY_ASK_FOR_SEMICOLON
#define KDRAY_END_ISA() KDRAY_PRAGMA(clang attribute pop) KDRAY_ASK_FOR_SEMICOLON
#else
#define KDRAY_GCC_TARGET(target_name) KDRAY_PRAGMA(GCC target target_name)
#define KDRAY_BEGIN_ISA() \
  KDRAY_PRAGMA(GCC push_options) KDRAY_GCC_TARGET(KDRAY_ISA_TARGET) KDRAY_ASK_FOR_SEMICOLON
#define KDRAY_END_ISA() KDRAY_PRAGMA(GCC pop_options) KDRAY_ASK_FOR_SEMICOLON
#endif
