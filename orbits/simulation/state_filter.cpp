#include "orbits/simulation/state_filter.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "models/arithmetic/median.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/simulation/section_map.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double unknown_state = 0.3;  // sd of a start in ranges
// From one sample to the next: a state that needs more steps has been carried far away by a wrong guess of the errors.
constexpr models::FlowOptions filter_flow{1e-8, 1e-8, 1000};
constexpr std::size_t most_filter_steps = 200;  // of flows per sample, in the mean

/// One reading that a filter has used, for the way back.
struct Used {
    VectorXd slope;  ///< of the reading, per range of each coordinate
    VectorXd gain;
    double innovation = 0.0;
    double variance = 1.0;  ///< of the innovation
};

/// A sample on the way forwards.
struct Step {
    MatrixXd carried;  ///< d x_k / d x_{k-1}, in ranges; identity at the first sample
    VectorXd state;    ///< after its readings
    MatrixXd covariance;
    std::vector<Used> used;
};

/// The way forwards.
class Filter {
public:
    Filter(const FollowedRecord& record, const FilterNoise& noise)
        : record_(record),
          noise_(noise),
          n_(record.system.dimension()),
          all_(n_ + std::ssize(record.free)),
          theta_(record.theta),
          scale_(all_),
          typical_((record.at[record.at.size() - 1] - record.at[0]) /
                   static_cast<double>(std::max<Index>(record.at.size() - 1, 1))),
          errors_(record.coordinates.size()) {
        scale_ << record.range, record.free_sd;
    }

    void begin(const VectorXd& start) {
        x_ = start;
        p_ = MatrixXd::Identity(all_, all_);
        p_.diagonal().head(n_).setConstant(unknown_state * unknown_state);
        now_ = {};
        now_.carried = MatrixXd::Identity(all_, all_);
    }

    void advance(Index sample) {
        const double duration = record_.at[sample] - record_.at[sample - 1];
        const std::array<double, 1> durations{duration};
        const auto flow =
            record_.system.flow_with_sensitivities(x_, record_.phases[static_cast<std::size_t>(sample - 1)], durations,
                                                   theta_, record_.free, record_.clock, filter_flow);
        now_ = {};
        now_.carried = MatrixXd::Identity(all_, all_);
        steps_ += flow.steps;
        MatrixXd carried = now_.carried;
        if (flow.status == models::FlowStatus::ok && flow.states.allFinite() && flow.sensitivities.allFinite())
            carried.topRows(n_) = record_.range.cwiseInverse().asDiagonal() * flow.sensitivities * scale_.asDiagonal();
        else
            carried.setConstant(std::numeric_limits<double>::infinity());
        const MatrixXd spread = carried * p_ * carried.transpose();
        if (spread.allFinite()) {
            x_ = flow.states.col(0);
            now_.carried = carried;
            p_ = spread;
            const double share = typical_ > 0.0 ? duration / typical_ : 1.0;
            p_.diagonal().head(n_).array() += noise_.process * noise_.process * share;
        } else {
            p_.diagonal().head(n_).array() += unknown_state * unknown_state;
            ++failed_;
        }
    }

    /// Nothing can come of going on from here, after `samples`.
    [[nodiscard]] bool hopeless(Index samples) const {
        constexpr Index enough = 20;
        return 10 * failed_ > samples + enough ||
               steps_ > most_filter_steps * static_cast<std::size_t>(samples + enough);
    }

    void read(Index sample) {
        for (std::size_t i = 0; i < record_.coordinates.size(); ++i) {
            const double value = record_.values(static_cast<Index>(i), sample);
            if (std::isfinite(value)) take(i, value, sample);
        }
        now_.state = x_;
        now_.covariance = p_;
    }

