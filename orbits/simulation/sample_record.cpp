#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <iterator>

#include <fmt/format.h>

#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/section_record.hpp"

namespace orbid::orbits {
namespace {

/// Samples of one call of the flow: its step budget holds for these, not for a record of any length.
constexpr std::size_t sample_chunk = 4096;

/// The records of all trajectories, one after the other.
StateRecord joined(std::vector<StateRecord>& parts) {
    StateRecord record;
    for (StateRecord& part : parts) {
        std::move(part.pieces.begin(), part.pieces.end(), std::back_inserter(record.pieces));
        std::move(part.events.begin(), part.events.end(), std::back_inserter(record.events));
        record.complete = record.complete && part.complete;
        if (!part.message.empty()) record.message += (record.message.empty() ? "" : "; ") + part.message;
    }
    return record;
}

}  // namespace

StateRecord record_samples(const models::System& system, const Eigen::VectorXd& theta,
                           const VirtualExperimentOptions& options, const Eigen::VectorXd& range) {
    const auto plan = std::get<SamplePlan>(options.plan);
    const std::size_t count = options.trajectories;
    std::vector<StateRecord> parts(count);
    const double rate = phase_rate(system, theta);
    oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t trajectory) {
        StateRecord& part = parts[trajectory];
        StateRecord::Piece piece;
        piece.trajectory = trajectory;
        piece.states.resize(system.dimension(), static_cast<Eigen::Index>(plan.count));
        piece.times.resize(static_cast<Eigen::Index>(plan.count));
        Eigen::VectorXd state = options.initial.cols() > 0
                                    ? Eigen::VectorXd(options.initial.col(static_cast<Eigen::Index>(trajectory)))
                                    : random_state(system, range, options.seed, trajectory, 0);
        // Every chunk begins where the last one ended; the first duration leads over the transient.
        double time = 0.0;
        std::size_t done = 0;
        while (done < plan.count) {
            const std::size_t size = std::min(sample_chunk, plan.count - done);
            std::vector<double> durations(size);
            for (std::size_t k = 0; k < size; ++k) {
                const double at = static_cast<double>(plan.transient + done + k) * plan.step;
                piece.times[static_cast<Eigen::Index>(done + k)] = at;
                durations[k] = at - time;
            }
            const auto flow =
                system.flow(state, options.phase + rate * time, durations, theta, models::Clock::time, options.flow);
            std::size_t good = size;
            if (flow.status != models::FlowStatus::ok)
                good = static_cast<std::size_t>(
                    std::lower_bound(durations.begin(), durations.end(), flow.stopped_after) - durations.begin());
            piece.states.middleCols(static_cast<Eigen::Index>(done), static_cast<Eigen::Index>(good)) =
                flow.states.leftCols(static_cast<Eigen::Index>(good));
            done += good;
            if (flow.status != models::FlowStatus::ok) {
                part.complete = false;
                part.message = fmt::format("trajectory {} stopped at {} s: {}", trajectory, time + flow.stopped_after,
                                           models::description(flow.status));
                part.events.push_back({TrajectoryEvent::Kind::failed, trajectory, plan.transient + done, 0, flow.status,
                                       flow.stopped_state});
                break;
            }
            state = flow.states.col(static_cast<Eigen::Index>(size) - 1);
            time += durations.back();
        }
        const auto kept = static_cast<Eigen::Index>(done);
        piece.states.conservativeResize(Eigen::NoChange, kept);
        piece.times.conservativeResize(kept);
        if (part.complete && system.at_rest(state, theta)) {
            Eigen::Index first = kept - 1;
            while (first > 0 && system.at_rest(piece.states.col(first - 1), theta))
                --first;
            part.events.push_back({TrajectoryEvent::Kind::at_rest, trajectory,
                                   plan.transient + static_cast<std::size_t>(first), 0, models::FlowStatus::ok, state});
        }
        if (kept > 0) part.pieces.push_back(std::move(piece));
    });
    return joined(parts);
}

}  // namespace orbid::orbits
