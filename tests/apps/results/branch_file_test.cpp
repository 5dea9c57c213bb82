#include "apps/results/branch_file.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/drawing/branch_plot.hpp"
#include "apps/drawing/chart_picture.hpp"
#include "apps/results/cycle_reader.hpp"
#include "apps/results/periodic_summary.hpp"
#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::branch_file_test {
namespace {

using periodic::Bifurcation;
using periodic::Branch;
using periodic::BranchEnd;
using tests::ContainsSubstring;

const auto pendulum = models::make_system("parametric_pendulum");
const models::Parameter& omega = pendulum->parameters()[static_cast<std::size_t>(pendulum->parameter_index("omega"))];

apps::CycleFileHead head() {
    return {"parametric_pendulum",
            apps::series_coordinates(*pendulum),
            0.1,
            std::nullopt,
            2.0 / 3.0,
            apps::fingerprint({{"/seed", "1"}})};
}

periodic::BranchPoint point(double parameter, int period, int unstable, Bifurcation bifurcation = Bifurcation::none) {
    periodic::BranchPoint point;
    point.parameter = parameter;
    point.arclength = 13.0 - parameter;
    point.orbit.status = periodic::OrbitStatus::converged;
    point.orbit.period = period;
    point.orbit.rotation = {period};
    point.orbit.points = Eigen::MatrixXd::Constant(2, period, 1.0 / 3.0);
    for (int j = 0; j < period; ++j)
        point.orbit.points(1, j) = 5.0 + j + parameter / 7.0;
    point.orbit.time = 2.0 / 3.0 * period;
    point.orbit.multipliers = {{unstable > 0 ? -1.5 : -0.5, 0.0}, {-0.1, 0.0}};
    if (bifurcation == Bifurcation::period_doubling) point.orbit.multipliers.front() = -1.0;
    point.unstable = unstable;
    point.bifurcation = bifurcation;
    if (bifurcation != Bifurcation::none) point.parameter_error = 1e-13 / 3.0;
    return point;
}

/// Doublings at 12, 10 and 9.6 on three branches, a fold on the first.
apps::FollowedBranches followed() {
    const auto doubling = Bifurcation::period_doubling;
    Branch first;
    first.first = BranchEnd::start;
    first.points = {point(13, 1, 0), point(12, 1, 0, doubling), point(10, 1, 1), point(9, 1, 1, Bifurcation::fold),
                    point(9.5, 1, 2)};
    first.last = BranchEnd::point_limit;
    Branch second;
    second.origin = Branch::Origin{0, 1};
    second.first = BranchEnd::other_branch;
    second.points = {point(12, 1, 0, doubling), point(11, 2, 0), point(10, 2, 0, doubling), point(9, 2, 1)};
    Branch third;
    third.origin = Branch::Origin{1, 2};
    third.first = third.last = BranchEnd::other_branch;
    third.points = {point(10, 2, 0, doubling), point(9.7, 4, 0), point(9.6, 4, 0, doubling), point(9.5, 4, 1),
                    point(9.4, 2, 0, doubling)};
    return {"", {first, second, third}};
}

TEST_CASE("every bifurcation is listed once, cascades go from branch to branch", "[apps]") {
    const auto branches = followed().branches;
    std::vector<std::pair<std::size_t, std::size_t>> places;
    for (const auto& place : apps::located_bifurcations(branches))
        places.emplace_back(place.branch, place.point);
    CHECK(places == std::vector<std::pair<std::size_t, std::size_t>>{{0, 1}, {0, 3}, {1, 2}, {2, 2}});
    CHECK(apps::branches_from(branches, {0, 1}) == std::vector<std::size_t>{1});
    CHECK(apps::branches_from(branches, {0, 3}).empty());
    const auto cascades = apps::doubling_cascades(branches);
    REQUIRE(cascades.size() == 1);
    REQUIRE(cascades[0].size() == 3);
    CHECK(cascades[0][2].branch == 2);
    CHECK(apps::critical_multiplier(branches[0].points[2].orbit) == std::complex<double>(-1.5, 0.0));
    CHECK(std::isnan(apps::critical_multiplier({}).real()));
}

TEST_CASE("branches are written, tabulated and read back", "[apps]") {
    const std::string text = apps::branches_text(head(), omega, 9.0, 13.0, followed());
    const auto json = nlohmann::json::parse(text);
    CHECK(json["format"] == "orbid-branches/1");
    CHECK(json["parameter"] == nlohmann::json({{"name", "omega"}, {"unit", "rad/s"}, {"range", {9.0, 13.0}}}));
    CHECK(json["message"].is_null());
    CHECK(json["branches"][0]["origin"].is_null());
    CHECK(json["branches"][0]["ends"] == nlohmann::json({"start", "point_limit"}));
    CHECK(json["branches"][1]["origin"] == nlohmann::json({0, 1}));
    const auto& doubling = json["branches"][0]["points"][1];
    CHECK(doubling["bifurcation"] == "period_doubling");
    CHECK(doubling["parameter_error"] == 1e-13 / 3.0);
    CHECK(json["branches"][0]["points"][0]["bifurcation"].is_null());
    CHECK(json["branches"][1]["points"][1]["points"].size() == 2);
    CHECK(json["cascades"][0]["parameter"] == nlohmann::json({12.0, 10.0, 9.6}));
    // (10 - 12) / (9.6 - 10)
    CHECK_THAT(json["cascades"][0]["ratios"][0].get<double>(), tests::WithinRel(5.0, 1e-14));

    const auto stored = apps::stored_branches(text);
    REQUIRE(stored);
    CHECK(apps::fingerprint_from_text(stored->fingerprint).has_value());
    CHECK(apps::branches_text(head(), omega, 9.0, 13.0, stored->followed) == text);
    CHECK(apps::branches_summary(stored->followed, omega) == apps::branches_summary(followed(), omega));
    CHECK_FALSE(apps::stored_branches("{}"));
    CHECK_FALSE(apps::stored_branches("no json"));
    std::string unknown = text;
    unknown.replace(unknown.find("point_limit"), 11, "point_limbo");
    CHECK_FALSE(apps::stored_branches(unknown));

    const std::string csv = apps::branches_csv(head(), omega, followed());
    CHECK_THAT(csv,
               ContainsSubstring("section,phi,phi_dot,frequency,phi_max,phi_min,phi_mean,phi_half_range,phi_rms,") &&
                   ContainsSubstring("phi_dot_rms\n0,0,13,0,1,") &&
                   ContainsSubstring("\n0,1,12,1,1,0.6666666666666666,0,period_doubling,-1,0,0,") &&
                   ContainsSubstring("\n1,1,11,2,2,1.3333333333333333,0,,-0.5,0,1,"));
}

TEST_CASE("branches are told in tables", "[apps]") {
    const std::string text = apps::branches_summary(followed(), omega);
    for (const char* words :
         {"omega [rad/s]", "\"points\" used up", "period doubling of branch 1", "met another branch", "9 ... 13",
          "-1.000000", "fold", "Cascades of period doublings", "4 to 8"}) {
        CAPTURE(text);
        CHECK_THAT(text, ContainsSubstring(words));
    }
    // A short stable stretch is no "0 %".
    auto long_branch = followed();
    auto& points = long_branch.branches[0].points;
    auto unstable = points[0];
    unstable.unstable = 1;
    unstable.bifurcation = {};
    points[0].unstable = 0;
    points.insert(points.end(), 300, unstable);
    CHECK_THAT(apps::branches_summary(long_branch, omega), ContainsSubstring("< 1 %"));
    CHECK_THAT(apps::branches_summary({"orbit 0 is no start", {}}, omega),
               ContainsSubstring("none: orbit 0 is no start"));
}

TEST_CASE("a bifurcation picture shows stable and unstable pieces, marks and units", "[apps]") {
    const auto coordinates = apps::series_coordinates(*pendulum);
    const auto branches = followed().branches;
    const auto count = [](const std::string& text, const std::string& word) {
        std::size_t found = 0;
        for (auto at = text.find(word); at != std::string::npos; at = text.find(word, at + 1))
            ++found;
        return found;
    };
    apps::BranchPicture picture;
    picture.parameter = {std::string(omega.name), std::string(omega.unit), false};
    picture.title = "A & B";
    const auto drawn = [&] {
        return apps::chart_svg(apps::branch_chart(branches, picture), picture.title, apps::run_picture_style);
    };
    // Without a section the time is shown, one curve per branch.
    CHECK_THAT(drawn(), ContainsSubstring(">T [s]<"));
    picture.shown = 1;
    picture.coordinate = coordinates[1];
    const std::string velocity = drawn();
    CHECK_THAT(velocity, ContainsSubstring("A &amp; B") && ContainsSubstring("ω [rad/s]") &&
                             ContainsSubstring("dφ/dt [rad/s]") && ContainsSubstring("period 4") &&
                             ContainsSubstring(">fold<") &&
                             ContainsSubstring("3 branches over omega, 14 orbits, 4 bifurcations located"));
    // Unstable orbits of three periods, and the legend's line.
    CHECK(count(velocity, "stroke-dasharray") == 3 + 1);
    // Unstable: one piece of the first branch, two of the second, four of the third, each with its end.
    std::ptrdiff_t pieces = 0;
    const apps::Chart chart = apps::branch_chart(branches, picture);
    for (const apps::ChartLayer& layer : chart.views.front().layers)
        if (layer.name == "unstable")
            pieces += std::count_if(layer.x.begin(), layer.x.end(), [](double x) { return std::isnan(x); });
    CHECK(pieces == 1 + 2 + 4);
    // One circle per point of the doubling orbits, of periods 1, 2 and 4, one square; each once more in the legend.
    CHECK(count(velocity, "m-4.54 0a4.54 4.54 0 1 0") == 1 + 2 + 4 + 1);
    CHECK(count(velocity, "m-3.49 -3.49h6.99v6.99") == 1 + 1);
    // The same input gives the same bytes.
    CHECK(velocity == drawn());
}

}  // namespace
}  // namespace orbid::branch_file_test
