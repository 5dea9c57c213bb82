#include "orbits/observability/course_derivatives.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "orbits/simulation/node_state.hpp"

namespace orbid::orbits {

namespace {

/// Of errors of the first state: what integration errors of 1e-13 may grow by.
constexpr double most_growth = 1e3;
/// A course is followed over 2^-10 of what was asked at first, then four times as far each time.
constexpr int most_halvings = 10;
constexpr std::size_t most_steps = 4000;
constexpr double tolerance = 1e-13;

/// Half of the instants are equally far apart, half in equal ratios from a 1e-5th on.
std::vector<double> instants(double duration) {
    constexpr int half = 24;
    constexpr double first = 1e-5;
    std::vector<double> times;
    for (int k = 0; k < half; ++k) {
        times.push_back(duration * std::pow(first, 1.0 - static_cast<double>(k) / half));
        times.push_back(duration * static_cast<double>(k + 1) / half);
    }
    std::sort(times.begin(), times.end());
    return times;
}

models::FlowOptions flow_options(const Eigen::VectorXd& state) {
    double smallest = 1.0;
    for (const double x : state)
        if (x != 0.0) smallest = std::min(smallest, std::abs(x));
    models::FlowOptions options;
    options.relative_tolerance = tolerance;
    options.absolute_tolerance = tolerance * std::max(smallest, 1e-6);
    options.maximum_steps = most_steps;
    return options;
}

/// Largest absolute values along a course; 1 of a coordinate that stays at 0.
Eigen::VectorXd sizes_of(const models::FlowResult& flow) {
    const Eigen::VectorXd largest = flow.states.cwiseAbs().rowwise().maxCoeff();
    return (largest.array() > 0.0).select(largest, 1.0);
}

/// Instants up to which errors of the start have grown by less than most_growth; 0: none.
Eigen::Index calm_instants(const models::FlowResult& flow, Eigen::Index directions) {
    const Eigen::VectorXd size = sizes_of(flow);
    const Eigen::Index n = size.size();
    for (Eigen::Index k = 0; k < flow.states.cols(); ++k) {
        const Eigen::MatrixXd by_start =
            size.cwiseInverse().asDiagonal() * flow.sensitivity(k, directions).leftCols(n) * size.asDiagonal();
        if (!flow.sensitivity(k, directions).allFinite() || !(by_start.cwiseAbs().maxCoeff() < most_growth)) return k;
    }
    return flow.states.cols();
}

struct Followed {
    std::vector<double> times;
    models::FlowResult flow;
    Eigen::Index calm = 0;
};

/// As far as errors stay small and the flow succeeds.
Followed followed(const ReadCourse& course, const Eigen::VectorXd& theta, std::span<const Eigen::Index> free) {
    const Eigen::Index d = course.state.size() + std::ssize(free);
    Followed best;
    for (int k = most_halvings; k >= 0; k -= 2) {
        Followed next;
        next.times = instants(std::ldexp(course.longest, -k));
        next.flow = course.system.flow_with_sensitivities(course.state, course.phase, next.times, theta, free,
                                                          models::Clock::time, flow_options(course.state));
        if (next.flow.status != models::FlowStatus::ok || !next.flow.states.allFinite()) break;
        next.calm = calm_instants(next.flow, d);
        const bool grown = next.calm < std::ssize(next.times);
        // Of a grown one the later instants are left out: it has to have enough of them.
        if (next.calm > 0 && (best.calm == 0 || !grown || 2 * next.calm > std::ssize(next.times)))
            best = std::move(next);
        if (grown) break;
    }
    return best;
}

}  // namespace

CourseDerivatives course_derivatives(const ReadCourse& course, const Eigen::VectorXd& theta,
                                     std::span<const Eigen::Index> free) {
    const Eigen::Index n = course.state.size(), f = std::ssize(free), d = n + f;
    CourseDerivatives result;
    const Followed at = followed(course, theta, free);
    if (at.calm == 0) return result;
    std::vector<double> phases;
    const double rate = phase_rate(course.system, theta);
    for (Eigen::Index k = 0; k < at.calm; ++k)
        phases.push_back(course.phase + rate * at.times[static_cast<std::size_t>(k)]);
    const models::ReadingResult reading = course.system.readings(course.sensor, at.flow.states.leftCols(at.calm),
                                                                 phases, theta, free, flow_options(course.state));
    if (reading.status != models::FlowStatus::ok || !reading.derivatives.allFinite()) return result;
    Eigen::VectorXd size(d);
    size.head(n) = sizes_of(at.flow);
    for (Eigen::Index j = 0; j < f; ++j) {
        const Eigen::Index parameter = free[static_cast<std::size_t>(j)];
        const double typical = course.system.parameters()[static_cast<std::size_t>(parameter)].typical_size;
        size[n + j] = theta[parameter] != 0.0 ? std::abs(theta[parameter]) : typical;
    }
    const Eigen::Index rows = std::ssize(course.observed);
    Eigen::MatrixXd all(at.calm * rows, d), terms(at.calm * rows, d);
    for (Eigen::Index k = 0; k < at.calm; ++k) {
        const Eigen::MatrixXd by_now = reading.derivatives.middleCols(k * d, d);
        const Eigen::MatrixXd states = at.flow.sensitivity(k, d);
        for (Eigen::Index r = 0; r < rows; ++r) {
            const Eigen::RowVectorXd now = by_now.row(course.observed[static_cast<std::size_t>(r)]);
            Eigen::RowVectorXd row = now.head(n) * states;
            Eigen::RowVectorXd size_of_terms = now.head(n).cwiseAbs() * states.cwiseAbs();
            row.tail(f) += now.tail(f);
            size_of_terms.tail(f) += now.tail(f).cwiseAbs();
            const double norm = size_of_terms.cwiseProduct(size.transpose()).norm();
            all.row(k * rows + r) = norm > 0.0 ? Eigen::RowVectorXd(row / norm) : row;
            terms.row(k * rows + r) = norm > 0.0 ? Eigen::RowVectorXd(size_of_terms / norm) : size_of_terms;
        }
    }
    result.by_state = all.leftCols(n);
    result.by_parameters = all.rightCols(f);
    result.state_terms = terms.leftCols(n);
    result.parameter_terms = terms.rightCols(f);
    result.duration = at.times[static_cast<std::size_t>(at.calm - 1)];
    return result;
}

}  // namespace orbid::orbits
