#include "estimator/exploration/bootstrap.hpp"

#include <algorithm>
#include <chrono>
#include <mutex>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>

#include "estimator/exploration/replication.hpp"

namespace orbid::estimator {

namespace {

/// Replicates as they end, in any order.
class Finished {
public:
    Finished(const BootstrapOptions& asked) : asked_(asked), list_(asked.done) {}

    void add(BootstrapReplicate replicate) {
        const std::lock_guard lock(door_);
        list_.push_back(std::move(replicate));
        if (asked_.progress) asked_.progress(list_.size(), asked_.replicates);
        const auto now = Clock::now();
        if (!asked_.keep || std::chrono::duration<double>(now - kept_).count() < asked_.keep_seconds) return;
        asked_.keep(list_);
        kept_ = Clock::now();
    }
    [[nodiscard]] std::vector<BootstrapReplicate> all() && { return std::move(list_); }

private:
    using Clock = std::chrono::steady_clock;
    const BootstrapOptions& asked_;
    std::mutex door_;
    std::vector<BootstrapReplicate> list_;
    Clock::time_point kept_ = Clock::now();
};

}  // namespace

Bootstrap bootstrap(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                    const std::vector<DerivedQuantity>& derived, const EstimateOptions& options,
                    const Estimate& estimate, const BootstrapOptions& asked) {
    if (asked.replicates < least_replicates)
        throw std::invalid_argument(
            fmt::format("replicates = {} must be {} or more: the ends of a 95 % interval would lie beyond all of them",
                        asked.replicates, least_replicates));
    const RecordDraws draws(residuals, estimate, asked.draws);
    const Replication replication(parameters, residuals, derived, options, estimate, draws, asked.draws.seed);
    std::vector<bool> there(asked.replicates, false);
    for (const BootstrapReplicate& replicate : asked.done)
        if (replicate.number < there.size()) there[replicate.number] = true;
    Finished finished(asked);
    const auto interrupted = [&] { return options.interrupted && options.interrupted(); };
    tbb::parallel_for(
        std::size_t{0}, asked.replicates,
        [&](std::size_t number) {
            if (there[number] || interrupted()) return;
            BootstrapReplicate replicate = replication.run(number, Mirror::none);
            // One that was cut short is none, and is computed anew.
            if (replicate.status != EstimateStatus::interrupted) finished.add(std::move(replicate));
        },
        tbb::simple_partitioner{});
    Bootstrap result = bootstrap_summary(parameters, estimate, std::move(finished).all(), asked.replicates);
    result.kind = draws.kind();
    result.block = draws.kind() == ErrorDraw::blocks ? draws.longest_block() : 1;
    return result;
}

}  // namespace orbid::estimator
