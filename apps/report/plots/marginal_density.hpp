#pragma once

#include <vector>

#include <nlohmann/json.hpp>

namespace orbid::apps {

/// A density as a curve.
struct MarginalDensity {
    std::vector<double> x;
    std::vector<double> y;
};

/// The density of a value from points of the density of the coordinate u in which it was followed (the logarithm of a
/// positive parameter): p(value) = p(u) du / dvalue, by a cubic spline of ln p(u) and cubic pieces of value(u).
/// @param list  "points" of an entry of "marginals" in result.json.
/// @return eight places per interval; nothing for fewer than three points.
[[nodiscard]] MarginalDensity marginal_density(const nlohmann::ordered_json& list);

}  // namespace orbid::apps
