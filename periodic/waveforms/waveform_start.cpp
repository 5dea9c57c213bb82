#include "periodic/waveforms/waveform_start.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "models/definition/parameter.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/solve_orbit.hpp"

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Measured states, per period of the forcing, that are taken for the state at phase 0, and at most.
constexpr Index launches_per_period = 8;
constexpr Index most_launches = 32;
/// Motion is followed this long, or until it repeats to settled_to of its size. Weak damping leaves exp(-0.05) per
/// period, which 400 periods make 2e-9.
constexpr int settling_periods = 400;
constexpr double settled_to = 1e-6;
/// Newton's method takes the orbit to its accuracy afterwards.
constexpr double settling_tolerance = 1e-7;

/// A sensor that reads a coordinate itself: its values are values of the state.
bool reads_state(const models::Sensor& sensor, Index coordinate) {
    return models::reading_function(sensor, static_cast<std::size_t>(coordinate)) == nullptr;
}

class StartSearch {
public:
    StartSearch(const models::System& system, const VectorXd& theta, const WaveformRecord& record,
                const std::vector<WaveformChannel>& channels, const models::FlowOptions& flow)
        : system_(system),
          theta_(theta),
          record_(record),
          channels_(channels),
          flow_(flow),
          forced_(system.kind() == models::Kind::forced),
          length_(forced_ ? record.period * system.period(theta, models::Clock::time) : record.time),
          scan_(system, theta, record, channels, flow) {}

    WaveformStart run() {
        if (record_.start) {
            judge(*record_.start);
            return std::move(best_);
        }
        for (const VectorXd& state : launches())
            if (const auto start = settled(state)) judge(*start);
        if (whole_state()) {
            for (const double time : launch_times())
                if (const auto start = measured(time)) judge(*start);
        }
        return std::move(best_);
    }

private:
    [[nodiscard]] bool whole_state() const {
        for (Index i = 0; i < system_.dimension(); ++i)
            if (std::none_of(channels_.begin(), channels_.end(), [&](const WaveformChannel& channel) {
                    return channel.coordinate == i && reads_state(record_.sensor, i);
                }))
                return false;
        return true;
    }

    /// The reading nearest to a time, 0 where a coordinate is not read.
    [[nodiscard]] VectorXd measured_state(double time) const {
        const double* first = record_.times.data();
        const double* end = first + record_.times.size();
        const double* above = std::lower_bound(first, end, time);
        if (above == end || (above != first && time - *(above - 1) < *above - time)) --above;
        const auto nearest = static_cast<Index>(above - first);
        VectorXd state = VectorXd::Zero(system_.dimension());
        for (std::size_t c = 0; c < channels_.size(); ++c) {
            const auto row = static_cast<Index>(c);
            if (!reads_state(record_.sensor, channels_[c].coordinate)) continue;
            // The nearest sample that is there.
            for (Index distance = 0; distance < record_.times.size(); ++distance) {
                const Index later = std::min(nearest + distance, record_.times.size() - 1);
                const Index earlier = std::max<Index>(nearest - distance, 0);
                const Index k = std::isfinite(record_.values(row, later)) ? later : earlier;
                if (!std::isfinite(record_.values(row, k))) continue;
                state(channels_[c].coordinate) = record_.values(row, k);
                break;
            }
        }
        return state;
    }

    /// Times that are taken for phase 0: the one where it is, or several over one turn of the orbit.
    [[nodiscard]] std::vector<double> launch_times() const {
        const double first = record_.times(0);
        if (!record_.phase.estimate) {
            // Forced: the first time at which a whole orbit has passed since phase 0.
            const double turns = record_.phase.value / (full_turn * record_.period) + first / length_;
            return {first + (std::ceil(turns) - turns) * length_};
        }
        const Index count = std::min(launches_per_period * record_.period, most_launches);
        std::vector<double> times;
        for (Index i = 0; i < count; ++i)
            times.push_back(first + length_ * static_cast<double>(i) / static_cast<double>(count));
        return times;
    }

    [[nodiscard]] std::vector<VectorXd> launches() const {
        std::vector<VectorXd> states;
        for (const double time : launch_times())
            states.push_back(measured_state(time));
        VectorXd mean = VectorXd::Zero(system_.dimension());
        for (std::size_t c = 0; c < channels_.size(); ++c)
            if (reads_state(record_.sensor, channels_[c].coordinate))
                mean(channels_[c].coordinate) = scan_.means()(static_cast<Index>(c));
        states.push_back(mean);
        states.emplace_back(VectorXd::Zero(system_.dimension()));
        // Of autonomous flows 0 is often at rest.
        states.emplace_back(VectorXd::Ones(system_.dimension()));
        return states;
    }

    [[nodiscard]] std::optional<StartingSolution> measured(double time) const {
        StartingSolution start;
        const Index points = forced_ ? record_.period : 1;
        start.points.resize(system_.dimension(), points);
        for (Index j = 0; j < points; ++j)
            start.points.col(j) = measured_state(time + length_ * static_cast<double>(j) / static_cast<double>(points));
        if (!forced_) start.time = record_.time;
        if (!start.points.allFinite()) return std::nullopt;
        return start;
    }

