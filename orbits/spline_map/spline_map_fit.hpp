#pragma once

#include <utility>
#include <vector>

#include <Eigen/Core>

#include "orbits/sections/section_points.hpp"
#include "orbits/spline_map/reading_smoother.hpp"
#include "orbits/spline_map/section_lift.hpp"
#include "orbits/spline_map/spline_map.hpp"
#include "orbits/spline_map/spline_model_error.hpp"

namespace orbid::orbits {

/// A patch map fitted to a series with errors in points and images.
struct SplineMapFit {
    SplineMapFit(SplineMap empty, const Eigen::VectorXd& smallest) : map(std::move(empty)), model_error(smallest) {}

    SplineMap map;
    /// K with Cov(coefficients) = K' K, row-major, shape (unknowns, unknowns), lower triangular.
    std::vector<double> root;
    PatchModelError model_error;
    Eigen::MatrixXd states;              ///< smoothed points, shape (n, points); nan where nothing was read
    double chi2 = 0.0;                   ///< of the residuals per degree of freedom
    double unexplained = 1.0;            ///< share of the images' variance that a map of the readings does not explain
    std::vector<SmallMatrix> remaining;  ///< covariance of the unknown part of a point's reading error
    bool usable = false;
};

struct SplineMapFitOptions {
    double spacing = 0.05;
    int passes = 6;
    double first_share = 0.8;  ///< Q = share^2 S in the first pass over the series
    /// In the last three. Where Q is large smoothed points follow a wrong map, and the map follows them: at noise 2e-2
    /// errors of the map grow from pass to pass with 0.1, and do not with 0.01.
    double last_share = 0.01;
    double gate = 25.0;
    double largest_unexplained = 0.25;
};

/// The first map of a section.
///
/// @param reading_covariance  S, shape (n, n), scaled units.
[[nodiscard]] SplineMapFit fit_spline_map(const SectionPoints& section, const SectionLift& lift,
                                          const Eigen::MatrixXd& reading_covariance,
                                          const SplineMapFitOptions& options);

/// The next map, of the same section or of a longer one. It begins at the states that were smoothed by the one before,
/// which also tells the turns of angles: better than a lift where errors grow to half a turn.
///
/// @return not usable if the one before is not
[[nodiscard]] SplineMapFit fit_spline_map(const SectionPoints& section, const SplineMapFit& before,
                                          const Eigen::MatrixXd& reading_covariance,
                                          const SplineMapFitOptions& options);

}  // namespace orbid::orbits
