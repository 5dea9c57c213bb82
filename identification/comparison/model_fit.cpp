#include "identification/comparison/model_fit.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace orbid::identification {

namespace {

/// One stage of one model: nothing else runs again.
Options plain_options(Options options) {
    options.comparison = {};
    options.starts = 1;
    return options;
}

/// Another model than that of the estimate, which is asked to stop as that is.
IdentificationProblem asking(IdentificationProblem problem, const Observer& observer) {
    problem.system = problem.system->with_stop([&observer] { return observer.left(); });
    return problem;
}

}  // namespace

ModelFit::ModelFit(const StageInput& input, IdentificationProblem problem, std::string name, SeriesStart nodes)
    : name_(std::move(name)),
      problem_(asking(std::move(problem), input.observer)),
      options_(plain_options(input.options)),
      setup_(estimate_setup(problem_, fitted_labels(problem_))),
      input_{problem_,  options_,       input.observer, setup_,  searched_binding(problem_, setup_),
             prepared_, input.estimate, input.search,   nullptr, std::move(nodes),
             false} {
    input_.estimate.progress = {};
    input_.estimate.watched = [this](const estimator::StepReport& report) { input_.observer.step(name_, report); };
    input_.observer.within(fmt::format("{}: first solutions", name_));
    add_series(problem_, setup_, prepared_);
    (void)add_waveform(problem_, setup_, setup_.start(), prepared_.waveform);
    (void)add_branch(problem_, setup_, setup_.start(), prepared_.branch);
}

StageRun ModelFit::fit(const Stage& stage, const estimator::Estimate& from) {
    std::vector<estimator::FreeParameter> parameters = setup_.parameters;
    for (estimator::FreeParameter& parameter : parameters) {
        const auto same = std::find_if(from.parameters.begin(), from.parameters.end(),
                                       [&](const estimator::Estimated& one) { return one.name == parameter.name; });
        if (same == from.parameters.end()) continue;
        parameter.start = same->value;
        // What the estimate holds is held in every model.
        if (same->interval_method == estimator::IntervalMethod::fixed)
            parameter.lower = parameter.upper = parameter.start;
    }
    StageRun run = fit_stage(input_, stage, parameters);
    input_.observer.detail(fmt::format("{}: {}, {} iterations, objective {:.6g}; {}", name_,
                                       status_name(run.result.status), run.result.iterations, run.result.objective,
                                       run.result.message));
    return run;
}

}  // namespace orbid::identification
