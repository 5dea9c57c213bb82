#include "estimator/sampling/posterior_sample.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "estimator/problem/problem.hpp"
#include "estimator/problem/tie.hpp"
#include "estimator/sampling/chain_diagnostic.hpp"
#include "estimator/sampling/improper_posterior.hpp"
#include "estimator/sampling/posterior_density.hpp"
#include "estimator/sampling/sandwich_map.hpp"
#include "models/arithmetic/cholesky_factor.hpp"
#include "models/definition/wrong_data.hpp"

namespace orbid::estimator {

namespace {

/// Limits of the verdict: Vehtari et al. (2021), sections 4 and 5.
constexpr double largest_rhat = 1.01;
constexpr double least_effective_size = 400.0;

PosteriorPlace place_of(const Problem& problem, const Estimate& start) {
    PosteriorPlace place = {{}, start.latents, Eigen::VectorXd(static_cast<Eigen::Index>(problem.errors.size()))};
    place.u.resize(static_cast<Eigen::Index>(problem.parameters.size()));
    for (Eigen::Index i = 0; i < place.u.size(); ++i)
        place.u[i] = std::clamp(
            problem.coordinates[static_cast<std::size_t>(i)].at(start.parameters[static_cast<std::size_t>(i)].value),
            problem.lower[i], problem.upper[i]);
    for (const NoiseModel& law : problem.laws) {
        const EstimatedScale& scale = start.scales[static_cast<std::size_t>(law.channels.front())];
        for (Eigen::Index k = 0; k < law.size(); ++k) {
            const ErrorCoordinate& coordinate = law.coordinates[static_cast<std::size_t>(k)];
            double natural = k == 0 ? scale.value : coordinate.start;
            for (const Estimated& shape : scale.shape)
                if (shape.name == coordinate.name) natural = shape.value;
            place.psi[law.first + k] = std::clamp(coordinate.at(natural), coordinate.lower, coordinate.upper);
        }
        if (!law.joint()) continue;
        const auto m = static_cast<Eigen::Index>(law.channels.size());
        Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(m, m);
        for (Eigen::Index j = 0; j < m; ++j) {
            const double sd = start.scales[static_cast<std::size_t>(law.channels[static_cast<std::size_t>(j)])].value;
            covariance(j, j) = sd * sd;
        }
        for (const EstimatedCovariance& estimated : start.covariances)
            if (!estimated.groups.empty() && estimated.groups.front() == scale.group && estimated.value.rows() == m)
                covariance = estimated.value;
        place.psi.segment(law.first, law.size()) = root_coordinates(models::CholeskyFactor(covariance).lower());
    }
    return place;
}

/// What is shown of a place: names and values of the columns of PosteriorSample::draws.
struct Shown {
    const Problem& problem;
    const PosteriorDensity& density;
    const std::vector<DerivedQuantity>& derived;
    const SandwichMap& adjusted;

    void name(PosteriorSample& sample) const {
        for (const FreeParameter& parameter : problem.parameters)
            sample.parameters.push_back({parameter.name, parameter.unit});
        for (const DerivedQuantity& one : derived)
            sample.derived.push_back({one.name, ""});
        for (const NoiseModel& law : problem.laws) {
            if (law.joint()) {
                for (std::size_t j = 0; j < law.channels.size(); ++j)
                    for (std::size_t i = j; i < law.channels.size(); ++i)
                        sample.errors.push_back(
                            {fmt::format("covariance({}, {})", group_of(problem, law.channels[i]).name,
                                         group_of(problem, law.channels[j]).name),
                             ""});
                continue;
            }
            const Group& own = group_of(problem, law.channels.front());
            for (const ErrorCoordinate& coordinate : law.coordinates)
                if (coordinate.estimate)
                    sample.errors.push_back(
                        {own.name + ":" + coordinate.name, coordinate.name == "scale" ? own.unit : ""});
        }
        for (const auto* list : {&sample.parameters, &sample.derived, &sample.errors})
            for (const SampledQuantity& one : *list)
                sample.names.push_back(one.name);
    }

