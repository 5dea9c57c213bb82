#pragma once

namespace orbid::models {

/// -march that the models and the inner loops of this library are compiled with: "native", "x86-64-v3"; empty: none.
[[nodiscard]] const char* compiled_machine();

/// Instructions that this library requires, as the level of the x86-64 psABI: "x86-64", "x86-64-v2" (SSE4.2),
/// "x86-64-v3" (AVX2), "x86-64-v4" (AVX-512); empty on other processors. Packs are as wide as its registers. Simulated
/// ensembles therefore have the same bytes within one level, and not beyond.
[[nodiscard]] const char* processor_level();

}  // namespace orbid::models
