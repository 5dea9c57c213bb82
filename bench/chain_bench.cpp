// Time and memory of an estimate of a long chain, blocks linked by matching errors, against its length.
//   chain_bench [largest number of blocks, default 1e6] [threads, default 1] [matching sd, default 1e-3]
// Henon's map with two more parameters, x' = 1 - a x^2 + y + c x, y' = b x + d, both coordinates read with errors of
// 1e-3, two latent states and four records per block: the map costs nothing, what is measured is the estimator.
// An iteration is one accepted step with everything that belongs to it (error scales included); what comes after the
// last one (posterior, report, check of the normal approximation) is given in iterations.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <random>
#include <string>

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>

#include "estimator/estimate/estimate.hpp"

namespace {

using namespace orbid;

/// Seconds: of the processor for one thread, so that other work on the machine does not count, else by the clock.
bool one_thread = true;
double now() {
    if (one_thread) return static_cast<double>(std::clock()) / static_cast<double>(CLOCKS_PER_SEC);
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// "VmHWM" = highest so far, "VmRSS" = now [byte]; 0 where the system does not tell.
double memory(const char* entry) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
        if (line.rfind(entry, 0) == 0) return 1024.0 * std::strtod(line.c_str() + std::strlen(entry) + 1, nullptr);
    return 0.0;
}

class Chain : public estimator::Residual {
public:
    Chain(std::size_t count, double matching) {
        std::mt19937_64 generator(5);
        std::normal_distribution<double> normal(0.0, 1e-3);
        Eigen::Vector2d z(0.1, 0.1);
        for (int i = 0; i < 100; ++i)
            z = Eigen::Vector2d(1.0 - 1.4 * z[0] * z[0] + z[1], 0.3 * z[0]);
        readings_.resize(2, static_cast<Eigen::Index>(count));
        layout_.resize(count);
        for (std::size_t b = 0; b < count; ++b) {
            const auto column = static_cast<Eigen::Index>(b);
            readings_(0, column) = z[0] + normal(generator);
            readings_(1, column) = z[1] + normal(generator);
            z = Eigen::Vector2d(1.0 - 1.4 * z[0] * z[0] + z[1], 0.3 * z[0]);
            estimator::BlockLayout& block = layout_[b];
            block.latents = 2;
            block.group = {0, 0};
            if (b + 1 == count) continue;
            block.group = {0, 0, 1, 1};
            block.linked_from = 2;
            block.next = static_cast<std::ptrdiff_t>(b) + 1;
        }
        estimator::Group reading;
        reading.name = "reading";
        reading.ordered = true;
        estimator::Group match;
        match.name = "matching";
        match.scale = {false, matching, estimator::FlatPrior{}};
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
        const double begin = now();
        std::vector<estimator::BlockValue> values(layout_.size());
        oneapi::tbb::parallel_for(std::size_t{0}, layout_.size(), [&](std::size_t b) {
            estimator::BlockValue& value = values[b];
            const bool joined = layout_[b].next >= 0;
            const Eigen::Index records = joined ? 4 : 2;
            const double x = z[b][0];
            const double y = z[b][1];
            value.e.resize(records);
            value.e.head(2) = readings_.col(static_cast<Eigen::Index>(b)) - z[b];
            if (joined) {
                value.e[2] = z[b + 1][0] - (1.0 - theta[0] * x * x + y + theta[2] * x);
                value.e[3] = z[b + 1][1] - (theta[1] * x + theta[3]);
            }
            if (!derivatives) return;
            value.e_theta.setZero(records, 4);
            value.e_z.setZero(records, 2);
            value.e_z(0, 0) = value.e_z(1, 1) = -1.0;
            if (!joined) return;
            value.e_next.setZero(records, 2);
            value.e_next(2, 0) = value.e_next(3, 1) = 1.0;
            value.e_z(2, 0) = 2.0 * theta[0] * x - theta[2];
            value.e_z(2, 1) = -1.0;
            value.e_z(3, 0) = -theta[1];
            value.e_theta(2, 0) = x * x;
            value.e_theta(2, 2) = -x;
            value.e_theta(3, 1) = -x;
            value.e_theta(3, 3) = -1.0;
        });
        own_time += now() - begin;
        return values;
    }
    mutable double own_time = 0.0;

private:
    Eigen::Matrix2Xd readings_;
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
};

}  // namespace

int main(int argc, char** argv) {
    const double largest = argc > 1 ? std::atof(argv[1]) : 1e6;
    const auto threads = static_cast<std::size_t>(argc > 2 ? std::atoi(argv[2]) : 1);
    const double matching = argc > 3 ? std::atof(argv[3]) : 1e-3;
    one_thread = threads == 1;
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism, threads);
    std::printf("%10s %6s %14s %14s %12s %10s %12s %8s\n", "blocks", "steps", "us/block/step", "residual's own",
                "after, steps", "total s", "byte/block", "slope");
    double before = 0.0;
    double blocks_before = 0.0;
    for (const double size : {1e4, 42754.0, 1e5, 1e6}) {
        if (!(size <= largest)) continue;
        const auto count = static_cast<std::size_t>(size);
        Chain chain(count, matching);
        const double held = memory("VmRSS");
        std::vector<estimator::FreeParameter> parameters;
        for (const auto& [name, start] :
             {std::pair<const char*, double>{"a", 1.3}, {"b", 0.25}, {"c", 0.05}, {"d", 0.02}}) {
            parameters.emplace_back();
            parameters.back().name = name;
            parameters.back().start = start;
        }
        estimator::EstimateOptions options;
        const double begin = now();
        double first = 0.0;
        double last = begin;
        double own_first = 0.0;
        double own_last = 0.0;
        int steps = 0;
        options.progress = [&](int, double) {
            last = now();
            own_last = chain.own_time;
            if (steps++ == 0) {
                first = last;
                own_first = own_last;
            }
        };
        const estimator::Estimate result = estimator::estimate(parameters, {&chain}, {}, options);
        const double end = now();
        const double iterations = std::max(steps - 1, 1);
        const double per_step = (last - first) / iterations;
        const double own = (own_last - own_first) / iterations;
        const double after = end - last - (chain.own_time - own_last);
        const double slope = before > 0.0 ? std::log((end - begin) / before) / std::log(size / blocks_before) : 0.0;
        std::printf("%10.0f %6d %14.2f %14.2f %12.2f %10.2f %12.0f %8.3f\n", size, steps, 1e6 * (per_step - own) / size,
                    1e6 * own / size, after / (per_step - own), end - begin, (memory("VmHWM") - held) / size, slope);
        if (std::getenv("CHAIN_BENCH_VERBOSE") != nullptr) {
            std::printf("  %s, %s\n", std::string(estimator::name(result.status)).c_str(), result.message.c_str());
            for (const auto& p : result.parameters)
                std::printf("  %s = %.9g +- %.3g\n", p.name.c_str(), p.value, p.sd);
            for (const auto& s : result.scales)
                std::printf("  %s: %.6g +- %.3g, lag1 %.3g\n", s.group.c_str(), s.value, s.uncertainty, s.lag1);
        }
        before = end - begin;
        blocks_before = size;
    }
    return 0;
}
