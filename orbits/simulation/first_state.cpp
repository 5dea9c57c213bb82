#include "orbits/simulation/first_state.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>
#include <vector>

#include "estimator/interface/random_stream.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/singular_values.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/simulation/initial_state.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr models::FlowOptions window_flow{1e-8, 1e-8, 20000};
constexpr Index longest_window = 65;  // samples of the fit of the first state

/// What the flow from a state misses of the readings of the first samples, in units of their sds.
struct WindowMiss {
    VectorXd e;
    MatrixXd slope;  ///< per range of each coordinate
};

class FirstWindow {
public:
    FirstWindow(const FollowedRecord& record, const VectorXd& range, const VectorXd& sd)
        : record_(record), range_(range), sd_(sd) {}

    /// Over as many samples as errors grow by a factor e on from x, but more readings than twice the coordinates.
    void choose_length(const VectorXd& x) {
        const Index n = record_.system.dimension(), most = std::min(longest_window, record_.values.cols());
        const Index least = std::min(most, 2 * n / std::ssize(record_.coordinates) + 2);
        length_ = most;
        for (; length_ > least; length_ = std::max(least, length_ / 2)) {
            const auto flow = from(x);
            if (flow.status != models::FlowStatus::ok || !flow.sensitivities.allFinite()) continue;
            const MatrixXd grown =
                range_.cwiseInverse().asDiagonal() * flow.sensitivities.rightCols(n) * range_.asDiagonal();
            if (models::singular_values(grown)[0] <= std::numbers::e) break;
        }
    }

    /// Levenberg and Marquardt. @return the sum of squares; infinite where none can be computed
    double improve(VectorXd& x, int steps) const {
        constexpr double least_step = 1e-6, too_damped = 1e6;
        WindowMiss now = miss(x);
        if (now.e.size() == 0) return std::numeric_limits<double>::infinity();
        double sum = now.e.squaredNorm(), damping = 1e-3;
        const Index n = x.size();
        for (int step = 0; step < steps && damping < too_damped; ++step) {
            const double size = std::sqrt(now.slope.squaredNorm() / static_cast<double>(n));
            MatrixXd stacked(now.e.size() + n, n);
            stacked << now.slope, std::sqrt(damping) * size * MatrixXd::Identity(n, n);
            VectorXd right = VectorXd::Zero(stacked.rows());
            right.head(now.e.size()) = now.e;
            const VectorXd change = models::PivotedFactor(stacked).solve(right);
            const VectorXd next = x + range_.cwiseProduct(change);
            WindowMiss trial = next.allFinite() ? miss(next) : WindowMiss{};
            if (trial.e.size() == 0 || !(trial.e.squaredNorm() <= sum)) {
                damping *= 10.0;
                continue;
            }
            x = next;
            now = std::move(trial);
            sum = now.e.squaredNorm();
            damping = std::max(damping / 10.0, 1e-9);
            if (change.norm() <= least_step) break;
        }
        return sum;
    }

    [[nodiscard]] std::uint64_t work() const { return work_; }

private:
    [[nodiscard]] models::FlowResult from(const VectorXd& x) const {
        std::vector<double> durations;
        for (Index k = 0; k < length_; ++k)
            durations.push_back(record_.at[k] - record_.at[0]);
        auto flow = record_.system.flow_with_sensitivities(x, record_.phases.front(), durations, record_.theta, {},
                                                           record_.clock, window_flow);
        work_ += flow_work(record_.system, flow.steps, record_.system.dimension());
        return flow;
    }

    /// Empty where it cannot be computed.
    [[nodiscard]] WindowMiss miss(const VectorXd& x) const {
        const Index n = record_.system.dimension(), rows = std::ssize(record_.coordinates);
        const auto flow = from(x);
        if (flow.status != models::FlowStatus::ok || !flow.states.allFinite() || !flow.sensitivities.allFinite())
            return {};
        const auto read = record_.system.readings(record_.sensor, flow.states,
                                                  std::span(record_.phases).first(static_cast<std::size_t>(length_)),
                                                  record_.theta, std::span<const Index>{}, window_flow);
        if (read.status != models::FlowStatus::ok || !read.readings.allFinite() || !read.derivatives.allFinite())
            return {};
        WindowMiss result{VectorXd::Zero(rows * length_), MatrixXd::Zero(rows * length_, n)};
        for (Index k = 0; k < length_; ++k)
            for (Index i = 0; i < rows; ++i) {
                if (!std::isfinite(record_.values(i, k))) continue;
                const Index row = record_.coordinates[static_cast<std::size_t>(i)];
                result.e[k * rows + i] = record_.difference(i, record_.values(i, k), read.readings(row, k)) / sd_[i];
                result.slope.row(k * rows + i) = read.derivatives.row(row).segment(k * n, n) *
                                                 flow.sensitivities.middleCols(k * n, n) * range_.asDiagonal() / sd_[i];
            }
        return result;
    }

