#include "orbits/series_residuals/shooting_interval.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>

#include "models/arithmetic/median.hpp"
#include "models/arithmetic/singular_values.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double largest_growth = 2.7182818284590452;
constexpr double largest_error = 0.2;  // of the range

/// What nine of ten stay below.
double usual(std::vector<double> values) {
    const std::size_t place = 9 * values.size() / 10;
    return models::ranked(std::move(values), place);
}

}  // namespace

Index shooting_interval(std::span<const std::shared_ptr<const models::System>> systems, const VectorXd& theta,
                        const Series& series, const models::Sensor& sensor, const std::vector<std::size_t>& segments) {
    if (series.sampling == Series::Sampling::section) return 1;
    constexpr std::size_t looks = 100;
    const models::System& system = *systems.front();
    Index longest = 1;
    for (const std::size_t s : segments)
        longest = std::max(longest, series.segments[s].values.cols() - 1);
    const auto fits = [&](Index interval) {
        const auto starts = transitions(systems, theta, series, sensor, segments, interval, looks, 0);
        if (starts.empty()) return false;
        MatrixXd states(system.dimension(), std::ssize(starts));
        for (std::size_t k = 0; k < starts.size(); ++k)
            states.col(static_cast<Index>(k)) = starts[k].from;
        const VectorXd range = coordinate_range(system, series, states);
        std::vector<double> growth, error;
        const std::span<const Index> none;
        for (const Prediction& p :
             predictions(systems, theta, starts, none, transition_clock(system, series), {1e-8, 1e-8, 20000})) {
            if (!p.ok) continue;
            const MatrixXd x = range.cwiseInverse().asDiagonal() * p.by_x * range.asDiagonal();
            growth.push_back(models::singular_values(x)[0]);
            error.push_back(p.error.cwiseQuotient(range).cwiseAbs().maxCoeff());
        }
        return 2 * growth.size() > starts.size() && usual(growth) <= largest_growth && usual(error) <= largest_error;
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
