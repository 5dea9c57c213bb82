#include <exception>
#include <mutex>
#include <optional>

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "apps/program/job_run.hpp"
#include "python/conversion/arguments.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/python_interruption.hpp"

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
    // What the caller's function raises ends the run and is raised again.
    std::optional<py::error_already_set> raised;
    std::mutex mutex;
    const auto failed = [&] {
        const std::lock_guard lock(mutex);
        return raised.has_value();
    };
    (void)computed_until_interrupted([&](const std::function<bool()>& stopped) {
        apps::JobRunCalls calls;
        calls.stopped = [&] { return stopped() || failed(); };
        if (!progress.is_none())
            calls.messages = [&](std::string_view line) {
                if (failed()) return;
                const py::gil_scoped_acquire lock;
                try {
                    progress(py::str(line.data(), line.size()));
                } catch (py::error_already_set& error) {
                    const std::lock_guard kept(mutex);
                    raised.emplace(std::move(error));
                }
            };
        result = apps::run_job_text(text, source, options, calls);
    });
    if (raised) throw py::error_already_set(*raised);
    return py::make_tuple(result.exit_code, problem_list(result.problems), result.summary, result.messages,
                          result.result);
}

}  // namespace

/// The Python side (orbid/job.py) makes text of dicts and objects of results.
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
}

}  // namespace orbid::python
