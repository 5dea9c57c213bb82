#include "orbits/simulation/transition.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "models/arithmetic/median.hpp"
#include "models/arithmetic/singular_values.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/section_map.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Of errors between two nodes. States that were followed to hidden coordinates may begin far off.
constexpr double largest_growth = std::numbers::e * std::numbers::e;
constexpr double largest_growth_hidden = std::numbers::e;
constexpr double largest_error = 0.2;  // of the range

/// What nine of ten stay below.
double usual(std::vector<double> values) {
    const std::size_t place = 9 * values.size() / 10;
    return models::ranked(std::move(values), place);
}

/// One somewhere in each of `count` equal stretches of `total` samples: multiples of the golden ratio fall evenly, and
/// in step with no period of the data.
std::vector<std::size_t> spread_places(std::size_t total, std::size_t count, std::uint64_t seed) {
    const std::size_t wanted = std::min(count, total);
    std::vector<std::size_t> places;
    for (std::size_t i = 0; i < wanted; ++i) {
        const double turns = std::numbers::phi * (static_cast<double>(i) + static_cast<double>(seed % 1000003));
        const double share = wanted == total ? 0.5 : turns - std::floor(turns);
        places.push_back(static_cast<std::size_t>((static_cast<double>(i) + share) * static_cast<double>(total) /
                                                  static_cast<double>(wanted)));
    }
    return places;
}

}  // namespace

models::Clock transition_clock(const models::System& system, const Series& series) {
    const bool sections = series.sampling == Series::Sampling::section;
    return sections && system.kind() == models::Kind::forced ? models::Clock::phase : models::Clock::time;
}

std::vector<Transition> transitions(const models::System& system, const VectorXd& theta, const Series& series,
                                    const models::Sensor& sensor, const std::vector<std::size_t>& segments,
                                    Index interval, std::size_t count, std::uint64_t seed) {
    // Not owned: used within this call only.
    const std::shared_ptr<const models::System> one(std::shared_ptr<const void>(), &system);
    return transitions(std::span(&one, 1), theta, series, sensor, segments, interval, count, seed);
}

std::vector<Transition> transitions(std::span<const std::shared_ptr<const models::System>> systems,
                                    const VectorXd& theta, const Series& series, const models::Sensor& sensor,
                                    const std::vector<std::size_t>& segments, Index interval, std::size_t count,
                                    std::uint64_t seed, std::span<const MatrixXd> known) {
    const models::Clock clock = transition_clock(*systems.front(), series);
    std::vector<std::size_t> chosen_segments = segments;
    if (segments.empty())
        for (std::size_t s = 0; s < series.segments.size(); ++s)
            chosen_segments.push_back(s);
    std::size_t total = 0;
    for (const std::size_t s : chosen_segments)
        total += static_cast<std::size_t>(std::max<Index>(series.segments[s].values.cols() - interval, 0));
    std::vector<Transition> result;
    if (total == 0) return result;
    const std::vector<std::size_t> places = spread_places(total, count, seed);
    std::size_t first = 0;
    auto place = places.begin();
    for (const std::size_t s : chosen_segments) {
        const Segment& data = series.segments[s];
        const auto own = static_cast<std::size_t>(std::max<Index>(data.values.cols() - interval, 0));
        std::vector<Index> samples;
        std::vector<Index> starts;
        for (; place != places.end() && *place < first + own; ++place) {
            const auto k = static_cast<Index>(*place - first);
            starts.push_back(k);
            for (const Index sample : {k, k + interval})
                samples.push_back(sample);
        }
        first += own;
        std::sort(samples.begin(), samples.end());
        samples.erase(std::unique(samples.begin(), samples.end()), samples.end());
        // States that the readings do not say are left to the flow by node_states(): of no use here.
        const auto readable = [&](Index k) {
            if (data.times.size() > 0 || !known.empty()) return true;
            return data.values.col(k).allFinite();
        };
        const models::System& system = *systems[systems.size() == 1 ? 0 : s];
        const MatrixXd states = known.empty() ? node_states(system, theta, series, s, sensor, samples)
                                              : MatrixXd(known[s](Eigen::all, samples));
        const auto state = [&](Index k) {
            return states.col(std::lower_bound(samples.begin(), samples.end(), k) - samples.begin());
        };
        for (const Index k : starts) {
            if (!readable(k) || !readable(k + interval)) continue;
            Transition t{state(k), state(k + interval), phase_at(system, theta, series, data, k), 0.0, s};
            if (!t.from.allFinite() || !t.to.allFinite()) continue;
            const double steps = static_cast<double>(interval);
            if (clock == models::Clock::phase)
                t.duration = 2.0 * std::numbers::pi * steps;
            else
                t.duration = data.times.size() > 0 ? data.times[k + interval] - data.times[k] : steps;
            result.push_back(std::move(t));
        }
    }
    return result;
}

