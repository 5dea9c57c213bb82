#include "apps/program/job_run.hpp"

#include <exception>
#include <memory>
#include <mutex>
#include <ostream>
#include <sstream>
#include <stdexcept>
#include <streambuf>
#include <utility>

#include "apps/campaign/plan/campaign_file.hpp"
#include "apps/documents/atomic_file.hpp"
#include "apps/documents/printable.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/program/check/data_check.hpp"
#include "apps/program/command.hpp"
#include "apps/program/problem_list.hpp"
#include "apps/program/run.hpp"

namespace orbid::apps {

namespace {

/// Whether a run with this exit code has stored a result; otherwise that in the folder is of another job.
bool was_run(int exit_code) {
    return exit_code == success || exit_code == no_valid_answer || exit_code == ended_by_signal;
}

/// Keeps what is written and tells each whole line.
class LineBuffer final : public std::streambuf {
public:
    explicit LineBuffer(const std::function<void(std::string_view)>& tell) : tell_(tell) {}
    [[nodiscard]] std::string text() const { return text_; }
    /// Throws what `tell` threw; nothing was told since.
    void rethrow() const {
        if (failure_) std::rethrow_exception(failure_);
    }

private:
    int_type overflow(int_type character) override {
        if (character == traits_type::eof()) return traits_type::not_eof(character);
        const char c = traits_type::to_char_type(character);
        (void)xsputn(&c, 1);
        return character;
    }
    std::streamsize xsputn(const char* characters, std::streamsize count) override {
        const std::lock_guard lock(mutex_);
        text_.append(characters, static_cast<std::size_t>(count));
        for (std::size_t end = text_.find('\n', told_); tell_ && !failure_ && end != std::string::npos;
             end = text_.find('\n', told_)) {
            // A stream would swallow it, and all that is written later.
            try {
                tell_(std::string_view(text_).substr(told_, end - told_));
            } catch (...) {
                failure_ = std::current_exception();
            }
            told_ = end + 1;
        }
        return count;
    }

    const std::function<void(std::string_view)>& tell_;
    std::mutex mutex_;
    std::string text_;
    std::size_t told_ = 0;
    std::exception_ptr failure_;
};

/// A caller's function as several threads may ask it: one at a time, and no more once it said yes.
std::function<bool()> one_at_a_time(const std::function<bool()>& stopped) {
    if (!stopped) return {};
    struct Asked {
        std::mutex mutex;
        bool yes = false;
    };
    return [&stopped, asked = std::make_shared<Asked>()] {
        const std::lock_guard lock(asked->mutex);
        if (!asked->yes) asked->yes = stopped();
        return asked->yes;
    };
}

}  // namespace

std::vector<JobProblem> job_problems(std::string_view text, const std::filesystem::path& source) {
    if (is_campaign(text)) return problem_list(read_campaign(text, source).problems, source);
    const JobReading reading = read_job(text, source);
    std::vector<JobProblem> problems = problem_list(reading.problems, source);
    if (!reading.job) return problems;
    for (const std::string& problem : check_data(*reading.job).problems)
        problems.push_back({{}, 0, 0, problem, true, problem});
    return problems;
}

JobRun run_job_text(std::string_view text, const std::filesystem::path& source, const RunOptions& options,
                    const JobRunCalls& calls) {
    if (options.out.empty() && !options.in_memory)
        throw std::invalid_argument("run_job_text: options.out is empty, needs a folder");
    if (options.threads < 0)
        throw std::invalid_argument("run_job_text: options.threads must be >= 0, not " +
                                    std::to_string(options.threads));
    JobRun run;
    const JobReading reading = read_job(text, source);
    run.problems = problem_list(reading.problems, source);
    run.exit_code = reading.exit_code();
    if (!reading.job) return run;
    std::ostringstream out;
    LineBuffer lines(calls.messages);
    std::ostream error(&lines);
    PrintableStream filtered_out(out);
    PrintableStream filtered_error(error);
    Console console{filtered_out, filtered_error};
    console.stopped = one_at_a_time(calls.stopped);
    std::string kept;
    run.exit_code = run_job(*reading.job, options, console, "never", &kept);
    run.summary = out.str();
    run.messages = lines.text();
    lines.rethrow();
    const bool estimates = options.stage == Stage::all || options.stage == Stage::estimate;
    if (reading.job->estimate && estimates && was_run(run.exit_code))
        run.result = options.in_memory ? std::move(kept) : read_whole_file(options.out / "result.json");
    return run;
}

}  // namespace orbid::apps