    [[nodiscard]] Step& now() { return now_; }
    [[nodiscard]] std::uint64_t work() const { return flow_work(record_.system, steps_, all_); }
    [[nodiscard]] const VectorXd& theta() const { return theta_; }
    [[nodiscard]] double misfit() const { return misfit_; }
    [[nodiscard]] VectorXd surprise() const {
        constexpr double normal_median = 1.4826;  // sd of a normal error over the median of its absolute value
        VectorXd result(std::ssize(errors_));
        for (std::size_t i = 0; i < errors_.size(); ++i)
            result[static_cast<Index>(i)] = normal_median * models::upper_median(errors_[i]);
        return result;
    }

private:
    struct Reading {
        double error = 0.0;
        VectorXd slope;
    };
    /// What is read at x, against `value`; an infinite error where nothing can be read.
    [[nodiscard]] Reading reading(std::size_t i, double value, Index sample, const VectorXd& x,
                                  const VectorXd& theta) const {
        const std::array<double, 1> phase{record_.phases[static_cast<std::size_t>(sample)]};
        const auto read = record_.system.readings(record_.sensor, x, phase, theta, record_.free, filter_flow);
        const Index row = record_.coordinates[i];
        if (read.status != models::FlowStatus::ok || !std::isfinite(read.readings(row, 0)) ||
            !read.derivatives.row(row).allFinite())
            return {std::numeric_limits<double>::infinity(), {}};
        return {record_.difference(static_cast<Index>(i), value, read.readings(row, 0)),
                read.derivatives.row(row).transpose().cwiseProduct(scale_)};
    }

    void take(std::size_t i, double value, Index sample) {
        constexpr int rounds = 4;
        constexpr double smallest_move = 1e-6;  // of the ranges
        const double sd = noise_.readings[static_cast<Index>(i)];
        VectorXd change = VectorXd::Zero(all_);  // in units of scale_
        Used used;
        double first_error = 0.0;
        for (int round = 0; round < rounds; ++round) {
            const Reading here =
                reading(i, value, sample, x_ + record_.range.cwiseProduct(change.head(n_)), moved(change));
            if (!std::isfinite(here.error)) {
                if (round == 0) return;
                break;
            }
            used.slope = here.slope;
            used.innovation = here.error + here.slope.dot(change);
            const VectorXd spread = p_ * here.slope;
            used.variance = here.slope.dot(spread) + sd * sd;
            used.gain = spread / used.variance;
            if (round == 0) {
                first_error = here.error;
                misfit_ += here.error * here.error / used.variance + std::log(used.variance);
            }
            const VectorXd next = used.gain * used.innovation;
            const bool same = (next - change).norm() <= smallest_move;
            if (!next.allFinite() || !in_domain(record_.system, moved(next))) break;
            change = next;
            if (same) break;
        }
        // (I - K h) P (I - K h)^T + K sd^2 K^T stays positive.
        const MatrixXd kept = MatrixXd::Identity(all_, all_) - used.gain * used.slope.transpose();
        const MatrixXd left = kept * p_ * kept.transpose() + sd * sd * used.gain * used.gain.transpose();
        if (!left.allFinite()) return;
        errors_[i].push_back(std::abs(first_error));
        x_ += record_.range.cwiseProduct(change.head(n_));
        theta_ = moved(change);
        p_ = left;
        now_.used.push_back(std::move(used));
    }

    /// Parameters after a change.
    [[nodiscard]] VectorXd moved(const VectorXd& change) const {
        VectorXd theta = theta_;
        for (std::size_t j = 0; j < record_.free.size(); ++j)
            theta[record_.free[j]] += record_.free_sd[static_cast<Index>(j)] * change[n_ + static_cast<Index>(j)];
        return theta;
    }

    const FollowedRecord& record_;
    const FilterNoise& noise_;
    Index n_;
    Index all_;       ///< coordinates and free parameters
    VectorXd theta_;  ///< shape (q)
    VectorXd scale_;  ///< shape (all_)
    double typical_;
    VectorXd x_;
    MatrixXd p_;
    Step now_;
    double misfit_ = 0.0;
    Index failed_ = 0;       ///< flows that could not be computed
    std::size_t steps_ = 0;  ///< of all flows
    std::vector<std::vector<double>> errors_;
};

