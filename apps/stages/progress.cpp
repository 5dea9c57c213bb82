#include "apps/stages/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <ostream>
#include <system_error>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/documents/json_text.hpp"
#include "apps/documents/printable.hpp"

namespace orbid::apps {
namespace {

constexpr int bar_width = 20;  // leaves room for rate, remaining time and a word in 80 columns
constexpr auto shortest_redraw = std::chrono::milliseconds(100);  // smooth to the eye, no cost
constexpr auto first_line = std::chrono::milliseconds(2000);  // work between stages that is done by then is not told

/// 1234567 -> "1.23 M": three digits and a prefix are all one can read while it changes.
std::string short_number(double value) {
    constexpr const char* prefixes[] = {"", " k", " M", " G", " T"};
    std::size_t prefix = 0;
    while (std::abs(value) >= 1000.0 && prefix + 1 < std::size(prefixes)) {
        value /= 1000.0;
        ++prefix;
    }
    return fmt::format("{:.3g}{}", value, prefixes[prefix]);
}

}  // namespace

std::string duration_text(double seconds) {
    if (!(seconds >= 0.0) || !std::isfinite(seconds)) return "?";
    if (seconds < 0.995) return fmt::format("{:.2f} s", seconds);
    if (seconds < 59.95) return fmt::format("{:.1f} s", seconds);
    const auto whole = static_cast<long long>(std::llround(seconds));
    if (whole < 3600) return fmt::format("{} min {:02} s", whole / 60, whole % 60);
    return fmt::format("{} h {:02} min", whole / 3600, whole % 3600 / 60);
}

Progress::Progress(bool quiet, std::ostream& stream, std::FILE* terminal, std::chrono::milliseconds every)
    : Progress(quiet, stream, terminal != nullptr && ::isatty(::fileno(terminal)) == 1, every) {}

Progress::Progress(bool quiet, std::ostream& stream, bool terminal, std::chrono::milliseconds every)
    : quiet_(quiet), stream_(stream), terminal_(terminal), every_(every) {}

Progress::~Progress() {
    {
        const std::lock_guard lock(mutex_);
        if (running_) finish(minor_ ? "" : "stopped");
        over_ = true;
    }
    changed_.notify_all();
    if (watching_.joinable()) watching_.join();
}

double Progress::seconds_since(Clock::time_point then) const {
    return std::chrono::duration<double>(Clock::now() - then).count();
}

void Progress::keep(std::string_view line) {
    log_ += fmt::format("{:10.3f}  {}\n", seconds_since(start_), printable(line));
}

void Progress::print(std::string_view line) {
    if (!quiet_) {
        clear_bar();
        stream_ << line << '\n';
        stream_.flush();
        last_line_ = Clock::now();
    }
}

void Progress::clear_bar() {
    if (bar_shown_) {
        write_unfiltered(stream_, "\r\033[K");
        bar_shown_ = false;
    }
}

/// Fraction, rate, what is known of the state, and the time that is left.
std::string Progress::state(double elapsed) const {
    std::string text;
    if (total_ > 0.0) {
        const double fraction = std::clamp(done_ / total_, 0.0, 1.0);
        const int filled = static_cast<int>(std::lround(fraction * bar_width));
        text += fmt::format(" [{}{}] {:3.0f} %", std::string(static_cast<std::size_t>(filled), '#'),
                            std::string(static_cast<std::size_t>(bar_width - filled), '.'), 100.0 * fraction);
    } else {
        text += fmt::format(" {:>11}", duration_text(elapsed));
    }
    if (done_ > 0.0 && elapsed > 0.0 && !unit_.empty())
        text += fmt::format("  {} {}/s", short_number(done_ / elapsed), unit_);
    double left = remaining_s_ - seconds_since(noted_);
    if (total_ > 0.0 && done_ > 0.0) left = (total_ - done_) * elapsed / done_;
    // What was foreseen and is over says nothing any more.
    const std::string remaining = left >= 0.0 ? duration_text(left) + " left" : "time left unknown";
    if (total_ > 0.0) text += "  " + remaining;
    if (!note_.empty()) text += "  " + note_;
    if (!(total_ > 0.0)) text += (note_.empty() ? "  " : "; ") + remaining;
    return text;
}

void Progress::draw() {
    const auto now = Clock::now();
    if (quiet_ || !terminal_ || !running_ || now - last_drawn_ < shortest_redraw) return;
    if (minor_ && now - stage_start_ < first_line) return;
    last_drawn_ = now;
    std::string line = printable(fmt::format("{:<9}{}", stage_, state(seconds_since(stage_start_))));
    // A longer line would wrap on an 80-column terminal and leave its upper half behind.
    constexpr std::size_t columns = 79;
    line.resize(std::min(line.size(), columns));
    write_unfiltered(stream_, '\r' + line + "\033[K");
    stream_.flush();
    bar_shown_ = true;
}

/// Until the end: keeps the bar alive, or writes a line when there was none for long.
void Progress::watch() {
    const std::chrono::milliseconds first = every_ / 5;
    const auto pause = terminal_ ? std::chrono::milliseconds(500) : std::max(first / 4, shortest_redraw);
    std::unique_lock lock(mutex_);
    while (!over_) {
        changed_.wait_for(lock, pause);
        if (over_ || !running_) continue;
        if (terminal_) {
            draw();
            continue;
        }
        // Half a pause early is nearer to the time than half a pause late.
        const auto now = Clock::now() + pause / 2;
        const bool told = last_line_ > stage_start_;
        if (now - (told ? last_line_ : stage_start_) < (told ? every_ : first)) continue;
        const std::string line = fmt::format("{:<9}{}", stage_, state(seconds_since(stage_start_)));
        keep(line);
        print(line);
    }
}

void Progress::watch_beside() {
    // A line of progress is not worth a run: without a thread, or without memory for its text, there is none.
    try {
        watching_ = std::thread([this] {
            try {
                watch();
            } catch (const std::bad_alloc&) {
            }
        });
    } catch (const std::system_error&) {
    }
}

void Progress::start(std::string_view stage, double total, std::string_view unit) {
    running_ = true;
    stage_ = stage;
    unit_ = unit;
    note_.clear();
    total_ = total > 0.0 ? total : 0.0;
    done_ = 0.0;
    remaining_s_ = std::numeric_limits<double>::quiet_NaN();
    noted_ = stage_start_ = Clock::now();
    last_drawn_ = {};
    if (!quiet_ && !watching_.joinable()) watch_beside();
}

void Progress::begin(std::string_view stage, double total, std::string_view unit) {
    const std::lock_guard lock(mutex_);
    if (running_) finish("");
    minor_ = false;
    start(stage, total, unit);
    keep(fmt::format("{}: started", stage));
    draw();
}

void Progress::within(std::string_view work) {
    const std::lock_guard lock(mutex_);
    if (running_ && !minor_) {
        note_ = work;
        remaining_s_ = std::numeric_limits<double>::quiet_NaN();
        draw();
        return;
    }
    if (running_) finish("");
    if (work.empty()) return;
    minor_ = true;
    start(work, 0.0, "");
}

void Progress::note(std::string_view words, double remaining_s) {
    const std::lock_guard lock(mutex_);
    note_ = words;
    remaining_s_ = remaining_s;
    noted_ = Clock::now();
    draw();
}

void Progress::advance(double amount) {
    const std::lock_guard lock(mutex_);
    if (amount > 0.0) {
        done_ += amount;
        draw();
    }
}

void Progress::at(double done, std::string_view note) {
    const std::lock_guard lock(mutex_);
    done_ = std::max(done_, done);
    note_ = note;
    draw();
}

void Progress::end(std::string_view outcome) {
    const std::lock_guard lock(mutex_);
    if (running_) finish(outcome);
}

void Progress::finish(std::string_view outcome) {
    running_ = false;
    const double elapsed = seconds_since(stage_start_);
    if (minor_ && elapsed < std::chrono::duration<double>(first_line).count()) return clear_bar();
    times_.push_back({stage_, elapsed, false});
    std::string line = fmt::format("{:<9} {:>11}", stage_, duration_text(elapsed));
    if (done_ > 0.0 && !unit_.empty() && elapsed > 0.0)
        line += fmt::format("  {} {}/s", short_number(done_ / elapsed), unit_);
    if (!outcome.empty()) line += fmt::format("  {}", outcome);
    keep(line);
    print(line);
}

void Progress::reused(std::string_view stage, std::string_view what) {
    const std::lock_guard lock(mutex_);
    if (running_ && stage_ == stage) running_ = false;
    times_.push_back({std::string(stage), 0.0, true});
    const std::string line = fmt::format("{:<9} {:>11}  {}", stage, "reused", what);
    keep(line);
    print(line);
}

void Progress::say(std::string_view line) {
    const std::lock_guard lock(mutex_);
    keep(line);
    print(line);
}

void Progress::log(std::string_view line) {
    const std::lock_guard lock(mutex_);
    keep(line);
}

std::vector<StageTime> Progress::times() const {
    const std::lock_guard lock(mutex_);
    return times_;
}

std::string Progress::log_text() const {
    const std::lock_guard lock(mutex_);
    return log_;
}

std::string timing_text(const std::vector<StageTime>& times, int threads,
                        const std::vector<std::pair<std::string, std::string>>& versions) {
    nlohmann::ordered_json out;
    out["stages"] = nlohmann::ordered_json::array();
    double sum = 0.0;
    for (const StageTime& time : times) {
        out["stages"].push_back({{"stage", time.stage}, {"seconds", time.seconds}, {"reused", time.reused}});
        sum += time.seconds;
    }
    out["seconds"] = sum;
    out["threads"] = threads;
    out["versions"] = nlohmann::ordered_json::object();
    for (const auto& [name, version] : versions)
        out["versions"][name] = version;
    return json_text(out);
}

}  // namespace orbid::apps
