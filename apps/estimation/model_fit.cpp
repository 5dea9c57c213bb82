#include "apps/estimation/model_fit.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

/// Another model than that of the run, which is asked to stop as that is.
Job asking(Job job, const Workspace& work) {
    job.model.system = job.model.system->with_stop(work.asking());
    return job;
}

}  // namespace

ModelFit::ModelFit(const StageInput& input, Job job, std::vector<std::vector<Eigen::MatrixXd>> nodes)
    : job_(asking(std::move(job), input.work)),
      work_{job_,
            input.work.options,
            input.work.document,
            input.work.progress,
            input.work.interruption,
            input.work.folder,
            input.work.stop},
      setup_(estimate_setup(job_, fitted_labels(job_, input.data))),
      input_{work_,     input.data,    input.section, setup_,  searched_binding(job_, setup_),
             prepared_, input.options, input.search,  nullptr, std::move(nodes),
             nullptr} {
    input_.options.progress = {};
    add_series(job_, input.data, setup_, prepared_);
    (void)add_waveform(job_, input.data, setup_, setup_.start(), prepared_.waveform);
}

StageRun ModelFit::fit(const StageJob& stage, const estimator::Estimate& from) {
    std::vector<estimator::FreeParameter> parameters = setup_.parameters;
    for (estimator::FreeParameter& parameter : parameters) {
        const auto same = std::find_if(from.parameters.begin(), from.parameters.end(),
                                       [&](const estimator::Estimated& one) { return one.name == parameter.name; });
        if (same != from.parameters.end()) parameter.start = same->value;
    }
    StageRun run = fit_stage(input_, stage, parameters);
    work_.progress.log(fmt::format("{}: {}, {} iterations, objective {:.6g}; {}", job_.model.variant, run.result.status,
                                   run.result.iterations, run.result.objective, run.result.message));
    return run;
}

}  // namespace orbid::apps
