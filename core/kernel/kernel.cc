#include "core/kernel/kernel.h"

namespace kdray::core {

namespace isa_baseline {
EngineFunction Find(Engine engine, Precision precision, bool double_vertices, bool any);
}
#ifdef __x86_64__
namespace isa_avx2 {
EngineFunction Find(Engine engine, Precision precision, bool double_vertices, bool any);
}
namespace isa_avx512 {
EngineFunction Find(Engine engine, Precision precision, bool double_vertices, bool any);
}
#endif

std::string_view Name(Engine engine) {
  switch (engine) {
    case Engine::kWave:
      return "wave";
    case Engine::kHybrid:
      return "hybrid";
    case Engine::kFrustum:
      return "frustum";
  }
  return "";
}

EngineFunction FindEngine(SimdLevel level, Engine engine, Precision precision, bool double_vertices,
                          bool any) {
  switch (level) {
    case SimdLevel::kBaseline:
      break;
#ifdef __x86_64__
    case SimdLevel::kAvx2:
      return isa_avx2::Find(engine, precision, double_vertices, any);
    case SimdLevel::kAvx512:
      return isa_avx512::Find(engine, precision, double_vertices, any);
#else
    case SimdLevel::kAvx2:
    case SimdLevel::kAvx512:
      break;
#endif
  }
  return isa_baseline::Find(engine, precision, double_vertices, any);
}

}  // namespace kdray::core
