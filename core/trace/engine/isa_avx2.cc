#include "core/trace/engine/target_prologue.h"

#ifdef __x86_64__
#pragma GCC push_options
#pragma GCC target("avx2,fma,bmi,bmi2,lzcnt,popcnt,f16c")
#define KDRAY_ISA_AVX2
#define KDRAY_ISA_NAMESPACE isa_avx2
#include "core/trace/engine/target_all.inc"
#pragma GCC pop_options
#endif
