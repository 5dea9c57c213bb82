#pragma once

#include <memory>
#include <vector>

#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/estimate_result.hpp"
#include "estimator/interface/mapped_residual.hpp"
#include "estimator/interface/parameter_map.hpp"

namespace orbid::estimator {

/// An estimate with tied parameters (FreeParameter::tied_to) or held ones, reformulated without them. Held is a
/// parameter whose bounds leave it one value: lower = start = upper.
///
/// The estimate of `parameters` with `residuals` and the result of derived() is the requested one; expand() restores
/// the original list of parameters. Derived quantities and residuals keep the full vector theta as argument.
struct TiedProblem {
    std::vector<FreeParameter> parameters;  ///< neither tied nor held; bounds of their followers hold for them
    std::vector<std::unique_ptr<MappedResidual>> adapters;
    std::vector<const Residual*> residuals;  ///< the adapters; the residuals as given when nothing is tied
    ParameterMap map = ParameterMap::identity(0);
    std::vector<FreeParameter> full;  ///< as given

    [[nodiscard]] bool any() const { return full.size() != parameters.size(); }

    /// The same quantities as functions of the reduced vector.
    [[nodiscard]] std::vector<DerivedQuantity> derived(const std::vector<DerivedQuantity>& quantities) const;

    /// Parameters, covariance, correlation, directions and hessian_ratio of `estimate` in terms of the full list. A
    /// tied parameter has value, start, sd and interval of the one it follows times its factor, and the same part in
    /// null directions. A held one has its value and neither sd nor interval. Products of powers (sloppy directions)
    /// stay those of the free ones.
    void expand(Estimate& estimate) const;

    /// The part of a full estimate that belongs to `parameters`: these and their covariance.
    [[nodiscard]] Estimate reduced(const Estimate& estimate) const;
};

/// Bounds that leave one value.
[[nodiscard]] bool is_held(const FreeParameter& parameter);

/// Whether any parameter is tied or held.
[[nodiscard]] bool any_tied(const std::vector<FreeParameter>& parameters);

/// Reformulates an estimate with tied or held parameters without them. A follower of a held one is held as well.
///
/// @throws std::invalid_argument naming the parameter. Names: duplicates. Ties: to itself, to an unknown name or to a
///         tied parameter; a factor that is 0 or not finite. A tied parameter with a prior of its own (alone or in a
///         joint one), or with bounds that leave no room for the one it follows.
[[nodiscard]] TiedProblem resolve_ties(const std::vector<FreeParameter>& parameters,
                                       const std::vector<const Residual*>& residuals,
                                       const std::vector<JointNormalPrior>& joint_priors = {});

}  // namespace orbid::estimator
