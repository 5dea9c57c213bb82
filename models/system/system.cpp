#include "models/system/system.hpp"

#include <fmt/format.h>

#include <cassert>
#include <stdexcept>

#include <oneapi/tbb/parallel_for.h>

#include "models/system/left_loop.hpp"

namespace orbid::models {

std::string_view description(FlowStatus status) {
    switch (status) {
        case FlowStatus::ok:
            return "ok";
        case FlowStatus::step_budget:
            return "the step budget was spent; slow and fast scales far apart need a model that says \"stiff\": true";
        case FlowStatus::not_finite:
            return "the state left the range of finite numbers";
        case FlowStatus::grazing:
            return "a switching surface was touched without crossing it: derivatives do not exist there";
        case FlowStatus::no_crossing:
            return "the section was not reached within the longest return time";
        case FlowStatus::no_input:
            return "the measured input does not reach that far";
        case FlowStatus::held_twice:
            return "two switching surfaces hold the solution at once";
        case FlowStatus::not_smooth:
            return "the equations jump at these parameters, and the stepper takes smooth ones only";
    }
    return "";
}

namespace {

[[noreturn]] void not_offered(const System& system, std::string_view what) {
    throw std::logic_error(fmt::format("model {} offers no {}", system.name(), what));
}

}  // namespace

Eigen::MatrixXd System::rhs_derivatives(const Eigen::MatrixXd& /*states*/, std::span<const double> /*phases*/,
                                        const Eigen::VectorXd& /*theta*/,
                                        std::span<const Eigen::Index> /*free*/) const {
    not_offered(*this, "derivatives of the equations");
}

std::shared_ptr<const System> System::with_input(std::shared_ptr<const InputSignal> /*signal*/) const {
    not_offered(*this, "measured inputs");
}

std::shared_ptr<const System> System::with_stop(std::function<bool()> /*interrupted*/) const {
    not_offered(*this, "a question whether to stop");
}

std::shared_ptr<const System> System::with_state_size(double /*size*/) const {
    not_offered(*this, "a size of its states");
}

std::vector<FlowResult> System::flows(const Eigen::MatrixXd& starts, std::span<const double> phases,
                                      std::span<const double> durations, const Eigen::VectorXd& theta,
                                      std::optional<std::span<const Eigen::Index>> free, Clock clock,
                                      const FlowOptions& options) const {
    if (std::ssize(phases) != starts.cols())
        throw std::invalid_argument(
            fmt::format("{} phases for {} starts: one per column is needed", phases.size(), starts.cols()));
    std::vector<FlowResult> results(phases.size());
    oneapi::tbb::parallel_for(std::size_t{0}, phases.size(), [&](std::size_t k) {
        const Eigen::VectorXd start = starts.col(static_cast<Eigen::Index>(k));
        results[k] = free ? flow_with_sensitivities(start, phases[k], durations, theta, *free, clock, options)
                          : flow(start, phases[k], durations, theta, clock, options);
    });
    stop_if_left();
    return results;
}

SecondOrderResult System::flow_with_second_derivatives(const Eigen::VectorXd& /*x0*/, double /*phase*/,
                                                       std::span<const double> /*durations*/,
                                                       const Eigen::VectorXd& /*theta*/,
                                                       std::span<const Eigen::Index> /*free*/, Clock /*clock*/,
                                                       const FlowOptions& /*options*/) const {
    not_offered(*this, "second derivatives");
}

CrossingResult System::crossings(const Eigen::VectorXd& /*x0*/, const Section& /*section*/, std::size_t /*count*/,
                                 double /*longest*/, const Eigen::VectorXd& /*theta*/,
                                 std::optional<std::span<const Eigen::Index>> /*free*/,
                                 const FlowOptions& /*options*/) const {
    not_offered(*this, "sections by a plane");
}

EnsembleResult System::crossing_ensemble(const Eigen::MatrixXd& /*starts*/, const Section& /*section*/,
                                         std::size_t /*count*/, double /*longest*/, const Eigen::VectorXd& /*theta*/,
                                         const FlowOptions& /*options*/) const {
    not_offered(*this, "sections by a plane");
}

Eigen::Index System::parameter_index(std::string_view wanted) const {
    const auto table = parameters();
    for (std::size_t i = 0; i < table.size(); ++i)
        if (table[i].name == wanted) return static_cast<Eigen::Index>(i);
    return -1;
}

Eigen::Index System::coordinate_index(std::string_view wanted) const {
    const auto table = coordinates();
    for (std::size_t i = 0; i < table.size(); ++i)
        if (table[i].name == wanted) return static_cast<Eigen::Index>(i);
    return -1;
}

Eigen::VectorXd System::default_parameters() const {
    const auto table = parameters();
    Eigen::VectorXd theta(static_cast<Eigen::Index>(table.size()));
    for (std::size_t i = 0; i < table.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = table[i].default_value;
    return theta;
}

Eigen::VectorXd ParameterBinding::values(const Eigen::VectorXd& theta) const {
    if (theta.size() != estimated_count)
        throw std::invalid_argument(
            fmt::format("parameter vector: length is {}, must be {}", theta.size(), estimated_count));
    assert(parameter.size() == estimated.size());
    Eigen::VectorXd all = base;
    for (std::size_t i = 0; i < parameter.size(); ++i)
        all[parameter[i]] = theta[estimated[i]];
    return all;
}

Eigen::MatrixXd ParameterBinding::spread(const Eigen::MatrixXd& columns) const {
    if (columns.cols() != static_cast<Eigen::Index>(parameter.size()))
        throw std::invalid_argument(
            fmt::format("derivative columns: number is {}, must be {}", columns.cols(), parameter.size()));
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(columns.rows(), estimated_count);
    // Two parameters of the system may stand for one estimated value: their columns add up.
    for (std::size_t i = 0; i < parameter.size(); ++i)
        all.col(estimated[i]) += columns.col(static_cast<Eigen::Index>(i));
    return all;
}

}  // namespace orbid::models
