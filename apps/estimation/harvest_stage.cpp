#include "apps/estimation/harvest_stage.hpp"

#include <optional>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "apps/estimation/estimated_values.hpp"
#include "apps/results/cycle_file.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/workspace.hpp"
#include "orbits/cycles/model_guided_search.hpp"

namespace orbid::apps {

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

void store_harvest(const StageInput& input) {
    input.work.folder.store(
        "harvested_cycles.json",
        cycles_text({cycle_file_head(input.work.job,
                                     stage_fingerprint(input.work.document, {"/model", "/seed", "/section", "/flow",
                                                                             "/data", "/orbits", "/estimate"})),
                     input.search}));
}

std::string harvest_cycles(StageInput& input, const StageRun& before) {
    const Job& job = input.work.job;
    if (input.section == nullptr) return "cycles were not searched for in a series";
    const auto covariance = known_covariance(before.estimate, input.cycle_binding);
    if (!covariance) return "the estimate before leaves a direction undetermined: it points nowhere";
    orbits::ModelGuidedSearchOptions options;
    options.search = input.section->options;
    options.search.interrupted = input.work.asking();
    // Known from the first search, they need not be estimated again.
    if (options.search.reading_covariance.size() == 0 &&
        input.search.reading_covariance.rows() == input.section->series().dimension())
        options.search.reading_covariance = input.search.reading_covariance;
    options.sensor = job.data[job.orbits->data].sensor;
    options.phase = job.section_phase;
    options.covariance = *covariance;
    options.free = input.cycle_binding.parameter;
    input.work.progress.begin("more cycles");
    orbits::ModelGuidedSearch found;
    try {
        const RunStop::AtOnce leaving(input.work.stop);
        const Eigen::VectorXd values = input.cycle_binding.values(estimated_theta(before.estimate));
        found = orbits::model_guided_search(input.section->series(), *job.model.system, values, input.search.cycles,
                                            options);
    } catch (const std::invalid_argument& error) {
        input.work.progress.end(error.what());
        return error.what();
    }
    input.work.progress.end(fmt::format("{} new cycles from {} orbits; {} not visited, {} rejected",
                                        found.cycles.size(), found.candidates, found.not_visited, found.rejected));
    for (const std::string& remark : found.remarks)
        input.work.progress.say(remark);
    if (found.cycles.empty()) return "no further cycle was found in the series";
    // Partners are indices into the list: those of new cycles count from their own beginning.
    const std::size_t known = input.search.cycles.size();
    for (orbits::Cycle& cycle : found.cycles) {
        if (cycle.mirror) *cycle.mirror += known;
        input.search.cycles.push_back(std::move(cycle));
    }
    store_harvest(input);
    return {};
}

}  // namespace orbid::apps
