#include "estimator/interface/mapped_residual.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <variant>

#include <fmt/format.h>

namespace orbid::estimator {

namespace {

/// The error parameter of that name besides the scale; null when the distribution has none.
ErrorParameter* shape_parameter(ErrorDistribution& distribution, const std::string& name) {
    if (auto* student = std::get_if<StudentErrors>(&distribution)) return name == "dof" ? &student->dof : nullptr;
    if (auto* relative = std::get_if<RelativeErrors>(&distribution))
        return name == "relative" ? &relative->relative : nullptr;
    if (auto* autoregressive = std::get_if<AutoregressiveErrors>(&distribution))
        return name == "correlation" ? &autoregressive->correlation : nullptr;
    return nullptr;
}

bool in_domain(const std::string& parameter, double value) {
    if (parameter == "dof") return value >= 1.0;
    if (parameter == "correlation") return std::abs(value) < 1.0;
    return value > 0.0;
}

void apply(const ErrorOverride& change, std::vector<Group>& groups, const std::vector<JointCovariance>& covariances) {
    const std::string who = "group \"" + change.group + "\": ";
    const auto found =
        std::find_if(groups.begin(), groups.end(), [&](const Group& group) { return group.name == change.group; });
    if (found == groups.end()) throw std::invalid_argument(who + "the residual has no group of that name");
    const auto index = static_cast<int>(found - groups.begin());
    for (const JointCovariance& covariance : covariances)
        if (std::find(covariance.groups.begin(), covariance.groups.end(), index) != covariance.groups.end())
            throw std::invalid_argument(who + "belongs to a full covariance, none of whose elements can be set alone");
    const bool scale = change.parameter == "scale";
    const bool from_residuals = scale && change.estimate && change.value <= 0.0;
    if (!std::isfinite(change.value) || (!from_residuals && !in_domain(change.parameter, change.value)))
        throw std::invalid_argument(who + change.parameter + " = " + fmt::to_string(change.value) +
                                    " must be finite and in its domain: scale > 0, dof >= 1, relative > 0, " +
                                    "|correlation| < 1");
    if (scale) {
        found->scale.value = change.value;
        found->scale.estimate = change.estimate;
        // A fixed value below the floor is what the caller wants.
        return;
    }
    ErrorParameter* parameter = shape_parameter(found->distribution, change.parameter);
    if (parameter == nullptr)
        throw std::invalid_argument(who + "its error distribution has no parameter \"" + change.parameter + "\"");
    parameter->value = change.value;
    parameter->estimate = change.estimate;
}

}  // namespace

MappedResidual::MappedResidual(const Residual& inner, ParameterMap map, MappedResidualOptions options)
    : inner_(&inner),
      map_(std::move(map)),
      options_(std::move(options)),
      initial_(options_.active ? *options_.active : inner.initial_set()) {
    override_errors(initial_);
    // A set that does not change leads nowhere: it is minimised to the end.
    if (options_.active) initial_.is_intermediate_stage = false;
    if (!options_.initial_latents) return;
    const std::vector<BlockLayout>& blocks = layout();
    if (options_.initial_latents->size() != blocks.size())
        throw std::invalid_argument("initial latent states of " + std::to_string(options_.initial_latents->size()) +
                                    " blocks, the residual has " + std::to_string(blocks.size()));
    for (std::size_t b = 0; b < blocks.size(); ++b)
        if ((*options_.initial_latents)[b].size() != blocks[b].latents)
            throw std::invalid_argument("block \"" + blocks[b].label +
                                        "\": " + std::to_string((*options_.initial_latents)[b].size()) +
                                        " initial latent states, layout says " + std::to_string(blocks[b].latents));
    initial_.latents = *options_.initial_latents;
}

void MappedResidual::override_errors(ActiveSet& active) const {
    if (options_.errors.empty()) return;
    const std::vector<JointCovariance> covariances = inner_->covariances();
    for (const ErrorOverride& change : options_.errors)
        apply(change, active.groups, covariances);
}

std::vector<BlockValue> MappedResidual::evaluate(const ActiveSet& active, const Eigen::VectorXd& theta,
                                                 const std::vector<Eigen::VectorXd>& latents, bool derivatives) const {
    std::vector<BlockValue> values = inner_->evaluate(active, map_.expand(theta), latents, derivatives);
    for (BlockValue& value : values) {
        // Only what the wrapped residual filled in: values alone, or a residual without constraints, have no columns.
        if (value.status != BlockStatus::ok) continue;
        if (value.e_theta.cols() == map_.full_size() && value.e_theta.rows() == value.e.size())
            value.e_theta = map_.reduce_columns(value.e_theta);
        if (value.c.size() > 0 && value.c_theta.cols() == map_.full_size() && value.c_theta.rows() == value.c.size())
            value.c_theta = map_.reduce_columns(value.c_theta);
    }
    return values;
}

RefreshReport MappedResidual::update_active_set(ActiveSet& active, const Eigen::VectorXd& theta,
                                                const std::vector<Eigen::VectorXd>& latents,
                                                const Eigen::VectorXd& scales) const {
    if (options_.active) return {};
    const RefreshReport report = inner_->update_active_set(active, map_.expand(theta), latents, scales);
    override_errors(active);
    return report;
}

}  // namespace orbid::estimator
