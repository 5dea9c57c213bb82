#pragma once

#include <vector>

#include <Eigen/Core>

namespace orbid::apps {

/// An orbit of the model, about.
struct OrbitStart {
    int period = 1;
    std::vector<int> rotation;  ///< one per angle coordinate; empty: from the points
    Eigen::MatrixXd points;     ///< shape (n, p)
    double time = 0.0;          ///< T [s], > 0: autonomous models without a section, which have one point; else 0
};

}  // namespace orbid::apps
