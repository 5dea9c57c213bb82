// The "periodic" block: what is read, what is written back, what is refused and in which words.

#include <variant>

#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/catch.hpp"

namespace job_periodic_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

/// A job of one block "periodic"; pendulum unless another head is given.
std::string with(const std::string& periodic,
                 const std::string& head = R"("model": { "name": "parametric_pendulum" })") {
    return "{ " + head + ",\n\"periodic\": " + periodic + " }";
}

const std::string start = R"({ "period": 1, "points": [[2.96, 6.40]] })";
const std::string lorenz = R"("model": { "name": "lorenz" })";
const std::string lorenz_section = lorenz + R"(, "section": { "coordinate": "z", "value": 27 })";
const std::string lorenz_start = R"({ "points": [[-13.7, -19.5, 27]], "time": 1.5 })";

apps::Job job_of(const std::string& text) {
    auto reading = apps::read_job(text, job_folder / "job.json");
    CAPTURE(text, reading.problems.empty() ? std::string() : apps::message(reading.problems[0], "job.json"));
    REQUIRE(reading.job);
    return *reading.job;
}

/// The job as job.json holds it, read again, gives the same text.
void check_written_and_read(const apps::Job& job) {
    const std::string text = apps::job_text(job, job_folder);
    CHECK(apps::job_text(job_of(text), job_folder) == text);
}

}  // namespace

TEST_CASE("methods of periodic orbits and their options are read and written", "[apps][job]") {
    const auto plain = job_of(with("{ \"orbits\": [" + start + "] }"));
    const auto& shooting = std::get<periodic::ShootingOptions>(plain.periodic->method);
    CHECK(shooting.tolerance == periodic::ShootingOptions{}.tolerance);
    CHECK(std::isinf(shooting.maximum_distance));
    CHECK(plain.periodic->free.size() == plain.model.system->parameters().size());
    CHECK_FALSE(plain.periodic->stability);
    check_written_and_read(plain);

    const auto fine = job_of(with(R"({ "accuracy": 1e-10, "tolerance": 1e-8, "maximum_iterations": 7, "stability": true,
        "maximum_distance": 0.25, "free": ["l", "m"], "orbits": [)" +
                                  start + "] }"));
    const auto& options = std::get<periodic::ShootingOptions>(fine.periodic->method);
    CHECK(options.flow.relative_tolerance == 1e-10);
    CHECK(options.flow.absolute_tolerance == 1e-10);
    CHECK(options.tolerance == 1e-8);
    CHECK(options.maximum_iterations == 7);
    CHECK(options.maximum_distance == 0.25);
    CHECK(fine.periodic->stability);
    CHECK(fine.periodic->free ==
          std::vector<Eigen::Index>{fine.model.system->parameter_index("l"), fine.model.system->parameter_index("m")});
    check_written_and_read(fine);

    const auto nodes =
        job_of(with(R"({ "method": "finite_difference", "nodes": 51, "free": [], "orbits": [)" + start + "] }"));
    CHECK(std::get<periodic::FiniteDifferenceOptions>(nodes.periodic->method).nodes == 51);
    CHECK(nodes.periodic->free.empty());
    check_written_and_read(nodes);

    const auto order = job_of(with(R"({ "method": "collocation", "order": 6, "intervals": 7, "accuracy": 1e-6,
        "orbits": [)" + start + "] }"));
    const auto& collocation = std::get<periodic::CollocationOptions>(order.periodic->method);
    CHECK(collocation.stages == 3);
    CHECK(collocation.intervals == 7);
    CHECK(collocation.accuracy == 1e-6);
    check_written_and_read(order);

    const auto course = job_of(with("{ \"orbits\": [" + lorenz_start + "] }", lorenz));
    CHECK(course.periodic->orbits[0].time == 1.5);
    CHECK(course.periodic->orbits[0].period == 1);
    check_written_and_read(course);
}

