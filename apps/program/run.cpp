#include "apps/program/run.hpp"

#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <ostream>
#include <sstream>
#include <stdexcept>
#include <thread>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/printable.hpp"
#include "apps/estimation/estimate_stage.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/evaluated_model.hpp"
#include "apps/job/input_checksums.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/job/version.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "apps/program/colour.hpp"
#include "apps/program/command_stored.hpp"
#include "apps/program/cycle_run.hpp"
#include "apps/program/summary.hpp"
#include "apps/results/lost_records.hpp"
#include "apps/results/output_folder.hpp"
#include "apps/results/periodic_summary.hpp"
#include "apps/stages/branch_stage.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/interruption.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/periodic_stage.hpp"
#include "apps/stages/progress.hpp"
#include "apps/stages/state_size.hpp"
#include "apps/stages/workspace.hpp"
#include "identification/starts/derivative_self_check.hpp"
#include "models/system/stopped.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

/// A run that its caller may stop.
class AskedCaller final : public Interruption {
public:
    explicit AskedCaller(const std::function<bool()>& stopped) : stopped_(stopped) {}
    [[nodiscard]] bool asked() const override { return stopped_ && stopped_(); }
    [[nodiscard]] bool asked_often() const override {
        if (!stopped_) return false;
        using std::chrono::steady_clock, std::chrono::milliseconds;
        const auto now = steady_clock::now().time_since_epoch();
        const auto last = last_.load(std::memory_order_relaxed);
        if (now.count() - last < steady_clock::duration(milliseconds(10)).count()) return yes_;
        last_ = now.count();
        if (stopped_()) yes_ = true;
        return yes_;
    }

private:
    const std::function<bool()>& stopped_;
    mutable std::atomic<std::chrono::steady_clock::rep> last_{0};
    mutable std::atomic<bool> yes_{false};
};

int exit_code(const estimator::Estimate& estimate) {
    if (estimate.status == estimator::EstimateStatus::converged)
        return too_few_used(estimate.counts) ? no_valid_answer : success;
    return estimate.status == estimator::EstimateStatus::interrupted ? ended_by_signal : no_valid_answer;
}

/// result.json of a run that is left before its estimate.
std::string result_without_estimate() {
    estimator::Estimate estimate;
    estimate.status = estimator::EstimateStatus::interrupted;
    estimate.message = "interrupted before the estimate";
    return result_text(estimate, {});
}

/// Runs the stages that the command and the job name; the exit code is the worst of theirs.
///
/// @param job  that of `work`, whose states take their size from the records
int run_stages(const Workspace& work, Job& job, const Console& console, bool coloured) {
    const bool estimating = wants(work.options, Stage::estimate) && job.estimate;
    const bool from_cycles =
        estimating && (job.estimate->cycles || (job.estimate->waveform && job.estimate->waveform->of_cycles));
    const bool optional = estimating && work.options.stage != Stage::orbits && are_cycles_optional(job);
    const bool searching = job.orbits && !optional && (wants(work.options, Stage::orbits) || from_cycles);
    const bool loading = wants(work.options, Stage::simulate) || (searching && is_section_search(job)) ||
                         (estimating && (job.estimate->series || job.estimate->waveform || is_section_search(job)));
    int code = success;
    if (estimating) work.stop.shows(result_without_estimate());

    std::vector<Experiment> data;
    if (loading) data = load_data(work);
    job.model.system = job.model.system->with_state_size(state_size(job, data));

    JobCycles cycles;
    if (searching && !work.interruption.asked()) {
        cycles = job_cycles(work, data, console);
        if (cycles.search.cycles.empty()) code = no_valid_answer;
    }
    if (wants(work.options, Stage::periodic) && job.periodic && !work.interruption.asked()) {
        const ComputedOrbits orbits = compute_orbits(work);
        console.out << orbits_summary(orbits);
        if (orbits.converged() == 0) code = no_valid_answer;
        if (job.periodic->continuation && !work.interruption.asked()) {
            const FollowedBranches followed = follow_job_branches(work, orbits);
            console.out << branches_summary(followed,
                                            job.model.parameter(job.periodic->continuation->options.parameter));
            if (followed.branches.empty()) code = no_valid_answer;
        }
    }
    if (estimating) {
        std::function<void(JobCycles&)> find;
        if (optional) find = [&](JobCycles& found) { find_needed_cycles(work, data, console, found); };
        const EstimateOutcome outcome = run_estimate(work, data, cycles, find);
        if (optional && !cycles.section) store_section(work, data);
        write_unfiltered(console.out,
                         with_status_colours(estimate_summary(outcome.estimate, outcome.context, job.title), coloured));
        code = std::max(code, exit_code(outcome.estimate));
        // What was asked for and could not be done.
        for (const auto& [block, reason] : outcome.context.posterior.refused) {
            console.error << fmt::format("{}: {}\n", block, reason);
            code = std::max(code, no_valid_answer);
        }
        const auto& sample = outcome.context.posterior.sample;
        if (sample && sample->status == estimator::SampleStatus::failed) code = std::max(code, no_valid_answer);
    } else if (work.interruption.asked()) {
        code = ended_by_signal;
    }
    return code;
}

