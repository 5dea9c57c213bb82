#include "apps/campaign/engine/task_run.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <ctime>
#include <exception>
#include <new>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/campaign/plan/campaign_file.hpp"
#include "apps/documents/compression.hpp"
#include "apps/documents/memory_limit.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"
#include "apps/job/reading/job_reader.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

constexpr int data_code = 3;
constexpr int interrupted_code = 130;

double processor_time() {
    timespec time{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

double unix_time() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

double number_or_unknown(const Json& object, const char* key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_number() ? found->get<double>() : TaskParameter::unknown;
}

TaskParameter parameter_of(const std::string& name, const Json& estimated, const char* value, const char* sd) {
    TaskParameter parameter;
    parameter.name = name;
    parameter.value = number_or_unknown(estimated, value);
    parameter.sd = number_or_unknown(estimated, sd);
    if (const auto interval = estimated.find("interval95"); interval != estimated.end() && interval->is_array()) {
        if ((*interval)[0].is_number()) parameter.lower = (*interval)[0];
        if ((*interval)[1].is_number()) parameter.upper = (*interval)[1];
    }
    return parameter;
}

/// The first line of several; all of them would fill a table.
std::string first_line(const std::string& text) {
    return text.substr(0, text.find('\n'));
}

/// The last line that is not empty: a program says last why it ended.
std::string last_line(std::string text) {
    while (!text.empty() && text.back() == '\n')
        text.pop_back();
    const auto before = text.rfind('\n');
    return before == std::string::npos ? text : text.substr(before + 1);
}

bool has_recorded_data(const std::string& text, const std::filesystem::path& source) {
    const JobReading reading = read_job(text, source);
    return reading.job && std::any_of(reading.job->data.begin(), reading.job->data.end(),
                                      [](const DataJob& data) { return data.file.has_value(); });
}

/// Removes a folder with all that is in it.
class RemovedFolder {
public:
    explicit RemovedFolder(std::filesystem::path folder) : folder_(std::move(folder)) {
        std::filesystem::create_directories(folder_);
    }
    ~RemovedFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(folder_, ignored);
    }
    RemovedFolder(const RemovedFolder&) = delete;
    RemovedFolder& operator=(const RemovedFolder&) = delete;
    [[nodiscard]] const std::filesystem::path& path() const { return folder_; }

private:
    std::filesystem::path folder_;
};

void fail(TaskOutcome& outcome, std::string status, std::string message) {
    outcome.state = TaskState::failed;
    outcome.status = std::move(status);
    outcome.message = std::move(message);
}

}  // namespace

void take_result(std::string_view text, TaskOutcome& outcome) {
    const Json result = Json::parse(text, nullptr, false);
    if (!result.is_object()) return fail(outcome, "error", "result.json is not JSON");
    outcome.status = result.value("status", "");
    outcome.message = first_line(result.value("message", ""));
    outcome.objective = number_or_unknown(result, "objective");
    for (const char* block : {"parameters", "derived"})
        if (const auto found = result.find(block); found != result.end())
            for (const auto& [name, estimated] : found->items())
                outcome.parameters.push_back(parameter_of(name, estimated, "value", "sd"));
    if (const auto errors = result.find("errors"); errors != result.end())
        for (const auto& [group, scale] : errors->items())
            if (scale.value("estimated", false))
                outcome.parameters.push_back(parameter_of(fmt::format("sd({})", group), scale, "sd", "uncertainty"));
    outcome.result = compressed(text);
}

std::vector<KnownValue> known_in_job(const std::string& text, const std::filesystem::path& source) {
    const JobReading reading = read_job(text, source);
    std::vector<KnownValue> known;
    if (!reading.job || !reading.job->estimate) return known;
    const Job& job = *reading.job;
    const auto add = [&](std::string name, double value) { known.push_back({std::move(name), value}); };
    if (simulates_all_data(job)) {
        for (const FreeParameterJob& parameter : job.estimate->parameters)
            add(parameter_names(job)[static_cast<std::size_t>(parameter.parameter)],
                job.model.values[parameter.parameter]);
        for (const DataJob& data : job.data)
            for (const Eigen::Index own : data.free)
                add(parameter_names(job)[static_cast<std::size_t>(own)] + "@" + data.name,
                    data.with_own(job.model.values)[own]);
    }
    for (const ReferenceJob& reference : job.reference)
        if (std::none_of(known.begin(), known.end(),
                         [&](const KnownValue& one) { return one.parameter == reference.name; }))
            add(reference.name, reference.value);
    return known;
}

