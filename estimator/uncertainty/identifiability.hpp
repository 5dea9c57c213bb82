#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/estimate_result.hpp"
#include "estimator/problem/bounded_step.hpp"

namespace orbid::estimator {

/// The information of the data alone on the parameters that are not held at a bound.
struct Identifiability {
    Eigen::VectorXd singular_values;             ///< of the reduced problem's sensitivities in units of `column_size`
    std::vector<NullDirection> null_directions;  ///< directions that leave the data unchanged, sparsest basis
    std::vector<NullDirection> undecided;        ///< those of them that no prior determines either
    std::vector<bool> undetermined;              ///< per parameter: part of an undetermined direction
    /// Directions that the data determine only within a factor e or worse, but others much better; the least determined
    /// first.
    std::vector<SloppyDirection> sloppy_directions;
    Eigen::VectorXd data_variance;  ///< posterior variance in u from the data alone; infinite in a null direction
};

/// @param r            whitened sensitivities of the reduced problem, shape (q, q).
/// @param size         size of each parameter in u (1 for log): unit of the components of null directions.
/// @param column_size  prior sd where proper, else size: unit of the singular values.
[[nodiscard]] Identifiability identifiability(const Eigen::MatrixXd& r, const BoundedStep& step,
                                              const Eigen::VectorXd& size, const Eigen::VectorXd& column_size);

/// The product of powers of the parameters along a direction in log parameters: "m^1 k2^1 k3^(-1/2)".
///
/// Exponents equal to a fraction p/q, q <= 6, to 1e-6 are written so, others with three digits.
[[nodiscard]] std::string as_product(const Eigen::VectorXd& components, const std::vector<FreeParameter>& parameters);

/// "m, k2 and k3 enter only in a combination: m +1, k2 +1, k3 +1 leaves the data unchanged"
[[nodiscard]] std::string in_words(const NullDirection& direction, const std::vector<FreeParameter>& parameters);

/// "the data know m^1 k2^1 only within a factor 12 (sd of its logarithm 2.5)"
[[nodiscard]] std::string in_words(const SloppyDirection& direction, const std::vector<FreeParameter>& parameters);

/// What the data tell of the parameters of a direction that they do not tell: of parameters on logarithmic scales
/// quotients of powers, "k2 / m and k3 / m", of others differences, "k3 - 0.8 k1", each with the largest component.
/// Empty for a direction of one parameter.
/// @param components  relative changes, shape (parameters); what is below a hundredth of the largest is left out.
/// @param size        of each parameter: the change in natural units that a component of 1 stands for.
[[nodiscard]] std::string what_is_told(const Eigen::VectorXd& components, const std::vector<FreeParameter>& parameters,
                                       const Eigen::VectorXd& size);

}  // namespace orbid::estimator
