#include "core/trace/engine/target_prologue.h"

#define KDRAY_ISA_NAMESPACE isa_baseline
#include "core/trace/engine/target_all.inc"
