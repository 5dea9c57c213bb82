#include "estimator/exploration/multi_start.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numeric>
#include <stdexcept>
#include <string>
#include <tuple>

#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>

#include "estimator/estimate/estimate_report.hpp"
#include "estimator/exploration/random_start.hpp"
#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

void check_multi_start(const ResidualFactory& residuals, const MultiStartOptions& options) {
    const auto positive = [](const std::string& name, double value) {
        if (!(value > 0.0)) throw std::invalid_argument(name + " = " + std::to_string(value) + " must be positive");
    };
    positive("starts", options.starts);
    positive("width", options.width);
    positive("kept", options.kept);
    positive("distance", options.distance);
    positive("objective_tolerance", options.objective_tolerance);
    if (options.screening_iterations < 0)
        throw std::invalid_argument("screening_iterations = " + std::to_string(options.screening_iterations) +
                                    " must not be negative");
    if (!residuals) throw std::invalid_argument("multi-start: residuals: a factory is needed");
}

/// Ends that can be compared at all come first.
int grade(EstimateStatus status) {
    if (status == EstimateStatus::converged) return 0;
    if (status == EstimateStatus::singular) return 1;
    if (status == EstimateStatus::interrupted) return 3;
    return status == EstimateStatus::failed ? 4 : 2;
}

class Search {
public:
    Search(const std::vector<FreeParameter>& parameters, const ResidualFactory& residuals,
           const std::vector<DerivedQuantity>& derived, const MultiStartOptions& options)
        : parameters_(parameters), factory_(residuals), derived_(derived), options_(options) {
        const auto count = static_cast<std::size_t>(options.starts);
        runs.resize(count);
        estimates.resize(count);
        Eigen::VectorXd given(static_cast<Eigen::Index>(parameters.size()));
        for (std::size_t i = 0; i < parameters.size(); ++i)
            given[static_cast<Eigen::Index>(i)] = parameters[i].start;
        for (std::size_t s = 0; s < count; ++s) {
            runs[s].start = static_cast<int>(s);
            runs[s].from = s == 0 ? given
                                  : random_start(parameters, options.estimate.joint_priors, options.width,
                                                 RandomStream(options.seed, RandomPurpose::multi_start, s));
            runs[s].theta = runs[s].from;
            runs[s].objective = nan_value;
            runs[s].message = "not started";
        }
    }

    /// Runs the given starts side by side, each from where it stands.
    void run(const std::vector<std::size_t>& which, const EstimateOptions& options);
    /// Starts in the order of their worth.
    [[nodiscard]] std::vector<std::size_t> ranking() const;
    [[nodiscard]] std::vector<Optimum> cluster();
    [[nodiscard]] bool interrupted() const { return options_.estimate.interrupted && options_.estimate.interrupted(); }

    std::vector<StartedRun> runs;
    std::vector<Estimate> estimates;

private:
    [[nodiscard]] bool same(const Estimate& a, const Estimate& b) const;

    const std::vector<FreeParameter>& parameters_;
    const ResidualFactory& factory_;
    const std::vector<DerivedQuantity>& derived_;
    const MultiStartOptions& options_;
};

void Search::run(const std::vector<std::size_t>& which, const EstimateOptions& options) {
    std::mutex door;
    int finished = 0;
    const auto one = [&](std::size_t k) {
        StartedRun& run = runs[which[k]];
        if (interrupted()) {
            run.status = EstimateStatus::interrupted;
            return;
        }
        std::vector<std::unique_ptr<Residual>> owned;
        {
            const std::lock_guard lock(door);
            owned = factory_();
        }
        std::vector<const Residual*> residuals;
        for (const auto& residual : owned)
            residuals.push_back(residual.get());
        std::vector<FreeParameter> parameters = parameters_;
        for (std::size_t i = 0; i < parameters.size(); ++i)
            parameters[i].start = run.theta[static_cast<Eigen::Index>(i)];
        EstimateOptions quiet = options;
        quiet.progress = nullptr;  // made for one estimate, not for several at a time
        quiet.watched = nullptr;
        Estimate& result = estimates[which[k]];
        result = estimate(parameters, residuals, derived_, quiet);
        run.status = result.status;
        run.message = result.message;
        run.evaluations += result.evaluations;
        for (std::size_t i = 0; i < parameters.size(); ++i) {
            run.theta[static_cast<Eigen::Index>(i)] = result.parameters[i].value;
            result.parameters[i].start = run.from[static_cast<Eigen::Index>(i)];
        }
        run.records = 0;
        if (result.status != EstimateStatus::failed) {
            run.objective = result.objective;
            for (const auto& blocks : result.residuals)
                for (const BlockValue& block : blocks)
                    if (block.status == BlockStatus::ok) run.records += static_cast<std::size_t>(block.e.size());
        }
        const std::lock_guard lock(door);
        ++finished;
        if (options_.progress) options_.progress(finished, static_cast<int>(which.size()));
        if (options_.ended) options_.ended(run);
    };
    tbb::parallel_for(std::size_t{0}, which.size(), one, tbb::simple_partitioner{});
}

