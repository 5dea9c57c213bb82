#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <iosfwd>
#include <limits>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace orbid::apps {

/// What one stage took.
struct StageTime {
    std::string stage;
    double seconds = 0.0;
    bool reused = false;  ///< its file was taken from the folder
};

/// Progress of a run on standard error, its log and its times. Thread-safe.
///
/// On a terminal: a line with fraction, rate, state and remaining time that is rewritten, replaced by one line when the
/// stage is done. Elsewhere: that line, and while a stage runs one about its state every ten seconds, the first after
/// two. A thread of its own writes them: no computation, however long, is silent. Quiet: nothing, but the log and the
/// times are kept.
///
///     Progress progress(options.quiet);
///     progress.begin("orbits", candidates, "candidates");
///     ... progress.advance(1);          // or progress.at(done) from the thread that knows the total
///     progress.end("57 cycles");
///
/// One stage at a time: begin() while a stage runs ends that stage first.
class Progress {
public:
    /// Between two lines about a stage where there is no terminal.
    static constexpr std::chrono::milliseconds usual_silence{10000};

    /// A bar is drawn when the stream's file is a terminal.
    /// @param stream  where to write; not owned. While a stage runs nobody else writes there.
    /// @param every   longest time between two lines of a stage where there is no terminal, > 0; the first one comes
    ///                after a fifth of it
    Progress(bool quiet, std::ostream& stream, std::FILE* terminal, std::chrono::milliseconds every = usual_silence);
    /// @param terminal  draw a bar, whatever the stream is.
    Progress(bool quiet, std::ostream& stream, bool terminal, std::chrono::milliseconds every = usual_silence);
    /// Ends a running stage, as "stopped".
    ~Progress();
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    /// Starts a stage of `total` units of work; 0 = unknown, without fraction or remaining time.
    void begin(std::string_view stage, double total = 0.0, std::string_view unit = "");
    /// `amount` more units are done.
    void advance(double amount);
    /// `done` units are done in all; smaller values than before are ignored. May name the state in a few words.
    void at(double done, std::string_view note = "");
    /// The state of the stage in a few words, and the seconds that it will still take (nan: unknown); what is done
    /// stays.
    void note(std::string_view words, double remaining_s = std::numeric_limits<double>::quiet_NaN());
    /// Work within a stage, or between two: then it is told like a stage, but only if it takes two seconds. Empty: it
    /// has ended.
    void within(std::string_view work);
    /// Ends the stage; its line shows `outcome`.
    void end(std::string_view outcome = "");
    /// A stage whose file fits and is taken from the folder.
    void reused(std::string_view stage, std::string_view what);
    /// A line for the log that is also shown unless quiet: warnings, orbits not found.
    void say(std::string_view line);
    /// A line for the log only.
    void log(std::string_view line);

    [[nodiscard]] std::vector<StageTime> times() const;
    /// Content of log.txt: each line begins with the seconds since the start.
    [[nodiscard]] std::string log_text() const;

private:
    using Clock = std::chrono::steady_clock;

    void start(std::string_view stage, double total, std::string_view unit);
    void finish(std::string_view outcome);
    void watch();
    void watch_beside();
    [[nodiscard]] std::string state(double elapsed) const;
    void keep(std::string_view line);
    void print(std::string_view line);
    void draw();
    void clear_bar();
    [[nodiscard]] double seconds_since(Clock::time_point then) const;

    mutable std::mutex mutex_;
    bool quiet_;
    std::ostream& stream_;
    bool terminal_;
    Clock::time_point start_ = Clock::now();
    std::vector<StageTime> times_;
    std::string log_;
    std::chrono::milliseconds every_;

    bool running_ = false;
    bool minor_ = false;  ///< work between two stages
    bool bar_shown_ = false;
    std::string stage_;
    std::string unit_;
    std::string note_;
    double total_ = 0.0;
    double done_ = 0.0;
    double remaining_s_ = std::numeric_limits<double>::quiet_NaN();  ///< as it was told at noted_
    Clock::time_point noted_;
    Clock::time_point stage_start_;
    Clock::time_point last_drawn_;
    Clock::time_point last_line_;

    bool over_ = false;
    std::condition_variable changed_;
    std::thread watching_;
};

/// Content of timing.json: seconds per stage, whether it was reused, the sum, threads and versions.
/// @param versions  (name, version) pairs: the program, its compiler, its libraries.
[[nodiscard]] std::string timing_text(const std::vector<StageTime>& times, int threads,
                                      const std::vector<std::pair<std::string, std::string>>& versions);

/// A readable duration: "0.12 s", "3.4 s", "2 min 05 s", "1 h 02 min".
[[nodiscard]] std::string duration_text(double seconds);

}  // namespace orbid::apps
