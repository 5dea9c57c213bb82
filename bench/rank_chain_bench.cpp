// One estimate of a long chain over ranks: time, memory and messages per rank, and the same estimate.
//   rank_chain_bench [nodes, default 1e6] [ranks ..., default 1 2 4]
// Henon's map with two parameters, both coordinates read with errors of 1e-3, matching sd 1e-3. Ranks are processes of
// this machine with one thread each. Seconds of the processor and memory are those of the busiest and of the largest
// rank: with a processor for each rank the estimate takes so long, apart from messages.
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <random>
#include <span>
#include <string>
#include <vector>

#include <oneapi/tbb/global_control.h>

#include "apps/ranks/process_ranks.hpp"
#include "estimator/estimate/estimate.hpp"
#include "estimator/estimate/estimate_over_ranks.hpp"

namespace {

using namespace orbid;

double thread_seconds() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// "VmHWM" = highest so far, "VmRSS" = now [byte].
double memory(const char* entry) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
        if (line.rfind(entry, 0) == 0) return 1024.0 * std::strtod(line.c_str() + std::strlen(entry) + 1, nullptr);
    return 0.0;
}

/// Nodes [begin, end) of a chain of `count`, and the one after them without its readings.
class Part : public estimator::Residual {
public:
    Part(std::size_t count, std::size_t begin, std::size_t end) {
        std::mt19937_64 generator(5);
        std::normal_distribution<double> normal(0.0, 1e-3);
        Eigen::Vector2d z(0.1, 0.1);
        for (int i = 0; i < 100; ++i)
            z = Eigen::Vector2d(1.0 - 1.4 * z[0] * z[0] + z[1], 0.3 * z[0]);
        const std::size_t known = std::min(end + 1, count);
        readings_.resize(2, static_cast<Eigen::Index>(known - begin));
        layout_.resize(known - begin);
        for (std::size_t b = 0; b < known; ++b) {
            const double x = z[0] + normal(generator);
            const double y = z[1] + normal(generator);
            z = Eigen::Vector2d(1.0 - 1.4 * z[0] * z[0] + z[1], 0.3 * z[0]);
            if (b < begin) continue;
            readings_.col(static_cast<Eigen::Index>(b - begin)) = Eigen::Vector2d(x, y);
            estimator::BlockLayout& block = layout_[b - begin];
            block.latents = 2;
            if (b >= end) continue;
            block.group = {0, 0};
            if (b + 1 == count) continue;
            block.group = {0, 0, 1, 1};
            block.linked_from = 2;
            block.next = static_cast<std::ptrdiff_t>(b - begin) + 1;
        }
        estimator::Group reading;
        reading.name = "reading";
        estimator::Group match;
        match.name = "matching";
        match.scale = {false, 1e-3, estimator::FlatPrior{}};
        groups_ = {reading, match};
    }
    [[nodiscard]] std::string_view type() const override { return "chain"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::chain; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override {
        std::vector<Eigen::VectorXd> z;
        z.reserve(layout_.size());
        for (Eigen::Index b = 0; b < readings_.cols(); ++b)
            z.emplace_back(readings_.col(b));
        return z;
    }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet&, const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& z,
                                                              bool derivatives) const override {
        std::vector<estimator::BlockValue> values(layout_.size());
        for (std::size_t b = 0; b < layout_.size(); ++b) {
            estimator::BlockValue& value = values[b];
            const auto records = std::ssize(layout_[b].group);
            value.e.resize(records);
            if (derivatives) {
                value.e_theta.setZero(records, 2);
                value.e_z.setZero(records, 2);
            }
            if (records == 0) continue;
            value.e.head(2) = readings_.col(static_cast<Eigen::Index>(b)) - z[b];
            if (derivatives) value.e_z(0, 0) = value.e_z(1, 1) = -1.0;
            if (records == 2) continue;
            const double x = z[b][0];
            value.e[2] = z[b + 1][0] - (1.0 - theta[0] * x * x + z[b][1]);
            value.e[3] = z[b + 1][1] - theta[1] * x;
            if (!derivatives) continue;
            value.e_next.setZero(records, 2);
            value.e_next(2, 0) = value.e_next(3, 1) = 1.0;
            value.e_z(2, 0) = 2.0 * theta[0] * x;
            value.e_z(2, 1) = -1.0;
            value.e_z(3, 0) = -theta[1];
            value.e_theta(2, 0) = x * x;
            value.e_theta(3, 1) = -x;
        }
        return values;
    }

private:
    Eigen::Matrix2Xd readings_;
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
};

/// Counts what a rank sends.
class CountingRanks : public estimator::Ranks {
public:
    explicit CountingRanks(estimator::Ranks& ranks) : ranks_(ranks) {}
    [[nodiscard]] int rank() const override { return ranks_.rank(); }
    [[nodiscard]] int count() const override { return ranks_.count(); }
    void send(int to, std::span<const std::byte> content) override {
        ++messages;
        bytes += static_cast<double>(content.size());
        ranks_.send(to, content);
    }
    [[nodiscard]] std::optional<estimator::RankMessage> receive(int from, std::chrono::milliseconds patience) override {
        return ranks_.receive(from, patience);
    }
    double messages = 0.0;
    double bytes = 0.0;

private:
    estimator::Ranks& ranks_;
};

