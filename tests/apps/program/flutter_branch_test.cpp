// The published model of a flutter rig, whose branch of cycles turns back where a tangent is not carried along the
// flow.

#include <string>
#include <vector>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace flutter_branch_test {

using namespace orbid::tests;

namespace {

/// The job of the corpus with a part of its text replaced; empty: as it is.
std::string job_with(const std::string& former, const std::string& now) {
    std::string text = orbid::apps::read_whole_file(source_folder() + "/configs/flutter_branch.json");
    if (former.empty()) return text;
    REQUIRE(text.find(former) != std::string::npos);
    return text.replace(text.find(former), former.size(), now);
}

/// branch.json and orbits.json of a job.
struct Results {
    TemporaryFolder folder;
    json branch, orbits;
    explicit Results(const std::string& job) {
        const Path out = folder.path() / "out";
        const Outcome outcome =
            orbid_with({"run", write_text(folder.path() / "job.json", job), "--out", out, "--force"});
        CAPTURE(outcome.error, outcome.out);
        REQUIRE(outcome.code == 0);
        branch = read_json(out / "branch.json");
        orbits = read_json(out / "orbits.json");
    }
};

// By SciPy 1.10 (DOP853 to 1e-13) with Newton's method on the period, and eigenvalues of the equilibrium by NumPy.
constexpr double period_s = 0.4122494898769;
constexpr double hopf_m_s = 17.957264995600;

/// One way from the Hopf point to 24 m/s, through one fold.
void check_branch(const json& file) {
    REQUIRE(file["branches"].size() == 1);
    const json& branch = file["branches"][0];
    std::vector<double> folds;
    int turns = 0;
    double before = 0.0;
    const json& points = branch["points"];
    for (std::size_t k = 0; k < points.size(); ++k) {
        const double speed = points[k]["parameter"];
        if (points[k]["bifurcation"] == "fold") folds.push_back(speed);
        const double way = k > 0 ? speed - points[k - 1]["parameter"].get<double>() : 0.0;
        if (way * before < 0.0) ++turns;
        if (way != 0.0) before = way;
    }
    CHECK(turns == 1);
    REQUIRE(folds.size() == 1);
    CHECK_THAT(folds[0], WithinAbs(14.6601239469, 1e-9));
    const bool forwards = branch["ends"][0] == "equilibrium";
    CHECK(branch["ends"][forwards ? 0 : 1] == "equilibrium");
    CHECK(branch["ends"][forwards ? 1 : 0] == "bound");
    const json& small = points[forwards ? 0 : points.size() - 1];
    const json& large = points[forwards ? points.size() - 1 : 0];
    CHECK(large["parameter"] == 24.0);
    // The last cycle has 1e-3 of the scale: the speed is off by the square of that.
    CHECK_THAT(small["parameter"].get<double>(), WithinAbs(hopf_m_s, 1e-4));
}

}  // namespace

TEST_CASE("the cycles of the flutter rig are followed from their Hopf point to 24 m/s", "[apps][run][reference]") {
    const Results results(job_with("", ""));
    check_branch(results.branch);
    const json& orbit = results.orbits["cycles"][0];
    CHECK_THAT(orbit["time"].get<double>(), WithinAbs(period_s, 1e-11));
    CHECK_THAT(orbit["frequency"].get<double>(), WithinAbs(1.0 / period_s, 1e-10));
    CHECK_THAT(orbit["multipliers"][0][0].get<double>(), WithinAbs(0.565098806, 1e-8));
    // 20000 equal instants by SciPy: extrema of h to 2e-9 of the motion.
    const json& amplitude = orbit["amplitude"];
    CHECK_THAT(amplitude["max"][0].get<double>(), WithinAbs(0.03201785, 2e-8));
    CHECK_THAT(amplitude["min"][0].get<double>(), WithinAbs(-0.02617786, 2e-8));
    CHECK_THAT(amplitude["mean"][0].get<double>(), WithinAbs(2.87437158e-3, 1e-10));
    CHECK_THAT(amplitude["rms"][0].get<double>(), WithinAbs(0.02075973, 1e-8));
    CHECK_THAT(amplitude["half_range"][2].get<double>(), WithinAbs(0.5 * (0.06281981 + 0.10714706), 2e-8));
    CHECK_THAT(amplitude["mean"][1].get<double>(), WithinAbs(0.0, 1e-10));  // a derivative has none
    // The same orbit on the branch.
    for (const json& point : results.branch["branches"][0]["points"])
        if (point["parameter"] == 16.5)
            CHECK_THAT(point["amplitude"]["rms"][0].get<double>(), WithinAbs(amplitude["rms"][0].get<double>(), 1e-10));
}

TEST_CASE("whatever section and step, the branch of the rig does not turn back", "[apps][run]") {
    const std::string section = R"("section": { "coordinate": "h", "value": 0, "direction": 1 },)";
    const std::string start = R"("period": 1, "points": [[0, 0.439, -0.0987, 0.4906, -0.0311, -0.1089]] })";
    const std::string free_start = R"("points": [[0, 0.439, -0.0987, 0.4906, -0.0311, -0.1089]], "time": 0.412 })";
    std::string free_job = job_with(section, "");
    REQUIRE(free_job.find(start) != std::string::npos);
    check_branch(Results(free_job.replace(free_job.find(start), start.size(), free_start)).branch);
    check_branch(Results(job_with("\"plot\": \"h\"", "\"plot\": \"h\", \"step\": { \"largest\": 0.02 }")).branch);
}

TEST_CASE("a cycle on a section through its extremum begins a branch", "[apps][run]") {
    const std::string section = R"("section": { "coordinate": "h", "value": 0, "direction": 1 },)";
    std::string job = job_with(section, R"("section": { "coordinate": "vh", "value": 0, "direction": -1 },)");
    const std::string points = "[[0, 0.439, -0.0987, 0.4906, -0.0311, -0.1089]]";
    REQUIRE(job.find(points) != std::string::npos);
    job.replace(job.find(points), points.size(), "[[0.032, 0, 0.01597, 1.3574, -0.0295, 0.14826]]");
    const Results results(job);
    CHECK_THAT(results.orbits["cycles"][0]["time"].get<double>(), WithinAbs(period_s, 1e-11));
    // Where h is largest.
    CHECK_THAT(results.orbits["cycles"][0]["points"][0][0].get<double>(), WithinAbs(0.03201785, 2e-8));
    check_branch(results.branch);
}

}  // namespace flutter_branch_test
