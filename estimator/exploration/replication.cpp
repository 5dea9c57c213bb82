#include "estimator/exploration/replication.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <variant>

#include "estimator/exploration/redrawn_residual.hpp"
#include "estimator/interface/not_finite.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

/// Steps are taken until they are this many posterior sds: far below what replicates scatter.
constexpr double replicate_tolerance = 1e-4;

/// The parameter of an error law besides its scale, begun at what was estimated.
void begin_shape(ErrorDistribution& distribution, const EstimatedScale& scale) {
    if (scale.shape.empty()) return;
    const double value = scale.shape.front().value;
    if (auto* student = std::get_if<StudentErrors>(&distribution)) student->dof.value = value;
    if (auto* relative = std::get_if<RelativeErrors>(&distribution)) relative->relative.value = value;
    if (auto* chain = std::get_if<AutoregressiveErrors>(&distribution)) chain->correlation.value = value;
}

double estimated_value(const Estimate& estimate, const std::string& name) {
    const auto found = std::find_if(estimate.parameters.begin(), estimate.parameters.end(),
                                    [&](const Estimated& one) { return one.name == name; });
    return found == estimate.parameters.end() ? nan_value : found->value;
}

/// Means of priors are records: others are drawn.
void redraw_priors(const Estimate& estimate, RandomStream random, std::vector<FreeParameter>& parameters,
                   std::vector<JointNormalPrior>& joint) {
    for (FreeParameter& parameter : parameters) {
        const double value = estimated_value(estimate, parameter.name);
        if (auto* normal = std::get_if<NormalPrior>(&parameter.prior))
            normal->mean = value + normal->sd * random.normal();
        if (auto* logarithmic = std::get_if<LogNormalPrior>(&parameter.prior))
            logarithmic->median = value * std::exp(logarithmic->log_sd * random.normal());
    }
    for (JointNormalPrior& prior : joint) {
        const Eigen::MatrixXd root = models::CholeskyFactor(prior.covariance).lower();
        Eigen::VectorXd normal(prior.mean.size());
        for (double& one : normal)
            one = random.normal();
        for (std::size_t i = 0; i < prior.names.size(); ++i)
            prior.mean[static_cast<Eigen::Index>(i)] = estimated_value(estimate, prior.names[i]);
        prior.mean += root.triangularView<Eigen::Lower>() * normal;
    }
}

}  // namespace

std::vector<ActiveSet> ended_sets(const Estimate& estimate) {
    std::vector<ActiveSet> sets = estimate.active;
    std::size_t channel = 0;
    for (std::size_t r = 0; r < sets.size(); ++r) {
        sets[r].latents = estimate.latents[r];
        for (Group& group : sets[r].groups) {
            const EstimatedScale& scale = estimate.scales[channel++];
            if (group.scale.estimate && scale.value > 0.0) group.scale.value = scale.value;
            begin_shape(group.distribution, scale);
        }
    }
    return sets;
}

Replication::Replication(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                         const std::vector<DerivedQuantity>& derived, const EstimateOptions& options,
                         const Estimate& estimate, const RecordDraws& draws, std::uint64_t seed)
    : parameters_(parameters),
      residuals_(residuals),
      derived_(derived),
      options_(options),
      estimate_(estimate),
      draws_(draws),
      sets_(ended_sets(estimate)),
      seed_(seed) {
    options_.verdict = false;
    options_.full_hessian = false;
    options_.progress = nullptr;
    options_.watched = nullptr;
    options_.step_tolerance = std::max(options_.step_tolerance, replicate_tolerance);
    for (FreeParameter& parameter : parameters_)
        if (parameter.tied_to.empty()) parameter.start = estimated_value(estimate, parameter.name);
}

BootstrapReplicate Replication::run(std::size_t number, Mirror mirror) const {
    auto shifts = draws_.shifts(number, mirror);
    std::vector<std::unique_ptr<RedrawnResidual>> owned;
    std::vector<const Residual*> redrawn;
    for (std::size_t r = 0; r < residuals_.size(); ++r) {
        owned.push_back(std::make_unique<RedrawnResidual>(*residuals_[r], sets_[r], std::move(shifts[r])));
        redrawn.push_back(owned.back().get());
    }
    std::vector<FreeParameter> parameters = parameters_;
    EstimateOptions options = options_;
    // Below all streams of records, whose residuals and groups are counted from 0.
    constexpr std::uint64_t of_priors = ~std::uint64_t{0};
    if (!draws_.added())
        redraw_priors(estimate_, {seed_, RandomPurpose::bootstrap, of_priors - number}, parameters,
                      options.joint_priors);
    const Estimate found = estimator::estimate(parameters, redrawn, derived_, options);
    BootstrapReplicate replicate;
    replicate.number = number;
    replicate.status = found.status;
    replicate.message = found.message;
    replicate.evaluations = found.evaluations;
    if (found.status != EstimateStatus::failed) take_values(found, replicate);
    return replicate;
}

/// Values and sds in the order of BootstrapReplicate.
void Replication::take_values(const Estimate& found, BootstrapReplicate& replicate) const {
    std::vector<double> values;
    std::vector<double> sds;
    const auto take = [&](double value, double sd) {
        values.push_back(value);
        sds.push_back(sd);
    };
    Eigen::VectorXd theta(static_cast<Eigen::Index>(found.parameters.size()));
    bool moved = false;
    for (std::size_t i = 0; i < found.parameters.size(); ++i) {
        const double bias = estimate_.parameters[i].bias;
        moved = moved || bias != 0.0;
        theta[static_cast<Eigen::Index>(i)] = found.parameters[i].value - bias;
        take(found.parameters[i].value - bias, found.parameters[i].sd);
    }
    for (std::size_t i = 0; i < found.derived.size(); ++i)
        take(moved ? derived_[i].value(theta) : found.derived[i].value, found.derived[i].sd);
    for (const EstimatedScale& scale : found.scales)
        if (scale.estimated) take(scale.value, scale.uncertainty);
    const auto count = static_cast<Eigen::Index>(values.size());
    replicate.values = Eigen::Map<const Eigen::VectorXd>(values.data(), count);
    replicate.sds = Eigen::Map<const Eigen::VectorXd>(sds.data(), count);
}

}  // namespace orbid::estimator
