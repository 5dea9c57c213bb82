#include "apps/program/command_line.hpp"

#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "apps/program/command_help.hpp"
#include "apps/program/command_table.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace command_line_test {

using namespace orbid::apps;
using orbid::tests::ContainsSubstring;

namespace {

/// Exit code and what was printed.
struct Outcome {
    int code;
    std::string out;
    std::string error;
};

Outcome outcome(const std::vector<std::string>& arguments) {
    std::ostringstream out;
    std::ostringstream error;
    auto* former_out = std::cout.rdbuf(out.rdbuf());
    auto* former_error = std::cerr.rdbuf(error.rdbuf());
    const int code = run_command(arguments);
    std::cout.rdbuf(former_out);
    std::cerr.rdbuf(former_error);
    return {code, out.str(), error.str()};
}

}  // namespace

TEST_CASE("a wrong command line is refused with code 2", "[apps][command]") {
    const auto refused = [](const std::vector<std::string>& arguments) {
        const Outcome result = outcome(arguments);
        CHECK(result.code == 2);
        CHECK(result.out.empty());
        return result.error;
    };
    CHECK_THAT(refused({}), ContainsSubstring("usage: orbid COMMAND"));
    CHECK_THAT(refused({"estimat", "x"}), ContainsSubstring("did you mean \"estimate\"?"));
    CHECK_THAT(refused({"run"}), ContainsSubstring("takes JOB.json, not 0"));
    CHECK_THAT(refused({"run", "a.json", "--thread", "2"}), ContainsSubstring("--thread"));
    CHECK_THAT(refused({"run", "a.json", "--threads", "-1"}), ContainsSubstring("--threads must be >= 0"));
    CHECK_THAT(refused({"check", "no_such_job.json"}), ContainsSubstring("does not exist"));
    CHECK_THAT(refused({"models", "dufing"}), ContainsSubstring("did you mean \"duffing\"?"));
    CHECK_THAT(refused({"new", "duffing", "nothing"}), ContainsSubstring("there is no task"));
}

TEST_CASE("help, models, new and check print what they say", "[apps][command]") {
    CHECK_THAT(outcome({"--help"}).out, ContainsSubstring("estimate") && ContainsSubstring("exit codes"));
    CHECK_THAT(outcome({"run", "--help"}).out, ContainsSubstring("--threads") && ContainsSubstring("example:"));
    CHECK_THAT(outcome({"--version"}).out, ContainsSubstring("orbid "));
    CHECK_THAT(outcome({"models"}).out, ContainsSubstring("parametric_pendulum"));
    CHECK_THAT(outcome({"models", "parametric_pendulum"}).out, ContainsSubstring("k1 sgn(phi')") &&
                                                                   ContainsSubstring("N m s^2") &&
                                                                   ContainsSubstring("crank_as_printed"));
    CHECK_THAT(outcome({"new", "duffing", "cycles"}).out, ContainsSubstring("\"orbits\""));
    const Outcome check = outcome({"check", orbid::tests::source_folder() + "/configs/pendulum_table3.json"});
    CHECK(check.code == 0);
    CHECK_THAT(check.out, ContainsSubstring("1048576 sections on 4 trajectories, 16.8 MB") &&
                              ContainsSubstring("l, k2, k3 from cycles"));
}

TEST_CASE("help has all commands, options and exit codes, examples, and fits 80 columns", "[apps][command]") {
    const std::string overview = outcome({"help"}).out;
    CHECK(overview == outcome({"--help"}).out);
    for (const ExitCode& code : exit_codes())
        CHECK_THAT(overview, ContainsSubstring(fmt::format("{:>5}  ", code.code)));
    for (const EnvironmentVariable& variable : environment_variables())
        CHECK_THAT(overview, ContainsSubstring(variable.name));
    const auto fits = [](const std::string& text) {
        std::istringstream lines(text);
        for (std::string line; std::getline(lines, line);) {
            // A command to be typed is not broken.
            const bool example = line.starts_with("  orbid ") || line.starts_with("usage: ");
            CAPTURE(line);
            CHECK((example || line.size() <= 80));
        }
    };
    fits(overview);
    for (const Command& command : command_table()) {
        CAPTURE(command.name);
        CHECK_THAT(overview, ContainsSubstring("  " + command.name + " "));
        const std::string page = outcome({"help", command.name}).out;
        CHECK(page == outcome({command.name, "--help"}).out);
        fits(page);
        CHECK_FALSE(command.examples.empty());
        for (const CommandExample& example : command.examples)
            CHECK_THAT(page, ContainsSubstring(example.line));
        for (const CommandOption& option : command.options)
            CHECK_THAT(page, ContainsSubstring("--" + option.name));
    }
    const Outcome unknown = outcome({"help", "rum"});
    CHECK(unknown.code == 2);
    CHECK_THAT(unknown.error, ContainsSubstring("did you mean \"run\"?"));
}

TEST_CASE("the page of a model lists what its variants have besides", "[apps]") {
    const Outcome page = outcome({"models", "double_pendulum"});
    REQUIRE(page.code == 0);
    const auto besides = page.out.find("besides, in the variant friction_and_drag:");
    REQUIRE(besides != std::string::npos);
    CHECK(page.out.find("  drag ") > besides);
    CHECK(page.out.find("  offset2 ") < besides);
    // Variants with the same parameters have nothing to list.
    CHECK(outcome({"models", "parametric_pendulum"}).out.find("besides") == std::string::npos);
}

}  // namespace command_line_test
