#include "core/proximity/simd/closest-inl.h"
