#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "apps/program/campaign_run_text.hpp"
#include "apps/program/job_run.hpp"
#include "python/conversion/arguments.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/python_interruption.hpp"
#include "python/jobs/python_callback.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

py::list problem_list(const std::vector<apps::JobProblem>& problems) {
    py::list list;
    for (const apps::JobProblem& problem : problems)
        list.append(
            py::make_tuple(problem.pointer, problem.line, problem.column, problem.rule, problem.data, problem.text));
    return list;
}

/// (exit code, problems, summary, messages, content of result.json)
py::tuple run(const std::string& text, const std::filesystem::path& source, const std::filesystem::path& out,
              int threads, const std::string& stage, bool force, const py::object& progress) {
    apps::RunOptions options;
    options.out = out;
    options.threads = threads;
    options.force = force;
    options.stage =
        static_cast<apps::Stage>(choice_of(stage, {"all", "simulate", "orbits", "periodic", "estimate"}, "stage"));
    apps::JobRun result;
    PythonCallback told;
    (void)computed_until_interrupted([&](const std::function<bool()>& stopped) {
        apps::JobRunCalls calls;
        calls.stopped = [&] { return stopped() || told.failed(); };
        if (!progress.is_none())
            calls.messages = [&](std::string_view line) {
                told.tell([&] { progress(py::str(line.data(), line.size())); });
            };
        result = apps::run_job_text(text, source, options, calls);
    });
    told.raise_again();
    return py::make_tuple(result.exit_code, problem_list(result.problems), result.summary, result.messages,
                          result.result);
}

/// (exit code, problems, summary, messages)
py::tuple run_campaign(const std::string& text, const std::filesystem::path& source, const std::filesystem::path& out,
                       int threads, bool retry, const py::object& progress) {
    apps::CampaignRunOptions options;
    options.out = out;
    options.threads = threads;
    options.retry = retry;
    apps::CampaignRun result;
    PythonCallback told;
    (void)computed_until_interrupted([&](const std::function<bool()>& stopped) {
        apps::CampaignRunCalls calls;
        calls.stopped = [&] { return stopped() || told.failed(); };
        if (!progress.is_none())
            calls.progress = [&](const apps::CampaignRunProgress& now) {
                told.tell([&] {
                    progress(now.counts.tasks, now.counts.waiting, now.counts.done, now.counts.failed, now.in_work,
                             now.seconds, now.remaining);
                });
            };
        result = apps::run_campaign_text(text, source, options, calls);
    });
    told.raise_again();
    return py::make_tuple(result.exit_code, problem_list(result.problems), result.summary, result.messages);
}

}  // namespace

/// The Python side (orbid/job.py, orbid/campaign_run.py) makes text of dicts and objects of results.
void bind_jobs(py::module_& module) {
    module.def("job_problems", [](const std::string& text, const std::filesystem::path& source) {
        std::vector<apps::JobProblem> problems;
        {
            const py::gil_scoped_release unlocked;
            problems = apps::job_problems(text, source);
        }
        return problem_list(problems);
    });
    module.def("run_job", &run);
    module.def("run_campaign", &run_campaign);
    module.def("campaign_job", [](const std::filesystem::path& folder, std::int64_t number) {
        const apps::CampaignTaskJob job = apps::campaign_task_job(folder, number);
        return py::make_tuple(job.text, job.source);
    });
}

}  // namespace orbid::python
