#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/parameter_map.hpp"
#include "estimator/interface/residual.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

/// Another start or a fixed value for one error parameter of a group.
struct ErrorOverride {
    std::string group;
    std::string parameter = "scale";  ///< "scale", or "dof", "relative", "correlation" as the distribution has it
    double value = 1.0;               ///< in natural units; <= 0 for an estimated scale: start from the residuals
    bool estimate = false;            ///< false: fixed at `value`; true: estimated from there. Priors stay
};

/// Changes of a MappedResidual besides the parameters.
struct MappedResidualOptions {
    std::vector<ErrorOverride> errors;
    /// Latent states to start from, one vector per block of the wrapped residual; empty = its own.
    std::optional<std::vector<Eigen::VectorXd>> initial_latents;
    /// The wrapped residual's set with which estimates begin and end: update_active_set() does nothing, and it is no
    /// intermediate stage. Empty: its initial one, which is updated.
    std::optional<ActiveSet> active;
};

/// A residual as a function of a smaller parameter vector. Some parameters are pinned, several tied to one, error
/// parameters fixed or started elsewhere, latent states started elsewhere.
///
///     e(reduced, z) = inner e(M reduced + pins, z),   de/d reduced = de/d theta M,   c likewise
///
/// Used for other questions to the same data: profile likelihoods pin one parameter, nested Laplace pins error
/// parameters, multi-start begins elsewhere. The estimated vector has the length and the order of the reduced one.
///
/// update_active_set() is forwarded to the wrapped residual with theta mapped, unless a set is given. Its sets are
/// those of the wrapped residual, but for the overridden error parameters.
class MappedResidual : public Residual {
public:
    /// `inner` is not owned and must outlive the adapter.
    ///
    /// @throws std::invalid_argument naming the group. Overrides: of an unknown group, of a parameter that its
    ///         distribution does not have, or of a group in a full covariance (its elements belong together). Values:
    ///         not finite or outside the parameter's domain; latent states that do not fit the layout.
    MappedResidual(const Residual& inner, ParameterMap map, MappedResidualOptions options = {});

    [[nodiscard]] std::string_view type() const override { return inner_->type(); }
    [[nodiscard]] const std::vector<Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] LatentStructure structure() const override { return inner_->structure(); }
    [[nodiscard]] std::vector<JointCovariance> covariances() const override { return inner_->covariances(); }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<BlockValue> evaluate(const ActiveSet& active, const Eigen::VectorXd& theta,
                                                   const std::vector<Eigen::VectorXd>& latents,
                                                   bool derivatives) const override;
    RefreshReport update_active_set(ActiveSet& active, const Eigen::VectorXd& theta,
                                    const std::vector<Eigen::VectorXd>& latents,
                                    const Eigen::VectorXd& scales) const override;

    [[nodiscard]] const ParameterMap& map() const { return map_; }

private:
    void override_errors(ActiveSet& active) const;

    const Residual* inner_;
    ParameterMap map_;
    MappedResidualOptions options_;
    ActiveSet initial_;
};

}  // namespace orbid::estimator

#pragma GCC visibility pop
