#include "orbits/simulation/section_record.hpp"

#include <algorithm>
#include <array>
#include <numbers>
#include <optional>

#include <fmt/format.h>

#include "estimator/interface/random_stream.hpp"
#include "orbits/simulation/attractor_detection.hpp"

namespace orbid::orbits {
namespace {

/// Sections between two looks at what became of the trajectories: long enough that starting anew costs nothing, short
/// enough that a captured trajectory does not run on for long.
constexpr std::size_t chunk = 8192;
/// The same for crossings of a plane: the time within a chunk is a sum of steps, whose rounding grows with it.
constexpr std::size_t crossing_chunk = 1024;

/// Losses in a row, without one point delivered, after which a trajectory is given up: nearly all starts then lead to a
/// stable orbit or to rest.
constexpr std::size_t fruitless_limit = 20;

/// One trajectory on its way.
struct Walker {
    std::size_t index = 0;
    Eigen::VectorXd state;     ///< where it is
    Eigen::MatrixXd sections;  ///< since the last start, transient included
    Eigen::VectorXd times;     ///< of crossings, since the last start
    double clock = 0.0;        ///< [s] since the last start
    Eigen::Index filled = 0;
    Eigen::Index remaining = 0;  ///< sections still to be delivered
    std::size_t elapsed = 0;     ///< sections since the very first start
    std::size_t attempts = 0;    ///< starts after the first
    std::size_t fruitless = 0;
    bool reported = false;  ///< capture or rest of the present start is known (Restart::never)
    bool active = true;
};

/// Why nothing more is learnt from a trajectory, and from where on.
struct Loss {
    TrajectoryEvent::Kind kind = TrajectoryEvent::Kind::captured;
    int period = 0;
    models::FlowStatus status = models::FlowStatus::ok;
    Eigen::Index settled = 0;  ///< first column that is worth nothing
};

class SectionRecorder {
public:
    SectionRecorder(const models::System& system, const Eigen::VectorXd& theta, const VirtualExperimentOptions& options,
                    const Eigen::VectorXd& range, double longest_return)
        : system_(system),
          theta_(theta),
          options_(options),
          plan_(std::get<SectionPlan>(options.plan)),
          range_(range),
          longest_return_(longest_return) {
        measure_ = 2.0 * range;
        for (const models::Coordinate& coordinate : system.coordinates())
            angle_.push_back(coordinate.angle);
        const std::size_t count = options.trajectories;
        for (std::size_t i = 0; i < count; ++i) {
            Walker walker;
            walker.index = i;
            walker.remaining = static_cast<Eigen::Index>(plan_.sections / count + (i < plan_.sections % count ? 1 : 0));
            walkers_.push_back(std::move(walker));
        }
        pieces_.resize(count);
        events_.resize(count);
        for (Walker& walker : walkers_) {
            walker.active = walker.remaining > 0;
            if (!walker.active) continue;
            start(walker, options.initial.cols() > 0
                              ? Eigen::VectorXd(options.initial.col(static_cast<Eigen::Index>(walker.index)))
                              : random_state(system, range, options.seed, walker.index, 0));
        }
    }

    StateRecord run() {
        while (advance()) {
        }
        for (std::size_t i = 0; i < walkers_.size(); ++i) {
            for (auto& piece : pieces_[i])
                record_.pieces.push_back(std::move(piece));
            for (auto& event : events_[i])
                record_.events.push_back(std::move(event));
        }
        return std::move(record_);
    }

private:
    [[nodiscard]] Eigen::Index needed(const Walker& walker) const {
        return static_cast<Eigen::Index>(plan_.transient) + walker.remaining;
    }

    /// The start is section 0 of what follows; of crossings it is none.
    void start(Walker& walker, const Eigen::VectorXd& state) {
        walker.state = state;
        walker.sections.resize(system_.dimension(), needed(walker));
        walker.filled = 0;
        walker.reported = false;
        if (plan_.section) {
            walker.times.resize(needed(walker));
            walker.clock = 0.0;
        } else {
            walker.sections.col(0) = state;
            walker.filled = 1;
        }
        finish(walker);
    }

