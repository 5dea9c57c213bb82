#include "estimator/sampling/posterior_sample.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include "estimator/problem/problem_setup.hpp"
#include "estimator/sampling/chain_diagnostic.hpp"
#include "estimator/sampling/improper_posterior.hpp"
#include "estimator/sampling/posterior_density.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

/// Limits of the verdict: Vehtari et al. (2021), sections 4 and 5.
constexpr double largest_rhat = 1.01;
constexpr double least_effective_size = 400.0;

[[noreturn]] void refuse_options(const std::string& what) {
    throw std::invalid_argument("posterior sample: " + what);
}

void check_estimate(const Problem& problem, const Estimate& start) {
    // A singular estimate may still have a proper posterior: see refuse_improper().
    if (start.status != EstimateStatus::converged && start.status != EstimateStatus::singular)
        refuse_options(
            fmt::format("the estimate must have converged, its status is {}: {}", name(start.status), start.message));
    bool fits = start.parameters.size() == problem.parameters.size() &&
                start.scales.size() == problem.channels.size() && start.latents.size() == problem.residuals.size();
    for (std::size_t i = 0; fits && i < problem.parameters.size(); ++i)
        fits = start.parameters[i].name == problem.parameters[i].name;
    for (std::size_t r = 0; fits && r < problem.residuals.size(); ++r) {
        const auto& layout = problem.residuals[r]->layout();
        fits = start.latents[r].size() == layout.size();
        for (std::size_t b = 0; fits && b < layout.size(); ++b)
            fits = !layout[b].active || start.latents[r][b].size() == layout[b].latents;
    }
    if (!fits) refuse_options("the estimate does not belong to these parameters and residuals");
    for (const Residual* residual : problem.residuals)
        for (const BlockLayout& block : residual->layout())
            if (block.active && block.constraints > 0)
                refuse_options(
                    fmt::format("block \"{}\" has equality constraints, on which no density can be walked; give its "
                                "matching errors a small sd instead",
                                block.label));
}

