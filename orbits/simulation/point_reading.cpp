#include "orbits/simulation/point_reading.hpp"

#include "models/arithmetic/lu_factor.hpp"
#include "orbits/records/refusal.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A quotient over a small part of the period is nearly the rate itself: three or four steps are usual.
constexpr int most_steps = 20;
/// Of a coordinate's size: where a start needs no more digits.
constexpr double settled = 1e-12;

}  // namespace

PointReading::PointReading(const SectionMap& map, const models::Sensor& sensor) : map_(map), sensor_(sensor) {
    refuse_if(map.place().plane && sensor.type != models::Sensor::Type::state,
              "cycle residual: crossings of a plane are read as states");
    refuse_if(sensor.type == models::Sensor::Type::function,
              "cycle residual: points read by formulas do not stand for states");
}

std::optional<PointReadings> PointReading::operator()(const MatrixXd& states, const VectorXd& theta,
                                                      std::span<const Index> free, bool derivatives) const {
    if (!states.allFinite()) return std::nullopt;
    const std::vector<double> phases(static_cast<std::size_t>(states.cols()), map_.phase());
    std::optional<std::span<const Index>> directions;
    if (derivatives) directions = free;
    const models::ReadingResult read =
        map_.system().readings(sensor_, map_.states(states), phases, theta, directions, map_.flow());
    if (read.status != models::FlowStatus::ok || !read.readings.allFinite() || !read.derivatives.allFinite())
        return std::nullopt;
    PointReadings result;
    result.values = map_.points(read.readings);
    if (!derivatives) return result;
    const Index n = map_.system().dimension();
    const Index d = n + static_cast<Index>(free.size());
    for (Index j = 0; j < states.cols(); ++j) {
        result.by_x.push_back(map_.points(map_.directions(read.derivatives.middleCols(j * d, n))));
        result.by_free.push_back(map_.points(read.derivatives.middleCols(j * d + n, d - n)));
    }
    return result;
}

MatrixXd PointReading::states(const MatrixXd& readings, const VectorXd& theta) const {
    MatrixXd result = readings;
    for (Index j = 0; j < readings.cols(); ++j) {
        MatrixXd x = readings.col(j);
        for (int step = 0; step < most_steps; ++step) {
            const auto read = (*this)(x, theta, {}, true);
            if (!read) break;
            const VectorXd error = map_.difference(readings.col(j), read->values);
            const VectorXd move = models::LuFactor(read->by_x[0]).solve(error);
            if (!move.allFinite()) break;
            x += move;
            if ((move.array().abs() < settled * (1.0 + x.col(0).array().abs())).all()) {
                result.col(j) = x;
                break;
            }
        }
    }
    return result;
}

}  // namespace orbid::orbits
