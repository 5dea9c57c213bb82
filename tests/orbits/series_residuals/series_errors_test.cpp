// Errors of a series beyond one sd per coordinate: distributions, known sds, full covariances, initial parameters.

#include <cmath>
#include <limits>
#include <variant>

#include "models/catalogue/registry.hpp"
#include "orbits/records/series_file.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"

namespace series_errors_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::ScratchFolder;
using tests::WithinRel;

namespace {

const Eigen::VectorXd truth = (Eigen::VectorXd(4) << 0.55, 0.028, 0.8, 0.024).finished();

models::ParameterBinding alpha_binding(Eigen::Index estimated) {
    models::ParameterBinding binding;
    binding.base = truth;
    binding.parameter = {0};
    binding.estimated = {0};
    binding.estimated_count = estimated;
    return binding;
}

/// Populations from (30, 4), exact, two segments of eleven years; no noise.
Series populations() {
    const auto system = models::make_system("lotka_volterra");
    Series series;
    series.sampling = Series::Sampling::samples;
    series.coordinates = {{"u", "1e3", false}, {"v", "1e3", false}};
    for (const double u : {30.0, 20.0}) {
        std::vector<double> times;
        for (int k = 0; k < 11; ++k)
            times.push_back(k);
        const Eigen::Vector2d x0(u, 4.0);
        const auto flow = system->flow(x0, 0.0, times, truth, models::Clock::time, {});
        Segment segment;
        segment.label = std::to_string(series.segments.size());
        segment.values = flow.states;
        segment.times = Eigen::Map<const Eigen::VectorXd>(times.data(), 11);
        segment.deviations = Eigen::MatrixXd::Constant(2, 11, 0.5);
        series.segments.push_back(std::move(segment));
    }
    return series;
}

SeriesResidual residual_with(const SeriesResidualOptions& options, const Series& series = populations(),
                             Eigen::Index estimated = 1) {
    return {models::make_system("lotka_volterra"), alpha_binding(estimated), series, options};
}

}  // namespace

TEST_CASE("distributions, floors and readings reach the estimator", "[orbits]") {
    SeriesResidualOptions options;
    options.forms = {{estimator::LogNormalErrors{}, 0.0, false}, {estimator::StudentErrors{}, 0.01, false}};
    const auto residual = residual_with(options);
    CHECK(std::holds_alternative<estimator::LogNormalErrors>(residual.groups()[0].distribution));
    CHECK(residual.groups()[0].unit == "1");
    CHECK(std::holds_alternative<estimator::StudentErrors>(residual.groups()[1].distribution));
    CHECK(residual.groups()[1].floor == 0.01);
    CHECK(residual.groups()[1].unit == "1e3");
    const auto& block = residual.layout()[0];
    REQUIRE(block.observed.size() == 22);
    CHECK(block.observed[0] == 30.0);
    CHECK(block.observed[11] == 4.0);
    CHECK(block.deviation.size() == 0);
    // Normal errors need neither.
    CHECK(residual_with({}).layout()[0].observed.size() == 0);
}

TEST_CASE("known sds of readings become those of the records", "[orbits]") {
    Series series = populations();
    series.segments[0].values(1, 3) = std::numeric_limits<double>::quiet_NaN();
    series.segments[0].deviations(1, 4) = 0.25;
    SeriesResidualOptions options;
    options.forms = {{}, {estimator::NormalErrors{}, 0.0, true}};
    const auto residual = residual_with(options, series);
    CHECK_FALSE(residual.groups()[0].factor);
    CHECK(residual.groups()[1].factor);
    CHECK(residual.groups()[1].unit == "1");
    const Eigen::VectorXd& deviation = residual.layout()[0].deviation;
    REQUIRE(deviation.size() == 21);  // one reading is missing
    CHECK(deviation[0] == 1.0);
    CHECK(deviation[11] == 0.5);
    CHECK(deviation[14] == 0.25);  // the fourth of v that is there
    CHECK(residual.error_sd(0, 14, 0.1, 2.0, 0.0) == 0.5);
    CHECK_THROWS_WITH(
        [&] {
            series.segments[0].deviations.resize(0, 0);
            return residual_with(options, series);
        }(),
        ContainsSubstring("segment 0: reading 0 of v has no known sd > 0"));
}

