#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace orbid::orbits {

/// Factor that turns a number in unit `from` into a number in unit `to`: 1 deg = pi/180 rad.
///
/// Known are angles (rad, mrad, deg, arcmin, turns), their rates (the same with "/s", rpm), times (s, ms, us, min, h),
/// lengths (m, cm, mm, km), velocities (m/s, cm/s, mm/s, km/h) and accelerations (m/s^2, cm/s^2, mm/s^2, g = 9.80665
/// m/s^2). Any two equal names have the factor 1, and so has an empty `from`.
///
/// @return nothing when a unit is unknown or the two measure different quantities.
[[nodiscard]] std::optional<double> unit_factor(std::string_view from, std::string_view to);

/// The units that convert to `to`, for messages: "rad, mrad, deg"; `to` itself when it is unknown.
[[nodiscard]] std::string units_like(std::string_view to);

}  // namespace orbid::orbits