std::uint64_t flow_work(const models::System& system, std::uint64_t steps, Index directions) {
    const double cost = system.evaluation_cost() * static_cast<double>(1 + directions);
    return static_cast<std::uint64_t>(cost * static_cast<double>(steps));
}

std::vector<Prediction> predictions(std::span<const std::shared_ptr<const models::System>> systems,
                                    const VectorXd& theta, const std::vector<Transition>& transitions,
                                    std::optional<std::span<const Index>> free, models::Clock clock,
                                    const models::FlowOptions& flow, std::optional<Index> delay) {
    const auto size = transitions.size();
    std::vector<Prediction> result(size);
    if (size == 0 || !in_domain(*systems.front(), theta)) return result;
    const Index n = systems.front()->dimension();
    // Those with equal durations run together.
    constexpr double equal_durations = 1e-10;  // relative: rounding of times
    constexpr std::size_t together = 512;
    std::vector<std::vector<std::size_t>> groups;
    for (std::size_t i = 0; i < size; ++i) {
        const Transition& t = transitions[i];
        const auto fits = [&](const std::vector<std::size_t>& group) {
            const Transition& other = transitions[group.front()];
            return group.size() < together && (systems.size() == 1 || other.segment == t.segment) &&
                   std::abs(other.duration - t.duration) <= equal_durations * std::abs(t.duration);
        };
        if (groups.empty() || !fits(groups.back())) groups.emplace_back();
        groups.back().push_back(i);
    }
    oneapi::tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) {
        const std::vector<std::size_t>& group = groups[g];
        const models::System& system = *systems[systems.size() == 1 ? 0 : transitions[group.front()].segment];
        MatrixXd starts(n, std::ssize(group));
        std::vector<double> phases(group.size());
        for (std::size_t k = 0; k < group.size(); ++k) {
            starts.col(static_cast<Index>(k)) = transitions[group[k]].from;
            phases[k] = transitions[group[k]].phase - (delay ? theta[*delay] : 0.0);
        }
        const std::array<double, 1> duration{transitions[group.front()].duration};
        const auto flows = system.flows(starts, phases, duration, theta, free, clock, flow);
        for (std::size_t k = 0; k < group.size(); ++k) {
            result[group[k]].cost = flow_cost(flows[k]);
            if (flows[k].status != models::FlowStatus::ok || !flows[k].states.allFinite() ||
                !flows[k].sensitivities.allFinite())
                continue;
            Prediction& p = result[group[k]];
            p.ok = true;
            p.error = wrapped_difference(system, transitions[group[k]].to, flows[k].states.col(0));
            if (!free) continue;
            p.by_x = flows[k].sensitivities.leftCols(n);
            p.by_free = flows[k].sensitivities.rightCols(static_cast<Index>(free->size()));
            const auto at = delay ? std::find(free->begin(), free->end(), *delay) : free->end();
            if (at == free->end()) continue;
            const std::array<double, 2> ends{phases[k], phases[k] + duration[0]};
            MatrixXd states(n, 2);
            states << starts.col(static_cast<Index>(k)), flows[k].states.col(0);
            const MatrixXd f = system.rhs(states, ends, theta);
            p.by_free.col(at - free->begin()) -= f.col(1) - p.by_x * f.col(0);
        }
    });
    return result;
}

VectorXd error_sizes(const models::Sensor& sensor, const VectorXd& range) {
    VectorXd sizes = range;
    if (sensor.type == models::Sensor::Type::angle_difference)
        sizes[static_cast<Index>(sensor.rate)] =
            range[static_cast<Index>(sensor.angle)] * std::numbers::sqrt2 / sensor.delay;
    return sizes;
}

