#include "identification/stages/several_starts.hpp"

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "estimator/exploration/bias.hpp"
#include "estimator/exploration/multi_start.hpp"
#include "identification/stages/noise_estimate.hpp"
#include "identification/starts/link_repair.hpp"
#include "identification/starts/series_start.hpp"

namespace orbid::identification {

void search_starts(StageInput& input, const ProblemResiduals& residuals,
                   std::vector<estimator::FreeParameter>& parameters) {
    estimator::MultiStartOptions search;
    search.starts = static_cast<int>(input.options.starts);
    search.seed = input.options.start_seed;
    search.estimate = input.estimate;
    search.estimate.progress = {};
    search.estimate.watched = {};
    search.estimate.verdict = false;
    input.observer.begin("starts", static_cast<double>(input.options.starts), "starts");
    estimator::StartedRun best;
    search.progress = [&](int finished, int) {
        input.observer.at(finished, std::isfinite(best.objective) && best.theta.size() > 0
                                        ? fmt::format("best objective {:.6g}", best.objective)
                                        : std::string());
    };
    search.ended = [&](const estimator::StartedRun& run) {
        const bool first = best.theta.size() == 0;
        if (!std::isfinite(run.objective) || (!first && run.objective >= best.objective)) return;
        best = run;
        input.observer.reached(best.theta, best.objective);
    };
    const auto found = estimator::multi_start(
        parameters, [&] { return residuals.copies(); }, input.setup.derived, search);
    input.starts->optima = found.optima;
    input.starts->runs = found.runs;
    input.observer.end(fmt::format("{} optima from {} starts", found.optima.size(), found.runs.size()));
    if (found.best_start < 0 || found.best.parameters.size() != parameters.size()) return;
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = found.best.parameters[i].value;
}

SeriesStart searched_series(StageInput& input, const std::vector<estimator::FreeParameter>& parameters) {
    SeriesSearch search;
    search.estimate = input.estimate;
    search.signs = input.signs;
    search.log = [&](const std::string& line) { input.observer.detail(line); };
    search.remark = [&](const std::string& line) { input.observer.remark(line); };
    search.watched = [&](const std::string& name, const estimator::StepReport& report) {
        input.observer.step(name, report);
    };
    search.reached = [&](const Eigen::VectorXd& theta) {
        if (input.kept) input.observer.reached(theta, std::numeric_limits<double>::quiet_NaN());
    };
    input.observer.within("states at the nodes");
    return search_series_start(input.problem, input.options, input.setup, parameters, search);
}

namespace {

/// Records drawn anew for the bias of an estimate: two pairs tell it to a tenth of a sd.
constexpr std::size_t bias_pairs = 2;

/// Whether courses on sections fold within the errors of their readings, which gives parameters a bias, and leaves
/// links on wrong branches.
bool any_folds(const ProblemResiduals& residuals, const estimator::Estimate& estimate) {
    for (std::size_t i = 0; i < residuals.shooting.size() && !estimate.active.empty(); ++i)
        if (residuals.shooting[i]->folds(estimate.active[residuals.first_shooting() + i])) return true;
    return false;
}

}  // namespace

estimator::Estimate affordable_estimate(const StageInput& input, const SeriesStart& start,
                                        const std::vector<estimator::FreeParameter>& parameters,
                                        const ProblemResiduals& residuals, estimator::EstimateOptions options) {
    bool spent = false;
    const auto interrupted = options.interrupted;
    if (start.affordable > 0)
        options.interrupted = [&] {
            std::uint64_t work = 0;
            for (const auto& one : residuals.shooting)
                work += one->work();
            spent = work > start.affordable;
            return spent || (interrupted && interrupted());
        };
    estimator::Estimate estimate = has_process_noise(residuals)
                                       ? estimate_with_noise(parameters, residuals, input.setup.derived, options)
                                       : estimator::estimate(parameters, residuals.all(), input.setup.derived, options);
    options.interrupted = interrupted;  // what it costs is known, and the limit above is not for several threads
    if (any_folds(residuals, estimate))
        estimate = with_mended_links(input.problem, input.setup, parameters, residuals, options, std::move(estimate),
                                     [&](const std::string& line) { input.observer.detail(line); });
    if (spent && estimate.status == estimator::EstimateStatus::interrupted) {
        estimate.status = estimator::EstimateStatus::iteration_limit;
        estimate.message = "given up: no start explains the readings, and more steps would cost too much";
    }
    return estimate;
}

estimator::Estimate less_its_bias(const StageInput& input, const std::vector<estimator::FreeParameter>& parameters,
                                  const ProblemResiduals& residuals, const estimator::EstimateOptions& options,
                                  estimator::Estimate estimate) {
    if (!any_folds(residuals, estimate)) return estimate;
    return estimator::unbiased(parameters, residuals.all(), input.setup.derived, options, estimate, bias_pairs,
                               {estimator::ErrorDraw::parametric, input.options.seed, false});
}

}  // namespace orbid::identification