PosteriorPlace place_of(const Problem& problem, const Estimate& start) {
    PosteriorPlace place = {{}, start.latents, Eigen::VectorXd(static_cast<Eigen::Index>(problem.errors.size()))};
    place.u.resize(static_cast<Eigen::Index>(problem.parameters.size()));
    for (Eigen::Index i = 0; i < place.u.size(); ++i)
        place.u[i] = std::clamp(
            problem.coordinates[static_cast<std::size_t>(i)].at(start.parameters[static_cast<std::size_t>(i)].value),
            problem.lower[i], problem.upper[i]);
    for (const NoiseModel& law : problem.laws) {
        const EstimatedScale& scale = start.scales[static_cast<std::size_t>(law.channels.front())];
        const auto size = static_cast<Eigen::Index>(law.coordinates.size());
        for (Eigen::Index k = 0; k < size; ++k) {
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
        const Eigen::MatrixXd triangle = models::CholeskyFactor(covariance).lower();
        Eigen::Index k = law.first;
        for (Eigen::Index j = 0; j < m; ++j)
            for (Eigen::Index i = j; i < m; ++i, ++k)
                place.psi[k] = i == j ? std::log(triangle(i, j)) : triangle(i, j);
    }
    return place;
}

/// What is shown of a place: names and values of the columns of PosteriorSample::draws.
class Shown {
public:
    Shown(const Problem& problem, const PosteriorDensity& density, const std::vector<DerivedQuantity>& derived)
        : problem_(problem), density_(density), derived_(derived) {}

    void name(PosteriorSample& sample) const {
        const auto quantity = [](std::string label, std::string unit) {
            SampledQuantity result;
            result.name = std::move(label);
            result.unit = std::move(unit);
            return result;
        };
        for (const FreeParameter& parameter : problem_.parameters)
            sample.parameters.push_back(quantity(parameter.name, parameter.unit));
        for (const DerivedQuantity& one : derived_)
            sample.derived.push_back(quantity(one.name, ""));
        for (const NoiseModel& law : problem_.laws) {
            if (law.joint()) {
                for (std::size_t j = 0; j < law.channels.size(); ++j)
                    for (std::size_t i = j; i < law.channels.size(); ++i)
                        sample.errors.push_back(quantity(
                            fmt::format("covariance({}, {})", group(law.channels[i]).name, group(law.channels[j]).name),
                            ""));
                continue;
            }
            const Group& own = group(law.channels.front());
            for (const ErrorCoordinate& coordinate : law.coordinates)
                if (coordinate.estimate)
                    sample.errors.push_back(
                        quantity(own.name + ":" + coordinate.name, coordinate.name == "scale" ? own.unit : ""));
        }
        for (const auto* list : {&sample.parameters, &sample.derived, &sample.errors})
            for (const SampledQuantity& one : *list)
                sample.names.push_back(one.name);
    }

    [[nodiscard]] std::vector<double> values(const Eigen::VectorXd& x) const {
        const PosteriorPlace place = density_.place(x);
        const Eigen::VectorXd theta = density_.natural(place);
        std::vector<double> result(theta.begin(), theta.end());
        for (const DerivedQuantity& one : derived_)
            result.push_back(one.value(theta));
        for (const NoiseModel& law : problem_.laws) {
            const Eigen::VectorXd psi = place.psi.segment(law.first, static_cast<Eigen::Index>(law.coordinates.size()));
            if (!law.joint()) {
                for (std::size_t k = 0; k < law.coordinates.size(); ++k)
                    if (law.coordinates[k].estimate)
                        result.push_back(law.coordinates[k].natural(psi[static_cast<Eigen::Index>(k)]));
                continue;
            }
            const auto m = static_cast<Eigen::Index>(law.channels.size());
            Eigen::MatrixXd triangle = Eigen::MatrixXd::Zero(m, m);
            Eigen::Index k = 0;
            for (Eigen::Index j = 0; j < m; ++j)
                for (Eigen::Index i = j; i < m; ++i, ++k)
                    triangle(i, j) = i == j ? std::exp(psi[k]) : psi[k];
            const Eigen::MatrixXd covariance = triangle * triangle.transpose();
            for (Eigen::Index j = 0; j < m; ++j)
                for (Eigen::Index i = j; i < m; ++i)
                    result.push_back(covariance(i, j));
        }
        return result;
    }

private:
    [[nodiscard]] const Group& group(int channel) const {
        const Channel& place = problem_.channels[static_cast<std::size_t>(channel)];
        return problem_.residuals[place.residual]->groups()[static_cast<std::size_t>(place.group)];
    }

    const Problem& problem_;
    const PosteriorDensity& density_;
    const std::vector<DerivedQuantity>& derived_;
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

}  // namespace

PosteriorSample sample_posterior(const std::vector<FreeParameter>& parameters, const std::vector<Residual*>& residuals,
                                 const std::vector<DerivedQuantity>& derived, const EstimateOptions& estimate_options,
                                 const Estimate& start, const SampleOptions& options) {
    validate(options);
    const Problem problem = set_up(parameters, residuals, derived, estimate_options);
    check_estimate(problem, start);
    const BlockSet set = freeze(residuals, problem.channels, problem.laws);
    refuse_improper(problem, set, start);
    const PosteriorDensity density(problem, set, place_of(problem, start));

    PosteriorSample sample;
    const Shown shown(problem, density, derived);
    shown.name(sample);
    if (density.dimension() == 0 || density.covariance().size() == 0) {
        if (parameters.empty() && set.latents == 0 && sample.errors.empty()) refuse_options("nothing is estimated");
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
    const auto chains = static_cast<Eigen::Index>(result.chains.size());
    const auto columns = static_cast<Eigen::Index>(sample.names.size());
    Eigen::MatrixXd potential(count, chains);
    std::vector<Eigen::MatrixXd> latent(static_cast<std::size_t>(set.latents), Eigen::MatrixXd(count, chains));
    for (Eigen::Index c = 0; c < chains; ++c) {
        const NutsChain& chain = result.chains[static_cast<std::size_t>(c)];
        Eigen::MatrixXd values(count, columns);
        for (Eigen::Index i = 0; i < count; ++i) {
            const std::vector<double> row = shown.values(chain.draws.col(i));
            values.row(i) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), columns);
            for (Eigen::Index k = 0; k < set.latents; ++k)
                latent[static_cast<std::size_t>(k)](i, c) =
                    chain.draws(static_cast<Eigen::Index>(problem.parameters.size()) + k, i);
        }
        sample.draws.push_back(std::move(values));
        sample.potential.push_back(chain.potential.head(count));
        potential.col(c) = sample.potential.back();
        sample.chains.push_back({chain.step, chain.acceptance, chain.divergences, chain.saturated,
                                 energy_mixing(chain.energy), chain.warm_up_evaluations, chain.evaluations});
    }
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        sample.latents.emplace_back(residuals[r]->layout().size());
        sample.latent_sds.emplace_back(residuals[r]->layout().size());
    }
    if (count < 2) {
        sample.message = sample.distrust = "interrupted before there were draws";
        return sample;
    }
    Verdict verdict;
    Eigen::Index column = 0;
    for (auto* list : {&sample.parameters, &sample.derived, &sample.errors})
        for (SampledQuantity& quantity : *list) {
            Eigen::MatrixXd draws(count, chains);
            for (Eigen::Index c = 0; c < chains; ++c)
                draws.col(c) = sample.draws[static_cast<std::size_t>(c)].col(column);
            sum_up(quantity, draws);
            verdict.look(quantity.name, draws);
            ++column;
        }
    std::size_t k = 0;
    for (const ActiveBlock& block : set.blocks) {
        Eigen::VectorXd mean(block.latents);
        Eigen::VectorXd sd(block.latents);
        for (Eigen::Index i = 0; i < block.latents; ++i, ++k) {
            mean[i] = latent[k].mean();
            sd[i] = std::sqrt((latent[k].array() - mean[i]).square().sum() / static_cast<double>(count * chains - 1));
            verdict.look(fmt::format("latent state {} of block \"{}\"", i,
                                     residuals[block.residual]->layout()[block.block].label),
                         latent[k]);
        }
        sample.latents[block.residual][block.block] = mean;
        sample.latent_sds[block.residual][block.block] = sd;
    }
    verdict.look("the density", potential);
    judge(sample, verdict);
    return sample;
}

}  // namespace orbid::estimator