/// The way back: what later readings say of earlier states.
MatrixXd smoothed(const FollowedRecord& record, const std::vector<Step>& steps) {
    const Index n = record.system.dimension();
    MatrixXd states(n, std::ssize(steps));
    VectorXd later = VectorXd::Zero(n + std::ssize(record.free));
    for (std::size_t k = steps.size(); k-- > 0;) {
        const Step& step = steps[k];
        const VectorXd state = step.state - record.range.cwiseProduct((step.covariance * later).head(n));
        if (!state.allFinite()) later.setZero();
        states.col(static_cast<Index>(k)) = state.allFinite() ? state : step.state;
        for (auto used = step.used.rbegin(); used != step.used.rend(); ++used)
            later += used->slope * (-used->innovation / used->variance - used->gain.dot(later));
        later = step.carried.transpose() * later;
    }
    return states;
}

}  // namespace

double FollowedRecord::difference(Index row, double reading, double read) const {
    const auto coordinate = static_cast<std::size_t>(coordinates[static_cast<std::size_t>(row)]);
    return models::reads_angle(sensor, system.coordinates(), coordinate) ? models::wrapped(reading - read)
                                                                         : reading - read;
}

FilteredStates filtered_states(const FollowedRecord& record, const VectorXd& start, const FilterNoise& noise,
                               Index samples) {
    Filter filter(record, noise);
    filter.begin(start);
    std::vector<Step> steps;
    for (Index k = 0; k < samples; ++k) {
        if (k > 0) filter.advance(k);
        if (filter.hopeless(k)) return {{}, record.theta, {}, std::numeric_limits<double>::infinity(), filter.work()};
        filter.read(k);
        steps.push_back(std::move(filter.now()));
    }
    return {smoothed(record, steps), filter.theta(), filter.surprise(), filter.misfit(), filter.work()};
}

FilteredStates followed_states(const FollowedRecord& record, const MatrixXd& starts, const VectorXd& roughness,
                               std::uint64_t most_work) {
    constexpr Index looked_at = 500, compared_at = 200;
    constexpr int rounds = 2;
    constexpr std::array<double, 7> reading_shares{1.0, 0.3, 0.1, 0.03, 0.01, 1e-3, 1e-4};
    constexpr std::array<double, 10> process{0.3, 0.1, 0.03, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5};
    const Index samples = record.values.cols();
    const Index few = std::min(samples, looked_at);
    FilterNoise best{roughness, 1e-2};
    double least = std::numeric_limits<double>::infinity();
    VectorXd start = starts.col(0);
    std::uint64_t work = 0;
    const auto misfit_of = [&](const VectorXd& from, const FilterNoise& noise, Index count) {
        const FilteredStates found = filtered_states(record, from, noise, count);
        work += found.work;
        return found.misfit;
    };
    for (Index j = 0; j < starts.cols() && starts.cols() > 1; ++j) {
        const double misfit = misfit_of(starts.col(j), best, std::min(samples, compared_at));
        if (!(misfit < least)) continue;
        least = misfit;
        start = starts.col(j);
    }
    least = std::numeric_limits<double>::infinity();
    const auto consider = [&](const FilterNoise& noise) {
        if (work > most_work) return;
        const double misfit = misfit_of(start, noise, few);
        if (!(misfit < least)) return;
        least = misfit;
        best = noise;
    };
    for (int round = 0; round < rounds; ++round) {
        const VectorXd readings = best.readings;
        for (const double one : process)
            consider({readings, one});
        const double error = best.process;
        for (const double share : reading_shares)
            consider({share * roughness, error});
    }
    FilteredStates result = filtered_states(record, start, best, samples);
    result.work += work;
    return result;
}

}  // namespace orbid::orbits
