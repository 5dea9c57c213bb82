#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>

#include "orbits/spline_map/reading_smoother.hpp"
#include "orbits/spline_map/spline_map.hpp"

namespace orbid::orbits {

/// The patches at the steps of a series: the rows of the linear system for the coefficients.
class SplineDesign {
public:
    /// @param places  shape (n, steps); steps with present[t] = 0 are left out.
    /// @param interrupted  asked by what takes long, and outlives this; @throws models::Stopped if it says so
    SplineDesign(const SplineMap& map, const Eigen::MatrixXd& places, const std::vector<char>& present,
                 const std::function<bool()>& interrupted);

    /// Phi' V^-1 Phi, row-major, shape (unknowns, unknowns), both triangles; 1 on the diagonal of unknowns that are
    /// zero by symmetry. Without a smoother V = 1.
    [[nodiscard]] std::vector<double> normal_matrix(const ReadingSmoother* smoother) const;
    /// Phi' u for u of shape (n, steps); 0 for unknowns that are zero by symmetry.
    [[nodiscard]] Eigen::VectorXd gathered(const Eigen::MatrixXd& u) const;
    /// Phi c, shape (n, steps).
    [[nodiscard]] Eigen::MatrixXd spread(const Eigen::VectorXd& coefficients) const;

private:
    struct Touch {
        std::size_t step;
        double value;
        bool mirrored;
    };
    const SplineMap* map_;
    const std::function<bool()>* interrupted_;
    std::size_t steps_ = 0;
    std::size_t width_ = 0;            ///< patches per step
    std::vector<std::int32_t> patch_;  ///< width_ per step; -1: step left out
    std::vector<char> mirrored_;
    std::vector<double> value_;
    std::vector<std::vector<Touch>> touches_;  ///< of every patch
};

}  // namespace orbid::orbits
