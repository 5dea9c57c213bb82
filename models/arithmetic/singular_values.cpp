#include "models/arithmetic/singular_values.hpp"

#include <Eigen/SVD>

namespace orbid::models {

SingularValues singular_value_decomposition(const Eigen::MatrixXd& a, SingularVectors vectors) {
    unsigned options = Eigen::ComputeFullV;
    if (vectors == SingularVectors::thin) options = Eigen::ComputeThinU | Eigen::ComputeThinV;
    if (vectors == SingularVectors::full) options = Eigen::ComputeFullU | Eigen::ComputeFullV;
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(a, options);
    SingularValues result;
    if (svd.computeU()) result.u = svd.matrixU();
    result.values = svd.singularValues();
    result.v = svd.matrixV();
    return result;
}

Eigen::VectorXd singular_values(const Eigen::MatrixXd& a) {
    return Eigen::JacobiSVD<Eigen::MatrixXd>(a).singularValues();
}

}  // namespace orbid::models