TEST_CASE("the sd of an error follows its distribution", "[orbits]") {
    SeriesResidualOptions options;
    options.forms = {{estimator::LogNormalErrors{}, 0.0, false}, {estimator::RelativeErrors{}, 0.0, false}};
    const auto residual = residual_with(options);
    // u = 30 read, 24 predicted, sd of ln u 0.25; v = 4 read, 3 predicted: sqrt(0.3^2 + (0.1 * 3)^2).
    CHECK_THAT(residual.error_sd(0, 0, 6.0, 0.25, 0.0), WithinRel(6.0, 1e-14));
    CHECK_THAT(residual.error_sd(0, 11, 1.0, 0.3, 0.1), WithinRel(std::sqrt(0.18), 1e-14));
}

TEST_CASE("errors that the readings cannot have are refused", "[orbits]") {
    const auto refused_with = []<class Error>(std::type_identity<Error>, auto&& change, const std::string& rule) {
        Series series = populations();
        SeriesResidualOptions options;
        change(series, options);
        CHECK_THROWS_AS(residual_with(options, series), Error);
        CHECK_THROWS_WITH(residual_with(options, series), ContainsSubstring(rule));
    };
    const auto refused = [&](auto&& change, const std::string& rule) {
        refused_with(std::type_identity<orbits::DataError>{}, change, rule);
    };
    const auto refused_call = [&](auto&& change, const std::string& rule) {
        refused_with(std::type_identity<std::invalid_argument>{}, change, rule);
    };
    using S = Series;
    using O = SeriesResidualOptions;
    refused_call([](S&, O& o) { o.forms.resize(1); }, "1 error distributions for 2 observed");
    refused(
        [](S& s, O& o) {
            s.segments[1].values(0, 2) = 0.0;
            o.forms = {{estimator::LogNormalErrors{}, 0.0, false}, {}};
        },
        "segment 1: log-normal errors of u: reading 2 is 0, must be > 0");
    refused([](S&, O& o) { o.forms = {{estimator::RelativeErrors{}, 0.0, true}, {}}; }, "known sds go with normal");
    refused_call([](S&, O& o) { o.covariances = {{{0, 2}, 0.0, {}}}; }, "there is no observed coordinate 2");
    refused(
        [](S& s, O& o) {
            s.segments[0].values(1, 3) = std::numeric_limits<double>::quiet_NaN();
            o.covariances = {{{0, 1}, 0.0, {}}};
        },
        "segment 0: the coordinates of a full covariance must be read at the same samples");
    refused_call(
        [](S&, O& o) {
            o.initial.resize(2);
            o.initial[0].kind = InitialStateRule::Kind::parameter;
            o.initial[0].parameters = {0};
        },
        "initial u: 1 parameters for 2 segments");
    refused_call(
        [](S&, O& o) {
            o.initial.resize(2);
            o.initial[0].kind = InitialStateRule::Kind::parameter;
            o.initial[0].parameters = {0, 1};
        },
        "initial u: no such estimated parameter");

    const auto pendulum = models::make_system("free_pendulum");
    Series swing;
    swing.sampling = Series::Sampling::samples;
    swing.coordinates = {{"phi", "rad", true}};
    swing.segments = {{"0", Eigen::MatrixXd::Ones(1, 5), Eigen::VectorXd::LinSpaced(5, 0.0, 0.4)}};
    models::ParameterBinding binding;
    binding.base = pendulum->default_parameters();
    SeriesResidualOptions options;
    options.forms = {{estimator::LogNormalErrors{}, 0.0, false}};
    CHECK_THROWS_WITH(SeriesResidual(pendulum, binding, swing, options), ContainsSubstring("an angle has no size"));
}

