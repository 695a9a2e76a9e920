#include "core/trace/engine/target_prologue.h"

#ifdef __x86_64__
#ifdef __clang__
#pragma clang attribute push(                                                               \
    __attribute__((                                                                         \
        target("avx512f,avx512vl,avx512bw,avx512dq,avx2,fma,bmi,bmi2,lzcnt,popcnt,f16c"))), \
    apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx512f,avx512vl,avx512bw,avx512dq,avx2,fma,bmi,bmi2,lzcnt,popcnt,f16c")
#endif
#define KDRAY_ISA_AVX512
#define KDRAY_ISA_NAMESPACE isa_avx512
#include "core/trace/engine/target_all.inc"
#ifdef __clang__
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif
