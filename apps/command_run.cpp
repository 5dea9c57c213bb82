#include "apps/command_run.hpp"

#include <filesystem>
#include <iostream>

#include "apps/job_reader.hpp"
#include "apps/job_summary.hpp"
#include "apps/run.hpp"

namespace orbid::apps {

namespace {

/// The job, or its problems on standard error.
JobReading read_and_report(const std::string& file) {
    JobReading reading = read_job_file(file);
    for (const Problem& problem : reading.problems)
        std::cerr << message(problem, file) << '\n';
    return reading;
}

int run_stage(const CommandCall& call, Stage stage) {
    RunOptions run;
    run.stage = stage;
    run.threads = call.whole_number("threads", 0, 0);
    run.quiet = call.has("quiet");
    run.force = call.has("force");
    const JobReading reading = read_and_report(call.words[0]);
    if (!reading.job) return reading.exit_code();
    std::filesystem::path out = call.words[0];
    if (out.extension() == ".json")
        out.replace_extension();
    else
        out += ".out";  // a job without .json must not be its own folder
    run.out = call.value("out", out.string());
    return run_job(*reading.job, run);
}

}  // namespace

int run_all_stages(const CommandCall& call) {
    return run_stage(call, Stage::all);
}

int run_simulation(const CommandCall& call) {
    return run_stage(call, Stage::simulate);
}

int run_orbits(const CommandCall& call) {
    return run_stage(call, Stage::orbits);
}

int run_periodic(const CommandCall& call) {
    return run_stage(call, Stage::periodic);
}

int run_estimation(const CommandCall& call) {
    return run_stage(call, Stage::estimate);
}

int check_job(const CommandCall& call) {
    const JobReading reading = read_and_report(call.words[0]);
    if (reading.job) std::cout << job_summary(*reading.job);
    return reading.exit_code();
}

}  // namespace orbid::apps
