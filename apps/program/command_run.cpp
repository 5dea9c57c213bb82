#include "apps/program/command_run.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <ostream>
#include <stdexcept>
#include <thread>

#include <fmt/format.h>

#include "apps/campaign/plan/campaign_file.hpp"
#include "apps/documents/atomic_file.hpp"
#include "apps/documents/printable.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/program/check/data_check.hpp"
#include "apps/program/check/flow_check.hpp"
#include "apps/program/check/job_summary.hpp"
#include "apps/program/check/work_estimate.hpp"
#include "apps/program/colour.hpp"
#include "apps/program/run.hpp"

namespace orbid::apps {

namespace {

bool holds_campaign(const std::filesystem::path& file) {
    if (!std::filesystem::is_regular_file(file)) return false;
    try {
        return is_campaign(read_whole_file(file, largest_job_file));
    } catch (const FileUnreadable&) {
        return false;  // told where the job is read
    }
}

/// The job, or its problems on standard error.
JobReading read_and_report(const CommandCall& call) {
    const std::string& file = call.words[0];
    const bool coloured = is_coloured(call.value("color", "auto"), call.console.error_terminal);
    JobReading reading = read_job_file(file);
    if (!reading.job && holds_campaign(file))
        reading.problems = {{{0, 0}, "", fmt::format("is a campaign: orbid campaign {}", file), Problem::Kind::job}};
    constexpr std::size_t most_told = 200;
    for (std::size_t i = 0; i < std::min(reading.problems.size(), most_told); ++i)
        write_unfiltered(call.console.error, error_text(message(reading.problems[i], file), coloured) + '\n');
    if (reading.problems.size() > most_told)
        call.console.error << fmt::format("{}: and {} more\n", file, reading.problems.size() - most_told);
    return reading;
}

int run_stage(const CommandCall& call, Stage stage) {
    RunOptions run;
    run.stage = stage;
    run.threads = call.whole_number("threads", 0, 0);
    run.quiet = call.has("quiet");
    run.force = call.has("force");
    run.progress_every = std::chrono::seconds(call.whole_number("progress", 10, 1));
    const JobReading reading = read_and_report(call);
    if (!reading.job) return reading.exit_code();
    std::filesystem::path out = call.words[0];
    if (out.extension() == ".json")
        out.replace_extension();
    else
        out += ".out";  // a job without .json must not be its own folder
    run.out = call.value("out", out.string());
    return run_job(*reading.job, run, call.console, call.value("color", "auto"));
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
    const bool coloured = is_coloured(call.value("color", "auto"), call.console.error_terminal);
    if (const std::filesystem::path file = call.words[0]; holds_campaign(file)) {
        const CampaignReading reading = read_campaign(read_whole_file(file, largest_job_file), file);
        for (const Problem& problem : reading.problems)
            write_unfiltered(call.console.error, error_text(message(problem, file.string()), coloured) + '\n');
        if (reading.campaign) call.console.out << campaign_summary(*reading.campaign);
        return reading.exit_code();
    }
    const JobReading reading = read_and_report(call);
    if (!reading.job) return reading.exit_code();
    const Job& job = *reading.job;
    const DataCheck data = check_data(job);
    call.console.out << job_summary(job);
    for (const std::string& remark : data.remarks)
        call.console.out << "  note       " << remark << '\n';
    for (const std::string& problem : data.problems)
        write_unfiltered(call.console.error, error_text(problem, coloured) + '\n');
    if (!data.problems.empty()) return unusable_data;
    const int asked = call.whole_number("threads", 0, 0);
    const int threads = asked > 0 ? asked : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
    call.console.out << work_table(estimated_work(job, data, threads, measured_rates(job, data)), threads);
    if (!call.has("flow")) return 0;
    try {
        call.console.out << '\n' << flow_table(job, check_flows(job));
    } catch (const std::invalid_argument& error) {
        write_unfiltered(
            call.console.error,
            error_text(fmt::format("--flow: there is nothing to compare: {}", error.what()), coloured) + '\n');
        return wrong_call;
    }
    return 0;
}

}  // namespace orbid::apps