TEST_CASE("what is wrong with periodic orbits in a job is said where it stands", "[apps][job]") {
    const auto refused = [](const std::string& periodic, const std::string& expected) {
        check_only(with(periodic), expected);
    };
    const auto of_start = [&](const std::string& orbit, const std::string& expected) {
        refused("{ \"orbits\": [" + orbit + "] }", expected);
    };
    refused("{}", "job.json:2: /periodic: needs \"orbits\"");
    refused("7", "job.json:2: /periodic: must be an object");
    refused("{ \"orbits\": [] }", "/periodic/orbits: must not be empty");
    refused("{ \"method\": \"shooting\",\n\"orbits\": [" + start + "] }",
            "job.json:2: /periodic/method: unknown value \"shooting\"");
    refused("{ \"nodes\": 100, \"orbits\": [" + start + "] }",
            "/periodic/nodes: belongs to \"method\": \"finite_difference\"");
    refused("{ \"order\": 4, \"orbits\": [" + start + "] }", "/periodic/order: belongs to \"method\": \"collocation\"");
    refused(R"({ "method": "finite_difference", "accuracy": 1e-9, "orbits": [)" + start + "] }",
            "/periodic/accuracy: belongs to \"method\"");
    refused(R"({ "method": "finite_difference", "nodes": 4, "orbits": [)" + start + "] }",
            "/periodic/nodes: must be a whole number from 5 to 1000000, not 4");
    refused(R"({ "method": "collocation", "order": 5, "orbits": [)" + start + "] }",
            "/periodic/order: must be even, not 5");
    refused(R"({ "method": "collocation", "order": 22, "orbits": [)" + start + "] }",
            "/periodic/order: must be a whole number from 2 to 20, not 22");
    refused(R"({ "method": "collocation", "stability": true, "orbits": [)" + start + "] }",
            "/periodic/stability: needs \"method\": \"multiple_shooting\"");
    refused("{ \"accuracy\": 0, \"orbits\": [" + start + "] }", "/periodic/accuracy: must be > 0 and <= 0.01, not 0");
    refused("{ \"tolerance\": -1, \"orbits\": [" + start + "] }", "/periodic/tolerance: must be > 0, not -1");
    refused("{ \"maximum_distance\": 0, \"orbits\": [" + start + "] }", "/periodic/maximum_distance: must be > 0");
    refused("{ \"free\": [\"lenght\"], \"orbits\": [" + start + "] }",
            "/periodic/free/0: the model parametric_pendulum has no parameter \"lenght\"");
    refused("{ \"free\": [\"l\", \"l\"], \"orbits\": [" + start + "] }", "/periodic/free/1: \"l\" is listed twice");
    refused("{ \"orbit\": [" + start + "], \"orbits\": [" + start + "] }",
            "/periodic/orbit: unknown key; did you mean \"orbits\"?");

    of_start(R"({ "period": 0, "points": [[1, 2]] })",
             "/periodic/orbits/0/period: must be a whole number from 1 to 1000, not 0");
    of_start(R"({ "period": -1, "points": [[1, 2]] })", "/periodic/orbits/0/period: must be a whole number");
    of_start(R"({ "points": [[1, 2]] })", "/periodic/orbits/0: \"period\" is missing");
    of_start(R"({ "period": 1 })", "/periodic/orbits/0: \"points\" is missing");
    of_start(R"({ "period": 2, "points": [[1, 2]] })",
             "/periodic/orbits/0/points: must hold one state per period: 2, not 1");
    of_start(R"({ "period": 1, "points": [[1, 2, 3]] })",
             "/periodic/orbits/0/points/0: must be a state of 2 numbers [phi, phi_dot], not 3");
    of_start(R"({ "period": 1, "rotation": [1, 0], "points": [[1, 2]] })",
             "/periodic/orbits/0/rotation: must hold one number per angle of the model: 1, not 2");
    of_start(R"({ "period": 1, "rotation": 0.5, "points": [[1, 2]] })",
             "/periodic/orbits/0/rotation: must be a whole number");
    of_start(R"({ "period": 1, "time": 0.7, "points": [[1, 2]] })",
             "/periodic/orbits/0/time: follows from \"period\": must be left out");
}

