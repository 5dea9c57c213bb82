#include "estimator/errors/joint_covariance.hpp"

#include <cmath>

namespace orbid::estimator {

Eigen::MatrixXd covariance_root(const NoiseModel& law, const Eigen::VectorXd& psi) {
    const auto m = static_cast<Eigen::Index>(law.channels.size());
    Eigen::MatrixXd lower = Eigen::MatrixXd::Zero(m, m);
    Eigen::Index k = law.first;
    for (Eigen::Index j = 0; j < m; ++j)
        for (Eigen::Index i = j; i < m; ++i, ++k)
            lower(i, j) = i == j ? std::exp(psi[k]) : psi[k];
    return lower;
}

Eigen::VectorXd root_coordinates(const Eigen::MatrixXd& lower) {
    const Eigen::Index m = lower.rows();
    Eigen::VectorXd psi(m * (m + 1) / 2);
    Eigen::Index k = 0;
    for (Eigen::Index j = 0; j < m; ++j)
        for (Eigen::Index i = j; i < m; ++i, ++k)
            psi[k] = i == j ? std::log(lower(i, j)) : lower(i, j);
    return psi;
}

Eigen::MatrixXd covariance_slopes(const NoiseModel& law, const Eigen::VectorXd& psi) {
    const Eigen::MatrixXd lower = covariance_root(law, psi);
    const Eigen::Index m = lower.rows();
    Eigen::MatrixXd slopes(m * m, m * (m + 1) / 2);
    Eigen::Index k = 0;
    for (Eigen::Index j = 0; j < m; ++j)
        for (Eigen::Index i = j; i < m; ++i, ++k) {
            Eigen::MatrixXd change = Eigen::MatrixXd::Zero(m, m);
            change(i, j) = i == j ? lower(i, j) : 1.0;
            const Eigen::MatrixXd half = change * lower.transpose();
            slopes.col(k) = (half + half.transpose()).reshaped();
        }
    return slopes;
}

}  // namespace orbid::estimator
