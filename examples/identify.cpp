// A model of one's own, identified from a long chaotic record in a table: no start that is close is needed.
#include <array>
#include <cstdio>
#include <memory>
#include <string_view>

#include "identification/strategy/identify.hpp"
#include "models/kernels/model_system.hpp"
#include "orbits/records/series_file.hpp"

using namespace orbid;

/// Two disc dynamos that drive each other and reverse at random; as in own_model.cpp, where the source is named.
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

int main(int argc, char** argv) {
    orbits::TableLayout table{.sampling = orbits::Series::Sampling::samples, .time = "t"};
    for (const char* name : {"x", "y", "z"})
        table.coordinates.push_back({.coordinate = {.name = name, .unit = "1"}, .column = name});

    identification::IdentificationProblem problem;
    problem.system = std::make_shared<models::ModelSystem<Rikitake>>();
    problem.parameters = {identification::free_parameter(*problem.system, "mu", 1.5),
                          identification::free_parameter(*problem.system, "a", 2.0)};
    problem.experiments = {
        {.name = "dynamos",
         .series = std::make_shared<orbits::Series>(orbits::read_csv(argc > 1 ? argv[1] : "dynamos.csv", table))}};

    const auto result = identification::identify(problem);
    std::printf("%s\n", estimator::name(result.estimate.status).data());
    for (const auto& parameter : result.estimate.parameters)
        std::printf("%s = %.4f, 95 %% within %.4f and %.4f\n", parameter.name.c_str(), parameter.value,
                    parameter.lower95, parameter.upper95);
}