TEST_CASE("periodic orbits of autonomous models and of maps have rules of their own", "[apps][job]") {
    check_only(with(R"({ "orbits": [ { "period": 2, "points": [[1, 1, 27], [2, 2, 27]] } ] })", lorenz),
               "/periodic/orbits/0: the model lorenz is autonomous: needs a \"section\" in the job");
    check_only(with(R"({ "orbits": [ { "period": 2, "time": 1, "points": [[1, 1, 27], [2, 2, 27]] } ] })", lorenz),
               "/periodic/orbits/0/period: counts crossings of a section, and the job has none: must be 1");
    check_only(with(R"({ "orbits": [ { "time": 1, "points": [[1, 1, 27], [2, 2, 27]] } ] })", lorenz),
               "/periodic/orbits/0/points: must hold one state where there is no section, not 2");
    for (const std::string time : {"0", "-1"}) {
        check_only(with("{ \"orbits\": [ { \"time\": " + time + ", \"points\": [[1, 1, 27]] } ] }", lorenz),
                   "/periodic/orbits/0/time: must be > 0, not " + time);
    }
    check_only(with(R"({ "orbits": [ { "period": 1, "time": 1, "points": [[1, 1, 27]] } ] })", lorenz_section),
               "/periodic/orbits/0/time: follows from the crossings of the section: must be left out");
    check_only(with(R"({ "method": "collocation", "orbits": [ { "period": 1, "points": [[0.6, 0.2]] } ] })",
                    R"("model": { "name": "henon" })"),
               "/periodic/method: the model henon is a map: must be \"multiple_shooting\"");
    check_only(with("{ \"method\": \"collocation\", \"orbits\": [" + start + "] }",
                    R"("model": { "name": "parametric_pendulum", "parameters": { "k1": 1e-3 } })"),
               "/periodic/method: the model parametric_pendulum is not smooth at these parameters");
    const auto driven = problems(with(R"({ "orbits": [ { "period": 1, "points": [[0, 0]] } ] })",
                                      R"("model": { "name": "landing_gear_damper", "variant": "measured_base" })"));
    CAPTURE(driven);
    REQUIRE_FALSE(driven.empty());
    CHECK_THAT(driven[0], ContainsSubstring("/periodic: the model landing_gear_damper is driven by measured inputs"));
}

