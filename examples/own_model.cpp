// A model of one's own, fitted to noisy samples: two disc dynamos that drive each other and reverse at random.
#include <array>
#include <cstdio>
#include <memory>
#include <string_view>

#include "estimator/estimate/estimate.hpp"
#include "models/kernels/model_system.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

using namespace orbid;

/// x' = -mu x + z y,   y' = -mu y + (z - a) x,   z' = 1 - x y
/// T. Rikitake, Proceedings of the Cambridge Philosophical Society 54:89-105 (1958).
struct Rikitake {
    static constexpr std::string_view name = "rikitake";
    static constexpr std::string_view summary = "two coupled disc dynamos";
    static constexpr std::string_view equations = "x' = -mu x + z y\ny' = -mu y + (z - a) x\nz' = 1 - x y";
    static constexpr std::array coordinates{models::real("x", "1"), models::real("y", "1"), models::real("z", "1")};
    static constexpr std::array parameters{
        models::Parameter{"mu", "1", models::positive, 1.0, "resistance"},
        models::Parameter{"a", "1", models::any_real, 3.75, "difference of the speeds"}};

    template <class T>
    static models::State<T, 3> rhs(const T& /*time*/, const models::State<T, 3>& x, const models::Values<T, 2>& p) {
        const auto& [mu, a] = p;
        return {-mu * x[0] + x[2] * x[1], -mu * x[1] + (x[2] - a) * x[0], 1.0 - x[0] * x[1]};
    }
};

int main() {
    const auto dynamos = std::make_shared<models::ModelSystem<Rikitake>>();
    const Eigen::VectorXd exact = dynamos->default_parameters();

    // 20 s of both currents; the speed z is not read. Initial states are estimated along.
    orbits::VirtualExperimentOptions experiment{.plan = orbits::SamplePlan{.step = 0.1, .count = 200}};
    experiment.initial = Eigen::Vector3d(1.0, 0.5, 2.0);
    experiment.noise = Eigen::Vector3d(0.01, 0.01, 0.0);
    const orbits::Series record = orbits::simulate(*dynamos, exact, experiment).series;

    const models::ParameterBinding binding{exact, {0, 1}, {0, 1}, 2};
    orbits::SeriesResidualOptions options{.observe = {"x", "y"}};
    options.start = Eigen::Vector2d(0.98, 3.7);
    options.initial.resize(3);
    options.initial[2].start = 2.1;
    orbits::SeriesResidual series(dynamos, binding, record, options);

    const auto result = estimator::estimate(
        {{.name = "mu", .start = 0.98, .scale = estimator::Scale::log, .lower = 0.0}, {.name = "a", .start = 3.7}},
        {&series});
    std::printf("%s\n", estimator::name(result.status).data());
    for (const auto& parameter : result.parameters)
        std::printf("%s = %.2f\n", parameter.name.c_str(), parameter.value);
}
