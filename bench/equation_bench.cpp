// Time of a model written as text, interpreted and compiled, over that of the same model in the registry, one thread.
//   equation_bench
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <tbb/global_control.h>

#include "apps/job/model_plugin.hpp"
#include "models/catalogue/registry.hpp"
#include "models/equations/interpreted_kernel.hpp"
#include "models/system/kernel_system.hpp"

namespace {

using namespace orbid;
using Systems = std::vector<std::shared_ptr<const models::System>>;

struct Case {
    std::string name;
    models::EquationText text;
    Eigen::VectorXd x0;
    std::vector<Eigen::Index> free;
    double duration;
};

std::vector<models::EquationText::Parameter> parameters_of(const std::string& name) {
    std::vector<models::EquationText::Parameter> list;
    const auto system = models::make_system(name);
    for (const models::Parameter& p : system->parameters())
        list.push_back({std::string(p.name), std::string(p.unit), p.domain, p.default_value, p.typical_size, ""});
    return list;
}

std::vector<Case> cases() {
    std::vector<Case> list;
    models::EquationText duffing;
    duffing.coordinates = {{"x", "x_dot", "1", false},
                           {"x_dot", "gamma * cos(phase) - delta * x_dot - x * (alpha + beta * x^2)", "1", false}};
    duffing.parameters = parameters_of("duffing");
    duffing.forcing = {"phase", "omega"};
    list.push_back({"duffing", duffing, Eigen::Vector2d(0.3, -0.2), {0, 1, 2, 3}, 20.0});
    models::EquationText lorenz;
    lorenz.coordinates = {{"x", "sigma * (y - x)", "1", false},
                          {"y", "x * (rho - z) - y", "1", false},
                          {"z", "x * y - beta * z", "1", false}};
    lorenz.parameters = parameters_of("lorenz");
    list.push_back({"lorenz", lorenz, Eigen::Vector3d(1.0, 2.0, 20.0), {0, 1, 2}, 3.0});
    models::EquationText pendulum;
    pendulum.coordinates = {
        {"phi", "phi_dot", "rad", true},
        {"phi_dot", "-(k1 * sign(phi_dot) + phi_dot * (k2 + k3 * abs(phi_dot))) / (m * l * l) - P * sin(phi)", "rad/s",
         false}};
    pendulum.definitions = {
        {"square", "sin(phase)^2", "1", false},
        {"root", "1 - epsilon^2 * square", "1", false},
        {"P", "g / l - A * omega^2 / l * (cos(phase) + epsilon * (1 - 2 * square + epsilon^2 * square^2) / root^1.5)",
         "1", false}};
    pendulum.parameters = parameters_of("parametric_pendulum");
    pendulum.forcing = {"phase", "omega"};
    list.push_back({"parametric_pendulum", pendulum, Eigen::Vector2d(1.0, 2.0), {1, 3, 4}, 3.0});
    return list;
}

/// Seconds of processor time of each system's work, the least of several turns, the systems in turn: what else runs on
/// the machine counts as little as possible.
std::vector<double> times(const Systems& systems, const std::function<void(const models::System&)>& work) {
    constexpr int turns = 15;
    std::vector<double> least(systems.size(), 1e300);
    std::vector<int> repeats(systems.size(), 1);
    for (std::size_t i = 0; i < systems.size(); ++i) {
        const std::clock_t from = std::clock();
        work(*systems[i]);
        const double once = static_cast<double>(std::clock() - from) / CLOCKS_PER_SEC;
        repeats[i] = std::max(1, static_cast<int>(0.03 / std::max(once, 1e-6)));
    }
    for (int turn = 0; turn < turns; ++turn)
        for (std::size_t i = 0; i < systems.size(); ++i) {
            const std::clock_t from = std::clock();
            for (int k = 0; k < repeats[i]; ++k)
                work(*systems[i]);
            least[i] = std::min(least[i], static_cast<double>(std::clock() - from) / CLOCKS_PER_SEC / repeats[i]);
        }
    return least;
}

}  // namespace

int main() {
    const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    std::printf("%-20s %-26s %12s %10s %12s\n", "model", "work", "registry", "compiled", "interpreted");
    for (const Case& each : cases()) {
        std::vector<models::EquationProblem> problems;
        const auto equations = models::Equations::read(each.text, problems);
        if (!equations) {
            for (const auto& problem : problems)
                std::fprintf(stderr, "%s: %s\n", each.name.c_str(), problem.rule.c_str());
            return 1;
        }
        std::string why;
        Systems systems{models::make_system(each.name)};
        systems.push_back(std::make_shared<models::KernelSystem>(models::interpreted_kernel(equations, why)));
        const apps::CompiledModel compiled = apps::compiled_model(equations);
        if (compiled.kernel)
            systems.push_back(std::make_shared<models::KernelSystem>(compiled.kernel));
        else
            std::printf("  not compiled: %s\n", compiled.why.c_str());
        const Eigen::VectorXd theta = systems[0]->default_parameters();
        const std::vector<double> durations{each.duration};
        Eigen::MatrixXd starts(each.x0.size(), 512);
        for (Eigen::Index i = 0; i < starts.cols(); ++i)
            starts.col(i) = (0.7 + 0.001 * static_cast<double>(i)) * each.x0;
        const std::vector<double> phases(512, 0.0), short_duration{0.1 * each.duration};
        const auto clock = models::Clock::time;
        const auto report = [&](const char* work, const std::function<void(const models::System&)>& run) {
            const auto t = times(systems, run);
            std::printf("%-20s %-26s %9.3g ms ", each.name.c_str(), work, t[0] * 1e3);
            if (t.size() > 2)
                std::printf("%8.2f x", t[2] / t[0]);
            else
                std::printf("%10s", "-");
            std::printf(" %10.2f x\n", t[1] / t[0]);
            std::fflush(stdout);
        };
        report("flow", [&](const models::System& s) { (void)s.flow(each.x0, 0.0, durations, theta, clock); });
        report("flow with sensitivities", [&](const models::System& s) {
            (void)s.flow_with_sensitivities(each.x0, 0.0, durations, theta, each.free, clock);
        });
        report("second derivatives", [&](const models::System& s) {
            (void)s.flow_with_second_derivatives(each.x0, 0.0, short_duration, theta, each.free, clock);
        });
        report("flows with sensitivities", [&](const models::System& s) {
            (void)s.flows(starts, phases, short_duration, theta, each.free, clock);
        });
        if (systems[0]->kind() == models::Kind::forced)
            report("ensemble", [&](const models::System& s) { (void)s.ensemble(starts.leftCols(256), 0.0, 4, theta); });
        else
            report("sections", [&](const models::System& s) {
                (void)s.crossings(each.x0, {Eigen::Vector3d(0.0, 0.0, 1.0), 27.0, -1}, 4, 10.0, theta, each.free);
            });
    }
    return 0;
}
