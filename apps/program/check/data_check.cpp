#include "apps/program/check/data_check.hpp"

#include <algorithm>
#include <utility>

#include "apps/estimation/job_problem.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/input_checksums.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/recorded_series.hpp"
#include "apps/stages/searched_section.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "identification/structure/structural_check.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

/// What an estimate asks of records that are all there: segments by name, readings that can determine the unknowns.
/// @return what they cannot determine, a line each
std::vector<std::string> check_estimate(const Job& job, const std::vector<Experiment>& data) {
    const auto problem = identification_problem(job, data);
    auto setup = estimate_setup(problem, fitted_labels(problem));
    identification::ProblemResiduals residuals;
    add_series(problem, setup, residuals);
    const identification::StructuralReport structure = structural_report(problem, setup);
    hold(structure, setup.parameters);
    check_enough_readings(problem, setup, residuals);
    return remarks(structure);
}

}  // namespace

DataCheck check_data(const Job& job) {
    DataCheck check;
    check.records.resize(job.data.size());
    const auto attempt = [&check](const auto& action) {
        try {
            action();
        } catch (const orbits::DataError& error) {
            check.problems.emplace_back(error.what());
        }
    };
    attempt([&] {
        Job other = job;
        sign_files(other);
    });
    if (!check.problems.empty()) return check;

    std::vector<Experiment> data(job.data.size());
    for (std::size_t i = 0; i < job.data.size(); ++i) {
        attempt([&] {
            const LabelledInputs inputs = load_inputs(job, job.data[i]);
            if (!job.data[i].file) return;
            if (job.data[i].streamed()) {
                data[i].stream = recorded_stream(job, i);
                data[i].series = data[i].stream->header();
            } else {
                data[i].series = recorded_series(job, i);
            }
            data[i].inputs = by_segment(inputs, data[i].series.segments);
            check.records[i] = {data[i].points(), data[i].segments()};
        });
    }
    if (job.orbits && job.orbits->file) {
        attempt([&] { check.cycles = named_cycles(job).search.cycles.size(); });
    }
    const bool all_read =
        std::all_of(check.records.begin(), check.records.end(), [](const auto& record) { return record.has_value(); });
    if (all_read && check.problems.empty() && job.estimate) attempt([&] { check.remarks = check_estimate(job, data); });
    check.experiments = std::move(data);
    return check;
}

}  // namespace orbid::apps