    /// Where motion from a state settles.
    [[nodiscard]] std::optional<StartingSolution> settled(const VectorXd& from) const {
        models::FlowOptions coarse = flow_;
        coarse.relative_tolerance = std::max(flow_.relative_tolerance, settling_tolerance);
        coarse.absolute_tolerance = std::max(flow_.absolute_tolerance, settling_tolerance);
        const Index p = forced_ ? record_.period : 1;
        std::vector<double> durations;
        for (Index j = 1; j <= p; ++j)
            durations.push_back(forced_ ? full_turn * static_cast<double>(j) : record_.time);
        const std::vector<Index> angles = angle_coordinates(system_);
        StartingSolution start;
        start.points.resize(from.size(), p);
        VectorXd x = from;
        for (int done = 0; done < settling_periods; done += static_cast<int>(p)) {
            const auto flow =
                system_.flow(x, 0.0, durations, theta_, forced_ ? models::Clock::phase : models::Clock::time, coarse);
            if (flow.status != models::FlowStatus::ok || !flow.states.allFinite()) return std::nullopt;
            start.points.col(0) = x;
            start.points.rightCols(p - 1) = flow.states.leftCols(p - 1);
            VectorXd change = flow.states.col(p - 1) - x;
            x = flow.states.col(p - 1);
            for (const Index i : angles) {
                change(i) = models::wrapped(change(i));
                x(i) = models::wrapped(x(i));
            }
            if (change.cwiseAbs().maxCoeff() < settled_to * std::max(x.cwiseAbs().maxCoeff(), 1e-300)) break;
            // The guess of T is not T: a limit cycle does not repeat after it, and is reached in a tenth of the time.
            if (!forced_ && done >= settling_periods / 10) break;
        }
        if (!forced_) {
            start.points.col(0) = x;
            start.time = time_of_return(x);
        }
        return start;
    }

    /// T [s]: the return to the plane across the flow that comes nearest to its beginning, from half of the guess to
    /// one and a half times it. The guess itself where there is none.
    [[nodiscard]] double time_of_return(const VectorXd& x) const {
        constexpr std::size_t returns = 16;
        const VectorXd f = system_.rhs(x, std::vector<double>{0.0}, theta_);
        if (!(f.norm() > 0.0)) return record_.time;
        const models::Section plane{f, f.dot(x), 1};
        double best = record_.time;
        double nearest = std::numeric_limits<double>::infinity();
        const auto crossing = system_.crossings(x, plane, returns, 2.0 * record_.time, theta_, std::nullopt, flow_);
        for (Index k = 0; k < crossing.states.cols(); ++k) {
            const double time = crossing.times(k);
            const double distance = (crossing.states.col(k) - x).norm();
            if (time < 0.5 * record_.time || time > 1.5 * record_.time || !(distance < nearest)) continue;
            nearest = distance;
            best = time;
        }
        return best;
    }

    /// Solves for the orbit and keeps it if it fits better than those before.
    void judge(const StartingSolution& start) {
        ShootingOptions options;
        options.flow = flow_;
        options.maximum_distance = std::numeric_limits<double>::infinity();
        PeriodicOrbit orbit = solve_orbit(system_, theta_, start, {}, options);
        const bool none = best_.status != OrbitStatus::converged;
        if (orbit.status != OrbitStatus::converged) {
            // A start at rest that stays there proves little.
            if (none && orbit.status != OrbitStatus::equilibrium) best_.status = orbit.status;
            return;
        }
        PhaseOrigin origin{orbit.points.col(0), {}};
        origin.normal = system_.rhs(origin.point, std::vector<double>{0.0}, theta_);
        // A phase that is known does not tell in which of the p periods of the orbit time 0 lies.
        const Index turns = record_.phase.estimate ? 1 : orbit.points.cols();
        for (Index turn = 0; turn < turns; ++turn) {
            const auto place = scan_.place(orbit, origin);
            if (!place) {
                if (none) best_.status = OrbitStatus::not_simulated;
                return;
            }
            if (best_.status != OrbitStatus::converged || place->misfit < best_.place.misfit)
                best_ = {OrbitStatus::converged, orbit, origin, *place};
            if (turns == 1) break;
            const VectorXd first = orbit.points.col(0);
            orbit.points.leftCols(turns - 1) = orbit.points.rightCols(turns - 1).eval();
            orbit.points.col(turns - 1) = first;
        }
    }

    const models::System& system_;
    const VectorXd& theta_;
    const WaveformRecord& record_;
    const std::vector<WaveformChannel>& channels_;
    models::FlowOptions flow_;
    bool forced_;
    double length_;  ///< of the orbit [s]
    WaveformScan scan_;
    WaveformStart best_;
};

}  // namespace

WaveformStart find_waveform_start(const models::System& system, const VectorXd& theta, const WaveformRecord& record,
                                  const std::vector<WaveformChannel>& channels, const models::FlowOptions& flow) {
    return StartSearch(system, theta, record, channels, flow).run();
}

}  // namespace orbid::periodic
