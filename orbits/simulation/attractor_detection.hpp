#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

namespace orbid::orbits {

/// A trajectory of sections that has settled on a stable periodic orbit.
struct Capture {
    int period = 0;            ///< sections until the orbit repeats, the smallest that does
    Eigen::Index settled = 0;  ///< column from which on every section lies on the orbit within the tolerance
};

/// Whether the last 256 sections of a trajectory repeat after p <= 64 sections within 1e-9 of the range.
///
/// @param sections  shape (n, m), column by column one section; fewer than 256 + 64 columns are never captured.
/// @param angle     per coordinate: differences are taken modulo 2 pi.
/// @param range     shape (n), > 0: size of each coordinate's range.
/// Cost: 64 differences when it is not captured.
[[nodiscard]] std::optional<Capture> captured(const Eigen::Ref<const Eigen::MatrixXd>& sections,
                                              const std::vector<bool>& angle, const Eigen::VectorXd& range);

/// First column from which on all sections equal the last one within 1e-9 of the range. m > 0.
[[nodiscard]] Eigen::Index settled_at_last(const Eigen::Ref<const Eigen::MatrixXd>& sections,
                                           const std::vector<bool>& angle, const Eigen::VectorXd& range);

}  // namespace orbid::orbits
