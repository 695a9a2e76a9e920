#include "core/kernel/simd/kernels-inl.h"
