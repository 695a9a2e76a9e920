// The names of the engines (core/kernel/kernel.h).
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace kdray::core {

enum class Engine : std::uint8_t {
  kWave,     ///< 16 rays in flight, each on its own: for rays that have nothing in common
  kHybrid,   ///< packets of 16 that fall apart into single rays where they stop agreeing
  kFrustum,  ///< packets of 64 that share their origin and stay close together
};
inline constexpr std::array kAllEngines = {Engine::kWave, Engine::kHybrid, Engine::kFrustum};

/// "wave", "hybrid", "frustum".
std::string_view Name(Engine engine);

}  // namespace kdray::core