TEST_CASE("searches and continuations are read with their defaults and written in full", "[apps][job]") {
    const auto plain = job_of(
        with(R"({ "search": { "periods": [1, 2, 3] } })", R"("seed": 7, "model": { "name": "parametric_pendulum" })"));
    REQUIRE(plain.periodic->search);
    CHECK(plain.periodic->search->periods == std::vector<int>{1, 2, 3});
    CHECK(plain.periodic->search->seed == 7);
    CHECK(plain.periodic->search->symmetry);
    CHECK(plain.periodic->search->points == periodic::OrbitSearchOptions{}.points);
    check_written_and_read(plain);
    CHECK_FALSE(job_of(with(R"({ "search": { "periods": [1] } })", R"("model": { "name": "henon" })"))
                    .periodic->search->symmetry);

    const auto full = job_of(with(R"({ "search": { "periods": [2], "points": 500, "trajectories": 3, "seed": 9,
        "patience": 11, "symmetry": false, "stabilised": false, "initial": [[1, 2, 30], [3, 4, 20]] } })",
                                  lorenz_section));
    const auto& search = *full.periodic->search;
    CHECK(search.points == 500);
    CHECK(search.trajectories == 3);
    CHECK(search.seed == 9);
    CHECK(search.patience == 11);
    CHECK_FALSE(search.symmetry);
    CHECK_FALSE(search.stabilised);
    CHECK(search.initial.col(1) == Eigen::Vector3d(3, 4, 20));
    check_written_and_read(full);

    const auto branch = job_of(with("{ \"orbits\": [" + start + R"(],
        "continuation": { "parameter": "omega", "to": 8.5 } })"));
    const auto& options = branch.periodic->continuation->options;
    CHECK(options.parameter == branch.model.system->parameter_index("omega"));
    CHECK(options.lower == 8.5);
    CHECK(options.upper == branch.model.values[options.parameter]);
    CHECK(options.direction == -1);
    CHECK(options.switch_doublings);
    CHECK(options.switch_symmetry);
    // The angle comes first, the velocity says more.
    CHECK(branch.periodic->continuation->plotted == branch.model.system->coordinate_index("phi_dot"));
    check_written_and_read(branch);

    const auto all = job_of(with("{ \"orbits\": [" + lorenz_start + R"(],
        "continuation": { "parameter": "rho", "range": [20, 30], "direction": 1, "orbit": 0,
          "step": { "first": 0.02, "smallest": 1e-5, "largest": 0.2 }, "points": 40, "branches": 3,
          "switch": ["symmetry_breaking"], "maximum_period": 4, "maximum_time": 50, "plot": "x" } })",
                                 lorenz));
    const auto& asked = all.periodic->continuation->options;
    CHECK(asked.direction == 1);
    CHECK(asked.first_step == 0.02);
    CHECK(asked.smallest_step == 1e-5);
    CHECK(asked.largest_step == 0.2);
    CHECK(asked.maximum_points == 40);
    CHECK(asked.maximum_branches == 3);
    CHECK_FALSE(asked.switch_doublings);
    CHECK(asked.switch_symmetry);
    CHECK(asked.maximum_period == 4);
    CHECK(asked.longest == 50.0);
    CHECK(all.periodic->continuation->plotted == 0);
    check_written_and_read(all);
    // Where an orbit without a section begins is arbitrary.
    CHECK_FALSE(
        job_of(
            with("{ \"orbits\": [" + lorenz_start + R"(], "continuation": { "parameter": "rho", "to": 30 } })", lorenz))
            .periodic->continuation->plotted);
}