    void finish(Walker& walker) {
        if (walker.filled < needed(walker)) return;
        deliver(walker, walker.filled);
        walker.active = false;
    }

    /// One chunk of all trajectories that still have something to deliver; false when there are none.
    bool advance() {
        std::vector<std::size_t> active;
        Eigen::Index longest = 0;
        for (const Walker& walker : walkers_) {
            if (!walker.active) continue;
            active.push_back(walker.index);
            longest = std::max(longest, needed(walker) - walker.filled);
        }
        if (active.empty()) return false;
        Eigen::MatrixXd starts(system_.dimension(), static_cast<Eigen::Index>(active.size()));
        for (std::size_t a = 0; a < active.size(); ++a)
            starts.col(static_cast<Eigen::Index>(a)) = walkers_[active[a]].state;
        const std::size_t sections =
            std::min(plan_.section ? crossing_chunk : chunk, static_cast<std::size_t>(longest));
        const auto result = plan_.section ? system_.crossing_ensemble(starts, *plan_.section, sections, longest_return_,
                                                                      theta_, options_.flow)
                                          : system_.ensemble(starts, options_.phase, sections, theta_, options_.flow);
        for (std::size_t a = 0; a < active.size(); ++a)
            take(walkers_[active[a]], result, a);
        return true;
    }

    void take(Walker& walker, const models::EnsembleResult& result, std::size_t member) {
        const Eigen::MatrixXd& sections = result.sections[member];
        const models::FlowStatus status = result.status[member];
        const Eigen::Index fresh = std::min(sections.cols() - 1, needed(walker) - walker.filled);
        walker.sections.middleCols(walker.filled, fresh) = sections.middleCols(1, fresh);
        if (plan_.section) {
            walker.times.segment(walker.filled, fresh) = result.times[member].segment(1, fresh).array() + walker.clock;
            walker.clock += result.times[member][fresh];
        }
        walker.filled += fresh;
        walker.elapsed += static_cast<std::size_t>(fresh);
        walker.state = sections.col(fresh);

        if (walker.filled < needed(walker) && status != models::FlowStatus::ok) {
            const bool rests = plan_.section && comes_to_rest(walker.state);
            lose(walker,
                 {rests ? TrajectoryEvent::Kind::at_rest : TrajectoryEvent::Kind::failed, 0, status, walker.filled});
        } else if (!walker.reported) {
            if (const auto loss = settled(walker)) lose(walker, *loss);
        }
        if (walker.active) finish(walker);
    }

    /// Does a flow that crosses the plane no more settle on an equilibrium? It is then at the same place, within what
    /// captured() calls the same, at four late instants that no cycle has in common.
    [[nodiscard]] bool comes_to_rest(const Eigen::VectorXd& state) const {
        const std::array<double, 4> durations{0.61803 * longest_return_, 0.75 * longest_return_,
                                              0.86603 * longest_return_, longest_return_};
        const auto run = system_.flow(state, 0.0, durations, theta_, models::Clock::time, options_.flow);
        return run.status == models::FlowStatus::ok && settled_at_last(run.states, angle_, measure_) == 0;
    }

    [[nodiscard]] std::optional<Loss> settled(const Walker& walker) const {
        const auto past = walker.sections.leftCols(walker.filled);
        if (system_.at_rest(walker.state, theta_))
            return Loss{TrajectoryEvent::Kind::at_rest, 0, {}, settled_at_last(past, angle_, measure_)};
        const auto capture = captured(past, angle_, measure_);
        if (!capture) return std::nullopt;
        return Loss{TrajectoryEvent::Kind::captured, capture->period, {}, capture->settled};
    }