/// The stage a single-stage command names must stand in the job.
std::optional<std::string> missing_block(const Job& job, Stage stage) {
    if (stage == Stage::simulate && job.data.empty()) return "simulate needs a \"data\" block in the job";
    if (stage == Stage::orbits && !job.orbits) return "orbits needs an \"orbits\" block in the job";
    if (stage == Stage::periodic && !job.periodic) return "periodic needs a \"periodic\" block in the job";
    if (stage == Stage::estimate && !job.estimate) return "estimate needs an \"estimate\" block in the job";
    const bool nothing = job.data.empty() && !job.orbits && !job.periodic && !job.estimate;
    if (stage == Stage::all && nothing) return "the job names no stage: nothing to run";
    return std::nullopt;
}

/// Stores the times and the log of a run.
void store_times(OutputFolder& folder, const Progress& progress, const RunOptions& options) {
    const int threads = options.threads > 0 ? options.threads : static_cast<int>(std::thread::hardware_concurrency());
    folder.store("timing.json", timing_text(progress.times(), threads, versions()));
    folder.store("log.txt", progress.log_text());
}

/// Runs a job whose files are signed first.
int run_signed(Job job, const RunOptions& options, const Console& console, std::string_view color, Progress& progress,
               const InterruptionGuard* signals, std::string* result) {
    const AskedCaller caller(console.stopped);
    const Interruption& interruption = signals != nullptr ? static_cast<const Interruption&>(*signals) : caller;
    progress.within("checksums of the data");
    sign_files(job);
    progress.within("compiling the equations");
    const std::string evaluation = settle_evaluation(job);
    progress.within({});
    if (!evaluation.empty()) progress.say(evaluation);
    const std::filesystem::path paths_from = options.in_memory ? job.source.parent_path() : options.out;
    const nlohmann::json document = nlohmann::json::parse(job_document(job, paths_from, versions()).dump());
    std::optional<OutputFolder> place;
    if (options.in_memory)
        place.emplace();
    else
        place.emplace(options.out, document, job_text(job, options.out, versions()), options.force);
    OutputFolder& folder = *place;
    if (!folder.in_memory() && !folder.is_locked())
        progress.say(fmt::format("the file system of {} has no locks: see that no other run writes there",
                                 options.out.string()));
    RunStop stop(interruption);
    const Workspace work{job, options, document, progress, interruption, folder, stop};
    job.model.system = job.model.system->with_stop(work.asking())->with_state_size(state_size(job, {}));
    int code = ended_by_signal;
    try {
        code = with_thread_limit(options.threads, console, [&] {
            return run_stages(work, job, console, is_coloured(color, console.out_terminal));
        });
    } catch (const models::Stopped&) {
        progress.end("interrupted");
        if (const std::string last = stop.result(); !last.empty()) folder.store("result.json", last);
        store_times(folder, progress, options);
        if (result != nullptr) *result = folder.kept_result();
        return ended_by_signal;
    }
    if (result != nullptr) *result = folder.kept_result();
    if (options.in_memory) return code;
    store_times(folder, progress, options);
    // Results are stored; of a long record the report takes seconds, and is left out when somebody waits for the end.
    RunStop report_stop(interruption);
    std::optional<RunStop::AtOnce> leaving;  // after an earlier stop there is the usual patience
    if (!interruption.asked()) leaving.emplace(report_stop);
    std::ostringstream complaints;
    progress.within("report");
    try {
        store_report(folder, complaints, [&report_stop] { return report_stop.now(); });
        progress.within({});
        console.error << complaints.str();
    } catch (const models::Stopped&) {
        progress.within({});
        console.error << "report.html: left out, since the run was stopped; orbid report makes it\n";
        return ended_by_signal;
    }
    return code;
}

}  // namespace

int run_job(const Job& asked, const RunOptions& options, const Console& console, std::string_view color,
            std::string* result) {
    if (const auto missing = missing_block(asked, options.stage)) {
        console.error << fmt::format("{}: {}\n", asked.source.string(), *missing);
        return wrong_call;
    }
    const auto refused = [&console](const std::exception& error, int code) {
        console.error << error.what() << '\n';
        return code;
    };
    Progress progress(options.quiet, console.error, console.error_terminal, options.progress_every);
    std::optional<InterruptionGuard> signals;
    if (console.signals) signals.emplace();
    try {
        return run_signed(asked, options, console, color, progress, signals ? &*signals : nullptr, result);
    } catch (const FolderRefused& error) {
        return refused(error, wrong_call);
    } catch (const StaleFile& error) {
        return refused(error, wrong_call);
    } catch (const identification::WrongModel& error) {
        return refused(error, wrong_call);
    } catch (const FileUnreadable& error) {
        return refused(error, unusable_data);
    } catch (const orbits::DataError& error) {
        return refused(error, unusable_data);
    }
}

}  // namespace orbid::apps
