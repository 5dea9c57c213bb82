#include "apps/job/flow_stepper.hpp"

#include <fmt/format.h>

#include <string_view>
#include <utility>
#include <vector>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "models/trajectories/odeint/odeint_kernel.hpp"

namespace orbid::apps {

namespace {

/// Parameters that would have to be 0 for smooth equations, no more than needed; empty where that does not help.
std::vector<std::string_view> causes(const models::System& system, const Eigen::VectorXd& theta) {
    const auto table = system.parameters();
    Eigen::VectorXd calm = theta;
    std::vector<Eigen::Index> removed;
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        if (theta[i] != 0.0 && models::contains(table[static_cast<std::size_t>(i)].domain, 0.0)) {
            calm[i] = 0.0;
            removed.push_back(i);
        }
    if (!system.smooth(calm)) return {};
    std::vector<std::string_view> names;
    for (const Eigen::Index i : removed) {
        calm[i] = theta[i];
        if (system.smooth(calm)) continue;
        calm[i] = 0.0;
        names.push_back(table[static_cast<std::size_t>(i)].name);
    }
    return names;
}

std::string jump(const models::System& system, const Eigen::VectorXd& theta, std::string_view where) {
    if (system.smooth(theta)) return {};
    std::string text = fmt::format("the equations jump at the parameters of {}", where);
    if (const auto names = causes(system, theta); !names.empty())
        text += fmt::format(" (they would be smooth with {} = 0)", fmt::join(names, " = "));
    return text;
}

}  // namespace

std::shared_ptr<const models::System> with_stepper(std::shared_ptr<const models::System> system, FlowStepper stepper) {
    return stepper == FlowStepper::verner ? std::move(system) : models::odeint_system(*system);
}

Eigen::VectorXd starting_parameters(const Job& job) {
    Eigen::VectorXd theta = job.model.values;
    if (job.estimate)
        for (const FreeParameterJob& free : job.estimate->parameters)
            theta[free.parameter] = free.value.start;
    return theta;
}

std::string causes_of_jumps(const Job& job) {
    const models::System& system = *job.model.system;
    Eigen::VectorXd theta = starting_parameters(job);
    if (job.estimate)
        for (const FreeParameterJob& free : job.estimate->parameters)
            if (theta[free.parameter] == 0.0)
                theta[free.parameter] = system.parameters()[static_cast<std::size_t>(free.parameter)].typical_size;
    if (system.smooth(theta)) return {};
    const auto names = causes(system, theta);
    return names.empty() ? "the equations" : fmt::format("{}", fmt::join(names, ", "));
}

std::string odeint_refusal(const Job& job) {
    const models::System& system = *job.model.system;
    if (std::string why = models::odeint_refusal(system); !why.empty()) return why;
    if (std::string why = jump(system, job.model.values, "the model"); !why.empty()) return why;
    const Eigen::VectorXd start = starting_parameters(job);
    if (std::string why = jump(system, start, "the estimate's start"); !why.empty()) return why;
    for (const DataJob& data : job.data)
        if (std::string why = jump(system, data.with_own(start), data.name); !why.empty()) return why;
    std::vector<Eigen::Index> moved;
    if (job.estimate)
        for (const FreeParameterJob& free : job.estimate->parameters)
            moved.push_back(free.parameter);
    if (job.periodic && job.periodic->continuation) moved.push_back(job.periodic->continuation->options.parameter);
    const auto jumps = [&](Eigen::Index i) {
        Eigen::VectorXd theta = start;
        theta[i] += system.parameters()[static_cast<std::size_t>(i)].typical_size;
        return !system.smooth(theta);
    };
    for (const Eigen::Index i : moved)
        if (jumps(i))
            return fmt::format("the equations jump as soon as {} leaves its start",
                               system.parameters()[static_cast<std::size_t>(i)].name);
    for (std::size_t k = 0; job.periodic && k < job.periodic->free.size(); ++k)
        if (jumps(job.periodic->free[k]))
            return fmt::format(
                "derivatives by {} jump although it is 0; /periodic/free can name the parameters without it",
                system.parameters()[static_cast<std::size_t>(job.periodic->free[k])].name);
    return {};
}

}  // namespace orbid::apps