    /// Stores the sections after the transient up to (not including) column `end`.
    void deliver(Walker& walker, Eigen::Index end) {
        const auto transient = static_cast<Eigen::Index>(plan_.transient);
        if (end <= transient) return;
        StateRecord::Piece piece{walker.index, walker.sections.middleCols(transient, end - transient), {}};
        if (plan_.section) piece.times = walker.times.segment(transient, end - transient);
        pieces_[walker.index].push_back(std::move(piece));
        walker.remaining -= end - transient;
        walker.fruitless = 0;
    }

    [[nodiscard]] static std::string reason(const Loss& loss) {
        switch (loss.kind) {
            case TrajectoryEvent::Kind::captured:
                return fmt::format("it was captured by an orbit of period {}", loss.period);
            case TrajectoryEvent::Kind::at_rest:
                return "it came to rest";
            default:
                return fmt::format("it could not be continued ({})", models::description(loss.status));
        }
    }

    void lose(Walker& walker, const Loss& loss) {
        const auto since = static_cast<std::size_t>(std::max<Eigen::Index>(walker.filled - 1 - loss.settled, 0));
        events_[walker.index].push_back(
            {loss.kind, walker.index, walker.elapsed - since, loss.period, loss.status, walker.state});
        const bool failed = loss.kind == TrajectoryEvent::Kind::failed;
        if (options_.restart == Restart::never) {
            walker.reported = true;
            // Resting where the plane is not met brings no more sections.
            if (!failed && loss.status == models::FlowStatus::ok) return;
            deliver(walker, walker.filled);
            give_up(walker, fmt::format("it cannot be continued ({})", models::description(loss.status)));
            return;
        }
        ++walker.fruitless;
        deliver(walker, loss.settled);
        if (walker.fruitless >= fruitless_limit) {
            give_up(walker, fmt::format("it was captured, at rest or failed {} times in a row before the transient of "
                                        "{} sections was over; the last time {}",
                                        fruitless_limit, plan_.transient, reason(loss)));
            return;
        }
        ++walker.attempts;
        const Eigen::VectorXd fresh = random_state(system_, range_, options_.seed, walker.index, walker.attempts);
        events_[walker.index].push_back(
            {TrajectoryEvent::Kind::restarted, walker.index, walker.elapsed, 0, models::FlowStatus::ok, fresh});
        start(walker, fresh);
    }

    void give_up(Walker& walker, const std::string& why) {
        walker.active = false;
        record_.complete = false;
        if (!record_.message.empty()) record_.message += "; ";
        record_.message +=
            fmt::format("trajectory {} stopped {} sections short: {}", walker.index, walker.remaining, why);
    }

    const models::System& system_;
    const Eigen::VectorXd& theta_;
    const VirtualExperimentOptions& options_;
    const SectionPlan plan_;
    const Eigen::VectorXd& range_;
    const double longest_return_;
    Eigen::VectorXd measure_;
    std::vector<bool> angle_;
    std::vector<Walker> walkers_;
    std::vector<std::vector<StateRecord::Piece>> pieces_;
    std::vector<std::vector<TrajectoryEvent>> events_;
    StateRecord record_;
};

}  // namespace

Eigen::VectorXd random_state(const models::System& system, const Eigen::VectorXd& range, std::uint64_t seed,
                             std::size_t trajectory, std::size_t attempt) {
    // 2^32 attempts of 2^32 trajectories: more than anybody will simulate.
    estimator::RandomStream stream(
        seed, estimator::RandomPurpose::initial_state,
        (static_cast<std::uint64_t>(trajectory) << 32) + static_cast<std::uint64_t>(attempt));
    Eigen::VectorXd state(system.dimension());
    for (Eigen::Index i = 0; i < state.size(); ++i) {
        const bool angle = system.coordinates()[static_cast<std::size_t>(i)].angle;
        const double half = angle ? std::numbers::pi : range[i];
        state[i] = stream.uniform(-half, half);
    }
    return state;
}

StateRecord record_sections(const models::System& system, const Eigen::VectorXd& theta,
                            const VirtualExperimentOptions& options, const Eigen::VectorXd& range,
                            double longest_return) {
    return SectionRecorder(system, theta, options, range, longest_return).run();
}

}  // namespace orbid::orbits