    const FollowedRecord& record_;
    const VectorXd& range_;
    const VectorXd& sd_;
    Index length_ = 1;
    mutable std::uint64_t work_ = 0;
};

/// A state on a course of the model, and how unlike the first readings its future is.
struct Analogue {
    VectorXd state;
    double distance = std::numeric_limits<double>::infinity();
};

/// Courses of a model beside the beginning of a record, both read every few samples.
class Courses {
public:
    Courses(const FollowedRecord& record, const VectorXd& sd) : record_(record), sd_(sd) {
        constexpr Index instants = 32, longest_stride = 4;
        const Index samples = record.values.cols();
        stride_ = std::clamp<Index>(samples / instants, 1, longest_stride);
        compared_ = std::min(instants, (samples - 1) / stride_ + 1);
        step_ = (record.at[(compared_ - 1) * stride_] - record.at[0]) /
                static_cast<double>(std::max<Index>(compared_ - 1, 1));
    }

    /// The place on the course from x that is most like the first readings; adds its states to `states`.
    [[nodiscard]] Analogue nearest(const VectorXd& x, std::vector<VectorXd>& states) const {
        constexpr Index lengths = 10;
        constexpr models::FlowOptions rough{1e-6, 1e-6, 20000};
        constexpr double same_phase = 0.3;  // [rad]
        // Measured inputs are those of the record: only the beginning of such a course can be compared.
        const bool driven = !record_.system.inputs().empty() && record_.clock == models::Clock::time;
        const Index count = driven || !(step_ > 0.0) ? compared_ : lengths * compared_;
        std::vector<double> durations;
        for (Index k = 0; k < count; ++k)
            durations.push_back(step_ * static_cast<double>(k));
        Analogue best;
        const double first_phase = record_.phases.front();
        const auto flow = record_.system.flow(x, first_phase, durations, record_.theta, record_.clock, rough);
        work_ += flow_work(record_.system, flow.steps, 0);
        if (flow.status != models::FlowStatus::ok || !flow.states.allFinite()) return best;
        std::vector<double> phases;
        const double rate = std::ssize(record_.phases) > stride_ && stride_ > 0
                                ? record_.phases[static_cast<std::size_t>(stride_)] - first_phase
                                : 0.0;
        for (Index k = 0; k < count; ++k)
            phases.push_back(first_phase + rate * static_cast<double>(k));
        const auto read =
            record_.system.readings(record_.sensor, flow.states, phases, record_.theta, std::nullopt, rough);
        if (read.status != models::FlowStatus::ok) return best;
        const bool forced = record_.system.kind() == models::Kind::forced;
        for (Index offset = 0; offset + compared_ <= count; ++offset) {
            const double turned = phases[static_cast<std::size_t>(offset)] - first_phase;
            if (forced && std::abs(models::wrapped(turned)) > same_phase) continue;
            const double distance = unlikeness(read.readings, offset);
            if (distance < best.distance) best = {flow.states.col(offset), distance};
        }
        for (Index k = 0; k < count; k += stride_)
            states.emplace_back(flow.states.col(k));
        return best;
    }

    [[nodiscard]] std::uint64_t work() const { return work_; }

private:
    [[nodiscard]] double unlikeness(const MatrixXd& readings, Index offset) const {
        double sum = 0.0;
        for (Index k = 0; k < compared_; ++k)
            for (Index i = 0; i < std::ssize(record_.coordinates); ++i) {
                const double value = record_.values(i, k * stride_);
                if (!std::isfinite(value)) continue;
                const double read = readings(record_.coordinates[static_cast<std::size_t>(i)], offset + k);
                const double e = record_.difference(i, value, read) / sd_[i];
                sum += e * e;
            }
        return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
    }

    const FollowedRecord& record_;
    const VectorXd& sd_;
    Index stride_ = 1;
    Index compared_ = 1;
    double step_ = 0.0;  ///< between instants that are compared
    mutable std::uint64_t work_ = 0;
};

