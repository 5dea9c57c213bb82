#include "apps/job/evaluated_model.hpp"

#include <system_error>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/flow_stepper.hpp"
#include "apps/job/model_plugin.hpp"
#include "apps/job/periodic_job.hpp"
#include "models/equations/interpreted_kernel.hpp"
#include "models/system/kernel_system.hpp"

namespace orbid::apps {

namespace {

// A model of two to four equations takes ten to twenty seconds to compile; interpreted it takes about three times as
// long as compiled.
constexpr double worth_compiling_s = 30.0;

/// Rows that an experiment will have, to an order of magnitude.
double rows(const DataJob& data) {
    if (data.simulation) {
        const SimulationJob& simulation = *data.simulation;
        return simulation.sampling == orbits::Series::Sampling::section
                   ? static_cast<double>(simulation.sections)
                   : static_cast<double>(simulation.count * simulation.trajectories);
    }
    // A row of a table takes some thirty bytes.
    return data.file->bytes() / 30.0;
}

/// What an evaluation with derivatives costs, in those of a model of two coordinates, four parameters and some 25
/// operations: formulas and the directions in which they are derived both multiply it.
double derivatives_cost(const models::Equations& equations) {
    const double directions = static_cast<double>(equations.coordinates().size() + equations.parameters().size());
    constexpr double typical = 25.0 / 14.0;  // operations, over those of Lorenz's equations
    return equations.evaluation_cost() / typical * (directions / 6.0);
}

/// Seconds that the job's flows would take interpreted, to an order of magnitude, from the job only: the decision to
/// compile must not depend on the machine, its load or its cache.
double interpreted_seconds(const Job& job) {
    // Orders of magnitude on a machine of 2020: a period of a forced model of two coordinates in an ensemble takes 5
    // microseconds, a sample or a link of a series with derivatives thirty.
    constexpr double period_s = 5e-6;
    const double derivatives_s = 3e-5 * derivatives_cost(*job.model.equations);
    double seconds = 0.0, fitted = 0.0;
    for (const DataJob& data : job.data) {
        fitted += rows(data);
        if (!data.simulation) continue;
        seconds += period_s * (rows(data) + static_cast<double>(data.simulation->trajectories) *
                                                static_cast<double>(data.simulation->transient));
    }
    // Searches and branches compute some ten thousand flows with derivatives, of several periods each.
    if (job.periodic && (job.periodic->search || job.periodic->continuation)) seconds += 30000.0 * derivatives_s;
    if (job.estimate) {
        // Iterations of an estimate, each once through the data; of all starts and samples.
        constexpr double iterations = 50.0;
        double repeated = iterations;
        if (job.estimate->series || job.estimate->waveform) seconds += repeated * fitted * derivatives_s;
        if (job.estimate->cycles) seconds += repeated * 2000.0 * derivatives_s;
        // A branch is followed at the start and wherever orbits are sought again.
        if (job.estimate->branch) seconds += repeated * 25000.0 * derivatives_s;
    }
    return seconds;
}

bool wants_compiled(const Job& job) {
    if (job.model.compile != CompileChoice::automatic) return job.model.compile == CompileChoice::always;
    return interpreted_seconds(job) > worth_compiling_s;
}

}  // namespace

std::shared_ptr<const models::System> system_of(const std::shared_ptr<const models::Equations>& equations,
                                                bool& compiled, std::string& why) {
    compiled = false;
    std::string beyond;
    if (const auto kernel = models::interpreted_kernel(equations, beyond))
        return std::make_shared<models::KernelSystem>(kernel);
    const CompiledModel model = compiled_model(equations);
    if (model.kernel) {
        compiled = true;
        return std::make_shared<models::KernelSystem>(model.kernel);
    }
    why = fmt::format("{} need compiled code: {}", beyond, model.why);
    return nullptr;
}

std::string settle_evaluation(Job& job) {
    if (!job.model.equations) return {};
    if (job.model.compiled) return "equations compiled: they cannot be interpreted";
    if (!wants_compiled(job))
        return job.model.compile == CompileChoice::never ? "equations interpreted, as the job says"
                                                         : "equations interpreted: the job is short";
    const CompiledModel model = compiled_model(job.model.equations);
    if (!model.kernel) return fmt::format("equations interpreted: {}", model.why);
    job.model.compiled = true;
    job.model.system = with_stepper(std::make_shared<models::KernelSystem>(model.kernel), job.stepper);
    return model.cached ? "equations compiled, found in the cache" : "equations compiled";
}

bool is_compiled_first(const Job& job) {
    if (!job.model.equations || job.model.compiled || !wants_compiled(job)) return false;
    const CompiledModelState state = compiled_model_state(*job.model.equations);
    return state.possible && !state.cached;
}

std::string planned_evaluation(const Job& job) {
    if (!job.model.equations) return {};
    if (job.model.compiled) return "compiled: they cannot be interpreted";
    if (!wants_compiled(job))
        return job.model.compile == CompileChoice::never ? "interpreted, as the job says"
                                                         : "interpreted: the job is short";
    const CompiledModelState state = compiled_model_state(*job.model.equations);
    if (!state.possible) return fmt::format("interpreted: {}", state.why);
    return state.cached ? "compiled, in the cache" : "compiled first, which takes some ten seconds";
}

}  // namespace orbid::apps
