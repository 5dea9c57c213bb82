#include "identification/structure/sign_choice.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace orbid::identification {

namespace {

/// Rounding of a formula of some ten operations.
constexpr double rounding = 1e-12;
constexpr Eigen::Index most_coordinates = 8;

bool has_sign(const InitialValue& initial) {
    if (!initial.estimate) return initial.value.value_or(0.0) != 0.0;
    return initial.is_parameter() || estimator::is_proper(initial.prior);
}

/// Rates and readings at a state.
struct Sight {
    Eigen::VectorXd rates, readings;
};

Sight sight_of(const models::System& system, const Experiment& data, const Eigen::VectorXd& state, double phase,
               const Eigen::VectorXd& theta) {
    const std::vector<double> phases{phase};
    const Eigen::MatrixXd readings = system.readings(data.sensor, state, phases, theta).readings;
    return {system.rhs(state, phases, theta).col(0), readings(data.observe, 0)};
}

bool same(const Eigen::VectorXd& a, const Eigen::VectorXd& b, double size) {
    return a.allFinite() && b.allFinite() && (a - b).cwiseAbs().maxCoeff() <= rounding * size;
}

Eigen::VectorXd signs_of(std::uint32_t pattern, Eigen::Index n) {
    Eigen::VectorXd signs = Eigen::VectorXd::Ones(n);
    for (Eigen::Index i = 0; i < n; ++i)
        if ((pattern >> i) & 1U) signs[i] = -1.0;
    return signs;
}

/// A set that is the difference of sets found before says nothing new.
bool composed(std::uint32_t pattern, const std::vector<std::uint32_t>& found) {
    std::vector<std::uint32_t> span{0};
    for (const std::uint32_t one : found)
        for (std::size_t k = span.size(); k-- > 0;)
            span.push_back(span[k] ^ one);
    return std::find(span.begin(), span.end(), pattern) != span.end();
}

}  // namespace

std::vector<std::vector<std::string>> sign_choices(const IdentificationProblem& problem, const EstimateSetup& setup,
                                                   const CourseDraws& draws,
                                                   const std::vector<CourseInformation>& courses) {
    const Eigen::Index n = problem.system->dimension();
    std::vector<std::vector<std::string>> choices;
    if (n > most_coordinates || courses.empty()) return choices;
    std::uint32_t determined = 0;
    for (const std::size_t e : problem.series->data)
        for (std::size_t i = 0; i < problem.experiments[e].initial_state.size(); ++i)
            if (has_sign(problem.experiments[e].initial_state[i])) determined |= 1U << i;
    std::vector<std::uint32_t> patterns;
    for (std::uint32_t pattern = 1; pattern < (1U << n); ++pattern)
        if ((pattern & determined) == 0) patterns.push_back(pattern);
    for (std::size_t k = 0; k < courses.size() && !patterns.empty(); ++k) {
        const CourseInformation& course = courses[k];
        const Experiment& data = problem.experiments[course.experiment];
        const models::System& system = draws.system(course.experiment, course.index);
        const Eigen::VectorXd theta = setup.experiments[course.experiment].values(draws.parameters(course.draw));
        const Sight here = sight_of(system, data, course.state, course.phase, theta);
        const double rate = here.rates.cwiseAbs().maxCoeff(), reading = here.readings.cwiseAbs().maxCoeff();
        std::erase_if(patterns, [&](std::uint32_t pattern) {
            const Eigen::VectorXd signs = signs_of(pattern, n);
            const Sight there = sight_of(system, data, signs.cwiseProduct(course.state), course.phase, theta);
            return !same(there.rates, signs.cwiseProduct(here.rates), rate) ||
                   !same(there.readings, here.readings, reading);
        });
    }
    std::stable_sort(patterns.begin(), patterns.end(),
                     [](std::uint32_t a, std::uint32_t b) { return std::popcount(a) < std::popcount(b); });
    std::vector<std::uint32_t> found;
    for (const std::uint32_t pattern : patterns) {
        if (composed(pattern, found)) continue;
        found.push_back(pattern);
        choices.emplace_back();
        for (Eigen::Index i = 0; i < n; ++i)
            if ((pattern >> i) & 1U) choices.back().emplace_back(problem.coordinate(i).name);
    }
    return choices;
}

}  // namespace orbid::identification