TaskWork::TaskWork(const CampaignTasks& tasks, const TaskRunner& runner, int rank)
    : tasks_(tasks), runner_(runner), rank_(rank), drawn_(!tasks.campaign().draws.empty()) {
    std::array<char, 256> name{};
    if (::gethostname(name.data(), name.size() - 1) == 0) host_ = name.data();
    const std::filesystem::path& source = tasks.campaign().jobs.front().source;
    if (tasks.campaign().resampled && has_recorded_data(tasks.job_text(0), source))
        resampled_.emplace(source.parent_path());
}

const std::vector<KnownValue>& TaskWork::known_values(const std::string& job, std::int64_t number) const {
    if (!drawn_ && known_group_ == tasks_.group(number)) return known_;
    known_ = tasks_.known(number);
    const std::vector<KnownValue> made = known_in_job(job, tasks_.base(number).source);
    known_.insert(known_.end(), made.begin(), made.end());
    known_group_ = tasks_.group(number);
    return known_;
}

TaskRun TaskWork::run_resampled(const std::string& job, std::int64_t number,
                                const std::function<bool()>& stopped) const {
    // A folder of its own, under a name that the task alone has: what is stored of it then says the same everywhere.
    const RemovedFolder folder(std::filesystem::temp_directory_path() /
                               ("orbid-" + tasks_.plan(number).key.substr(0, 32)));
    Json document = Json::parse(job);
    resampled_->put_into(document, tasks_.campaign().seed + static_cast<std::uint64_t>(tasks_.replicate(number)),
                         folder.path());
    return runner_(document.dump(2), tasks_.base(number).source, stopped);
}

TaskOutcome TaskWork::run(std::int64_t number, const std::function<bool()>& stopped) const {
    using Clock = std::chrono::steady_clock;
    TaskOutcome outcome;
    outcome.number = number;
    outcome.host = host_;
    outcome.rank = rank_;
    outcome.started = unix_time();
    const Clock::time_point begin = Clock::now();
    const double processor_begin = processor_time();
    const auto elapsed = [&] { return std::chrono::duration<double>(Clock::now() - begin).count(); };
    const double limit = tasks_.campaign().seconds;
    bool campaign_stopped = false;
    bool late = false;
    std::vector<KnownValue> known;
    try {
        const std::string job = tasks_.job_text(number);
        const std::function<bool()> asked = [&] {
            late = late || (limit > 0.0 && elapsed() > limit);
            campaign_stopped = campaign_stopped || stopped();
            return late || campaign_stopped;
        };
        const TaskRun run =
            resampled_ ? run_resampled(job, number, asked) : runner_(job, tasks_.base(number).source, asked);
        outcome.exit_code = run.exit_code;
        if (!run.result.empty()) take_result(run.result, outcome);
        known = known_values(job, number);
        if (!run.problems.empty())
            fail(outcome, run.exit_code == data_code ? "data" : "invalid", first_line(run.problems));
        else if (run.result.empty())
            fail(outcome, run.exit_code == data_code ? "data" : "error", last_line(run.messages));
        else if (late && run.exit_code == interrupted_code)
            fail(outcome, "time_limit", fmt::format("no answer within {} s: {}", limit, outcome.message));
    } catch (const std::bad_alloc&) {
        fail(outcome, "error", out_of_memory_text());
    } catch (const std::exception& error) {
        fail(outcome, "error", first_line(error.what()));
    }
    if (campaign_stopped && !late && outcome.exit_code == interrupted_code) outcome.state = TaskState::waiting;
    for (TaskParameter& parameter : outcome.parameters) {
        const auto found = std::find_if(known.begin(), known.end(),
                                        [&](const KnownValue& one) { return one.parameter == parameter.name; });
        if (found == known.end()) continue;
        parameter.truth = found->truth;
        parameter.bound = found->bound;
    }
    outcome.seconds = elapsed();
    outcome.processor_seconds = processor_time() - processor_begin;
    return outcome;
}

}  // namespace orbid::apps