TEST_CASE("an initial value that is a parameter moves the prediction like one", "[orbits]") {
    SeriesResidualOptions options;
    options.initial.resize(2);
    options.initial[0].kind = InitialStateRule::Kind::parameter;
    options.initial[0].parameters = {1, 2};
    const auto residual = residual_with(options, populations(), 3);
    CHECK(residual.free_coordinates() == std::vector<Eigen::Index>{1});
    REQUIRE(residual.layout()[0].latents == 1);
    const Eigen::VectorXd theta = (Eigen::VectorXd(3) << 0.5, 28.0, 21.0).finished();
    const auto latents = residual.initial_latents();
    CHECK(residual.state(0, theta, latents[0])[0] == 28.0);
    CHECK(residual.state(1, theta, latents[1])[0] == 21.0);
    const auto values = residual.evaluate(residual.initial_set(), theta, latents, true);
    for (Eigen::Index j = 0; j < 3; ++j) {
        // Central differences: truncation h^2 and rounding eps / h are both below 1e-8 of the derivative's size, 1
        // ... 50.
        const double h = 1e-5 * theta[j];
        Eigen::VectorXd above = theta, below = theta;
        above[j] += h;
        below[j] -= h;
        const auto up = residual.evaluate(residual.initial_set(), above, latents, false);
        const auto down = residual.evaluate(residual.initial_set(), below, latents, false);
        for (std::size_t b = 0; b < 2; ++b) {
            CAPTURE(j, b);
            const Eigen::VectorXd difference = (up[b].e - down[b].e) / (2.0 * h);
            const double size = 1.0 + difference.cwiseAbs().maxCoeff();
            CHECK((values[b].e_theta.col(j) - difference).cwiseAbs().maxCoeff() < 1e-5 * size);
        }
    }
    CHECK(values[0].e_theta.col(2).isZero(0.0));  // of the other segment
    CHECK(values[0].e_z.cols() == 1);
    // Exact data: the guess from the first readings is the truth, and so is the prediction fitted to the segment.
    CHECK_THAT(residual.guessed_state(0)[0], WithinRel(30.0, 1e-3));
    const Eigen::VectorXd at_truth = (Eigen::VectorXd(3) << 0.55, 1.0, 1.0).finished();
    const auto predictions = residual.predict(at_truth, Eigen::VectorXd::Ones(2), {0, 1});
    CHECK(predictions[0].rms.maxCoeff() < 1e-6);
    CHECK_THAT(predictions[1].state[0], WithinRel(20.0, 1e-6));
}

TEST_CASE("a column of sds is read in the unit of its readings", "[orbits]") {
    TableLayout layout;
    layout.sampling = Series::Sampling::samples;
    layout.time = "t";
    layout.coordinates = {{{"phi", "rad", true}, "angle", "mrad", -1.0, 0.0, "error"}};
    const ScratchFolder folder;
    const auto read = [&](const std::string& text) { return read_csv(folder.file("data.csv", text), layout); };
    const Series series = read("t,angle,error\n0,1000,2\n1,,\n2,500,4\n");
    const Eigen::MatrixXd& sds = series.segments[0].deviations;
    REQUIRE(sds.cols() == 3);
    CHECK(series.segments[0].values(0, 0) == -1.0);
    CHECK_THAT(sds(0, 0), WithinRel(0.002, 1e-14));  // a sd has no sign
    CHECK(std::isnan(sds(0, 1)));
    CHECK_THAT(sds(0, 2), WithinRel(0.004, 1e-14));
    for (const char* wrong : {"", "0", "-1", "inf", "nan"}) {
        CAPTURE(wrong);
        const std::string text = std::string("t,angle,error\n0,1000,2\n1,700,") + wrong + "\n2,500,4\n";
        CHECK_THROWS_AS(read(text), DataError);
        CHECK_THROWS_WITH(
            read(text), ContainsSubstring("data.csv:3, column \"error\"") && ContainsSubstring("must be a number > 0"));
    }
    CHECK_THROWS_WITH(read("t,angle\n0,1\n1,2\n"), ContainsSubstring("error"));
}

}  // namespace series_errors_test
