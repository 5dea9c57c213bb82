#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "orbits/patch_map.hpp"
#include "orbits/section_lift.hpp"
#include "orbits/section_points.hpp"

namespace orbid::orbits {

/// How a pass over the series went.
struct PatchMapPass {
    double model_share = 0.0;  ///< Q = model_share^2 S
    double chi2 = 0.0;         ///< of the residuals per degree of freedom
    double freedom = 0.0;      ///< effective number of coefficients
    double state_sd = 0.0;     ///< rms of what remains of a reading error relative to the error itself
    double step = 0.0;         ///< largest change of a coefficient
    std::size_t gated = 0;     ///< steps that were kept from pulling
};

/// A patch map fitted to a series with errors in both of its sides.
struct PatchMapFit {
    explicit PatchMapFit(PatchMap empty) : map(std::move(empty)) {}

    PatchMap map;
    /// K with Cov(coefficients) = K' K, row-major, shape (unknowns, unknowns), lower triangular.
    std::vector<double> root;
    Eigen::MatrixXd states;    ///< smoothed points, shape (n, points); nan where nothing was read
    double model_share = 0.0;  ///< Q = model_share^2 S
    double chi2 = 0.0;         ///< of the residuals per degree of freedom
    double freedom = 0.0;      ///< effective number of coefficients
    double state_sd = 0.0;     ///< rms of what remains of a reading error relative to the error itself
    std::size_t gated = 0;     ///< steps that were kept from pulling
    std::vector<PatchMapPass> passes;
    bool usable = false;
};

struct PatchMapFitOptions {
    double spacing = 0.05;
    int passes = 6;
    double first_share = 0.8;
    double last_share = 0.2;
    double gate = 25.0;
};

/// @param reading_covariance  S, shape (n, n), scaled units.
[[nodiscard]] PatchMapFit fit_patch_map(const SectionPoints& section, const SectionLift& lift,
                                        const Eigen::MatrixXd& reading_covariance, const PatchMapFitOptions& options);

}  // namespace orbid::orbits
