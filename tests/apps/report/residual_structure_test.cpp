#include "apps/report/plots/residual_structure.hpp"

#include <cmath>
#include <string>
#include <vector>

#include "estimator/interface/random_stream.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/apps/stored_run/stored_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::residual_structure_test {
namespace {

using apps::RecordGroup;
using apps::ResidualRow;
using tests::ContainsSubstring;
using tests::WithinAbs;

/// Residuals e of sd 1, one after the other; predictions are a slow wave.
std::vector<ResidualRow> rows_of(const std::vector<double>& e, const std::string& block = "0", double first = 0.0) {
    std::vector<ResidualRow> rows;
    for (std::size_t k = 0; k < e.size(); ++k) {
        const double t = first + 0.5 * static_cast<double>(k);
        rows.push_back({"run1", block, "x", t, std::sin(0.01 * t) + e[k], std::sin(0.01 * t), 1.0});
    }
    return rows;
}

RecordGroup group_of(const std::vector<std::vector<ResidualRow>*>& blocks) {
    RecordGroup group;
    group.experiment = "other";  // not that of the stored run, whose points are sections
    group.coordinate = group.label = "x";
    for (std::vector<ResidualRow>* rows : blocks) {
        group.blocks.push_back({rows->front().block, {}});
        for (const ResidualRow& row : *rows)
            group.blocks.back().second.push_back(&row);
    }
    return group;
}

/// e_k = rho e_(k - 1) + white noise.
std::vector<double> autoregression(double rho, std::size_t count) {
    estimator::RandomStream stream(7, estimator::RandomPurpose::reading_noise, 0);
    std::vector<double> e{stream.normal()};
    while (e.size() < count)
        e.push_back(rho * e.back() + std::sqrt(1.0 - rho * rho) * stream.normal());
    return e;
}

TEST_CASE("the autocorrelation of an alternating residual is that of its signs", "[apps][report]") {
    std::vector<double> e;
    for (int k = 0; k < 40; ++k)
        e.push_back(k % 2 == 0 ? 1.0 : -1.0);
    auto rows = rows_of(e);
    const auto r = autocorrelation_of(group_of({&rows}), 3);
    REQUIRE(r.size() == 4);
    CHECK_THAT(r[1], WithinAbs(-1.0, 1e-12));
    CHECK_THAT(r[2], WithinAbs(1.0, 1e-12));
    // A missing sample leaves gaps, but does not shift the others.
    rows.erase(rows.begin() + 7);
    const auto gap = autocorrelation_of(group_of({&rows}), 3);
    REQUIRE(gap.size() == 4);
    CHECK_THAT(gap[1], WithinAbs(-1.0, 0.01));
    CHECK_THAT(gap[2], WithinAbs(1.0, 0.01));
    // Of a table that somebody changed: a time before the others has no lag.
    rows.back().at = -100.0;
    const auto backwards = autocorrelation_of(group_of({&rows}), 3);
    REQUIRE(backwards.size() == 4);
    CHECK_THAT(backwards[1], WithinAbs(-1.0, 0.01));
}

TEST_CASE("the autocorrelation of an autoregression falls by its factor, segment by segment", "[apps][report]") {
    constexpr double rho = 0.6;
    const std::vector<double> e = autoregression(rho, 20000);
    auto first = rows_of({e.begin(), e.begin() + 10000}, "a");
    auto second = rows_of({e.begin() + 10000, e.end()}, "b", 1e6);
    const auto r = autocorrelation_of(group_of({&first, &second}), 5);
    // Standard errors of these lags are below 0.013 (Bartlett).
    for (std::size_t k = 0; k < r.size(); ++k)
        CHECK_THAT(r[k], WithinAbs(std::pow(rho, static_cast<double>(k)), 0.04));
    // Its spectrum: (1 - rho^2) / (1 - 2 rho cos w + rho^2); 4 at w = 0 and 1/4 at w = pi.
    const auto chart = apps::spectrum_chart({group_of({&first, &second})});
    REQUIRE(chart.views.size() == 1);
    const auto& power = chart.views[0].layers.back();
    CHECK_THAT(power.y.front(), WithinAbs(4.0, 0.6));
    CHECK_THAT(power.y.back(), WithinAbs(0.25, 0.05));
    CHECK_THAT(power.x.back(), WithinAbs(1.0, 1e-12));  // half of the sampling rate of 2 per unit of time
    // Readings at their own times have no lags.
    for (std::size_t k = 0; k < first.size(); ++k)
        first[k].at += 0.2 * std::sin(static_cast<double>(k * k));
    CHECK(autocorrelation_of(group_of({&first}), 5).empty());
}

TEST_CASE("a residual that depends on the rate is seen against the rate", "[apps][report]") {
    const tests::TemporaryFolder folder;
    tests::write_stored_run(folder.path());
    estimator::RandomStream stream(3, estimator::RandomPurpose::reading_noise, 0);
    std::vector<ResidualRow> rows;
    for (int k = 0; k < 4000; ++k) {
        const double t = 0.05 * k;
        const double rate = std::cos(t);
        rows.push_back({"other", "a, b", "x", t, std::sin(t) + rate + 0.1 * stream.normal(), std::sin(t), 1.0});
    }
    auto group = group_of({&rows});
    const auto chart = apps::dependence_chart(apps::read_stored_run(folder.path()), {group});
    REQUIRE(chart.views.size() == 2);
    CHECK_THAT(chart.views[1].label, ContainsSubstring("rate of x"));
    const auto mean_at = [](const apps::ChartView& view, std::size_t k) { return view.layers.back().y.at(k); };
    // The mean is the rate itself, from -1 to 1, up to the width of a group; against the state there is none.
    const auto& means = chart.views[1].layers.back();
    for (std::size_t k = 0; k < means.x.size(); ++k)
        CHECK_THAT(means.y[k], WithinAbs(means.x[k], 0.03));
    CHECK(mean_at(chart.views[1], 0) < -0.9);
    CHECK_THAT(mean_at(chart.views[0], 12), WithinAbs(0.0, 0.2));
}

TEST_CASE("a predicted segment tells the rms of its error", "[apps][report]") {
    auto rows = rows_of(std::vector<double>(50, 0.25));
    const auto chart = apps::segment_chart({group_of({&rows})});
    REQUIRE(chart.views.size() == 1);
    CHECK_THAT(chart.views[0].label, ContainsSubstring("segment 0: rms of the error 0.25"));
    REQUIRE(chart.views[0].layers.size() == 3);
    CHECK_THAT(chart.views[0].layers[2].y[7], WithinAbs(0.25, 1e-12));
}

}  // namespace
}  // namespace orbid::residual_structure_test
