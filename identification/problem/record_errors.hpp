#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/residual.hpp"

#pragma GCC visibility push(default)

namespace orbid::identification {

/// Errors of the readings of one coordinate. ErrorScale::value is 0 while estimated without a start: "start from the
/// residuals".
struct RecordErrors {
    Eigen::Index coordinate = 0;  ///< of the model
    estimator::ErrorScale scale;  ///< with `sd_column` a factor on the sds there
    estimator::ErrorDistribution distribution = estimator::NormalErrors{};
    double floor = 0.0;     ///< least value of an estimated scale
    std::string sd_column;  ///< not empty: orbits::Segment::deviations holds the sd of every reading
};

/// Several coordinates with one full covariance, estimated.
struct JointErrors {
    std::vector<Eigen::Index> coordinates;  ///< two or more, normal
    double dof = 0.0;                       ///< of its inverse-Wishart prior; 0: none
    Eigen::MatrixXd psi;                    ///< shape (m, m), with a prior
};

}  // namespace orbid::identification

#pragma GCC visibility pop
