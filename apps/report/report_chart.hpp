#pragma once

#include <span>
#include <string>

#include <nlohmann/json.hpp>

#include "apps/drawing/chart.hpp"

namespace orbid::apps {

/// Numbers small in a page: a plain list up to 64 of them, an even grid as first value, step and count, others as whole
/// steps between the least and the greatest, in 32 bits up to 2^16 numbers and in 16 bits beyond, base64, little
/// endian; the highest code stands for nan. Steps are 2.3e-10 and 1.5e-5 of the range.
[[nodiscard]] nlohmann::ordered_json packed_numbers(std::span<const double> values);

/// The chart as JSON for a script element: no "<" in it. Points of a density are left out: they follow in blocks.
[[nodiscard]] std::string chart_text(const Chart& chart);

}  // namespace orbid::apps