std::vector<std::size_t> Search::ranking() const {
    std::size_t most = 0;
    bool same_set = true;
    for (const StartedRun& run : runs) {
        if (!std::isfinite(run.objective)) continue;
        same_set = same_set && (most == 0 || most == run.records);
        most = std::max(most, run.records);
    }
    const auto worth = [&](std::size_t s) {
        const StartedRun& run = runs[s];
        const auto records = static_cast<double>(run.records);
        const bool few = records < 0.9 * static_cast<double>(most);
        const double objective = !std::isfinite(run.objective) ? infinity
                                 : same_set                    ? run.objective
                                                               : run.objective / std::max(records, 1.0);
        return std::make_tuple(grade(run.status), run.screened, few, objective, s);
    };
    std::vector<std::size_t> order(runs.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return worth(a) < worth(b); });
    return order;
}

bool Search::same(const Estimate& a, const Estimate& b) const {
    if (!(std::abs(a.objective - b.objective) <= options_.objective_tolerance)) return false;
    for (std::size_t i = 0; i < a.parameters.size(); ++i) {
        const Estimated& one = a.parameters[i];
        const Estimated& other = b.parameters[i];
        if (one.at_bound != other.at_bound) return false;
        // Undetermined: any value will do. At a bound: the same one.
        const double sd = std::isfinite(one.laplace_sd) ? one.laplace_sd : other.laplace_sd;
        if (!std::isfinite(sd)) continue;
        const double rounding = 1e-12 * std::max(std::abs(one.value), std::abs(other.value));
        if (!(std::abs(one.value - other.value) <= options_.distance * sd + rounding)) return false;
    }
    return true;
}

std::vector<Optimum> Search::cluster() {
    std::vector<Optimum> optima;
    std::vector<std::size_t> first;
    for (const std::size_t s : ranking()) {
        StartedRun& run = runs[s];
        if (run.screened || grade(run.status) > 1) continue;
        const auto found = std::find_if(first.begin(), first.end(), [&](std::size_t f) {
            return runs[f].records == run.records && same(estimates[f], estimates[s]);
        });
        run.optimum = static_cast<int>(found - first.begin());
        if (found == first.end()) {
            first.push_back(s);
            optima.push_back({run.objective, run.theta, {}});
        }
        optima[static_cast<std::size_t>(run.optimum)].starts.push_back(run.start);
    }
    for (Optimum& optimum : optima)
        std::sort(optimum.starts.begin(), optimum.starts.end());
    return optima;
}

/// The starts that a short look leaves: the best `kept` of all, and the given one.
std::vector<std::size_t> screened(Search& search, const std::vector<std::size_t>& which,
                                  const MultiStartOptions& options) {
    EstimateOptions look = options.estimate;
    look.maximum_iterations = options.screening_iterations;
    look.maximum_rounds = 1;
    look.verdict = false;
    search.run(which, look);
    // What matters now is how far down they are, not how they ended.
    for (StartedRun& run : search.runs)
        run.screened = run.status != EstimateStatus::failed;
    std::vector<std::size_t> order(which);
    const auto worth = [&](std::size_t s) {
        const double objective = search.runs[s].objective;
        return std::make_tuple(std::isfinite(objective) ? objective : infinity, s);
    };
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return worth(a) < worth(b); });
    order.resize(static_cast<std::size_t>(options.kept));
    // The given start is never dropped.
    if (std::find(order.begin(), order.end(), std::size_t{0}) == order.end()) order.back() = 0;
    std::sort(order.begin(), order.end());
    for (const std::size_t s : order)
        search.runs[s].screened = false;
    return order;
}

}  // namespace

MultiStart multi_start(const std::vector<FreeParameter>& parameters, const ResidualFactory& residuals,
                       const std::vector<DerivedQuantity>& derived, const MultiStartOptions& options) {
    check_multi_start(residuals, options);
    Search search(parameters, residuals, derived, options);
    std::vector<std::size_t> which(search.runs.size());
    std::iota(which.begin(), which.end(), std::size_t{0});
    if (options.screening_iterations > 0 && static_cast<std::size_t>(options.kept) < which.size())
        which = screened(search, which, options);
    search.run(which, options.estimate);

    MultiStart result;
    result.interrupted = std::any_of(search.runs.begin(), search.runs.end(),
                                     [](const StartedRun& run) { return run.status == EstimateStatus::interrupted; });
    result.optima = search.cluster();
    const std::size_t best = search.ranking().front();
    result.runs = search.runs;
    if (std::isfinite(search.runs[best].objective)) {
        result.best_start = search.runs[best].start;
        result.best = std::move(search.estimates[best]);
        if (result.interrupted && result.best.status != EstimateStatus::interrupted)
            result.best.message += "; the search over starts was interrupted";
        return result;
    }
    result.best = std::move(search.estimates.front());
    if (result.best.parameters.empty())
        for (const FreeParameter& parameter : parameters)
            result.best.parameters.push_back(bare_estimate(parameter, parameter.start));
    result.best.status = result.interrupted ? EstimateStatus::interrupted : EstimateStatus::failed;
    result.best.message = "none of " + std::to_string(options.starts) +
                          " starts could be estimated; the given one: " + search.runs.front().message;
    return result;
}

}  // namespace orbid::estimator