/// What a process answers.
struct Answer {
    double converged = 0.0, iterations = 0.0, seconds = 0.0, busiest = 0.0, bytes = 0.0, messages = 0.0, sent = 0.0;
    std::array<double, 7> numbers{};  ///< a, b, their sds, scale of readings, its uncertainty, objective
};

void take(const estimator::Estimate& result, Answer& answer) {
    answer.converged = result.status == estimator::EstimateStatus::converged ? 1.0 : 0.0;
    answer.iterations = result.iterations;
    answer.numbers = {
        result.parameters[0].value, result.parameters[1].value,   result.parameters[0].sd, result.parameters[1].sd,
        result.scales[0].value,     result.scales[0].uncertainty, result.objective};
}

/// @param ranks  0: estimate() itself.
Answer run(std::size_t count, int ranks) {
    std::vector<estimator::FreeParameter> parameters(2);
    parameters[0].name = "a";
    parameters[0].start = 1.38;
    parameters[1].name = "b";
    parameters[1].start = 0.29;
    estimator::EstimateOptions options;
    options.clusters = estimator::Clusters::none;
    options.verdict = false;
    options.step_tolerance = 1e-9;
    Answer answer;
    const auto begin = std::chrono::steady_clock::now();
    if (ranks == 0) {
        const Part whole(count, 0, count);
        const double before = thread_seconds();
        take(estimator::estimate(parameters, {&whole}, {}, options), answer);
        answer.busiest = thread_seconds() - before;
    } else {
        const auto compute = [&](estimator::Ranks& talking) {
            const auto own = static_cast<std::size_t>(talking.rank());
            const auto all = static_cast<std::size_t>(ranks);
            const Part part(count, own * count / all, (own + 1) * count / all);
            CountingRanks counting(talking);
            Answer mine;
            const double before = thread_seconds();
            take(estimator::estimate_over_ranks(parameters, {&part}, {own > 0, own + 1 < all}, counting, {}, options),
                 mine);
            mine.busiest = thread_seconds() - before;
            mine.messages = counting.messages;
            mine.sent = counting.bytes;
            mine.bytes = memory("VmHWM");
            return mine;
        };
        apps::ProcessRanks processes(ranks, [&](estimator::Ranks& talking) {
            const Answer mine = compute(talking);
            talking.send(0, std::as_bytes(std::span(&mine, 1)));
            return 0;
        });
        std::vector<Answer> of{compute(processes)};
        for (int r = 1; r < ranks; ++r) {
            const estimator::RankMessage message = processes.receive(r);
            if (message.content.size() != sizeof(Answer)) std::exit(1);
            std::memcpy(&of.emplace_back(), message.content.data(), sizeof(Answer));
        }
        answer = of[0];
        for (const Answer& one : of) {
            answer.busiest = std::max(answer.busiest, one.busiest);
            answer.messages = std::max(answer.messages, one.messages);
            answer.sent = std::max(answer.sent, one.sent);
            answer.bytes = std::max(answer.bytes, one.bytes);
        }
    }
    answer.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (ranks == 0) answer.bytes = memory("VmHWM");
    return answer;
}

/// run() in a process of its own.
Answer run_apart(std::size_t count, int ranks) {
    std::array<int, 2> ends{};
    Answer answer;
    if (pipe(ends.data()) != 0) std::exit(1);
    std::fflush(stdout);
    const pid_t child = fork();
    if (child == 0) {
        const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism, 1);
        answer = run(count, ranks);
        const bool written = write(ends[1], &answer, sizeof answer) == static_cast<ssize_t>(sizeof answer);
        _exit(written ? 0 : 1);
    }
    close(ends[1]);
    const bool got = child > 0 && read(ends[0], &answer, sizeof answer) == static_cast<ssize_t>(sizeof answer);
    close(ends[0]);
    if (child > 0) waitpid(child, nullptr, 0);
    if (!got) {
        std::fprintf(stderr, "the process of %d ranks has failed\n", ranks);
        std::exit(1);
    }
    return answer;
}

}  // namespace

int main(int argc, char** argv) {
    const auto count = static_cast<std::size_t>(argc > 1 ? std::atof(argv[1]) : 1e6);
    std::vector<int> ranks{0};
    for (int i = 2; i < argc; ++i)
        ranks.push_back(std::atoi(argv[i]));
    if (ranks.size() == 1) ranks.insert(ranks.end(), {1, 2, 4});
    std::printf("%zu nodes\n%12s %6s %9s %13s %13s %10s %10s %12s\n", count, "ranks", "steps", "clock s",
                "busiest rank s", "MB per rank", "messages", "MB sent", "difference");
    Answer one;
    bool same = true;
    for (const int r : ranks) {
        const Answer answer = run_apart(count, r);
        if (r == 0) one = answer;
        double difference = 0.0;
        for (std::size_t i = 0; i < one.numbers.size(); ++i)
            difference = std::max(difference, std::abs(answer.numbers[i] / one.numbers[i] - 1.0));
        same = same && answer.converged > 0.0 && difference < 1e-10;
        std::printf("%12s %6.0f %9.1f %13.1f %13.0f %10.0f %10.3f %12.1e\n",
                    r == 0 ? "one process" : std::to_string(r).c_str(), answer.iterations, answer.seconds,
                    answer.busiest, 1e-6 * answer.bytes, answer.messages, 1e-6 * answer.sent, difference);
    }
    std::printf("%s\n", same ? "the same estimate to 1e-10" : "NOT the same estimate");
    return same ? 0 : 1;
}
