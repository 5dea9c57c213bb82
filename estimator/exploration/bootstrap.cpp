#include "estimator/exploration/bootstrap.hpp"

#include <algorithm>
#include <chrono>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <utility>
#include <variant>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>

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

/// The sets of an estimate, to begin another one from.
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

/// Values and sds of an estimate, in the order of BootstrapReplicate.
void take_values(const Estimate& estimate, BootstrapReplicate& replicate) {
    std::vector<double> values;
    std::vector<double> sds;
    for (const auto* list : {&estimate.parameters, &estimate.derived})
        for (const Estimated& one : *list) {
            values.push_back(one.value);
            sds.push_back(one.sd);
        }
    for (const EstimatedScale& scale : estimate.scales)
        if (scale.estimated) {
            values.push_back(scale.value);
            sds.push_back(scale.uncertainty);
        }
    const auto count = static_cast<Eigen::Index>(values.size());
    replicate.values = Eigen::Map<const Eigen::VectorXd>(values.data(), count);
    replicate.sds = Eigen::Map<const Eigen::VectorXd>(sds.data(), count);
}

/// What all replicates of an estimate share.
class Replication {
public:
    Replication(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                const std::vector<DerivedQuantity>& derived, const EstimateOptions& options, const Estimate& estimate,
                const RecordDraws& draws, std::uint64_t seed)
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

    [[nodiscard]] BootstrapReplicate run(std::size_t number) const {
        auto shifts = draws_.shifts(number);
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

private:
    std::vector<FreeParameter> parameters_;
    const std::vector<const Residual*>& residuals_;
    const std::vector<DerivedQuantity>& derived_;
    EstimateOptions options_;
    const Estimate& estimate_;
    const RecordDraws& draws_;
    std::vector<ActiveSet> sets_;
    std::uint64_t seed_;
};

/// Replicates as they end, in any order.
class Finished {
public:
    Finished(const BootstrapOptions& asked) : asked_(asked), list_(asked.done) {}

    void add(BootstrapReplicate replicate) {
        const std::lock_guard lock(door_);
        list_.push_back(std::move(replicate));
        if (asked_.progress) asked_.progress(list_.size(), asked_.replicates);
        const auto now = Clock::now();
        if (!asked_.keep || std::chrono::duration<double>(now - kept_).count() < asked_.keep_seconds) return;
        asked_.keep(list_);
        kept_ = Clock::now();
    }
    [[nodiscard]] std::vector<BootstrapReplicate> all() && { return std::move(list_); }

private:
    using Clock = std::chrono::steady_clock;
    const BootstrapOptions& asked_;
    std::mutex door_;
    std::vector<BootstrapReplicate> list_;
    Clock::time_point kept_ = Clock::now();
};

}  // namespace

Bootstrap bootstrap(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                    const std::vector<DerivedQuantity>& derived, const EstimateOptions& options,
                    const Estimate& estimate, const BootstrapOptions& asked) {
    if (asked.replicates < least_replicates)
        throw std::invalid_argument(
            fmt::format("replicates = {} must be {} or more: the ends of a 95 % interval would lie beyond all of them",
                        asked.replicates, least_replicates));
    const RecordDraws draws(residuals, estimate, asked.draws);
    const Replication replication(parameters, residuals, derived, options, estimate, draws, asked.draws.seed);
    std::vector<bool> there(asked.replicates, false);
    for (const BootstrapReplicate& replicate : asked.done)
        if (replicate.number < there.size()) there[replicate.number] = true;
    Finished finished(asked);
    const auto interrupted = [&] { return options.interrupted && options.interrupted(); };
    tbb::parallel_for(
        std::size_t{0}, asked.replicates,
        [&](std::size_t number) {
            if (there[number] || interrupted()) return;
            BootstrapReplicate replicate = replication.run(number);
            // One that was cut short is none, and is computed anew.
            if (replicate.status != EstimateStatus::interrupted) finished.add(std::move(replicate));
        },
        tbb::simple_partitioner{});
    Bootstrap result = bootstrap_summary(parameters, estimate, std::move(finished).all(), asked.replicates);
    result.kind = draws.kind();
    result.block = draws.kind() == ErrorDraw::blocks ? draws.longest_block() : 1;
    return result;
}

}  // namespace orbid::estimator
