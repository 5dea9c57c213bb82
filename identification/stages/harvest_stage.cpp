#include "identification/stages/harvest_stage.hpp"

#include <optional>
#include <utility>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "orbits/cycles/model_guided_search.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::identification {

namespace {

/// Sds of the model's free parameters, as far as an estimate knows them all.
std::optional<Eigen::MatrixXd> known_covariance(const estimator::Estimate& estimate,
                                                const models::ParameterBinding& binding) {
    const Eigen::MatrixXd& all = estimate.covariance;
    if (all.rows() != static_cast<Eigen::Index>(estimate.parameters.size())) return std::nullopt;
    const Eigen::MatrixXd own = all(binding.estimated, binding.estimated);
    return own.allFinite() ? std::optional(own) : std::nullopt;
}

}  // namespace

std::string harvest_cycles(StageInput& input, const StageRun& before) {
    const IdentificationProblem& problem = input.problem;
    const MeasuredCycles& measured = problem.measured;
    if (!measured.section || !measured.experiment) return "cycles were not searched for in a series";
    const auto covariance = known_covariance(before.estimate, input.cycle_binding);
    if (!covariance) return "the estimate before leaves a direction undetermined: it points nowhere";
    orbits::ModelGuidedSearchOptions options;
    options.search = measured.options;
    options.search.interrupted = [&observer = input.observer] { return observer.left(); };
    // Known from the first search, they need not be estimated again.
    if (options.search.reading_covariance.size() == 0 &&
        input.search.reading_covariance.rows() == measured.section->dimension())
        options.search.reading_covariance = input.search.reading_covariance;
    options.sensor = problem.experiments[*measured.experiment].sensor;
    options.phase = measured.section_phase;
    options.section = measured.plane;
    options.covariance = *covariance;
    options.free = input.cycle_binding.parameter;
    options.search.progress = [&observer = input.observer](const std::string& part, std::size_t done, std::size_t) {
        observer.at(static_cast<double>(done), part);
    };
    input.observer.begin("more cycles", 3.0, {});
    orbits::ModelGuidedSearch found;
    try {
        const Unstoppable computing(input.observer);
        const Eigen::VectorXd values = input.cycle_binding.values(estimated_theta(before.estimate));
        found = orbits::model_guided_search(*measured.section, *problem.system, values, input.search.cycles, options);
    } catch (const orbits::DataError& error) {
        input.observer.end(error.what());
        return error.what();
    }
    input.observer.end(fmt::format("{} new cycles from {} orbits; {} not visited, {} rejected", found.cycles.size(),
                                   found.candidates, found.not_visited, found.rejected));
    for (const std::string& remark : found.remarks)
        input.observer.remark(remark);
    if (found.cycles.empty()) return "no further cycle was found in the series";
    for (std::size_t c = 0; c < input.search.cycles.size(); ++c)
        input.search.cycles[c].common =
            c < found.known_common.size() ? std::move(found.known_common[c]) : Eigen::MatrixXd();
    // Partners are indices into the list: those of new cycles count from their own beginning.
    const std::size_t known = input.search.cycles.size();
    for (orbits::Cycle& cycle : found.cycles) {
        if (cycle.mirror) *cycle.mirror += known;
        input.search.cycles.push_back(std::move(cycle));
    }
    input.observer.found(input.search);
    return {};
}

}  // namespace orbid::identification
