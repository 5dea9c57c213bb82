#pragma once

#include <chrono>
#include <cstdio>
#include <iosfwd>
#include <mutex>
#include <string>
#include <string_view>
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
/// On a terminal: a bar with fraction, rate and remaining time, redrawn at most ten times a second, replaced by one
/// line when the stage is done. Elsewhere: that one line only. Quiet: nothing, but the log and the times are kept.
///
///     Progress progress(options.quiet);
///     progress.begin("orbits", candidates, "candidates");
///     ... progress.advance(1);          // or progress.at(done) from the thread that knows the total
///     progress.end("57 cycles");
///
/// One stage at a time: begin() while a stage runs ends that stage first.
class Progress {
public:
    /// A bar is drawn when the stream's file is a terminal.
    /// @param stream  where to write; not owned.
    Progress(bool quiet, std::ostream& stream, std::FILE* terminal);
    /// @param terminal  draw a bar, whatever the stream is.
    Progress(bool quiet, std::ostream& stream, bool terminal);
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

    void finish(std::string_view outcome);
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

    bool running_ = false;
    bool bar_shown_ = false;
    std::string stage_;
    std::string unit_;
    std::string note_;
    double total_ = 0.0;
    double done_ = 0.0;
    Clock::time_point stage_start_;
    Clock::time_point last_drawn_;
};

/// Content of timing.json: seconds per stage, whether it was reused, the sum, threads and versions.
/// @param versions  (name, version) pairs: the program, its compiler, its libraries.
[[nodiscard]] std::string timing_text(const std::vector<StageTime>& times, int threads,
                                      const std::vector<std::pair<std::string, std::string>>& versions);

/// A readable duration: "0.12 s", "3.4 s", "2 min 05 s", "1 h 02 min".
[[nodiscard]] std::string duration_text(double seconds);

}  // namespace orbid::apps
