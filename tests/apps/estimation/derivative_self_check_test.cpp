// Derivatives are compared with differences before an estimate: a model that loses them ends the run.

#include "identification/starts/derivative_self_check.hpp"

#include <cmath>

#include "models/catalogue/registry.hpp"
#include "models/kernels/model_system.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace derivative_self_check_test {

using namespace orbid;
using namespace orbid::identification;
using tests::ContainsSubstring;

namespace {

/// x' = -k x, whose equations throw the derivative with respect to k away.
struct Forgetful {
    static constexpr std::string_view name = "forgetful", summary = "", equations = "";
    static constexpr std::array coordinates{models::real("x", "1")};
    static constexpr std::array parameters{models::Parameter{"k", "1/s", models::positive, 0.8, "rate"}};

    template <class T>
    static models::State<T, 1> rhs(const T& /*t*/, const models::State<T, 1>& x, const models::Values<T, 1>& p) {
        using models::value_of;
        return {-value_of(p[0]) * x[0]};
    }
};

FlowStart start_of(std::shared_ptr<const models::System> system, const Eigen::VectorXd& state) {
    FlowStart start;
    start.theta = system->default_parameters();
    start.system = std::move(system);
    start.state = state;
    start.durations = {0.1, 0.5};
    start.free = {0};
    return start;
}

}  // namespace

TEST_CASE("a model that loses a derivative is refused by the name of the entry", "[apps]") {
    const auto start = start_of(std::make_shared<models::ModelSystem<Forgetful>>(), Eigen::VectorXd::Ones(1));
    CHECK_THROWS_AS(compare_derivatives(start), WrongModel);
    CHECK_THROWS_WITH(
        compare_derivatives(start),
        ContainsSubstring("model forgetful: its derivatives are not those of its equations") && ContainsSubstring("k"));
}

TEST_CASE("models of the library agree with differences", "[apps]") {
    CHECK_THAT(compare_derivatives(start_of(models::make_system("lorenz"), Eigen::Vector3d(1.0, 2.0, 20.0))),
               ContainsSubstring("model lorenz: derivatives agree with differences"));
    auto large = start_of(models::make_system("lorenz96", "", 200), Eigen::VectorXd::Ones(200));
    CHECK_THAT(compare_derivatives(large), ContainsSubstring("not compared with differences: 201 directions"));
}

TEST_CASE("the log of a run says how derivatives agree", "[apps][run]") {
    const tests::TemporaryFolder work;
    const auto out = work.path() / "out";
    const auto job = tests::write_text(work.path() / "job.json", R"({ "model": { "name": "duffing" },
      "data": { "simulate": { "samples": { "step": 0.05, "count": 101 }, "initial": [[1, 0]], "noise": { "x": 0.01 } } },
      "estimate": { "parameters": { "delta": { "start": 0.33 } }, "residuals": [ { "type": "series" } ] } })");
    const auto run = tests::orbid_with({"run", job, "--out", out, "--quiet"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    CHECK_THAT(orbid::apps::read_whole_file(out / "log.txt"),
               ContainsSubstring("model duffing: derivatives agree with differences; worst: d "));
}

}  // namespace derivative_self_check_test