/// What the first samples tell by themselves.
VectorXd told_state(const FollowedRecord& record, const Segment& data) {
    const Index length = std::min(longest_window, record.values.cols());
    const VectorXd times = data.times.size() > 0 ? VectorXd(data.times.head(length)) : VectorXd(record.at.head(length));
    const Segment beginning{data.label, record.values.leftCols(length), times, {}};
    const VectorXd guess = initial_state(record.system, record.theta,
                                         {beginning, record.coordinates, record.sensor, record.phases.front()});
    return guess.allFinite() ? guess : VectorXd::Zero(guess.size());
}

/// A size for coordinates that are not read: that of what is.
double typical_size(const FollowedRecord& record) {
    double product = 0.0;
    for (Index i = 0; i < record.values.rows(); ++i) {
        double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
        for (const double value : record.values.row(i)) {
            if (!std::isfinite(value)) continue;
            lowest = std::min(lowest, value);
            highest = std::max(highest, value);
        }
        product += std::log(highest > lowest ? highest - lowest : 1.0);
    }
    return std::exp(product / static_cast<double>(record.values.rows()));
}

MatrixXd columns(const std::vector<VectorXd>& list, Index rows) {
    MatrixXd all(rows, std::ssize(list));
    for (std::size_t k = 0; k < list.size(); ++k)
        all.col(static_cast<Index>(k)) = list[k];
    return all;
}

}  // namespace

FirstStates first_states(const FollowedRecord& record, const Segment& data, const VectorXd& first, const VectorXd& sd) {
    constexpr int others = 24, improved = 12, finished = 4;
    constexpr int few_steps = 8, many_steps = 30;
    const Index n = record.system.dimension();
    const VectorXd guess = told_state(record, data);
    const auto set_known = [&](VectorXd& x) {
        for (Index i = 0; i < first.size(); ++i)
            if (std::isfinite(first[i])) x[i] = first[i];
    };
    std::vector<VectorXd> begins{guess};
    set_known(begins.front());
    std::vector<bool> unread(static_cast<std::size_t>(n), true);
    if (record.sensor.type != models::Sensor::Type::function)
        for (const Index i : record.coordinates)
            unread[static_cast<std::size_t>(i)] = false;
    const double size = typical_size(record);
    for (std::uint64_t j = 0; j < others; ++j) {
        estimator::RandomStream random(0, estimator::RandomPurpose::initial_state, j);
        VectorXd x = guess;
        const double scale = size * std::pow(10.0, random.uniform(-1.5, 1.0));
        for (Index i = 0; i < n; ++i)
            if (unread[static_cast<std::size_t>(i)]) x[i] = scale * random.normal();
        set_known(x);
        begins.push_back(x);
    }
    const Courses courses(record, sd);
    std::vector<Analogue> found;
    std::vector<VectorXd> near{begins.front()};
    for (VectorXd& x : begins) {
        std::vector<VectorXd> states;
        Analogue one = courses.nearest(x, states);
        found.push_back({x, one.distance});
        if (!std::isfinite(one.distance)) continue;
        set_known(one.state);
        found.push_back(one);
    }
    std::stable_sort(found.begin(), found.end(),
                     [](const Analogue& a, const Analogue& b) { return a.distance < b.distance; });
    found.resize(std::min<std::size_t>(found.size(), improved));
    for (const Analogue& one : found) {
        std::vector<VectorXd> states;
        (void)courses.nearest(one.state, states);
        near.insert(near.end(), states.begin(), states.end());
    }
    FirstStates result;
    result.courses = columns(near, n);
    if (first.size() > 0 && first.allFinite()) {
        result.states = begins.front();
        result.work = courses.work();
        return result;
    }
    const VectorXd range = state_range(record.system, result.courses);
    FirstWindow window(record, range, sd);
    window.choose_length(found.front().state);
    for (Analogue& one : found)
        one.distance = window.improve(one.state, few_steps);
    const auto nearer = [](const Analogue& a, const Analogue& b) { return a.distance < b.distance; };
    std::stable_sort(found.begin(), found.end(), nearer);
    found.resize(std::min<std::size_t>(found.size(), finished));
    for (Analogue& one : found)
        one.distance = window.improve(one.state, many_steps);
    std::stable_sort(found.begin(), found.end(), nearer);
    std::vector<VectorXd> states;
    for (const Analogue& one : found)
        if (std::isfinite(one.distance) || states.empty()) states.push_back(one.state);
    result.states = columns(states, n);
    result.work = courses.work() + window.work();
    return result;
}

}  // namespace orbid::orbits