    [[nodiscard]] std::vector<double> values(const Eigen::VectorXd& x) const {
        PosteriorPlace place = density.place(x);
        place.u = adjusted(place.u);
        const Eigen::VectorXd theta = density.natural(place);
        std::vector<double> result(theta.begin(), theta.end());
        for (const DerivedQuantity& one : derived)
            result.push_back(one.value(theta));
        for (const NoiseModel& law : problem.laws) {
            if (!law.joint()) {
                for (std::size_t k = 0; k < law.coordinates.size(); ++k)
                    if (law.coordinates[k].estimate)
                        result.push_back(
                            law.coordinates[k].natural(place.psi[law.first + static_cast<Eigen::Index>(k)]));
                continue;
            }
            const Eigen::MatrixXd triangle = covariance_root(law, place.psi);
            const Eigen::MatrixXd covariance = triangle * triangle.transpose();
            for (Eigen::Index j = 0; j < covariance.cols(); ++j)
                for (Eigen::Index i = j; i < covariance.rows(); ++i)
                    result.push_back(covariance(i, j));
        }
        return result;
    }
};

/// Collects the reasons for distrust while quantities are summed up.
class Verdict {
public:
    void look(const std::string& name, const Eigen::MatrixXd& draws) {
        // A derived quantity may be constant; what does not move has no diagnostics and needs none.
        if (draws.size() > 0 && draws.maxCoeff() == draws.minCoeff() && draws.rows() >= 12) return;
        const double rhat = rank_normalised_rhat(draws);
        const double bulk = bulk_effective_sample_size(draws);
        const double tail = tail_effective_sample_size(draws);
        const double size = std::isnan(bulk) ? bulk : std::isnan(tail) ? tail : std::min(bulk, tail);
        // What cannot be judged is the worst: the first nan stays.
        if (!std::isnan(worst_rhat) && !(rhat <= worst_rhat)) {
            worst_rhat = rhat;
            rhat_name = name;
        }
        if (!std::isnan(least_size) && !(size >= least_size)) {
            least_size = size;
            size_name = name;
        }
    }

    double worst_rhat = 0.0;
    double least_size = std::numeric_limits<double>::infinity();
    std::string rhat_name;
    std::string size_name;
};

void sum_up(SampledQuantity& quantity, const Eigen::MatrixXd& draws) {
    quantity.mean = draws.mean();
    quantity.sd = std::sqrt((draws.array() - quantity.mean).square().sum() / static_cast<double>(draws.size() - 1));
    quantity.mean_error = mean_standard_error(draws);
    quantity.sd_error = sd_standard_error(draws);
    for (std::size_t p = 0; p < sample_probabilities.size(); ++p) {
        quantity.quantiles[p] = sample_quantile(draws, sample_probabilities[p]);
        quantity.quantile_errors[p] = quantile_standard_error(draws, sample_probabilities[p]);
    }
    quantity.rhat = rank_normalised_rhat(draws);
    quantity.bulk_size = bulk_effective_sample_size(draws);
    quantity.tail_size = tail_effective_sample_size(draws);
}

double energy_mixing(const Eigen::VectorXd& energy) {
    const Eigen::Index n = energy.size();
    if (n < 2) return std::numeric_limits<double>::quiet_NaN();
    return (energy.tail(n - 1) - energy.head(n - 1)).squaredNorm() / (energy.array() - energy.mean()).square().sum();
}

void judge(PosteriorSample& sample, const Verdict& verdict) {
    sample.worst_rhat = verdict.worst_rhat;
    sample.least_size = verdict.least_size;
    int divergences = 0;
    int saturated = 0;
    for (const SampledChain& chain : sample.chains) {
        divergences += chain.divergences;
        saturated += chain.saturated;
    }
    std::vector<std::string> reasons;
    if (!(verdict.worst_rhat < largest_rhat))
        reasons.push_back(
            fmt::format("the chains disagree about {} (R-hat {:.3f})", verdict.rhat_name, verdict.worst_rhat));
    if (!(verdict.least_size > least_effective_size))
        reasons.push_back(
            fmt::format("{} has an effective sample size of {:.0f} only", verdict.size_name, verdict.least_size));
    if (divergences > 0)
        reasons.push_back(
            fmt::format("{} trajectories diverged: regions may be missing, try a higher acceptance", divergences));
    sample.trusted = reasons.empty();
    for (const std::string& reason : reasons)
        sample.distrust += (sample.distrust.empty() ? "" : "; ") + reason;
    sample.message = sample.trusted ? "the chains agree" : sample.distrust;
    if (saturated > 0)
        sample.message +=
            fmt::format("; {} trajectories reached the maximum depth: longer ones would mix faster", saturated);
}

/// One coordinate of the density, shape (count, chains).
Eigen::MatrixXd coordinate_draws(const NutsResult& result, Eigen::Index coordinate, Eigen::Index count) {
    Eigen::MatrixXd draws(count, static_cast<Eigen::Index>(result.chains.size()));
    for (Eigen::Index c = 0; c < draws.cols(); ++c)
        draws.col(c) = result.chains[static_cast<std::size_t>(c)].draws.row(coordinate).head(count).transpose();
    return draws;
}

/// The first draws of all chains in natural units, and what the chains say of themselves.
void take_draws(const NutsResult& result, const Shown& shown, Eigen::Index count, PosteriorSample& sample) {
    const auto columns = static_cast<Eigen::Index>(sample.names.size());
    for (const NutsChain& chain : result.chains) {
        Eigen::MatrixXd values(count, columns);
        for (Eigen::Index i = 0; i < count; ++i) {
            const std::vector<double> row = shown.values(chain.draws.col(i));
            values.row(i) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), columns);
        }
        sample.draws.push_back(std::move(values));
        sample.potential.push_back(chain.potential.head(count));
        sample.chains.push_back({chain.step, chain.acceptance, chain.divergences, chain.saturated,
                                 energy_mixing(chain.energy), chain.warm_up_evaluations, chain.evaluations});
    }
}

