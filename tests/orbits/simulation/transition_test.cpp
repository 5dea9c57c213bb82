#include "orbits/simulation/transition.hpp"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "models/equations/equation_text.hpp"
#include "tests/catch.hpp"

namespace transition_test {

using namespace orbid;
using orbits::flow_work;
using tests::WithinRel;

namespace {

std::shared_ptr<const models::System> system_of(const std::vector<std::pair<std::string, std::string>>& equations) {
    models::EquationText text;
    for (const auto& [name, rate] : equations)
        text.coordinates.push_back({name, rate});
    for (const char* name : {"s", "r", "b"})
        text.parameters.push_back({name, "1", models::any_real, 2.0});
    std::vector<models::EquationProblem> problems;
    auto system = models::system_from_text(text, problems);
    REQUIRE(problems.empty());
    return system;
}

/// x' = s r b - sin(x) - sin(2 x) - ..., so many sines.
std::shared_ptr<const models::System> sum_of(int sines) {
    std::string rate = "s * r * b";
    for (int k = 1; k <= sines; ++k)
        rate += " - sin(" + std::to_string(k) + " * x)";
    return system_of({{"x", rate}});
}

}  // namespace

TEST_CASE("work counts steps, directions and long formulas", "[orbits][simulation]") {
    const auto hand_written = models::make_system("parametric_pendulum");
    CHECK(flow_work(*hand_written, 100, 0) == 100);
    CHECK(flow_work(*hand_written, 100, 5) == 600);
    const auto lorenz = system_of({{"x", "s * (y - x)"}, {"y", "r * x - y - x * z"}, {"z", "x * y - b * z"}});
    CHECK_THAT(lorenz->evaluation_cost(), WithinRel(1.0, 0.1));
    // A sine counts ten, its factor, the product and the difference one each.
    const double ten = sum_of(10)->evaluation_cost(), twenty = sum_of(20)->evaluation_cost();
    CHECK_THAT(twenty - ten, WithinRel(10.0 * 13.0 / 14.0, 1e-12));
    CHECK_THAT(static_cast<double>(flow_work(*sum_of(20), 100'000, 5)), WithinRel(6e5 * twenty, 1e-6));
}

}  // namespace transition_test