VectorXd prediction_noise(const std::vector<Prediction>& predictions, const VectorXd& sizes) {
    constexpr double normal_median = 1.4826;  // sd of a normal error over the median of its absolute value
    VectorXd noise = VectorXd::Zero(sizes.size());
    for (Index i = 0; i < sizes.size(); ++i) {
        std::vector<double> values;
        for (const Prediction& p : predictions) {
            if (!p.ok || p.by_x.size() == 0) continue;
            const double grown = p.by_x.row(i).transpose().cwiseProduct(sizes).norm() / sizes[i];
            values.push_back(std::abs(p.error[i]) / (sizes[i] * std::hypot(1.0, grown)));
        }
        noise[i] = normal_median * models::upper_median(std::move(values));
    }
    return noise;
}

VectorXd coordinate_range(const models::System& system, const Series& series, const MatrixXd& states) {
    const VectorXd scale = series.scale();
    VectorXd range = state_range(system, states);
    for (Index row = 0; row < series.dimension(); ++row) {
        const Index i = system.coordinate_index(series.coordinate(row).name);
        if (i >= 0 && !system.coordinates()[static_cast<std::size_t>(i)].angle) range[i] = scale[row];
    }
    return range;
}

VectorXd state_range(const models::System& system, const MatrixXd& states) {
    VectorXd range(system.dimension());
    for (Index i = 0; i < range.size(); ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) {
            range[i] = 2.0 * std::numbers::pi;
            continue;
        }
        double lowest = std::numeric_limits<double>::infinity();
        double highest = -lowest;
        for (Index k = 0; k < states.cols(); ++k) {
            if (!std::isfinite(states(i, k))) continue;
            lowest = std::min(lowest, states(i, k));
            highest = std::max(highest, states(i, k));
        }
        range[i] = highest > lowest ? highest - lowest : 1.0;
    }
    return range;
}

Index shooting_interval(std::span<const std::shared_ptr<const models::System>> systems, const VectorXd& theta,
                        const Series& series, const models::Sensor& sensor, const std::vector<std::size_t>& segments,
                        std::span<const MatrixXd> known) {
    if (series.sampling == Series::Sampling::section) return 1;
    constexpr std::size_t looks = 100;
    const models::System& system = *systems.front();
    const double allowed = known.empty() ? largest_growth : largest_growth_hidden;
    Index longest = 1;
    for (const std::size_t s : segments)
        longest = std::max(longest, series.segments[s].values.cols() - 1);
    const auto fits = [&](Index interval) {
        const auto starts = transitions(systems, theta, series, sensor, segments, interval, looks, 0, known);
        if (starts.empty()) return false;
        MatrixXd states(system.dimension(), std::ssize(starts));
        for (std::size_t k = 0; k < starts.size(); ++k)
            states.col(static_cast<Index>(k)) = starts[k].from;
        const VectorXd range = known.empty() ? coordinate_range(system, series, states) : state_range(system, states);
        std::vector<double> growth, error;
        const std::span<const Index> none;
        for (const Prediction& p :
             predictions(systems, theta, starts, none, transition_clock(system, series), {1e-8, 1e-8, 20000})) {
            if (!p.ok) continue;
            const MatrixXd x = range.cwiseInverse().asDiagonal() * p.by_x * range.asDiagonal();
            growth.push_back(models::singular_values(x)[0]);
            error.push_back(p.error.cwiseQuotient(range).cwiseAbs().maxCoeff());
        }
        return 2 * growth.size() > starts.size() && usual(growth) <= allowed && usual(error) <= largest_error;
    };
    // Doubling, then bisection to within an eighth.
    Index good = 1;
    Index bad = longest + 1;
    while (2 * good < bad) {
        if (!fits(2 * good)) {
            bad = 2 * good;
            break;
        }
        good *= 2;
    }
    while (bad - good > std::max<Index>(1, good / 8)) {
        const Index middle = (good + bad) / 2;
        (fits(middle) ? good : bad) = middle;
    }
    return good;
}

}  // namespace orbid::orbits