/// Parameters, derived quantities and error parameters from all draws.
void sum_up_columns(PosteriorSample& sample, Verdict& verdict) {
    Eigen::Index column = 0;
    for (auto* list : {&sample.parameters, &sample.derived, &sample.errors})
        for (SampledQuantity& quantity : *list) {
            Eigen::MatrixXd draws(sample.draws.front().rows(), static_cast<Eigen::Index>(sample.draws.size()));
            for (Eigen::Index c = 0; c < draws.cols(); ++c)
                draws.col(c) = sample.draws[static_cast<std::size_t>(c)].col(column);
            sum_up(quantity, draws);
            verdict.look(quantity.name, draws);
            ++column;
        }
}

/// Means and sds of the latent states, which are coordinates of the density after the parameters.
void sum_up_latents(const Problem& problem, const BlockSet& set, const NutsResult& result, Eigen::Index count,
                    PosteriorSample& sample, Verdict& verdict) {
    auto coordinate = static_cast<Eigen::Index>(problem.parameters.size());
    for (const ActiveBlock& block : set.blocks) {
        Eigen::VectorXd mean(block.latents);
        Eigen::VectorXd sd(block.latents);
        for (Eigen::Index i = 0; i < block.latents; ++i) {
            const Eigen::MatrixXd draws = coordinate_draws(result, coordinate++, count);
            mean[i] = draws.mean();
            sd[i] = std::sqrt((draws.array() - mean[i]).square().sum() / static_cast<double>(draws.size() - 1));
            verdict.look(fmt::format("latent state {} of block \"{}\"", i, label_of(set, block)), draws);
        }
        sample.latents[block.residual][block.block] = mean;
        sample.latent_sds[block.residual][block.block] = sd;
    }
}

}  // namespace

PosteriorSample sample_posterior(const std::vector<FreeParameter>& parameters,
                                 const std::vector<const Residual*>& residuals,
                                 const std::vector<DerivedQuantity>& derived, const EstimateOptions& estimate_options,
                                 const Estimate& start, const SampleOptions& options) {
    validate(options);
    if (start.active.size() != residuals.size())
        throw std::invalid_argument("posterior sample: the estimate does not belong to these parameters and residuals");
    if (std::any_of(parameters.begin(), parameters.end(), is_held)) {
        const TiedProblem free = resolve_ties(parameters, residuals, estimate_options.joint_priors);
        return sample_posterior(free.parameters, free.residuals, free.derived(derived), estimate_options,
                                free.reduced(start), options);
    }
    const Problem problem = set_up(parameters, residuals, start.active, derived, estimate_options);
    refuse_unfit(problem, start);
    const BlockSet set = freeze(residuals, start.active, problem.channels, problem.laws);
    refuse_improper(problem, set, start);
    const PosteriorDensity density(problem, set, place_of(problem, start));

    PosteriorSample sample;
    const SandwichMap adjusted(problem, start, density.parameter_covariance());
    const Shown shown{problem, density, derived, adjusted};
    shown.name(sample);
    if (density.dimension() == 0 || density.covariance().size() == 0) {
        if (parameters.empty() && set.latents == 0 && sample.errors.empty())
            throw models::DataError("posterior sample: nothing is estimated");
        sample.message = "the posterior cannot be evaluated around the estimate";
        return sample;
    }
    const NutsResult result = estimator::sample(
        [&density](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) { return density(x, gradient); },
        density.start(), density.covariance(), options);

    sample.status = result.interrupted ? SampleStatus::interrupted : SampleStatus::complete;
    Eigen::Index count = options.draws;
    for (const NutsChain& chain : result.chains)
        count = std::min(count, chain.draws.cols());
    take_draws(result, shown, count, sample);
    for (const ActiveSet& active : set.active) {
        sample.latents.emplace_back(active.layout.size());
        sample.latent_sds.emplace_back(active.layout.size());
    }
    if (count < 2) {
        sample.message = sample.distrust = "interrupted before there were draws";
        return sample;
    }
    Verdict verdict;
    sum_up_columns(sample, verdict);
    sum_up_latents(problem, set, result, count, sample, verdict);
    Eigen::MatrixXd potential(count, static_cast<Eigen::Index>(result.chains.size()));
    for (Eigen::Index c = 0; c < potential.cols(); ++c)
        potential.col(c) = sample.potential[static_cast<std::size_t>(c)];
    verdict.look("the density", potential);
    judge(sample, verdict);
    if (adjusted.moves()) sample.message += "; draws of the parameters are moved to the covariance of the table";
    return sample;
}

}  // namespace orbid::estimator
