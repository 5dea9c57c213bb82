#include "periodic/waveforms/waveform_start.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "models/definition/parameter.hpp"
#include "periodic/orbit/coarse_flow.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/solve_orbit.hpp"

namespace orbid::periodic {
namespace {

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
    explicit StartSearch(const WaveformCase& of)
        : of_(of),
          length_(of.forced() ? of.record.period * of.system.period(of.theta, models::Clock::time) : of.record.time),
          scan_(of) {}

    WaveformStart run() {
        if (of_.record.start) {
            judge(*of_.record.start);
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
        for (Index i = 0; i < of_.system.dimension(); ++i)
            if (std::none_of(of_.channels.begin(), of_.channels.end(), [&](const WaveformChannel& channel) {
                    return channel.coordinate == i && reads_state(of_.record.sensor, i);
                }))
                return false;
        return true;
    }

    /// The reading nearest to a time, 0 where a coordinate is not read.
    [[nodiscard]] VectorXd measured_state(double time) const {
        const double* first = of_.record.times.data();
        const double* end = first + of_.record.times.size();
        const double* above = std::lower_bound(first, end, time);
        if (above == end || (above != first && time - *(above - 1) < *above - time)) --above;
        const auto nearest = static_cast<Index>(above - first);
        VectorXd state = VectorXd::Zero(of_.system.dimension());
        for (std::size_t c = 0; c < of_.channels.size(); ++c) {
            const auto row = static_cast<Index>(c);
            if (!reads_state(of_.record.sensor, of_.channels[c].coordinate)) continue;
            // The nearest sample that is there.
            for (Index distance = 0; distance < of_.record.times.size(); ++distance) {
                const Index later = std::min(nearest + distance, of_.record.times.size() - 1);
                const Index earlier = std::max<Index>(nearest - distance, 0);
                const Index k = std::isfinite(of_.record.values(row, later)) ? later : earlier;
                if (!std::isfinite(of_.record.values(row, k))) continue;
                state(of_.channels[c].coordinate) = of_.record.values(row, k);
                break;
            }
        }
        return state;
    }

    /// Times that are taken for phase 0: the one where it is, or several over one turn of the orbit.
    [[nodiscard]] std::vector<double> launch_times() const {
        const double first = of_.record.times(0);
        if (!of_.record.phase.estimate) {
            // Forced: the first time at which a whole orbit has passed since phase 0.
            const double turns = of_.record.phase.value / (full_turn * of_.record.period) + first / length_;
            return {first + (std::ceil(turns) - turns) * length_};
        }
        const Index count = std::min(launches_per_period * of_.record.period, most_launches);
        std::vector<double> times;
        for (Index i = 0; i < count; ++i)
            times.push_back(first + length_ * static_cast<double>(i) / static_cast<double>(count));
        return times;
    }

    [[nodiscard]] std::vector<VectorXd> launches() const {
        std::vector<VectorXd> states;
        for (const double time : launch_times())
            states.push_back(measured_state(time));
        VectorXd mean = VectorXd::Zero(of_.system.dimension());
        for (std::size_t c = 0; c < of_.channels.size(); ++c)
            if (reads_state(of_.record.sensor, of_.channels[c].coordinate))
                mean(of_.channels[c].coordinate) = scan_.means()(static_cast<Index>(c));
        states.push_back(mean);
        states.emplace_back(VectorXd::Zero(of_.system.dimension()));
        // Of autonomous flows 0 is often at rest.
        states.emplace_back(VectorXd::Ones(of_.system.dimension()));
        return states;
    }

    [[nodiscard]] std::optional<StartingSolution> measured(double time) const {
        StartingSolution start;
        const Index points = of_.forced() ? of_.record.period : 1;
        start.points.resize(of_.system.dimension(), points);
        for (Index j = 0; j < points; ++j)
            start.points.col(j) = measured_state(time + length_ * static_cast<double>(j) / static_cast<double>(points));
        if (!of_.forced()) start.time = of_.record.time;
        if (!start.points.allFinite()) return std::nullopt;
        return start;
    }

    /// Where motion from a state settles.
    [[nodiscard]] std::optional<StartingSolution> settled(const VectorXd& from) const {
        const models::FlowOptions coarse = coarsened(of_.flow, settling_tolerance);
        const Index p = of_.forced() ? of_.record.period : 1;
        std::vector<double> durations;
        for (Index j = 1; j <= p; ++j)
            durations.push_back(of_.forced() ? full_turn * static_cast<double>(j) : of_.record.time);
        const std::vector<Index> angles = angle_coordinates(of_.system);
        StartingSolution start;
        start.points.resize(from.size(), p);
        VectorXd x = from;
        for (int done = 0; done < settling_periods; done += static_cast<int>(p)) {
            const auto flow = of_.system.flow(x, 0.0, durations, of_.theta,
                                              of_.forced() ? models::Clock::phase : models::Clock::time, coarse);
            if (flow.status != models::FlowStatus::ok || !flow.states.allFinite()) return std::nullopt;
            start.points.col(0) = x;
            start.points.rightCols(p - 1) = flow.states.leftCols(p - 1);
            const VectorXd change = wrapped_angles(flow.states.col(p - 1) - x, angles);
            x = wrapped_angles(flow.states.col(p - 1), angles);
            if (change.cwiseAbs().maxCoeff() < settled_to * std::max(x.cwiseAbs().maxCoeff(), 1e-300)) break;
            // The guess of T is not T: a limit cycle does not repeat after it, and is reached in a tenth of the time.
            if (!of_.forced() && done >= settling_periods / 10) break;
        }
        if (!of_.forced()) {
            start.points.col(0) = x;
            start.time = time_of_return(x);
        }
        return start;
    }

    /// T [s]: the return to the plane across the flow that comes nearest to its beginning, from half of the guess to
    /// one and a half times it. The guess itself where there is none.
    [[nodiscard]] double time_of_return(const VectorXd& x) const {
        constexpr std::size_t returns = 16;
        const VectorXd f = of_.system.rhs(x, std::vector<double>{0.0}, of_.theta);
        if (!(f.norm() > 0.0)) return of_.record.time;
        const models::Section plane{f, f.dot(x), 1};
        double best = of_.record.time;
        double nearest = std::numeric_limits<double>::infinity();
        const auto crossing =
            of_.system.crossings(x, plane, returns, 2.0 * of_.record.time, of_.theta, std::nullopt, of_.flow);
        for (Index k = 0; k < crossing.states.cols(); ++k) {
            const double time = crossing.times(k);
            const double distance = (crossing.states.col(k) - x).norm();
            if (time < 0.5 * of_.record.time || time > 1.5 * of_.record.time || !(distance < nearest)) continue;
            nearest = distance;
            best = time;
        }
        return best;
    }

    /// Solves for the orbit and keeps it if it fits better than those before.
    void judge(const StartingSolution& start) {
        ShootingOptions options;
        options.flow = of_.flow;
        options.maximum_distance = std::numeric_limits<double>::infinity();
        PeriodicOrbit orbit = solve_orbit(of_.system, of_.theta, start, {}, options);
        const bool none = best_.status != OrbitStatus::converged;
        if (orbit.status != OrbitStatus::converged) {
            // A start at rest that stays there proves little.
            if (none && orbit.status != OrbitStatus::equilibrium) best_.status = orbit.status;
            return;
        }
        PhaseOrigin origin{orbit.points.col(0), {}};
        origin.normal = of_.system.rhs(origin.point, std::vector<double>{0.0}, of_.theta);
        // A phase that is known does not tell in which of the p periods of the orbit time 0 lies.
        const Index turns = of_.record.phase.estimate ? 1 : orbit.points.cols();
        for (Index turn = 0; turn < turns; ++turn) {
            const auto place = scan_.place(orbit, origin);
            if (!place) {
                if (none) best_.status = OrbitStatus::not_simulated;
                return;
            }
            if (best_.status != OrbitStatus::converged || place->misfit < best_.place.misfit)
                best_ = {OrbitStatus::converged, orbit, origin, *place};
            if (turns == 1) break;
            orbit.points = begun_later(orbit.points, 1);
        }
    }

    WaveformCase of_;
    double length_;  ///< of the orbit [s]
    WaveformScan scan_;
    WaveformStart best_;
};

}  // namespace

WaveformStart find_waveform_start(const WaveformCase& of) {
    return StartSearch(of).run();
}

}  // namespace orbid::periodic