TEST_CASE("what is wrong with searches and continuations is said where it stands", "[apps][job]") {
    const auto search = [](const std::string& block, const std::string& expected) {
        check_only(with("{\n\"search\": " + block + " }"), expected);
    };
    search("{ }", "job.json:3: /periodic/search: \"periods\" is missing");
    search(R"({ "periods": [] })", "/periodic/search/periods: must not be empty");
    search(R"({ "periods": [1, 2, 1] })", "/periodic/search/periods/2: 1 is listed twice");
    search(R"({ "periods": [0] })", "/periodic/search/periods/0: must be a whole number from 1");
    search(R"({ "periods": [1], "points": 99 })", "/periodic/search/points: must be a whole number from 100");
    search(R"({ "periods": [1], "trajectories": 0 })", "/periodic/search/trajectories: must be a whole number from 1");
    search(R"({ "periods": [1], "initial": [[1, 2, 3]] })",
           "/periodic/search/initial/0: must be a state of 2 numbers [phi, phi_dot], not 3");
    search(R"({ "periods": [1], "point": 1000 })", "/periodic/search/point: unknown key; did you mean \"points\"?");
    check_only(with(R"({ "search": { "periods": [1] } })", lorenz),
               "/periodic/search: the model lorenz is autonomous: needs a \"section\" in the job");
    check_only(with(R"({ "search": { "periods": [1], "symmetry": true } })", R"("model": { "name": "henon" })"),
               "/periodic/search/symmetry: the model henon declares no symmetry; must be false");

    const auto branch = [](const std::string& block, const std::string& expected) {
        check_only(with("{ \"orbits\": [" + start + "],\n\"continuation\": " + block + " }"), expected);
    };
    branch("{ \"to\": 8 }", "job.json:3: /periodic/continuation: \"parameter\" is missing");
    branch(R"({ "parameter": "omga", "to": 8 })",
           "/periodic/continuation/parameter: the model parametric_pendulum has no parameter \"omga\"; did you mean "
           "\"omega\"?");
    branch(R"({ "parameter": "omega" })", "/periodic/continuation: needs \"range\" or \"to\"");
    branch(R"({ "parameter": "omega", "to": -1 })", "/periodic/continuation/to: omega");
    branch(R"({ "parameter": "omega", "to": 9.09 })",
           "/periodic/continuation/to: is where the branch starts: the model's omega is 9.09");
    branch(R"({ "parameter": "omega", "to": 8, "direction": -1 })",
           "/periodic/continuation/direction: does not go with \"to\"");
    branch(R"({ "parameter": "omega", "to": 8, "range": [8, 10] })",
           "/periodic/continuation/range: stands beside \"to\"");
    branch(R"({ "parameter": "omega", "from": 9, "to": 8 })",
           "/periodic/continuation/from: a branch starts at the model's own value of the parameter");
    branch(R"({ "parameter": "omega", "range": [10, 8] })",
           "/periodic/continuation/range: is empty: 10 must be below 8");
    branch(R"({ "parameter": "omega", "range": [10, 12] })",
           "/periodic/continuation/range: must contain the value that the branch starts at: the model's omega is 9.09");
    branch(R"({ "parameter": "omega", "range": [8] })", "/periodic/continuation/range: must be [lower, upper]");
    branch(R"({ "parameter": "omega", "range": [-8, 10] })", "/periodic/continuation/range/0: omega");
    branch(R"({ "parameter": "omega", "range": [8, 10], "direction": 2 })",
           "/periodic/continuation/direction: must be one of 1, -1, 0");
    branch(R"({ "parameter": "omega", "to": 8, "orbit": 1 })",
           "/periodic/continuation/orbit: must be below 1, the number of starts, not 1");
    branch(R"({ "parameter": "omega", "to": 8, "points": 1 })",
           "/periodic/continuation/points: must be a whole number from 2");
    branch(R"({ "parameter": "omega", "to": 8, "switch": ["doubling"] })",
           "/periodic/continuation/switch/0: unknown value \"doubling\"");
    branch(R"({ "parameter": "omega", "to": 8, "switch": ["period_doubling", "period_doubling"] })",
           "/periodic/continuation/switch/1: \"period_doubling\" is listed twice");
    branch(R"({ "parameter": "omega", "to": 8, "step": { "smallest": 1 } })",
           "/periodic/continuation/step/smallest: the smallest step, 1, is above the largest, 0.05");
    branch(R"({ "parameter": "omega", "to": 8, "step": { "first": 1 } })",
           "/periodic/continuation/step/first: must be between the smallest and the largest step");
    branch(R"({ "parameter": "omega", "to": 8, "step": { "first": 0 } })",
           "/periodic/continuation/step/first: must be > 0, not 0");
    branch(R"({ "parameter": "omega", "to": 8, "maximum_time": 0 })",
           "/periodic/continuation/maximum_time: must be > 0");
    branch(R"({ "parameter": "omega", "to": 8, "plot": "ph" })",
           "/periodic/continuation/plot: the model parametric_pendulum has no coordinate \"ph\"");
    check_only(with(R"({ "orbits": [ { "period": 2, "points": [[1, 1], [2, 2]] } ],
                         "continuation": { "parameter": "omega", "to": 8, "maximum_period": 1 } })"),
               "/periodic/continuation/maximum_period: must be at least the period of the orbit it starts at, 2");
    check_only(with(R"({ "continuation": { "parameter": "omega", "to": 8 } })"),
               "/periodic: a branch needs the orbit that it starts at");
}

}  // namespace job_periodic_test
